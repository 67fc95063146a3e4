"""The part of a record that is the section: from its stand at the first stop to that at the last."""

from __future__ import annotations

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Stop
from sim.trips.findings import FindingLog, Kind
from sim.trips.points import LEAST_MOVED_M, Points
from sim.trips.record import Record
from sim.trips.standing import AT_STOP_M, Stand, visits

STAND_KEPT_S = 30.0
"""Of the stand at the start and at the end so much is kept."""
SAME_TIME_S = 1e-6
"""Times nearer than this are the same."""


def section_of(
    record: Record,
    points: Points,
    found: list[Stand],
    stops: tuple[Stop, Stop],
    log: FindingLog,
    *,
    whole_stands: bool,
) -> slice:
    """The points from the last stand at the first stop before the first stand at the last stop, to that.

    `points` have positions on the route, `found` are their standstills. Where the train does not stand at a stop, it
    is cut where it passes the stop, or not at all if it is never more than 300 m beyond. Of a stand at either end 30 s
    are kept, unless `whole_stands`. Raises DasError where nothing is left.
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
    log.add(Kind.BEFORE_SECTION, record, points.point[:first], _how_far(beyond[0], stops[0], "before"))
    log.add(Kind.AFTER_SECTION, record, points.point[last + 1 :], _how_far(beyond[1], stops[1], "beyond"))
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
    """The first point after the train passed a stop without standing there; 0 where it was never well before it."""
    before = np.flatnonzero(points.along_m[: last + 1] < stop.position_m)
    if not len(before) or points.along_m[before].min() >= stop.position_m - AT_STOP_M:
        return 0
    return int(before[-1]) + 1


def _passing_end(points: Points, start: Stand | None, stop: Stop) -> int:
    """The last point before the train passed a stop without standing there; the end where it was never well beyond."""
    first = start.last if start else 0
    beyond = first + np.flatnonzero(points.along_m[first:] > stop.position_m)
    if not len(beyond) or points.along_m[beyond].max() <= stop.position_m + AT_STOP_M:
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
            begin = int(np.searchsorted(time_s, time_s[stand.last] - STAND_KEPT_S - SAME_TIME_S))
            _cut(Kind.LONG_STAND_AT_START, record, points, slice(first, begin), time_s[stand.last] - time_s[first], log)
            first = max(first, begin)
        if stand.first < last <= stand.last:
            end = int(np.searchsorted(time_s, time_s[stand.first] + STAND_KEPT_S + SAME_TIME_S, side="right"))
            _cut(Kind.LONG_STAND_AT_END, record, points, slice(end, last + 1), time_s[last] - time_s[stand.first], log)
            last = min(last, end - 1)
    return slice(first, last + 1)


def _cut(kind: Kind, record: Record, points: Points, which: slice, stood_s: float, log: FindingLog) -> None:
    log.add(kind, record, points.point[which], f"{stood_s:.0f} s, {STAND_KEPT_S:.0f} s kept")
