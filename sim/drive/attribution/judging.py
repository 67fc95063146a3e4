"""What a driver did at each moment of a leg, judged by the advice shown, or else by the best run from there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.advice.modes import Mode
from das.domain.trajectory import Trajectory
from das.domain.vehicle import Vehicle
from sim.drive.attribution.causes import EnergyCause
from sim.drive.attribution.shown import Seen

Floats = NDArray[np.float64]

OVER_MPS: Final = 2.0 / 3.6
"""A speed this far (m/s) from the advised one is against the advice: displays show whole km/h, drivers keep within one
or two."""
SAME_MPS: Final = 1.0 / 3.6
"""A train this far (m/s) below the advised speed may need more effort than advised to reach it."""
LASTS: Final = 3
"""What the driver did at this number of moments on end was meant; what lasted for fewer passed by."""
NEUTRAL_RATIO: Final = 0.03
"""An effort below this share of the largest traction is none: the train coasts."""
EFFORT_RATIO: Final = 0.15
"""Efforts that differ by more than this share of the largest traction are different."""
AHEAD_S: Final = 2.0
"""Driven and best effort are compared over so long (s): forces take a second to build up."""

PULLING: Final = (Mode.FULL_TRACTION, Mode.REDUCED_TRACTION)
BRAKING: Final = (Mode.REDUCED_BRAKE, Mode.FULL_BRAKE, Mode.FRICTION_BRAKE)


@dataclass(frozen=True, kw_only=True)
class Moment:
    """A moment of a drive: speed, efforts as shares of the largest traction, and what was shown and seen.

    `driven_ratio` is the effort of the driven train over the next seconds, `best_ratio` that of the best run from here
    (NaN: there is none), `coasts_to_brake` whether that run coasts now and brakes next.
    """

    speed_mps: float
    driven_ratio: float
    best_ratio: float
    coasts_to_brake: bool
    seen: Seen | None = None
    signal: bool = False

    @property
    def pulls(self) -> bool:
        """Whether the train is under traction, or the controller is set to it."""
        lever_ratio = -1.0 if self.seen is None or math.isnan(self.seen.lever_ratio) else self.seen.lever_ratio
        return max(self.driven_ratio, lever_ratio) > NEUTRAL_RATIO

    @property
    def brakes(self) -> bool:
        """Whether the train brakes."""
        return self.driven_ratio < -NEUTRAL_RATIO


class Judge:
    """Names the cause to which the energy of each moment belongs; moments are to be given in order of time."""

    def __init__(self) -> None:
        self._coasting_due = self._was_over = False
        self._over_moments = self._neutral_moments = self._slowing_moments = 0
        self._before = EnergyCause.REST

    def cause(self, now: Moment) -> EnergyCause:
        """The cause of a moment: a signal, then what was shown, then what would have been best."""
        self._before = self._named(now)
        return self._before

    def _named(self, now: Moment) -> EnergyCause:
        if now.signal:
            return EnergyCause.SIGNAL
        if now.seen is not None and now.seen.mode is not Mode.NONE:
            return self._by_advice(now, now.seen)
        self._coasting_due, self._over_moments = False, 0
        return _by_best(now)

    def _by_advice(self, now: Moment, seen: Seen) -> EnergyCause:
        over = now.speed_mps > seen.speed_mps + OVER_MPS and seen.speed_mps > 0
        slowing = seen.mode in (Mode.COAST, *BRAKING) and not seen.top_only
        if slowing and not self._coasting_due:
            self._was_over = self._over_moments >= LASTS
            self._neutral_moments = self._slowing_moments = 0
        self._coasting_due = slowing
        self._over_moments = self._over_moments + 1 if over and not slowing else 0
        self._slowing_moments += 1
        if slowing and now.pulls:
            # What was against the advice before it changed goes on for the moment that the driver takes to react.
            goes_on = self._slowing_moments <= LASTS and self._before is EnergyCause.AGAINST_ADVICE
            return EnergyCause.AGAINST_ADVICE if self._was_over or goes_on else EnergyCause.LATE_COASTING
        if seen.mode is Mode.COAST and not seen.top_only:
            return self._coasting(now)
        if over and not now.brakes:
            return EnergyCause.AGAINST_ADVICE
        return EnergyCause.AGAINST_ADVICE if _other_effort(now, seen) else EnergyCause.AS_ADVISED

    def _coasting(self, now: Moment) -> EnergyCause:
        """The cause of a moment without traction while coasting is advised.

        A driver who still holds the speed may have to brake downhill: coasting has not begun then.
        """
        if not now.brakes:
            self._neutral_moments += 1
            return EnergyCause.AS_ADVISED
        begun = self._neutral_moments >= LASTS or self._was_over
        return EnergyCause.AGAINST_ADVICE if begun else EnergyCause.LATE_COASTING


def _other_effort(now: Moment, seen: Seen) -> bool:
    """Whether the effort leads away from what was advised."""
    if seen.top_only or seen.mode is Mode.DEPART:  # How to depart is no advice for a moment of its own.
        return False
    if math.isnan(seen.lever_ratio) or math.isnan(seen.advised_ratio):
        return seen.mode in PULLING and now.brakes
    more = max(seen.lever_ratio - seen.advised_ratio, now.driven_ratio - max(seen.advised_ratio, 0.0))
    less = seen.advised_ratio - seen.lever_ratio
    faster, slower = now.speed_mps > seen.speed_mps - SAME_MPS, now.speed_mps < seen.speed_mps - OVER_MPS
    return (more > EFFORT_RATIO and faster) or (less > EFFORT_RATIO and slower)


def _by_best(now: Moment) -> EnergyCause:
    """The cause where no advice was shown: how the effort differed from that of the best run from here."""
    if math.isnan(now.best_ratio):
        return EnergyCause.REST
    more = now.driven_ratio - now.best_ratio
    if now.coasts_to_brake and now.pulls:
        return EnergyCause.LATE_COASTING
    if more > EFFORT_RATIO:
        return EnergyCause.TOO_FAST
    return EnergyCause.TOO_SLOW if more < -EFFORT_RATIO else EnergyCause.REST


def effort_ratio(run: Trajectory, vehicle: Vehicle, since_s: float) -> float:
    """Mean effort of a run over the next seconds from a time on it, as a share of the largest traction there."""
    first = max(int(np.searchsorted(run.t_s, since_s, side="right")) - 1, 0)
    end = max(int(np.searchsorted(run.t_s, since_s + AHEAD_S)), first + 1)
    total_n = (run.force_el_n + run.force_friction_n)[first:end]
    over_s = np.diff(run.t_s)[first:end]
    if not len(over_s) or over_s.sum() <= 0:
        return 0.0
    largest_n = float(vehicle.traction_effort_n(np.array([run.v_mps[first]]))[0])
    return float(total_n @ over_s / over_s.sum()) / max(largest_n, 1.0)


def coasts_to_brake(run: Trajectory, vehicle: Vehicle) -> bool:
    """Whether a run coasts now, and brakes before it pulls again."""
    total_n = run.force_el_n + run.force_friction_n
    ratio = total_n / np.maximum(vehicle.traction_effort_n(run.v_mps[:-1]), 1.0)
    acts = np.flatnonzero(np.abs(ratio) > NEUTRAL_RATIO)
    # The first intervals after a state may hold a last bit of what came before.
    return bool(len(acts) and run.t_s[acts[0]] > AHEAD_S and ratio[acts[0]] < 0)
