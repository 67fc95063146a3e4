"""How a driver keeps references: by how much his forecast arrival drifts, and what time he is still likely to lose."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from das.advice.guide.settings import LossSettings, MarginSettings
from das.domain.units import NS
from das.solver.section import Section

ON_CURVE_MPS = 0.05
"""The fastest run brakes where its speed falls and is this near (m/s) to the braking curve."""


class UsualLoss:
    """The time that drivers usually lose against a reference on the rest of a section."""

    def __init__(self, section: Section, settings: LossSettings) -> None:
        self._settings, self._node_m = settings, section.node_m
        self._braking_s = _braking_to_go_s(section)
        to_go_s = section.fastest_run.time_to_go_s
        self._last_from_m = float(np.interp(-settings.last_s, -to_go_s, section.node_m))

    def from_s(self, s_m: float, ahead_s: float) -> float:
        """The time (s) usually lost from a position (m) on, from where the train takes `ahead_s` to the end."""
        braking_s = float(np.interp(s_m, self._node_m, self._braking_s))
        running_s = self._settings.running_s_per_min * max(ahead_s, 0.0) / 60.0
        return running_s + self._settings.braking_ratio * braking_s

    def at_last_s(self, s_m: float, ahead_s: float) -> float:
        """What of it (s) cannot be made up any more, because it is lost just before the stop."""
        return self.from_s(max(s_m, self._last_from_m), min(ahead_s, self._settings.last_s))


def _braking_to_go_s(section: Section) -> NDArray[np.float64]:
    """For how long (s) the fastest run brakes for limits and the stop, from each node of a section on."""
    speeds = section.fastest_run.speed_mps
    brakes = (speeds[1:] < speeds[:-1]) & (speeds[1:] > section.envelope_mps[1:] - ON_CURVE_MPS)
    steps_s = np.where(brakes, 2.0 * section.step_m / np.maximum(speeds[:-1] + speeds[1:], 1e-3), 0.0)
    return np.append(steps_s[::-1].cumsum()[::-1], 0.0)


class Drift:
    """How well the driver keeps references: by how much the forecast arrival drifts, and what of it he usually loses.

    One object serves all sections of a journey; another driver begins with another one.
    """

    def __init__(self, margin: MarginSettings, loss: LossSettings) -> None:
        self._margin, self._loss = margin, loss
        self._square = margin.drift_s_per_min**2
        self._sampled: tuple[int, float] | None = None
        self._before: tuple[float, float] | None = None
        self._lost_s = self._usual_s = loss.known_after_s

    @property
    def ratio(self) -> float:
        """What this driver loses, as a share of what drivers usually lose; who loses more makes it up on the way."""
        return min(max(self._lost_s, 0.0) / self._usual_s, 1.0)

    def see(self, now_ns: int, late_s: float, usual_s: float, *, anew: bool) -> None:
        """Take in how late the train is forecast to arrive, and what drivers usually lose from here on.

        `anew`: do not compare it with the previous forecast.
        """
        if anew or self._sampled is None or self._before is None or now_ns < self._sampled[0]:
            self._sampled, self._before = (now_ns, late_s), (late_s, usual_s)
            return
        self._lost_s += late_s - self._before[0]
        self._usual_s += max(self._before[1] - usual_s, 0.0)
        self._before = late_s, usual_s
        minutes = (now_ns - self._sampled[0]) * NS / 60.0
        if minutes * 60.0 < self._margin.sampled_s:
            return
        kept = math.exp(-minutes / self._margin.forgotten_min)
        self._square = kept * self._square + (1.0 - kept) * (late_s - self._sampled[1]) ** 2 / minutes
        self._sampled = now_ns, late_s

    def pause(self) -> None:
        """Do not compare the next forecast with the one before: what changed in between is not the driver's doing."""
        self._sampled = None

    def margin_s(self, ahead_s: float) -> float:
        """The margin (s) to keep to a time that is `ahead_s` from now."""
        margin = self._margin
        spread_s = margin.deviations * math.sqrt(self._square * max(ahead_s, 0.0) / 60.0)
        return min(max(spread_s, margin.least_s), margin.most_s)

    def loss_s(self, usual_s: float, on_time_ratio: float) -> float:
        """The time (s) that this driver loses at most with a probability, where drivers usually lose `usual_s`."""
        likely_s = self.ratio * usual_s
        return max(likely_s + NormalDist().inv_cdf(on_time_ratio) * math.sqrt(self._loss.variance_s * likely_s), 0.0)
