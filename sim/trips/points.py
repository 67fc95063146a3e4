"""The points of a record that fit together as one train's motion, with plausible speeds, and its standstills."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, Final, NamedTuple, Self

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Floats
from das.domain.units import KMH
from sim.recording.course import stretches_of
from sim.trips import cleaning
from sim.trips.cleaning import FindingKind, FindingLog
from sim.trips.line import Line
from sim.trips.record import Bools, Ints, Record
from sim.trips.settings import (
    AT_PLATFORM_M,
    LEAST_KEPT_RATIO,
    LEAST_MOVED_M,
    MAX_CROSS_TRACK_M,
    RECORD_STANDS_MPS,
    STALL_HALF_WINDOW_S,
    WANDER_M,
    WRONG_SPEED_MPS,
)

LONGEST_GAP_S: Final = 300.0
"""Gap (s) above which the record is split if the train moved in it or next to it; the largest part is kept."""
STANDING_BY_POSITIONS_MPS: Final = 0.5
"""Speed of the positions (m/s) below which a train stands where no speed is reported: they wander by metres."""
LED_WINDOW_S: Final = 12.0
"""Time (s) at an end of a record in which positions are checked for slowing to a stand."""
LED_POINTS: Final = 4
"""Least number of positions within `LED_WINDOW_S` at an end of a record that show a stand."""
LED_SPEED_MPS: Final = 2.0
"""Largest speed (m/s) at an end of a record whose positions show a stand."""
LED_CHANGE_MPS2: Final = 0.1
"""Least slowing (m/s²) of positions at an end of a record that show a stand: noise gives less."""
GENTLE_MPS2: Final = 0.3
"""Gentlest stop or start (m/s²) of a train, so that v²/2a and v/a bound what may be left of its motion."""
ONE_WAY_RATIO: Final = 0.5
"""Least distance of the ends of a trip in one direction, as a share of its whole extent."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """Points of a record that are kept, arrays of shape (points,); `point` is the index in the record.

    `along_m` is the chainage, later the position on the route; `aside_m` is the distance from the line. `missing`,
    `dropout` and `spike` mark the reason why a speed is not the reported one. Where only the positions show that the
    train stands at an end of the record, `slowed_to_mps` is the speed that they give there; elsewhere it is NaN.
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

    Every point that is dropped is logged. Wrong speeds are only marked here; those on the section are logged later.
    Raises DasError if most points do not fit.
    """
    along, aside = _place(record, line)
    located = np.isfinite(aside)
    log.add(FindingKind.NO_POSITION, record, ~located & ~record.invalid, "neither on the map nor on the route")
    points = _all_points(record, along, aside).take(located & ~record.invalid)
    if not len(points):
        raise DasError(f"{record.source}: no point has a position")
    points = _on_line(record, line, points, section_m, log)
    points = _without_jumps(record, _without_frozen(record, points, log), section_m, log)
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
    outside = np.ones(len(points), dtype=bool)
    outside[on[0] : on[-1] + 1] = False
    away = points.aside_m[outside]
    log.add(FindingKind.OFF_LINE, record, points.point[outside], f"up to {away.max():.0f} m away" if len(away) else "")
    return points.take(~outside)


def _without_frozen(record: Record, points: Points, log: FindingLog) -> Points:
    on = np.flatnonzero(points.aside_m <= MAX_CROSS_TRACK_M)
    frozen = np.zeros(len(points), dtype=bool)
    frozen[on] = cleaning.find_frozen(points.time_s[on], points.along_m[on], measured_mps(record, points)[on])
    log.add(FindingKind.POSITION_FROZEN, record, points.point[frozen], "exactly the same position")
    return points.take(~frozen)


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
    other = np.ones(len(points), dtype=bool)
    other[largest] = False
    log.add(
        FindingKind.FAR_APART,
        record,
        points.point[other],
        f"the train moved unseen for more than {LONGEST_GAP_S:.0f} s",
    )
    return points.take(largest)


def _with_speeds(record: Record, points: Points) -> Points:
    """The points with stands marked, and with dropouts and spikes corrected; raises DasError if the train never
    moves."""
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
    """Mask of the points of standstills, with apparent motion disregarded.

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


def left_over(speed_mps: float) -> tuple[float, float]:
    """Distance (m) and time (s) that a train at this speed needs at most to stop, or has needed since it started."""
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
