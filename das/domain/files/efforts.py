"""Reader of a train's efforts: force and power, effort curves (CSV or in the file), and modes.

The formats are explained in docs/reference/file-formats.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from das.domain.effort import EffortCurve, EffortEnvelope, EffortMode
from das.domain.errors import DasError, InputError
from das.domain.files.reading import MOST_BYTES, Fields, read_text
from das.domain.units import FACTORS, KMH, KN

MOST_POINTS = 2000
"""Largest number of points of an effort curve."""
LEAST_APART_MPS = 1e-3
"""Least difference (m/s) between two points of an effort curve."""
HIGHEST_MPS, LARGEST_N = 250.0, 1e8
"""Highest speed (m/s) and largest force (N) of a point of an effort curve."""
_ENVELOPE = {"max_force": "force", "max_power": "power"}
_CURVE = {"speed": "speed", "force": "force"}
_NO_EFFORT = EffortEnvelope(max_force_n=0.0, max_power_w=0.0)


class ReadEfforts(NamedTuple):
    """The efforts of a train: in the default mode `mode` of its file, and in all modes."""

    traction: EffortEnvelope
    electric_brake: EffortEnvelope
    modes: Mapping[str, EffortMode]
    mode: str


def read_efforts(fields: Fields, top_mps: float) -> ReadEfforts:
    """The tables `[traction]`, `[electric_brake]` and `[modes]` of a vehicle file, for a top speed (m/s).

    A mode without its own efforts has those of the file. `[traction]` may be missing if `[vehicle]` names a
    `default_mode`. Raises InputError for anything unusable.
    """
    main, table = fields.table("vehicle"), fields.optional_table("modes")
    default = main.name("default_mode", "")
    electric = _envelope(fields.table("electric_brake"), top_mps) if fields.has("electric_brake") else _NO_EFFORT
    every = None if default and not fields.has("traction") else _traction(fields, top_mps)
    modes = {name: _mode(table.table(name), every, electric, top_mps) for name in table.data}
    if default and default not in modes:
        raise main.error("default_mode", default, f"one of the modes {', '.join(modes) or '(the file has none)'}")
    if every is None or default:
        return ReadEfforts(modes[default].traction, modes[default].electric_brake, modes, default)
    return ReadEfforts(every, electric, modes, "")


def _traction(fields: Fields, top_mps: float) -> EffortEnvelope:
    traction = _envelope(fields.table("traction"), top_mps)
    if traction.curve is not None and traction.curve.force_n[0] == 0:
        raise fields.error("traction.curve", "0 kN at 0 km/h", "a force > 0; otherwise the train cannot start")
    return traction


def _mode(fields: Fields, every: EffortEnvelope | None, electric: EffortEnvelope, top_mps: float) -> EffortMode:
    """One mode of a train; missing values are those of the rest of the file."""
    voltage = {"voltage": "voltage"}
    fields.check_keys(["source", "traction", "electric_brake", "weather", *fields.quantity_keys(voltage)])
    if every is None or fields.has("traction"):
        every = _traction(fields, top_mps)
    if fields.has("electric_brake"):
        electric = _envelope(fields.table("electric_brake"), top_mps)
    return EffortMode(
        traction=every,
        electric_brake=electric,
        voltage_v=fields.quantity("voltage", "voltage") if fields.given_keys("voltage", "voltage") else None,
        weather=fields.name("weather", "") if fields.has("weather") else "",
    )


def _envelope(fields: Fields, top_mps: float) -> EffortEnvelope:
    """Force and power, or an effort curve: the name of a CSV file, or a table in the file."""
    if not fields.has("curve"):
        fields.check_keys(["source", *fields.quantity_keys(_ENVELOPE)])
        return EffortEnvelope(
            max_force_n=fields.quantity("max_force", "force"), max_power_w=fields.quantity("max_power", "power")
        )
    fields.check_keys(["source", "curve"])
    if isinstance(fields.data["curve"], str):
        path = fields.source.parent / fields.text("curve")
        rows = read_columns(path, "effort curve", _CURVE, MOST_POINTS)
        curve = effort_curve(path, {f"line {line}": row for line, row in rows.items()}, top_mps)
    elif isinstance(fields.data["curve"], Mapping):
        columns = fields.columns("curve", _CURVE, most=MOST_POINTS)
        points = zip(columns["speed"], columns["force"], strict=True)
        curve = effort_curve(
            fields.source, {f"{fields.prefix}curve.rows[{i}]": x for i, x in enumerate(points)}, top_mps
        )
    else:
        raise fields.error("curve", fields.data["curve"], "the name of a CSV file, or a table of columns and rows")
    return EffortEnvelope.of_curve(curve, top_mps)


def effort_curve(source: Path | str, points: Mapping[str, Sequence[float]], top_mps: float) -> EffortCurve:
    """The curve through points of speed (m/s) and force (N), each under its place in the file.

    Raises InputError unless the speeds rise from 0 at least to the top speed (m/s) and the forces are possible.
    """
    before_mps = -LEAST_APART_MPS
    for place, (speed_mps, force_n) in points.items():
        shown = f"{speed_mps / KMH:g} km/h"
        if before_mps < 0 and speed_mps != 0:
            raise InputError(source, place, shown, "0 km/h as the first speed")
        if not before_mps + LEAST_APART_MPS <= speed_mps <= HIGHEST_MPS:
            expected = f"rising speeds of at most {HIGHEST_MPS / KMH:g} km/h, after {max(before_mps, 0) / KMH:g} km/h"
            raise InputError(source, place, shown, expected)
        if not 0 <= force_n <= LARGEST_N:
            raise InputError(source, place, f"{force_n / KN:g} kN", f"a force from 0 to {LARGEST_N / KN:g} kN")
        before_mps = speed_mps
    if len(points) < 2 or before_mps < top_mps * (1 - 1e-9):
        expected = f"at least 2 points, up to the top speed of {top_mps / KMH:g} km/h"
        raise InputError(source, "last speed of the curve", f"{max(before_mps, 0) / KMH:g} km/h", expected)
    speeds_mps, forces_n = zip(*points.values(), strict=True)
    if max(forces_n) == 0:
        raise InputError(source, "forces of the curve", "all 0", "a force > 0")
    return EffortCurve(speed_mps=tuple(map(float, speeds_mps)), force_n=tuple(map(float, forces_n)))


def read_columns(path: Path, what: str, columns: Mapping[str, str], most: int) -> dict[int, list[float]]:
    """The rows (SI) of a CSV file whose header names columns with their units, each under its line number.

    `what` is the kind of content, for messages; `columns` maps each name to its dimension, in the order of the file.
    Raises DasError or InputError for anything unusable, and for more than `most` rows.
    """
    lines = list(enumerate(read_text(path, MOST_BYTES).splitlines(), 1))
    header = [name.strip() for name in lines[0][1].split(",")] if lines else []
    factors = [_factor(path, header, index, columns) for index in range(len(columns))]
    if len(header) > len(columns):
        raise InputError(path, f"column {len(columns) + 1}", header[len(columns)], f"only {', '.join(columns)}")
    rows = {line: _row(path, line, text.split(","), factors) for line, text in lines[1:] if text.strip()}
    if not rows:
        raise DasError(f"{path}: empty {what}, expected rows of {', '.join(header)}")
    if len(rows) > most:
        raise InputError(path, "number of rows", len(rows), f"at most {most}")
    return rows


def _factor(path: Path, header: list[str], index: int, columns: Mapping[str, str]) -> float:
    name, dimension = list(columns.items())[index]
    column = header[index] if index < len(header) else ""
    unit = column[len(name) + 1 :] if column.startswith(name + "_") else ""
    if unit not in FACTORS[dimension]:
        names = " or ".join(f"{name}_{u}" for u in FACTORS[dimension] if u.isidentifier() and u.islower())
        raise InputError(path, f"column {index + 1}", column, names)
    return FACTORS[dimension][unit]


def _row(path: Path, line: int, row: list[str], factors: list[float]) -> list[float]:
    if len(row) != len(factors):
        raise InputError(path, f"line {line}", ",".join(row), f"{len(factors)} numbers")
    try:
        values = [float(cell) for cell in row]
    except ValueError:
        raise InputError(path, f"line {line}", ",".join(row), f"{len(factors)} numbers") from None
    if not np.isfinite(values).all():
        raise InputError(path, f"line {line}", ",".join(row), "finite numbers; leave out points not covered")
    return [value * factor for value, factor in zip(values, factors, strict=True)]
