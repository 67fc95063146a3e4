"""Reader for the project's own TOML files of vehicles and routes (format: docs/reference/file-formats.md)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import MISSING
from das.domain.files.losses_toml import read_chain, read_losses
from das.domain.files.reading import Fields, read_toml, train_length_m
from das.domain.files.ttobench import check_tunnel_resistance, curvature_stretches
from das.domain.loss_chain import LossChain
from das.domain.losses import Level
from das.domain.plausibility import ACCEPTED, ROUTE_CHECKS, VEHICLE_CHECKS, check_route, check_vehicle
from das.domain.route import Route, Stop, Stretches, Tunnel, Zone
from das.domain.vehicle import BrakePolicy, EffortEnvelope, Load, Resistance, ServiceBrake, Vehicle

Floats = NDArray[np.float64]

SCHEMA_VERSION = 1
MOST_STOPS = 1000
"""Most stops of a route. Assumption: the longest lines have some hundred."""
MOST_POINTS = 200_000
"""Most points of a route's geometry: 1000 km with one every 5 m."""
INSIST = f'if it is meant, say {ACCEPTED} = ["{{check}}"] in [%s]'
"""How a file's maker gets past a value that is refused for not being plausible."""

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
            *("electric_brake", "friction_brake", "brakes", "service_brake", "adhesion", "losses", "loads"),
        ]
    )
    vehicle = _lossless(fields)  # checks masses, speeds and forces before a loss map is made from them
    losses, default = read_losses(fields.table("losses"), vehicle)
    return replace(vehicle, losses=MappingProxyType(losses), default_level=default)


def _lossless(fields: Fields) -> Vehicle:
    """The vehicle without its losses."""
    main = fields.table("vehicle")
    main.check_keys(["id", "name", "source", ACCEPTED, "rotating_mass_ratio", *main.quantity_keys(_VEHICLE)])
    electric = EffortEnvelope(max_force_n=0.0, max_power_w=0.0)
    if fields.has("electric_brake"):
        electric = _envelope(fields.table("electric_brake"))
    friction_n = _friction_brake_n(fields)
    areas, coefficients = _tunnel_resistance(fields)
    vehicle = Vehicle(
        id=main.name("id"),
        name=main.name("name"),
        source=str(fields.source),
        mass_kg=main.quantity("mass", "mass"),
        rotating_mass_ratio=main.quantity("rotating_mass", "ratio", 0.0),
        train_length_m=train_length_m(main.source, main.quantity("length", "length")),
        max_speed_mps=main.quantity("max_speed", "speed"),
        resistance=_resistance(fields.table("resistance")),
        traction=_envelope(fields.table("traction")),
        electric_brake=electric,
        friction_brake_force_n=friction_n,
        brake_policy=_brake_policy(fields, electric, friction_n),
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
    )
    return check_vehicle(vehicle, _accepted(main, VEHICLE_CHECKS), insist=INSIST % "vehicle")


def read_loss_chain(path: Path) -> LossChain:
    """The parametric loss chain of a vehicle file; raises DasError where its level L3 is not `kind = "components"`."""
    table = read_toml(path).table("losses").table(Level.L3)
    if table.text("kind") != "components":
        raise table.error("kind", table.text("kind"), "components")
    return read_chain(table)


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
            *("id", "name", "source", "description", "illustrative", ACCEPTED),
            *main.quantity_keys({"length": "length", "altitude_at_start": "length"}),
        ]
    )
    position_m, latitude_deg, longitude_deg = _geometry(fields)
    route = Route(
        id=main.name("id"),
        name=main.name("name"),
        source=str(path),
        illustrative=main.flag("illustrative", False),
        length_m=main.quantity("length", "length"),
        stops=_stops(fields),
        limits_mps=_stretches(fields, "speed_limits", "limit", "speed"),
        gradients_ratio=_stretches(fields, "gradients", "gradient", "gradient"),
        curvature_per_m=_curvature(fields),
        tunnels=_tunnels(fields),
        receptivity_ratio=_receptivity(fields),
        neutral_sections=_zones(fields, "neutral_sections"),
        no_regeneration=_zones(fields, "no_regeneration"),
        altitude_at_start_m=main.quantity("altitude_at_start", "length", 0.0),
        geometry_position_m=position_m,
        geometry_latitude_deg=latitude_deg,
        geometry_longitude_deg=longitude_deg,
    )
    return check_route(route, _accepted(main, ROUTE_CHECKS), insist=INSIST % "route")


def _accepted(main: Fields, checks: tuple[str, ...]) -> list[str]:
    """The plausibility checks whose refusal a file accepts."""
    names = main.data.get(ACCEPTED, [])
    if not isinstance(names, list) or any(name not in checks for name in names):
        raise main.error(ACCEPTED, names, f"a list of names out of {', '.join(checks)}")
    return names


def _geometry(fields: Fields) -> tuple[Floats, Floats, Floats]:
    """Position (m), latitude and longitude (deg) of each point of the route's way; empty where the file has none."""
    if not fields.has("geometry"):
        return np.empty(0), np.empty(0), np.empty(0)
    wanted = {"position": "length", "latitude": "angle", "longitude": "angle"}
    columns = fields.columns("geometry", wanted, most=MOST_POINTS)
    return np.array(columns["position"]), np.array(columns["latitude"]), np.array(columns["longitude"])


def _curvature(fields: Fields) -> Stretches:
    """Mean curvature of each stretch; the line is straight where the file has no curves."""
    rows = [[0.0, np.inf, np.inf]]
    if fields.has("curves"):
        wanted = {"position": "length", "radius_start": "length", "radius_end": "length"}
        columns = fields.columns("curves", wanted, unbounded=("radius_start", "radius_end"))
        rows = [list(row) for row in zip(*columns.values(), strict=True)]
    return curvature_stretches(str(fields.source), rows)


def _resistance(fields: Fields) -> Resistance:
    fields.check_keys(["source", *fields.quantity_keys(_RESISTANCE)])
    return Resistance(
        c0_n=fields.quantity("c0", "force"),
        c1_n_per_mps=fields.quantity("c1", "resistance_1"),
        c2_n_per_mps2=fields.quantity("c2", "resistance_2"),
    )


def _friction_brake_n(fields: Fields) -> float:
    """Largest force of the friction brake (N); 0 where the file has none."""
    if not fields.has("friction_brake"):
        return 0.0
    table = fields.table("friction_brake")
    table.check_keys(["source", *table.quantity_keys({"max_force": "force"})])
    return table.quantity("max_force", "force")


def _service_brake(fields: Fields) -> ServiceBrake:
    """How the train is braked in service; the usual figures for what the file does not say."""
    usual = ServiceBrake()
    if not fields.has("service_brake"):
        return usual
    table = fields.table("service_brake")
    table.check_keys(["source", *table.quantity_keys({"deceleration": "acceleration", "build_up": "time"})])
    return ServiceBrake(
        deceleration_mps2=table.quantity("deceleration", "acceleration", usual.deceleration_mps2),
        build_up_s=table.quantity("build_up", "time", usual.build_up_s),
    )


def _adhesive_mass(fields: Fields) -> float:
    """Mass on the driven axles (kg); inf without a table: adhesion is no limit."""
    if not fields.has("adhesion"):
        return np.inf
    table = fields.table("adhesion")
    table.check_keys(["source", *table.quantity_keys({"adhesive_mass": "mass"})])
    return table.quantity("adhesive_mass", "mass", unbounded=True)


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
    policy = brakes.choice("policy", BrakePolicy)
    if policy is BrakePolicy.ELECTRIC and not has_electric:
        raise brakes.error("policy", str(policy), "an [electric_brake] in the file")
    return policy


def _stops(fields: Fields) -> tuple[Stop, ...]:
    entries = fields.data.get("stops", MISSING)
    if not isinstance(entries, list):
        raise fields.error("stops", entries, "a list of [[stops]]")
    fields.check_count("stops", entries, MOST_STOPS)
    stops = []
    for i, entry in enumerate(entries):
        table = Fields.of(fields.source, entry, f"stops[{i}].")
        places = {"position": "length", "altitude": "length", "latitude": "angle", "longitude": "angle"}
        table.check_keys(["name", "source", *table.quantity_keys(places)])
        for name, dimension in places.items():
            table.quantity(name, dimension, 0.0)  # information only, but not unreadable
        stops.append(Stop(name=table.name("name"), position_m=table.quantity("position", "length")))
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
