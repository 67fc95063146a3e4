"""Loss maps as CSV: speed_kmh, force_n, loss_w (or speed_mps, force_kn, loss_kw).

A point that the file leaves out is not covered by the map.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from das.domain.errors import DasError, InputError
from das.domain.files.reading import MOST_BYTES, read_text
from das.domain.losses import LossMap
from das.domain.units import FACTORS

MOST_CELLS = 5_000_000
"""Most points of a loss map: 500 km/h and 10 000 kN in steps of 1."""
_COLUMNS = {"speed": "speed", "force": "force", "loss": "power"}


def read_loss_map(path: Path) -> LossMap:
    """Read a loss map; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    lines = list(enumerate(read_text(path, MOST_BYTES).splitlines(), 1))
    header = [name.strip() for name in lines[0][1].split(",")] if lines else []
    factors = [_factor(path, header, index, name) for index, name in enumerate(_COLUMNS)]
    rows = {line: _numbers(path, line, text.split(","), factors) for line, text in lines[1:] if text.strip()}
    if not rows:
        raise DasError(f"{path}: empty loss map, expected rows of {', '.join(header)}")
    return _to_map(path, rows)


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


def _to_map(path: Path, rows: dict[int, list[float]]) -> LossMap:
    """The map of rows of speed, force and loss (SI), which are given by their line numbers."""
    data = np.array(list(rows.values()))
    speeds, i = np.unique(data[:, 0].round(9), return_inverse=True)
    forces, j = np.unique(data[:, 1].round(6), return_inverse=True)
    check_cells(path, len(speeds), len(forces))
    first: dict[tuple[int, int], int] = {}
    for line, point in zip(rows, zip(i.tolist(), j.tolist(), strict=True), strict=True):
        if first.setdefault(point, line) != line:
            raise InputError(
                path, f"line {line}", f"the point of line {first[point]}", "each speed and force only once"
            )
    table = np.full((len(speeds), len(forces)), np.nan)
    table[i, j] = data[:, 2]
    return LossMap(name=str(path), speed_mps=_evened(speeds), force_n=_evened(forces), loss_w_table=table)


def check_cells(path: Path, speeds: int, forces: int) -> None:
    """Raise InputError where a loss map of so many speeds and forces would have more than `MOST_CELLS` points."""
    if speeds * forces > MOST_CELLS:
        raise InputError(
            path, "size of the loss map", f"{speeds} speeds × {forces} forces", f"at most {MOST_CELLS} points"
        )


def _evened(axis: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Remove the rounding of the file's decimals (under 1 % of a step) so that the axis is exactly even."""
    even = np.linspace(axis[0], axis[-1], len(axis))
    if len(axis) > 1 and np.abs(even - axis).max() < 0.01 * (axis[-1] - axis[0]) / (len(axis) - 1):
        even[np.abs(even) < 1e-9 * (axis[-1] - axis[0])] = 0.0
        return even
    return axis
