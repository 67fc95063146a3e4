"""How human drivers hold a speed, brake and move the controller, with what all human drivers share.
Parameters that differ between drivers, or that a scenario can set, are in `sim.drivers.parameters`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from das.domain.units import KMH
from sim.drivers.cab import AT_STOP_M, CabView, Diary
from sim.drivers.kinds import FrictionPolicy
from sim.drivers.knowledge import Outlook
from sim.drivers.parameters import HumanParameters
from sim.drivers.tracking import STOPPING_MPS, RollOff
from sim.plant.kernels import TrainNumbers
from sim.plant.plant import Efforts

# What all human drivers share. All values are assumptions, chosen so that the drives look realistic.
GAIN_PER_S: Final = 0.1
"""Share of a speed error that a driver corrects per second."""
SETTLED_RATIO: Final = 0.25
"""Share of the dead band down to which the speed error is corrected."""
ROLL_MPS: Final = 2.0
"""Least excess (m/s) over the intended speed for which a driver brakes."""
RELEASED_RATIO: Final = 0.6
"""Share of the planned deceleration down to which the brakes stay applied."""
SETTLED_MPS: Final = 0.1
"""Excess over a limit (m/s) at which braking for it ends."""
REGAINED_S: Final = 10.0
"""Least time (s) in which a descent adds the dead band to the speed for the brakes to be released there."""
EASED_S: Final = 6.0
"""Time (s) in which a driver removes the excess over a limit by braking."""
NEAREST_M: Final = 0.3
"""Last distance (m) before the mark; within it and beyond the mark, the driver brakes as planned."""
MISSED_M: Final = 0.5 * AT_STOP_M
"""Largest misjudgement (m) of the place of a mark. Braking adds a further error, and a train further off than
`AT_STOP_M` counts as not arrived."""
CREEPS_MPS: Final = 10.0 * KMH
"""Lowest speed (m/s) of a driver who brakes for a stop by eye, before braking is necessary."""
WAITS_S: Final = 5.0
"""Time (s) that a driver waits after setting the controller to see the effect before a small change. The
effort takes 1 to 2 s to build up, and at 0.1 m/s² the speedometer needs 3 s for 1 km/h."""
WAITS_RATIO: Final = 0.3
"""Share of the controller's scale above which a change is not small: one and a half steps of a display."""


class Wander:
    """An Ornstein–Uhlenbeck process with standard deviation 1 and a correlation time (s)."""

    def __init__(self, correlation_s: float, random: np.random.Generator) -> None:
        self._correlation_s, self._random = correlation_s, random
        self.value = float(random.standard_normal())

    def over(self, span_s: float) -> None:
        """Advance by a time (s); the step is exact for any length."""
        keep = math.exp(-span_s / self._correlation_s)
        self.value = keep * self.value + math.sqrt(1.0 - keep * keep) * float(self._random.standard_normal())


class Errors:
    """The slowly wandering errors of a driver's speed and effort."""

    def __init__(self, human: HumanParameters, speed: np.random.Generator, force: np.random.Generator) -> None:
        self._human = human
        self._speed, self._force = Wander(human.speed_error_s, speed), Wander(human.force_error_s, force)

    def over(self, span_s: float) -> None:
        """Advance by a time (s)."""
        self._speed.over(span_s)
        self._force.over(span_s)

    @property
    def speed_mps(self) -> float:
        """The excess (m/s) of the actual speed over the intended one."""
        return self._human.speed_error_mps * self._speed.value

    @property
    def force_ratio(self) -> float:
        """The effort set, as a share of the intended one (1: no error; never below 0)."""
        return max(1.0 + self._human.force_error_ratio * self._force.value, 0.0)


class StopMark:
    """The driver's estimate of the next stopping point: drawn once for each halt, never beyond a signal."""

    def __init__(self, human: HumanParameters, random: np.random.Generator) -> None:
        self._human, self._random = human, random
        self._for_m, self._off_m = math.nan, 0.0

    def at_m(self, cab: CabView) -> float:
        """The estimated position (m) of the mark."""
        if cab.halt_m != self._for_m:
            self._for_m = cab.halt_m
            off_m = self._human.stop_error_m * float(self._random.standard_normal())
            off_m = min(max(off_m, -MISSED_M), MISSED_M)
            self._off_m = -abs(off_m) if cab.signal_m < cab.stop_m else off_m
        return cab.halt_m + self._off_m


class SpeedHold:
    """Holding of a speed with the driver's dead band; keeps between looks whether an error is being corrected."""

    def __init__(self, human: HumanParameters) -> None:
        self._human = human
        self._correcting = self._restraining = False

    def stand(self) -> None:
        """Record that the train stands: nothing is being corrected."""
        self._correcting = False

    def push_n(self, error_mps: float, mass_kg: float) -> float:
        """The wheel force (N) that corrects an error of the speed (wanted − actual, m/s).

        A new error within the dead band is not corrected; a correction continues until the error is nearly zero.
        """
        human = self._human
        if abs(error_mps) > human.dead_band_mps:
            self._correcting = True
        elif abs(error_mps) <= SETTLED_RATIO * human.dead_band_mps:
            self._correcting = False
        return GAIN_PER_S * mass_kg * error_mps if self._correcting else 0.0

    def force_n(self, error_mps: float, needed_n: float, mass_kg: float, *, crawls: bool) -> float:
        """The wheel force (N) for an error of the speed (wanted − actual, m/s); holding the speed needs `needed_n`.

        If the train is only slightly too fast, it rolls. `crawls`: the train is about to stop.
        """
        force_n = needed_n + self.push_n(error_mps, mass_kg)
        # Downhill the driver brakes until the speed is right and then lets the train roll, to brake less often.
        if not self._correcting or error_mps > 0 or crawls:
            self._restraining = False
        elif error_mps <= -ROLL_MPS:
            self._restraining = True
        return 0.0 if force_n < 0 and not self._restraining else force_n


class Handling:
    """Holding of speeds, and braking, with the driver's dead band and errors."""

    def __init__(
        self,
        human: HumanParameters,
        errors: Errors,
        mark: StopMark,
        train: TrainNumbers,
        friction: FrictionPolicy = FrictionPolicy.AS_MEASURED,
    ) -> None:
        self._human, self._errors, self._mark, self._friction = human, errors, mark, friction
        self._hold, self._ceiling = SpeedHold(human), SpeedHold(human)
        self._braking = False
        self.brakes_hard = False
        """Whether the braking for a limit or a stop is so hard that the hand must not wait."""
        self._roll_off = RollOff()
        self.efforts = Efforts.at(0.0, train)
        """The largest efforts of the train at the present speed."""

    def stand(self) -> None:
        """Record that the train stands: the driver is neither correcting nor braking."""
        self._braking = False
        self._hold.stand()
        self._ceiling.stand()

    def friction_ratio(self, *, follows_effort: bool) -> float:
        """The friction brake's share of a braking effort that the motors could supply."""
        by_advice = self._friction is FrictionPolicy.BY_ADVICE and follows_effort
        electric = by_advice or self._friction is FrictionPolicy.ELECTRIC_FIRST
        return 0.0 if electric else self._human.friction_ratio

    def under_top(self, cab: CabView, outlook: Outlook, top_mps: float, allowed_mps: float, *, rolls: bool) -> float:
        """The setting that holds a top speed, or the allowed speed if that is lower.

        `rolls`: when the top speed is lowered, the driver lets the train roll down to it.
        """
        rolled_mps = self._roll_off.speed_mps(top_mps if rolls else math.inf, cab.speed_mps)
        if rolled_mps is None:
            return self.held(cab, outlook, min(top_mps, allowed_mps))
        return min(self.held(cab, outlook, min(rolled_mps, allowed_mps)), 0.0)

    def held(self, cab: CabView, outlook: Outlook, speed_mps: float, *, ceiling: bool = False) -> float:
        """The setting that holds a speed: the intended speed, or a `ceiling` for the speed under advised effort."""
        error = speed_mps + min(self._errors.speed_mps, self._human.below_limit_mps) - cab.speed_mps
        needed_n, mass_kg = outlook.resisting_n(cab.s_m, cab.speed_mps), outlook.train.inertial_mass_kg
        crawls = cab.speed_mps <= STOPPING_MPS
        hold = self._ceiling if ceiling else self._hold
        return self.efforts.lever_ratio(
            hold.force_n(error, needed_n, mass_kg, crawls=crawls) * self._errors.force_ratio
        )

    def corrected(self, cab: CabView, outlook: Outlook, speed_mps: float) -> float:
        """The correction (−1 … 1) of an advised effort because the train is not at the advised speed."""
        error = speed_mps + self._errors.speed_mps - cab.speed_mps
        return self.efforts.lever_ratio(self._hold.push_n(error, outlook.train.inertial_mass_kg))

    def needed_braking(self, cab: CabView, outlook: Outlook, reach_s: float) -> float | None:
        """The deceleration (m/s²) for the limits and stops ahead; None while the driver brakes for none of them.

        `reach_s` is the time (s) that the hand needs to return the controller from traction to 0.
        """
        human, v, s = self._human, cab.speed_mps, cab.s_m
        needed = outlook.needed_braking_mps2(s, v, v * EASED_S)
        if v <= STOPPING_MPS:
            way_m = self._mark.at_m(cab) - s
            stopping = v * v / (2.0 * way_m) if way_m > NEAREST_M else human.braking_mps2
            if stopping >= RELEASED_RATIO * human.braking_mps2:
                self._braking = self.brakes_hard = True
                return stopping
        ahead_m = v * (human.early_braking_s + reach_s)
        if v > outlook.allowed_mps(s + ahead_m) + min(human.dead_band_mps, human.below_limit_mps):
            self._braking = True
        elif needed < RELEASED_RATIO * human.braking_mps2:
            rolls_mps2 = -outlook.resisting_n(s, v) / outlook.train.inertial_mass_kg
            # If the train would immediately speed up downhill, the driver eases the brake but does not release it.
            steep = rolls_mps2 * REGAINED_S > human.dead_band_mps
            settled_mps = -human.dead_band_mps if steep else SETTLED_MPS
            self._braking = self._braking and v > max(outlook.allowed_mps(s) + settled_mps, STOPPING_MPS)
        self.brakes_hard = self._braking and needed >= RELEASED_RATIO * human.braking_mps2
        return needed if self._braking else None

    def braked(self, cab: CabView, outlook: Outlook, needed_mps2: float) -> float:
        """The setting for a deceleration (m/s²), limited to twice the planned one."""
        rate = min(max(needed_mps2, 0.0), 2.0 * self._human.braking_mps2)
        force_n = outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * rate
        return self.efforts.lever_ratio(force_n * self._errors.force_ratio)


class Hand:
    """The setting of the controller (−1 … 1), moved at the speed of a hand.

    After setting the controller the driver waits to see the effect: the next small change follows only after a while,
    unless it is urgent or for another `task`. Traction or braking that has lasted that while ends without a wait.
    """

    def __init__(self, human: HumanParameters, diary: Diary) -> None:
        self._human, self._diary = human, diary
        self.setting = 0.0
        self._moving, self._notched_s, self._left_s, self._begun_s = False, -math.inf, -math.inf, -math.inf
        self._task: object = None

    @property
    def reach_s(self) -> float:
        """The time (s) to return the controller from traction to 0."""
        human = self._human
        full_s = human.notches * human.notch_s if human.notches else 1.0 / human.lever_rate_per_s
        return max(self.setting, 0.0) * full_s

    def release(self) -> None:
        """Set the controller to 0 immediately: the train stands."""
        self.setting, self._left_s, self._begun_s = 0.0, -math.inf, -math.inf

    def move(self, wanted: float, now_s: float, span_s: float, *, task: object = None, urgent: bool = False) -> None:
        """Move the controller towards a setting during `span_s`."""
        before = self.setting
        small = abs(wanted - before) < WAITS_RATIO and abs(wanted) < 1.0 and not self._moving
        since_s = self._begun_s if wanted * before <= 0 else self._left_s
        if small and now_s < since_s + WAITS_S and task == self._task and not urgent:
            return
        self._task = task
        self.setting = self._by_notches(wanted, now_s) if self._human.notches else self._by_percent(wanted, span_s)
        moved = self.setting != before
        if moved and not self._moving:
            self._diary.note(now_s, "lever", wanted)
        self._moving = moved and self.setting != wanted
        self._left_s = now_s if moved else self._left_s
        self._begun_s = now_s if moved and before * self.setting <= 0 else self._begun_s

    def _by_notches(self, wanted: float, now_s: float) -> float:
        human = self._human
        notch, aim = round(self.setting * human.notches), round(wanted * human.notches)
        if aim != notch and now_s - self._notched_s >= human.notch_s:
            self._notched_s = now_s
            notch += 1 if aim > notch else -1
        return notch / human.notches

    def _by_percent(self, wanted: float, span_s: float) -> float:
        """Move to any setting at the hand's rate; very small changes are not made."""
        human, before = self._human, self.setting
        small = abs(wanted - before) < human.lever_least_ratio and abs(wanted) not in (0.0, 1.0)
        if small and not self._moving:
            return before
        step = min(abs(wanted - before), human.lever_rate_per_s * span_s)
        return wanted if step == abs(wanted - before) else before + math.copysign(step, wanted - before)
