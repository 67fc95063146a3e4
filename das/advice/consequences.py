"""What comes of an advice: where a driver gets who does what is shown, from anywhere the train may be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from das.advice import last_word_kernels as kernels
from das.advice.braking_model import BrakingModel, Needed
from das.advice.regimes import Regime
from das.estimate.estimate import Estimate

SDS_AHEAD = 2.0
"""The train may be ahead of its estimate by so many standard deviations of the position."""
BY_EYE_M = 10.0
"""Nearer than this to the mark the driver sees where he is: the deviation brings the train no nearer to it."""
HELD_ABOVE_MPS = 1.0
"""A train above what is allowed by no more than this is brought down to a speed to hold; a faster one must brake."""
BACK_IN_S = 5.0
"""A train above a limit may be braked so gently that it is below it after so long (s)."""
FULL_RATIO = 0.97
"""A brake from this share of the full one on counts as full: nothing stronger can be asked for."""
FORCE_RATIO = 1.02
"""A force above the largest one at this speed by no more than a fiftieth is a matter of rounding."""
LONGEST_S = 30.0
"""Brakes that are announced for later than this are judged later: by then they are announced again."""
STOPPED_MPS = 0.1
"""A train slower than this stands."""


class Doing(NamedTuple):
    """What a driver does up to a time (s): a wheel force (N), with which he goes to a speed (m/s) and holds it.

    The force of an effort grows as the electric brake does while the train slows down: `of_n` is that brake (N) where
    it begins; 0: the force is what it is.
    """

    until_s: float
    force_n: float
    speed_mps: float
    holds: bool = False
    of_n: float = 0.0


class Excess(NamedTuple):
    """A speed that is reached (m/s), and the highest one there (m/s)."""

    value_mps: float
    bound_mps: float


class Consequences:
    """A train at a moment, on its way with whatever a driver does until an advice expires.

    It may be ahead of its estimate, by `SDS_AHEAD` deviations; everything is counted from there.
    """

    def __init__(self, model: BrakingModel, here: Estimate, valid_s: float) -> None:
        self.model, self.v_mps = model, max(here.speed_mps, 0.0)
        self.valid_s = min(max(valid_s, kernels.STEP_S), LONGEST_S)
        """How long the advice is valid."""
        deviation_m = SDS_AHEAD * here.position_sd_m
        self.behind_m, self.s_m = here.s_m - deviation_m, here.s_m
        self.ahead_m = min(here.s_m + deviation_m, max(here.s_m, model.end_m - BY_EYE_M))
        """Where the train may be at most."""

    def excess(self, doings: Sequence[Doing], lasts_s: float, since_s: float = 0.0) -> Excess | None:
        """Where a driver who does this is too fast for what is ahead; None where he never is."""
        done = np.array(doings, dtype=float)
        tuned = FULL_RATIO, HELD_ABOVE_MPS, STOPPED_MPS, BACK_IN_S
        found = kernels.first_excess(*self.model.train, done, self.ahead_m, self.v_mps, since_s, lasts_s, tuned)
        return Excess(*found) if found[0] >= 0 else None

    def braking(self) -> tuple[float, Needed]:
        """The force (N, <= 0) that is needed from here, and what for; all brakes where a steady one is not enough."""
        model, v_mps = self.model, self.v_mps
        needed = model.needed(self.ahead_m, v_mps, self.valid_s)
        wanted_n = needed.rate_mps2 * model.mass_kg - model.resisting_n(self.ahead_m, v_mps)
        most_n = model.most_brake_n(v_mps)
        force_n = -min(max(wanted_n, 0.0), most_n)
        doing = Doing(math.inf, force_n, needed.speed_mps)
        return (force_n if self.excess([doing], self.valid_s) is None else -most_n), needed

    def mode_of(self, force_n: float) -> Regime:
        """The mode of a braking force (N, <= 0) here: with friction where the electric brake is not enough."""
        electric_n = self.model.electric_n(self.v_mps) if self.model.has_motors(self.ahead_m) else 0.0
        if force_n >= 0:
            return Regime.COAST
        if -force_n > electric_n * FORCE_RATIO:
            return Regime.FRICTION_BRAKE
        return Regime.FULL_BRAKE if -force_n >= FULL_RATIO * electric_n else Regime.REDUCED_BRAKE

    def unavailable(self, force_n: float, v_mps: float) -> Excess | None:
        """Forces that the train does not have at its speed are none that a driver could give."""
        most_n = self.model.traction_n(v_mps) if force_n > 0 else self.model.most_brake_n(v_mps)
        return Excess(self.v_mps, math.nan) if abs(force_n) > FORCE_RATIO * most_n + 1.0 else None

    def braked_horizon(self, force_n: float, to_mps: float, seconds: int) -> dict[str, tuple[float, ...]]:
        """The horizon of a brake to a speed, by the names of its fields: nowhere above what is allowed."""
        model, s_m, v_mps = self.model, self.ahead_m, self.v_mps
        doing = np.array(Doing(math.inf, force_n, to_mps), dtype=float)
        speeds: list[float] = []
        forces: list[float] = []
        for _ in range(seconds):
            for _ in range(round(1.0 / kernels.STEP_S)):
                after_mps = float(kernels.after_step(*model.line, model.mass_kg, doing, s_m, v_mps))
                s_m, v_mps = s_m + 0.5 * (v_mps + after_mps) * kernels.STEP_S, after_mps
            forces.append(force_n if v_mps > to_mps else 0.0)
            speeds.append(min(v_mps, model.allowed_mps(s_m), *speeds[-1:]))
        return {"horizon_speed_mps": tuple(speeds), "horizon_force_n": tuple(forces)}

    def brake_n(self, effort_ratio: float) -> float:
        """The force (N, < 0) of an effort, as a share of what the motors brake with now; of all brakes without them."""
        return effort_ratio * (self.model.electric_n(self.v_mps) or self.model.most_brake_n(self.v_mps))
