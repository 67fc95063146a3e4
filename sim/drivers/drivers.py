"""The drivers by name: rule followers, the perfect follower of advice, the literal reader, the human, a user's own."""

from __future__ import annotations

import math

from das.advice.regimes import TRACTION, Regime
from sim.drivers.cab import AT_STOP_M, AdviceView, Asked, CabView, Driver, asked
from sim.drivers.human import HumanDriver, Motion
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation
from sim.drivers.knowledge import Foresight, Habit, LineKnowledge, Outlook
from sim.drivers.own_class import OwnDriver
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import Follower, SpeedIs, presenter_of
from sim.drivers.tracking import (
    ANTICIPATION_S,
    CREEPING_MPS,
    EASY_BRAKING_MPS2,
    JUDGED_EVERY_S,
    LATE_BRAKING_MPS2,
    MINDED_MPS,
    READ_MPS,
    RELEASE_S,
    ROLL_MPS,
    RollOff,
    TimeRule,
    hold,
    needed_braking_mps2,
    stand,
    stop_at,
    under_ceiling,
)
from sim.plant.kernels import Command
from sim.plant.plant import COAST, Efforts, force, lever

LATE_BRAKING = Habit(braking_mps2=LATE_BRAKING_MPS2)
"""The habit of a driver who brakes late."""
EASY_BRAKING = Habit(braking_mps2=EASY_BRAKING_MPS2)
"""The habit of a driver who brakes comfortably."""


class FastDriver:
    """Drives as fast as allowed, and brakes late."""

    def __init__(self, line: LineKnowledge, habit: Habit = LATE_BRAKING) -> None:
        self.foresight = Foresight(line, habit)

    def command(self, cab: CabView) -> Command:
        return stand(cab) or self._drive(cab, self.foresight.outlook(cab), math.inf)

    def _drive(self, cab: CabView, outlook: Outlook, top_mps: float, roll_mps: float = 0.0) -> Command:
        """Drive under the ceiling and a top speed; brakes stay off while it is exceeded by at most `roll_mps`."""
        stopping = stop_at(cab, outlook, cab.halt_m, self.foresight.habit.braking_mps2)
        if stopping is not None:
            return stopping
        rolls = top_mps < cab.speed_mps <= top_mps + roll_mps
        ceiling = under_ceiling(cab, outlook, ANTICIPATION_S, 0.0 if rolls else math.inf)
        if rolls or top_mps >= ceiling.value:
            return ceiling
        return hold(cab, outlook, top_mps if cab.speed_mps <= top_mps else min(top_mps + roll_mps, ceiling.value))


class TopSpeedDriver(FastDriver):
    """Keeps to one top speed: the displayed one or, without a display, an estimate at departure of the speed that keeps
    time.

    When the top speed is lowered, the train rolls down to it, unless a limit or a stop ahead requires braking.
    """

    def __init__(self, line: LineKnowledge, habit: Habit = EASY_BRAKING) -> None:
        super().__init__(line, habit)
        self._rule, self._roll_off = TimeRule(), RollOff()

    def command(self, cab: CabView) -> Command:
        outlook = self.foresight.outlook(cab)
        return stand(cab) or self._under_top(cab, outlook, shown_cap(cab) or self._rule.cap_mps(cab, outlook))

    def _under_top(self, cab: CabView, outlook: Outlook, top_mps: float) -> Command:
        rolled_mps = self._roll_off.speed_mps(top_mps, cab.speed_mps)
        if rolled_mps is None:
            return self._drive(cab, outlook, top_mps)
        # The lowest speed reached is now the top speed: no traction, and brakes only to prevent acceleration.
        return self._drive(cab, outlook, rolled_mps)._replace(high_n=0.0)


class TimetableDriver(FastDriver):
    """Keeps time without advice: updates the top speed at intervals, and lets the train roll above it."""

    def __init__(self, line: LineKnowledge, habit: Habit = EASY_BRAKING) -> None:
        super().__init__(line, habit)
        self._rule = TimeRule(JUDGED_EVERY_S)

    def command(self, cab: CabView) -> Command:
        outlook = self.foresight.outlook(cab)
        return stand(cab) or self._drive(cab, outlook, self._rule.cap_mps(cab, outlook), ROLL_MPS)


def shown_cap(cab: CabView) -> float | None:
    """The top speed (m/s) on the display; None if it shows none."""
    view = cab.shown
    if view is None or presenter_of(view.presentation).speed_is(view.mode) is not SpeedIs.HIGHEST:
        return None
    return view.speed_mps if view.speed_mps > 0 else None


class PerfectDriver:
    """Follows the display exactly if it shows how to drive; otherwise keeps time as `TimetableDriver`."""

    def __init__(self, line: LineKnowledge) -> None:
        self._alone, self._minding = TimetableDriver(line), FastDriver(line)
        self._followers: dict[Presentation, Follower | None] = {}
        self._minds = False
        """Whether the driver obeys something unknown to the advice; remains true after the display goes blank."""

    def command(self, cab: CabView) -> Command:
        view = cab.shown
        follower = None if view is None else self._follower(view.presentation)
        may_mind = (self._minds or follower is not None) and (cab.restrictions or cab.signal_m < cab.stop_m)
        self._minds = bool(may_mind) and self._must_mind(cab)
        if self._minds:
            return self._minding.command(cab)
        if view is None or follower is None:
            return self._alone.command(cab)
        outlook = self._alone.foresight.outlook(cab)
        if view.mode == Regime.DEPART:
            self._followers.clear()
            return stand(cab) or self._depart(cab, view.departure, outlook)
        return stand(cab) or follower.command(cab, view, outlook) or self._alone.command(cab)

    def _follower(self, presentation: Presentation) -> Follower | None:
        """The follower of a presentation, kept until the next departure; None if it does not show how to drive."""
        if presentation not in self._followers:
            self._followers[presentation] = presenter_of(presentation).follower()
        return self._followers[presentation]

    def _depart(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command:
        target = min(view.speed_mps, cab.limit_mps)
        if math.isnan(view.lever_ratio):
            return hold(cab, outlook, target)
        most_n = view.lever_ratio * Efforts.at(cab.speed_mps, outlook.train).traction_n
        return hold(cab, outlook, target, high_n=max(most_n, 0.0))

    def _must_mind(self, cab: CabView) -> bool:
        """Whether the train is near the highest speed under restrictions and signals that the advice may not know."""
        soon_m = cab.s_m + cab.speed_mps * ANTICIPATION_S
        return cab.speed_mps > self._minding.foresight.outlook(cab).allowed_mps(soon_m) - MINDED_MPS


class LiteralDriver:
    """Follows the guide's card, with no other knowledge, to show how a train runs by the card alone.

    The driver reads the card, the speedometer and the distance to the stop, ignores limits, signs and signals, releases
    traction in time to reach a speed without exceeding it, and brakes by eye only if the card shows no effort. Without
    the guide it drives as `TimetableDriver`.
    """

    def __init__(self, line: LineKnowledge) -> None:
        self._alone = TimetableDriver(line)
        self._due: AdviceView | None = None
        self._reached = False
        self._motion = Motion()

    def command(self, cab: CabView) -> Command:
        view = cab.shown
        self._motion.feel(cab)
        if view is None or not presenter_of(view.presentation).needs_guide:
            self._due = None
            return self._alone.command(cab)
        if cab.shall_stand:
            self._due = None
            return COAST
        return self._obeyed(cab, self._read(cab, view.departure))

    def _read(self, cab: CabView, view: AdviceView) -> AdviceView:
        """The card that applies: the card shown once it is due, until then the previous card."""
        due, soon_mps = self._due, cab.speed_mps + max(self._motion.rate_mps2, 0.0) * RELEASE_S
        if due is None or cab.time_s - view.time_s >= view.due_s:
            same = due is not None and (due.mode, due.speed_mps) == (view.mode, view.speed_mps)
            self._due, self._reached = view, self._reached and same
            due = view
        gains = due.mode in TRACTION
        away_mps = due.speed_mps - READ_MPS - soon_mps if gains else cab.speed_mps - due.speed_mps
        self._reached = self._reached or away_mps <= 0.0
        return due

    def _obeyed(self, cab: CabView, card: AdviceView) -> Command:
        outlook = self._alone.foresight.outlook(cab)
        told = asked(card.mode, card.speed_mps, card.lever_ratio, cab.speed_mps, reached=self._reached)
        if told in (Asked.ACCELERATE, Asked.BRAKE):
            return lever(card.lever_ratio)
        if told is Asked.HOLD:
            return hold(cab, outlook, card.speed_mps)
        if told is Asked.COAST:
            return COAST
        if told is Asked.BRAKE_BY_EYE:
            return self._by_eye(cab, outlook)
        if told is Asked.KEEP_BELOW and card.speed_mps > 0:
            return hold(cab, outlook, card.speed_mps, high_n=0.0)
        return lever(-1.0)  # The card shows "stop".

    def _by_eye(self, cab: CabView, outlook: Outlook) -> Command:
        if cab.speed_mps < CREEPING_MPS and cab.stop_m - cab.s_m > AT_STOP_M:
            return hold(cab, outlook, CREEPING_MPS)
        needed = needed_braking_mps2(cab, cab.stop_m)
        if math.isinf(needed):
            return lever(-1.0)
        return force(outlook.resisting_n(cab.s_m, cab.speed_mps) - outlook.train.inertial_mass_kg * needed)


def make_driver(
    kind: DriverKind | OwnClass,
    line: LineKnowledge,
    *,
    parameters: HumanParameters | None = None,
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED,
    seed: int = 0,
    stream: int = 0,
) -> Driver:
    """Make a driver for a line.

    Only the human driver uses the parameters, the friction policy and `stream` (the number of its random stream);
    the seed is passed to the human driver and to a user's class. Raises DasError for a class that cannot be used.
    """
    if isinstance(kind, OwnClass):
        return OwnDriver(kind, line, seed)
    if kind is DriverKind.HUMAN:
        return HumanDriver(line, parameters, friction=friction, seed=seed, stream=stream)
    if kind is DriverKind.PERFECT:
        return PerfectDriver(line)
    if kind is DriverKind.LITERAL:
        return LiteralDriver(line)
    ruled = {DriverKind.FAST: FastDriver, DriverKind.TOP_SPEED: TopSpeedDriver, DriverKind.TIMETABLE: TimetableDriver}
    return ruled[kind](line)
