"""The reduced maximum speed: the one top speed with which a train that brakes gently keeps the timetable.

A display shows it in whole steps, as a staircase that goes down where braking for a lower speed begins.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.advice import kernels
from das.advice.goal import LONGEST_RATIO
from das.advice.planner import BRAKED_EARLY_S
from das.advice.shown import steady_step, step_below
from das.domain.units import KMH, NS
from das.solver.kernels.driving import FULL_BRAKES, braking_envelope
from das.solver.kernels.forces import largest_gain, mean_resistance, on_supply
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.kernels.tuples import LineArrays
from das.solver.section import Section

EASY_BRAKING_MPS2: Final = 0.5
"""The deceleration of comfortable service braking (assumption)."""
JUDGED_EVERY_S: Final = 30.0
"""Interval (s) at which the reduced maximum speed is computed."""
SLOWEST_MPS: Final = 20.0 * KMH
"""Lowest speed shown (m/s), except under a lower limit and in the last metres before a stop, where it is halved, if
need be several times."""
HALVINGS: Final = 12
"""Halvings of an interval that find the reduced maximum speed."""
BELOW_RATIO: Final = 0.999
"""Divisor of the allowed speed from which the computation starts for a train faster than comfortable braking allows."""

Floats = NDArray[np.float64]
LEVEL_MPS = 1e-6
"""Fall over an interval (m/s) below which a curve counts as level."""


class Staircase:
    """The top speed to show at each position of a section, under a curve of gentle braking.

    The speed shown is never above the limit over the train, nor above the curve. Where it would be above the curve,
    the speed at the foot of the curve is shown instead: the next lower limit, or before a stop the slowest
    speed. The speed 0 of a stop itself is not shown: the driver finds the mark without the display, and a train
    that stands short of the mark must still be able to move up. In the last metres, where full braking from the slowest
    speed would no longer stop the train at the mark, that speed is halved as often as it takes.

    A train may be so much slower than the curve that speeding up saves time. Then it is shown a speed that it can reach
    before it must brake, until the curve has fallen to that speed.
    """

    def __init__(self, section: Section, curve_mps: Floats, braking_mps2: float) -> None:
        self._section, self._braking_mps2 = section, braking_mps2
        self._falls = np.diff(curve_mps) < -LEVEL_MPS
        # Where the curve rises, because the limit does, the interval already has the speed of the next one's start.
        starts = np.where(self._falls, curve_mps[:-1], curve_mps[1:])
        self._start_w, self._end_w = starts**2, curve_mps[1:] ** 2
        self._foot_mps, self._full_w = _feet(self._falls, curve_mps[1:]), section.envelope_mps**2
        self._judged_mps = self._shown_mps = math.nan

    def at(self, s_m: float, v_mps: float, judged_mps: float) -> float:
        """The speed to show (m/s) to a train in a state; `judged_mps` is its reduced maximum speed."""
        i = int(kernels.interval(self._section.node_m, s_m))
        limit_mps = float(self._section.limit_mps[i])
        free_mps = min(self._held(judged_mps), step_below(limit_mps))
        curve_mps = self.curve_mps(s_m)
        # The speed shown to a train that is slowing down does not rise while the train is still above the new speed.
        slows = self._falls[i] and v_mps > free_mps > self._shown_mps
        if curve_mps >= free_mps:
            self._shown_mps = self._shown_mps if slows else free_mps
        else:
            foot_mps = min(self._foot(i, s_m), free_mps)
            if not foot_mps < self._shown_mps <= min(curve_mps, free_mps):
                reached_mps = self._worth_reaching(i, v_mps, curve_mps)
                self._shown_mps = max(foot_mps, min(step_below(reached_mps), free_mps))
        return min(self._shown_mps, limit_mps)

    def curve_mps(self, s_m: float) -> float:
        """The highest speed (m/s) at a place from which gentle braking keeps every limit and stop ahead."""
        section = self._section
        i = int(kernels.interval(section.node_m, s_m))
        share = min(max((s_m - section.node_m[i]) / (section.node_m[i + 1] - section.node_m[i]), 0.0), 1.0)
        return math.sqrt(self._start_w[i] + (self._end_w[i] - self._start_w[i]) * share)

    def _held(self, judged_mps: float) -> float:
        """The reduced maximum speed in whole steps, which changes only when `judged_mps` has clearly changed."""
        self._judged_mps = steady_step(judged_mps, self._judged_mps)
        return self._judged_mps

    def _foot(self, i: int, s_m: float) -> float:
        """The speed to show on a falling curve: the limit at the foot of the curve, or before a stop a slow speed."""
        foot_mps = float(self._foot_mps[i])
        return step_below(foot_mps) if foot_mps > 0 else self._slow_mps(s_m)

    def _slow_mps(self, s_m: float) -> float:
        """The slowest speed shown, halved until full braking from it stops the train at the mark."""
        full_mps = math.sqrt(kernels.linear(self._section.node_m, self._full_w, s_m))
        speed_mps = SLOWEST_MPS
        while speed_mps > full_mps and speed_mps > 0:
            speed_mps = step_below(0.5 * speed_mps)
        return speed_mps

    def _worth_reaching(self, i: int, v_mps: float, curve_mps: float) -> float:
        """The speed (m/s) that a train can reach before it must brake; 0 if speeding up to it saves too little time.

        With the train's speed v, the curve's speed c here, acceleration a and braking b, the train reaches
        u² = (b·v² + a·c²)/(a + b), over a distance of (c² − v²)/(2b), in the time (u − v)·(1/a + 1/b).
        """
        gain, braking = self._acceleration_mps2(i, curve_mps), self._braking_mps2
        if v_mps >= curve_mps or gain <= 0:
            return 0.0
        reached = math.sqrt((braking * v_mps**2 + gain * curve_mps**2) / (gain + braking))
        way_m = (curve_mps**2 - v_mps**2) / (2.0 * braking)
        takes_s = (reached - v_mps) * (1.0 / gain + 1.0 / braking)
        saves_s = way_m / v_mps - takes_s if v_mps > 0 else math.inf
        return reached if saves_s >= BRAKED_EARLY_S else 0.0

    def _acceleration_mps2(self, i: int, v_mps: float) -> float:
        """The acceleration (m/s²) that full traction gives in an interval at a speed."""
        line = self._section.for_kernels
        here = on_supply(self._section.train, float(line.supply[i]))
        resisting_n = mean_resistance(v_mps, v_mps, float(line.tunnel_n_per_mps2[i]), here) + float(line.constant_n[i])
        return float(largest_gain(v_mps, resisting_n, here))


def _feet(falls: NDArray[np.bool_], ends_mps: Floats) -> Floats:
    """For each interval of a curve, the speed at the foot of the falling part that it is in or that follows it."""
    feet = ends_mps.copy()
    for i in range(len(falls) - 2, -1, -1):
        if falls[i + 1]:
            feet[i] = feet[i + 1]
    return feet


class ReducedSpeed:
    """The reduced maximum speed of a section: the one top speed with which the train keeps the timetable.

    It is computed at the departure and again at regular intervals, and is constant in between.
    """

    def __init__(self, section: Section) -> None:
        easy_mps2 = min(EASY_BRAKING_MPS2, section.train.max_deceleration_mps2)
        easy = section.train._replace(max_deceleration_mps2=easy_mps2)
        ceiling, _ = braking_envelope(section.for_kernels, section.limit_mps, section.end_speed_mps, easy, FULL_BRAKES)
        # On a descent where such gentle braking is not enough, the envelope of the section counts.
        self._ceiling_mps = np.minimum(np.maximum(ceiling, section.floor_mps), section.envelope_mps)
        self._section = section
        self._staircase = Staircase(section, self._ceiling_mps, easy_mps2)
        self._judged_ns, self._for_ns, self._speed_mps = 0, 0, math.nan

    def shown_mps(self, s_m: float, v_mps: float, now_ns: int, arrival_ns: int) -> float:
        """The top speed to show (m/s): the reduced maximum speed, or a lower one that applies here or ahead."""
        return self._staircase.at(s_m, v_mps, self.judged_mps(s_m, v_mps, now_ns, arrival_ns))

    def judged_mps(self, s_m: float, v_mps: float, now_ns: int, arrival_ns: int) -> float:
        """The reduced maximum speed (m/s) for the rest of the section; computed again only if the last one is old."""
        age_s = (now_ns - self._judged_ns) * NS
        if math.isnan(self._speed_mps) or arrival_ns != self._for_ns or not 0 <= age_s < JUDGED_EVERY_S:
            before_mps = self._speed_mps if arrival_ns == self._for_ns else math.nan
            self._judged_ns, self._for_ns = now_ns, arrival_ns
            self._speed_mps = self._judged(s_m, v_mps, (arrival_ns - now_ns) * NS, before_mps)
        return self._speed_mps

    def _judged(self, s_m: float, v_mps: float, left_s: float, before_mps: float) -> float:
        low, high = SLOWEST_MPS, max(float(self._ceiling_mps.max()), SLOWEST_MPS)
        least_s = self.time_s(s_m, v_mps, high)
        if least_s >= left_s:
            return high
        ample = left_s > LONGEST_RATIO * least_s
        if ample and not math.isnan(before_mps):
            return before_mps
        left_s = LONGEST_RATIO * least_s if ample else left_s
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.time_s(s_m, v_mps, middle) > left_s else (low, middle)
        return high

    def time_s(self, s_m: float, v_mps: float, top_mps: float) -> float:
        """The time (s) to the section's end under a top speed, braking gently; infinity if a hill stops the train."""
        section = self._section
        first = int(np.searchsorted(section.node_m, s_m, side="right")) - 1
        first = min(max(first, 0), len(section.step_m) - 1)
        cap = np.maximum(np.minimum(self._ceiling_mps[first:], top_mps), section.floor_mps[first:])
        line = LineArrays(*(array[first:].copy() for array in section.for_kernels))
        line.step_m[0] = max(float(section.node_m[first + 1]) - s_m, 1e-3)
        speeds = np.empty(len(cap))
        speeds[0] = min(v_mps, cap[0] / BELOW_RATIO)
        took_s = float(fastest_roll_out(line, cap, section.train, speeds))
        return took_s if took_s >= 0 else math.inf
