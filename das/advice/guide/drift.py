"""The time that a driver is likely to lose against a reference, learned from the drift of the forecast arrival."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Final

import numpy as np

from das.solver.guide.schedule import ON_CURVE_MPS
from das.solver.section import Section

RUNNING_S_PER_MIN: Final = 1.0
"""The time usually lost, in seconds per minute (default human driver), by holding below limits and reacting late."""
BRAKING_RATIO: Final = 0.2
"""The time usually lost by braking early and gently, as a share of the braking time of the fastest run."""
LAST_S: Final = 300.0
"""The last part of the run (s), whose usual loss the reserve covers, as even the fastest run may not regain it."""
VARIANCE_S: Final = 4.0
"""The ratio (s) of the variance of a loss (s²) to the loss (s)."""
KNOWN_AFTER_S: Final = 25.0
"""Usual loss (s) after which a driver's measured loss weighs half: that of a section of 11 min, because in each of
three sections the same drivers lost another share of it (1.9, 0.5 and 0.7)."""


class UsualLoss:
    """The time that drivers usually lose against a reference on the rest of a section."""

    def __init__(self, section: Section) -> None:
        self._node_m = section.node_m
        speeds = section.fastest_run.speed_mps
        brakes = (speeds[1:] < speeds[:-1]) & (speeds[1:] > section.envelope_mps[1:] - ON_CURVE_MPS)
        steps_s = np.where(brakes, 2.0 * section.step_m / np.maximum(speeds[:-1] + speeds[1:], 1e-3), 0.0)
        self._braking_s = np.append(steps_s[::-1].cumsum()[::-1], 0.0)
        """The braking time (s) of the fastest run from each node on."""
        self._last_from_m = float(np.interp(-LAST_S, -section.fastest_run.time_to_go_s, section.node_m))

    def between_s(self, s_m: float, to_m: float, takes_s: float) -> float:
        """The time (s) usually lost between two positions (m), in `takes_s`; 0 if the second is behind the first."""
        here_s, there_s = np.interp((s_m, to_m), self._node_m, self._braking_s)
        return RUNNING_S_PER_MIN * max(takes_s, 0.0) / 60.0 + BRAKING_RATIO * max(float(here_s - there_s), 0.0)

    def from_s(self, s_m: float, ahead_s: float) -> float:
        """The time (s) usually lost from a position (m) to the end of the section, which takes `ahead_s`."""
        return self.between_s(s_m, float(self._node_m[-1]), ahead_s)

    def at_last_s(self, s_m: float, ahead_s: float) -> float:
        """The part of the usual loss (s) that cannot be made up, because it occurs just before the stop."""
        return self.from_s(max(s_m, self._last_from_m), min(ahead_s, LAST_S))


class Drift:
    """A driver's adherence to references on all sections of a journey: the time lost."""

    def __init__(self) -> None:
        self._before: tuple[float, float] | None = None
        self._lost_s = self._usual_s = KNOWN_AFTER_S

    @property
    def ratio(self) -> float:
        """The loss of this driver as a share of the usual one, at most 1: larger losses are recovered on the way."""
        return min(max(self._lost_s, 0.0) / self._usual_s, 1.0)

    def see(self, late_s: float, usual_s: float, *, anew: bool) -> None:
        """Update with the forecast lateness and the usual loss from here on; `anew`: ignore the forecast before."""
        if self._before is not None and not anew:
            self._lost_s += late_s - self._before[0]
            self._usual_s += max(self._before[1] - usual_s, 0.0)
        self._before = late_s, usual_s

    def pause(self) -> None:
        """Exclude the change to the next forecast: it is not due to the driver."""
        self._before = None

    def loss_s(self, usual_s: float, probability: float) -> float:
        """The loss (s; gain < 0) that this driver does not exceed with a probability, where `usual_s` is usual."""
        likely_s = self.ratio * usual_s
        return likely_s + NormalDist().inv_cdf(probability) * math.sqrt(VARIANCE_S * likely_s)
