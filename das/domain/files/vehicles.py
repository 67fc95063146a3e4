"""Reader of vehicles in this project's TOML format, including losses and the CSV loss maps that they refer to.

The formats are explained in docs/reference/file-formats.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_type_hints

import numpy as np

from das.domain.braking import REACTION_S, SiteBraking
from das.domain.effort import EffortCurve, EffortEnvelope, EffortMode
from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.reading import MOST_BYTES, Fields, in_si, key_units, read_text, read_toml, train_length_m
from das.domain.levels import Level
from das.domain.loss_chain import Converter, LossChain
from das.domain.losses import MOST_MAP_POINTS, EfficiencyLoss, LossMap, LossModel, check_map_size
from das.domain.plausibility import ACCEPTED, INSIST, VEHICLE_CHECKS, checked
from das.domain.units import FACTORS, KMH, KN
from das.domain.vehicle import AIR_BRAKE_BUILD_UP_S, BrakePolicy, Load, Resistance, ServiceBrake, Vehicle

MOST_POINTS = 2000
"""Largest number of points of an effort curve."""
LEAST_APART_MPS = 1e-3
"""Least difference (m/s) between two points of an effort curve."""
HIGHEST_MPS, LARGEST_N = 250.0, 1e8
"""Highest speed (m/s) and largest force (N) of a point of an effort curve."""
_CURVE = {"speed": "speed", "force": "force"}
_NO_EFFORT = EffortEnvelope(max_force_n=0.0, max_power_w=0.0)


def _read_efforts(fields: Fields, top_mps: float) -> tuple[dict[str, EffortMode], str, EffortMode]:
    """The modes of a vehicle file for a top speed (m/s), the name of the default mode, and its efforts.

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
        return modes, default, modes[default]
    return modes, "", EffortMode(traction=every, electric_brake=electric)


def _traction(fields: Fields, top_mps: float) -> EffortEnvelope:
    traction = _envelope(fields.table("traction"), top_mps)
    if traction.curve is not None and traction.curve.force_n[0] == 0:
        raise fields.error("traction.curve", "0 kN at 0 km/h", "a force > 0; otherwise the train cannot start")
    return traction


def _mode(fields: Fields, every: EffortEnvelope | None, electric: EffortEnvelope, top_mps: float) -> EffortMode:
    """One mode of a train; missing values are taken from the rest of the file."""
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
        weather=fields.name("weather", ""),
    )


def _envelope(fields: Fields, top_mps: float) -> EffortEnvelope:
    """Force and power, or an effort curve: the name of a CSV file, or a table in the file."""
    if not fields.has("curve"):
        return fields.made(EffortEnvelope)
    fields.check_keys(["source", "curve"])
    if isinstance(fields.data["curve"], str):
        path = fields.source.parent / fields.text("curve")
        rows = read_columns(path, "effort curve", _CURVE, MOST_POINTS)
        curve = effort_curve(path, {f"line {line}": row for line, row in rows.items()}, top_mps)
    elif isinstance(fields.data["curve"], Mapping):
        points = enumerate(fields.number_rows("curve", _CURVE, most=MOST_POINTS))
        curve = effort_curve(fields.source, {f"{fields.prefix}curve.rows[{i}]": x for i, x in points}, top_mps)
    else:
        raise fields.error("curve", fields.data["curve"], "the name of a CSV file, or a table of columns and rows")
    return EffortEnvelope.of_curve(curve, top_mps)


def effort_curve(source: Path | str, points: Mapping[str, Sequence[float]], top_mps: float) -> EffortCurve:
    """The curve through points of speed (m/s) and force (N); the keys are their places in the file, for messages.

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
    """The rows (SI) of a CSV file whose header names columns with their units; the keys are the line numbers.

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
        names = " or ".join(f"{name}_{u}" for u in key_units(dimension))
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
        raise InputError(path, f"line {line}", ",".join(row), "finite numbers; omit points without a value")
    return [value * factor for value, factor in zip(values, factors, strict=True)]


SCHEMA_VERSION = 1

_VEHICLE = {
    "mass": "mass",
    "length": "length",
    "max_speed": "speed",
    "max_acceleration": "acceleration",
    "max_deceleration": "acceleration",
    "auxiliary_power": "power",
    "comfort_power": "power",
}
_SITE_BRAKING = {"planning_brake": "acceleration", "reaction": "time", "below_limit": "speed"}


def read_vehicle(path: Path) -> Vehicle:
    """Read a vehicle; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    return vehicle_of(read_toml(path))


def vehicle_of(fields: Fields, insist: str = INSIST % "vehicle") -> Vehicle:
    """The vehicle described by the fields of a file; errors as in `read_vehicle`.

    `insist` is the text appended to the message for an implausible value (see `das.domain.plausibility.checked`).
    """
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(
        [
            *("schema_version", "vehicle", "resistance", "tunnel_resistance", "traction", "modes"),
            *("electric_brake", "friction_brake", "brakes", "service_brake", "adhesion", "losses", "loads"),
        ]
    )
    vehicle = _lossless(fields, insist)  # checks masses, speeds and forces before a loss map is computed from them
    losses, default = read_losses(fields.table("losses"), vehicle)
    return replace(vehicle, losses=MappingProxyType(losses), default_level=default)


def _lossless(fields: Fields, insist: str) -> Vehicle:
    main = fields.table("vehicle")
    main.check_keys(
        ["id", "name", "source", ACCEPTED, "rotating_mass_ratio", "default_mode", *main.quantity_keys(_VEHICLE)]
    )
    max_speed_mps = main.quantity("max_speed", "speed")
    modes, mode, efforts = _read_efforts(fields, max_speed_mps)
    friction_n = _alone(fields, "friction_brake", ("max_force", "force"), 0.0)
    has_electric = efforts.electric_brake.max_force_n > 0
    loads = fields.optional_table("loads")
    tunnels = fields.optional_rows("tunnel_resistance", {"cross_section": "area", "coefficient": "resistance_2"})
    areas, coefficients = check_tunnel_resistance(fields, tunnels)
    vehicle = Vehicle(
        id=main.name("id"),
        name=main.name("name"),
        source=str(fields.source),
        mass_kg=main.quantity("mass", "mass"),
        rotating_mass_ratio=main.quantity("rotating_mass", "ratio", 0.0),
        train_length_m=train_length_m(main.source, main.quantity("length", "length")),
        max_speed_mps=max_speed_mps,
        resistance=fields.table("resistance").made(Resistance),
        traction=efforts.traction,
        electric_brake=efforts.electric_brake,
        friction_brake_force_n=friction_n,
        brake_policy=_brake_policy(fields, friction_n, has_electric=has_electric),
        max_acceleration_mps2=main.quantity("max_acceleration", "acceleration", np.inf, unbounded=True),
        max_deceleration_mps2=main.quantity("max_deceleration", "acceleration", np.inf, unbounded=True),
        service_brake=_service_brake(fields.optional_table("service_brake"), has_electric=has_electric),
        adhesive_mass_kg=_alone(fields, "adhesion", ("adhesive_mass", "mass"), np.inf, unbounded=True),
        auxiliary_power_w=main.quantity("auxiliary_power", "power", 0.0),
        comfort_power_w=main.quantity("comfort_power", "power", 0.0),
        tunnel_area_m2=areas,
        tunnel_resistance_n_per_mps2=coefficients,
        default_level=Level.L0_REG,
        loads=MappingProxyType({name: loads.table(name).made(Load) for name in loads.data}),
        modes=MappingProxyType(modes),
        mode=mode,
    )
    return checked(vehicle, main.names(ACCEPTED, VEHICLE_CHECKS), insist=insist)


def _alone(fields: Fields, key: str, quantity: tuple[str, str], default: float, *, unbounded: bool = False) -> float:
    """The one quantity of a table, or the default if the file lacks the table."""
    if not fields.has(key):
        return default
    table = fields.table(key)
    table.check_keys(["source", *table.quantity_keys(dict([quantity]))])
    return table.quantity(*quantity, unbounded=unbounded)


def _service_brake(table: Fields, *, has_electric: bool) -> ServiceBrake:
    """The service brake of a file; one that does not say how fast its friction brakes alone act has an air brake."""
    brake = table.made(ServiceBrake)
    says = has_electric or table.given_keys("build_up", "time")
    return brake if says else replace(brake, build_up_s=AIR_BRAKE_BUILD_UP_S)


def _brake_policy(fields: Fields, friction_n: float, *, has_electric: bool) -> BrakePolicy:
    if not fields.has("brakes"):
        if friction_n > 0:
            return BrakePolicy.BLENDED if has_electric else BrakePolicy.FRICTION
        return BrakePolicy.ELECTRIC
    brakes = fields.table("brakes")
    brakes.check_keys(["source", "policy"])
    policy = brakes.choice("policy", BrakePolicy)
    if policy is BrakePolicy.ELECTRIC and not has_electric:
        raise brakes.error("policy", str(policy), "an [electric_brake] in the file")
    return policy


def read_losses(fields: Fields, vehicle: Vehicle) -> tuple[dict[Level, LossModel], Level]:
    """The loss models of a table `[losses]`, and its default level: the named one, the first with data, or L0 REG."""
    fields.check_keys(["source", "default", "own", "l1", "l2", "l3"])
    losses: dict[Level, LossModel] = {}
    for level in (Level.OWN, Level.L1, Level.L2):
        if fields.has(level):
            losses[level] = _efficiency_loss(fields.table(level))
    if fields.has(Level.L3):
        losses[Level.L3] = _loss_map(fields.table(Level.L3), vehicle)
    return losses, fields.choice("default", Level, next(iter(losses), Level.L0_REG))


def _loss_map(fields: Fields, vehicle: Vehicle) -> LossMap:
    kind = fields.text("kind")
    if kind == "csv":
        fields.check_keys(["source", "kind", "path"])
        return read_loss_map(fields.source.parent / fields.text("path"))
    if kind != "components":
        raise fields.error("kind", kind, "components or csv")
    chain = read_chain(fields)
    modes = (vehicle, *vehicle.modes.values())
    traction_n, brake_n = (
        max(getattr(one, name).max_force_n for one in modes) for name in ("traction", "electric_brake")
    )
    with np.errstate(all="ignore"):  # A map with a loss that is not finite is rejected.
        return chain.to_map(f"{fields.source} [losses.l3]", traction_n, brake_n, vehicle.max_speed_mps)


def _efficiency_loss(fields: Fields) -> EfficiencyLoss:
    made: Callable[..., EfficiencyLoss] = EfficiencyLoss.from_efficiencies
    names = ["traction_efficiency", "brake_efficiency"]
    if fields.has("mean_efficiency_ratio"):
        made, names = EfficiencyLoss.symmetric, ["mean_efficiency"]
    fields.check_keys(["source", *(f"{name}_ratio" for name in names), *fields.quantity_keys({"idle": "power"})])
    return made(*(_efficiency(fields, name) for name in names), idle_w=fields.quantity("idle", "power", 0.0))


def _efficiency(fields: Fields, name: str) -> float:
    value = fields.quantity(name, "ratio")
    if not 0 < value <= 1:
        raise fields.error(f"{name}_ratio", value, "more than 0 and at most 1")
    return value


def read_chain(fields: Fields) -> LossChain:
    """The parametric loss chain of a table `[losses.l3]`."""
    kinds = get_type_hints(LossChain)
    fields.check_keys(["source", "kind", *kinds])
    return LossChain(**{name: _component(fields.table(name), kind) for name, kind in kinds.items()})


def _component(fields: Fields, kind: type[Any]) -> Any:
    if kind is not Converter:
        return fields.made(kind)
    keys = "clock_speeds_kmh", "clock_pulses"
    speeds, pulses = (_clock_numbers(fields, key) for key in keys)
    return fields.made(kind, *keys, clock_speeds_mps=tuple(x * KMH for x in speeds), clock_pulses=pulses)


def _clock_numbers(fields: Fields, key: str) -> tuple[float, ...]:
    values = fields.data.get(key, MISSING)
    if not isinstance(values, list):
        raise fields.error(key, values, "a list of numbers")
    fields.check_count(key, values)
    return tuple(in_si(fields.source, f"{fields.prefix}{key}[{i}]", x, ("-", "ratio")) for i, x in enumerate(values))


def read_loss_map(path: Path) -> LossMap:
    """Read a loss map; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    rows = read_columns(path, "loss map", {"speed": "speed", "force": "force", "loss": "power"}, MOST_MAP_POINTS)
    data = np.array(list(rows.values()))
    speeds, i = np.unique(data[:, 0].round(9), return_inverse=True)
    forces, j = np.unique(data[:, 1].round(6), return_inverse=True)
    check_map_size(path, len(speeds), len(forces))
    first: dict[tuple[int, int], int] = {}
    for line, point in zip(rows, zip(i.tolist(), j.tolist(), strict=True), strict=True):
        if first.setdefault(point, line) != line:
            raise InputError(
                path, f"line {line}", f"the point of line {first[point]}", "each speed and force only once"
            )
    table = np.full((len(speeds), len(forces)), np.nan)
    table[i, j] = data[:, 2]
    return LossMap(name=str(path), speed_mps=_evened(speeds), force_n=_evened(forces), loss_w_table=table)


def _evened(axis: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """An evenly spaced axis, if the given one differs from it only by rounding in the file (under 1 % of a step)."""
    even = np.linspace(axis[0], axis[-1], len(axis))
    if len(axis) > 1 and np.abs(even - axis).max() < 0.01 * (axis[-1] - axis[0]) / (len(axis) - 1):
        even[np.abs(even) < 1e-9 * (axis[-1] - axis[0])] = 0.0
        return even
    return axis


def site_braking(fields: Fields) -> SiteBraking:
    """The braking of a site's drivers, from a table of a scenario or of a build plan.

    Raises InputError for an unknown key, and for a value that is implausible for a driver.
    """
    fields.check_keys(fields.quantity_keys(_SITE_BRAKING))
    brake_mps2 = fields.within("planning_brake", "acceleration", 0.5, (0.1, 1.5))
    return SiteBraking(
        deceleration_mps2=brake_mps2 if fields.given_keys("planning_brake", "acceleration") else None,
        reaction_s=fields.within("reaction", "time", REACTION_S, (0.0, 10.0)),
        below_limit_mps=fields.within("below_limit", "speed", 0.0, (0.0, 20.0 * KMH)),
    )


def check_tunnel_resistance(
    fields: Fields, rows: Iterable[Sequence[float]]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Cross sections (m²) and coefficients (N/(m/s)²), sorted; InputError for impossible values."""
    ordered = sorted(tuple(row) for row in rows)
    for i, (area, coefficient) in enumerate(ordered):
        if not 0 < area < np.inf or (i and area == ordered[i - 1][0]):
            raise fields.error(f"tunnel resistance[{i}] cross section", area, "different finite areas > 0")
        if not 0 <= coefficient < np.inf:
            key = f"tunnel resistance[{i}] coefficient (N/(m/s)²)"
            raise fields.error(key, coefficient, "a finite number >= 0")
    return tuple(row[0] for row in ordered), tuple(row[1] for row in ordered)
