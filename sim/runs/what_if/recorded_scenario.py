"""The scenario of a recorded day: the attached one, or one made from what was heard on a drive without a simulator."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from das.domain.files.load import catalogue
from das.domain.restriction import Restriction
from das.domain.units import NS
from das.node.options import NodeOptions
from sim.drive.calls import KeptCall, calls_of
from sim.drive.limits import told_lists
from sim.recording.course import DrivenCourse
from sim.recording.inputs import put, sha256, vehicle_files
from sim.runs.reproduce.inputs import node_given
from sim.runs.what_if.origin import Origin
from sim.world.drawn import Truth
from sim.world.scenario import LONGEST_DWELL_S, SCHEMA_VERSION, Scenario, read_scenario

LEAST_DELAY_S: Final = 1.0
"""A departure that was late by less than this (s) was in time."""
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


def attached_scenario(origin: Origin) -> Scenario:
    """The scenario of a simulated day, with the input files that the recording brings along.

    Raises DasError where the scenario, or a file that it needs, is not attached.
    """
    files, path = origin.files, origin.path
    if not files.has("scenario"):
        raise DasError(f"{path}: does not bring its scenario along, so that its day cannot be had again")
    scenario = read_scenario(files.place("scenario"))
    return replace(
        scenario,
        route=_file(origin, "route", scenario.route),
        vehicle=_vehicle(origin, "", scenario.vehicle),
        loss_map=None if scenario.loss_map is None else _attached(origin, "loss_map"),
        truth=_truth(origin, scenario.truth),
    )


def _truth(origin: Origin, truth: Truth) -> Truth:
    if truth.vehicle is not None:
        truth = replace(truth, vehicle=_vehicle(origin, "true_", truth.vehicle))
    if truth.loss_map is not None:
        truth = replace(truth, loss_map=_attached(origin, "true_loss_map"))
    return truth


def _file(origin: Origin, kind: str, name: str) -> str:
    """A route by its name, where today's bundled one is that of the recording; else the attached file."""
    bundled = catalogue("routes").get(name)
    if bundled is not None and sha256(bundled) == origin.files.sha256(kind):
        return name
    return str(_attached(origin, kind))


def _vehicle(origin: Origin, prefix: str, name: str) -> str:
    """The same of a vehicle, whose loss map counts as well."""
    files = origin.files
    if name in catalogue("vehicles") and all(
        sha256(path) == files.sha256(f"{prefix}{kind}") for kind, path in vehicle_files(name).items()
    ):
        return name
    _attached(origin, f"{prefix}vehicle")
    return str(files.place_vehicle(f"{prefix}vehicle", f"{prefix}loss_map"))


def _attached(origin: Origin, kind: str) -> Path:
    if not origin.files.has(kind):
        raise DasError(f"{origin.path}: does not bring its {kind.replace('_', ' ')} along")
    return origin.files.place(kind)


def scenario_of_drive(origin: Origin, node: str | None) -> Scenario:
    """A scenario made from a drive without a simulator: line, train, stops, late departures and restrictions.

    `node` says what the recording's node was started with, where the recording does not. What held the train up
    between stops nobody recorded, nor resistance, wind and rail. Raises DasError where line or train are not known.
    """
    given = node_given(origin.contents, origin.train, origin.folder, node)
    options = given.options()
    text = "\n".join(_lines(origin, options))
    path = put(origin.folder / "scenario" / f"{_id(origin)}.toml", text.encode())
    scenario = read_scenario(path)
    driven = options.driven
    return replace(scenario, route=options.line.route, vehicle=driven.vehicle, loss_map=driven.loss_map)


def _id(origin: Origin) -> str:
    kept = "".join(one if one.isalnum() or one in "._-" else "-" for one in origin.path.stem)
    return f"day-of-{kept}"[:64]


def _lines(origin: Origin, options: NodeOptions) -> Iterator[str]:
    """The lines of the scenario file."""
    journey, line, driven = origin.journey, options.line, options.driven
    load = driven.load or journey.vehicle_id.partition("/")[2] or journey.load
    stops = journey.stops
    departure = EPOCH + timedelta(microseconds=stops[0].departure_ns // 1000)
    yield "# Made from a recording by das-sim what-if. Its timetable is that of the recorded journey."
    yield f"schema_version = {SCHEMA_VERSION}"
    yield "[scenario]"
    yield f"id = {_quoted(_id(origin))}"
    yield f"title = {_quoted(f'The day of {origin.path.name}, driven anew')}"
    yield f"route = {_quoted(_bare(line.route))}"
    yield f"vehicle = {_quoted(_bare(driven.vehicle))}"
    yield from [f"load = {_quoted(load)}"] if load else []
    yield from [f"loss_map = {_quoted(driven.loss_map.name)}"] if driven.loss_map else []
    yield from ["point_mass = true"] if driven.point_mass else []
    yield f"reverse = {'true' if journey.reversed else 'false'}"
    yield f"from = {_quoted(stops[0].name)}"
    yield f"to = {_quoted(stops[-1].name)}"
    yield f"calls = [{', '.join(_quoted(stop.name) for stop in stops[1:-1])}]"
    yield "[timetable]"
    yield f"departure = {_quoted(departure.isoformat())}"
    yield f"dwell_s = {_dwell_s(stops):g}"
    trip = DrivenCourse.of(origin.recording)
    made, dwell_s = calls_of(origin.recording, trip), _dwell_s(stops)
    for index, call in enumerate(made[:-1]):
        yield from _delay(call, dwell_s if index else 0.0)
    yield from _restrictions(origin, trip)


def _bare(name: str) -> str:
    """A name as it is, or the bare name of a file."""
    return Path(name).name if Path(name).suffix else name


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _dwell_s(stops: Any) -> float:
    """The shortest time at a stop on the way (s), by the timetable."""
    dwells = [(stop.departure_ns - stop.arrival_ns) * NS for stop in stops[1:-1]]
    return max(min(dwells, default=0.0), 0.0)


def _delay(call: KeptCall, dwell_s: float) -> Iterator[str]:
    """By how much a departure was held up: later than the timetable and the dwell after the arrival allow."""
    if not call.departed_ns or not call.due_departure_ns:
        return
    ready_ns = max(call.due_departure_ns, call.arrived_ns + round(dwell_s / NS) if call.arrived_ns else 0)
    delay_s = (call.departed_ns - ready_ns) * NS
    if delay_s >= LEAST_DELAY_S:
        yield "[[disturbances]]"
        yield 'kind = "departure-delay"'
        yield f"stop = {_quoted(call.name)}"
        yield f"delay_s = {delay_s:.1f}"


def _restrictions(origin: Origin, trip: DrivenCourse) -> Iterator[str]:
    """Each restriction that was told, from where the train was when it was first told."""
    first_m, last_m = origin.journey.stops[0].s_m, origin.journey.stops[-1].s_m
    known: set[Restriction] = set()
    for time_ns, told in told_lists(origin.recording):
        told_m = float(trip.at(np.array([time_ns]), trip.s_m)[0])
        for whole in told:
            start_m = max(whole.start_m, first_m)
            if not start_m < min(whole.end_m, last_m) or whole.limit_mps < 1.0:
                continue
            one, window = replace(whole, start_m=start_m), _window(whole, origin.journey.stops[0].departure_ns)
            if one in known or window is None:
                continue
            known.add(one)
            yield "[[disturbances]]"
            yield 'kind = "restriction"'
            yield f"from_m = {start_m!r}"
            yield f"to_m = {one.end_m!r}"
            yield f"speed_mps = {one.limit_mps!r}"
            yield f"announced_m = {max(start_m - told_m, 0.0) + 1.0:.1f}"
            yield from window


def _window(one: Restriction, departure_ns: int) -> list[str] | None:
    """The lines of a restriction's window on the run's clock; None where it does not hold on the day of the drive."""
    from_s, until_s = (round((at_ns - departure_ns) * NS, 9) for at_ns in (one.valid_from_ns, one.valid_until_ns))
    if (one.valid_from_ns and from_s > LONGEST_DWELL_S) or (one.valid_until_ns and until_s <= 0):
        return None
    ends = [f"valid_from_s = {from_s!r}"] if one.valid_from_ns and from_s > 0 else []
    return [*ends, f"valid_until_s = {until_s!r}"] if 0 < until_s <= LONGEST_DWELL_S else ends
