"""The causes of the energy above the optimum: the advice shown, the driver's actions, and the cause of each moment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Source
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.domain.trajectory import Trajectory
from das.domain.vehicle import Vehicle
from sim.drive.table import HOLDS_NS, DriveTable
from sim.drivers.presentations.presenter import SpeedIs, known_mode, presenter_of, shown_presentation
from sim.options import WhatIfKind
from sim.recording.course import Floats, Times
from sim.recording.opening import WHAT_IF


class EnergyCause(StrEnum):
    """A reason for energy above the optimum for the same times (docs/explanation/where-the-energy-went.md)."""

    TOO_MUCH_EFFORT = "too-much-effort"
    LATE_COASTING = "late-coasting"
    TOO_LITTLE_EFFORT = "too-little-effort"
    AGAINST_ADVICE = "against-advice"
    AS_ADVISED = "as-advised"
    LATENESS = "lateness"
    FRICTION = "friction"
    SIGNAL = "signal"
    RESTRICTION = "restriction"
    TRAIN = "train"
    REST = "rest"
    RECOVERED = "lateness-recovered"
    """Counted only against the timetable's optimum, like `ARRIVAL`: the optimum for the same times includes both."""
    ARRIVAL = "arrival-off-timetable"

    @property
    def label(self) -> str:
        """The cause in a few words."""
        return LABELS[self]

    @property
    def meaning(self) -> str:
        """One sentence about what is counted under the cause."""
        return MEANINGS[self]

    @property
    def next_time(self) -> str:
        """One sentence of advice to the driver for the next time."""
        return NEXT_TIME.get(self, NOT_THE_DRIVERS)


LABELS = {
    EnergyCause.TOO_MUCH_EFFORT: "too much effort",
    EnergyCause.LATE_COASTING: "coasting begun late",
    EnergyCause.TOO_LITTLE_EFFORT: "too little effort, made up later",
    EnergyCause.AGAINST_ADVICE: "against the advice",
    EnergyCause.AS_ADVISED: "driven as advised",
    EnergyCause.LATENESS: "hurried, and yet late",
    EnergyCause.FRICTION: "friction brake instead of the motors",
    EnergyCause.SIGNAL: "signal at danger",
    EnergyCause.RESTRICTION: "temporary restriction",
    EnergyCause.TRAIN: "train, wind, rail",
    EnergyCause.REST: "rest, not attributed",
    EnergyCause.RECOVERED: "lateness recovered",
    EnergyCause.ARRIVAL: "arrival off the timetable",
}

MEANINGS = {
    EnergyCause.TOO_MUCH_EFFORT: "No advice was shown; the effort exceeded the best run's, to recover lost time.",
    EnergyCause.LATE_COASTING: "The train should have coasted, but had traction, or held its speed by braking.",
    EnergyCause.TOO_LITTLE_EFFORT: "No advice was shown; the effort was below the best run's, and higher later.",
    EnergyCause.AGAINST_ADVICE: "Advice was shown, but speed or effort differed from it.",
    EnergyCause.AS_ADVISED: "The advice was followed, or its speed was reached. Correcting speeds costs energy.",
    EnergyCause.LATENESS: "The train hurried, with or without advice, for an arrival that it missed by more than 10 s.",
    EnergyCause.FRICTION: "The friction brake dissipated energy that the motors could have fed back.",
    EnergyCause.SIGNAL: "A signal at danger was in sight.",
    EnergyCause.RESTRICTION: "The cost of a restriction from its announcement on; no driver could have avoided it.",
    EnergyCause.TRAIN: "Train, wind or rail were not as planned; this includes errors of sampling once a second.",
    EnergyCause.REST: "The driving was nearly the best, or the cause is not known.",
    EnergyCause.RECOVERED: "The train left late; arriving by the timetable takes at least this much more energy.",
    EnergyCause.ARRIVAL: "Arriving before the timetable's time costs energy, arriving after it saves some.",
}

NEXT_TIME: Final = {
    EnergyCause.TOO_MUCH_EFFORT: "Next time: follow the best run at each place.",
    EnergyCause.LATE_COASTING: "Next time: begin to coast earlier.",
    EnergyCause.TOO_LITTLE_EFFORT: "Next time: accelerate more there, but keep a margin to the limit.",
    EnergyCause.AGAINST_ADVICE: "Next time: drive as shown, or report why that was not possible.",
    EnergyCause.LATENESS: "Next time: do not hurry for an arrival that is out of reach.",
    EnergyCause.FRICTION: "Next time: brake with the motors alone, and match the speed of the best run at each place.",
}
NOT_THE_DRIVERS: Final = "Nothing for the driver to change."
"""Text for a cause that is not in `NEXT_TIME`."""
BY_SPEED: Final = frozenset(
    {EnergyCause.TOO_MUCH_EFFORT, EnergyCause.LATE_COASTING, EnergyCause.TOO_LITTLE_EFFORT, EnergyCause.AGAINST_ADVICE}
)
"""Causes about the speed of the train."""


class Seen(NamedTuple):
    """Advice that a driver saw: mode, speed (m/s), effort as a share of the largest (NaN: none).

    `lever_ratio` is the setting of the controller then. `top_only`: only a highest speed is advised.
    """

    mode: Regime
    speed_mps: float
    advised_ratio: float
    lever_ratio: float
    top_only: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownAdvice:
    """The advice shown over a drive, arrays of shape (messages,); `shown` is False where nothing was shown.

    `speed_now`: the speed is to be held at this moment, not to be reached later.
    """

    time_ns: Times
    shown: NDArray[np.bool_]
    mode: NDArray[np.int64]
    speed_mps: Floats
    advised_ratio: Floats
    lever_ratio: Floats
    top_only: NDArray[np.bool_]
    speed_now: NDArray[np.bool_]

    @classmethod
    def of(cls, table: DriveTable) -> ShownAdvice:
        """The content of the display; if no display was recorded, the node's advice counts as shown.

        Nobody saw the advice of a replay or of a what-if in open loop: the train moves as in the original recording.
        """
        unseen = table.run.get("kind") == "replay" or table.run.get(WHAT_IF) == WhatIfKind.OPEN_LOOP
        names = "mode", "advised_speed_mps"
        if table.has("cab") and not unseen:
            time_ns, presentation, mode, speed_mps, advised_ratio, lever_ratio = table.of_topic(
                "cab", "presentation", *names, "advised_lever_ratio", "lever_ratio"
            )
            speed_is = np.array([_speed_is(*one) for one in zip(presentation, mode, strict=True)])
            shown, top_only, speed_now = presentation > 0, speed_is == SpeedIs.HIGHEST, speed_is == SpeedIs.TO_HAVE
        else:
            time_ns, source, mode, speed_mps, advised_ratio = table.of_topic(
                "advice", "source", *names, "advised_force_ratio"
            )
            lever_ratio = np.full(len(time_ns), math.nan)
            shown = (source != Source.NONE) & (not unseen)
            top_only, speed_now = np.zeros(len(time_ns), dtype=bool), np.ones(len(time_ns), dtype=bool)
        return cls(
            time_ns=time_ns, shown=shown, mode=mode, speed_mps=speed_mps, advised_ratio=advised_ratio,
            lever_ratio=lever_ratio, top_only=top_only, speed_now=speed_now,
        )  # fmt: skip

    def at(self, time_ns: int) -> Seen | None:
        """The advice that the driver saw at a time; None if nothing was shown."""
        last = int(np.searchsorted(self.time_ns, time_ns, side="right")) - 1
        if last < 0 or not self.shown[last] or time_ns - int(self.time_ns[last]) > HOLDS_NS:
            return None
        return Seen(
            mode=known_mode(int(self.mode[last])),
            speed_mps=float(self.speed_mps[last]),
            advised_ratio=float(self.advised_ratio[last]),
            lever_ratio=float(self.lever_ratio[last]),
            top_only=bool(self.top_only[last]),
        )

    @property
    def comparable(self) -> NDArray[np.bool_]:
        """Mask of messages with a speed to hold now or not to exceed, with which the train's speed can be compared."""
        return self.shown & (self.speed_mps > 0) & (self.speed_now | self.top_only)

    @property
    def any_shown(self) -> bool:
        """Whether anything was shown at all."""
        return bool(self.shown.any())


def _speed_is(number: int, mode: int) -> SpeedIs:
    """The meaning of the speed shown; in an unknown presentation, only a cruising speed is a speed to hold now."""
    presentation = shown_presentation(number)
    if presentation is None:
        return SpeedIs.TO_HAVE if mode == Regime.CRUISE else SpeedIs.TO_REACH
    return presenter_of(presentation).speed_is(mode)


APART_MPS: Final = 2.0 / 3.6
"""Least deviation (m/s) from the advised speed that counts as against the advice: displays show whole km/h, drivers
keep within one or two."""
SAME_MPS: Final = 1.0 / 3.6
"""Least shortfall (m/s) below the advised speed for which a train may need more effort than advised."""
LASTS: Final = 3
"""Least number of consecutive moments of a deliberate act of the driver."""
NEUTRAL_RATIO: Final = 0.03
"""Share of the largest traction below which an effort counts as none: the train coasts."""
EFFORT_RATIO: Final = 0.15
"""Share of the largest traction by which different efforts differ."""
AHEAD_S: Final = 2.0
"""Time (s) over which actual and optimal effort are compared, because forces take a second to build up."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """A moment of a drive: speed, efforts as shares of the largest traction, and what was shown and seen.

    `driven_ratio` is the effort of the driven train over the next seconds, `best_ratio` that of the optimal trajectory
    from here (NaN: there is none); `coasts_to_brake`: that trajectory coasts now and brakes next.
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
    """Finds the cause to which the energy of each moment belongs; the moments must come in order of time."""

    def __init__(self) -> None:
        self._coasting_due = self._was_over = False
        self._over_moments = self._neutral_moments = self._slowing_moments = 0
        self._before = EnergyCause.REST

    def cause(self, now: Moment) -> EnergyCause:
        """The cause of a moment, judged by a signal in sight; else by the advice shown; else by the optimum."""
        self._before = self._named(now)
        return self._before

    def _named(self, now: Moment) -> EnergyCause:
        if now.signal:
            return EnergyCause.SIGNAL
        if now.seen is not None and now.seen.mode is not Regime.NONE:
            return self._by_advice(now, now.seen)
        self._coasting_due, self._over_moments = False, 0
        return _by_best(now)

    def _by_advice(self, now: Moment, seen: Seen) -> EnergyCause:
        over = now.speed_mps > seen.speed_mps + APART_MPS and seen.speed_mps > 0
        slowing = seen.mode in (Regime.COAST, *BRAKES) and not seen.top_only
        if slowing and not self._coasting_due:
            self._was_over = self._over_moments >= LASTS
            self._neutral_moments = self._slowing_moments = 0
        self._coasting_due = slowing
        self._over_moments = self._over_moments + 1 if over and not slowing else 0
        self._slowing_moments += 1
        if slowing and now.pulls:
            # A driver who drove against the advice before it changed still does so during the reaction to the change.
            goes_on = self._slowing_moments <= LASTS and self._before is EnergyCause.AGAINST_ADVICE
            return EnergyCause.AGAINST_ADVICE if self._was_over or goes_on else EnergyCause.LATE_COASTING
        if seen.mode is Regime.COAST and not seen.top_only:
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
    if seen.top_only or seen.mode is Regime.DEPART:  # The advice to depart does not apply to a moving train.
        return False
    if math.isnan(seen.lever_ratio) or math.isnan(seen.advised_ratio):
        return seen.mode in TRACTION and now.brakes
    more = max(seen.lever_ratio - seen.advised_ratio, now.driven_ratio - max(seen.advised_ratio, 0.0))
    less = seen.advised_ratio - seen.lever_ratio
    faster, slower = now.speed_mps > seen.speed_mps - SAME_MPS, now.speed_mps < seen.speed_mps - APART_MPS
    return (more > EFFORT_RATIO and faster) or (less > EFFORT_RATIO and slower)


def _by_best(now: Moment) -> EnergyCause:
    """The cause if no advice was shown: the difference of the effort from that of the optimum from here on."""
    if math.isnan(now.best_ratio):
        return EnergyCause.REST
    more = now.driven_ratio - now.best_ratio
    if now.coasts_to_brake and now.pulls:
        return EnergyCause.LATE_COASTING
    if more > EFFORT_RATIO:
        return EnergyCause.TOO_MUCH_EFFORT
    return EnergyCause.TOO_LITTLE_EFFORT if more < -EFFORT_RATIO else EnergyCause.REST


def effort_ratio(run: Trajectory, vehicle: Vehicle, since_s: float) -> float:
    """Mean effort of a trajectory in the `AHEAD_S` after `since_s`, as a share of the largest traction there."""
    first = max(int(np.searchsorted(run.t_s, since_s, side="right")) - 1, 0)
    end = max(int(np.searchsorted(run.t_s, since_s + AHEAD_S)), first + 1)
    total_n = (run.force_el_n + run.force_friction_n)[first:end]
    over_s = np.diff(run.t_s)[first:end]
    if not len(over_s) or over_s.sum() <= 0:
        return 0.0
    largest_n = float(vehicle.traction_effort_n(np.array([run.v_mps[first]]))[0])
    return float(total_n @ over_s / over_s.sum()) / max(largest_n, 1.0)


def coasts_to_brake(run: Trajectory, vehicle: Vehicle) -> bool:
    """Whether a trajectory coasts now, and brakes before it applies traction again."""
    total_n = run.force_el_n + run.force_friction_n
    ratio = total_n / np.maximum(vehicle.traction_effort_n(run.v_mps[:-1]), 1.0)
    acts = np.flatnonzero(np.abs(ratio) > NEUTRAL_RATIO)
    # The first intervals from a state may hold a remainder of the regime before it.
    return bool(len(acts) and run.t_s[acts[0]] > AHEAD_S and ratio[acts[0]] < 0)
