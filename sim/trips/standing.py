"""Where a train stood: runs of standing points, and the visits to a stop among them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from das.domain.route import Floats
from sim.trips import cleaning
from sim.trips.record import Bools
from sim.trips.settings import SPEEDS, STANDS


class Stand(NamedTuple):
    """A standstill: its first and its last point."""

    first: int
    last: int


def standing(speed_mps: Floats, from_positions: Bools) -> Bools:
    """Which points belong to a stand; `from_positions` marks speeds that were not reported."""
    return speed_mps < np.where(from_positions, STANDS.standing_by_positions_mps, STANDS.standing_mps)


def stood_through(time_s: Floats, along_m: Floats, still: Bools, untold: Bools) -> Bools:
    """Which points belong to a stand once seeming motion is taken away.

    `still` are points at which the train stands. Points without a speed (`untold`) stand as well if positions over 15 s
    on either side keep them in place, and so do all points between two stands within 30 m.
    """
    slow_mps = cleaning.derived_speed_mps(time_s, along_m, SPEEDS.stall_half_window_s)
    found = still | (untold & (np.abs(slow_mps) < STANDS.standing_by_positions_mps))
    for before, after in pairwise(stands(found)):
        between = slice(before.last, after.first + 1)
        if np.abs(along_m[between] - along_m[before.last]).max() <= STANDS.wander_m:
            found[between] = True
    return found


def slowed_to(time_s: Floats, along_m: Floats, untold: Bools) -> Floats:
    """Speed (m/s) at the first and the last point if positions slow down to a stand there, else NaN.

    Mean slopes are those of seconds before, so they show no stand in a record that ends as the train stops. The speed
    is therefore that of the parabola through the positions of 12 s, at an end whose speed is `untold`.
    """
    found = np.full(len(time_s), np.nan)
    for end in (0, -1):
        inwards_s = np.abs(time_s - time_s[end])
        near = inwards_s <= STANDS.led_window_s
        if not untold[end] or np.count_nonzero(near) < STANDS.led_points:
            continue
        way_m = (along_m[near] - along_m[end]) * (1.0 if end == 0 else -1.0)
        half_change, speed, _ = np.polyfit(inwards_s[near], way_m, 2)
        if abs(speed) <= STANDS.led_speed_mps and 2.0 * half_change >= STANDS.led_change_mps2:
            found[end] = max(speed, 0.0)
    return found


def left_over(speed_mps: float) -> tuple[float, float]:
    """How far (m) and how long (s) a train of this speed runs to its stand, or has run from it, at most."""
    return speed_mps**2 / (2.0 * STANDS.gentle_mps2), speed_mps / STANDS.gentle_mps2


def stands(standing_points: Bools) -> list[Stand]:
    """The standstills in order."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], standing_points, [False])).astype(np.int8)))
    return [Stand(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]


def visits(found: list[Stand], s_m: Floats, stop_m: float, *, last: bool) -> list[Stand]:
    """The standstill nearest to a stop in each visit to it; of two that are equally near, the first, or the `last`.

    A visit ends when the train is further away than 300 m.
    """
    nearest: list[Stand] = []
    seen_to = 0
    for stand in found:
        off = abs(s_m[stand.last] - stop_m)
        best_m = abs(s_m[nearest[-1].last] - stop_m) if nearest else np.inf
        if off > STANDS.at_stop_m:
            continue
        stayed = bool(nearest) and bool(np.all(np.abs(s_m[seen_to : stand.first] - stop_m) <= STANDS.at_stop_m))
        if not stayed:
            nearest.append(stand)
        elif (off <= best_m) if last else (off < best_m):
            nearest[-1] = stand
        seen_to = stand.last
    return nearest
