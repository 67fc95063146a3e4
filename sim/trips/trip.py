"""A recorded trip: opened, cleaned, and placed on its route as a smooth run; its standstills and its section."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from das.bus.recording import Recording
from das.command_line.files import load_route, load_vehicle
from das.command_line.printing import typed
from das.domain.errors import DasError
from das.domain.files import load
from das.domain.files.vehicles import read_loss_map
from das.domain.route import Route, Stop, section_stops
from das.domain.units import KMH, NS
from das.domain.vehicle import Vehicle
from das.solver.section import Section, build_section
from sim.options import TripOptions
from sim.recording.course import stood_ns
from sim.recording.opening import AttachedFiles
from sim.trips.cleaning import LEAST_KEPT_RATIO, FindingKind, FindingLog, find_gaps, in_order
from sim.trips.matching import AT_PLATFORM_M, WANDER_M, MatchedTrip, match_trip, runs_back, stands
from sim.trips.profile import DrivenRun, to_profile
from sim.trips.record import Reading, Record, read_trip, reading_of

if TYPE_CHECKING:
    from sim.trips.line import Line

SHORTEST_STAND_S: Final = 5.0
"""Shortest stand (s) on the way that is reported: at 1 Hz a shorter one may be a single slow point."""
WHOLE_TRIP_M: Final = 100.0
"""Largest distance (m) of a trip's ends from the stops with which the trip still covers the whole section."""
FASTEST_MPS: Final = 400.0 * KMH
"""Highest speed (m/s) of a trip; a record with a higher speed is rejected."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trip:
    """A trip matched to a route as driven, its smooth run, and the journey and delays of a recording.

    `reversed`: it ran against the route's file. `direction_known` is False if only kilometre posts give its positions,
    because they do not show the direction; coordinates of the route's stops do. `delays` are pairs of a time (ns) and a
    delay (s).
    """

    path: Path
    format: str
    route: Route
    reversed: bool
    start: Stop
    end: Stop
    matched: MatchedTrip
    run: DrivenRun
    direction_known: bool
    journey: Any | None = None
    delays: tuple[tuple[int, float], ...] = ()

    @property
    def whole(self) -> bool:
        """Whether the trip runs from standstill to standstill at the stops."""
        off = (self.run.s_m[0] - self.start.position_m, self.run.s_m[-1] - self.end.position_m)
        ends = self.matched.ends
        standing = ends.starts_standing and ends.ends_standing
        return standing and bool(max(abs(x) for x in off) <= WHOLE_TRIP_M)

    @property
    def stands(self) -> tuple[StandFound, ...]:
        """The standstills of the train in order, timed as for every drive."""
        matched, course, found = self.matched, self.run.course, []
        last, time_ns = len(matched.time_ns) - 1, matched.time_ns
        for stand in stands(matched.standing):
            inside = stand.first > 0 and stand.last < last
            if inside and (time_ns[stand.last] - time_ns[stand.first]) * NS < SHORTEST_STAND_S:
                continue
            s_m = float(matched.s_m[stand.last])
            stop = min(self.route.stops, key=lambda stop: abs(stop.position_m - s_m))
            there = abs(stop.position_m - s_m) <= AT_PLATFORM_M
            _, came_ns, left_ns = stood_ns(s_m, WANDER_M, course, matched)
            found.append(
                StandFound(
                    s_m=s_m,
                    stop=stop.name if there else None,
                    off_m=s_m - stop.position_m if there else None,
                    arrival_ns=came_ns or int(time_ns[stand.first]) if stand.first > 0 else None,
                    departure_ns=left_ns or int(time_ns[stand.last]) if stand.last < last else None,
                )
            )
        return tuple(found)

    @property
    def ran_ns(self) -> tuple[int, int]:
        """The span of time of the trip (ns since 1970): from stand to stand if it stands at both its stops."""
        first_ns, last_ns = (int(self.run.course.time_ns[i]) for i in (0, -1))
        if not self.whole:
            return first_ns, last_ns
        return self.stands[0].departure_ns or first_ns, self.stands[-1].arrival_ns or last_ns

    @property
    def stops_on_the_way(self) -> tuple[str, ...]:
        """Stops of the route at which the train stood between the first and the last stop."""
        ends = (self.start.name, self.end.name)
        return tuple(s.stop for s in self.stands if s.dwell_s is not None and s.stop is not None and s.stop not in ends)

    @property
    def better_stops(self) -> str:
        """Options for the stops at which the trip starts and ends, if other stops were chosen; else empty."""
        stands = self.stands
        first = next((s.stop for s in stands if s.arrival_ns is None), None)
        last = next((s.stop for s in stands if s.departure_ns is None), None)
        options = [("--from", first, self.start), ("--to", last, self.end)]
        return " ".join(f"{name} {shlex.quote(stop)}" for name, stop, is_ in options if stop and stop != is_.name)


def load_trip(path: Path, reading: Reading, route: Route, said: TripOptions) -> Trip:
    """Clean a trip and place it on a route, which is given as in its file.

    A GPS record needs kilometre posts or a route with geometry, unless it has positions on the route. A trip that runs
    against the stated direction is reversed if no stops are named. Raises DasError or InputError for anything unusable.
    """
    log = FindingLog(read=len(reading.record))
    record = in_order(reading.record, log)
    driven, reverse, line = _direction(record, route, said, log)
    start, end = section_stops(driven, said.from_stop, said.to_stop)
    recorded = reading.journey is not None
    if recorded:
        _check_recorded(record, start, end)
    record = record.driven(reverse, route.length_m)
    matched = match_trip(record, line, driven, (start, end), log, whole_stands=recorded)
    run = to_profile(matched)
    if run.speed_mps.max() > FASTEST_MPS:
        top_kmh = run.speed_mps.max() / KMH
        raise DasError(f"{path}: the positions lead to {top_kmh:.0f} km/h, faster than trains run: times are wrong")
    _check_seen(path, matched)
    return Trip(
        path=path,
        format=reading.format,
        route=driven,
        reversed=reverse,
        start=start,
        end=end,
        matched=matched,
        run=run,
        direction_known=line is None or line.on_route or (said.direction_said and reverse == bool(said.reverse)),
        journey=reading.journey,
        delays=reading.delays,
    )


def _check_seen(path: Path, matched: MatchedTrip) -> None:
    """Raise DasError for a trip that is mostly gaps: the rest would be invented."""
    time_s = matched.elapsed_s()[~matched.invalid]
    unseen_s = float(np.diff(time_s)[find_gaps(time_s)].sum())
    if unseen_s > LEAST_KEPT_RATIO * time_s[-1]:
        raise DasError(
            f"{path}: no points in {unseen_s:.0f} s of the trip's {time_s[-1]:.0f} s, expected less than half"
        )


def _check_recorded(record: Record, start: Stop, end: Stop) -> None:
    """Raise DasError for a recorded trip that goes beyond the section: its timetable does not fit the section."""
    s_m = record.position_m[np.isfinite(record.position_m)]
    if not len(s_m):
        return
    before, after = start.position_m - s_m[0], s_m[-1] - end.position_m
    for beyond, what in (
        (before, f"starts {before:.0f} m before {start.name}"),
        (after, f"ends {after:.0f} m beyond {end.name}"),
    ):
        if beyond > AT_PLATFORM_M:
            raise DasError(f"{record.source}: the trip {what}, more than {AT_PLATFORM_M:.0f} m outside the section")


def _direction(record: Record, route: Route, said: TripOptions, log: FindingLog) -> tuple[Route, bool, Line | None]:
    """The route as driven, whether it is reversed, and the line (None if the record has route positions)."""
    reverse = bool(said.reverse)
    driven = route.reversed() if reverse else route
    line = _line(record, driven, said.posts)
    if record.as_driven or not runs_back(record.driven(reverse, route.length_m), line):
        return driven, reverse, line
    other = route if reverse else route.reversed()
    right = "leave out --reverse" if said.reverse else "give --reverse"
    posts = f", or turn the list {said.posts} round" if line is not None and not line.on_route else ""
    _check_turn(record, said, line, right, posts)
    log.add(FindingKind.OTHER_WAY, record, [0], f"{other.stops[0].name} to {other.stops[-1].name}: {right}{posts}")
    if line is not None:
        line = _line(record, other, said.posts) if line.on_route else line.turned()
    return other, not reverse, line


def _check_turn(record: Record, said: TripOptions, line: Line | None, right: str, posts: str) -> None:
    """Raise DasError, with what is right in words, for a trip that runs against the given direction or named stops."""
    along = f" along {line.source}" if line is not None else ""
    if said.from_stop is None and said.to_stop is None:
        if said.reverse is None:
            return
        order = "--reverse" if said.reverse else "--no-reverse"
        raise DasError(f"{record.source}: {order}: the trip runs the other way{along}: {right}{posts}")
    named = " and ".join(f"--{name}" for name, stop in (("from", said.from_stop), ("to", said.to_stop)) if stop)
    raise DasError(f"{record.source}: the trip runs the other way{along}: {right}, and change {named}")


def _line(record: Record, driven: Route, posts: Path | None) -> Line | None:
    if record.on_route:
        if posts is not None:
            raise DasError(f"--posts {posts}: not needed, {record.source} has positions on the route")
        return None
    from sim.trips.line import Line, read_kilometre_posts

    return read_kilometre_posts(posts).placed(driven) if posts is not None else Line.from_route(driven)


@dataclass(frozen=True, kw_only=True)
class StandFound:
    """A standstill: its position, the stop of the route there (None if there is none), its beginning and end.

    `off_m` is the distance of the train beyond the stop. A time is None if the record begins or ends with the stand.
    """

    s_m: float
    stop: str | None
    off_m: float | None
    arrival_ns: int | None
    departure_ns: int | None

    @property
    def dwell_s(self) -> float | None:
        """Duration of the stand; None if the record begins or ends with it."""
        if self.arrival_ns is None or self.departure_ns is None:
            return None
        return (self.departure_ns - self.arrival_ns) * NS


def open_trip(trip_path: Path, options: TripOptions, folder: Path) -> tuple[TripOptions, Trip]:
    """Read, clean and match a trip; returns the options completed from the recording, and the trip.

    Files that are attached to a recording are put into `folder`. Raises DasError for anything unusable.
    """
    reading = read_trip(trip_path, options.of_train)
    options = _completed(reading, options, folder)
    if options.route is None:
        raise DasError(f"{trip_path}: a trip without a journey needs --route")
    trip = load_trip(trip_path, reading, load_route(options.route), options)
    return replace(options, reverse=trip.reversed), trip


def recorded_trip(recording: Recording, driven: Route) -> Trip:
    """The trip of a recording on its line as driven; DasError for positions that cannot be used."""
    reading = reading_of(recording)
    start, end = reading.ends or (None, None)
    return load_trip(recording.path, reading, driven, TripOptions(reverse=False, from_stop=start, to_stop=end))


def _completed(reading: Reading, options: TripOptions, folder: Path) -> TripOptions:
    """Fill in route, vehicle, direction and stops from the recording's journey if they were not given."""
    journey, recording, ends = reading.journey, reading.recording, reading.ends
    if journey is None or recording is None or ends is None:
        return options
    if options.reverse is not None:
        raise DasError("--reverse: the recording states its direction")
    files = AttachedFiles(recording, folder)
    route = options.route
    if route is None:
        route = files.find("routes", journey.route_id, load.load_route)[1]
    vehicle = options.vehicle
    if vehicle is None:
        vehicle = files.find("vehicles", journey.vehicle_id, load.load_vehicle)[1]
    start, end = ends if load_route(route).id == journey.route_id else (None, None)
    return replace(
        options,
        route=route,
        vehicle=vehicle,
        reverse=journey.reversed,
        from_stop=start if options.from_stop is None else options.from_stop,
        to_stop=end if options.to_stop is None else options.to_stop,
    )


def trip_section(trip: Trip, options: TripOptions) -> Section:
    """The section of a trip with the chosen vehicle; raises DasError if none is chosen or it cannot run there."""
    if options.vehicle is None:
        find = f"das-sim trip {shlex.quote(str(trip.path))} --route {shlex.quote(str(options.route))}"
        find += f" --posts {shlex.quote(str(options.posts))}" if options.posts is not None else ""
        find += " --reverse" if options.reverse else ""
        raise DasError(
            f"{trip.path}: a trip without a journey needs --vehicle; to find trains that can have driven it, use "
            f"{typed(find)} --vehicles all"
        )
    vehicle = load_vehicle(options.vehicle)
    if options.loss_map is not None:
        vehicle = vehicle.with_loss_map(read_loss_map(options.loss_map))
    return section_with(trip, vehicle, options)


def section_with(trip: Trip, vehicle: Vehicle, options: TripOptions) -> Section:
    """The section of a trip with a vehicle; DasError if it cannot run there."""
    return build_section(
        trip.route,
        vehicle,
        level=options.level,
        start_m=trip.start.position_m,
        end_m=trip.end.position_m,
    )
