"""Plug-ins of other packages: drivers, presentations, measures and importers, by entry points.

A package declares each object in its metadata: a group, a name, and its place as `module:object`. A package is imported
only when one of its objects is used. The metadata are parsed here, because `importlib.metadata` would add 0.2 s to
every start.
"""

from __future__ import annotations

import os
import sys
from configparser import ConfigParser, Error
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from das.domain.errors import DasError

DRIVERS: Final = "das.drivers"
"""Group of drivers: classes with a method command(cab), as for `--driver package.module:Class`."""
PRESENTATIONS: Final = "das.presentations"
"""Group of presentations: objects of `Presenter`, named by the word after --advice."""
MEASURES: Final = "das.measures"
"""Group of measures: functions of a `DriveTable` that return a number or None, named by a column with unit."""
IMPORTERS: Final = "das.importers"
"""Group of importers: functions that read a train in another program's format, named by file extension."""


@dataclass(frozen=True, kw_only=True)
class Door:
    """An object provided by a package: name and place of the object, and the package with its version."""

    name: str
    module: str
    attribute: str
    package: str

    def load(self) -> Any:
        """The imported object; DasError if it cannot be imported."""
        try:
            return getattr(import_module(self.module), self.attribute)
        except Exception as error:
            raise DasError(f"{self.name} of the package {self.package} cannot be loaded ({error})") from error


@cache
def installed(group: str) -> MappingProxyType[str, Door]:
    """The objects that installed packages provide for a group, by name; if names are equal, the first is used."""
    found: dict[str, Door] = {}
    for path in _metadata():
        parser = ConfigParser(delimiters=("=",), interpolation=None)
        parser.optionxform = str  # type: ignore[method-assign,assignment]  # names keep their capitals
        try:
            parser.read_string(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, Error):
            continue
        for name, where in parser.items(group) if parser.has_section(group) else ():
            module, _, attribute = where.partition(":")
            package = path.parent.name.removesuffix(".dist-info").replace("-", " ", 1)
            found.setdefault(name, Door(name=name, module=module, attribute=attribute.strip(), package=package))
    return MappingProxyType(found)


@cache
def _metadata() -> tuple[Path, ...]:
    """The files of entry points on Python's path that name one of our groups."""
    files = (file for folder in dict.fromkeys(sys.path) for file in Path(folder).glob("*.dist-info/entry_points.txt"))
    return tuple(file for file in files if os.access(file, os.R_OK) and b"[das." in file.read_bytes())
