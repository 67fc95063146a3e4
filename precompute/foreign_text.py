"""Reading text files of other origin: CSV with other separators, comments and decimal commas, and plain YAML."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import NamedTuple

import yaml  # type: ignore[import-untyped]

from das.domain.errors import DasError
from das.domain.files.reading import Fields, read_text

MOST_BYTES_OF_YAML = 1_000_000
"""Largest YAML file (bytes) that is read; a train with a point of its effort curve at every km/h has 0.005 MB."""
MOST_NODES, MOST_DEPTH = 100_000, 30
"""Largest number of values of a YAML file, and of tables within tables."""
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?", re.IGNORECASE | re.ASCII)


class CsvTable(NamedTuple):
    """The cells of a CSV file: its rows (one or more) with their line numbers, and the separator of cells."""

    separator: str
    rows: list[tuple[int, list[str]]]

    def number(self, cell: str) -> float | None:
        """The number in a cell, None if there is none; a comma is a decimal sign unless commas separate cells."""
        text = cell if self.separator == "," else cell.replace(",", ".")
        return float(text) if _NUMBER.fullmatch(text) else None

    def joined(self, cells: list[str]) -> str:
        """The cells of a row as written in the file, for messages."""
        return self.separator.join(cells)


def read_csv(path: Path, most_bytes: int, expected: str) -> CsvTable:
    """Read a CSV file; empty lines and those that begin with # are left out.

    Semicolons or tabs separate cells if the first line has them, else commas. Raises DasError for an unusable file; the
    message for an empty file states what is `expected`.
    """
    lines = [
        (number, line)
        for number, line in enumerate(read_text(path, most_bytes).split("\n"), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise DasError(f"{path}: empty, expected {expected}")
    separator = next((one for one in ";\t" if one in lines[0][1]), ",")
    rows = []
    try:
        for number, line in lines:
            (cells,) = csv.reader([line], delimiter=separator, strict=True)
            rows.append((number, [cell.strip() for cell in cells]))
    except csv.Error as error:
        raise DasError(f"{path}: not a usable CSV file ({error})") from error
    return CsvTable(separator, rows)


def read_yaml(path: Path) -> Fields:
    """Parse a YAML document that is a table of keys; DasError if the file cannot be read or holds something else.

    References (`*name`) are rejected: a small file with many of them expands to a huge one.
    """
    text = read_text(path, MOST_BYTES_OF_YAML)
    try:
        _check(path, text)
        data = yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise DasError(f"{path}: not valid YAML ({' '.join(str(error).split())})") from error
    return Fields.of(path, data)


def _check(path: Path, text: str) -> None:
    depth, nodes = 0, 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.AliasEvent):
            raise DasError(f"{path}: the reference *{event.anchor} in the YAML, expected plain data without references")
        nodes += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if nodes > MOST_NODES or depth > MOST_DEPTH:
            raise DasError(f"{path}: more than {MOST_NODES} values or {MOST_DEPTH} tables within tables")
