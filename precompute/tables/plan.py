"""The plan of a build: from a TOML file to its jobs (format: docs/reference/tables.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from typing import Any, TypeVar

from das.domain.braking import USUAL, SiteBraking
from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.load import catalogue, load_journey, load_route, load_vehicle
from das.domain.files.reading import Fields, number, read_toml
from das.domain.files.vehicles import read_loss_map, site_braking
from das.domain.levels import Level
from das.domain.route import Route, Stop
from das.domain.vehicle import Vehicle
from precompute.tables.writing import Job, TableSettings

SCHEMA_VERSION = 1
MOST_BUFFERS = 1000
LARGEST_BUFFER_PERCENT = 1000.0
_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True)
class BuildPlan:
    """The jobs of a build: every section of every line with every train, each once."""

    source: Path
    jobs: tuple[Job, ...]


_Line = tuple[Route, tuple[Stop, ...]]
"""A route in one direction, with the stops that bound its sections."""


def read_plan(path: Path, *, refined: bool = True) -> BuildPlan:
    """Read a plan and all files it names; raises DasError or InputError (file, key, value, expectation).

    `refined`: the front of each section is refined.
    """
    fields = read_toml(path)
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(["schema_version", "routes", "trains", "tables", "braking"])
    lines = [line for entry in _entries(fields, "routes") for line in _lines(entry)]
    if not lines:
        raise fields.error("routes", MISSING, "at least one [[routes]]")
    trains = [train for entry in _entries(fields, "trains") for train in _trains(entry)]
    if not trains:
        raise fields.error("trains", MISSING, "at least one [[trains]]")
    settings = _settings(fields.optional_table("tables"), refined)
    site = _braking(fields)
    jobs: dict[str, Job] = {}
    for (route, stops), (train, level) in product(lines, trains):
        for start, end in pairwise(stops):
            job = Job(
                route=route,
                vehicle=train,
                level=level,
                start_m=start.position_m,
                end_m=end.position_m,
                braking=None if site is None else site.of(train),
                settings=settings,
            )
            if job.name in jobs:
                raise InputError(path, "routes or trains", job.name, "every section and train once")
            jobs[job.name] = job
    return BuildPlan(source=path, jobs=tuple(jobs.values()))


def _braking(fields: Fields) -> SiteBraking | None:
    """The braking of the drivers who use the tables; None if they use the train's full brakes, as in a study."""
    if not fields.has("braking"):
        return USUAL
    table = fields.table("braking")
    if not table.flag("full", False):
        return site_braking(Fields.of(table.source, {k: v for k, v in table.data.items() if k != "full"}, table.prefix))
    table.check_keys(["full"])
    return None


def _entries(fields: Fields, key: str) -> Iterator[Fields]:
    entries = fields.data.get(key, [])
    if not isinstance(entries, list):
        raise fields.error(key, entries, f"[[{key}]] tables")
    for i, entry in enumerate(entries):
        yield Fields.of(fields.source, entry, f"{key}[{i}].")


def _lines(fields: Fields) -> list[_Line]:
    fields.check_keys(["route", "reverse", "stops", "journey"])
    route = _loaded(fields, "route", "routes", load_route)
    reverse = fields.data.get("reverse", False)
    if not isinstance(reverse, bool) and reverse != "both":
        raise fields.error("reverse", reverse, 'true, false or "both"')
    if fields.has("journey"):
        return [_journey_line(fields, route.reversed() if reverse else route)]
    stops = _stops(fields, route)
    ways = {False: (False,), True: (True,), "both": (False, True)}[reverse]
    return [_reversed(route, stops) if backwards else (route, stops) for backwards in ways]


def _journey_line(fields: Fields, route: Route) -> _Line:
    """The line between the stops of a journey, which runs in one direction."""
    for key in ("stops",) if fields.data.get("reverse") != "both" else ("reverse",):
        if fields.has(key):
            raise fields.error(key, fields.data[key], "no such key with journey, which has its own stops and direction")
    journey = _loaded(fields, "journey", "journeys", lambda name: load_journey(name, route))
    return route, tuple(Stop(name=call.name, position_m=call.position_m) for call in journey.calls)


def _stops(fields: Fields, route: Route) -> tuple[Stop, ...]:
    """The stops that a plan names, in the order of the route; all stops if it names none."""
    names = _texts(fields, "stops")
    if not names:
        return route.stops
    stops = tuple(_in_plan(fields, "stops", name, route.stop) for name in names)
    for before, after in pairwise(stops):
        if after.position_m <= before.position_m:
            raise fields.error("stops", after.name, f"a stop after {before.name!r} (the order of the route's file)")
    if len(stops) < 2:
        raise fields.error("stops", names, "at least two stops")
    return stops


def _reversed(route: Route, stops: tuple[Stop, ...]) -> _Line:
    back = route.reversed()
    return back, tuple(back.stops[-1 - route.stops.index(stop)] for stop in reversed(stops))


def _trains(fields: Fields) -> list[tuple[Vehicle, Level]]:
    fields.check_keys(["vehicle", "loads", "levels", "loss_map"])
    vehicle = _loaded(fields, "vehicle", "vehicles", load_vehicle)
    if fields.has("loss_map"):
        name = fields.text("loss_map")
        loss_map = _in_plan(fields, "loss_map", name, lambda text: read_loss_map(fields.source.parent / text))
        vehicle = vehicle.with_loss_map(loss_map)
    loads = _texts(fields, "loads")
    loaded = [_in_plan(fields, "loads", name, vehicle.loaded) for name in loads] if loads else [vehicle]
    for name in _texts(fields, "levels"):
        if name not in list(Level):
            raise fields.error("levels", name, "one of " + ", ".join(Level))
    levels = [Level(name) for name in _texts(fields, "levels")] or [vehicle.default_level]
    for level in levels:
        _in_plan(fields, "levels", level, vehicle.loss_model)
    return list(product(loaded, levels))


def _settings(fields: Fields, refined: bool) -> TableSettings:
    fields.check_keys(["buffers_percent", "max", "proven"])
    default = TableSettings()
    return TableSettings(
        buffers_percent=_buffers(fields) if fields.has("buffers_percent") else default.buffers_percent,
        with_max=fields.flag("max", default.with_max),
        refined=refined,
        proven=fields.whole("proven", (0, MOST_BUFFERS), default.proven),
    )


def _buffers(fields: Fields) -> tuple[float, ...]:
    """The buffers (%), which the plan gives as a list, or by the keys `from`, `to` and `step`."""
    given = fields.data["buffers_percent"]
    if isinstance(given, list):
        buffers = [number(fields.source, f"{fields.prefix}buffers_percent[{i}]", x) for i, x in enumerate(given)]
    else:
        table = fields.table("buffers_percent")
        table.check_keys(["from", "to", "step"])
        first, last, step = (
            number(table.source, table.prefix + key, table.data.get(key, MISSING)) for key in ("from", "to", "step")
        )
        if not step > 0:
            raise table.error("step", step, "a number > 0")
        if not 0 <= (last - first) / step < MOST_BUFFERS:
            raise table.error("to", last, f"a number >= from that gives at most {MOST_BUFFERS} buffers")
        buffers = [round(first + step * i, 9) for i in range(int((last - first) / step + 1e-9) + 1)]
    rising = all(a < b for a, b in pairwise(buffers))
    if not buffers or not rising or not buffers[0] >= 0 or not buffers[-1] <= LARGEST_BUFFER_PERCENT:
        raise fields.error("buffers_percent", given, f"rising numbers from 0 to {LARGEST_BUFFER_PERCENT:g}")
    if len(buffers) > MOST_BUFFERS:
        raise fields.error("buffers_percent", f"{len(buffers)} numbers", f"at most {MOST_BUFFERS}")
    return tuple(buffers)


def _texts(fields: Fields, key: str) -> list[str]:
    value = fields.data.get(key, [])
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value) or len(set(value)) < len(value):
        raise fields.error(key, value, "a list of distinct texts")
    return list(value)


def _loaded(fields: Fields, key: str, kind: str, load: Callable[[str], _T]) -> _T:
    """Load a file of a kind: bundled, by its name, or by a path relative to the folder of the plan."""
    name, beside = fields.text(key), fields.source.parent
    return _in_plan(fields, key, name, lambda text: load(text if text in catalogue(kind) else str(beside / text)))


def _in_plan(fields: Fields, key: str, value: str, read: Callable[[Any], _T]) -> _T:
    """The result of `read` for a value; a DasError is raised again, preceded by the place in the plan."""
    try:
        return read(value)
    except DasError as error:
        raise DasError(f"{fields.source}: {fields.prefix}{key} = {str(value)!r}: {error}") from error
