"""A human driver: glances now and then, reacts late, does not always follow, errs, and improves with practice."""

from __future__ import annotations

import math

from das.advice.regimes import Regime
from sim.drivers.attention import Chance, DisplayReading, Lapses, ReactionTimes, advice_kind
from sim.drivers.cab import AdviceView, CabView, Diary, DriverEvent, Efforts
from sim.drivers.handling import HAND, HEEDING, Errors, Hand, Handling, HumanSettings, StopMark
from sim.drivers.kinds import FrictionPolicy
from sim.drivers.knowledge import Foresight, Habit, LineKnowledge, Outlook
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import SpeedIs, presenter_of
from sim.drivers.rules import TimeRule
from sim.drivers.tracking import RULE
from sim.plant.plant import COAST, Command, lever

BEGUN_RATIO = 0.5
"""A driver who has set this share of an effort has begun with it."""


class Motion:
    """The motion that the driver feels: the time of the last look, the speed then, and how it changes."""

    def __init__(self) -> None:
        self._now_s, self._speed_mps = -math.inf, 0.0
        self.rate_mps2 = 0.0
        """Change of the speed between the last two looks (m/s²)."""

    def feel(self, cab: CabView) -> float:
        """Take note of a look; returns the time (s) since the last one, 0 at the first."""
        span_s = max(cab.time_s - self._now_s, 0.0) if math.isfinite(self._now_s) else 0.0
        if span_s > 0:
            self.rate_mps2 = (cab.speed_mps - self._speed_mps) / span_s
        self._now_s, self._speed_mps = cab.time_s, cab.speed_mps
        return span_s


class Departure:
    """When a standing train is set in motion: one reaction after it may go."""

    def __init__(self, times: ReactionTimes) -> None:
        self._times = times
        self._depart_s = math.inf
        self._stood = False

    def begins(self, cab: CabView) -> bool:
        """Whether this is the first look since the train stood; asked once.

        A train that moves has departed: where it stands next, even between stops, it is set in motion anew.
        """
        if cab.speed_mps > 0:
            self._depart_s = math.inf
        stood, self._stood = self._stood, False
        return stood

    def due(self, cab: CabView) -> bool:
        """Whether the standing train is to be set in motion now."""
        self._stood = True
        if cab.shall_stand:
            self._depart_s = math.inf
            return False
        if math.isinf(self._depart_s):
            self._depart_s = cab.time_s + self._times.draw(cab.time_s)
        return cab.time_s >= self._depart_s


class HumanDriver:
    """Drives by what the cab shows, with a human's limits; the same seed and stream drive the same, bit for bit.

    The driver minds limits and stops all the time, except in lapses, and the display only at glances.
    """

    def __init__(
        self,
        line: LineKnowledge,
        parameters: HumanParameters | None = None,
        *,
        friction: FrictionPolicy = FrictionPolicy.AS_MEASURED,
        seed: int = 0,
        stream: int = 0,
    ) -> None:
        self.parameters = human = parameters or HumanParameters()
        settings = HumanSettings()
        self._diary = diary = Diary()
        chance = Chance(seed, stream)
        times = ReactionTimes(human, chance, diary)
        self._errors = Errors(human, chance.speed, chance.force)
        self._foresight = Foresight(line, Habit(braking_mps2=human.braking_mps2, below_mps=human.below_limit_mps))
        self._rule = TimeRule(RULE.judged_every_s)
        self._motion, self._departure = Motion(), Departure(times)
        self._lapses = Lapses(human, chance, diary)
        self._display = DisplayReading(human, chance, times, diary)
        mark = StopMark(human, settings, chance.marks)
        self.handling = Handling(human, settings, self._errors, mark, line.train, friction)
        """How he holds a speed and brakes."""
        self._hand = Hand(human, diary)

    @property
    def events(self) -> list[DriverEvent]:
        """What the driver did and felt so far."""
        return self._diary.events

    def command(self, cab: CabView) -> Command:
        """What the controller is set to until the next look."""
        span_s = self._motion.feel(cab)
        if span_s > 0:
            self._errors.over(span_s)
        if cab.speed_mps <= 0 and not self._departure.due(cab):
            self._hand.release()
            self.handling.stand()
            return COAST
        outlook = self._foresight.outlook(cab)
        if not self._lapses.away(cab, outlook.allowed_mps(cab.s_m)):
            if self._departure.begins(cab):
                self._display.depart(cab)
            self._display.look(cab)
            self.handling.efforts = Efforts.at(cab.speed_mps, outlook.train)
            wanted, heeded = self._wanted(cab, outlook), self._display.heeded
            urgent = self.handling.brakes_hard or cab.speed_mps > cab.limit_mps
            self._hand.move(wanted, cab.time_s, span_s, task=heeded.task, urgent=urgent)
        friction_ratio = self.handling.friction_ratio(follows_effort=self._display.heeded.by_effort)
        return lever(self._hand.setting, friction_ratio=friction_ratio)

    def _wanted(self, cab: CabView, outlook: Outlook) -> float:
        """The setting that he wants now: by advice or habit, but never more than limits and stops let."""
        handling, heeded, reach_s = self.handling, self._display.heeded, self._hand.reach_s
        allowed = min(outlook.allowed_mps(cab.s_m), cab.limit_mps)
        coming = min(allowed, outlook.allowed_mps(cab.s_m + cab.speed_mps * reach_s))
        near = cab.speed_mps + reach_s * max(self._motion.rate_mps2, 0.0) > coming - HEEDING.watched_mps
        if heeded.view is not None and heeded.by_effort:
            wanted = presenter_of(heeded.view.presentation).set_by(self, cab, outlook, heeded.view, allowed)
            wanted = min(wanted, handling.held(cab, outlook, coming, ceiling=True)) if near else wanted
        else:
            top_mps, rolls = self._top_mps(cab, outlook), self._by_top_speed
            wanted = handling.under_top(cab, outlook, top_mps, coming if near else allowed, rolls=rolls)
        needed = handling.needed_braking(cab, outlook, reach_s)
        return wanted if needed is None else min(wanted, handling.braked(cab, outlook, needed))

    @property
    def _by_top_speed(self) -> bool:
        """Whether he follows advice that says a highest speed."""
        view, follows = self._display.heeded.view, self._display.heeded.follows
        return follows and view is not None and presenter_of(view.presentation).speed_is(view.mode) is SpeedIs.HIGHEST

    def set_effort(self, lever_ratio: float) -> float:
        """An effort as he sets it (−1 … 1): with an error, but the ends of the scale are stops that the hand feels."""
        if abs(lever_ratio) > HAND.end_stop_ratio:
            return math.copysign(1.0, lever_ratio)
        return min(max(lever_ratio * self._errors.force_ratio, -1.0), 1.0)

    def to_speed(self, cab: CabView, outlook: Outlook, view: AdviceView, allowed_mps: float) -> float:
        """The setting for the effort and the speed shown; when the speed is reached, he sees it himself and holds it.

        Where no effort is shown, it is all traction, or his own brake.
        """
        target, effort = min(view.shown_speed_mps, allowed_mps), view.lever_ratio
        if math.isnan(effort):
            brakes = advice_kind(view) == "brake"
            effort = self.handling.braked(cab, outlook, self.parameters.braking_mps2) if brakes else 1.0
        if view.mode in (Regime.FULL_TRACTION, Regime.REDUCED_TRACTION):
            away = target - cab.speed_mps - max(self._motion.rate_mps2, 0.0) * HEEDING.eased_off_s
            if away > 0 and not self._display.heeded.reached and not self._soon_over(cab, outlook, effort, target):
                return self.set_effort(effort)
            self._display.reach()
            return self.handling.held(cab, outlook, target)
        if view.mode == Regime.CRUISE:
            return self.handling.held(cab, outlook, target)
        if view.mode == Regime.COAST:
            return 0.0
        if cab.speed_mps <= target:
            return min(self.handling.held(cab, outlook, target), 0.0) if target > 0 else 0.0
        return 0.0 if self._soon_over(cab, outlook, effort, target) else self.set_effort(effort)

    def _soon_over(self, cab: CabView, outlook: Outlook, effort: float, target_mps: float) -> bool:
        """Whether he has not begun to accelerate or brake to a speed, and would be done so soon that he does not."""
        if self._hand.setting * math.copysign(1.0, effort) >= BEGUN_RATIO * abs(effort):
            return False
        efforts = self.handling.efforts
        effort_n = effort * (efforts.traction_n if effort > 0 else efforts.brakes_n)
        rate_mps2 = (effort_n - outlook.resisting_n(cab.s_m, cab.speed_mps)) / outlook.train.inertial_mass_kg
        return abs(target_mps - cab.speed_mps) < abs(rate_mps2) * HEEDING.least_effort_s

    def _top_mps(self, cab: CabView, outlook: Outlook) -> float:
        """The highest speed that he drives at: the display's reduced maximum, or between keeping time and haste."""
        heeded = self._display.heeded
        if heeded.view is not None and self._by_top_speed:
            return heeded.view.shown_speed_mps
        keeps = self._rule.cap_mps(cab, outlook)
        return keeps + self._haste_ratio * max(outlook.top_mps - keeps, 0.0)

    @property
    def _haste_ratio(self) -> float:
        """How he drives between just in time (0) and as fast as allowed (1), without advice on how to drive.

        Where he is told how late the train is, he drives faster when it is late and slower when it is early, in
        proportion, up to one end or the other.
        """
        haste, heeded = self.parameters.haste_ratio, self._display.heeded
        if heeded.view is None or not heeded.follows or math.isnan(heeded.view.deviation_s):
            return haste
        part = min(max(heeded.view.deviation_s / HEEDING.made_good_s, -1.0), 1.0)
        return haste + part * ((1.0 - haste) if part > 0 else haste)
