"""Loss maps as CSV: speed_kmh, force_n, loss_w (or speed_mps, force_kn, loss_kw); missing points are not covered."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from das.domain.errors import DasError, InputError
from das.domain.files.reading import read_text
from das.domain.losses import LossMap
from das.domain.units import FACTORS

_COLUMNS = {"speed": "speed", "force": "force", "loss": "power"}


def read_loss_map(path: Path) -> LossMap:
    """Read a loss map; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    reader = csv.reader(io.StringIO(read_text(path)))
    header = [name.strip() for name in next(reader, [])]
    factors = [_factor(path, header, index, name) for index, name in enumerate(_COLUMNS)]
    rows = []
    for line, row in enumerate(reader, 2):
        if row:
            rows.append(_numbers(path, line, row, factors))
    if not rows:
        raise DasError(f"{path}: empty loss map, expected rows of {', '.join(header)}")
    return _to_map(path, np.array(rows))


def _factor(path: Path, header: list[str], index: int, name: str) -> float:
    dimension = _COLUMNS[name]
    column = header[index] if index < len(header) else ""
    unit = column[len(name) + 1 :] if column.startswith(name + "_") else ""
    if unit not in FACTORS[dimension]:
        names = " or ".join(f"{name}_{u}" for u in FACTORS[dimension] if u.isidentifier() and u.islower())
        raise InputError(path, f"column {index + 1}", column, names)
    return FACTORS[dimension][unit]


def _numbers(path: Path, line: int, row: list[str], factors: list[float]) -> list[float]:
    if len(row) != len(factors):
        raise InputError(path, f"line {line}", ",".join(row), f"{len(factors)} numbers")
    try:
        values = [float(cell) for cell in row]
    except ValueError:
        raise InputError(path, f"line {line}", ",".join(row), f"{len(factors)} numbers") from None
    if not np.isfinite(values).all():
        raise InputError(path, f"line {line}", ",".join(row), "finite numbers; leave out points not covered")
    return [value * factor for value, factor in zip(values, factors, strict=True)]


def _to_map(path: Path, rows: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> LossMap:
    speeds, i = np.unique(rows[:, 0].round(9), return_inverse=True)
    forces, j = np.unique(rows[:, 1].round(6), return_inverse=True)
    table = np.full((len(speeds), len(forces)), np.nan)
    if len(np.unique(i * len(forces) + j)) != len(rows):
        seen: set[tuple[int, int]] = set()
        for line, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True), 2):
            if pair in seen:
                raise InputError(path, f"line {line}", rows[line - 2].tolist(), "each speed and force only once")
            seen.add(pair)
    table[i, j] = rows[:, 2]
    return LossMap(name=str(path), speed_mps=_evened(speeds), force_n=_evened(forces), loss_w_table=table)


def _evened(axis: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Remove the rounding of the file's decimals (under 1 % of a step) so that the axis is exactly even."""
    even = np.linspace(axis[0], axis[-1], len(axis))
    if len(axis) > 1 and np.abs(even - axis).max() < 0.01 * (axis[-1] - axis[0]) / (len(axis) - 1):
        even[np.abs(even) < 1e-9 * (axis[-1] - axis[0])] = 0.0
        return even
    return axis
