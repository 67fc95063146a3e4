"""A human driver, who glances at the display at intervals, reacts late, makes errors, and may not follow advice."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from das.advice.regimes import BRAKES, KIND_OF, TRACTION, InstructionKind, Regime
from das.advice.shown import STOP_BY_EYE_M
from das.domain.units import KMH
from sim.drivers.cab import AdviceView, Asked, CabView, Diary, DriverEvent, asked
from sim.drivers.handling import CREEPS_MPS, Errors, Hand, Handling, StopMark
from sim.drivers.kinds import FrictionPolicy
from sim.drivers.knowledge import Foresight, Habit, LineKnowledge, Outlook
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import END_STOP_RATIO, SpeedIs, presenter_of
from sim.drivers.tracking import JUDGED_EVERY_S, TimeRule
from sim.plant.kernels import Command
from sim.plant.plant import COAST, Efforts, lever

# Parameters of all human drivers for limits and advice. All values are assumptions.
WARNING_MPS: Final = 1.5
"""Excess over the braking curve (m/s) at which the train warns its driver; the warning ends any lapse."""
WATCHED_MPS: Final = 1.5
"""Margin (m/s) below the highest permitted speed; within the margin, that speed has priority over advice."""
EASED_OFF_S: Final = 1.5
"""Time (s) before reaching the target speed of an acceleration at which the driver eases off."""
EXPECTED_WITHIN_S: Final = 5.0
"""Longest time (s) between a change of the advice and the announced change for it to count as announced."""
MADE_GOOD_S: Final = 20.0
"""Displayed lateness (s) from which on a driver drives as fast as allowed, and earliness for just in time."""
LEAST_EFFORT_S: Final = 4.0
"""Shortest acceleration (s) that a driver begins; for a shorter one the speed is held. Instead of braking for a
shorter time, the train rolls."""


class Chance:
    """A driver's random numbers: one stream for each kind of event, so that a parameter affects only its own draws."""

    def __init__(self, seed: int, stream: int) -> None:
        streams = np.random.SeedSequence(seed, spawn_key=(stream,)).spawn(7)
        generators = [np.random.default_rng(one) for one in streams]
        self.reactions, self.choices, self.looks, self.lapses, self.marks, self.speed, self.force = generators


class ReactionTimes:
    """A driver's reaction times, drawn from a lognormal distribution and recorded in the diary."""

    def __init__(self, human: HumanParameters, chance: Chance, diary: Diary) -> None:
        self._human, self._random, self._diary = human, chance.reactions, diary

    def draw(self, now_s: float, *, of_itself: float = 1.0) -> float:
        """The next reaction time (s); `of_itself` is the share of the time taken: below 1 if announced."""
        human = self._human
        normal = float(self._random.standard_normal())
        reaction_s = human.reaction_median_s * math.exp(human.reaction_log_sd * normal)
        if of_itself < 1.0:
            self._diary.note(now_s, "expected", of_itself)
            reaction_s *= of_itself
        self._diary.note(now_s, "reaction", reaction_s)
        return reaction_s


def says_mode(view: AdviceView) -> bool:
    """Whether the advice shows how to drive; other advice shows at most a highest speed."""
    return presenter_of(view.presentation).says_mode


def _shown_mode(view: AdviceView) -> int:
    """The driving regime of advice; advice without a regime counts as advice to hold a speed."""
    return view.mode if says_mode(view) else int(Regime.CRUISE)


class Lapses:
    """Lapses of the driver's attention: they begin at random, and the train's speed warning ends a lapse early."""

    def __init__(self, human: HumanParameters, chance: Chance, diary: Diary) -> None:
        self._human, self._random, self._diary = human, chance.lapses, diary
        self._next_s, self._awake_s = -math.inf, -math.inf

    def away(self, cab: CabView, allowed_mps: float) -> bool:
        """Whether attention is away now; `allowed_mps` is the highest speed that the driver accepts here."""
        human, now_s = self._human, cab.time_s
        if human.lapses_per_h <= 0:
            return False
        if not math.isfinite(self._next_s):
            self._next_s = now_s + self._until_next()
        if now_s >= self._next_s:
            length_s = human.lapse_mean_s * float(self._random.standard_exponential())
            self._diary.note(now_s, "lapse", length_s)
            self._awake_s = now_s + length_s
            self._next_s = self._awake_s + self._until_next()
        if cab.speed_mps > allowed_mps + human.below_limit_mps + WARNING_MPS:
            self._awake_s = min(self._awake_s, now_s)
        return now_s < self._awake_s

    def _until_next(self) -> float:
        return 3600.0 / self._human.lapses_per_h * float(self._random.standard_exponential())


class Heeded(NamedTuple):
    """The advice that the driver saw last (`view`), and whether it is followed.

    `reached`: the train has reached the speed up to which the advice accelerates.
    """

    view: AdviceView | None = None
    follows: bool = False
    reached: bool = False

    @property
    def task(self) -> int | None:
        """The driving regime of the advice followed; None if no advice is followed, or the advice shows none."""
        return self.view.mode if self.by_effort and self.view is not None else None

    @property
    def by_effort(self) -> bool:
        """Whether the driver follows advice that shows how to drive."""
        return self.follows and self.view is not None and says_mode(self.view)


class Announced(NamedTuple):
    """The last change that the display announced: its driving regime, and its due time (s on the cab's clock)."""

    mode: int = Regime.NONE
    due_s: float = math.inf


class DisplayReading:
    """The driver's glances at the display, decisions on new advice, and actions after a reaction time."""

    def __init__(self, human: HumanParameters, chance: Chance, times: ReactionTimes, diary: Diary) -> None:
        self._human, self._chance, self._times, self._diary = human, chance, times, diary
        self._glance_s, self._act_s = -math.inf, math.inf
        self._seen: AdviceView | None = None
        self._judged: tuple[object, ...] | None = None
        self._decided: tuple[object, ...] = ()
        self._pending: bool | None = None
        self._noticed = 0
        self._announced = Announced()
        self.heeded = Heeded()
        """The advice seen last, and whether it is followed."""

    def reach(self) -> None:
        """Record that the advised acceleration has reached its speed; the driver holds that speed until the advice
        changes."""
        self.heeded = self.heeded._replace(reached=True)

    def depart(self, cab: CabView) -> None:
        """Look at the display again at departure; the reaction time is already over, so the driver acts immediately."""
        self.heeded, self._judged, self._decided, self._pending = Heeded(), None, (), None
        self._glance(cab)
        if self._pending is not None:
            self._act_s = cab.time_s
            self.look(cab)

    def look(self, cab: CabView) -> None:
        """Glance at the display if it is time to, and act on a decision whose reaction time is over."""
        if cab.time_s >= self._glance_s:
            self._glance(cab)
        if self._pending is not None and cab.time_s >= self._act_s:
            self._diary.note(self._act_s, "acted", float(self._pending))
            self.heeded = self.heeded._replace(view=self._seen, follows=self._pending)
            self._pending = None

    def _glance(self, cab: CabView) -> None:
        human, now_s = self._human, cab.time_s
        beyond_s = max(human.glance_mean_s - human.glance_least_s, 0.0)
        self._glance_s = now_s + human.glance_least_s + beyond_s * float(self._chance.looks.standard_exponential())
        self._seen = view = cab.shown
        self._diary.note(now_s, "glance", 0 if view is None else view.mode)
        read = None if view is None else view.departure  # A moving train has been cleared.
        item = None if read is None else (read.presentation, *presenter_of(read.presentation).item(read))
        if item != self._judged:
            self._judged = item
            self.heeded = self.heeded._replace(reached=False)
            self._judge(read, now_s)
        self._expect(view, now_s)
        if self._pending is None:
            self.heeded = self.heeded._replace(view=view)

    def _expect(self, view: AdviceView | None, now_s: float) -> None:
        if view is None or view.next_mode == Regime.NONE or not math.isfinite(view.next_change_s):
            return
        self._announced = Announced(view.next_mode, view.time_s + view.next_change_s)
        if self._announced.due_s >= now_s + self._human.glance_least_s:
            self._glance_s = min(self._glance_s, self._announced.due_s)

    def _reaction_s(self, mode: int, now_s: float) -> float:
        """The reaction time (s), shorter if the change was announced."""
        expected = mode == self._announced.mode and abs(now_s - self._announced.due_s) <= EXPECTED_WITHIN_S
        return self._times.draw(now_s, of_itself=self._human.expected_ratio if expected else 1.0)

    def _judge(self, view: AdviceView | None, now_s: float) -> None:
        """Decide whether to follow new advice, and when to act; withdrawn advice is given up after a reaction."""
        kind = None if view is None else KIND_OF.get(_shown_mode(view))
        if self._pending is not None:
            self._diary.note(now_s, "changed", self._noticed)
        self._noticed = 0 if view is None or kind is None else _shown_mode(view)
        self._diary.note(now_s, "noticed", self._noticed)
        if view is None or kind is None:
            self._pending, self._decided = False, ()
            self._act_s = now_s + self._reaction_s(Regime.NONE, now_s) if self.heeded.follows else now_s
            return
        # More or less effort for the same speed is the same advice: it needs no new decision.
        advice = (kind, round(view.speed_mps / KMH)) if says_mode(view) and math.isfinite(view.speed_mps) else ()
        follow = self.heeded.follows if self._pending is None else self._pending
        if not advice or advice != self._decided:
            follow = bool(self._chance.choices.random() < self._followed_ratio(view, kind))
            self._diary.note(now_s, "followed" if follow else "refused", self._noticed)
        self._pending, self._decided = follow, advice
        self._act_s = now_s + self._reaction_s(self._noticed, now_s)

    def _followed_ratio(self, view: AdviceView, kind: InstructionKind) -> float:
        """The probability that the driver follows advice of a kind; a displayed reason may reduce the refusals."""
        human = self._human
        followed = float(getattr(human, f"comply_{kind}_ratio"))
        if not view.reason or human.reason_refusal_ratio == 1.0:
            return followed
        return 1.0 - human.reason_refusal_ratio * (1.0 - followed)


BEGUN_RATIO = 0.5
"""Share of an effort from which on the acceleration or braking counts as begun."""


class Motion:
    """The acceleration that the driver feels, from the speeds at the last two looks."""

    def __init__(self) -> None:
        self._now_s, self._speed_mps = -math.inf, 0.0
        self.rate_mps2 = 0.0
        """Acceleration between the last two looks (m/s²)."""

    def feel(self, cab: CabView) -> float:
        """Record the speed at a look; returns the time (s) since the last look, 0 at the first."""
        span_s = max(cab.time_s - self._now_s, 0.0) if math.isfinite(self._now_s) else 0.0
        if span_s > 0:
            self.rate_mps2 = (cab.speed_mps - self._speed_mps) / span_s
        self._now_s, self._speed_mps = cab.time_s, cab.speed_mps
        return span_s


class Departure:
    """The departure of a standing train: one reaction time after it may depart."""

    def __init__(self, times: ReactionTimes) -> None:
        self._times = times
        self._depart_s = math.inf
        self._stood = False

    def begins(self, cab: CabView) -> bool:
        """Whether this is the first look after the train stood. Call it once at each look."""
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
    """Drives with the information in the cab and human limitations; the same seed and stream give the same drive, bit
    for bit.

    Except in lapses, the driver watches limits and stops all the time, and the display only at glances.
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
        human = parameters or HumanParameters()
        human = replace(human, braking_mps2=line.planned_braking_mps2(human.braking_mps2))
        self.parameters = human
        self._diary = diary = Diary()
        chance = Chance(seed, stream)
        times = ReactionTimes(human, chance, diary)
        self._errors = Errors(human, chance.speed, chance.force)
        self._foresight = Foresight(line, Habit(braking_mps2=human.braking_mps2, below_mps=human.below_limit_mps))
        self._rule = TimeRule(JUDGED_EVERY_S)
        self._motion, self._departure = Motion(), Departure(times)
        self._lapses = Lapses(human, chance, diary)
        self._display = DisplayReading(human, chance, times, diary)
        mark = StopMark(human, chance.marks)
        self.handling = Handling(human, self._errors, mark, line.train, friction)
        """The driver's way of holding a speed and braking."""
        self._hand = Hand(human, diary)

    @property
    def events(self) -> list[DriverEvent]:
        """The driver's actions and observations so far."""
        return self._diary.events

    def command(self, cab: CabView) -> Command:
        """The controller's setting until the next look."""
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
        """The wanted setting, from advice or habit, but never more than limits and stops allow."""
        handling, heeded, reach_s = self.handling, self._display.heeded, self._hand.reach_s
        allowed = min(outlook.allowed_mps(cab.s_m), cab.limit_mps)
        coming = min(allowed, outlook.allowed_mps(cab.s_m + cab.speed_mps * reach_s))
        near = cab.speed_mps + reach_s * max(self._motion.rate_mps2, 0.0) > coming - WATCHED_MPS
        if heeded.view is not None and heeded.by_effort:
            if heeded.task in BRAKES and cab.halt_m - cab.s_m <= STOP_BY_EYE_M:
                wanted = self._by_eye(cab, outlook)
            else:
                wanted = presenter_of(heeded.view.presentation).set_by(self, cab, outlook, heeded.view, allowed)
            wanted = min(wanted, handling.held(cab, outlook, coming, ceiling=True)) if near else wanted
        else:
            top_mps, rolls = self._top_mps(cab, outlook), self._by_top_speed
            wanted = handling.under_top(cab, outlook, top_mps, coming if near else allowed, rolls=rolls)
        needed = handling.needed_braking(cab, outlook, reach_s)
        return wanted if needed is None else min(wanted, handling.braked(cab, outlook, needed))

    def _by_eye(self, cab: CabView, outlook: Outlook) -> float:
        """The setting until braking for the mark is necessary: the present speed is held, or a creeping one."""
        return self.handling.held(cab, outlook, max(cab.speed_mps, CREEPS_MPS))

    @property
    def _by_top_speed(self) -> bool:
        view, follows = self._display.heeded.view, self._display.heeded.follows
        return follows and view is not None and presenter_of(view.presentation).speed_is(view.mode) is SpeedIs.HIGHEST

    def set_effort(self, lever_ratio: float) -> float:
        """An effort as set by the driver (−1 … 1): with an error, except at the ends of the scale, which the hand can
        feel."""
        if abs(lever_ratio) > END_STOP_RATIO:
            return math.copysign(1.0, lever_ratio)
        return min(max(lever_ratio * self._errors.force_ratio, -1.0), 1.0)

    def to_speed(self, cab: CabView, outlook: Outlook, view: AdviceView, allowed_mps: float) -> float:
        """The setting for the effort and the speed shown; when the train reaches the speed, the driver holds it. If the
        display shows no effort, the driver uses full traction, or the planned braking.
        """
        target, effort = min(view.shown_speed_mps, allowed_mps), view.lever_ratio
        told = asked(view.mode, target, effort, cab.speed_mps)
        if told is Asked.BRAKE_BY_EYE:
            return self._by_eye(cab, outlook)
        if math.isnan(effort):
            brakes = told is Asked.BRAKE
            effort = self.handling.braked(cab, outlook, self.parameters.braking_mps2) if brakes else 1.0
        if told is Asked.ACCELERATE:
            away = target - cab.speed_mps - max(self._motion.rate_mps2, 0.0) * EASED_OFF_S
            if away > 0 and not self._display.heeded.reached and not self._soon_over(cab, outlook, effort, target):
                return self.set_effort(effort)
        if told in (Asked.ACCELERATE, Asked.HOLD):
            if view.mode in TRACTION:
                self._display.reach()
            return self.handling.held(cab, outlook, target)
        if told is Asked.BRAKE:
            return 0.0 if self._soon_over(cab, outlook, effort, target) else self.set_effort(effort)
        if told is Asked.KEEP_BELOW and target > 0:
            return min(self.handling.held(cab, outlook, target), 0.0)
        return 0.0

    def _soon_over(self, cab: CabView, outlook: Outlook, effort: float, target_mps: float) -> bool:
        if self._hand.setting * math.copysign(1.0, effort) >= BEGUN_RATIO * abs(effort):
            return False
        efforts = self.handling.efforts
        effort_n = effort * (efforts.traction_n if effort > 0 else efforts.brakes_n)
        rate_mps2 = (effort_n - outlook.resisting_n(cab.s_m, cab.speed_mps)) / outlook.train.inertial_mass_kg
        return abs(target_mps - cab.speed_mps) < abs(rate_mps2) * LEAST_EFFORT_S

    def _top_mps(self, cab: CabView, outlook: Outlook) -> float:
        """The driver's top speed (m/s): the displayed one, or a speed between just in time and as fast as allowed."""
        heeded = self._display.heeded
        if heeded.view is not None and self._by_top_speed:
            return heeded.view.shown_speed_mps
        keeps = self._rule.cap_mps(cab, outlook)
        return keeps + self._haste_ratio * max(outlook.top_mps - keeps, 0.0)

    @property
    def _haste_ratio(self) -> float:
        """The haste without advice on how to drive, 0 (just in time) to 1; more if shown late, less if shown early."""
        haste, heeded = self.parameters.haste_ratio, self._display.heeded
        if heeded.view is None or not heeded.follows or math.isnan(heeded.view.deviation_s):
            return haste
        part = min(max(heeded.view.deviation_s / MADE_GOOD_S, -1.0), 1.0)
        return haste + part * ((1.0 - haste) if part > 0 else haste)
