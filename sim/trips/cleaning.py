"""What does not fit in a record: times out of order, positions a train cannot have been at, speeds it did not run.

The functions judge; `matching` does what follows from it.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from typing import Any

import numpy as np

from das.domain.errors import DasError
from das.domain.route import Floats
from das.domain.units import NS
from sim.trips.findings import FindingLog, Kind
from sim.trips.record import Bools, Ints, Record

JUMP_M = 50.0
"""A position further than this from where its neighbours lead is a jump, unless there was time to change the speed."""
MAX_BACKWARD_M = 30.0
"""Steps back up to this are noise; longer ones are a train that turned, or jumps where it drives on."""
CHANGE_MPS2 = 1.0
"""Change of speed a train is given credit for while it is not seen: full braking, the most there is in service."""
STEPS_AROUND = 5
"""The speed that neighbours tell is the median of this many steps either side."""
FROZEN_RATIO = 0.5
"""Reported speeds that explain this share of the way after a frozen position were right."""
LATE_S, SCALE_RATIO = 5.0, 0.02
"""The way that reported speeds tell is off by a speed that comes so late, and by this share of itself."""
POINTS_BACK, LONGEST_JUMP_S = 120, 120.0
"""So many points, or so long, may be wrong for the right ones on either side to be found to belong together."""
STRAY_WEIGHT = 3.0
"""A point left out under a step that just fits costs this much besides itself, so that a train is not taken to brake
and speed up again, at the most there is, to get onto a part that is wrong as a whole and off it."""
DERIVED_HALF_WINDOW_S = 5.0
"""Speed from positions is their mean slope over this time either side; GPS positions catch up only after seconds."""
STALL_HALF_WINDOW_S = 15.0
"""Positions that stall have caught up within this time."""
WRONG_SPEED_MPS, WRONG_SPEED_RATIO = 4.0, 0.2
"""A reported speed is wrong where it is off the speed from positions by both; more than delay (3 s at 1 m/s²)."""
EDGE_MPS, EDGE_MPS2, SAME_MPS = 1.0, 1.5, 0.05
"""Next to a wrong speed, one still off by the first belongs to it that jumps faster than the second, or is the same."""
GAP_S, GAP_STEPS, SPARSE_S = 5.0, 3.0, 30.0
"""Longer than both this time and so many usual steps without a point is a gap; longer than the last in any record."""
TOP_SPEED_PERCENTILE = 99.0
"""The top speed of a trip is this percentile of the speeds around its points: a few may be wrong."""
LEAST_KEPT_RATIO = 0.5
"""This share of a record's points must fit together (or those that do cover this share of the section)."""
_Strays = Callable[[Ints, Any], Floats]
"""How far earlier points i and a later point j, or one for each, are from fitting each other: 1 just fits."""


def in_order(record: Record, log: FindingLog) -> Record:
    """The record with times that increase: each time once (its first point), the fewest others dropped.

    A file that mostly runs backwards is turned round first. Raises DasError where no two times increase.
    """
    steps = np.diff(record.time_ns)
    if np.count_nonzero(steps < 0) > np.count_nonzero(steps > 0):
        log.add(Kind.NEWEST_FIRST, record, [0], f"{np.count_nonzero(steps < 0)} of {len(steps)} steps go back")
        record = record.take(slice(None, None, -1))
    again = np.ones(len(record), dtype=bool)
    again[np.unique(record.time_ns, return_index=True)[1]] = False
    log.add(Kind.DUPLICATE_TIME, record, again, "same time as a point before")
    record = record.take(~again)
    back = np.ones(len(record), dtype=bool)
    back[_longest_rise(record.time_ns)] = False
    if np.count_nonzero(~back) < LEAST_KEPT_RATIO * len(back):
        raise DasError(
            f"{record.source}: the times are in disorder: only {np.count_nonzero(~back)} of {len(back)} points are in "
            "order, sort the file by time if it was shuffled"
        )
    log.add(Kind.TIME_BACK, record, back, _most_back(record.time_ns))
    record = record.take(~back)
    if len(record) < 2:
        raise DasError(f"{record.source}: all points have one time, expected times that increase")
    return record


def _most_back(time_ns: Ints) -> str:
    back_s = (np.maximum.accumulate(time_ns) - time_ns).max() * NS
    return f"up to {back_s:.4g} s back"


def _longest_rise(values: Ints) -> list[int]:
    """Indices of a longest strictly increasing subsequence; of two neighbours in the wrong order the first is in it.

    Patience sorting, from the end: `ends[k]` is the index of the greatest value (`least` holds it negated) from which
    a rise of k + 1 goes on.
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
    """Points that do not belong to the longest run of positions one train can have had.

    Two points fit where their distance is that of the reported speeds (NaN where there are none) between them, within
    50 m, the way of 5 s of their change and 2 %; where those are not the speeds that the positions around tell, that of
    the latter, within what a change of speed by 1 m/s² makes of it. It is no more than the train's top speed allows,
    and not back. Again until nothing is left to drop.
    """
    kept = np.arange(len(time_s))
    while len(kept) > 1:
        chain = _longest_chain(_strays_of_positions(time_s[kept], along_m[kept], speed_mps[kept]), time_s[kept])
        if len(chain) == len(kept):
            break
        kept = kept[chain]
    jump = np.ones(len(time_s), dtype=bool)
    jump[kept] = False
    return jump


def find_frozen(time_s: Floats, along_m: Floats, speed_mps: Floats) -> Bools:
    """Points that repeat a position to the digit while the train moves: the receiver held its last fix.

    The reported speeds (NaN where there are none) are believed where the next position is over 50 m away and bears
    them out by half at least; where none follows, where the positions led there as fast: no train stops within a step.
    """
    frozen = np.zeros(len(time_s), dtype=bool)
    moving = speed_mps > WRONG_SPEED_MPS
    repeats = np.append(False, (np.diff(along_m) == 0) & moving[1:])
    edges = np.flatnonzero(np.diff(np.concatenate((repeats, [False])).astype(np.int8)))
    for last_good, last in edges.reshape(-1, 2):
        if np.all(along_m[last:] == along_m[last]):
            frozen[last_good + 1 :] |= _led_on(time_s, along_m, speed_mps, int(last_good))
            break
        run = slice(last_good, last + 2)
        told_m = np.trapezoid(np.nan_to_num(speed_mps[run]), time_s[run])
        if along_m[last + 1] - along_m[last] >= max(FROZEN_RATIO * told_m, JUMP_M):
            frozen[last_good + 1 : last + 1] = True
    return frozen


def _led_on(time_s: Floats, along_m: Floats, speed_mps: Floats, last_good: int) -> bool:
    """Whether speeds lead over 50 m on from a last position, and positions led there at half that speed or more."""
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
    """Way (m) and time (s) up to each point: the way of the steps whose reported speeds are those of the positions
    around, the time of the others and of gaps."""
    off = np.abs(reported_mps - around_mps)  # NaN is not below anything
    told = off < np.maximum(WRONG_SPEED_MPS, WRONG_SPEED_RATIO * around_mps)
    both, steps = told[1:] & told[:-1], np.diff(time_s)
    both[find_gaps(time_s)] = False
    mean = np.where(both, 0.5 * (reported_mps[1:] + reported_mps[:-1]), 0.0)
    return np.append(0.0, np.cumsum(mean * steps)), np.append(0.0, np.cumsum(np.where(both, 0.0, steps)))


def _longest_chain(strays: _Strays, time_s: Floats) -> list[int]:
    """Indices of the longest chain in which each point fits the one before, at most 120 points or 120 s back; a point
    left out costs more the further the step over it strays. Dynamic programming over the last point."""
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
    """Speed at each point by the median of the steps around it."""
    steps = np.diff(along_m) / np.diff(time_s)
    padded = np.concatenate((np.full(STEPS_AROUND, np.nan), steps, np.full(STEPS_AROUND, np.nan)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * STEPS_AROUND)
    return np.asarray(np.nanmedian(windows, axis=1), dtype=np.float64)


def derived_speed_mps(time_s: Floats, position_m: Floats, half_window_s: float = DERIVED_HALF_WINDOW_S) -> Floats:
    """Speed from positions: mean slope over 5 s (at least one point) either side, one-sided at the ends."""
    before = np.minimum(time_s - half_window_s, np.append(time_s[0], time_s[:-1]))
    after = np.maximum(time_s + half_window_s, np.append(time_s[1:], time_s[-1]))
    before, after = np.maximum(before, time_s[0]), np.minimum(after, time_s[-1])
    moved_m = np.interp(after, time_s, position_m) - np.interp(before, time_s, position_m)
    return np.asarray(moved_m / (after - before), dtype=np.float64)


def find_wrong_speeds(time_s: Floats, position_m: Floats, speed_mps: Floats) -> tuple[Bools, Bools]:
    """Dropouts and spikes: points whose reported speed is far below or above that from positions.

    Positions stall at times while the speed is right, so a spike must be above their mean slope over 15 s as well.
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
    """Whether most reported speeds of a moving train are not those of its positions: in another unit, or not there."""
    derived = derived_speed_mps(time_s, position_m)
    moving = (derived > WRONG_SPEED_MPS) & np.isfinite(speed_mps)
    off = np.abs(derived - speed_mps) > np.maximum(WRONG_SPEED_MPS + _unsure_mps(time_s), WRONG_SPEED_RATIO * derived)
    return bool(2 * np.count_nonzero(off & moving) > np.count_nonzero(moving))


def find_halts(time_s: Floats, position_m: Floats, speed_mps: Floats) -> Bools:
    """Points with a speed of 0, which is 0 in any unit, at which positions are slow too; none where the speed of most
    points that move is 0."""
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
    """How far beside a gap the mean slope may be off: a gap of G lets the speed change by a·(G − 5 s)/2, half of it
    is in the window."""
    steps = np.diff(time_s)
    longest = np.maximum(np.append(0.0, steps), np.append(steps, 0.0))
    return np.asarray(CHANGE_MPS2 * np.maximum(longest - DERIVED_HALF_WINDOW_S, 0.0) / 4.0)


def find_gaps(time_s: Floats) -> Ints:
    """Indices of the points before a gap."""
    steps = np.diff(time_s)
    return np.flatnonzero(steps > min(max(GAP_S, GAP_STEPS * float(np.median(steps))), SPARSE_S))
