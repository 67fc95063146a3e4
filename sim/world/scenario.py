"""Scenario files: train, line, timetable, what differs from the plan, and what goes wrong.

The format: docs/reference/scenarios.md.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, replace
from dataclasses import fields as fields_of
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from das.domain.braking import SiteBraking
from das.domain.conditions import STRONGEST_WIND_MPS
from das.domain.files.load import bundled_files, locate
from das.domain.files.reading import Fields, in_si, range_expected, read_toml
from das.domain.files.vehicles import site_braking
from sim.world.disturbances import KINDS, Disturbance, SensorFault
from sim.world.drawn import Drawn, HumanRange, Truth, beside, key_of, read_human, read_quantity, read_truth

SCHEMA_VERSION = 1
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
LATEST = datetime(2200, 1, 1, tzinfo=UTC)
"""Latest departure in a scenario: times on the bus are ns since 1970 in 63 bits, which end in 2262."""
LONGEST_DWELL_S = 86_400.0
_ID = re.compile(r"\w[\w.-]{0,63}")
"""The form of an id, which becomes part of file names."""

KEYS = (
    *("id", "title", "description", "route", "vehicle", "load", "loss_map", "point_mass", "reverse", "from", "to"),
    *("calls", "journey"),
)
"""The keys of the table `[scenario]`."""
_RISING = (("from", "to"), ("valid_from", "valid_until"), ("seen", "told"))
"""Pairs of quantities of a disturbance; the second of a pair must be greater than the first."""
_SI_SUFFIX = {"length": "m", "time": "s", "speed": "mps", "ratio": "ratio"}
_DIMENSIONS = {suffix: dimension for dimension, suffix in _SI_SUFFIX.items()}
_SIZED = (SensorFault.JUMP, SensorFault.NOISE)
"""Faults of localisation that have a size."""
LONGEST_LINE_M = 1e7
_MOST = {"time": LONGEST_DWELL_S, "length": LONGEST_LINE_M}
"""Greatest values (SI) by dimension; a larger figure is taken for a typing error."""
_RANGES = {
    "speed": (1.0, 200.0),
    "adhesion": (0.01, 10.0),
    "wind": (-STRONGEST_WIND_MPS, STRONGEST_WIND_MPS),
    "size": (1.0, LONGEST_LINE_M),
}
"""Least and greatest values (SI) of figures that have a narrower range than 0 to `_MOST`: trains must get through."""


@dataclass(frozen=True, kw_only=True)
class PlannedDisturbance:
    """A disturbance as the file gives it: figures that seeds draw, and properties that are fixed."""

    kind: str
    figures: Mapping[str, Drawn]
    fixed: Mapping[str, Any]

    def draw(self, random: np.random.Generator) -> Disturbance:
        """Draw the disturbance of one day."""
        made: Any = KINDS[self.kind]
        drawn = {name: figure.draw(random) for name, figure in self.figures.items()}
        disturbance: Disturbance = made(**drawn, **self.fixed)
        return disturbance


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Noise of the train's sensors without faults: standard deviations of position and speed (assumptions).

    `force_noise_ratio` is the relative standard deviation of the efforts that train control measures; None if it does
    not measure efforts.
    """

    position_noise_m: float = 3.0
    speed_noise_mps: float = 0.05
    force_noise_ratio: float | None = None


class EarlyDeparture(StrEnum):
    """What happens when a driver sets traction before the train may depart."""

    WITHHELD = "withheld"
    """Traction is withheld, as by an interlock of the doors."""
    COUNTED = "counted"
    """The train leaves, and the run says that it left early."""


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """The days that can be simulated: each seed draws one, with its driver from `human`.

    Sections take the times of `running_s` or, if that is None, the least time of the train braked in service and a
    buffer on top of it. `calls` names the stops on the way at which the train calls; None: at all of them. `loss_map`
    is the file of the losses (L3) with which the advice is planned in place of the vehicle's own; `point_mass` plans a
    train of no length. `journey` gives stops, dwells, passings and times; its clock shows 0 at midnight before the
    departure. `early_departure` says what happens when a driver sets traction before the train may depart.
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
    point_mass: bool = False
    journey: str | None = None
    early_departure: EarlyDeparture = EarlyDeparture.WITHHELD

    def timed_by(self, journey: str) -> Scenario:
        """The same scenario with the stops and times of a journey (its bundled name, or its file)."""
        return replace(self, journey=journey, from_stop=None, to_stop=None, calls=None, running_s=None)

    def day(self, seed: int) -> tuple[Disturbance, ...]:
        """Draw the disturbances of a seed's day."""
        random = np.random.default_rng([seed, 1])
        return tuple(planned.draw(random) for planned in self.disturbances)


def bundled_scenarios() -> dict[str, Path]:
    """The files of the bundled scenarios, by name."""
    return bundled_files("sim.world", "scenarios")


def load_scenario(name_or_path: str, journey: str | None = None) -> Scenario:
    """Read a bundled scenario or a TOML file, to be timed by a journey if one is named (its bundled name, or its file).

    Raises DasError or InputError for anything unusable.
    """
    scenario = read_scenario(locate(name_or_path, "scenario", bundled_scenarios()))
    return scenario if journey is None else scenario.timed_by(journey)


def read_scenario(path: Path) -> Scenario:
    """Read a scenario; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    return scenario_of(read_toml(path))


def scenario_of(fields: Fields) -> Scenario:
    """The scenario of the fields of a file; raises InputError for anything unusable."""
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
        disturbances=_disturbances(fields),
        calls=_calls(main),
        loss_map=path.parent / main.text("loss_map") if main.has("loss_map") else None,
        point_mass=main.flag("point_mass", False),
        journey=beside(path.parent, main.text("journey")) if main.has("journey") else None,
        early_departure=timetable.choice("early_departure", EarlyDeparture, EarlyDeparture.WITHHELD),
    )


def _refuse_beside_journey(table: Fields, keys: Sequence[str]) -> None:
    for key in keys:
        if table.has(key):
            expected = "none beside scenario.journey, which has stops and times of its own"
            raise table.error(key, table.data[key], expected)


def _running_s(timetable: Fields) -> tuple[float, ...] | None:
    """The running times (s) of the sections, if the timetable states them; a buffer beside them is refused."""
    given = timetable.given_keys("running", "time")
    if not given:
        return None
    if more := [*given[1:], *timetable.given_keys("buffer", "ratio")]:
        raise timetable.error(more[0], timetable.data[more[0]], f"none beside {given[0]}")
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
    force_keys = fields.quantity_keys({"force_noise": "ratio"})
    fields.check_keys([*fields.quantity_keys({"position_noise": "length", "speed_noise": "speed"}), *force_keys])
    says_forces = any(fields.has(key) for key in force_keys)
    any_size = (0.0, np.inf)
    return Sensors(
        position_noise_m=fields.within("position_noise", "length", Sensors.position_noise_m, any_size),
        speed_noise_mps=fields.within("speed_noise", "speed", Sensors.speed_noise_mps, any_size),
        force_noise_ratio=fields.within("force_noise", "ratio", 0.0, any_size) if says_forces else None,
    )


def _disturbances(fields: Fields) -> tuple[PlannedDisturbance, ...]:
    entries = fields.data.get("disturbances", [])
    if not isinstance(entries, list):
        raise fields.error("disturbances", entries, "a list of [[disturbances]]")
    tables = (Fields.of(fields.source, entry, f"disturbances[{i}].") for i, entry in enumerate(entries))
    return tuple(_planned(table) for table in tables)


def _planned(table: Fields) -> PlannedDisturbance:
    kind = table.text("kind")
    if kind not in KINDS:
        raise table.error("kind", kind, "one of " + ", ".join(KINDS))
    quantities, optional = (_figures(kind, optional=one) for one in (False, True))
    made: Any = KINDS[kind]
    texts = {one.name: None if one.default is MISSING else one.default for one in fields_of(made) if one.type == "str"}
    fixed: dict[str, Any] = {name: table.name(name, default) for name, default in texts.items()}
    others = [*texts, *(["fault"] if kind == "sensor-fault" else [])]
    if kind == "sensor-fault":
        fixed["fault"] = fault = table.choice("fault", SensorFault)
        if fault not in _SIZED:
            fixed["size_m"] = 0.0
            quantities = {name: dimension for name, dimension in quantities.items() if name != "size"}
    table.check_keys(["kind", *others, *table.quantity_keys({**quantities, **optional})])
    given = {name: unit for name, unit in optional.items() if key_of(table, name, unit) in table.data}
    quantities = {**quantities, **given}
    drawn = {
        name: _checked(table, name, dimension, read_quantity(table, name, dimension))
        for name, dimension in quantities.items()
    }
    for lower, higher in _RISING:
        if {lower, higher} <= drawn.keys() and not drawn[lower].high < drawn[higher].low:
            key, unit = key_of(table, higher, quantities[higher]), _SI_SUFFIX[quantities[higher]]
            raise table.error(key, table.data[key], f"more than {lower} = {drawn[lower].high:g} {unit}")
    figures = {f"{name}_{_SI_SUFFIX[dimension]}": drawn[name] for name, dimension in quantities.items()}
    return PlannedDisturbance(kind=kind, figures=figures, fixed=fixed)


def _figures(kind: str, *, optional: bool) -> dict[str, str]:
    """The dimensions of the figures that a kind of disturbance must have, or may have (`optional`), by name."""
    made: Any = KINDS[kind]
    names = (one.name.rpartition("_") for one in fields_of(made) if (one.default is None) is optional)
    return {name: _DIMENSIONS[suffix] for name, _, suffix in names if suffix in _DIMENSIONS}


def _checked(table: Fields, name: str, dimension: str, figure: Drawn) -> Drawn:
    key = key_of(table, name, dimension)
    least, most = _RANGES.get(name, (0.0, _MOST.get(dimension, np.inf)))
    if not least <= figure.low <= figure.high <= most or np.isinf(figure.high):
        expected = range_expected(key[len(name) + 1 :], dimension, (least, most))
        raise table.error(key, table.data[key], f"{expected}, or {{min = …, max = …}} in this order")
    return figure
