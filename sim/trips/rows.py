"""Rows of CSV files as numbers, with errors that name the file, the line and the value."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError, InputError
from das.domain.files.reading import read_text
from das.domain.route import Floats

ROUNDING = 1e-6
"""A negative speed this near to 0 (in its file's unit) comes from rounding."""


def read_cells(path: Path, what: str, expected: str) -> tuple[list[list[str]], str]:
    """Cells of a CSV file, row i being line i + 1, and the separator: a semicolon or tab if line 1 has one, or a comma.

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


def read_rows(path: Path, names: tuple[str, ...], at_least: int, what: str) -> Floats:
    """Rows of finite numbers (rows × len(names)) of a file without a header; row i is line i + 1 of the file.

    Raises DasError for a missing or empty file and InputError (file, line, value) for an unusable line.
    """
    rows, separator = read_cells(path, what, f"lines of {', '.join(names)}")
    values = []
    for line, cells in enumerate(rows, 1):
        check_width(path, line, cells, separator, names)
        values.append([number(path, line, name, cell) for name, cell in zip(names, cells, strict=True)])
    if len(values) < at_least:
        raise DasError(f"{path}: {what} of {len(values)} line, expected at least {at_least} lines")
    return np.array(values)


def check_width(path: Path, line: int, cells: list[str], separator: str, names: tuple[str, ...]) -> None:
    """Raise InputError for a row with another number of columns."""
    if len(cells) != len(names):
        raise InputError(path, f"line {line}", separator.join(cells), f"{len(names)} columns: {', '.join(names)}")


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


def not_negative(path: Path, line: int, speed: float) -> float:
    """A speed; one that is below 0 by rounding alone is 0. Raises InputError for other negative speeds."""
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
