"""A driver's adherence to references: the drift of the forecast arrival, and the time likely to be lost ahead."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Final

import numpy as np

from das.domain.units import NS
from das.solver.guide.schedule import ON_CURVE_MPS
from das.solver.section import Section

MARGIN_LEAST_S: Final = 2.0
"""The smallest margin (s) to either end of a timing point's window."""
MARGIN_MOST_S: Final = 12.0
"""The largest margin (s) to either end of a timing point's window."""
MARGIN_DEVIATIONS: Final = 1.5
"""The margin as a multiple of the standard deviation of the train's drift against the reference."""
DRIFT_S_PER_MIN: Final = 2.0
"""The drift assumed before any measurement: standard deviation of the seconds gained or lost per minute."""
SAMPLED_S: Final = 20.0
"""The interval (s) between two measurements of the drift."""
FORGOTTEN_MIN: Final = 5.0
"""The time constant (min) with which measurements of the drift lose weight."""
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

    def from_s(self, s_m: float, ahead_s: float) -> float:
        """The time (s) usually lost from a position (m) to the end of the section, which takes `ahead_s`."""
        braking_s = float(np.interp(s_m, self._node_m, self._braking_s))
        return RUNNING_S_PER_MIN * max(ahead_s, 0.0) / 60.0 + BRAKING_RATIO * braking_s

    def at_last_s(self, s_m: float, ahead_s: float) -> float:
        """The part of the usual loss (s) that cannot be made up, because it occurs just before the stop."""
        return self.from_s(max(s_m, self._last_from_m), min(ahead_s, LAST_S))


class Drift:
    """A driver's adherence to references on all sections of a journey: drift of forecast arrivals, time lost."""

    def __init__(self) -> None:
        self._square = DRIFT_S_PER_MIN**2
        self._sampled: tuple[int, float] | None = None
        self._before: tuple[float, float] | None = None
        self._lost_s = self._usual_s = KNOWN_AFTER_S

    @property
    def ratio(self) -> float:
        """The loss of this driver as a share of the usual one, at most 1: larger losses are recovered on the way."""
        return min(max(self._lost_s, 0.0) / self._usual_s, 1.0)

    def see(self, now_ns: int, late_s: float, usual_s: float, *, anew: bool) -> None:
        """Update with the forecast lateness and the usual loss from here on; `anew`: ignore the forecast before."""
        if anew or self._sampled is None or self._before is None or now_ns < self._sampled[0]:
            self._sampled, self._before = (now_ns, late_s), (late_s, usual_s)
            return
        self._lost_s += late_s - self._before[0]
        self._usual_s += max(self._before[1] - usual_s, 0.0)
        self._before = late_s, usual_s
        minutes = (now_ns - self._sampled[0]) * NS / 60.0
        if minutes * 60.0 < SAMPLED_S:
            return
        kept = math.exp(-minutes / FORGOTTEN_MIN)
        self._square = kept * self._square + (1.0 - kept) * (late_s - self._sampled[1]) ** 2 / minutes
        self._sampled = now_ns, late_s

    def pause(self) -> None:
        """Exclude the change to the next forecast from the drift: it is not due to the driver."""
        self._sampled = None

    def margin_s(self, ahead_s: float) -> float:
        """The margin (s) for a time that is `ahead_s` from now."""
        spread_s = MARGIN_DEVIATIONS * math.sqrt(self._square * max(ahead_s, 0.0) / 60.0)
        return min(max(spread_s, MARGIN_LEAST_S), MARGIN_MOST_S)

    def loss_s(self, usual_s: float, on_time_ratio: float) -> float:
        """The loss (s) that this driver does not exceed with the given probability, if the usual loss is `usual_s`."""
        likely_s = self.ratio * usual_s
        return max(likely_s + NormalDist().inv_cdf(on_time_ratio) * math.sqrt(VARIANCE_S * likely_s), 0.0)
