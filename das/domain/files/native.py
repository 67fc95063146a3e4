"""Reader for the project's own TOML files of vehicles and routes (format: docs/file-formats.md)."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from das.domain.errors import MISSING, InputError
from das.domain.files.loss_map_csv import read_loss_map
from das.domain.files.reading import Fields, number, read_toml
from das.domain.files.ttobench import check_tunnel_resistance, curvature_stretches
from das.domain.loss_chain import Auxiliaries, Converter, Gear, LossChain, Motors, Transformer
from das.domain.losses import EfficiencyLoss, Level, LossModel
from das.domain.route import Route, Stop, Stretches, Tunnel, Zone
from das.domain.units import KMH
from das.domain.vehicle import BrakePolicy, EffortEnvelope, Load, Resistance, Vehicle

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
_ENVELOPE = {"max_force": "force", "max_power": "power"}
_RESISTANCE = {"c0": "force", "c1": "resistance_1", "c2": "resistance_2"}


def read_vehicle(path: Path) -> Vehicle:
    """Read a vehicle; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    fields = read_toml(path)
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(
        [
            *("schema_version", "vehicle", "resistance", "tunnel_resistance", "traction"),
            *("electric_brake", "friction_brake", "brakes", "adhesion", "losses", "loads"),
        ]
    )
    main = fields.table("vehicle")
    main.check_keys(["id", "name", "source", "rotating_mass_ratio", *main.quantity_keys(_VEHICLE)])
    resistance = fields.table("resistance")
    resistance.check_keys(["source", *resistance.quantity_keys(_RESISTANCE)])
    traction = _envelope(fields.table("traction"))
    electric = _envelope(fields.table("electric_brake")) if fields.has("electric_brake") else None
    friction_n = 0.0
    if fields.has("friction_brake"):
        friction = fields.table("friction_brake")
        friction.check_keys(["source", *friction.quantity_keys({"max_force": "force"})])
        friction_n = friction.quantity("max_force", "force")
    max_speed_mps = main.quantity("max_speed", "speed")
    electric = electric or EffortEnvelope(max_force_n=0.0, max_power_w=0.0)
    losses, default = _losses(fields.table("losses"), traction, electric, max_speed_mps)
    areas, coefficients = _tunnel_resistance(fields)
    return Vehicle(
        id=main.text("id"),
        name=main.text("name"),
        source=str(path),
        mass_kg=main.quantity("mass", "mass"),
        rotating_mass_ratio=main.quantity("rotating_mass", "ratio", 0.0),
        train_length_m=main.quantity("length", "length"),
        max_speed_mps=max_speed_mps,
        resistance=Resistance(
            c0_n=resistance.quantity("c0", "force"),
            c1_n_per_mps=resistance.quantity("c1", "resistance_1"),
            c2_n_per_mps2=resistance.quantity("c2", "resistance_2"),
        ),
        traction=traction,
        electric_brake=electric,
        friction_brake_force_n=friction_n,
        brake_policy=_brake_policy(fields, electric, friction_n),
        max_acceleration_mps2=main.quantity("max_acceleration", "acceleration", np.inf),
        max_deceleration_mps2=main.quantity("max_deceleration", "acceleration", np.inf),
        adhesive_mass_kg=_adhesive_mass(fields),
        auxiliary_power_w=main.quantity("auxiliary_power", "power", 0.0),
        comfort_power_w=main.quantity("comfort_power", "power", 0.0),
        tunnel_area_m2=areas,
        tunnel_resistance_n_per_mps2=coefficients,
        default_level=default,
        losses=MappingProxyType(losses),
        loads=MappingProxyType(_loads(fields)),
    )


def read_loss_chain(path: Path) -> LossChain:
    """The parametric loss chain of a vehicle file; raises DasError where its level L3 is not `kind = "components"`."""
    table = read_toml(path).table("losses").table(Level.L3)
    if table.text("kind") != "components":
        raise table.error("kind", table.text("kind"), "components")
    return _loss_chain(table)


def read_route(path: Path) -> Route:
    """Read a route; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    fields = read_toml(path)
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(
        [
            *("schema_version", "route", "stops", "speed_limits", "gradients", "curves", "tunnels", "geometry"),
            *("receptivity", "neutral_sections", "no_regeneration"),
        ]
    )
    main = fields.table("route")
    main.check_keys(
        [
            *("id", "name", "source", "description", "illustrative"),
            *main.quantity_keys({"length": "length", "altitude_at_start": "length"}),
        ]
    )
    length_m = main.quantity("length", "length")
    geometry: dict[str, list[float]] = {"position": [], "latitude": [], "longitude": []}
    if fields.has("geometry"):
        geometry = fields.columns("geometry", {"position": "length", "latitude": "angle", "longitude": "angle"})
    curves = [[0.0, np.inf, np.inf]]
    if fields.has("curves"):
        columns = fields.columns("curves", {"position": "length", "radius_start": "length", "radius_end": "length"})
        curves = [list(row) for row in zip(*columns.values(), strict=True)]
    return Route(
        id=main.text("id"),
        name=main.text("name"),
        source=str(path),
        illustrative=main.flag("illustrative", False),
        length_m=length_m,
        stops=_stops(fields),
        limits_mps=_stretches(fields, "speed_limits", "limit", "speed"),
        gradients_ratio=_stretches(fields, "gradients", "gradient", "gradient"),
        curvature_per_m=curvature_stretches(str(path), curves),
        tunnels=_tunnels(fields),
        receptivity_ratio=_receptivity(fields),
        neutral_sections=_zones(fields, "neutral_sections"),
        no_regeneration=_zones(fields, "no_regeneration"),
        altitude_at_start_m=main.quantity("altitude_at_start", "length", 0.0),
        geometry_position_m=np.array(geometry["position"]),
        geometry_latitude_deg=np.array(geometry["latitude"]),
        geometry_longitude_deg=np.array(geometry["longitude"]),
    )


def _adhesive_mass(fields: Fields) -> float:
    """Mass on the driven axles (kg); inf without a table: adhesion is no limit."""
    if not fields.has("adhesion"):
        return np.inf
    table = fields.table("adhesion")
    table.check_keys(["source", *table.quantity_keys({"adhesive_mass": "mass"})])
    return table.quantity("adhesive_mass", "mass")


def _loads(fields: Fields) -> dict[str, Load]:
    if not fields.has("loads"):
        return {}
    loads, quantities = {}, {"mass": "mass", "c0": "force"}
    for name in fields.table("loads").data:
        table = fields.table("loads").table(name)
        table.check_keys(["source", *table.quantity_keys(quantities)])
        c0_given = any(table.has(key) for key in table.quantity_keys({"c0": "force"}))
        loads[name] = Load(
            mass_kg=table.quantity("mass", "mass"), c0_n=table.quantity("c0", "force") if c0_given else None
        )
    return loads


def _tunnel_resistance(fields: Fields) -> tuple[tuple[float, ...], tuple[float, ...]]:
    if not fields.has("tunnel_resistance"):
        return (), ()
    columns = fields.columns("tunnel_resistance", {"cross_section": "area", "coefficient": "resistance_2"})
    return check_tunnel_resistance(fields, list(zip(*columns.values(), strict=True)))


def _envelope(fields: Fields) -> EffortEnvelope:
    fields.check_keys(["source", *fields.quantity_keys(_ENVELOPE)])
    return EffortEnvelope(
        max_force_n=fields.quantity("max_force", "force"), max_power_w=fields.quantity("max_power", "power")
    )


def _brake_policy(fields: Fields, electric: EffortEnvelope, friction_n: float) -> BrakePolicy:
    has_electric = electric.max_force_n > 0
    if not fields.has("brakes"):
        if friction_n > 0:
            return BrakePolicy.BLENDED if has_electric else BrakePolicy.FRICTION
        return BrakePolicy.ELECTRIC
    brakes = fields.table("brakes")
    brakes.check_keys(["source", "policy"])
    value = brakes.text("policy")
    if value not in list(BrakePolicy):
        raise brakes.error("policy", value, "one of " + ", ".join(BrakePolicy))
    if value == BrakePolicy.ELECTRIC and not has_electric:
        raise brakes.error("policy", value, "an [electric_brake] in the file")
    return BrakePolicy(value)


def _losses(
    fields: Fields, traction: EffortEnvelope, electric: EffortEnvelope, max_speed_mps: float
) -> tuple[dict[Level, LossModel], Level]:
    fields.check_keys(["source", "default", "own", "l1", "l2", "l3"])
    losses: dict[Level, LossModel] = {}
    for level in (Level.OWN, Level.L1, Level.L2):
        if fields.has(level):
            losses[level] = _efficiency_loss(fields.table(level))
    if fields.has(Level.L3):
        table = fields.table(Level.L3)
        kind = table.text("kind")
        if kind == "csv":
            table.check_keys(["source", "kind", "path"])
            losses[Level.L3] = read_loss_map(table.source.parent / table.text("path"))
        elif kind == "components":
            chain = _loss_chain(table)
            name = f"{table.source} [losses.l3]"
            losses[Level.L3] = chain.to_map(name, traction.max_force_n, electric.max_force_n, max_speed_mps)
        else:
            raise table.error("kind", kind, "components or csv")
    default = fields.text("default", next(iter(losses), Level.L0_REG))
    if default not in list(Level):
        raise fields.error("default", default, "one of " + ", ".join(Level))
    return losses, Level(default)


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


def _loss_chain(fields: Fields) -> LossChain:
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
        values["clock_speeds_mps"] = tuple(x * KMH for x in _numbers(fields, "clock_speeds_kmh"))
        values["clock_pulses"] = _numbers(fields, "clock_pulses")
    try:
        return made(**values)
    except InputError as error:
        raise InputError(fields.source, fields.prefix + error.key, error.value, error.expected) from None


def _numbers(fields: Fields, key: str) -> tuple[float, ...]:
    values = fields.data.get(key, MISSING)
    if not isinstance(values, list):
        raise fields.error(key, values, "a list of numbers")
    return tuple(number(fields.source, f"{fields.prefix}{key}[{i}]", x) for i, x in enumerate(values))


def _stops(fields: Fields) -> tuple[Stop, ...]:
    entries = fields.data.get("stops", MISSING)
    if not isinstance(entries, list):
        raise fields.error("stops", entries, "a list of [[stops]]")
    stops = []
    for i, entry in enumerate(entries):
        table = Fields.of(fields.source, entry, f"stops[{i}].")
        places = {"position": "length", "altitude": "length", "latitude": "angle", "longitude": "angle"}
        table.check_keys(["name", "source", *table.quantity_keys(places)])
        for name, dimension in places.items():
            table.quantity(name, dimension, 0.0)  # information only, but not unreadable
        stops.append(Stop(name=table.text("name"), position_m=table.quantity("position", "length")))
    return tuple(stops)


def _stretches(fields: Fields, key: str, name: str, dimension: str) -> Stretches:
    columns = fields.columns(key, {"position": "length", name: dimension})
    return Stretches(start_m=np.array(columns["position"]), value=np.array(columns[name]))


def _receptivity(fields: Fields) -> Stretches:
    if not fields.has("receptivity"):
        return Stretches(start_m=np.zeros(1), value=np.ones(1))
    return _stretches(fields, "receptivity", "receptivity", "ratio")


def _zones(fields: Fields, key: str) -> tuple[Zone, ...]:
    if not fields.has(key):
        return ()
    columns = fields.columns(key, {"position": "length", "length": "length"})
    return tuple(Zone(start_m=start, length_m=length) for start, length in zip(*columns.values(), strict=True))


def _tunnels(fields: Fields) -> tuple[Tunnel, ...]:
    if not fields.has("tunnels"):
        return ()
    columns = fields.columns("tunnels", {"position": "length", "length": "length", "cross_section": "area"})
    return tuple(
        Tunnel(start_m=start, length_m=length, area_m2=area)
        for start, length, area in zip(*columns.values(), strict=True)
    )
