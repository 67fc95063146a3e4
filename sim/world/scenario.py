"""Scenario files: train, line, timetable, differences from the plan, disturbances, and the random draws of a seed.

The format: docs/reference/scenarios.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import fields as fields_of
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from das.domain.braking import SiteBraking
from das.domain.conditions import BOUNDS, Conditions
from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.load import bundled_files, load_vehicle, locate
from das.domain.files.reading import MOST_ROWS, Fields, in_si, number, quantity_of, range_expected, read_toml
from das.domain.files.vehicles import read_loss_map, site_braking
from das.domain.levels import Level
from das.domain.units import to_si
from das.domain.vehicle import Vehicle
from sim.drivers.parameters import HumanParameters, Participant
from sim.world.disturbances import KINDS, Disturbance, SensorFault


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A figure drawn for each seed, uniformly between `low` and `high`; fixed if the two are equal."""

    low: float
    high: float

    def draw(self, random: np.random.Generator) -> float:
        return float(random.uniform(self.low, self.high))


def read_range(table: Fields, key: str) -> Drawn:
    """Read a figure: `delay_s = 90` or `delay_s = {min = 30, max = 180}`.

    Raises InputError for anything else.
    """
    if not isinstance(table.data.get(key), Mapping):
        value = number(table.source, f"{table.prefix}{key}", table.data.get(key, MISSING))
        return Drawn(low=value, high=value)
    ends = table.table(key)
    ends.check_keys(["min", "max"])
    low, high = (number(table.source, f"{ends.prefix}{end}", ends.data.get(end, MISSING)) for end in ("min", "max"))
    if not low <= high:
        raise table.error(key, table.data[key], "{min = …, max = …} in this order")
    return Drawn(low=low, high=high)


def key_of(table: Fields, name: str, dimension: str) -> str:
    """The key of a quantity in the file; the bare name of the quantity if the file does not give it."""
    return next(iter(table.given_keys(name, dimension)), name)


TRUTH_STREAM = 5
"""Number of the random stream of a seed from which the conditions are drawn."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The differences between the true and the planned train; None means as planned.

    `conditions` are the ranges from which the `Conditions` of each seed are drawn, by the names of the fields.
    `adhesive_mass_kg` is the mass on driven axles; it replaces the mass in the vehicle's file. `loss_map` is the file
    of the true train's losses (L3).
    """

    conditions: Mapping[str, Drawn]
    adhesive_mass_kg: float | None = None
    vehicle: str | None = None
    load: str | None = None
    level: Level | None = None
    loss_map: Path | None = None

    @property
    def is_as_planned(self) -> bool:
        """Whether train, load and losses are as in the plan; the conditions of a run may still differ."""
        others = (self.adhesive_mass_kg, self.vehicle, self.load, self.level, self.loss_map)
        return all(one is None for one in others)

    @property
    def of_every_day(self) -> Conditions | None:
        """The conditions of every run; None if the conditions differ between seeds."""
        if any(drawn.low != drawn.high for drawn in self.conditions.values()):
            return None
        return Conditions(**{name: drawn.low for name, drawn in self.conditions.items()})

    def draw(self, seed: int) -> Conditions:
        """Draw the conditions of a seed's run."""
        random = np.random.default_rng([seed, TRUTH_STREAM])
        return Conditions(**{name: drawn.draw(random) for name, drawn in self.conditions.items()})

    def train(self, planned: Vehicle, planned_level: Level) -> tuple[Vehicle, Level]:
        """The true train and the level of its losses; raises DasError for files that cannot be used."""
        vehicle = planned if self.vehicle is None else load_vehicle(self.vehicle)
        vehicle = vehicle if self.load is None else vehicle.loaded(self.load)
        level = planned_level if self.level is None else self.level
        if self.loss_map is not None:
            vehicle, level = vehicle.with_loss_map(read_loss_map(self.loss_map)), Level.L3
        if self.adhesive_mass_kg is not None:
            vehicle = replace(vehicle, adhesive_mass_kg=self.adhesive_mass_kg)
        vehicle.loss_model(level)
        return vehicle, level


def read_truth(table: Fields) -> Truth:
    """Read the table `[truth]` of a scenario; raises DasError or InputError for anything unusable."""
    conditions = {field: quantity_of(field) for field in BOUNDS}
    quantities = table.quantity_keys(dict([*conditions.values(), ("adhesive_mass", "mass")]))
    table.check_keys([*quantities, "vehicle", "load", "level", "loss_map"])
    folder = table.source.parent
    return Truth(
        conditions={
            field: _read_within(table, quantity, getattr(Conditions, field), BOUNDS[field])
            for field, quantity in conditions.items()
        },
        adhesive_mass_kg=_adhesive_mass(table),
        vehicle=beside(folder, table.text("vehicle")) if table.has("vehicle") else None,
        load=table.text("load") if table.has("load") else None,
        level=_level(table),
        loss_map=folder / table.text("loss_map") if table.has("loss_map") else None,
    )


def beside(folder: Path, name: str) -> str:
    """The unchanged name of a bundled file, or the path of a file, resolved from the scenario's folder."""
    return str(folder / name) if Path(name).suffix else name


def _adhesive_mass(table: Fields) -> float | None:
    key = key_of(table, "adhesive_mass", "mass")
    if not table.has(key):
        return None
    mass_kg = table.quantity("adhesive_mass", "mass")
    if mass_kg <= 0:
        raise table.error(key, table.data[key], "a finite mass > 0")
    return mass_kg


def _level(table: Fields) -> Level | None:
    if not table.has("level"):
        return None
    level = table.choice("level", Level)
    if table.has("loss_map") and level is not Level.L3:
        raise table.error("level", str(level), f"{Level.L3}, the level of a loss map")
    return level


HUMAN_STREAM = 4
"""Number of the random stream of a seed from which the driver is drawn."""
TRIPS = "trips"
COUNTED = ("notches",)
"""Parameters that are whole numbers."""


@dataclass(frozen=True, kw_only=True)
class HumanRange:
    """The human drivers of a scenario: parameters by name, and `trips`, the number of trips already made.

    Parameters that are not given have default values.
    """

    given: Mapping[str, Drawn]

    def of(self, seed: int, who: Participant | None, source: Path) -> tuple[HumanParameters, dict[str, float]]:
        """The parameters of the participant or, without one, of the seed's driver, and the values drawn for them.

        Values of the scenario (`source`) replace the population's. Raises DasError if those of a participant contradict
        each other, or if the scenario gives a range, which would make a different driver for each seed.
        """
        if who is None:
            random = np.random.default_rng([seed, HUMAN_STREAM])
            drawn = {name: figure.draw(random) for name, figure in self.given.items()}
            return _driver(drawn), drawn
        for name, figure in self.given.items():
            if figure.low != figure.high:
                expected = "expected one value, because a participant is the same in every run"
                raise DasError(f"{source}: human.{name} is a range: {expected}")
        fixed = {name: figure.low for name, figure in self.given.items()}
        values = who.population.draw(who.number) | fixed
        try:
            return _driver(values), {"participant": who.number, **values}
        except InputError as error:
            raise DasError(f"{who.population.source}: participant {who.number}: {error}") from None


def read_human(table: Fields) -> HumanRange:
    """Read the table `[human]` of a scenario; raises InputError or DasError for anything unusable."""
    table.check_keys([TRIPS, *(item.name for item in fields_of(HumanParameters))])
    given = {name: read_range(table, name) for name in table.data}
    for name, figure in given.items():
        if name in COUNTED and figure.low != figure.high:
            raise table.error(name, table.data[name], "one whole number")
    lows = {name: figure.low for name, figure in given.items()}
    highs = {name: figure.high for name, figure in given.items()}
    # The mean time between glances must not be below the least time even for the closest values that can be drawn.
    nearest = lows | {name: highs[name] for name in ("glance_least_s",) if name in highs}
    for ends in (nearest, highs):
        try:
            _driver(ends)
        except InputError as error:
            raise DasError(f"{table.source}: {str(error).replace('human driver: ', table.prefix, 1)}") from None
    return HumanRange(given=given)


def _driver(values: Mapping[str, float]) -> HumanParameters:
    of_driver: dict[str, Any] = {name: value for name, value in values.items() if name != TRIPS}
    counted = {name: int(of_driver[name]) for name in COUNTED if name in of_driver and of_driver[name] % 1 == 0}
    return HumanParameters(**(of_driver | counted)).after(values.get(TRIPS, 0.0))


SCHEMA_VERSION = 1
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LATEST = datetime(2200, 1, 1, tzinfo=UTC)
"""Latest departure in a scenario: times on the bus are ns since 1970 in 63 bits, which end in 2262."""
LONGEST_DWELL_S = 86_400.0
_ID = re.compile(r"\w[\w.-]{0,63}")
"""The form of an id, which becomes part of file names."""

KEYS = (
    *("id", "title", "description", "route", "vehicle", "load", "loss_map", "reverse", "from", "to"),
    *("calls", "journey"),
)
"""The keys of the table `[scenario]`."""
_RISING = (("from_m", "to_m"), ("valid_from_s", "valid_until_s"), ("seen_m", "told_m"))
"""Pairs of figures of a disturbance; the second of a pair must be greater than the first."""
_DIMENSIONS = {"m": "length", "s": "time", "mps": "speed", "ratio": "ratio"}
_SIZED = (SensorFault.JUMP, SensorFault.NOISE)
"""Localisation faults that have a size."""
LONGEST_LINE_M = 1e7
_MOST = {"time": LONGEST_DWELL_S, "length": LONGEST_LINE_M}
"""Greatest values (SI) by dimension; a larger figure is considered a typing error."""
_RANGES = {
    "speed_mps": (1.0, 200.0),
    "adhesion_ratio": BOUNDS["adhesion_ratio"],
    "wind_mps": BOUNDS["head_wind_mps"],
    "size_m": (1.0, LONGEST_LINE_M),
}
"""Least and greatest values (SI) of figures with a narrower range than 0 to `_MOST`, so that trains get through."""


@dataclass(frozen=True, kw_only=True)
class PlannedDisturbance:
    """A disturbance as given in the file: figures drawn for each seed, and fixed properties."""

    kind: str
    figures: Mapping[str, Drawn]
    fixed: Mapping[str, Any]

    def draw(self, random: np.random.Generator) -> Disturbance:
        """Draw the disturbance of one run."""
        drawn = {name: figure.draw(random) for name, figure in self.figures.items()}
        disturbance: Disturbance = KINDS[self.kind](**drawn, **self.fixed)
        return disturbance


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """The noise of faultless sensors of the train: standard deviations of position and speed (assumptions).

    `force_noise_ratio` is the relative standard deviation of the efforts that train control measures; None if it does
    not measure efforts.
    """

    position_noise_m: float = 3.0
    speed_noise_mps: float = 0.05
    force_noise_ratio: float | None = None


class EarlyDeparture(StrEnum):
    """The effect of traction that a driver sets before the train may depart."""

    WITHHELD = "withheld"
    """Traction is withheld, as by a door interlock."""
    COUNTED = "counted"
    """The train leaves, and the run reports that it left early."""


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A set of runs that can be simulated: one for each seed, with a driver drawn from `human`.

    The times of sections are `running_s` or, if that is None, the least time with service braking plus a
    buffer. `calls` names the stops on the way at which the train calls; None: at all of them. `loss_map`
    is the file of losses (L3) used to plan the advice instead of the vehicle's own losses. `journey` gives stops,
    dwells, passings and times, which count from midnight before the departure. `early_departure` is the effect of
    traction that a driver sets before the train may depart.
    """

    id: str
    title: str
    description: str
    source: Path
    route: str
    vehicle: str
    load: str | None
    reverse: bool
    from_stop: str | None
    to_stop: str | None
    departure_ns: int
    buffer_ratio: float
    running_s: tuple[float, ...] | None
    dwell_s: float
    truth: Truth
    human: HumanRange
    sensors: Sensors
    braking: SiteBraking
    disturbances: tuple[PlannedDisturbance, ...]
    calls: tuple[str, ...] | None = None
    loss_map: Path | None = None
    journey: str | None = None
    early_departure: EarlyDeparture = EarlyDeparture.WITHHELD

    def timed_by(self, journey: str) -> Scenario:
        """The scenario with the stops and times of a journey (its bundled name, or its file)."""
        return replace(self, journey=journey, from_stop=None, to_stop=None, calls=None, running_s=None)

    def day(self, seed: int) -> tuple[Disturbance, ...]:
        """The disturbances of a seed's run, drawn at random."""
        random = np.random.default_rng([seed, 1])
        return tuple(planned.draw(random) for planned in self.disturbances)


def bundled_scenarios() -> dict[str, Path]:
    """The files of the bundled scenarios, by name."""
    return bundled_files("sim.world", "scenarios")


def load_scenario(name_or_path: str, journey: str | None = None) -> Scenario:
    """Read a bundled scenario or a TOML file; a `journey` (bundled name or file) replaces its stops and times.

    Raises DasError or InputError for anything unusable.
    """
    scenario = read_scenario(locate(name_or_path, "scenario", bundled_scenarios()))
    return scenario if journey is None else scenario.timed_by(journey)


def read_scenario(path: Path) -> Scenario:
    """Read a scenario; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    return scenario_of(read_toml(path))


def scenario_of(fields: Fields) -> Scenario:
    """The scenario in the fields of a file; raises InputError for anything unusable."""
    path = fields.source
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(
        ["schema_version", "scenario", "timetable", "truth", "human", "sensors", "braking", "disturbances"]
    )
    main = fields.table("scenario")
    main.check_keys(KEYS)
    timetable = fields.optional_table("timetable")
    own_times = timetable.quantity_keys({"buffer": "ratio", "running": "time", "dwell": "time"})
    timetable.check_keys(["departure", "early_departure", *own_times])
    if main.has("journey"):
        _refuse_beside_journey(main, ("from", "to", "calls"))
        _refuse_beside_journey(timetable, own_times)
    return Scenario(
        id=_id(main),
        title=main.text("title"),
        description=main.text("description", ""),
        source=path,
        route=beside(path.parent, main.text("route")),
        vehicle=beside(path.parent, main.text("vehicle")),
        load=main.text("load") if main.has("load") else None,
        reverse=main.flag("reverse", False),
        from_stop=main.text("from") if main.has("from") else None,
        to_stop=main.text("to") if main.has("to") else None,
        departure_ns=_moment(timetable),
        buffer_ratio=timetable.within("buffer", "ratio", 0.07, (0.0, 10.0)),
        running_s=_running_s(timetable),
        dwell_s=timetable.within("dwell", "time", 60.0, (0.0, LONGEST_DWELL_S)),
        truth=read_truth(fields.optional_table("truth")),
        human=read_human(fields.optional_table("human")),
        sensors=_sensors(fields.optional_table("sensors")),
        braking=site_braking(fields.optional_table("braking")),
        disturbances=tuple(map(_planned, fields.tables("disturbances", MOST_ROWS))),
        calls=_calls(main),
        loss_map=path.parent / main.text("loss_map") if main.has("loss_map") else None,
        journey=beside(path.parent, main.text("journey")) if main.has("journey") else None,
        early_departure=timetable.choice("early_departure", EarlyDeparture, EarlyDeparture.WITHHELD),
    )


def _refuse_beside_journey(table: Fields, keys: Sequence[str]) -> None:
    for key in keys:
        if table.has(key):
            expected = "none with scenario.journey, which has stops and times of its own"
            raise table.error(key, table.data[key], expected)


def _running_s(timetable: Fields) -> tuple[float, ...] | None:
    """The running times (s) of the sections, if the timetable gives any; a buffer as well is rejected."""
    given = timetable.given_keys("running", "time")
    if not given:
        return None
    if more := [*given[1:], *timetable.given_keys("buffer", "ratio")]:
        raise timetable.error(more[0], timetable.data[more[0]], f"none with {given[0]}")
    unit, times = given[0].rpartition("_")[2], []
    for i, value in enumerate(timetable.rows(given[0], "a list of times, one for each section")):
        key = f"{given[0]}[{i}]"
        time_s = in_si(timetable.source, timetable.prefix + key, value, (unit, "time"), unbounded=True)
        if not 0.0 < time_s <= LONGEST_DWELL_S:
            raise timetable.error(
                key, value, f"more than 0, and {range_expected(unit, 'time', (0.0, LONGEST_DWELL_S))}"
            )
        times.append(time_s)
    return tuple(times)


def _calls(main: Fields) -> tuple[str, ...] | None:
    if not main.has("calls"):
        return None
    names = main.data["calls"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise main.error("calls", names, "a list of names of stops")
    return tuple(names)


def _id(main: Fields) -> str:
    name = main.text("id")
    if not _ID.fullmatch(name):
        raise main.error("id", name, "1 to 64 letters, digits, '.', '_' or '-', not beginning with '.' or '-'")
    return name


def _moment(timetable: Fields) -> int:
    text = timetable.text("departure", "2026-11-21T08:04:00Z")
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        moment = None
    if moment is None or moment.tzinfo is None:
        raise timetable.error("departure", text, "a time with its zone, like 2026-11-21T08:04:00Z")
    if not EPOCH < moment < LATEST:
        raise timetable.error("departure", text, f"a time in {EPOCH.year} to {LATEST.year - 1}")
    return (moment - EPOCH) // timedelta(microseconds=1) * 1000


def _sensors(fields: Fields) -> Sensors:
    quantities = {"position_noise": "length", "speed_noise": "speed", "force_noise": "ratio"}
    fields.check_keys(fields.quantity_keys(quantities))
    says_forces, any_size = fields.given_keys("force_noise", "ratio"), (0.0, np.inf)
    return Sensors(
        position_noise_m=fields.within("position_noise", "length", Sensors.position_noise_m, any_size),
        speed_noise_mps=fields.within("speed_noise", "speed", Sensors.speed_noise_mps, any_size),
        force_noise_ratio=fields.within("force_noise", "ratio", 0.0, any_size) if says_forces else None,
    )


def _planned(table: Fields) -> PlannedDisturbance:
    kind = table.text("kind")
    if kind not in KINDS:
        raise table.error("kind", kind, "one of " + ", ".join(KINDS))
    every = fields_of(KINDS[kind])
    others = [one.name for one in every if one.name in ("stop", "fault")]
    parts = {one.name: one.name.rpartition("_") for one in every if one.name not in others}
    quantities = {field: (name, _DIMENSIONS[suffix]) for field, (name, _, suffix) in parts.items()}
    fixed: dict[str, Any] = {"stop": table.name("stop")} if "stop" in others else {}
    if kind == "sensor-fault":
        fixed["fault"] = fault = table.choice("fault", SensorFault)
        if fault not in _SIZED:
            fixed["size_m"] = 0.0
            del quantities["size_m"]
    table.check_keys(["kind", *others, *table.quantity_keys(dict(quantities.values()))])
    optional = {one.name for one in every if one.default is None}
    figures = {
        field: _read_within(table, (name, unit), None, _RANGES.get(field, (0.0, _MOST.get(unit, np.inf))))
        for field, (name, unit) in quantities.items()
        if field not in optional or table.given_keys(name, unit)
    }
    for lower, higher in _RISING:
        if {lower, higher} <= figures.keys() and not figures[lower].high < figures[higher].low:
            key, (name, _, suffix) = key_of(table, *quantities[higher]), parts[lower]
            raise table.error(key, table.data[key], f"more than {name} = {figures[lower].high:g} {suffix}")
    return PlannedDisturbance(kind=kind, figures=figures, fixed=fixed)


def _read_within(table: Fields, quantity: tuple[str, str], default: float | None, ends: tuple[float, float]) -> Drawn:
    """Read a quantity, given by name and dimension, or a range of it (SI); InputError for one beyond its ends (SI)."""
    (name, dimension), key = quantity, key_of(table, *quantity)
    unit = key[len(name) + 1 :]
    if isinstance(table.data.get(key), Mapping):
        for more in table.given_keys(name, dimension)[1:]:
            raise table.error(more, table.data[more], f"only one of {key} and {more}")
        drawn = read_range(table, key)
        low, high = to_si(drawn.low, unit, dimension), to_si(drawn.high, unit, dimension)
    else:
        low = high = table.quantity(name, dimension, default, unbounded=True)
    if not ends[0] <= low <= high <= ends[1] or np.isinf(high):
        expected = range_expected(unit, dimension, ends)
        raise table.error(key, table.data[key], f"{expected}, or {{min = …, max = …}} in this order")
    return Drawn(low=low, high=high)
