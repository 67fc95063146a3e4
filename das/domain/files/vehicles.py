"""Reader of vehicles in this project's TOML format, with their losses and the loss maps (CSV) that they name.

The formats are explained in docs/reference/file-formats.md.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from das.domain.braking import REACTION_S, SiteBraking
from das.domain.errors import MISSING, InputError
from das.domain.files.efforts import ReadEfforts, read_columns, read_efforts
from das.domain.files.reading import Fields, in_si, read_toml, train_length_m
from das.domain.levels import Level
from das.domain.loss_chain import Auxiliaries, Converter, Gear, LossChain, Motors, Transformer
from das.domain.losses import MOST_MAP_POINTS, EfficiencyLoss, LossMap, LossModel, check_map_size
from das.domain.plausibility import ACCEPTED, INSIST, VEHICLE_CHECKS, check_vehicle
from das.domain.units import KMH
from das.domain.vehicle import BrakePolicy, Load, Resistance, ServiceBrake, Vehicle

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
_RESISTANCE = {"c0": "force", "c1": "resistance_1", "c2": "resistance_2"}
_MAP_COLUMNS = {"speed": "speed", "force": "force", "loss": "power"}
_SITE_BRAKING = {"planning_brake": "acceleration", "reaction": "time", "below_limit": "speed"}


def read_vehicle(path: Path) -> Vehicle:
    """Read a vehicle; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    return vehicle_of(read_toml(path))


def vehicle_of(fields: Fields, insist: str = INSIST % "vehicle") -> Vehicle:
    """The vehicle described by the fields of a file; errors as in `read_vehicle`.

    `insist` is the end of the message for an implausible value (see `das.domain.plausibility.check_vehicle`).
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
    """The vehicle without its losses."""
    main = fields.table("vehicle")
    main.check_keys(
        ["id", "name", "source", ACCEPTED, "rotating_mass_ratio", "default_mode", *main.quantity_keys(_VEHICLE)]
    )
    max_speed_mps = main.quantity("max_speed", "speed")
    efforts = read_efforts(fields, max_speed_mps)
    friction_n = _friction_brake_n(fields)
    areas, coefficients = _tunnel_resistance(fields)
    vehicle = Vehicle(
        id=main.name("id"),
        name=main.name("name"),
        source=str(fields.source),
        mass_kg=main.quantity("mass", "mass"),
        rotating_mass_ratio=main.quantity("rotating_mass", "ratio", 0.0),
        train_length_m=train_length_m(main.source, main.quantity("length", "length")),
        max_speed_mps=max_speed_mps,
        resistance=_resistance(fields.table("resistance")),
        traction=efforts.traction,
        electric_brake=efforts.electric_brake,
        friction_brake_force_n=friction_n,
        brake_policy=_brake_policy(fields, efforts, friction_n),
        max_acceleration_mps2=main.quantity("max_acceleration", "acceleration", np.inf, unbounded=True),
        max_deceleration_mps2=main.quantity("max_deceleration", "acceleration", np.inf, unbounded=True),
        service_brake=_service_brake(fields),
        adhesive_mass_kg=_adhesive_mass(fields),
        auxiliary_power_w=main.quantity("auxiliary_power", "power", 0.0),
        comfort_power_w=main.quantity("comfort_power", "power", 0.0),
        tunnel_area_m2=areas,
        tunnel_resistance_n_per_mps2=coefficients,
        default_level=Level.L0_REG,
        loads=MappingProxyType(_loads(fields)),
        modes=MappingProxyType(efforts.modes),
        mode=efforts.mode,
    )
    return check_vehicle(vehicle, main.names(ACCEPTED, VEHICLE_CHECKS), insist=insist)


def read_loss_chain(path: Path) -> LossChain:
    """The parametric loss chain of a vehicle file; raises DasError if its level L3 is not `kind = "components"`."""
    table = read_toml(path).table("losses").table(Level.L3)
    if table.text("kind") != "components":
        raise table.error("kind", table.text("kind"), "components")
    return read_chain(table)


def _resistance(fields: Fields) -> Resistance:
    fields.check_keys(["source", *fields.quantity_keys(_RESISTANCE)])
    return Resistance(
        c0_n=fields.quantity("c0", "force"),
        c1_n_per_mps=fields.quantity("c1", "resistance_1"),
        c2_n_per_mps2=fields.quantity("c2", "resistance_2"),
    )


def _friction_brake_n(fields: Fields) -> float:
    """Largest force of the friction brake (N); 0 if the file has none."""
    if not fields.has("friction_brake"):
        return 0.0
    table = fields.table("friction_brake")
    table.check_keys(["source", *table.quantity_keys({"max_force": "force"})])
    return table.quantity("max_force", "force")


def _service_brake(fields: Fields) -> ServiceBrake:
    """Service braking of the train; values missing in the file have the usual defaults."""
    usual, table = ServiceBrake(), fields.optional_table("service_brake")
    table.check_keys(["source", *table.quantity_keys({"deceleration": "acceleration", "build_up": "time"})])
    return ServiceBrake(
        deceleration_mps2=table.quantity("deceleration", "acceleration", usual.deceleration_mps2),
        build_up_s=table.quantity("build_up", "time", usual.build_up_s),
    )


def _adhesive_mass(fields: Fields) -> float:
    """Mass on the driven axles (kg); inf without a table, which means that adhesion is no limit."""
    if not fields.has("adhesion"):
        return np.inf
    table = fields.table("adhesion")
    table.check_keys(["source", *table.quantity_keys({"adhesive_mass": "mass"})])
    return table.quantity("adhesive_mass", "mass", unbounded=True)


def _loads(fields: Fields) -> dict[str, Load]:
    loads, quantities, tables = {}, {"mass": "mass", "c0": "force"}, fields.optional_table("loads")
    for name in tables.data:
        table = tables.table(name)
        table.check_keys(["source", *table.quantity_keys(quantities)])
        loads[name] = Load(
            mass_kg=table.quantity("mass", "mass"),
            c0_n=table.quantity("c0", "force") if table.given_keys("c0", "force") else None,
        )
    return loads


def _tunnel_resistance(fields: Fields) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if not fields.has("tunnel_resistance"):
        return (), ()
    columns = fields.columns("tunnel_resistance", {"cross_section": "area", "coefficient": "resistance_2"})
    return check_tunnel_resistance(fields, list(zip(*columns.values(), strict=True)))


def _brake_policy(fields: Fields, efforts: ReadEfforts, friction_n: float) -> BrakePolicy:
    has_electric = efforts.electric_brake.max_force_n > 0
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
        table = fields.table(Level.L3)
        losses[Level.L3] = _loss_map(table, vehicle)
    return losses, fields.choice("default", Level, next(iter(losses), Level.L0_REG))


def _loss_map(fields: Fields, vehicle: Vehicle) -> LossMap:
    """The loss map of a CSV file, or one computed from a chain of components."""
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
    idle = {"idle": "power"}
    if fields.has("mean_efficiency_ratio"):
        fields.check_keys(["source", "mean_efficiency_ratio", *fields.quantity_keys(idle)])
        return EfficiencyLoss.symmetric(_efficiency(fields, "mean_efficiency"), fields.quantity("idle", "power", 0.0))
    keys = ["traction_efficiency_ratio", "brake_efficiency_ratio"]
    fields.check_keys(["source", *keys, *fields.quantity_keys(idle)])
    return EfficiencyLoss.from_efficiencies(
        _efficiency(fields, "traction_efficiency"),
        _efficiency(fields, "brake_efficiency"),
        fields.quantity("idle", "power", 0.0),
    )


def _efficiency(fields: Fields, name: str) -> float:
    value = fields.quantity(name, "ratio")
    if not 0 < value <= 1:
        raise fields.error(f"{name}_ratio", value, "more than 0 and at most 1")
    return value


_COMPONENTS: dict[str, tuple[type[Any], dict[str, str]]] = {
    "auxiliaries": (Auxiliaries, {"base": "power", "fan": "power", "rated_heat": "power"}),
    "transformer": (Transformer, {"no_load": "power", "copper": "power", "rated_power": "power"}),
    "converter": (
        Converter,
        {
            "fixed": "power",
            "line": "ratio",
            "line_brake": "ratio",
            "conduction": "power",
            "switching": "power",
            "snubber": "power",
            "asynchronous": "frequency",
            "stator": "frequency_per_speed",
        },
    ),
    "motors": (
        Motors,
        {
            "base_speed": "speed",
            "rated_force": "force",
            "magnetising": "ratio",
            "pull_out": "ratio",
            "brake_current": "ratio",
            "copper": "power",
            "iron": "power",
        },
    ),
    "gear": (Gear, {"mesh": "ratio", "churning": "power", "churning_speed": "speed"}),
}
"""Component of a loss chain → its class and its quantities (name → dimension)."""
_SI_SUFFIX = {
    "power": "w",
    "ratio": "ratio",
    "frequency": "hz",
    "frequency_per_speed": "hz_per_mps",
    "speed": "mps",
    "force": "n",
}


def read_chain(fields: Fields) -> LossChain:
    """The parametric loss chain of a table `[losses.l3]`."""
    fields.check_keys(["source", "kind", *_COMPONENTS])
    return LossChain(**{name: _component(fields.table(name), name) for name in _COMPONENTS})


def _component(fields: Fields, name: str) -> Any:
    made, quantities = _COMPONENTS[name]
    clock = ["clock_speeds_kmh", "clock_pulses"] if made is Converter else []
    fields.check_keys(["source", *fields.quantity_keys(quantities), *clock])
    values: dict[str, object] = {
        f"{quantity}_{_SI_SUFFIX[dimension]}": fields.quantity(quantity, dimension)
        for quantity, dimension in quantities.items()
    }
    if clock:
        values["clock_speeds_mps"] = tuple(x * KMH for x in _clock_numbers(fields, "clock_speeds_kmh"))
        values["clock_pulses"] = _clock_numbers(fields, "clock_pulses")
    try:
        return made(**values)
    except InputError as error:
        raise InputError(fields.source, fields.prefix + error.key, error.value, error.expected) from None


def _clock_numbers(fields: Fields, key: str) -> tuple[float, ...]:
    values = fields.data.get(key, MISSING)
    if not isinstance(values, list):
        raise fields.error(key, values, "a list of numbers")
    fields.check_count(key, values)
    return tuple(in_si(fields.source, f"{fields.prefix}{key}[{i}]", x, ("-", "ratio")) for i, x in enumerate(values))


def read_loss_map(path: Path) -> LossMap:
    """Read a loss map; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    rows = read_columns(path, "loss map", _MAP_COLUMNS, MOST_MAP_POINTS)
    return _to_map(path, rows)


def _to_map(path: Path, rows: dict[int, list[float]]) -> LossMap:
    """The loss map from rows of speed, force and loss (SI), each under its line number."""
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
    """Remove the rounding of the file's decimals (under 1 % of a step), which makes the axis exactly even."""
    even = np.linspace(axis[0], axis[-1], len(axis))
    if len(axis) > 1 and np.abs(even - axis).max() < 0.01 * (axis[-1] - axis[0]) / (len(axis) - 1):
        even[np.abs(even) < 1e-9 * (axis[-1] - axis[0])] = 0.0
        return even
    return axis


def site_braking(fields: Fields) -> SiteBraking:
    """The braking of a site's drivers, from a table of a scenario or of a plan of tables.

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
    fields: Fields, rows: list[tuple[float, float]]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Cross sections (m²) and coefficients (N/(m/s)²), sorted; InputError for impossible values."""
    rows = sorted(rows)
    for i, (area, coefficient) in enumerate(rows):
        if not 0 < area < np.inf or (i and area == rows[i - 1][0]):
            raise fields.error(f"tunnel resistance[{i}] cross section", area, "different finite areas > 0")
        if not 0 <= coefficient < np.inf:
            key = f"tunnel resistance[{i}] coefficient (N/(m/s)²)"
            raise fields.error(key, coefficient, "a finite number >= 0")
    return tuple(row[0] for row in rows), tuple(row[1] for row in rows)
