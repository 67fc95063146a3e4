"""Building blocks of your own driver: hold a speed, brake to one, stop at a mark, keep time, notches, noise.

All settings are the controller's, from −1 (both brakes) to 1 (full traction), for `sim.plant.plant.lever`.
"""

from __future__ import annotations

import math
from typing import Final, Self

import numpy as np

from das.domain.errors import DasError
from das.domain.units import KMH
from sim.drivers.cab import AdviceView, Asked, CabView, asked
from sim.drivers.handling import CREEPS_MPS, Wander
from sim.drivers.knowledge import Foresight, Habit, LineKnowledge, Outlook
from sim.drivers.presentations.presenter import SpeedIs, presenter_of
from sim.drivers.tracking import (
    ANTICIPATION_S,
    JUDGED_EVERY_S,
    STOPPING_RATIO,
    TimeRule,
    hold,
    stop_at,
    under_ceiling,
)
from sim.plant.kernels import Command, demanded
from sim.plant.plant import Efforts

BEFORE_SIGNAL_M: Final = 15.0
"""Distance (m) before a signal at danger at which a train is stopped."""
CALM_PER_S: Final = 0.1
"""Share of a speed error that is corrected per second."""


class Skills:
    """The abilities of a practised driver: each skill returns a controller setting for the present state of the cab.

    Call `see` at every look, then ask for settings. Braking is planned with `braking_mps2`. Speeds stay below limits
    by `below_mps`, or by a tenth of the limit if that is less. Only the setting of `most` keeps the limits: use it if
    it is lower than yours.
    """

    def __init__(self, line: LineKnowledge, *, braking_mps2: float = 0.5, below_mps: float = 2.0 * KMH) -> None:
        self.braking_mps2 = braking_mps2
        self._foresight = Foresight(line, Habit(braking_mps2=braking_mps2, below_mps=below_mps))
        self._rule = TimeRule(JUDGED_EVERY_S)
        self._cab: CabView | None = None
        self._outlook: Outlook | None = None

    def see(self, cab: CabView) -> Self:
        """Take the view of the cab as present; a signal at danger counts as `BEFORE_SIGNAL_M` nearer than it is."""
        self._cab = cab._replace(signal_m=cab.signal_m - BEFORE_SIGNAL_M)
        self._outlook = self._foresight.outlook(self._cab)
        return self

    @property
    def cab(self) -> CabView:
        """The last view of the cab."""
        assert self._cab is not None, "call see(cab) first"
        return self._cab

    @property
    def outlook(self) -> Outlook:
        """The line up to the next stop, with the highest speed whose planned braking keeps all limits and stops
        ahead."""
        assert self._outlook is not None, "call see(cab) first"
        return self._outlook

    @property
    def halt_in_m(self) -> float:
        """The distance (m) to where the train must stand next."""
        return self.cab.halt_m - self.cab.s_m

    def hold(self, speed_mps: float) -> float:
        """The setting that holds a speed, including the force needed here."""
        return self._ratio(hold(self.cab, self.outlook, speed_mps)._replace(gain_per_s=CALM_PER_S))

    def brake_to(self, speed_mps: float, at_m: float) -> float | None:
        """The setting with which the train reaches a lower speed at a place (m); None while braking is too early."""
        cab, way_m = self.cab, at_m - self.cab.s_m
        if cab.speed_mps <= speed_mps:
            return None
        needed_mps2 = (cab.speed_mps**2 - speed_mps**2) / (2.0 * way_m) if way_m > 0 else self.braking_mps2
        if needed_mps2 < STOPPING_RATIO * self.braking_mps2:
            return None
        force_n = self.outlook.resisting_n(cab.s_m, cab.speed_mps) - self.outlook.train.inertial_mass_kg * needed_mps2
        return self._efforts().lever_ratio(force_n)

    def stop_at(self, mark_m: float) -> float | None:
        """The setting that stops the train at a mark (m); None above 10 m/s, and while braking is too early."""
        found = stop_at(self.cab, self.outlook, mark_m, self.braking_mps2)
        return None if found is None else self._ratio(found)

    def most(self) -> float:
        """The highest setting that limits, restrictions, signals and stops allow; it stops the train at its halt."""
        below = self._ratio(under_ceiling(self.cab, self.outlook, ANTICIPATION_S))
        stopping = self.stop_at(self.cab.halt_m)
        return below if stopping is None else stopping

    def timely_mps(self) -> float:
        """The top speed (m/s) with which the rest of the section takes the time left by the timetable."""
        return self._rule.cap_mps(self.cab, self.outlook)

    def advised(self, view: AdviceView) -> float | None:
        """The setting that follows the display (`sim.drivers.cab`); None if it does not show how to drive. For "stop"
        without an effort, the speed is held until the last moment to brake.
        """
        presenter = presenter_of(view.presentation)
        to_reach = presenter.speed_is(view.mode) is SpeedIs.TO_REACH
        to_mps, effort = view.shown_speed_mps if to_reach else math.nan, view.lever_ratio
        told = asked(view.mode, to_mps, effort, self.cab.speed_mps) if presenter.says_mode else None
        if told is Asked.HOLD:
            return self.hold(view.shown_speed_mps)
        if told is Asked.ACCELERATE:
            return 1.0 if math.isnan(effort) else effort
        if told is Asked.BRAKE:
            return -0.5 if math.isnan(effort) else effort
        if told is Asked.BRAKE_BY_EYE:
            return min(self.hold(max(self.cab.speed_mps, CREEPS_MPS)), self.most())
        if told is Asked.KEEP_BELOW:
            return min(self.hold(view.shown_speed_mps), 0.0)
        return None if told is None else 0.0

    def _efforts(self) -> Efforts:
        return Efforts.at(self.cab.speed_mps, self.outlook.train)

    def _ratio(self, command: Command) -> float:
        return self._efforts().lever_ratio(demanded(command, 0.0, self.cab.speed_mps, self.outlook.train))


class NotchedLever:
    """A controller with a number of notches in each direction, which moves by whole notches."""

    def __init__(self, count: int) -> None:
        if count < 1:
            raise DasError(f"NotchedLever: count = {count}: expected at least one notch each way")
        self.count, self.notch = count, 0

    def set(self, wanted: float, most: float = 1.0) -> float:
        """The notch after moving to that nearest to `wanted` if it is a whole notch away; never above `most`."""
        if abs(self.count * wanted - self.notch) >= 1.0:
            self.notch = round(self.count * wanted)
        self.notch = min(self.notch, math.floor(self.count * most))
        return self.notch / self.count


class WanderingError:
    """An error that varies slowly about 0, drawn with a seed: the same seed gives the same error at the same looks."""

    def __init__(self, seed: int, *, deviation: float, correlation_s: float) -> None:
        self._deviation = deviation
        self._wander = Wander(correlation_s, np.random.default_rng(seed))
        self._time_s: float | None = None

    def at(self, time_s: float) -> float:
        """The error at a time (s), which must not be before the time of the last call."""
        if self._time_s is not None:
            self._wander.over(time_s - self._time_s)
        self._time_s = time_s
        return self._deviation * self._wander.value
