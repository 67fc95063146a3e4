"""What does not fit in a record: times out of order, positions a train cannot have been at, speeds it did not run.

The functions judge; `matching` does what follows from it.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable

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
POINTS_BACK, LONGEST_JUMP_S = 120, 120.0
"""So many points, or so long, may be wrong for the right ones on either side to be found to belong together."""
DERIVED_HALF_WINDOW_S = 5.0
"""Speed from positions is their mean slope over this time either side; GPS positions catch up only after seconds."""
STALL_HALF_WINDOW_S = 15.0
"""Positions that stall have caught up within this time."""
WRONG_SPEED_MPS, WRONG_SPEED_RATIO = 4.0, 0.2
"""A reported speed is wrong where it is off the speed from positions by both; more than delay (3 s at 1 m/s²)."""
EDGE_MPS, EDGE_MPS2 = 1.0, 1.5
"""Next to a wrong speed, one still off by the first that jumps faster than the second belongs to it."""
GAP_S, GAP_STEPS = 5.0, 3.0
"""Longer than both this time and so many usual steps without a point is a gap."""
TOP_SPEED_PERCENTILE = 99.0
"""The top speed of a trip is this percentile of the speeds around its points: a few may be wrong."""
LEAST_KEPT_RATIO = 0.5
"""This share of a record's points must fit together (or those that do cover this share of the section)."""
_Strays = Callable[[Ints, int], Floats]
"""How far earlier points i and a later point j are from fitting each other: 1 is the most that fits."""


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


def find_jumps(time_s: Floats, along_m: Floats) -> Bools:
    """Points that do not belong to the longest run of positions one train can have had.

    Two points fit where their distance is that of the speed around them, within 50 m and what a change of speed by
    1 m/s² makes of it in the time between, no more than the train's top speed allows, and not back; again until nothing
    is left to drop.
    """
    kept = np.arange(len(time_s))
    while len(kept) > 1:
        chain = _longest_chain(_strays_of_positions(time_s[kept], along_m[kept]), time_s[kept])
        if len(chain) == len(kept):
            break
        kept = kept[chain]
    jump = np.ones(len(time_s), dtype=bool)
    jump[kept] = False
    return jump


def find_frozen(time_s: Floats, along_m: Floats, speed_mps: Floats) -> Bools:
    """Points that repeat a position to the digit while the train moves: the receiver held its last fix.

    The reported speeds (NaN where there are none) are believed where the next position is over 50 m away and bears
    them out by half at least.
    """
    frozen = np.zeros(len(time_s), dtype=bool)
    moving = speed_mps > WRONG_SPEED_MPS
    repeats = np.append(False, (np.diff(along_m) == 0) & moving[1:])
    edges = np.flatnonzero(np.diff(np.concatenate((repeats, [False])).astype(np.int8)))
    for last_good, last in edges.reshape(-1, 2):
        if last + 1 == len(time_s):
            continue
        run = slice(last_good, last + 2)
        told_m = np.trapezoid(np.nan_to_num(speed_mps[run]), time_s[run])
        if along_m[last + 1] - along_m[last] >= max(FROZEN_RATIO * told_m, JUMP_M):
            frozen[last_good + 1 : last + 1] = True
    return frozen


def _strays_of_positions(time_s: Floats, along_m: Floats) -> _Strays:
    speed = _speed_around(time_s, along_m)
    around_s = STEPS_AROUND * float(np.median(np.diff(time_s)))
    top = float(np.percentile(speed, TOP_SPEED_PERCENTILE)) + CHANGE_MPS2 * around_s

    def strays(i: Ints, j: int) -> Floats:
        dt, way_m = time_s[j] - time_s[i], along_m[j] - along_m[i]
        off_m = np.abs(way_m - 0.5 * (speed[i] + speed[j]) * dt)
        by_change = off_m / (JUMP_M + CHANGE_MPS2 * dt * (0.5 * dt + around_s))
        by_top_speed = np.abs(way_m) / (JUMP_M + top * dt)
        by_going_back = np.where(np.minimum(speed[i], speed[j]) > 0, -way_m / MAX_BACKWARD_M, 0.0)
        return np.asarray(np.maximum(np.maximum(by_change, by_top_speed), by_going_back))

    return strays


def _longest_chain(strays: _Strays, time_s: Floats) -> list[int]:
    """Indices of the longest chain in which each point fits the one before, at most 120 points or 120 s back; of two
    as long, the one that strays less. Dynamic programming over the last point."""
    count = len(time_s)
    score, before = np.ones(count), np.full(count, -1)
    earliest = np.minimum(np.arange(count) - POINTS_BACK, np.searchsorted(time_s, time_s - LONGEST_JUMP_S))
    for j in range(1, count):
        i = np.arange(max(earliest[j], 0), j)
        off = strays(i, j)
        value = np.where(off <= 1.0, score[i] + 1.0 - 0.5 / count * off, 0.0)
        best = int(value.argmax())
        if value[best] > 0:
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
    jump = np.abs(np.diff(speed_mps)) > EDGE_MPS2 * np.diff(time_s)
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
    return np.flatnonzero(steps > max(GAP_S, GAP_STEPS * float(np.median(steps))))
