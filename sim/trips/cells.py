"""Cells of a CSV file as numbers and as times, with errors that name the file, the line and the value.

Times are whole ns since 1970, without the rounding of a double.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError, InputError
from das.domain.files.reading import read_text
from das.domain.route import Floats
from das.domain.units import MS, NS

ROUNDING = 1e-6
"""Distance from 0 (in its file's unit) at which a negative speed comes from rounding."""
NO_SPEED = -1.0
"""Speed that iOS writes if it knows none."""
NO_VALUE = frozenset(("", "-", "n/a", "na", "nan", "none", "null"))
"""Texts of a cell, in small letters, that stand for a value that is not known."""
Read = TypeVar("Read")
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_NS_PER_MICROSECOND = 1000
LATEST_NS = round(9e9 / NS)
"""The latest time (ns since 1970, year 2255) that fits in integer nanoseconds."""
PER_UNIT_NS = {"time_ms": round(MS / NS), "time_s": round(1 / NS)}
"""Nanoseconds in the unit of each column of times."""
LATITUDE_NAMES = ("latitude", "latitude_deg", "lat")
LONGITUDE_NAMES = ("longitude", "longitude_deg", "lon", "lng")
"""Names that a column of latitudes or of longitudes may have."""


def read_cells(path: Path, what: str, expected: str) -> tuple[list[list[str]], str]:
    """Cells of a CSV file, row i from line i + 1, and the separator: a semicolon or tab if line 1 has it, else a comma.

    Raises DasError for a missing or empty file, or one with a line break inside quotes.
    """
    lines = read_text(path).rstrip().splitlines()
    if not lines:
        raise DasError(f"{path}: empty {what}, expected {expected}")
    separator = next((mark for mark in ";\t" if mark in lines[0]), ",")
    try:
        rows = list(csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True))
    except csv.Error as error:
        raise DasError(f"{path}: not a usable CSV file ({error})") from error
    if len(rows) != len(lines):
        raise DasError(f"{path}: a quoted cell goes over several lines, expected one line a row")
    return [[cell.strip() for cell in row] for row in rows], separator


class CellTable(NamedTuple):
    """A CSV file: what it holds, names of columns, rows of cells, line of the first row, and separator."""

    path: Path
    what: str
    names: tuple[str, ...]
    rows: list[list[str]]
    first: int
    separator: str

    @classmethod
    def read(cls, path: Path, what: str, names: tuple[str, ...]) -> CellTable:
        """Read a file with or without a header; `names` are the columns of a file without one.

        Raises DasError as `read_cells` does.
        """
        rows, separator = read_cells(path, what, f"a header, or lines of {', '.join(names)}")
        if any(is_number(cell) for cell in rows[0]):
            return cls(path, what, names, rows, 1, separator)
        return cls(path, what, tuple(cell.casefold() for cell in rows[0]), rows[1:], 2, separator)

    def body(self) -> list[list[str]]:
        """The rows with points as decimal signs; if cells are not separated by commas, a comma is a decimal sign.

        Raises DasError for fewer than two rows, and InputError for a row with another number of columns.
        """
        count, width = len(self.rows), f"{len(self.names)} columns: {', '.join(self.names)}"
        if count < 2:
            lines = f"{count} line{'s' * (not count)}"
            raise DasError(f"{self.path}: {self.what} of {lines}, expected at least 2 lines of points")
        for line, cells in enumerate(self.rows, self.first):
            if len(cells) != len(self.names):
                raise InputError(self.path, f"line {line}", self.separator.join(cells), width)
        return self.rows if self.separator == "," else [[cell.replace(",", ".") for cell in row] for row in self.rows]


def number(path: Path, line: int, name: str, cell: str) -> float:
    """Read a cell as a finite number; raises InputError for anything else."""
    try:
        value = float(cell)
    except ValueError:
        raise InputError(path, f"line {line} {name}", cell, "a number") from None
    if not np.isfinite(value):
        raise InputError(path, f"line {line} {name}", cell, "a finite number")
    return value


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a point or a comma as the decimal sign."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def usable(cells: Sequence[str], read: Callable[[int, str], Read], *, needed: bool = False) -> list[Read | None]:
    """The values of a column's cells; None for a cell without a value, or with one that `read` refuses.

    `read` is given the index and the text of a cell. Raises the first InputError if at least half of the stated cells
    are refused: then the column holds something else. Where a value is `needed`, an empty cell is refused as well.
    """
    found: list[Read | None] = []
    refused, stated = [], 0
    for i, cell in enumerate(cells):
        value = None
        if needed or cell.casefold() not in NO_VALUE:
            stated += 1
            try:
                value = read(i, cell)
            except InputError as error:
                refused.append(error)
        found.append(value)
    if refused and 2 * len(refused) >= stated:
        raise refused[0]
    return found


def known(values: Sequence[float | None]) -> Floats:
    """Values as an array; NaN for None."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def degrees(path: Path, line: int, name: str, cell: str, largest: float) -> float:
    """Read a cell as a latitude or longitude; raises InputError for anything else."""
    value = number(path, line, name, cell)
    if abs(value) > largest:
        raise InputError(path, f"line {line} {name}", value, f"-{largest:g} to {largest:g} deg")
    return value


def not_negative(path: Path, line: int, speed: float) -> float:
    """The speed, 0 if rounding alone made it negative, NaN for −1. Raises InputError for any other negative speed."""
    if speed == NO_SPEED:
        return math.nan
    if speed < -ROUNDING:
        raise InputError(path, f"line {line} speed", speed, "a speed >= 0")
    return max(speed, 0.0)


def check_column(path: Path, name: str, values: Floats, bad: NDArray[np.bool_], expected: str, first: int = 1) -> None:
    """Raise InputError for the first row that is marked in `bad`; row 0 is line `first`."""
    if bad.any():
        i = int(bad.argmax())
        raise InputError(path, f"line {i + first} {name}", float(values[i]), expected)


def check_location(path: Path, latitude_deg: Floats, longitude_deg: Floats, first: int = 1) -> None:
    """Raise InputError for the first latitude beyond ±90° or longitude beyond ±180°."""
    check_column(path, "latitude", latitude_deg, np.abs(latitude_deg) > 90, "-90 to 90 deg", first)
    check_column(path, "longitude", longitude_deg, np.abs(longitude_deg) > 180, "-180 to 180 deg", first)


def time_from_number(path: Path, key: str, text: str, column: str) -> int:
    """An epoch time written as a number in the column's unit; InputError (file, key, value) for any other text."""
    unit = column.rpartition("_")[2]
    try:
        value = Decimal(text)
    except InvalidOperation:
        raise InputError(path, key, text, "a number") from None
    if not value.is_finite():
        raise InputError(path, key, text, "a finite number")
    # A figure like 1e999999999 must not become an integer of so many digits.
    if not 0 <= value <= LATEST_NS or not 0 <= (ns := value * PER_UNIT_NS[column]) <= LATEST_NS:
        raise InputError(path, key, text, f"an epoch time in {unit}")
    return round(ns)


def time_from_iso(path: Path, key: str, text: str) -> int:
    """An ISO 8601 time, in UTC if it names no zone; InputError (file, key, value) for any other text."""
    expected = "an ISO 8601 time like 2026-11-21T08:04:00Z"
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(path, key, text, expected) from None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    ns = (moment - _EPOCH) // timedelta(microseconds=1) * _NS_PER_MICROSECOND
    if not 0 <= ns <= LATEST_NS:
        raise InputError(path, key, text, f"{expected}, 1970 to 2255")
    return ns
