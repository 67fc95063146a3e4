"""Numba kernels of the last word: the curve of full braking, and the motion of a driver who follows what is shown.

The braking model is three arrays and two numbers. `nodes` are the positions (m) that bound the intervals of the line.
`places` has one column for each interval and the rows `LIMIT` to `BOUND`. `forces` has one column for each speed
i / `STEPS_PER_MPS` (m/s) and the rows `TRACTION` to `RUNNING`. The numbers are the train's inertial mass (kg) and
`most`, its largest deceleration (m/s²).
"""

from __future__ import annotations

import math

import numpy as np

from das.advice.regimes import FULL_RATIO
from das.compiling import kernel

STEPS_PER_MPS = 10.0
"""Speeds per m/s at which forces are tabulated."""
STEP_S = 0.5
"""Time step (s) of the simulated motion of the train."""
HELD_ABOVE_MPS = 1.0
"""Largest excess (m/s) over the allowed speed at which advice to hold a lower speed, not to brake, is safe."""
BACK_IN_S = 5.0
"""Time (s) in which strong enough braking brings a train back under a limit."""
STOPPED_MPS = 0.1
"""Speed (m/s) below which a train counts as standing."""

LIMIT, LINE, MOTORS, ALLOWED, BOUND, PLACES = 0, 1, 2, 3, 6, 9
"""Rows of `places`: the limit over the train (m/s), the deceleration by gradient and curves (m/s²), and whether the
motors can brake (1 or 0); then three rows for the allowed speeds, and three for the bounds, which include tolerances:
the square of the speed at the beginning of the interval, at its end, and the highest in it (m²/s²)."""
TRACTION, ELECTRIC, MOST, BRAKE, BRAKE_WITHOUT_MOTORS, RUNNING = 0, 1, 2, 3, 4, 5
"""Rows of `forces` (N): the largest traction, the largest electric brake, the largest force of all brakes, full braking
with motors and without them, and the running resistance."""


@kernel
def interval(nodes, s):
    """Index of the interval that contains a position; before the nodes the first, beyond them the last."""
    low, high = 0, nodes.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle] <= s:
            low = middle
        else:
            high = middle
    return low


@kernel
def highest_limit(nodes, places, start, end):
    """The highest limit (m/s) with the head of the train anywhere between two positions."""
    i = interval(nodes, start)
    highest = places[LIMIT, i]
    while i + 1 < nodes.size - 1 and nodes[i + 1] <= end:
        i += 1
        highest = max(highest, places[LIMIT, i])
    return highest


@kernel
def speed_at(nodes, places, row, s):
    """The highest speed (m/s) at a position, by the curve in `row`: `ALLOWED`, or `BOUND` with tolerances."""
    i = interval(nodes, s)
    share = min(max((s - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0), 1.0)
    w = places[row, i] + (places[row + 1, i] - places[row, i]) * share
    return math.sqrt(min(w, places[row + 2, i]))


@kernel
def force_at(forces, row, v):
    """The force (N) of a row of `forces` at a speed."""
    return forces[row, min(int(v * STEPS_PER_MPS + 0.5), forces.shape[1] - 1)]


@kernel
def resisting(nodes, places, forces, mass, s, v):
    """The resistance (N) at a position and speed: running resistance, gradient and curves."""
    return force_at(forces, RUNNING, v) + places[LINE, interval(nodes, s)] * mass


@kernel
def full_brake(nodes, places, forces, mass, most, s, v):
    """The force (N, >= 0) of full braking at a position and speed."""
    row = BRAKE if places[MOTORS, interval(nodes, s)] > 0.0 else BRAKE_WITHOUT_MOTORS
    return max(min(force_at(forces, row, v), most * mass - resisting(nodes, places, forces, mass, s, v)), 0.0)


@kernel
def fill_curve(nodes, places, forces, mass, most, row):
    """Fill in the curve `ALLOWED` or `BOUND`: the highest speeds from which full braking obeys the curve's third row.

    The curve is computed backwards from the last node, where the train stands. Over a step of length h, v² grows by 2·h
    times the mean deceleration of its two ends (Heun).
    """
    w = 0.0
    for i in range(nodes.size - 2, -1, -1):
        step = nodes[i + 1] - nodes[i]
        w = min(w, places[row + 2, i])
        places[row + 1, i] = w
        later = _deceleration(places, forces, mass, most, i, w)
        w = max(w + step * (later + _deceleration(places, forces, mass, most, i, w + 2.0 * step * later)), 0.0)
        places[row, i] = w
        w = min(w, places[row + 2, i])


@kernel
def _deceleration(places, forces, mass, most, i, w):
    """The deceleration (m/s²) of full braking at v² = w: at most `most`, unless the gradient alone slows the train
    more."""
    x = min(math.sqrt(max(w, 0.0)) * STEPS_PER_MPS, forces.shape[1] - 1.001)
    k = int(x)
    row = BRAKE if places[MOTORS, i] > 0.0 else BRAKE_WITHOUT_MOTORS
    before, after = forces[row, k] + forces[RUNNING, k], forces[row, k + 1] + forces[RUNNING, k + 1]
    rate = (before + (x - k) * (after - before)) / mass + places[LINE, i]
    return min(rate, max(most, places[LINE, i]))


@kernel
def asked(forces, doing, v):
    """The force (N) of an instruction at a speed; a braking force may be scaled with the electric brake."""
    grows = doing[1] < 0.0 and doing[4] > 0.0
    return doing[1] * force_at(forces, ELECTRIC, v) / doing[4] if grows else doing[1]


@kernel
def after_step(nodes, places, forces, mass, doing, s, v):
    """The speed (m/s) one time step later if the driver follows `doing`, a row of the `doings` of `first_excess`."""
    force, goal, holds = asked(forces, doing, v), doing[2], doing[3] > 0.0
    faster = v >= goal
    if holds:
        force = -np.inf if faster else (force if force > 0.0 else np.inf)
    elif force > 0.0 and faster:
        force = 0.0
    force = min(max(force, -force_at(forces, MOST, v)), force_at(forces, TRACTION, v))
    after = v + (force - resisting(nodes, places, forces, mass, s, v)) / mass * STEP_S
    if (holds and faster) or force < 0.0:
        return max(after, min(goal, v), 0.0)
    if holds or force > 0.0:
        after = min(after, goal)
    return max(after, 0.0)


@kernel
def first_excess(nodes, places, forces, mass, most, doings, s, v, since, lasts):
    """The first speed (m/s) above the bound at its place if the driver follows `doings`, and that bound (m/s).

    Returns -1, -1 if there is none between the times `since` and `lasts` (s). A row of `doings` holds the time until
    which it applies (s), a wheel force (N), the speed to reach with it (m/s), whether to hold that speed (1 or 0), and
    the electric brake at its beginning (N); if that is above 0, a braking force is scaled with the electric brake.

    A train above its bound is not counted if the instruction corrects that. Holding a speed up to the bound suffices
    if the train exceeds what is allowed by at most `HELD_ABOVE_MPS`. Otherwise the share `FULL_RATIO` of full braking
    suffices or, where the limit itself is what is allowed, slowing down to it within `BACK_IN_S`; and trains slower
    than `STOPPED_MPS` are not counted.
    """
    k = 0
    for step in range(math.ceil(lasts / STEP_S) + 1):
        while k + 1 < doings.shape[0] and (step + 0.5) * STEP_S > doings[k, 0]:
            k += 1
        bound, doing = speed_at(nodes, places, BOUND, s), doings[k]
        after = after_step(nodes, places, forces, mass, doing, s, v)
        if v > bound and step * STEP_S >= since:
            allowed = speed_at(nodes, places, ALLOWED, s)
            if doing[3] > 0.0:
                suffices = doing[2] <= bound and v <= allowed + HELD_ABOVE_MPS
            else:
                full = full_brake(nodes, places, forces, mass, most, s, v)
                level = allowed >= places[LIMIT, interval(nodes, s)] - 1e-9
                comes_back = level and v - after >= (v - allowed) * STEP_S / BACK_IN_S
                all_given = full > 0.0 and asked(forces, doing, v) <= -FULL_RATIO * full
                suffices = v < STOPPED_MPS or (v > doing[2] and (comes_back or all_given))
            if not suffices:
                return v, bound
        s, v = s + 0.5 * (v + after) * STEP_S, after
    return -1.0, -1.0


@kernel
def keep_horizon(nodes, places, speeds, s, before, slack, kept):
    """Fill in `kept`: the speeds of a horizon (1 s apart), each lowered to what is allowed if it exceeds its bound.

    Both apply where the speed leads; a negative one becomes 0. Returns index (-1: none) and bound of the first changed.
    """
    first, first_bound = -1, -1.0
    for n in range(speeds.size):
        there = s + 0.5 * (before + speeds[n])
        bound = speed_at(nodes, places, BOUND, there) + slack
        kept[n] = speeds[n]
        if not 0.0 <= speeds[n] <= bound:
            kept[n] = min(max(speeds[n], 0.0), speed_at(nodes, places, ALLOWED, there))
            there = s + 0.5 * (before + kept[n])
            if first < 0:
                first, first_bound = n, bound
        s, before = there, kept[n]
    return first, first_bound
