"""How a human driver holds a speed and brakes: the controller's setting that each of them asks for."""

from __future__ import annotations

import math

import numpy as np

from sim.drivers.cab import CabView, Efforts
from sim.drivers.chance import Errors
from sim.drivers.human_settings import HumanSettings
from sim.drivers.kinds import FrictionPolicy
from sim.drivers.knowledge import Outlook
from sim.drivers.parameters import HumanParameters
from sim.drivers.rule_settings import TRACKING
from sim.drivers.tracking import RollOff
from sim.plant.kernels import TrainNumbers


class StopMark:
    """Where the driver takes the mark of the next halt to be: drawn once for each halt, never beyond a signal."""

    def __init__(self, human: HumanParameters, settings: HumanSettings, random: np.random.Generator) -> None:
        self._human, self._settings, self._random = human, settings, random
        self._for_m, self._off_m = math.nan, 0.0

    def at_m(self, cab: CabView) -> float:
        """The position (m) of the mark."""
        if cab.halt_m != self._for_m:
            self._for_m = cab.halt_m
            most_m = self._settings.missed_m
            off_m = self._human.stop_error_m * float(self._random.standard_normal())
            off_m = min(max(off_m, -most_m), most_m)
            self._off_m = -abs(off_m) if cab.signal_m < cab.stop_m else off_m
        return cab.halt_m + self._off_m


class SpeedHold:
    """Holding a speed with the driver's dead band: what he is correcting is remembered from look to look."""

    def __init__(self, human: HumanParameters, settings: HumanSettings) -> None:
        self._human, self._settings = human, settings
        self._correcting = self._restraining = False

    def stand(self) -> None:
        """The train stands: nothing is being corrected."""
        self._correcting = False

    def push_n(self, error_mps: float, mass_kg: float) -> float:
        """The wheel force (N) that takes an error of the speed (wanted − actual, m/s) away.

        One within the dead band is left, one that is being corrected is corrected nearly to the end.
        """
        human, settings = self._human, self._settings
        if abs(error_mps) > human.dead_band_mps:
            self._correcting = True
        elif abs(error_mps) <= settings.settled_ratio * human.dead_band_mps:
            self._correcting = False
        return settings.gain_per_s * mass_kg * error_mps if self._correcting else 0.0

    def force_n(self, error_mps: float, needed_n: float, mass_kg: float, *, crawls: bool) -> float:
        """The wheel force (N) for an error of the speed (wanted − actual, m/s); the speed itself needs `needed_n`.

        A small excess is rolled off. `crawls`: the train is about to stop.
        """
        settings = self._settings
        force_n = needed_n + self.push_n(error_mps, mass_kg)
        # Downhill the driver brakes until the speed is right, then lets the train roll; otherwise he would brake every
        # few seconds.
        if not self._correcting or error_mps > 0 or crawls:
            self._restraining = False
        elif error_mps <= -settings.roll_mps:
            self._restraining = True
        return 0.0 if force_n < 0 and not self._restraining else force_n


class Handling:
    """Holding a speed and braking, with the driver's dead band and errors."""

    def __init__(
        self,
        human: HumanParameters,
        settings: HumanSettings,
        errors: Errors,
        mark: StopMark,
        train: TrainNumbers,
        friction: FrictionPolicy = FrictionPolicy.AS_MEASURED,
    ) -> None:
        self._human, self._settings, self._errors, self._mark = human, settings, errors, mark
        self._friction = friction
        self._hold, self._ceiling = SpeedHold(human, settings), SpeedHold(human, settings)
        self._braking = False
        self.brakes_hard = False
        """Whether he brakes for a limit or a stop so hard that the brakes cannot wait."""
        self._roll_off = RollOff()
        self.efforts = Efforts.at(0.0, train)
        """What the train can do at the present speed."""

    @property
    def needs_brakes(self) -> bool:
        """Whether a limit or a stop asks for brakes, by his own margins."""
        return self._braking

    def stand(self) -> None:
        """The train stands: nothing is being corrected and the driver is not braking for anything."""
        self._braking = False
        self._hold.stand()
        self._ceiling.stand()

    def friction_ratio(self, *, follows_effort: bool) -> float:
        """The share of a braking effort that he asks of the friction brake though the motors could give it."""
        by_advice = self._friction is FrictionPolicy.BY_ADVICE and follows_effort
        electric = by_advice or self._friction is FrictionPolicy.ELECTRIC_FIRST
        return 0.0 if electric else self._human.friction_ratio

    def under_top(self, cab: CabView, outlook: Outlook, top_mps: float, allowed_mps: float, *, rolls: bool) -> float:
        """The setting that holds a top speed, or what is allowed if that is less.

        When the top speed is lowered, the driver lets the train roll down to it, if he `rolls`.
        """
        rolled_mps = self._roll_off.speed_mps(top_mps if rolls else math.inf, cab.speed_mps)
        if rolled_mps is None:
            return self.held(cab, outlook, min(top_mps, allowed_mps))
        return min(self.held(cab, outlook, min(rolled_mps, allowed_mps)), 0.0)

    def held(self, cab: CabView, outlook: Outlook, speed_mps: float, *, ceiling: bool = False) -> float:
        """The setting that holds a speed: the one he means to drive at, or a `ceiling` over advice on effort."""
        error = speed_mps + min(self._errors.speed_mps, self._human.below_limit_mps) - cab.speed_mps
        needed_n, mass_kg = outlook.resisting_n(cab.s_m, cab.speed_mps), outlook.train.inertial_mass_kg
        crawls = cab.speed_mps <= TRACKING.stopping_mps
        hold = self._ceiling if ceiling else self._hold
        return self.efforts.lever_ratio(
            hold.force_n(error, needed_n, mass_kg, crawls=crawls) * self._errors.force_ratio
        )

    def corrected(self, cab: CabView, outlook: Outlook, speed_mps: float) -> float:
        """By how much he sets the controller off an advised effort (−1 … 1), because the train is not at its speed."""
        error = speed_mps + self._errors.speed_mps - cab.speed_mps
        return self.efforts.lever_ratio(self._hold.push_n(error, outlook.train.inertial_mass_kg))

    def needed_braking(self, cab: CabView, outlook: Outlook, reach_s: float) -> float | None:
        """The deceleration for what lies ahead (m/s²), from shortly before it is needed until it is done; else None.

        `reach_s` is the time in which the hand gets the controller back from traction.
        """
        human, settings, v, s = self._human, self._settings, cab.speed_mps, cab.s_m
        needed = outlook.needed_braking_mps2(s, v, v * settings.eased_s)
        if v <= TRACKING.stopping_mps:
            way_m = self._mark.at_m(cab) - s
            stopping = v * v / (2.0 * way_m) if way_m > settings.nearest_m else human.braking_mps2
            if stopping >= settings.released_ratio * human.braking_mps2:
                self._braking = self.brakes_hard = True
                return stopping
        ahead_m = v * (human.early_braking_s + reach_s)
        if v > outlook.allowed_mps(s + ahead_m) + min(human.dead_band_mps, human.below_limit_mps):
            self._braking = True
        elif needed < settings.released_ratio * human.braking_mps2:
            rolls_mps2 = -outlook.resisting_n(s, v) / outlook.train.inertial_mass_kg
            # On a descent that would bring the speed back at once, the brake is eased and kept, not given up.
            steep = rolls_mps2 * settings.regained_s > human.dead_band_mps
            settled_mps = -human.dead_band_mps if steep else settings.settled_mps
            self._braking = self._braking and v > max(outlook.allowed_mps(s) + settled_mps, TRACKING.stopping_mps)
        self.brakes_hard = self._braking and needed >= settings.released_ratio * human.braking_mps2
        return needed if self._braking else None

    def braked(self, cab: CabView, outlook: Outlook, needed_mps2: float) -> float:
        """The setting for a deceleration, which is at most twice the one that he plans with."""
        rate = min(max(needed_mps2, 0.0), 2.0 * self._human.braking_mps2)
        force_n = outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * rate
        return self.efforts.lever_ratio(force_n * self._errors.force_ratio)
