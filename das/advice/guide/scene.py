"""What the guide sees in a second: the steps, the train and its forecast, and the limits around it."""

from __future__ import annotations

from typing import NamedTuple

from das.advice.braking import BrakingAhead
from das.advice.goal import TrainState
from das.advice.guide.timeline import GuideStep
from das.solver.guide.schedule import Prospect, Schedule


class SpeedsAllowed(NamedTuple):
    """The bounds on an instruction where the train is: the highest safe speed, and the limit over the train (m/s).

    `too_fast`: the driver is told that the train is too fast.
    """

    allowed_mps: float
    limit_mps: float
    too_fast: bool = False


class Sight(NamedTuple):
    """All that a second of the guide depends on, besides its memory."""

    schedule: Schedule
    steps: tuple[GuideStep, ...]
    foreseen: Prospect
    state: TrainState
    place: SpeedsAllowed
    ahead: BrakingAhead

    def due_s(self, number: int) -> float:
        """In what time (s) a step begins for this train; 0 if it has begun, like the first; infinity: none."""
        if number >= len(self.steps):
            return float("inf")
        begun = number == 0 or self.steps[number].from_m <= self.state.s_m
        return 0.0 if begun else self.foreseen.passes_s(self.steps[number].from_m)

    @property
    def rolls_mps2(self) -> float:
        """The acceleration (m/s²) of the train if it coasts here."""
        return self.ahead.rolls_mps2(self.state.s_m, self.state.v_mps)
