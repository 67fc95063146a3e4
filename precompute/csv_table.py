"""Reading CSV tables of strangers: cells between semicolons, tabs or commas, with comments and decimal commas."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import NamedTuple

from das.domain.errors import DasError
from das.domain.files.reading import read_text

_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?", re.IGNORECASE | re.ASCII)


class CsvTable(NamedTuple):
    """The cells of a CSV file: its rows (one or more) with their line numbers, and what separates cells."""

    separator: str
    rows: list[tuple[int, list[str]]]

    def number(self, cell: str) -> float | None:
        """The number in a cell, None if there is none; a comma is a decimal sign unless commas separate cells."""
        text = cell if self.separator == "," else cell.replace(",", ".")
        return float(text) if _NUMBER.fullmatch(text) else None

    def joined(self, cells: list[str]) -> str:
        """The cells of a row as they stand in the file, for messages."""
        return self.separator.join(cells)


def read_csv(path: Path, most_bytes: int, expected: str) -> CsvTable:
    """Read a CSV file; empty lines and those that begin with # are left out.

    Semicolons or tabs separate cells if the first line has them, else commas. Raises DasError for an unusable file; for
    an empty one it says what was `expected`.
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
