"""How a driver keeps references: by how much his forecast arrival drifts, and what time he is still likely to lose."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.units import NS
from das.solver.section import Section

MARGIN_LEAST_S: Final = 2.0
"""The least margin to either end of the window in which a point may be passed."""
MARGIN_MOST_S: Final = 12.0
"""The largest margin to either end of the window in which a point may be passed."""
MARGIN_DEVIATIONS: Final = 1.5
"""The margin is this many standard deviations of the train's drift against the reference."""
DRIFT_S_PER_MIN: Final = 2.0
"""The drift assumed before the driver is known (standard deviation; seconds gained or lost in a minute)."""
SAMPLED_S: Final = 20.0
"""The drift is measured once in this time."""
FORGOTTEN_MIN: Final = 5.0
"""After this time (min) an earlier measurement of the drift counts for 1/e."""
RUNNING_S_PER_MIN: Final = 1.0
"""Drivers usually lose this many seconds in each minute (the default human driver on Zürich–Luzern): they hold speeds a
little below limits, and react late."""
BRAKING_RATIO: Final = 0.2
"""Drivers usually lose this share of the time in which the fastest run brakes: they brake earlier and more gently."""
LAST_S: Final = 150.0
"""The reserve is for what is lost in so many seconds before the stop. What is lost before that, a new reference
makes up, and only if it is lost."""
VARIANCE_S: Final = 4.0
"""The variance of a loss (s²) is this many times the loss (s). It is that of a driver, and of what drivers usually
lose from stop to stop."""
KNOWN_AFTER_S: Final = 8.0
"""A driver's own loss counts as much as the usual one once he has come where drivers usually have lost so much
(s): before his first stop."""
ON_CURVE_MPS = 0.05
"""The fastest run brakes where its speed falls and is this near (m/s) to the braking curve."""


class UsualLoss:
    """The time that drivers usually lose against a reference on the rest of a section."""

    def __init__(self, section: Section) -> None:
        self._node_m = section.node_m
        self._braking_s = _braking_to_go_s(section)
        to_go_s = section.fastest_run.time_to_go_s
        self._last_from_m = float(np.interp(-LAST_S, -to_go_s, section.node_m))

    def from_s(self, s_m: float, ahead_s: float) -> float:
        """The time (s) usually lost from a position (m) on, from where the train takes `ahead_s` to the end."""
        braking_s = float(np.interp(s_m, self._node_m, self._braking_s))
        running_s = RUNNING_S_PER_MIN * max(ahead_s, 0.0) / 60.0
        return running_s + BRAKING_RATIO * braking_s

    def at_last_s(self, s_m: float, ahead_s: float) -> float:
        """What of it (s) cannot be made up any more, because it is lost just before the stop."""
        return self.from_s(max(s_m, self._last_from_m), min(ahead_s, LAST_S))


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

    def __init__(self) -> None:
        self._square = DRIFT_S_PER_MIN**2
        self._sampled: tuple[int, float] | None = None
        self._before: tuple[float, float] | None = None
        self._lost_s = self._usual_s = KNOWN_AFTER_S

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
        if minutes * 60.0 < SAMPLED_S:
            return
        kept = math.exp(-minutes / FORGOTTEN_MIN)
        self._square = kept * self._square + (1.0 - kept) * (late_s - self._sampled[1]) ** 2 / minutes
        self._sampled = now_ns, late_s

    def pause(self) -> None:
        """Do not compare the next forecast with the one before: what changed in between is not the driver's doing."""
        self._sampled = None

    def margin_s(self, ahead_s: float) -> float:
        """The margin (s) to keep to a time that is `ahead_s` from now."""
        spread_s = MARGIN_DEVIATIONS * math.sqrt(self._square * max(ahead_s, 0.0) / 60.0)
        return min(max(spread_s, MARGIN_LEAST_S), MARGIN_MOST_S)

    def loss_s(self, usual_s: float, on_time_ratio: float) -> float:
        """The time (s) that this driver loses at most with a probability, where drivers usually lose `usual_s`."""
        likely_s = self.ratio * usual_s
        return max(likely_s + NormalDist().inv_cdf(on_time_ratio) * math.sqrt(VARIANCE_S * likely_s), 0.0)
