"""Trains from rolling stock files of railtoolkit (YAML, schema 2022.05), as TrainRuns.jl reads them."""

from __future__ import annotations

import numpy as np

from das.domain.errors import DasError
from das.domain.files.reading import Fields, in_si
from das.domain.files.vehicles import MOST_POINTS
from das.domain.units import KMH, TONNE
from das.domain.vehicle import Load, Resistance
from precompute.vehicle_import.train import ImportedTrain, Mode, Points, number_in_si

SCHEMA = "https://railtoolkit.org/schema/rolling-stock.json"
GRAVITY_MPS2 = 9.80665
"""Gravity in TrainRuns.jl (m/s²): it turns the permille of the file into forces."""
AIR_MPS, REFERENCE_MPS = 15.0 * KMH, 100.0 * KMH
"""Head wind for traction units and passenger coaches, and reference speed of coefficients (TrainRuns.jl)."""
PASSENGER_MPS2, FREIGHT_MPS2 = 0.375, 0.225
"""Braking deceleration (m/s²) if a file gives none (Brünger and Dahlhaus 2014, p. 74, as in TrainRuns.jl)."""
MOST_VEHICLES = 1000
_TRACTION, _PASSENGER = ("traction unit", "multiple unit"), ("passenger", "multiple unit")


def is_rolling_stock(fields: Fields) -> bool:
    """Whether a YAML file is a rolling stock of railtoolkit."""
    return fields.data.get("schema") == SCHEMA


def read_rolling_stock(fields: Fields, train_id: str | None = None) -> ImportedTrain:
    """The first train of a rolling stock file, or the one with an id; raises DasError or InputError if unusable.

    The file is in t, m, km/h, N and permille of the weight. The train carries its largest load. Source of the formulas:
    TrainRuns.jl, src/formulary.jl, after Wende, "Fahrdynamik des Schienenverkehrs" (2003), pp. 151 and 153.
    """
    train = _train(fields, train_id)
    vehicles = _formation(fields, train)
    pulling = [one for one in vehicles if one.text("vehicle_type") in _TRACTION]
    if not pulling:
        raise train.error("formation", [one.text("id") for one in vehicles], "a traction unit or multiple unit in it")
    masses_kg = [number_in_si(one, "mass", ("t", "mass")) for one in vehicles]
    loads_kg = [number_in_si(one, "load_limit", ("t", "mass"), 0.0) for one in vehicles]
    for one, mass_kg in zip(vehicles, masses_kg, strict=True):
        if mass_kg <= 0:
            raise one.error("mass", one.data["mass"], "a mass above 0 (t)")
    mass_kg, load_kg = sum(masses_kg), sum(loads_kg)
    turning = [number_in_si(one, "rotation_mass", ("-", "ratio"), 1.09 if one in pulling else 1.06) for one in vehicles]
    passenger = any(one.text("vehicle_type") in _PASSENGER for one in vehicles)
    braked = (one for one in pulling if one.has("a_braking"))
    braking = [abs(number_in_si(one, "a_braking", ("m/s^2", "acceleration"))) for one in braked]
    usual_mps2 = PASSENGER_MPS2 if passenger else FREIGHT_MPS2
    limits = [number_in_si(one, "speed_limit", ("km/h", "speed")) for one in vehicles if one.has("speed_limit")]
    if not limits:
        raise DasError(f"{fields.source}: speed_limit is missing in every vehicle of {train.text('id')}")
    notes = ["the file gives no losses and no electric brake"]
    if load_kg:
        notes.append(f"the train carries its largest load, {load_kg / TONNE:g} t, as in TrainRuns.jl; see [loads]")
    if not braking:
        notes.append(f"the deceleration is {usual_mps2} m/s² (Brünger and Dahlhaus 2014, p. 74)")
    return ImportedTrain(
        id=train.name("id"),
        name=train.name("name"),
        source=f"{fields.source.name} (railtoolkit rolling stock)",
        mass_kg=mass_kg + load_kg,
        rotating_mass_ratio=float(np.average(turning, weights=masses_kg)) - 1.0,
        length_m=sum(number_in_si(one, "length", ("m", "length")) for one in vehicles),
        max_speed_mps=min(limits),
        resistance=_sum([_resistance(one, load) for one, load in zip(vehicles, loads_kg, strict=True)]),
        modes={"": Mode(_added([_points(one) for one in pulling]))},
        deceleration_mps2=min(braking, default=usual_mps2),
        notes=tuple(notes),
        empty=Load(mass_kg=mass_kg, c0_n=_sum([_resistance(one, 0.0) for one in vehicles]).c0_n) if load_kg else None,
    )


def _tables(fields: Fields, key: str) -> list[Fields]:
    rows = fields.rows(key, "a list of tables", MOST_VEHICLES)
    return [Fields.of(fields.source, row, f"{key}[{i}].") for i, row in enumerate(rows)]


def _train(fields: Fields, train_id: str | None) -> Fields:
    trains = {one.name("id"): one for one in _tables(fields, "trains")}
    if train_id is not None and train_id not in trains:
        raise DasError(f"{fields.source}: no train {train_id!r}; it has {', '.join(trains)}")
    return trains[train_id] if train_id is not None else next(iter(trains.values()))


def _formation(fields: Fields, train: Fields) -> list[Fields]:
    """The vehicles of a train, one for each occurrence in its formation."""
    known = {one.text("id"): one for one in _tables(fields, "vehicles")}
    formation = train.rows("formation", "a list of ids of vehicles", MOST_VEHICLES)
    for i, name in enumerate(formation):
        if not isinstance(name, str) or name not in known:
            raise train.error(f"formation[{i}]", name, f"the id of a vehicle: {', '.join(list(known)[:20])}")
    return [known[name] for name in formation]


def _resistance(one: Fields, load_kg: float) -> Resistance:
    """Running resistance of one vehicle.

    Traction units: m_d·g·f0 + m_c·g·f1 + m·g·f2·((v + w)/100 km/h)², with the masses on driven and on other axles.
    Coaches: (m + load)·g·(f0 + f1·v/100 km/h + f2·((v + w)/100 km/h)²); for freight wagons w = 0.
    """
    mass_kg, kind = number_in_si(one, "mass", ("t", "mass")), one.text("vehicle_type")
    keys = "base_resistance", "rolling_resistance", "air_resistance"
    f0, f1, f2 = (number_in_si(one, key, ("‰", "gradient"), 0.0) for key in keys)
    if kind in _TRACTION:
        driven_kg = number_in_si(one, "mass_traction", ("t", "mass"), mass_kg / TONNE)
        weight_n = mass_kg * GRAVITY_MPS2
        c0_n, c1 = GRAVITY_MPS2 * (driven_kg * f0 + max(mass_kg - driven_kg, 0.0) * f1), 0.0
    elif kind in ("passenger", "freight"):
        weight_n = (mass_kg + load_kg) * GRAVITY_MPS2
        c0_n, c1 = weight_n * f0, weight_n * f1 / REFERENCE_MPS
    else:
        raise one.error("vehicle_type", kind, "traction unit, multiple unit, passenger or freight")
    air = Resistance(c0_n=c0_n, c1_n_per_mps=c1, c2_n_per_mps2=weight_n * f2 / REFERENCE_MPS**2)
    return air if kind == "freight" else air.in_head_wind(AIR_MPS)


def _sum(parts: list[Resistance]) -> Resistance:
    return Resistance(
        c0_n=sum(one.c0_n for one in parts),
        c1_n_per_mps=sum(one.c1_n_per_mps for one in parts),
        c2_n_per_mps2=sum(one.c2_n_per_mps2 for one in parts),
    )


def _points(one: Fields) -> Points:
    """The points of a traction unit's effort: pairs of speed (km/h) and force (N)."""
    found = []
    for i, pair in enumerate(one.rows("tractive_effort", "a list of pairs of speed and force", MOST_POINTS)):
        if not isinstance(pair, list) or len(pair) != 2:
            raise one.error(f"tractive_effort[{i}]", pair, "a pair of speed (km/h) and force (N)")
        key = f"{one.prefix}tractive_effort[{i}]"
        speed_mps = in_si(one.source, key, pair[0], ("km/h", "speed"))
        found.append((speed_mps, in_si(one.source, key, pair[1], ("N", "force"))))
    return tuple(found)


def _added(curves: list[Points]) -> Points:
    """The efforts of several traction units together; beyond the ends of a curve, its force stays the same."""
    if len(curves) == 1:
        return curves[0]
    speeds = sorted({speed for points in curves for speed, _ in points})
    total = np.zeros(len(speeds))
    for points in curves:
        total += np.interp(speeds, [speed for speed, _ in points], [force for _, force in points])
    return tuple(zip(speeds, total.tolist(), strict=True))
