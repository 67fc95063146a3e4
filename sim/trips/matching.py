"""A record on the route: points that fit together as one train's motion, its standstills, and the cut to its section.

Positions never decrease, and speeds have no dropouts.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Floats, Route, Stop
from das.domain.units import KMH, NS
from sim.recording.course import DrivenCourse, stretches_of
from sim.trips import cleaning
from sim.trips.cleaning import (
    JUMP_M,
    LEAST_KEPT_RATIO,
    LOST_S,
    MAX_BACKWARD_M,
    MAX_CROSS_TRACK_M,
    SCALE_TOLERANCE_RATIO,
    STALL_HALF_WINDOW_S,
    WRONG_SPEED_MPS,
    CleaningReport,
    FindingKind,
    FindingLog,
)
from sim.trips.record import Bools, Ints, Record

if TYPE_CHECKING:
    from sim.trips.line import Line

RECORD_STANDS_MPS: Final = 1.0 * KMH
"""Reported speed (m/s) below which a train counts as standing if its positions do not move."""
WANDER_M: Final = 30.0
"""Largest wander (m) of the positions of a standing train, equal to `MAX_BACKWARD_M`."""
AT_PLATFORM_M: Final = 300.0
"""Largest distance (m) from a stop at which a train stands at the stop: platforms are long, and maps inexact."""
LEAST_MOVED_M: Final = 30.0
"""Extent (m) that the positions of a trip must exceed: noise alone may spread them over so many metres."""
LONGEST_GAP_S: Final = 300.0
"""Longest gap (s); a longer one splits the record if the train moved in it or next to it. The largest part is kept."""
STANDING_BY_POSITIONS_MPS: Final = 0.5
"""Speed (m/s) from positions, below which a train stands if no speed is reported: positions wander by metres."""
LED_WINDOW_S: Final = 12.0
"""Time (s) at an end of a record in which positions are checked for slowing to a stand."""
LED_POINTS: Final = 4
"""Least number of positions within `LED_WINDOW_S` at an end of a record that show a stand."""
LED_SPEED_MPS: Final = 2.0
"""Largest speed (m/s) at an end of a record whose positions show a stand."""
LED_CHANGE_MPS2: Final = 0.1
"""Least slowing (m/s²) of positions at an end of a record that show a stand: noise gives less."""
GENTLE_MPS2: Final = 0.3
"""Gentlest stop or start (m/s²) of a train, so that v²/2a and v/a bound the rest of its motion."""
ONE_WAY_RATIO: Final = 0.5
"""Least distance of the ends of a trip in one direction, as a share of its whole extent."""
STAND_KEPT_S: Final = 30.0
"""Time (s) of a stand at the start or the end that is kept."""
TOLD_M: Final = 0.01
"""Least move (m) of a position that is reported."""

SAME_TIME_S = 1e-6
"""Difference (s) below which times count as equal."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """Points of a record that are kept, arrays of shape (points,); `point` is the index in the record.

    `along_m` is the chainage, later the position on the route; `aside_m` is the distance from the line, NaN if the
    position was computed from speeds. `missing`, `dropout` and `spike` mark the reason why a speed is not the reported
    one. `slowed_to_mps` is the speed from positions at an end of the record at which only positions show that the train
    stands; elsewhere it is NaN.
    """

    point: Ints
    time_s: Floats
    along_m: Floats
    aside_m: Floats
    speed_mps: Floats
    missing: Bools
    dropout: Bools
    spike: Bools
    standing: Bools
    slowed_to_mps: Floats

    def __len__(self) -> int:
        return len(self.point)

    @property
    def speed_derived(self) -> Bools:
        """Mask of the speeds that come from the positions."""
        return self.missing | self.dropout | self.spike

    def take(self, which: Any) -> Self:
        """Some of the points, by mask, slice or indices."""
        return replace(self, **{f.name: getattr(self, f.name)[which] for f in fields(self)})


def _place(record: Record, line: Line | None) -> tuple[Floats, Floats]:
    """Chainage along a line (m) and distance from it (m); without a line, the record's positions. NaN where unknown."""
    if line is None:
        return record.position_m, np.where(np.isfinite(record.position_m), 0.0, np.nan)
    known = np.isfinite(record.latitude_deg) & np.isfinite(record.longitude_deg)
    along, aside = np.full(len(record), np.nan), np.full(len(record), np.nan)
    if known.any():
        along[known], aside[known] = line.match(record.latitude_deg[known], record.longitude_deg[known])
    return along, aside


def runs_back(record: Record, line: Line | None) -> bool:
    """Whether a record (in order of time) runs against the line or, without a line, towards lower positions.

    The direction follows from the medians of the first and the last tenth of its points on the line. They must lie well
    apart, because a return trip has no direction.
    """
    along, aside = _place(record, line)
    along = along[aside <= MAX_CROSS_TRACK_M]
    if not len(along):
        return False
    tenth = max(len(along) // 10, 1)
    back = float(np.median(along[:tenth]) - np.median(along[-tenth:]))
    return back > max(LEAST_MOVED_M, ONE_WAY_RATIO * float(np.ptp(along)))


def fitting_points(record: Record, line: Line | None, section_m: float, log: FindingLog) -> Points:
    """The consistent points of a record that are on the line, with speeds that fit them.

    Every dropped point is logged. Wrong speeds are only marked here; those on the section are logged later. Raises
    DasError if most points do not fit.
    """
    along, aside = _place(record, line)
    located = np.isfinite(aside)
    points = _all_points(record, along, aside).take(located & ~record.invalid)
    if not len(points):
        raise DasError(f"{record.source}: no point has a position")
    points = _on_line(record, line, points, section_m, log)
    frozen = _frozen(record, points)
    points, lost = _located_by_speeds(record, points.take(~frozen)), points.point[frozen]
    by_speeds = points.point[np.isnan(points.aside_m)]
    nowhere = np.setdiff1d(np.flatnonzero(~located & ~record.invalid), by_speeds)
    log.add(FindingKind.NO_POSITION, record, nowhere, "neither on the map nor on the route")
    log.add(FindingKind.POSITION_FROZEN, record, np.setdiff1d(lost, by_speeds), "exactly the same position")
    log.add(FindingKind.SPEED_ALONE, record, by_speeds, "no position, or exactly the same")
    points = _without_jumps(record, points, section_m, log)
    points = _one_part(record, points, log)
    if len(points) < 2:
        raise DasError(f"{record.source}: a single point fits, expected at least 2")
    return _with_speeds(record, points)


def _all_points(record: Record, along_m: Floats, aside_m: Floats) -> Points:
    """Every point, speeds as reported."""
    none = np.zeros(len(record), dtype=bool)
    return Points(
        point=np.arange(len(record)),
        time_s=record.elapsed_s(),
        along_m=along_m,
        aside_m=aside_m,
        speed_mps=record.speed_mps,
        missing=np.isnan(record.speed_mps),
        dropout=none,
        spike=none,
        standing=none,
        slowed_to_mps=np.full(len(record), np.nan),
    )


def _on_line(record: Record, line: Line | None, points: Points, section_m: float, log: FindingLog) -> Points:
    """The points from the first to the last on the line; a point off the line between them is kept, as a jump."""
    off = points.aside_m > MAX_CROSS_TRACK_M
    if line is not None and not _enough(points.take(~off), len(points), section_m):
        i = int(off.argmax())
        raise DasError(
            f"{record.source}: trip not on the line {line.source}: {record.where(int(points.point[i]))} is "
            f"{points.aside_m[i]:.0f} m away and {np.count_nonzero(off)} of {len(off)} points more than "
            f"{MAX_CROSS_TRACK_M:.0f} m"
        )
    on = np.flatnonzero(~off)
    inside = slice(on[0], on[-1] + 1)
    away, outside = np.delete(points.aside_m, inside), np.delete(points.point, inside)
    log.add(FindingKind.OFF_LINE, record, outside, f"up to {away.max():.0f} m away" if len(away) else "")
    return points.take(inside)


def _frozen(record: Record, points: Points) -> Bools:
    """Mask of the points that repeat a position while the train moves."""
    on = np.flatnonzero(points.aside_m <= MAX_CROSS_TRACK_M)
    frozen = np.zeros(len(points), dtype=bool)
    frozen[on] = cleaning.find_frozen(points.time_s[on], points.along_m[on], measured_mps(record, points)[on])
    return frozen


def _located_by_speeds(record: Record, points: Points) -> Points:
    """The points, and between them those that only have a speed, as in a tunnel, with positions computed from it."""
    time_s, speed = record.elapsed_s(), np.where(record.degraded, np.nan, record.speed_mps)
    every = _all_points(record, np.full(len(record), np.nan), np.full(len(record), np.nan))
    on, found = points.aside_m <= MAX_CROSS_TRACK_M, [points]
    for i in np.flatnonzero((np.diff(points.time_s) > LOST_S) & on[1:] & on[:-1]):
        inside = np.arange(points.point[i], points.point[i + 1] + 1)
        inside = inside[~record.invalid[inside]]
        way_m = float(points.along_m[i + 1] - points.along_m[i])
        led_m = cleaning.positions_by_speeds(time_s[inside], speed[inside], way_m)
        if led_m is not None:
            alone = np.flatnonzero(np.isfinite(speed[inside]))
            alone = alone[(alone > 0) & (alone < len(inside) - 1)]
            found.append(replace(every.take(inside[alone]), along_m=points.along_m[i] + led_m[alone]))
    joined = {f.name: np.concatenate([getattr(one, f.name) for one in found]) for f in fields(points)}
    return replace(points, **joined).take(np.argsort(joined["point"]))


def _without_jumps(record: Record, points: Points, section_m: float, log: FindingLog) -> Points:
    off = points.aside_m > MAX_CROSS_TRACK_M
    on = np.flatnonzero(~off)
    jump = off.copy()
    jump[on] = cleaning.find_jumps(points.time_s[on], points.along_m[on], measured_mps(record, points)[on])
    kept = points.take(~jump)
    if not jump.any():
        return kept
    if not _enough(kept, len(points), section_m):
        raise DasError(
            f"{record.source}: the positions jump: only {len(kept)} of {len(points)} points fit together, "
            f"{record.where(int(points.point[jump.argmax()]))} does not"
        )
    led_to = np.interp(points.time_s, kept.time_s, kept.along_m)
    away = np.where(off, points.aside_m, np.abs(points.along_m - led_to))[jump]
    log.add(FindingKind.POSITION_JUMP, record, points.point[jump], f"by up to {away.max():.0f} m")
    return kept


def _enough(kept: Points, count: int, section_m: float) -> bool:
    """Whether the remaining points are most of the record, or cover most of the section."""
    if len(kept) < 2:
        return False
    return len(kept) >= LEAST_KEPT_RATIO * count or float(np.ptp(kept.along_m)) >= LEAST_KEPT_RATIO * section_m


def _one_part(record: Record, points: Points, log: FindingLog) -> Points:
    """The largest part of the record without a long gap in which, or next to which, the train moved."""
    steps_s, steps_m = np.diff(points.time_s), np.abs(np.diff(points.along_m))
    moving = steps_m > WRONG_SPEED_MPS * steps_s
    beside = np.append(False, moving[:-1]) | np.append(moving[1:], False)
    breaks = np.flatnonzero((steps_s > LONGEST_GAP_S) & (beside | (steps_m > AT_PLATFORM_M))) + 1
    largest = max(np.split(np.arange(len(points)), breaks), key=len)
    unseen = f"the train moved unseen for more than {LONGEST_GAP_S:.0f} s"
    log.add(FindingKind.FAR_APART, record, np.delete(points.point, largest), unseen)
    return points.take(largest)


def _with_speeds(record: Record, points: Points) -> Points:
    """The points with stands marked, and with dropouts and spikes corrected; DasError if the train never moves."""
    halted = np.zeros(len(points), dtype=bool)
    if cleaning.speeds_unusable(points.time_s, points.along_m, measured_mps(record, points)):
        halted = cleaning.find_halts(points.time_s, points.along_m, measured_mps(record, points))
        points = replace(points, missing=np.ones(len(points), dtype=bool), speed_mps=np.full(len(points), np.nan))
    dropout, spike = cleaning.find_wrong_speeds(points.time_s, points.along_m, measured_mps(record, points))
    derived = np.abs(cleaning.derived_speed_mps(points.time_s, points.along_m))
    speed = np.where(points.missing | dropout | spike, derived, points.speed_mps)
    untold = points.missing | spike
    still = (standing(speed, untold) & ~dropout) | halted
    still = stood_through(points.time_s, points.along_m, still, untold)
    slowed = np.where(still, np.nan, slowed_to(points.time_s, points.along_m, untold))
    still |= np.isfinite(slowed)
    if still.all():
        raise DasError(f"{record.source}: the train never moves, every speed is below {RECORD_STANDS_MPS / KMH:g} km/h")
    return replace(points, speed_mps=speed, dropout=dropout, spike=spike, standing=still, slowed_to_mps=slowed)


def measured_mps(record: Record, points: Points) -> Floats:
    """Speeds (m/s); NaN for those that are wrong or were not measured."""
    return np.where(record.degraded[points.point] | points.speed_derived, np.nan, points.speed_mps)


class Stand(NamedTuple):
    """A standstill: its first and its last point."""

    first: int
    last: int


def standing(speed_mps: Floats, from_positions: Bools) -> Bools:
    """Mask of the points of standstills; `from_positions` marks speeds that were not reported."""
    return speed_mps < np.where(from_positions, STANDING_BY_POSITIONS_MPS, RECORD_STANDS_MPS)


def stood_through(time_s: Floats, along_m: Floats, still: Bools, untold: Bools) -> Bools:
    """Mask of the points of standstills, ignoring apparent motion.

    `still` are points at which the train stands. It also stands at points without a usable speed (`untold`) whose
    positions over 15 s on either side show no motion, and at all points between two stands if they are within 30 m.
    """
    slow_mps = cleaning.derived_speed_mps(time_s, along_m, STALL_HALF_WINDOW_S)
    found = still | (untold & (np.abs(slow_mps) < STANDING_BY_POSITIONS_MPS))
    for before, after in pairwise(stands(found)):
        between = slice(before.last, after.first + 1)
        if np.abs(along_m[between] - along_m[before.last]).max() <= WANDER_M:
            found[between] = True
    return found


def slowed_to(time_s: Floats, along_m: Floats, untold: Bools) -> Floats:
    """Speed (m/s) at the first and the last point if positions slow down to a stand there, else NaN.

    A mean slope of the positions lags by seconds, so it shows no stand in a record that ends as the train stops. At an
    end whose speed is `untold`, the speed is therefore the slope of the parabola through the positions of 12 s.
    """
    found = np.full(len(time_s), np.nan)
    for end in (0, -1):
        inwards_s = np.abs(time_s - time_s[end])
        near = inwards_s <= LED_WINDOW_S
        if not untold[end] or np.count_nonzero(near) < LED_POINTS:
            continue
        way_m = (along_m[near] - along_m[end]) * (1.0 if end == 0 else -1.0)
        half_change, speed, _ = np.polyfit(inwards_s[near], way_m, 2)
        if abs(speed) <= LED_SPEED_MPS and 2.0 * half_change >= LED_CHANGE_MPS2:
            found[end] = max(speed, 0.0)
    return found


def left_over(slowed_to_mps: Floats) -> tuple[float, float]:
    """Largest distance (m) and time (s) in which a train at these speeds (NaN: none) comes to a stop or has started."""
    speed_mps = float(np.nan_to_num(slowed_to_mps).max())
    return speed_mps**2 / (2.0 * GENTLE_MPS2), speed_mps / GENTLE_MPS2


def stands(standing_points: Bools) -> list[Stand]:
    """The standstills in order."""
    return [Stand(first, end - 1) for first, end in stretches_of(standing_points)]


def visits(found: list[Stand], s_m: Floats, stop_m: float, *, last: bool) -> list[Stand]:
    """The standstill nearest to a stop in each visit to it; if two are equally near, the first (the last if `last`).

    A visit ends when the train is further away than 300 m.
    """
    nearest: list[Stand] = []
    seen_to = 0
    for stand in found:
        off = abs(s_m[stand.last] - stop_m)
        best_m = abs(s_m[nearest[-1].last] - stop_m) if nearest else np.inf
        if off > AT_PLATFORM_M:
            continue
        stayed = bool(nearest) and bool(np.all(np.abs(s_m[seen_to : stand.first] - stop_m) <= AT_PLATFORM_M))
        if not stayed:
            nearest.append(stand)
        elif (off <= best_m) if last else (off < best_m):
            nearest[-1] = stand
        seen_to = stand.last
    return nearest


@dataclass(frozen=True, kw_only=True)
class MatchReport:
    """The placing of a record on the route: s = offset_m + scale · chainage.

    `anchor` is the origin of offset and scale: "route" (the line has the route's positions already), "start and end",
    "start" or "end" (the stops where the train stood), "stops" (the coordinates of the route's stops), "positions" (the
    record has positions on the route). If only positions show that the train stood at an end of the record, it may have
    stood up to `stand_uncertainty_m` beyond that end. Distances from the line (cross track) are None if there is no
    line.
    """

    offset_m: float
    scale: float
    anchor: str
    stand_uncertainty_m: float
    median_cross_track_m: float | None
    p95_cross_track_m: float | None
    max_cross_track_m: float | None
    cleaning: CleaningReport


class RunEnds(NamedTuple):
    """The ends of a run among the points of a record.

    The train stands up to point `departure` and from point `arrival` on. If it does not stand at an end, that end is
    the first or last point of the record, and `starts_standing` or `ends_standing` is False.
    """

    departure: int
    arrival: int
    starts_standing: bool
    ends_standing: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedTrip(DrivenCourse):
    """A record on a route, arrays of shape (points,); `s_m` never decreases, `speed_mps` has no dropouts.

    `dropout` marks speeds that were not measured but derived from positions, `invalid` points that a recording calls
    invalid, and `standing` points at which the train stands.
    """

    source: str
    latitude_deg: Floats
    longitude_deg: Floats
    dropout: Bools
    invalid: Bools
    uncertainty_m: Floats
    standing: Bools
    ends: RunEnds
    report: MatchReport

    def __post_init__(self) -> None:
        for array in (self.s_m, self.speed_mps, self.dropout):
            array.setflags(write=False)

    def elapsed_s(self) -> Floats:
        """Time since the first point (s)."""
        return np.asarray((self.time_ns - self.time_ns[0]) * NS, dtype=np.float64)


def match_trip(
    record: Record,
    line: Line | None,
    route: Route,
    stops: tuple[Stop, Stop],
    log: FindingLog | None = None,
    *,
    whole_stands: bool = False,
) -> MatchedTrip:
    """Match a record (times increasing) to a route, from the first of `stops` to the second.

    Impossible points and speeds are dropped or corrected, and listed in the report (see docs/reference/trips.md).
    Kilometre posts have their own zero. If two standstills are as far apart as the stops, within 1 %, they are placed
    at the stops and the kilometrage is scaled to both. Otherwise the stand at the start fixes the zero, or else the
    stand at the end. Without a line, the record's own positions are used. Long stands at the ends are cut to 30 s
    unless `whole_stands`. Raises DasError if nothing usable remains: the train is off the line, does not move, turns
    back, or runs on another section.
    """
    log = log or FindingLog(read=len(record))
    start_stop, end_stop = stops
    if start_stop.position_m >= end_stop.position_m:
        raise DasError(f"{route.source}: {start_stop.name} does not lie before {end_stop.name} on the route as driven")
    points = fitting_points(record, line, end_stop.position_m - start_stop.position_m, log)
    found = stands(points.standing)
    pinned = _pinned(points.along_m, found)
    offset_m, scale, anchor = _alignment(record, line, pinned, found, stops, _unusable_speeds(record, points))
    placed = replace(points, along_m=offset_m + scale * pinned)
    kept = section_of(record, placed, found, stops, log, whole_stands=whole_stands)
    drifted = np.abs(scale * (pinned - points.along_m))[kept] > TOLD_M
    points = placed.take(kept)
    log.add(FindingKind.STANDING_DRIFT, record, points.point[drifted])
    points = _mended(record, points, log)
    _log_section(record, points, end_stop, log)
    aside_m, known = points.aside_m, line is not None
    report = MatchReport(
        offset_m=offset_m,
        scale=scale,
        anchor=anchor,
        stand_uncertainty_m=left_over(points.slowed_to_mps)[0],
        median_cross_track_m=float(np.nanmedian(aside_m)) if known else None,
        p95_cross_track_m=float(np.nanpercentile(aside_m, 95)) if known else None,
        max_cross_track_m=float(np.nanmax(aside_m)) if known else None,
        cleaning=log.report(len(points), record.unread),
    )
    return _with_invalid(record, points, report)


def _pinned(along_m: Floats, found: list[Stand]) -> Floats:
    """Positions (m) with every standstill at one place.

    At the start that place is the last position, because the receiver has settled by then; elsewhere it is the median.
    """
    pinned = along_m.copy()
    for stand in found:
        here = slice(stand.first, stand.last + 1)
        pinned[here] = along_m[stand.last] if stand.first == 0 else np.median(along_m[here])
    return pinned


def _unusable_speeds(record: Record, points: Points) -> str:
    if np.isnan(record.speed_mps).all() or not points.missing.all():
        return ""
    return " (its speeds are not those of its positions: another unit of speed or time?)"


def _alignment(
    record: Record, line: Line | None, pinned_m: Floats, found: list[Stand], stops: tuple[Stop, Stop], hint: str
) -> tuple[float, float, str]:
    """Offset, scale and anchor of s = offset + scale·chainage."""
    if line is None:
        return 0.0, 1.0, "positions"
    if line.on_route and not line.by_stops:
        return 0.0, 1.0, "route"
    start_m, end_m = stops[0].position_m, stops[1].position_m
    pair = _stands_apart(pinned_m, found, end_m - start_m)
    if pair is not None:
        first, last = pair
        scale = (end_m - start_m) / (last - first)
        return start_m - scale * first, scale, "start and end"
    if line.by_stops:
        return 0.0, 1.0, "stops"
    if found and found[0].first == 0:
        return start_m - float(pinned_m[0]), 1.0, "start"
    if found and found[-1].last == len(pinned_m) - 1:
        return end_m - float(pinned_m[-1]), 1.0, "end"
    raise DasError(
        f"{record.source}: the train stands neither at the first nor at the last {record.place} that fits, so "
        f"kilometre posts cannot be aligned with the route's positions{hint}: expected a record from its stand at "
        f"{stops[0].name} or to that at {stops[1].name}, or a route with geometry instead of --posts"
    )


def _stands_apart(pinned_m: Floats, found: list[Stand], distance_m: float) -> tuple[float, float] | None:
    """The two standstills whose distance is nearest to the distance of the stops; None if all are off by over 1 %."""
    places = pinned_m[[stand.first for stand in found]]
    off = np.abs(np.subtract.outer(places, places).T - distance_m)
    off[np.tril_indices(len(places))] = np.inf  # keep pairs in the order of travel
    if not np.any(off <= SCALE_TOLERANCE_RATIO * distance_m):
        return None
    i, j = np.unravel_index(int(off.argmin()), off.shape)
    return float(places[i]), float(places[j])


def _mended(record: Record, points: Points, log: FindingLog) -> Points:
    """The points with positions that never decrease, and with speeds from positions where none were measured."""
    s_m = _flattened(record, points)
    back = np.abs(s_m - points.along_m) > TOLD_M
    log.add(FindingKind.STEP_BACK, record, points.point[back], f"less than {MAX_BACKWARD_M:.0f} m")
    # Wrong speeds are sought again on the final positions, so that a cleaned trip needs no more corrections.
    dropout, spike = cleaning.find_wrong_speeds(points.time_s, s_m, measured_mps(record, points))
    points = replace(points, dropout=points.dropout | dropout, spike=points.spike | spike)
    # A standing train has speed 0; a moving train has at least the speed below which trains count as standing.
    derived = np.maximum(cleaning.derived_speed_mps(points.time_s, s_m), RECORD_STANDS_MPS)
    derived = np.where(points.standing, 0.0, derived)
    return replace(points, along_m=s_m, speed_mps=np.where(points.speed_derived, derived, points.speed_mps))


def _flattened(record: Record, points: Points) -> Floats:
    """Positions (m) that never decrease nor pass the stand at the end; raises DasError for steps back beyond noise."""
    highest = np.maximum.accumulate(points.along_m)
    back = highest - points.along_m
    if back.max() > MAX_BACKWARD_M:
        i = int((back > MAX_BACKWARD_M).argmax())
        raise DasError(
            f"{record.source}: position decreases by {back[i]:.0f} m at {record.where(int(points.point[i]))} "
            "(wrong direction? see --reverse)"
        )
    return np.minimum(highest, points.along_m[-1]) if points.standing[-1] else highest


def _log_section(record: Record, points: Points, end_stop: Stop, log: FindingLog) -> None:
    """Log the corrections of the section's speeds, and the findings that were left uncorrected."""
    at = points.point
    for kind, which in (
        (FindingKind.SPEED_MISSING, points.missing),
        (FindingKind.SPEED_DROPOUT, points.dropout),
        (FindingKind.SPEED_SPIKE, points.spike),
    ):
        log.add(kind, record, at[which], _speeds(record, at[which], points, which))
    slowed = np.isfinite(points.slowed_to_mps)
    reach_m, reach_s = left_over(points.slowed_to_mps)
    log.add(
        FindingKind.SLOWS_TO_STAND, record, at[slowed], f"the stand is up to {reach_m:.1f} m and {reach_s:.0f} s beyond"
    )
    inside = np.arange(at[0], at[-1] + 1)
    time_s = record.elapsed_s()[inside]
    gaps = cleaning.find_gaps(time_s)
    longest = f"longest {np.diff(time_s)[gaps].max():.0f} s" if len(gaps) else ""
    log.add(FindingKind.GAP, record, inside[gaps], longest)
    for kind, i in ((FindingKind.STARTS_MOVING, 0), (FindingKind.ENDS_MOVING, -1)):
        if not points.standing[i]:
            left = f", {end_stop.position_m - points.along_m[-1]:.0f} m before {end_stop.name}" if i else ""
            log.add(kind, record, [at[i]], f"at {points.speed_mps[i] / KMH:.0f} km/h{left}")


def _speeds(record: Record, at: Ints, points: Points, which: Bools) -> str:
    """Words about the reported speed that is furthest from the corrected speed."""
    off = np.abs(record.speed_mps[at] - points.speed_mps[which])
    if not len(off) or np.isnan(off).all():
        return ""
    worst = int(np.nanargmax(off))
    unit = ", so most are: another unit?" if 2 * len(at) > len(points) else ""
    return f"{record.speed_mps[at][worst] / KMH:.0f} instead of {points.speed_mps[which][worst] / KMH:.0f} km/h{unit}"


def _with_invalid(record: Record, points: Points, report: MatchReport) -> MatchedTrip:
    """The trip, including the points that a recording calls invalid, because the node received them as well."""
    inside = np.zeros(len(record), dtype=bool)
    inside[points.point[0] : points.point[-1] + 1] = True
    kept = record.invalid & inside
    kept[points.point] = True
    j = np.flatnonzero(kept)
    s_m, speed = (np.interp(j, points.point, values) for values in (points.along_m, points.speed_mps))
    still = np.interp(j, points.point, points.standing) == 1.0
    derived = np.zeros(len(record), dtype=bool)
    derived[points.point] = points.speed_derived
    moving = np.flatnonzero(~points.standing)
    departure, arrival = max(int(moving[0]) - 1, 0), min(int(moving[-1]) + 1, len(points) - 1)
    uncertainty = record.uncertainty_m[j]
    if report.median_cross_track_m is not None:
        uncertainty = np.where(np.isnan(uncertainty), report.median_cross_track_m, uncertainty)
    by_speeds = np.isin(j, points.point[np.isnan(points.aside_m)])
    return MatchedTrip(
        source=record.source,
        time_ns=record.time_ns[j],
        s_m=s_m,
        speed_mps=speed,
        latitude_deg=record.latitude_deg[j],
        longitude_deg=record.longitude_deg[j],
        dropout=(derived | record.degraded)[j],
        invalid=record.invalid[j],
        uncertainty_m=np.where(by_speeds, JUMP_M, uncertainty),
        standing=still,
        ends=RunEnds(
            departure=int(np.searchsorted(j, points.point[departure])),
            arrival=int(np.searchsorted(j, points.point[arrival])),
            starts_standing=bool(points.standing[0]),
            ends_standing=bool(points.standing[-1]),
        ),
        report=report,
    )


def section_of(
    record: Record,
    points: Points,
    found: list[Stand],
    stops: tuple[Stop, Stop],
    log: FindingLog,
    *,
    whole_stands: bool,
) -> slice:
    """The points of the section: from the last stand at the first stop to the next stand at the last stop.

    `points` have positions on the route, `found` are their standstills. If the train does not stand at a stop, the
    record is cut where the train passes it, or not at all if it is never more than 300 m beyond the stop. The stand at
    either end is cut to 30 s unless `whole_stands`. Raises DasError if nothing is left.
    """
    start, end = _stands_of_section(points, found, stops)
    last = end.last if end else _passing_end(points, start, stops[1])
    first = start.first if start else _passing_start(points, last, stops[0])
    s_m = points.along_m[first : last + 1]
    if last - first < 1 or np.ptp(s_m) <= LEAST_MOVED_M:
        raise DasError(
            f"{record.source}: the trip does not run from {stops[0].name} towards {stops[1].name}: it covers "
            f"{np.ptp(s_m) if len(s_m) else 0.0:.0f} m between them"
        )
    beyond = (stops[0].position_m - points.along_m[:first], points.along_m[last + 1 :] - stops[1].position_m)
    log.add(FindingKind.BEFORE_SECTION, record, points.point[:first], _how_far(beyond[0], stops[0], "before"))
    log.add(FindingKind.AFTER_SECTION, record, points.point[last + 1 :], _how_far(beyond[1], stops[1], "beyond"))
    if whole_stands:
        return slice(first, last + 1)
    return _without_long_stands(record, points, found, (first, last), log)


def _stands_of_section(
    points: Points, found: list[Stand], stops: tuple[Stop, Stop]
) -> tuple[Stand | None, Stand | None]:
    starts = visits(found, points.along_m, stops[0].position_m, last=False)
    ends = visits(found, points.along_m, stops[1].position_m, last=True)
    for end in ends:
        before = [start for start in starts if start.last < end.first]
        if before:
            return before[-1], end
    if starts:
        return starts[-1], None
    return None, ends[0] if ends else None


def _passing_start(points: Points, last: int, stop: Stop) -> int:
    """Index of the first point after the train passed a stop; 0 if it was never well before the stop."""
    before = np.flatnonzero(points.along_m[: last + 1] < stop.position_m)
    if not len(before) or points.along_m[before].min() >= stop.position_m - AT_PLATFORM_M:
        return 0
    return int(before[-1]) + 1


def _passing_end(points: Points, start: Stand | None, stop: Stop) -> int:
    """Index of the last point before the train passed a stop without standing; the last if it was never well beyond."""
    first = start.last if start else 0
    beyond = first + np.flatnonzero(points.along_m[first:] > stop.position_m)
    if not len(beyond) or points.along_m[beyond].max() <= stop.position_m + AT_PLATFORM_M:
        return len(points) - 1
    return int(beyond[0]) - 1


def _how_far(beyond_m: np.ndarray, stop: Stop, where: str) -> str:
    return f"up to {beyond_m.max():.0f} m {where} {stop.name}" if len(beyond_m) and beyond_m.max() > 0 else ""


def _without_long_stands(
    record: Record, points: Points, found: list[Stand], ends: tuple[int, int], log: FindingLog
) -> slice:
    """The points between the ends; of a stand at the start only the last 30 s, at the end only the first 30 s."""
    (first, last), time_s, kept_s = ends, points.time_s, STAND_KEPT_S

    def cut(kind: FindingKind, which: slice, stood_s: float) -> None:
        log.add(kind, record, points.point[which], f"{stood_s:.0f} s, {kept_s:.0f} s kept")

    for stand in found:
        came_s, left_s = time_s[stand.first], time_s[stand.last]
        if stand.first <= first < stand.last:
            begin = int(np.searchsorted(time_s, left_s - kept_s - SAME_TIME_S))
            cut(FindingKind.LONG_STAND_AT_START, slice(first, begin), left_s - time_s[first])
            first = max(first, begin)
        if stand.first < last <= stand.last:
            end = int(np.searchsorted(time_s, came_s + kept_s + SAME_TIME_S, side="right"))
            cut(FindingKind.LONG_STAND_AT_END, slice(end, last + 1), time_s[last] - came_s)
            last = min(last, end - 1)
    return slice(first, last + 1)
