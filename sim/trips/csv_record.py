"""Reading records as CSV: with a header that names columns and units, or latitude, longitude, km/h, ms without."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from das.domain.errors import DasError, InputError
from das.domain.route import Floats
from das.domain.units import KM, KMH
from sim.trips import moments
from sim.trips.record import Ints, Record
from sim.trips.rows import check_column, check_location, check_width, is_number, not_negative, number, read_cells

WITHOUT_HEADER = ("latitude_deg", "longitude_deg", "speed_kmh", "time_ms")
COLUMNS = {
    "latitude": {"latitude_deg": 1.0, "latitude": 1.0, "lat": 1.0},
    "longitude": {"longitude_deg": 1.0, "longitude": 1.0, "lon": 1.0, "lng": 1.0},
    "position": {"position_m": 1.0, "position_km": KM},
    "speed": {"speed_kmh": KMH, "speed_mps": 1.0},
    "speed_from_positions": {"speed_from_positions": 1.0},
    "time": {"time_ms": 0.0, "time_s": 0.0, "time": 0.0, "timestamp": 0.0},
}
"""Quantities, the names their columns may have, and factors to SI (times are read digit by digit instead)."""
ISO_TIMES = ("time", "timestamp")
"""Columns of times in ISO 8601; the others are numbers."""
_SHOWN_NAMES = 6


@dataclass(frozen=True)
class _Column:
    """Where a quantity is: index and name of its column, factor to SI."""

    index: int
    name: str
    factor: float


def read_csv(path: Path) -> Record:
    """Read a record; an empty cell is a value that is not known.

    Raises DasError or InputError (file, line, value, expectation).
    """
    rows, separator = read_cells(path, "trip", f"a header, or lines of {', '.join(WITHOUT_HEADER)}")
    header = not any(is_number(cell) for cell in rows[0])
    names = tuple(cell.casefold() for cell in rows[0]) if header else WITHOUT_HEADER
    columns = _columns(path, names)
    first = 2 if header else 1
    body = rows[first - 1 :]
    if len(body) < 2:
        raise DasError(f"{path}: trip of {len(body)} line{'s' * (not body)}, expected at least 2 lines of points")
    for line, cells in enumerate(body, first):
        check_width(path, line, cells, separator, names)
    if separator != ",":  # then a comma is a decimal one
        body = [[cell.replace(",", ".") for cell in cells] for cells in body]
    latitude, longitude, position, speed, derived = (
        _values(path, quantity, columns.get(quantity), body, first) for quantity in COLUMNS if quantity != "time"
    )
    check_location(path, latitude, longitude, first)
    check_column(path, "speed_from_positions", derived, ~np.isin(derived, (0, 1)) & ~np.isnan(derived), "0 or 1", first)
    used = {column.index for column in columns.values()}
    return Record.of(
        str(path),
        np.arange(len(body)) + first,
        _times(path, columns["time"], body, first),
        latitude_deg=latitude,
        longitude_deg=longitude,
        position_m=position,
        speed_mps=speed,
        degraded=derived == 1,
        unread=tuple(name for i, name in enumerate(names) if i not in used),
    )


def _columns(path: Path, names: tuple[str, ...]) -> dict[str, _Column]:
    """The column of each quantity that the file has; raises InputError if time or place is missing."""
    found: dict[str, _Column] = {}
    for index, name in enumerate(names):
        for quantity, accepted in COLUMNS.items():
            if name not in accepted:
                continue
            if quantity in found:
                raise InputError(
                    path, "line 1", name, f"one column of {quantity} only, there is {found[quantity].name}"
                )
            found[quantity] = _Column(index, name, accepted[name])
    unknown = [name for name in names if not any(name in accepted for accepted in COLUMNS.values())]
    for quantity in ("time", "speed"):
        unclear = [name for name in unknown if quantity not in found and name.startswith(quantity)]
        if unclear:
            raise InputError(path, "line 1", unclear[0], f"{quantity} as {' or '.join(COLUMNS[quantity])}")
    located = "position" in found or {"latitude", "longitude"} <= found.keys()
    if "time" not in found or not located:
        shown = ",".join(names[:_SHOWN_NAMES]) + ("…" if len(names) > _SHOWN_NAMES else "")
        expected = f"columns of time ({', '.join(COLUMNS['time'])}) and latitude_deg, longitude_deg or position_m"
        raise InputError(path, "line 1", shown, expected)
    return found


def _values(path: Path, quantity: str, column: _Column | None, rows: list[list[str]], first: int) -> Floats:
    """The values of a column in SI; NaN where its cell is empty, or everywhere if there is no such column."""
    values = np.full(len(rows), np.nan)
    if column is None:
        return values
    for i, row in enumerate(rows):
        if not row[column.index]:
            continue
        value = number(path, i + first, quantity, row[column.index])
        if quantity == "speed":
            value = not_negative(path, i + first, value)
        values[i] = value * column.factor
    return values


def _times(path: Path, column: _Column, rows: list[list[str]], first: int) -> Ints:
    cells = [(f"line {i} time", row[column.index]) for i, row in enumerate(rows, first)]
    if column.name in ISO_TIMES:
        return np.array([moments.from_iso(path, key, cell) for key, cell in cells], dtype=np.int64)
    return np.array([moments.from_number(path, key, cell, column.name) for key, cell in cells], dtype=np.int64)
