"""Cleaning of a record: the kinds of findings, the search for them, and the log of all findings.

The functions find times out of order, impossible positions and impossible speeds; `points` and `matching` act on them.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Floats
from das.domain.units import NS
from sim.recording.course import stretches_of, utc
from sim.trips.record import Bools, Ints, Record

MAX_CROSS_TRACK_M: Final = 200.0
"""Largest distance (m) from the line of a point that counts as on the line. Lines through kilometre posts cut curves:
by 62 m at 2 km radius."""
SCALE_TOLERANCE_RATIO: Final = 0.01
"""Largest relative difference of matched length and distance between the stops for scaling the kilometrage."""
MAX_BACKWARD_M: Final = 30.0
"""Length (m) up to which steps back are noise; a longer step is a turn of the train, or a jump."""
STRAY_WEIGHT: Final = 3.0
"""Cost of each point left out between two points that only just fit each other. Without it, the chain of positions
could change to a wrong part of the record and back, as if the train braked and accelerated as hard as it can."""
LEAST_KEPT_RATIO: Final = 0.5
"""Share of a record's points that must fit together, or of the section that the points must cover."""
STALL_HALF_WINDOW_S: Final = 15.0
"""Longest time (s) until the positions of a receiver that stalled have caught up again."""
WRONG_SPEED_MPS: Final = 4.0
"""Difference (m/s) from the speed of the positions above which a speed is wrong, if it also exceeds
`WRONG_SPEED_RATIO`. A delay of 3 s at 1 m/s² explains less."""
JUMP_M: Final = 50.0
"""Largest distance (m) of a position from the place that its neighbours give; beyond it the position is a jump, if no
change of speed explains it."""
CHANGE_MPS2: Final = 1.0
"""Largest acceleration (m/s²) of a train between its points: no train brakes harder in service."""
STEPS_AROUND: Final = 5
"""Steps on either side whose median is the speed of the positions around a point."""
FROZEN_RATIO: Final = 0.5
"""Least distance to the next position that makes a repeated one wrong, as a share of that by reported speeds."""
LATE_S: Final = 5.0
"""Delay (s) that reported speeds may have, which makes their integral uncertain."""
SCALE_RATIO: Final = 0.02
"""Relative error that the integral of reported speeds may have."""
POINTS_BACK: Final = 120
"""Largest number of consecutive wrong positions that are found: points further apart are not compared."""
LONGEST_JUMP_S: Final = 120.0
"""Longest time (s) of wrong positions that is found: points further apart are not compared."""
LOST_S: Final = 10.0
"""Time (s) without positions over which smoothing joins them well; over a longer one, reported speeds give them."""
LOST_RATIO: Final = 0.05
"""Largest relative difference, besides `JUMP_M`, between the integral of the speeds of such a time and its way."""
TOP_SPEED_PERCENTILE: Final = 99.0
"""Percentile of the speeds around its points that is taken as the top speed of a trip: a few may be wrong."""
DERIVED_HALF_WINDOW_S: Final = 5.0
"""Time (s) on either side whose mean slope is the speed from positions."""
WRONG_SPEED_RATIO: Final = 0.2
"""Share of the speed from positions by which a wrong reported speed must also differ."""
EDGE_MPS: Final = 1.0
"""Least difference (m/s) of a speed next to a wrong one that is wrong as well if it jumps (`EDGE_MPS2`) or repeats
(`SAME_MPS`)."""
EDGE_MPS2: Final = 1.5
"""Change of speed (m/s²) that counts as a jump."""
SAME_MPS: Final = 0.05
"""Largest difference (m/s) between two speeds of which the second counts as a repetition of the first."""
GAP_S: Final = 5.0
"""Least duration (s) of a gap, if it is also longer than `GAP_STEPS` usual intervals."""
GAP_STEPS: Final = 3.0
"""Longest time between points, in usual intervals, that is no gap."""
SPARSE_S: Final = 30.0
"""Time without points (s) that is a gap in any record, even a sparse one."""

_Strays = Callable[[Ints, Any], Floats]
"""Misfit of later points j (one, or one for each i) with earlier points i; two points fit if it is at most 1."""
_REMOVING = ("dropped", "cut")
"""Outcomes of findings whose points are removed from the record."""


class FindingKind(StrEnum):
    """The kinds of faults that cleaning looks for: a name, words, and the outcome."""

    words: str
    done: str

    def __new__(cls, name: str, words: str, done: str) -> FindingKind:
        """A kind of finding, whose value is its name."""
        kind = str.__new__(cls, name)
        kind._value_, kind.words, kind.done = name, words, done
        return kind

    NO_TIME = "no_time", "no time", "dropped"
    NO_ZONE = "no_zone", "time without a zone", "read as local time"
    NEWEST_FIRST = "newest_first", "newest point first", "reversed"
    OTHER_WAY = "other_way", "trip in the other direction", "replayed in that direction"
    DUPLICATE_TIME = "duplicate_time", "duplicate time", "dropped"
    TIME_BACK = "time_back", "time running back", "dropped"
    NO_POSITION = "no_position", "no position", "dropped"
    SPEED_ALONE = "speed_alone", "speed without a position", "position computed from speeds"
    OFF_LINE = "off_line", "off the line before or after", "cut"
    POSITION_FROZEN = "position_frozen", "position frozen while moving", "dropped"
    POSITION_JUMP = "position_jump", "position jump", "dropped"
    FAR_APART = "far_apart", "other part of the record, beyond a long gap", "cut"
    BEFORE_SECTION = "before_section", "before the section", "cut"
    AFTER_SECTION = "after_section", "after the section", "cut"
    LONG_STAND_AT_START = "long_stand_at_start", "long stand at the start", "cut"
    LONG_STAND_AT_END = "long_stand_at_end", "long stand at the end", "cut"
    STANDING_DRIFT = "standing_drift", "position drifts while standing", "merged"
    SLOWS_TO_STAND = "slows_to_stand", "slows down to a stand at an end of the record", "treated as a standstill"
    STEP_BACK = "step_back", "small step back", "flattened"
    SPEED_MISSING = "speed_missing", "no usable speed", "speed from positions"
    SPEED_DROPOUT = "speed_dropout", "speed dropout", "speed from positions"
    SPEED_SPIKE = "speed_spike", "impossible speed", "speed from positions"
    GAP = "gap", "gap in time", "bridged"
    STARTS_MOVING = "starts_moving", "starts moving", "left open"
    ENDS_MOVING = "ends_moving", "ends moving, no final stop", "left open"


@dataclass(frozen=True, kw_only=True)
class TripFinding:
    """Findings of one kind: number of points (or gaps), place and time of the first, and details in words."""

    kind: FindingKind
    count: int
    first: str
    first_time_ns: int
    detail: str

    @property
    def first_time(self) -> str:
        """Time of the first occurrence, UTC."""
        return utc(self.first_time_ns)


@dataclass(frozen=True, kw_only=True)
class CleaningReport:
    """The findings on a record of `read` points, of which `kept` are left; `unread` are unused columns."""

    read: int
    kept: int
    findings: tuple[TripFinding, ...] = ()
    unread: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        """The report in one line."""
        parts = [f"{f.count} × {f.kind.words} ({f.kind.done})" for f in self.findings]
        return f"{self.kept} of {self.read} points kept; " + ("; ".join(parts) or "nothing to clean")

    def as_object(self) -> dict[str, Any]:
        """The report as an object for JSON."""
        return {
            "points_read": self.read,
            "points_kept": self.kept,
            "columns_not_read": list(self.unread),
            "findings": [
                {
                    "kind": str(f.kind),
                    "count": f.count,
                    "done": f.kind.done,
                    "first": f.first,
                    "first_time": f.first_time,
                    "first_time_ns": f.first_time_ns,
                    "detail": f.detail,
                }
                for f in self.findings
            ],
        }


@dataclass
class FindingLog:
    """Collects findings while a record of `read` points is cleaned."""

    read: int = 0
    found: list[TripFinding] = field(default_factory=list)

    def add(self, kind: FindingKind, record: Record, which: Any, detail: str = "") -> None:
        """Add a finding at the points `which` (mask or indices) of a record; no points, no finding."""
        which = np.asarray(which)
        points = np.flatnonzero(which) if which.dtype == bool else which
        if not len(points):
            return
        first, time_ns = record.where(points[0]), int(record.time_ns[points[0]])
        self.found.append(TripFinding(kind=kind, count=len(points), first=first, first_time_ns=time_ns, detail=detail))

    def report(self, kept: int, unread: tuple[str, ...]) -> CleaningReport:
        """The report on all findings, those that removed points first."""
        ordered = sorted(self.found, key=lambda f: (f.kind.done not in _REMOVING, list(FindingKind).index(f.kind)))
        return CleaningReport(read=self.read, kept=kept, findings=tuple(ordered), unread=unread)


def in_order(record: Record, log: FindingLog) -> Record:
    """The record with increasing times: of equal ones the first point is kept; as few others as possible are dropped.

    A file that mostly runs backwards is reversed first. Raises DasError if the times are in disorder, or all equal.
    """
    log.add(FindingKind.NO_TIME, record, record.untimed, "not readable; the time shown is that of a neighbour")
    record = record.take(~record.untimed)
    if record.zone:
        log.add(FindingKind.NO_ZONE, record, np.arange(len(record)), f"that of {record.zone}")
    steps = np.diff(record.time_ns)
    if np.count_nonzero(steps < 0) > np.count_nonzero(steps > 0):
        log.add(FindingKind.NEWEST_FIRST, record, [0], f"{np.count_nonzero(steps < 0)} of {len(steps)} steps go back")
        record = record.take(slice(None, None, -1))
    first = np.sort(np.unique(record.time_ns, return_index=True)[1])
    log.add(FindingKind.DUPLICATE_TIME, record, np.delete(np.arange(len(record)), first), "same time as a point before")
    record = record.take(first)
    rising = longest_rise(record.time_ns)
    if len(rising) < LEAST_KEPT_RATIO * len(record):
        raise DasError(
            f"{record.source}: the times are in disorder: only {len(rising)} of {len(record)} points are in order, "
            "sort the file by time if it was shuffled"
        )
    most_s = (np.maximum.accumulate(record.time_ns) - record.time_ns).max() * NS
    log.add(FindingKind.TIME_BACK, record, np.delete(np.arange(len(record)), rising), f"up to {most_s:.4g} s back")
    record = record.take(rising)
    if len(record) < 2:
        raise DasError(f"{record.source}: all points have one time, expected times that increase")
    return record


def longest_rise(values: Ints) -> list[int]:
    """Indices of a longest strictly increasing subsequence; of two neighbours in the wrong order it keeps the first.

    Patience sorting, from the end: `ends[k]` is the index of the greatest value (negated in `least`) that begins an
    increasing subsequence of length k + 1.
    """
    ends: list[int] = []
    least: list[int] = []
    after = [-1] * len(values)
    for i in range(len(values) - 1, -1, -1):
        value = -int(values[i])
        k = bisect_left(least, value)
        after[i] = ends[k - 1] if k else -1
        if k == len(ends):
            ends.append(i)
            least.append(value)
        else:
            ends[k], least[k] = i, value
    chain = [ends[-1]]
    while after[chain[-1]] >= 0:
        chain.append(after[chain[-1]])
    return chain


def find_jumps(time_s: Floats, along_m: Floats, speed_mps: Floats) -> Bools:
    """Points outside the longest chain of positions that one train can have had.

    Two points fit if their distance is the integral of the reported speeds between them, within 50 m, 5 s times the
    change of speed, and 2 %. If speeds are not reported, or contradict the positions around them, the speeds of the
    positions count instead, within the distance that an acceleration of 1 m/s² covers. The distance must also be within
    the train's top speed, and not lead back. The search is repeated until it drops nothing.
    """
    kept = np.arange(len(time_s))
    while len(kept) > 1:
        chain = longest_chain(_strays_of_positions(time_s[kept], along_m[kept], speed_mps[kept]), time_s[kept])
        if len(chain) == len(kept):
            break
        kept = kept[chain]
    jump = np.ones(len(time_s), dtype=bool)
    jump[kept] = False
    return jump


def find_frozen(time_s: Floats, along_m: Floats, speed_mps: Floats) -> Bools:
    """Points that repeat a position to the digit while the train moves: the receiver held its last position.

    The train moved if the next position is at least 50 m away, and at least half as far as the reported speeds (NaN:
    none) lead. If no other position follows, it moved if the positions before show an equally fast motion, because no
    train stops within one step. That also shows that it moved where speeds of 0 are reported.
    """
    frozen = np.zeros(len(time_s), dtype=bool)
    moving = speed_mps > WRONG_SPEED_MPS
    repeats = np.append(False, (np.diff(along_m) == 0) & moving[1:])
    for last_good, last in ((first - 1, end - 1) for first, end in stretches_of(repeats)):
        if np.all(along_m[last:] == along_m[last]):
            frozen[last_good + 1 :] |= _led_on(time_s, along_m, speed_mps, last_good)
            break
        run = slice(last_good, last + 2)
        told_m = np.trapezoid(np.nan_to_num(speed_mps[run]), time_s[run])
        if along_m[last + 1] - along_m[last] >= max(FROZEN_RATIO * told_m, JUMP_M):
            frozen[last_good + 1 : last + 1] = True
    zero = np.append(False, (np.diff(along_m) == 0) & (speed_mps[1:] == 0))
    for last_good, last in ((first - 1, end - 1) for first, end in stretches_of(zero)):
        if last_good == 0 or last == len(time_s) - 1:
            continue
        before_s, after_s = time_s[last_good] - time_s[last_good - 1], time_s[last + 1] - time_s[last]
        came_mps = (along_m[last_good] - along_m[last_good - 1]) / before_s
        led_m = np.median(along_m[last + 1 : last + 1 + STEPS_AROUND]) - along_m[last]
        if came_mps > WRONG_SPEED_MPS + CHANGE_MPS2 * before_s and led_m > JUMP_M + CHANGE_MPS2 / 2 * after_s**2:
            frozen[last_good + 1 : last + 1] = True
    return frozen


def positions_by_speeds(time_s: Floats, speed_mps: Floats, way_m: float) -> Floats | None:
    """Distances (m) from the first point to each by the integral of the reported speeds, scaled to the whole way.

    The speeds of the first and the last point may be unknown (NaN). None unless the speeds are at most 10 s apart and
    their integral is the way, within 5 % and 50 m. If it is not, speeds of 0 are left out as dropouts.
    """
    for known in (np.isfinite(speed_mps), np.nan_to_num(speed_mps) > 0):
        if not known.any() or np.diff(time_s[known], prepend=time_s[0], append=time_s[-1]).max() > LOST_S:
            continue
        speed = np.interp(time_s, time_s[known], speed_mps[known])
        led_m = np.append(0.0, np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time_s)))
        if led_m[-1] > 0 and abs(led_m[-1] - way_m) <= JUMP_M + LOST_RATIO * way_m:
            return np.asarray(led_m * way_m / led_m[-1])
    return None


def _led_on(time_s: Floats, along_m: Floats, speed_mps: Floats, last_good: int) -> bool:
    """Whether reported speeds lead 50 m past the last position, and earlier positions moved at least half as fast."""
    before = max(last_good - STEPS_AROUND, 0)
    if before == last_good:
        return False
    led_mps = (along_m[last_good] - along_m[before]) / (time_s[last_good] - time_s[before])
    told_m = np.trapezoid(np.nan_to_num(speed_mps[last_good:]), time_s[last_good:])
    fast = led_mps >= max(FROZEN_RATIO * speed_mps[last_good + 1], WRONG_SPEED_MPS)
    return bool(fast and told_m >= JUMP_M)


def _strays_of_positions(time_s: Floats, along_m: Floats, reported_mps: Floats) -> _Strays:
    speed = _speed_around(time_s, along_m)
    around_s = STEPS_AROUND * float(np.median(np.diff(time_s)))
    top = float(np.percentile(speed, TOP_SPEED_PERCENTILE)) + CHANGE_MPS2 * around_s
    told_m, untold_s = _told_by_speeds(time_s, speed, reported_mps)

    def strays(i: Ints, j: Any) -> Floats:
        dt, way_m = time_s[j] - time_s[i], along_m[j] - along_m[i]
        told, untold = told_m[j] - told_m[i], untold_s[j] - untold_s[i]
        off_m = np.abs(way_m - told - 0.5 * (speed[i] + speed[j]) * untold)
        unsure_m = np.where(untold < dt, LATE_S * np.abs(speed[j] - speed[i]) + SCALE_RATIO * told, 0.0)
        by_change = off_m / (JUMP_M + unsure_m + CHANGE_MPS2 * untold * (0.5 * untold + around_s))
        by_top_speed = (np.abs(way_m) - top * dt) / JUMP_M
        by_going_back = np.where(np.minimum(speed[i], speed[j]) > 0, -way_m / MAX_BACKWARD_M, 0.0)
        return np.asarray(np.maximum(np.maximum(by_change, by_top_speed), by_going_back))

    return strays


def _told_by_speeds(time_s: Floats, around_mps: Floats, reported_mps: Floats) -> tuple[Floats, Floats]:
    """Integral of trusted speeds (m), and time without them (s), from the first point to each point.

    The speeds of a step are trusted if both agree with the positions around them; speeds in gaps are not trusted.
    """
    off = np.abs(reported_mps - around_mps)  # NaN is not below anything
    told = off < np.maximum(WRONG_SPEED_MPS, WRONG_SPEED_RATIO * around_mps)
    both, steps = told[1:] & told[:-1], np.diff(time_s)
    both[find_gaps(time_s)] = False
    mean = np.where(both, 0.5 * (reported_mps[1:] + reported_mps[:-1]), 0.0)
    return np.append(0.0, np.cumsum(mean * steps)), np.append(0.0, np.cumsum(np.where(both, 0.0, steps)))


def longest_chain(strays: _Strays, time_s: Floats) -> list[int]:
    """Indices of the longest chain in which each point fits the previous one; dynamic programming over the last point.

    A point may follow one that is at most 120 points and 120 s earlier. Points left out between two points of the chain
    cost more the worse these two fit.
    """
    count = len(time_s)
    if np.all(strays(np.arange(count - 1), np.arange(1, count)) <= 1.0):
        return list(range(count))
    score, before = np.ones(count), np.full(count, -1)
    earliest = np.minimum(np.arange(count) - POINTS_BACK, np.searchsorted(time_s, time_s - LONGEST_JUMP_S))
    for j in range(1, count):
        i = np.arange(max(earliest[j], 0), j)
        off = strays(i, j)
        strayed = STRAY_WEIGHT * off**2 * (j - i - 1)
        value = np.where(off <= 1.0, score[i] + 1.0 - strayed - 0.5 / count * off, 0.0)
        best = int(value.argmax())
        if value[best] > score[j]:
            score[j], before[j] = value[best], i[best]
    chain = [int(score.argmax())]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return chain[::-1]


def _speed_around(time_s: Floats, along_m: Floats) -> Floats:
    """Speed (m/s) at each point: the median of the steps around it."""
    steps = np.diff(along_m) / np.diff(time_s)
    padded = np.concatenate((np.full(STEPS_AROUND, np.nan), steps, np.full(STEPS_AROUND, np.nan)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * STEPS_AROUND)
    return np.asarray(np.nanmedian(windows, axis=1), dtype=np.float64)


def derived_speed_mps(time_s: Floats, position_m: Floats, half_window_s: float = DERIVED_HALF_WINDOW_S) -> Floats:
    """Speed (m/s) from positions: their mean slope over 5 s (at least one point) on either side."""
    before = np.minimum(time_s - half_window_s, np.append(time_s[0], time_s[:-1]))
    after = np.maximum(time_s + half_window_s, np.append(time_s[1:], time_s[-1]))
    before, after = np.maximum(before, time_s[0]), np.minimum(after, time_s[-1])
    moved_m = np.interp(after, time_s, position_m) - np.interp(before, time_s, position_m)
    return np.asarray(moved_m / (after - before), dtype=np.float64)


def find_wrong_speeds(time_s: Floats, position_m: Floats, speed_mps: Floats) -> tuple[Bools, Bools]:
    """Dropouts and spikes: points whose reported speed is far below, or far above, the speed of the positions.

    Positions stall at times while the speed is right, so a spike must also be above their mean slope over 15 s.
    """
    derived = derived_speed_mps(time_s, position_m)
    higher = np.maximum(derived, derived_speed_mps(time_s, position_m, STALL_HALF_WINDOW_S))
    step = np.abs(np.diff(speed_mps))
    jump = (step > EDGE_MPS2 * np.diff(time_s)) | (step < SAME_MPS)
    unsure = _unsure_mps(time_s)
    dropouts = _with_edges(derived - speed_mps, derived, jump, unsure)
    spikes = _with_edges(speed_mps - higher, higher, jump, unsure)
    return dropouts, spikes & ~dropouts


def speeds_unusable(time_s: Floats, position_m: Floats, speed_mps: Floats) -> bool:
    """Whether most reported speeds of a moving train contradict its positions: in another unit, or no speeds at all."""
    derived = derived_speed_mps(time_s, position_m)
    moving = (derived > WRONG_SPEED_MPS) & np.isfinite(speed_mps)
    off = np.abs(derived - speed_mps) > np.maximum(WRONG_SPEED_MPS + _unsure_mps(time_s), WRONG_SPEED_RATIO * derived)
    return bool(2 * np.count_nonzero(off & moving) > np.count_nonzero(moving))


def find_halts(time_s: Floats, position_m: Floats, speed_mps: Floats) -> Bools:
    """Points with a reported speed of 0, which is 0 in any unit, at which the positions move slowly as well.

    No point counts if the reported speed is 0 at most of the points at which the positions move.
    """
    derived = derived_speed_mps(time_s, position_m)
    moving, zero = derived > WRONG_SPEED_MPS, speed_mps == 0
    if 2 * np.count_nonzero(moving & zero) > np.count_nonzero(moving):
        return np.zeros(len(time_s), dtype=bool)
    return np.asarray(zero & ~moving, dtype=np.bool_)


def _with_edges(off_mps: Floats, derived_mps: Floats, jump: Bools, unsure_mps: Floats) -> Bools:
    found = (off_mps > WRONG_SPEED_MPS + unsure_mps) & (off_mps > WRONG_SPEED_RATIO * derived_mps)
    while True:
        edge = np.zeros_like(found)
        edge[1:] |= found[:-1] & jump
        edge[:-1] |= found[1:] & jump
        edge &= ~found & (off_mps > EDGE_MPS)
        if not edge.any():
            return found
        found |= edge


def _unsure_mps(time_s: Floats) -> Floats:
    """Possible error (m/s) of the mean slope of positions next to a gap.

    In a gap of G seconds the speed may change by a·(G − 5 s)/2, half of it in the window of the slope.
    """
    steps = np.diff(time_s)
    longest = np.maximum(np.append(0.0, steps), np.append(steps, 0.0))
    return np.asarray(CHANGE_MPS2 * np.maximum(longest - DERIVED_HALF_WINDOW_S, 0.0) / 4.0)


def find_gaps(time_s: Floats) -> Ints:
    """Indices of the points after which a gap begins."""
    steps = np.diff(time_s)
    return np.flatnonzero(steps > min(max(GAP_S, GAP_STEPS * float(np.median(steps))), SPARSE_S))
