"""Where a train stood: runs of standing points, and the visits to a stop among them."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from das.domain.route import Floats
from das.domain.units import KMH
from sim.trips import cleaning
from sim.trips.record import Bools

STANDING_MPS = 1.0 * KMH
"""A train reported slower than this, and not moving by its positions, stands."""
STANDING_BY_POSITIONS_MPS = 0.5
"""The same where no speed is reported: positions wander by some metres in 10 s."""
WANDER_M = cleaning.MAX_BACKWARD_M
"""Positions of a train that stands wander by no more than this, and come back."""
LED_WINDOW_S, LED_POINTS = 12.0, 4
"""Whether positions slow down to a stand at an end of the record is judged by so many seconds, of so many points."""
LED_SPEED_MPS, LED_CHANGE_MPS2 = 2.0, 0.1
"""They do where they lead to no more than this speed there, and change it by this or more (their noise is less)."""
GENTLE_MPS2 = 0.3
"""So gently a train stops or starts at the least (assumption): v²/2a and v/a are what may be left of its motion."""
AT_STOP_M = 300.0
"""A train that stands this near to a stop stands at it: platforms are long, and maps inexact."""


class Stand(NamedTuple):
    """A standstill: its first and its last point."""

    first: int
    last: int


def standing(speed_mps: Floats, from_positions: Bools) -> Bools:
    """Points at which the train stands."""
    return speed_mps < np.where(from_positions, STANDING_BY_POSITIONS_MPS, STANDING_MPS)


def stood_through(time_s: Floats, along_m: Floats, still: Bools, untold: Bools) -> Bools:
    """The points at which a train stands (`still`), with those at which it only seems to move: the `untold` ones,
    without a speed, that positions over 15 s either side keep in place; and all between two stands within 30 m."""
    slow_mps = cleaning.derived_speed_mps(time_s, along_m, cleaning.STALL_HALF_WINDOW_S)
    found = still | (untold & (np.abs(slow_mps) < STANDING_BY_POSITIONS_MPS))
    for before, after in pairwise(stands(found)):
        between = slice(before.last, after.first + 1)
        if np.abs(along_m[between] - along_m[before.last]).max() <= WANDER_M:
            found[between] = True
    return found


def slowed_to(time_s: Floats, along_m: Floats, untold: Bools) -> Floats:
    """Speed (m/s) at the first and at the last point where positions slow down to a stand there, NaN elsewhere.

    Mean slopes are those of seconds before: a record that ends as the train stops shows no stand by them. So the speed
    is that of the parabola through the positions of 12 s, at an end whose speed is `untold`.
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
    """How far (m) and how long (s) a train of this speed still runs to its stand, or has run from it, at the most."""
    return speed_mps**2 / (2.0 * GENTLE_MPS2), speed_mps / GENTLE_MPS2


def stands(standing_points: Bools) -> list[Stand]:
    """The standstills in order."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], standing_points, [False])).astype(np.int8)))
    return [Stand(int(first), int(end) - 1) for first, end in edges.reshape(-1, 2)]


def visits(found: list[Stand], s_m: Floats, stop_m: float, *, last: bool) -> list[Stand]:
    """Of each visit to a stop the standstill nearest to it, of two as near the first or the `last`.

    A visit ends when the train is further away than 300 m.
    """
    nearest: list[Stand] = []
    seen_to = 0
    for stand in found:
        off = abs(s_m[stand.last] - stop_m)
        best_m = abs(s_m[nearest[-1].last] - stop_m) if nearest else np.inf
        if off > AT_STOP_M:
            continue
        stayed = bool(nearest) and bool(np.all(np.abs(s_m[seen_to : stand.first] - stop_m) <= AT_STOP_M))
        if not stayed:
            nearest.append(stand)
        elif (off <= best_m) if last else (off < best_m):
            nearest[-1] = stand
        seen_to = stand.last
    return nearest
