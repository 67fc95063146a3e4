"""The reduced maximum speed: the one highest speed with which a train that brakes easily keeps the timetable."""

from __future__ import annotations

import math

import numpy as np

from das.advice.settings import DEFAULT, AdviceSettings
from das.advice.staircase import Staircase
from das.domain.units import NS
from das.solver.kernels.driving import FULL_BRAKES, braking_envelope
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.kernels.tuples import LineArrays
from das.solver.section import Section


class ReducedSpeed:
    """The reduced maximum speed of a section, judged at the departure and then every while: it stands still between."""

    def __init__(self, section: Section, settings: AdviceSettings = DEFAULT) -> None:
        self._settings, self._longest_ratio = settings.reduced, settings.plan.longest_ratio
        easy_mps2 = min(settings.reduced.easy_braking_mps2, section.train.max_deceleration_mps2)
        easy = section.train._replace(max_deceleration_mps2=easy_mps2)
        ceiling, _ = braking_envelope(section.for_kernels, section.limit_mps, section.end_speed_mps, easy, FULL_BRAKES)
        # Where a descent cannot be braked so easily, the envelope of the section holds.
        self._ceiling_mps = np.minimum(np.maximum(ceiling, section.floor_mps), section.envelope_mps)
        self._section = section
        self._staircase = Staircase(section, self._ceiling_mps, easy_mps2, settings)
        self._judged_ns, self._for_ns, self._speed_mps = 0, 0, math.nan

    def shown_mps(self, s_m: float, v_mps: float, now_ns: int, arrival_ns: int) -> float:
        """The top speed to show (m/s) in a state: the judged one, or a lower one that holds here or ahead."""
        return self._staircase.at(s_m, v_mps, self.judged_mps(s_m, v_mps, now_ns, arrival_ns))

    def judged_mps(self, s_m: float, v_mps: float, now_ns: int, arrival_ns: int) -> float:
        """The reduced maximum speed (m/s) from a state: the one for the whole way that is left."""
        age_s = (now_ns - self._judged_ns) * NS
        if math.isnan(self._speed_mps) or arrival_ns != self._for_ns or not 0 <= age_s < self._settings.judged_every_s:
            before_mps = self._speed_mps if arrival_ns == self._for_ns else math.nan
            self._judged_ns, self._for_ns = now_ns, arrival_ns
            self._speed_mps = self._judged(s_m, v_mps, (arrival_ns - now_ns) * NS, before_mps)
        return self._speed_mps

    def _judged(self, s_m: float, v_mps: float, left_s: float, before_mps: float) -> float:
        low = self._settings.slowest_mps
        high = max(float(self._ceiling_mps.max()), low)
        least_s = self.time_s(s_m, v_mps, high)
        if least_s >= left_s:
            return high
        ample = left_s > self._longest_ratio * least_s
        if ample and not math.isnan(before_mps):
            return before_mps
        left_s = self._longest_ratio * least_s if ample else left_s
        for _ in range(self._settings.halvings):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.time_s(s_m, v_mps, middle) > left_s else (low, middle)
        return high

    def time_s(self, s_m: float, v_mps: float, top_mps: float) -> float:
        """Time to the end under a top speed, braking easily (inf: a hill cannot be climbed so slowly)."""
        section = self._section
        first = int(np.searchsorted(section.node_m, s_m, side="right")) - 1
        first = min(max(first, 0), len(section.step_m) - 1)
        cap = np.maximum(np.minimum(self._ceiling_mps[first:], top_mps), section.floor_mps[first:])
        line = LineArrays(*(array[first:].copy() for array in section.for_kernels))
        line.step_m[0] = max(float(section.node_m[first + 1]) - s_m, 1e-3)
        speeds = np.empty(len(cap))
        speeds[0] = min(v_mps, cap[0] / self._settings.below_ratio)
        took_s = float(fastest_roll_out(line, cap, section.train, speeds))
        return took_s if took_s >= 0 else math.inf
