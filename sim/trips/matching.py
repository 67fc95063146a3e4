"""A record on the route, cut to its section: positions that never decrease, and speeds without dropouts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Floats, Route, Stop
from das.domain.units import KMH, NS
from sim.recording.course import DrivenCourse
from sim.trips import cleaning
from sim.trips.cleaning import CleaningReport, FindingKind, FindingLog
from sim.trips.line import Line
from sim.trips.points import Points, Stand, fitting_points, left_over, measured_mps, stands, visits
from sim.trips.record import Bools, Ints, Record
from sim.trips.settings import AT_PLATFORM_M, LEAST_MOVED_M, MAX_BACKWARD_M, RECORD_STANDS_MPS, SCALE_TOLERANCE_RATIO

STAND_KEPT_S: Final = 30.0
"""Time (s) of a stand at the start or the end that is kept."""
TOLD_M: Final = 0.01
"""Least move (m) of a position that is reported."""

SAME_TIME_S = 1e-6
"""Difference (s) below which times count as equal."""


@dataclass(frozen=True, kw_only=True)
class MatchReport:
    """How a record was placed on the route: s = offset_m + scale · chainage.

    `anchor` says what fixed offset and scale: "route" (the line has the route's positions already), "start and end",
    "start" or "end" (the stops where the train stood), "stops" (the coordinates of the route's stops), "positions" (the
    record has positions on the route). If only
    positions show that the train stood at an end of the record, it may have stood up to `stand_uncertainty_m` beyond
    that end. Distances from the line (cross track) are None if there is no line.
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
    """Match a record (times increasing) to a route that is driven from the first of `stops` to the second.

    Impossible points and speeds are dropped or mended, and listed in the report (see docs/reference/trips.md).
    Kilometre posts have a zero of their own. If two standstills are as far apart as the stops, within 1 %, they are put
    on the stops and the kilometrage is scaled to both. Otherwise the stand at the start fixes the zero, or else the
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
    anchored = _alignment(record, line, pinned, found, stops, _unusable_speeds(record, points))
    offset_m, scale, _ = anchored
    placed = replace(points, along_m=offset_m + scale * pinned)
    kept = section_of(record, placed, found, stops, log, whole_stands=whole_stands)
    drifted = np.abs(scale * (pinned - points.along_m))[kept] > TOLD_M
    points = placed.take(kept)
    log.add(FindingKind.STANDING_DRIFT, record, points.point[drifted])
    points = _mended(record, points, log)
    _log_section(record, points, end_stop, log)
    return _with_invalid(record, points, _report(record, points, anchored, line, log))


def _report(
    record: Record, points: Points, anchored: tuple[float, float, str], line: Line | None, log: FindingLog
) -> MatchReport:
    aside_m, known = points.aside_m, line is not None
    return MatchReport(
        offset_m=anchored[0],
        scale=anchored[1],
        anchor=anchored[2],
        stand_uncertainty_m=left_over(_fastest(points.slowed_to_mps))[0],
        median_cross_track_m=float(np.median(aside_m)) if known else None,
        p95_cross_track_m=float(np.percentile(aside_m, 95)) if known else None,
        max_cross_track_m=float(aside_m.max()) if known else None,
        cleaning=log.report(len(points), record.unread),
    )


def _fastest(slowed_to_mps: Floats) -> float:
    """The highest speed (m/s) at an end that was taken for a stand; 0 if none was."""
    return float(np.nan_to_num(slowed_to_mps).max())


def _pinned(along_m: Floats, found: list[Stand]) -> Floats:
    """Positions (m) with every standstill in one place.

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
    off[np.tril_indices(len(places))] = np.inf  # keep pairs in driving order
    if not np.any(off <= SCALE_TOLERANCE_RATIO * distance_m):
        return None
    i, j = np.unravel_index(int(off.argmin()), off.shape)
    return float(places[i]), float(places[j])


def _mended(record: Record, points: Points, log: FindingLog) -> Points:
    """The points with positions that never decrease, and with speeds from positions where none were measured."""
    s_m = _flattened(record, points)
    back = np.abs(s_m - points.along_m) > TOLD_M
    log.add(FindingKind.STEP_BACK, record, points.point[back], f"less than {MAX_BACKWARD_M:.0f} m")
    # Wrong speeds are sought again on the final positions, so that a cleaned trip has nothing left to mend.
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
    """Log what was mended in the section's speeds, and what was found but left as it is."""
    at = points.point
    for kind, which in (
        (FindingKind.SPEED_MISSING, points.missing),
        (FindingKind.SPEED_DROPOUT, points.dropout),
        (FindingKind.SPEED_SPIKE, points.spike),
    ):
        log.add(kind, record, at[which], _speeds(record, at[which], points, which))
    slowed = np.isfinite(points.slowed_to_mps)
    reach_m, reach_s = left_over(_fastest(points.slowed_to_mps))
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
    """Words about the reported speed that is furthest from the mended speed."""
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
    departure, arrival = _departure_and_arrival(points)
    uncertainty = record.uncertainty_m[j]
    if report.median_cross_track_m is not None:
        uncertainty = np.where(np.isnan(uncertainty), report.median_cross_track_m, uncertainty)
    return MatchedTrip(
        source=record.source,
        time_ns=record.time_ns[j],
        s_m=s_m,
        speed_mps=speed,
        latitude_deg=record.latitude_deg[j],
        longitude_deg=record.longitude_deg[j],
        dropout=(derived | record.degraded)[j],
        invalid=record.invalid[j],
        uncertainty_m=uncertainty,
        standing=still,
        ends=RunEnds(
            departure=int(np.searchsorted(j, points.point[departure])),
            arrival=int(np.searchsorted(j, points.point[arrival])),
            starts_standing=bool(points.standing[0]),
            ends_standing=bool(points.standing[-1]),
        ),
        report=report,
    )


def _departure_and_arrival(points: Points) -> tuple[int, int]:
    """The last point of the stand at the start and the first point of the stand at the end; else the end points."""
    moving = np.flatnonzero(~points.standing)
    return max(int(moving[0]) - 1, 0), min(int(moving[-1]) + 1, len(points) - 1)


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
