"""The consequences of an advice: what speeds the train reaches if the driver does what is shown."""

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
"""The train is assumed to be ahead of its estimated position by this many standard deviations."""
BY_EYE_M = 10.0
"""From this far (m) the driver sees the mark; the train is assumed nearer to the stop only if its estimate is."""
HELD_ABOVE_MPS = 1.0
"""A driver above the allowed speed by at most this may be told to hold a lower speed; a faster one must brake."""
BACK_IN_S = 5.0
"""For a train above a limit, braking is strong enough if the train is back under the limit after this time."""
FULL_RATIO = 0.97
"""Braking with at least this share of the full braking force counts as full: nothing stronger can be asked for."""
FORCE_RATIO = 1.02
"""A force up to this multiple of the largest one at the speed counts as available: the difference is rounding."""
LONGEST_S = 30.0
"""Braking announced for later than this (s) is not judged yet: it will be announced again, and judged, before then."""
STOPPED_MPS = 0.1
"""A train slower than this counts as standing."""


class Doing(NamedTuple):
    """What the driver does until a time (s): he applies a wheel force (N) to reach a speed (m/s).

    `holds`: he then holds the speed, with whatever force that takes. `of_n` > 0: the braking force is a share of
    the electric brake, and grows with it as the train slows down; `of_n` is the force of the electric brake (N) at the
    start. `of_n` = 0: the braking force is constant.
    """

    until_s: float
    force_n: float
    speed_mps: float
    holds: bool = False
    of_n: float = 0.0


class Excess(NamedTuple):
    """A speed (m/s) that is too high, and the highest safe speed (m/s) there (NaN: it could not be judged)."""

    value_mps: float
    bound_mps: float


class Consequences:
    """Predicts how a train moves until an advice expires, for whatever its driver does.

    The train starts from `ahead_m`: it may be ahead of its estimated position by `SDS_AHEAD` standard deviations.
    """

    def __init__(self, model: BrakingModel, here: Estimate, valid_s: float) -> None:
        self.model, self.v_mps = model, max(here.speed_mps, 0.0)
        self.valid_s = min(max(valid_s, kernels.STEP_S), LONGEST_S)
        """How long the advice is still valid (s)."""
        deviation_m = SDS_AHEAD * here.position_sd_m
        self.behind_m, self.s_m = here.s_m - deviation_m, here.s_m
        self.ahead_m = min(here.s_m + deviation_m, max(here.s_m, model.end_m - BY_EYE_M))
        """The furthest position (m) at which the train may be."""

    def excess(self, doings: Sequence[Doing], lasts_s: float, since_s: float = 0.0) -> Excess | None:
        """The first speed between `since_s` and `lasts_s` that is too high if the driver does this; None if none is."""
        done = np.array(doings, dtype=float)
        tuned = FULL_RATIO, HELD_ABOVE_MPS, STOPPED_MPS, BACK_IN_S
        found = kernels.first_excess(*self.model.train, done, self.ahead_m, self.v_mps, since_s, lasts_s, tuned)
        return Excess(*found) if found[0] >= 0 else None

    def braking(self) -> tuple[float, Needed]:
        """The braking force (N, <= 0) needed from here, and the speed and place that need it.

        If the constant force computed from the needed deceleration does not suffice, the force is that of all brakes.
        """
        model, v_mps = self.model, self.v_mps
        needed = model.needed(self.ahead_m, v_mps, self.valid_s)
        wanted_n = needed.rate_mps2 * model.mass_kg - model.resisting_n(self.ahead_m, v_mps)
        most_n = model.most_brake_n(v_mps)
        force_n = -min(max(wanted_n, 0.0), most_n)
        doing = Doing(math.inf, force_n, needed.speed_mps)
        return (force_n if self.excess([doing], self.valid_s) is None else -most_n), needed

    def mode_of(self, force_n: float) -> Regime:
        """The mode of a braking force (N, <= 0) here; the friction brake if the electric brake is not enough."""
        electric_n = self.model.electric_n(self.v_mps) if self.model.has_motors(self.ahead_m) else 0.0
        if force_n >= 0:
            return Regime.COAST
        if -force_n > electric_n * FORCE_RATIO:
            return Regime.FRICTION_BRAKE
        return Regime.FULL_BRAKE if -force_n >= FULL_RATIO * electric_n else Regime.REDUCED_BRAKE

    def unavailable(self, force_n: float, v_mps: float) -> Excess | None:
        """An excess if the train does not have this force (N) at the speed `v_mps`, so that no driver can apply it."""
        most_n = self.model.traction_n(v_mps) if force_n > 0 else self.model.most_brake_n(v_mps)
        return Excess(self.v_mps, math.nan) if abs(force_n) > FORCE_RATIO * most_n + 1.0 else None

    def braked_horizon(self, force_n: float, to_mps: float, seconds: int) -> dict[str, tuple[float, ...]]:
        """The horizon fields of an advice, by name, for braking with a force (N) to a speed (m/s).

        No speed is above what is allowed.
        """
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
        """The braking force (N) of an effort: a share of the motors' brake now, or of all brakes if there is none."""
        return effort_ratio * (self.model.electric_n(self.v_mps) or self.model.most_brake_n(self.v_mps))
