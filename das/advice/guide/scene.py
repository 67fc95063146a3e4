"""What the guide sees in a second: the steps, the train and its forecast, and the limits around it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.braking import BrakingAhead
from das.advice.goal import TrainState
from das.advice.guide.keeping import Kept
from das.advice.guide.planning import elapsed_s
from das.advice.guide.timeline import GuideStep
from das.solver.guide.schedule import Schedule

Floats = NDArray[np.float64]


class SpeedsAllowed(NamedTuple):
    """The bounds on an instruction where the train is: the highest safe speed, and the limit over the train (m/s).

    `too_fast`: the driver is told that the train is too fast.
    """

    allowed_mps: float
    limit_mps: float
    too_fast: bool = False


class TrainForecast(NamedTuple):
    """The forecast of the reference from here: times (s from now), places (m) and speeds (m/s)."""

    times_s: Floats
    at_m: Floats
    speeds_mps: Floats

    @classmethod
    def of(cls, kept: Kept, state: TrainState) -> TrainForecast:
        """The forecast of a train in a state that keeps to the reference."""
        times_s, at_m = elapsed_s(kept.reference.schedule, kept.forecast, state.s_m)
        speeds_mps = kept.forecast.speeds_mps[-len(at_m) :].copy()
        speeds_mps[0] = state.v_mps
        return cls(times_s, at_m, speeds_mps)

    def time_s(self, s_m: float) -> float:
        """When the train reaches a place (s from now)."""
        return float(np.interp(s_m, self.at_m, self.times_s))

    def speed_mps(self, s_m: float) -> float:
        """The speed at which the train passes a place (m/s)."""
        return float(np.interp(s_m, self.at_m, self.speeds_mps))


class Sight(NamedTuple):
    """All that a second of the guide depends on, besides its memory."""

    schedule: Schedule
    steps: tuple[GuideStep, ...]
    foreseen: TrainForecast
    state: TrainState
    place: SpeedsAllowed
    ahead: BrakingAhead

    def due_s(self, number: int) -> float:
        """In what time (s) a step begins for this train; 0 if it has begun, like the first; infinity: none."""
        if number >= len(self.steps):
            return float("inf")
        begun = number == 0 or self.steps[number].from_m <= self.state.s_m
        return 0.0 if begun else self.foreseen.time_s(self.steps[number].from_m)

    @property
    def rolls_mps2(self) -> float:
        """The acceleration (m/s²) of the train if it coasts here."""
        return self.ahead.rolls_mps2(self.state.s_m, self.state.v_mps)
