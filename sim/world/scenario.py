"""Scenario files: train, line, timetable, and what differs and goes wrong on the day (docs/scenarios.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.files.reading import Fields, number, read_toml
from das.domain.units import to_si
from sim.world.disturbances import (
    BusOutage,
    DelayOnTheWay,
    DepartureDelay,
    Disturbance,
    HeadWind,
    NodeRestart,
    Restriction,
    SensorFault,
    SensorOutage,
    SignalStop,
    SlipperyRail,
    TrainAhead,
)

SCHEMA_VERSION = 1
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

_STRETCH = {"from": "length", "to": "length"}
_KINDS: dict[str, tuple[type[Any], dict[str, str]]] = {
    "departure-delay": (DepartureDelay, {"delay": "time"}),
    "dwell-overrun": (DepartureDelay, {"delay": "time"}),
    "delay-on-the-way": (DelayOnTheWay, {**_STRETCH, "speed": "speed"}),
    "restriction": (Restriction, {**_STRETCH, "speed": "speed", "announced": "length"}),
    "signal-stop": (SignalStop, {"at": "length", "seen": "length", "clears_after": "time"}),
    "train-ahead": (TrainAhead, {"at": "length", "seen": "length", "clears": "time", "told": "length"}),
    "slippery-rail": (SlipperyRail, {**_STRETCH, "adhesion": "ratio"}),
    "head-wind": (HeadWind, {**_STRETCH, "wind": "speed"}),
    "sensor-fault": (SensorOutage, {"from": "time", "for": "time", "size": "length"}),
    "bus-outage": (BusOutage, {"from": "time", "for": "time"}),
    "node-restart": (NodeRestart, {"at": "time"}),
}
"""Kind of disturbance → its class and its quantities (name → dimension)."""
_SI_SUFFIX = {"length": "m", "time": "s", "speed": "mps", "ratio": "ratio"}
_OPTIONAL = {"size": 0.0}
_LEAST = {"speed": 1.0, "adhesion": 0.01, "wind": -np.inf}
"""Least values (SI) of figures, where that is not 0: a train has to get through."""


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A figure that every seed draws evenly from `low` to `high` (equal: fixed)."""

    low: float
    high: float

    def draw(self, random: np.random.Generator) -> float:
        return float(random.uniform(self.low, self.high))


@dataclass(frozen=True, kw_only=True)
class Planned:
    """A disturbance as the file plans it: figures to be drawn, and what is not a figure."""

    kind: str
    figures: Mapping[str, Drawn]
    fixed: Mapping[str, Any]

    def draw(self, random: np.random.Generator) -> Disturbance:
        """The disturbance of one day."""
        made, _ = _KINDS[self.kind]
        drawn = {name: figure.draw(random) for name, figure in self.figures.items()}
        disturbance: Disturbance = made(**drawn, **self.fixed)
        return disturbance


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """Localisation as good as it gets: standard deviations of position and speed (assumptions)."""

    position_noise_m: float = 3.0
    speed_noise_mps: float = 0.05


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A day to be simulated; `conditions` are the truth's against the plan's.

    `adhesive_mass_kg` is the true train's mass on driven axles, where its file gives none (None: as the file says).
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
    dwell_s: float
    conditions: Conditions
    adhesive_mass_kg: float | None
    sensors: Sensors
    disturbances: tuple[Planned, ...]

    def day(self, seed: int) -> tuple[Disturbance, ...]:
        """The disturbances of a seed's day."""
        random = np.random.default_rng([seed, 1])
        return tuple(planned.draw(random) for planned in self.disturbances)


def bundled_scenarios() -> dict[str, Path]:
    """The scenarios that come with the program, by name."""
    folder = Path(str(files("sim.world") / "scenarios"))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_scenario(name_or_path: str) -> Scenario:
    """A bundled scenario or a TOML file; raises DasError or InputError for anything unusable."""
    bundled = bundled_scenarios()
    if name_or_path in bundled:
        return read_scenario(bundled[name_or_path])
    path = Path(name_or_path)
    if path.suffix.lower() != ".toml":
        raise DasError(f"{name_or_path}: not a bundled scenario ({', '.join(bundled)}) and not a .toml file")
    if not path.is_file():
        raise DasError(f"{name_or_path}: no such file")
    return read_scenario(path)


def read_scenario(path: Path) -> Scenario:
    """Read a scenario; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    fields = read_toml(path)
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(["schema_version", "scenario", "timetable", "truth", "sensors", "disturbances"])
    main = fields.table("scenario")
    main.check_keys(["id", "title", "description", "route", "vehicle", "load", "reverse", "from", "to"])
    timetable = _optional(fields, "timetable")
    timetable.check_keys(["departure", *timetable.quantity_keys({"buffer": "ratio", "dwell": "time"})])
    buffer_ratio = timetable.quantity("buffer", "ratio", 0.07)
    if not 0 <= buffer_ratio <= 10:
        raise timetable.error("buffer_ratio", buffer_ratio, "a ratio from 0 to 10")
    return Scenario(
        id=main.text("id"),
        title=main.text("title"),
        description=main.text("description", ""),
        source=path,
        route=_beside(path, main.text("route")),
        vehicle=_beside(path, main.text("vehicle")),
        load=main.text("load") if main.has("load") else None,
        reverse=main.flag("reverse", False),
        from_stop=main.text("from") if main.has("from") else None,
        to_stop=main.text("to") if main.has("to") else None,
        departure_ns=_moment(timetable),
        buffer_ratio=buffer_ratio,
        dwell_s=_at_least_zero(timetable, "dwell", "time", 60.0),
        conditions=_conditions(_optional(fields, "truth")),
        adhesive_mass_kg=_adhesive_mass(_optional(fields, "truth")),
        sensors=_sensors(_optional(fields, "sensors")),
        disturbances=_disturbances(fields),
    )


def _beside(path: Path, name: str) -> str:
    """A bundled name as it is; a file's path is taken from the scenario's folder."""
    return str(path.parent / name) if Path(name).suffix else name


def _optional(fields: Fields, key: str) -> Fields:
    return fields.table(key) if fields.has(key) else Fields.of(fields.source, {}, f"{key}.")


def _moment(timetable: Fields) -> int:
    text = timetable.text("departure", "2026-11-21T08:04:00Z")
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        moment = None
    if moment is None or moment.tzinfo is None:
        raise timetable.error("departure", text, "a time with its zone, like 2026-11-21T08:04:00Z")
    return (moment - EPOCH) // timedelta(microseconds=1) * 1000


def _at_least_zero(fields: Fields, name: str, dimension: str, default: float) -> float:
    value = fields.quantity(name, dimension, default)
    if not 0 <= value < np.inf:
        raise fields.error(name, value, "a finite number >= 0")
    return value


def _conditions(truth: Fields) -> Conditions:
    ratios = ("mass", "resistance", "receptivity", "adhesion")
    others = {"head_wind": "speed", "adhesive_mass": "mass"}
    truth.check_keys(truth.quantity_keys({**dict.fromkeys(ratios, "ratio"), **others}))
    try:
        return Conditions(
            mass_ratio=truth.quantity("mass", "ratio", 1.0),
            resistance_ratio=truth.quantity("resistance", "ratio", 1.0),
            receptivity_ratio=truth.quantity("receptivity", "ratio", 1.0),
            adhesion_ratio=truth.quantity("adhesion", "ratio", 1.0),
            head_wind_mps=truth.quantity("head_wind", "speed", 0.0),
        )
    except DasError as error:
        raise DasError(f"{truth.source}: truth: {error}") from None


def _adhesive_mass(truth: Fields) -> float | None:
    mass_kg = truth.quantity("adhesive_mass", "mass", np.inf)
    if not mass_kg > 0:
        raise truth.error("adhesive_mass", mass_kg, "a mass > 0")
    return None if np.isinf(mass_kg) else mass_kg


def _sensors(fields: Fields) -> Sensors:
    fields.check_keys(fields.quantity_keys({"position_noise": "length", "speed_noise": "speed"}))
    return Sensors(
        position_noise_m=_at_least_zero(fields, "position_noise", "length", Sensors.position_noise_m),
        speed_noise_mps=_at_least_zero(fields, "speed_noise", "speed", Sensors.speed_noise_mps),
    )


def _disturbances(fields: Fields) -> tuple[Planned, ...]:
    entries = fields.data.get("disturbances", [])
    if not isinstance(entries, list):
        raise fields.error("disturbances", entries, "a list of [[disturbances]]")
    tables = (Fields.of(fields.source, entry, f"disturbances[{i}].") for i, entry in enumerate(entries))
    return tuple(_planned(table) for table in tables)


def _planned(table: Fields) -> Planned:
    kind = table.text("kind")
    if kind not in _KINDS:
        raise table.error("kind", kind, "one of " + ", ".join(_KINDS))
    made, quantities = _KINDS[kind]
    others = {DepartureDelay: ["stop"], SensorOutage: ["fault"]}.get(made, [])
    table.check_keys(["kind", *others, *table.quantity_keys(quantities)])
    fixed: dict[str, Any] = {}
    if made is DepartureDelay:
        fixed["stop"] = table.text("stop")
    if made is SensorOutage:
        fault = table.text("fault")
        if fault not in list(SensorFault):
            raise table.error("fault", fault, "one of " + ", ".join(SensorFault))
        fixed["fault"] = SensorFault(fault)
    figures = {
        f"{name}_{_SI_SUFFIX[dimension]}": _figure(table, name, dimension) for name, dimension in quantities.items()
    }
    if made is TrainAhead and not figures["told_m"].low > figures["seen_m"].high:
        raise table.error("told_m", figures["told_m"].low, f"more than seen_m = {figures['seen_m'].high:g}")
    if "to_m" in figures and not figures["from_m"].high < figures["to_m"].low:
        raise table.error("to_m", figures["to_m"].low, f"more than from_m = {figures['from_m'].high:g}")
    return Planned(kind=kind, figures=figures, fixed=fixed)


def _figure(table: Fields, name: str, dimension: str) -> Drawn:
    """A quantity, or a range of it: `delay_s = 90` or `delay_s = {min = 30, max = 180}`."""
    key = next((key for key in table.quantity_keys({name: dimension}) if key in table.data), None)
    if key is None or not isinstance(table.data[key], Mapping):
        value = table.quantity(name, dimension, _OPTIONAL.get(name))
        return _checked(table, key or name, Drawn(low=value, high=value), name)
    ends = table.table(key)
    ends.check_keys(["min", "max"])
    unit = key[len(name) + 1 :]
    low, high = (
        to_si(number(table.source, f"{ends.prefix}{end}", ends.data.get(end)), unit, dimension)
        for end in ("min", "max")
    )
    return _checked(table, key, Drawn(low=low, high=high), name)


def _checked(table: Fields, key: str, figure: Drawn, name: str) -> Drawn:
    least = _LEAST.get(name, 0.0)
    if not least <= figure.low <= figure.high < np.inf:
        expected = "a finite number" if np.isinf(least) else f"a finite number >= {least:g} (SI)"
        raise table.error(key, table.data.get(key), f"{expected}, or {{min = …, max = …}} in this order")
    return figure
