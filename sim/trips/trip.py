"""A trip to replay or to look at: read, cleaned, and put on its route in its direction, with its smooth run."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Route, Stop, section_stops
from das.domain.units import KMH
from sim.trips.cleaning import find_gaps, in_order
from sim.trips.findings import FindingKind, FindingLog
from sim.trips.line import Line, read_kilometre_posts
from sim.trips.matching import MatchedTrip, match_trip
from sim.trips.points import runs_back
from sim.trips.profile import DrivenRun, to_profile
from sim.trips.reading import Reading
from sim.trips.record import Record
from sim.trips.schedule import StandFound, stands_found
from sim.trips.settings import PLACING, POSITIONS, STANDS


@dataclass(frozen=True, kw_only=True, eq=False)
class Trip:
    """A trip matched to a route as driven, its smooth run, and what a recording says besides.

    `reversed` says that it ran against the route's file. `direction_known` is False where only kilometre posts tell
    where it was, because they do not tell the direction. `line_not_used` are the posts of a trip that has positions on
    the route.
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
    line_not_used: Path | None = None
    journey: Any | None = None
    delays: tuple[tuple[int, float], ...] = ()

    @property
    def whole(self) -> bool:
        """Whether the trip runs from standstill to standstill at the stops."""
        off = (self.run.s_m[0] - self.start.position_m, self.run.s_m[-1] - self.end.position_m)
        ends = self.matched.ends
        standing = ends.starts_standing and ends.ends_standing
        return standing and bool(max(abs(x) for x in off) <= PLACING.whole_trip_m)

    @property
    def stands(self) -> tuple[StandFound, ...]:
        """Where the train stood, in order."""
        return stands_found(self.matched, self.route, self.run.speed_lag_s)

    @property
    def stops_on_the_way(self) -> tuple[str, ...]:
        """Stops of the route at which the train stood between the first and the last stop."""
        ends = (self.start.name, self.end.name)
        return tuple(s.stop for s in self.stands if s.dwell_s is not None and s.stop is not None and s.stop not in ends)

    @property
    def better_stops(self) -> str:
        """Options that name the stops at which the trip starts and ends, if those are others; else empty."""
        stands = self.stands
        first = next((s.stop for s in stands if s.arrival_ns is None), None)
        last = next((s.stop for s in stands if s.departure_ns is None), None)
        options = [("--from", first, self.start), ("--to", last, self.end)]
        return " ".join(f"{name} {shlex.quote(stop)}" for name, stop, is_ in options if stop and stop != is_.name)


@dataclass(frozen=True, kw_only=True)
class Whereabouts:
    """What the user says about where a trip was driven.

    `reverse` None: nothing is said about the direction. Stops None: the route's first and last. `line` are kilometre
    posts. `strict` refuses a trip of which points would be dropped, or that runs the other way.
    """

    reverse: bool | None = None
    from_stop: str | None = None
    to_stop: str | None = None
    line: Path | None = None
    strict: bool = False

    @property
    def direction_said(self) -> bool:
        """Whether the user said the direction."""
        return self.reverse is not None or None not in (self.from_stop, self.to_stop)


def load_trip(path: Path, reading: Reading, route: Route, said: Whereabouts) -> Trip:
    """Clean a trip and put it on a route, which is given as in its file.

    A GPS record needs kilometre posts or a route with geometry, unless it has positions on the route. A trip that runs
    the other way than `said` is driven the other way if no stops are named. Raises DasError or InputError for anything
    unusable.
    """
    log = FindingLog(strict=said.strict, read=len(reading.record))
    record = in_order(reading.record, log)
    driven, reverse, line = _direction(record, route, said, log)
    start, end = section_stops(driven, said.from_stop, said.to_stop)
    recorded = reading.journey is not None
    if recorded:
        _check_recorded(record, start, end)
    record = record.driven(reverse, route.length_m)
    matched = match_trip(record, line, driven, (start, end), log, whole_stands=recorded)
    run = to_profile(matched)
    if run.speed_mps.max() > PLACING.fastest_mps:
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
        line_not_used=said.line if line is None else None,
        journey=reading.journey,
        delays=reading.delays,
    )


def _check_seen(path: Path, matched: MatchedTrip) -> None:
    """Raise DasError for a trip that is mostly gaps: the rest would be invented."""
    time_s = matched.elapsed_s()[~matched.invalid]
    unseen_s = float(np.diff(time_s)[find_gaps(time_s)].sum())
    if unseen_s > POSITIONS.least_kept_ratio * time_s[-1]:
        raise DasError(
            f"{path}: no points in {unseen_s:.0f} s of the trip's {time_s[-1]:.0f} s, expected less than half"
        )


def _check_recorded(record: Record, start: Stop, end: Stop) -> None:
    """Raise DasError for a recording with a journey outside the section: its timetable would not be the section's."""
    s_m = record.position_m[np.isfinite(record.position_m)]
    if not len(s_m):
        return
    before, after = start.position_m - s_m[0], s_m[-1] - end.position_m
    for beyond, what in (
        (before, f"starts {before:.0f} m before {start.name}"),
        (after, f"ends {after:.0f} m beyond {end.name}"),
    ):
        if beyond > STANDS.at_stop_m:
            raise DasError(f"{record.source}: the trip {what}, more than {STANDS.at_stop_m:.0f} m outside the section")


def _direction(record: Record, route: Route, said: Whereabouts, log: FindingLog) -> tuple[Route, bool, Line | None]:
    """The route as driven, whether that is against its file, and the line; None if the record's positions count."""
    ways, reverse = (route, route.reversed()), bool(said.reverse)
    line = _line(record, ways[reverse], said.line)
    if record.as_driven or not runs_back(record.driven(reverse, route.length_m), line):
        return ways[reverse], reverse, line
    _check_turn(record, said, line)
    other = ways[not reverse]
    right = "leave out --reverse" if said.reverse else "give --reverse"
    posts = f", or turn the list {said.line} round" if line is not None and not line.on_route else ""
    log.add(FindingKind.OTHER_WAY, record, [0], f"{other.stops[0].name} to {other.stops[-1].name}: {right}{posts}")
    if line is not None:
        line = Line.from_route(other) if line.on_route else line.turned()
    return other, not reverse, line


def _check_turn(record: Record, said: Whereabouts, line: Line | None) -> None:
    """Raise DasError for a trip with named stops that runs the other way: the stops say which way it should run."""
    if said.from_stop is None and said.to_stop is None:
        return
    right = "leave out --reverse" if said.reverse else "give --reverse"
    named = " and ".join(f"--{name}" for name, stop in (("from", said.from_stop), ("to", said.to_stop)) if stop)
    along = f" along {line.source}" if line is not None else ""
    raise DasError(f"{record.source}: the trip runs the other way{along}: {right}, and change {named}")


def _line(record: Record, driven: Route, posts: Path | None) -> Line | None:
    if record.on_route:
        return None
    return read_kilometre_posts(posts) if posts is not None else Line.from_route(driven)
