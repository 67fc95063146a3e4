"""Reader for TTOBench tracks, trains and journeys (Kouzoupis, Pendharkar, Corman 2023): JSON that states each unit."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from types import MappingProxyType

import numpy as np

from das.domain.effort import EffortEnvelope
from das.domain.errors import MISSING
from das.domain.files.reading import Fields, in_si, read_json, train_length_m
from das.domain.files.routes import curvature_stretches
from das.domain.files.vehicles import check_tunnel_resistance
from das.domain.journey import ANY_TIME, Window
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.plausibility import checked
from das.domain.route import Route, Stop, Stretches, Tunnel
from das.domain.units import FACTORS
from das.domain.vehicle import BrakePolicy, Resistance, Vehicle
from das.offline.asked_journey import Call, Journey, Passing, bound_of_window

INSIST = "correct the file, or convert it to TOML (docs/reference/file-formats.md), which can accept {check}"
"""The end of the error for an implausible value: what to do if the value is intended."""


def read_train(path: Path) -> Vehicle:
    """Read a TTOBench train; its constant efficiencies become its losses at level OWN.

    Raises DasError for a missing file, InputError (file, key, value, expectation) for anything unusable in it.
    """
    fields = read_json(path)
    friction_brake_n = _quantity(fields, "max pn braking force", "force", 0.0)
    has_electric_brake = _quantity(fields, "max reg braking force", "force", 0.0) > 0
    own = EfficiencyLoss.from_efficiencies(
        _efficiency(fields, "efficiency traction"),
        _efficiency(fields, "efficiency reg brake") if has_electric_brake else 1.0,
    )
    columns = ("cross section", "area"), ("coefficient", "resistance_2")
    tunnels = _rows(fields, "tunnel resistance", *columns) if fields.has("tunnel resistance") else []
    areas, coefficients = check_tunnel_resistance(fields, tunnels)
    vehicle = Vehicle(
        id=_identity(fields),
        name=_identity(fields),
        source=str(path),
        mass_kg=_quantity(fields, "mass", "mass"),
        rotating_mass_ratio=_quantity(fields, "rho", "ratio", 0.0),
        train_length_m=train_length_m(fields.source, _quantity(fields, "length", "length", 0.0)),
        max_speed_mps=_quantity(fields, "max speed", "speed"),
        resistance=Resistance(
            c0_n=_quantity(fields, "rolling resistance r0", "force"),
            c1_n_per_mps=_quantity(fields, "rolling resistance r1", "resistance_1"),
            c2_n_per_mps2=_quantity(fields, "rolling resistance r2", "resistance_2"),
        ),
        traction=EffortEnvelope(
            max_force_n=_quantity(fields, "max traction force", "force"),
            max_power_w=_quantity(fields, "max traction power", "power"),
        ),
        electric_brake=EffortEnvelope(
            max_force_n=_quantity(fields, "max reg braking force", "force", 0.0),
            max_power_w=_quantity(fields, "max reg braking power", "power", 0.0),
        ),
        friction_brake_force_n=friction_brake_n,
        brake_policy=BrakePolicy.BLENDED if friction_brake_n > 0 else BrakePolicy.ELECTRIC,
        max_acceleration_mps2=_quantity(fields, "max acceleration", "acceleration", np.inf),
        max_deceleration_mps2=_quantity(fields, "max deceleration", "acceleration", np.inf),
        tunnel_area_m2=areas,
        tunnel_resistance_n_per_mps2=coefficients,
        losses=MappingProxyType({Level.OWN: own}),
    )
    return checked(vehicle, insist=INSIST)


def read_track(path: Path) -> Route:
    """Read a TTOBench track. Stops are named by their numbers, because the format has no names.

    Raises DasError for a missing file, InputError (file, key, value, expectation) for anything unusable in it.
    """
    fields = read_json(path)
    stops = _stop_positions(fields)
    length_m = stops[-1]
    limits = _rows(fields, "speed limits", ("position", "length"), ("velocity", "speed"))
    gradients = _rows(fields, "gradients", ("position", "length"), ("slope", "gradient"))
    ends = ("radius at start", "length"), ("radius at end", "length")
    curves = _rows(fields, "curvatures", ("position", "length"), *ends) if fields.has("curvatures") else []
    areas = ("length", "length"), ("cross section", "area")
    tunnels = _rows(fields, "tunnels", ("position", "length"), *areas) if fields.has("tunnels") else []
    identity = _identity(fields)
    route = Route(
        id=identity,
        name=identity,
        source=str(path),
        illustrative=False,
        length_m=length_m,
        stops=tuple(Stop(name=f"stop {i}", position_m=x) for i, x in enumerate(stops, 1)),
        limits_mps=_stretches(limits),
        gradients_ratio=_stretches(gradients),
        curvature_per_m=curvature_stretches(str(path), curves or [[0.0, np.inf, np.inf]]),
        tunnels=tuple(Tunnel(start_m=a, length_m=b, area_m2=c) for a, b, c in tunnels),
        altitude_at_start_m=_quantity(fields, "altitude", "length", 0.0),
    )
    return checked(route, insist=INSIST)


_TIMING = {
    "position": "length",
    "lower time constraint": "time",
    "upper time constraint": "time",
    "lower speed constraint": "speed",
    "upper speed constraint": "speed",
}
"""Columns of a journey's timing points with their dimensions."""
_OPEN = dict(zip(list(_TIMING)[1:], (-np.inf, np.inf, 0.0, np.inf), strict=True))
"""The number that null (an open bound) stands for in the columns in which null is not refused."""
_UNBOUNDED = ("radius at start", "radius at end", *_OPEN)
"""Columns whose values may be infinite: the radius of a straight track, the end of an open window."""


def read_journey(path: Path) -> Journey:
    """Read a TTOBench journey; its points are named by their positions, because the format has no names.

    Two rows at one position are the arrival and the departure of a stop. One row with both speeds 0 is a stop without
    a dwell, any other row a passing. Null is an open bound. Raises DasError for a missing file, InputError (file, key,
    value, expectation) for anything unusable in it.
    """
    fields = read_json(path)
    rows = _rows(fields, "timing points", *_TIMING.items())
    groups = [list(group) for _, group in groupby(rows, key=lambda row: row[0])]
    last = len(groups) - 1
    points = tuple(_timing_point(fields, group, first=i == 0, last=i == last) for i, group in enumerate(groups))
    identity = _identity(fields)
    return Journey(id=identity, name=identity, source=str(path), points=points)


def _timing_point(fields: Fields, rows: list[list[float]], *, first: bool, last: bool) -> Call | Passing:
    """A point of a journey from its rows (SI): one row, or two for a stop with a dwell."""
    position_m = rows[0][0]
    name = f"{position_m:g} m"
    key = f"timing points at {name}"
    bounds_s = [[bound_of_window(fields.source, key, time_s) for time_s in row[1:3]] for row in rows]
    windows = [Window(earliest_s=earliest_s, latest_s=latest_s) for earliest_s, latest_s in bounds_s]
    if len(rows) == 1 and rows[0][4] > 0:
        return Passing(
            name=name, position_m=position_m, window=windows[0], lowest_mps=rows[0][3], highest_mps=rows[0][4]
        )
    if len(rows) > 2 or any(row[3] != 0 or row[4] != 0 for row in rows):
        raise fields.error(key, f"{len(rows)} rows", "one, or two with speeds 0: a stop")
    if first or last:
        if len(rows) > 1:
            raise fields.error(key, "2 rows", "one row at an end of the journey")
        arrival, departure = (ANY_TIME, windows[0]) if first else (windows[0], ANY_TIME)
        return Call(name=name, position_m=position_m, arrival=arrival, departure=departure)
    return Call(name=name, position_m=position_m, arrival=windows[0], departure=windows[-1])


def _identity(fields: Fields) -> str:
    return fields.table("metadata").text("id", fields.source.stem) if fields.has("metadata") else fields.source.stem


def _unit(fields: Fields, key: str, dimension: str) -> str:
    unit = fields.data.get(key, MISSING)
    if not isinstance(unit, str) or unit not in FACTORS[dimension]:
        known = ", ".join(u for u in FACTORS[dimension] if not u.isidentifier() or len(u) < 3)
        raise fields.error(key, unit, f"a unit of {dimension.replace('_', ' ')}, one of {known}")
    return unit


def _quantity(fields: Fields, key: str, dimension: str, default: float | None = None) -> float:
    """The number in `{"unit": …, "value": …}`, in SI."""
    if not fields.has(key):
        if default is None:
            raise fields.error(key, MISSING, '{"unit": …, "value": …}')
        return default
    entry = fields.table(key)
    unit = _unit(entry, "unit", dimension)
    value = entry.data.get("value", MISSING)
    unbounded = dimension == "acceleration"  # acceleration limited only by the train's forces
    return in_si(fields.source, f"{entry.prefix}value", value, (unit, dimension), unbounded=unbounded)


def _efficiency(fields: Fields, key: str) -> float:
    value = _quantity(fields, key, "ratio")
    if not 0 < value <= 1:
        raise fields.error(key, fields.table(key).data["value"], "more than 0 and at most 100 %")
    return value


def _stop_positions(fields: Fields) -> list[float]:
    table = fields.table("stops")
    unit = _unit(table, "unit", "length")
    values = table.data.get("values", MISSING)
    if not isinstance(values, list) or len(values) < 2:
        raise table.error("values", values, "at least two positions")
    table.check_count("values", values)
    return [in_si(fields.source, f"stops.values[{i}]", x, (unit, "length")) for i, x in enumerate(values)]


def _rows(fields: Fields, key: str, *columns: tuple[str, str]) -> list[list[float]]:
    """The rows of `{"units": {column: unit}, "values": [[…], …]}` in SI; the text "infinity" counts as a number."""
    table = fields.table(key)
    units_table = table.table("units")
    units = [_unit(units_table, name, dimension) for name, dimension in columns]
    found = []
    for i, row in enumerate(table.rows("values", "a list of rows")):
        place = f"{key}.values[{i}]"
        if not isinstance(row, list) or len(row) != len(columns):
            raise fields.error(place, row, f"{len(columns)} numbers: {', '.join(name for name, _ in columns)}")
        cells = [float(cell) if cell in ("infinity", "-infinity") else cell for cell in row]
        cells = [_OPEN.get(name) if cell is None else cell for cell, (name, _) in zip(cells, columns, strict=True)]
        found.append(
            [
                in_si(fields.source, f"{place}.{name}", cell, (unit, dimension), unbounded=name in _UNBOUNDED)
                for cell, unit, (name, dimension) in zip(cells, units, columns, strict=True)
            ]
        )
    return found


def _stretches(rows: list[list[float]]) -> Stretches:
    return Stretches(start_m=np.array([row[0] for row in rows]), value=np.array([row[1] for row in rows]))
