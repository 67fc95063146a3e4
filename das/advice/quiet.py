"""The quiet display: no instruction is shown while the driver has reasons unknown to the advice."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

from das.advice.advice import Advice, Cause
from das.advice.goal import AT_STOP_M
from das.advice.regimes import BRAKES, Regime
from das.advice.shown import TARGET_STEP_MPS
from das.domain.units import NS
from das.estimate.estimate import Estimate
from das.estimate.plausibility import STANDSTILL_MPS
from das.solver.section import Section

BRAKES_MPS2: Final = 0.2
"""Deceleration (m/s²), in addition to gradient and resistance, that shows that a driver brakes."""
BRAKES_S: Final = 3.0
"""Least duration (s) of a brake; its mean deceleration since it began is compared with `BRAKES_MPS2`."""
RELEASED_MPS2: Final = 0.1
"""Deceleration (m/s²), in addition to gradient and resistance, up to which the brake counts as released; a
brake slows the train by more in every second, because a jump in the speed lasts only one."""
RELEASED_S: Final = 2.0
"""Time (s) over which the deceleration for `RELEASED_MPS2` is averaged, to suppress the noise of the speed."""
SETTLED_S: Final = 5.0
"""Time (s) after an advised brake in which braking does not count: drivers react late and brakes release late."""
BRAKES_AHEAD_S: Final = 20.0
"""Time (s) by which a driver may brake before an announced brake without acting against the advice."""
SAMPLED_S: Final = 0.75
"""Least time (s) between compared speeds; speeds nearer in time differ mostly by noise."""
ROUNDING_S: Final = 0.25
"""Largest earliness (s) of advice messages, which are due once a second."""
SLOWING: Final = frozenset({*BRAKES, Regime.COAST})
"""Modes of instructions that are shown even to a driver who brakes, because braking does not contradict them."""


class _Sample(NamedTuple):
    """A time (s), the speed (m/s), and the speed without what resistance took away since the first sample (m/s)."""

    time_s: float
    v_mps: float
    driven_mps: float

    def braked_mps2(self, after: _Sample) -> float:
        """The mean deceleration (m/s²) from this sample to a later one, beyond what resistance explains."""
        return (self.driven_mps - after.driven_mps) / (after.time_s - self.time_s)


class Quiet:
    """Detects, at each advice message, a driver who brakes against advice to accelerate or to hold a speed, and a train
    that stands where it has no stop."""

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque()
        self._began: _Sample | None = None
        """The last sample before the train began to slow down steadily."""
        self._against = False
        self._advised_s = -math.inf
        """Time of the last advice to brake (s)."""

    def forget(self) -> None:
        """Discard the samples, the brake that was detected, and the last advised brake."""
        self._samples.clear()
        self._began, self._against, self._advised_s = None, False, -math.inf

    def cause(self, advice: Advice, here: Estimate, section: Section) -> Cause:
        """The cause for hiding advice from the driver; NONE to show it. Call it for every advice message."""
        if advice.mode is Regime.NONE:
            self.forget()
            return Cause.NONE
        if here.speed_mps < STANDSTILL_MPS:
            self.forget()
            on_line = section.start_m + AT_STOP_M < here.s_m < section.end_m - AT_STOP_M
            return Cause.STANDS_ON_LINE if on_line else Cause.NONE
        self._sample(here, section)
        shown = {advice.mode} if advice.guide is None else {advice.mode, advice.guide.now.mode}
        if shown & BRAKES:
            self._advised_s = here.time_ns * NS
        if self._against:
            self._against = not self._released()
        elif not self._brakes_soon(advice):
            self._against = self._brakes(holds=advice.mode is Regime.CRUISE)
        return Cause.DRIVER_BRAKES if self._against and not shown & SLOWING else Cause.NONE

    def _sample(self, here: Estimate, section: Section) -> None:
        """Take a sample, unless the one before is too recent; drop samples that are no longer needed."""
        now_s, v_mps, samples = here.time_ns * NS, here.speed_mps, self._samples
        if samples and now_s < samples[-1].time_s:  # The clock was set back.
            self.forget()
        if not samples:
            samples.append(_Sample(now_s, v_mps, v_mps))
            return
        before = samples[-1]
        span_s = now_s - before.time_s
        if span_s < SAMPLED_S:
            return
        lost_mps2 = max(section.resistance_n(here.s_m, v_mps), 0.0) / section.train.inertial_mass_kg
        samples.append(_Sample(now_s, v_mps, before.driven_mps + v_mps - before.v_mps + lost_mps2 * span_s))
        if before.braked_mps2(samples[-1]) <= RELEASED_MPS2:
            self._began = None
        elif self._began is None:
            self._began = before
        while samples[1].time_s <= now_s - RELEASED_S + ROUNDING_S:
            samples.popleft()

    def _brakes(self, *, holds: bool) -> bool:
        """Whether a brake that began `SETTLED_S` after advised ones counts; with `holds`, small losses do not."""
        began, now = self._began, self._samples[-1]
        if began is None or began.time_s < self._advised_s + SETTLED_S:
            return False
        slowed = not holds or began.v_mps - now.v_mps > TARGET_STEP_MPS
        lasts = now.time_s - began.time_s >= BRAKES_S - ROUNDING_S
        return slowed and lasts and began.braked_mps2(now) > BRAKES_MPS2

    def _released(self) -> bool:
        first, last = self._samples[0], self._samples[-1]
        return first is not last and first.braked_mps2(last) <= RELEASED_MPS2

    def _brakes_soon(self, advice: Advice) -> bool:
        """Whether the advice itself announces a brake within `BRAKES_AHEAD_S`, which the driver may begin early."""
        following = () if advice.guide is None else advice.guide.following
        announced = [(advice.next_mode, advice.next_change_s), *((one.mode, one.in_s) for one in following)]
        return any(mode in BRAKES and in_s <= BRAKES_AHEAD_S for mode, in_s in announced)
