"""CSV files without a header as arrays, with errors that name the file, the line and the value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError, InputError
from das.domain.files.reading import read_text
from das.domain.route import Floats


def read_rows(path: Path, names: tuple[str, ...], at_least: int, what: str) -> Floats:
    """Rows of finite numbers (rows × len(names)); row i is line i + 1 of the file.

    Raises DasError for a missing or empty file and InputError (file, line, value) for an unusable line.
    """
    lines = read_text(path).rstrip().splitlines()
    if not lines:
        raise DasError(f"{path}: empty {what}, expected lines of {', '.join(names)}")
    rows = np.array([_numbers(path, number, line, names) for number, line in enumerate(lines, 1)])
    if len(rows) < at_least:
        raise DasError(f"{path}: {what} of {len(rows)} line, expected at least {at_least} lines")
    return rows


def check_column(path: Path, name: str, values: Floats, bad: NDArray[np.bool_], expected: str) -> None:
    """InputError for the first line marked in `bad` (rows)."""
    if bad.any():
        i = int(bad.argmax())
        raise InputError(path, f"line {i + 1} {name}", float(values[i]), expected)


def check_location(path: Path, latitude_deg: Floats, longitude_deg: Floats) -> None:
    """InputError for the first latitude beyond ±90° or longitude beyond ±180°."""
    check_column(path, "latitude", latitude_deg, np.abs(latitude_deg) > 90, "-90 to 90 deg")
    check_column(path, "longitude", longitude_deg, np.abs(longitude_deg) > 180, "-180 to 180 deg")


def _numbers(path: Path, number: int, line: str, names: tuple[str, ...]) -> list[float]:
    cells = line.split(",")
    if len(cells) != len(names):
        raise InputError(path, f"line {number}", line, f"{len(names)} columns: {', '.join(names)}")
    values = []
    for name, cell in zip(names, cells, strict=True):
        try:
            values.append(float(cell))
        except ValueError:
            raise InputError(path, f"line {number} {name}", cell, "a number") from None
        if not np.isfinite(values[-1]):
            raise InputError(path, f"line {number} {name}", cell, "a finite number")
    return values
