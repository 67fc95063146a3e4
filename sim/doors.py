"""What other packages bring: drivers, presentations, measures and importers, by their entry points.

A package says in its metadata what it brings: a group, a name, and where it is as `module:object`. Nothing of a package
is imported before it is used. The metadata are read by hand: `importlib.metadata` would take every start 0.2 s.
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
"""A class with a method command(cab), as `--driver package.module:Class` names one."""
PRESENTATIONS: Final = "das.presentations"
"""A `Presenter`; its name is the word after --advice."""
MEASURES: Final = "das.measures"
"""A function of a `DriveTable` that gives a number, or None; its name is the column, which ends in its unit."""
IMPORTERS: Final = "das.importers"
"""A function that reads a train of another program from a path; its name is the end of such a file's name."""
GROUPS: Final = (DRIVERS, PRESENTATIONS, MEASURES, IMPORTERS)


@dataclass(frozen=True, kw_only=True)
class Door:
    """Something that a package brings: its name, where it is, and the package with its version."""

    name: str
    module: str
    attribute: str
    package: str

    def load(self) -> Any:
        """The object; DasError if it cannot be imported."""
        try:
            return getattr(import_module(self.module), self.attribute)
        except Exception as error:
            raise DasError(f"{self.name} of the package {self.package} cannot be loaded ({error})") from error


@cache
def installed(group: str) -> MappingProxyType[str, Door]:
    """What all packages that are installed bring to a group, by name; the first of a name counts."""
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
