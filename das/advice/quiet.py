"""The quiet display: when the driver is shown no instruction, because he acts on what the advice cannot know."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import Final, NamedTuple

from das.advice.advice import Advice, Cause
from das.advice.regimes import BRAKES, Regime
from das.advice.settings import QuietSettings, StopSettings
from das.domain.units import NS
from das.estimate.estimate import Estimate
from das.estimate.plausibility import STANDSTILL_MPS
from das.solver.section import Section

SAMPLED_S: Final = 0.75
"""Speeds less than this time (s) apart are not compared, because their difference would be mostly noise."""
ROUNDING_S: Final = 0.25
"""Advice that comes once a second may come earlier by this (s)."""
SLOWING: Final = frozenset({*BRAKES, Regime.COAST})
"""Instructions with these modes are always shown: a driver who brakes does not act against them."""


class _Sample(NamedTuple):
    """A time (s), and the speed (m/s) that the train would have then without resistance since the first sample.

    Where a gradient accelerates the train, it is not corrected: a driver who brakes there to hold his speed does not
    slow down.
    """

    time_s: float
    driven_mps: float


class Quiet:
    """Sees at each advice whether the driver brakes against it, or the train stands where it has no stop.

    A driver brakes against the advice if he brakes while it tells him to accelerate or to hold a speed.
    """

    def __init__(self, settings: QuietSettings, stop: StopSettings) -> None:
        self._settings, self._stop = settings, stop
        self._samples: deque[_Sample] = deque()
        self._before_mps = 0.0
        self._against = False
        self._advised_s = -math.inf
        """When the advice last said to brake (s)."""

    def forget(self) -> None:
        """Forget what the driver has done so far."""
        self._samples.clear()
        self._against, self._advised_s = False, -math.inf

    def cause(self, advice: Advice, here: Estimate, section: Section) -> Cause:
        """Why the driver is not to be shown this advice; NONE if it is to be shown. Call it for every advice."""
        if advice.mode is Regime.NONE:
            self.forget()
            return Cause.NONE
        if here.speed_mps < STANDSTILL_MPS:
            self.forget()
            near_m = self._stop.at_stop_m
            on_line = section.start_m + near_m < here.s_m < section.end_m - near_m
            return Cause.STANDS_ON_LINE if on_line else Cause.NONE
        self._sample(here, section)
        shown = _modes(advice)
        if shown & BRAKES:
            self._advised_s = here.time_ns * NS
        if self._against:
            self._against = self._braked_mps2(self._settings.released_s) > self._settings.released_mps2
        elif not shown & SLOWING and not self._brakes_soon(advice):
            self._against = self._brakes()
        return Cause.DRIVER_BRAKES if self._against and not shown & SLOWING else Cause.NONE

    def _sample(self, here: Estimate, section: Section) -> None:
        """Take a sample, unless the one before is too recent; drop samples that are no longer needed."""
        now_s, samples = here.time_ns * NS, self._samples
        if samples and now_s < samples[-1].time_s:  # The clock was set back.
            self.forget()
        driven_mps = 0.0
        if samples:
            span_s = now_s - samples[-1].time_s
            if span_s < SAMPLED_S:
                return
            resistance_n = section.resistance_n(here.s_m, here.speed_mps)
            lost_mps = max(resistance_n, 0.0) / section.train.inertial_mass_kg * span_s
            driven_mps = samples[-1].driven_mps + here.speed_mps - self._before_mps + lost_mps
        samples.append(_Sample(now_s, driven_mps))
        self._before_mps = here.speed_mps
        while len(samples) > 2 and samples[1].time_s <= now_s - self._settings.brakes_s + ROUNDING_S:
            samples.popleft()

    def _braked_mps2(self, over_s: float) -> float:
        """The mean deceleration (m/s²) that resistance does not explain, over the last `over_s` or a little more.

        Minus infinity if the train has not been seen for so long.
        """
        last = self._samples[-1]
        since_s = last.time_s - over_s + ROUNDING_S
        first = next((one for one in reversed(self._samples) if one.time_s <= since_s), None)
        return -math.inf if first is None else _fall_mps2(first, last)

    def _brakes(self) -> bool:
        """Whether the driver has braked for long enough, and began no sooner than an advised brake is released.

        A measured speed may jump once, but a brake slows the train at every moment.
        """
        settings = self._settings
        if len(self._samples) < 2 or self._samples[0].time_s < self._advised_s + settings.settled_s:
            return False
        least_mps2 = min(_fall_mps2(before, after) for before, after in pairwise(self._samples))
        steady = least_mps2 > settings.steady_ratio * settings.brakes_mps2
        return steady and self._braked_mps2(settings.brakes_s) > settings.brakes_mps2

    def _brakes_soon(self, advice: Advice) -> bool:
        """Whether the advice itself announces a brake for soon, which the driver may begin early."""
        announced = [(advice.next_mode, advice.next_change_s)]
        if advice.coach is not None:
            announced += [(one.mode, one.in_s) for one in advice.coach.following]
        return any(mode in BRAKES and in_s <= self._settings.brakes_ahead_s for mode, in_s in announced)


def _fall_mps2(before: _Sample, after: _Sample) -> float:
    """The mean deceleration (m/s²) between two samples."""
    return (before.driven_mps - after.driven_mps) / (after.time_s - before.time_s)


def _modes(advice: Advice) -> set[Regime]:
    """The modes that the displays show: of the full advice, of the four modes, and of the coach."""
    shown = {advice.mode, advice.four_mode}
    return shown if advice.coach is None else shown | {advice.coach.now.mode}
