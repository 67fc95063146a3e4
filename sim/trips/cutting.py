"""Cutting a record to its section: from its stand at the first stop to its stand at the last."""

from __future__ import annotations

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Stop
from sim.trips.findings import FindingKind, FindingLog
from sim.trips.points import Points
from sim.trips.record import Record
from sim.trips.settings import PLACING, STANDS
from sim.trips.standing import Stand, visits

SAME_TIME_S = 1e-6
"""Times nearer to each other than this (s) are the same."""


def section_of(
    record: Record,
    points: Points,
    found: list[Stand],
    stops: tuple[Stop, Stop],
    log: FindingLog,
    *,
    whole_stands: bool,
) -> slice:
    """The points of the section: from the last stand at the first stop to the first stand at the last stop after it.

    `points` have positions on the route, `found` are their standstills. Where the train does not stand at a stop, the
    record is cut where the train passes it, or not at all if it is never more than 300 m beyond. Of the stand at either
    end 30 s are kept, or all if `whole_stands`. Raises DasError if nothing is left.
    """
    start, end = _stands_of_section(points, found, stops)
    last = end.last if end else _passing_end(points, start, stops[1])
    first = start.first if start else _passing_start(points, last, stops[0])
    s_m = points.along_m[first : last + 1]
    if last - first < 1 or np.ptp(s_m) <= PLACING.least_moved_m:
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
    if not len(before) or points.along_m[before].min() >= stop.position_m - STANDS.at_stop_m:
        return 0
    return int(before[-1]) + 1


def _passing_end(points: Points, start: Stand | None, stop: Stop) -> int:
    """Index of the last point before the train passed a stop without standing; the last if it was never well beyond."""
    first = start.last if start else 0
    beyond = first + np.flatnonzero(points.along_m[first:] > stop.position_m)
    if not len(beyond) or points.along_m[beyond].max() <= stop.position_m + STANDS.at_stop_m:
        return len(points) - 1
    return int(beyond[0]) - 1


def _how_far(beyond_m: np.ndarray, stop: Stop, where: str) -> str:
    return f"up to {beyond_m.max():.0f} m {where} {stop.name}" if len(beyond_m) and beyond_m.max() > 0 else ""


def _without_long_stands(
    record: Record, points: Points, found: list[Stand], ends: tuple[int, int], log: FindingLog
) -> slice:
    first, last = ends
    time_s = points.time_s
    for stand in found:
        if stand.first <= first < stand.last:
            begin = int(np.searchsorted(time_s, time_s[stand.last] - STANDS.stand_kept_s - SAME_TIME_S))
            _cut(
                FindingKind.LONG_STAND_AT_START,
                record,
                points,
                slice(first, begin),
                time_s[stand.last] - time_s[first],
                log,
            )
            first = max(first, begin)
        if stand.first < last <= stand.last:
            end = int(np.searchsorted(time_s, time_s[stand.first] + STANDS.stand_kept_s + SAME_TIME_S, side="right"))
            _cut(
                FindingKind.LONG_STAND_AT_END,
                record,
                points,
                slice(end, last + 1),
                time_s[last] - time_s[stand.first],
                log,
            )
            last = min(last, end - 1)
    return slice(first, last + 1)


def _cut(kind: FindingKind, record: Record, points: Points, which: slice, stood_s: float, log: FindingLog) -> None:
    log.add(kind, record, points.point[which], f"{stood_s:.0f} s, {STANDS.stand_kept_s:.0f} s kept")
