"""The cab: the on-board system without sockets and clocks. It receives frozen messages and answers each tick."""

from __future__ import annotations

import dataclasses
import traceback
from dataclasses import dataclass
from pathlib import Path

from das.advice import wording
from das.advice.advice import Advice, Cause, Timetable, Withdrawal
from das.advice.guide.guide import Guide
from das.advice.last_word import BrakingBasis, LastWord
from das.advice.planner import Planner
from das.advice.quiet import Quiet
from das.advice.reason import Reason
from das.advice.regimes import Regime
from das.cab.guard import Guard, off_route
from das.cab.heard import (
    DelayHeard,
    Heard,
    JourneyHeard,
    Kind,
    NodeSeen,
    PositionHeard,
    PublisherSeen,
    RestrictionsHeard,
    TargetsHeard,
    judged,
)
from das.cab.learning import Learning
from das.cab.leg import Leg, NoPlanError
from das.cab.legs import Legs
from das.cab.orders import Post, is_of_another_day
from das.cab.outputs import NodeState, Output, Reporting, Severity, Status
from das.cab.preparation import Fronts, Preparation
from das.cab.situation import Situation
from das.cab.withdrawal import Trust, decide
from das.domain.conditions import Conditions
from das.domain.errors import DasError, raise_interruption
from das.domain.route import Stop
from das.domain.units import NS
from das.estimate.calibration import Calibrator
from das.estimate.estimate import Estimate, PositionFix
from das.estimate.localisation import Localisation
from das.solver.front import Front
from das.solver.guide.policies import GuideFront
from das.solver.section import Section
from das.solver.warm_up import warm_up as solve_tiny

OVERDUE_PERIODS = 1.2
"""Least validity of advice, in advice periods."""
LONGEST_REASON = 80
"""Longest reason of a target, or error text (characters); the rest is cut."""


@dataclass(frozen=True, kw_only=True)
class CabSettings:
    """The settings of a cab."""

    advice_period_s: float = 1.0
    """The time between advice messages. If it is long, each message is valid until the next is due."""
    no_restrictions: bool = False
    """Whether the site has no temporary restrictions, so that there is advice without a list of them."""
    calibrate: bool = False
    """Whether mass and running resistance are estimated from the measured efforts and used in plans."""
    background: bool = False
    """Whether fronts are searched for in a separate thread, and the status has measured durations.

    Otherwise each tick waits for the fronts it needs, and the durations are 0: no output depends on the machine.
    """
    guide: bool = False
    """Whether there is a guide; if not, nothing is computed for it."""


class Cab:
    """One train's on-board system: `hear` takes a message, `tick` gives the advice.

    Both return the outputs to send, in order. The same messages in the same order give the same answers, bit for bit,
    unless fronts are solved in the background. Call `close` at the end.
    """

    def __init__(self, post: Post, situation: Situation, fronts: Fronts, settings: CabSettings | None = None) -> None:
        settings = settings or CabSettings()
        preparation = Preparation(fronts, background=settings.background, guide=settings.guide)
        self.legs = Legs(situation, preparation)
        """The legs of the journey under way."""
        self.here = Estimate(time_ns=0)
        """The estimated state of the train on which the last advice is based."""
        self.learning: Learning | None = None
        """The calibration of the train while driving; None without it."""
        if settings.calibrate:
            calibrator = Calibrator(situation.route, situation.vehicle, point_mass=situation.point_mass)
            self.learning = Learning(calibrator)
        self._post, self._zone, self._settings = post, post.route.zone, settings
        self._least_valid_ns = round(OVERDUE_PERIODS * settings.advice_period_s / NS)
        self._guard, self._reporting = Guard(), Reporting()
        self._localisation = Localisation(situation.vehicle)
        self._quiet = Quiet()
        self._trust = Trust(restrictions_received=settings.no_restrictions)
        self._clock_ns = 0
        self._journey: JourneyHeard | None = None
        self._of_another_day = False
        self._news_pending = self._failing = False

    @property
    def urgent(self) -> bool:
        """Whether restrictions or targets have changed, or a front was found, since the last advice."""
        return self._news_pending or (self.legs.preparation.has_answer and not self._failing)

    @property
    def searching(self) -> bool:
        """Whether a search for a front is under way."""
        return self.legs.preparation.searching

    @property
    def has_journey(self) -> bool:
        """Whether a journey was received, accepted or refused."""
        return bool(self.legs.legs) or bool(self._trust.journey_refused)

    def close(self) -> None:
        """End the threads that search for fronts."""
        self.legs.preparation.close()

    def hear(self, message: Heard | PublisherSeen | NodeSeen) -> list[Output]:
        """Act on a message, or report why it is ignored.

        An unforeseen error is caught, reported, and withdraws the next advice; a crashed cab could do neither.
        """
        if isinstance(message, NodeSeen):
            self._guard.see_node(message)
            return []
        if isinstance(message, PublisherSeen):
            waiting = self._guard.see(message)
            return self.hear(dataclasses.replace(waiting, heard_ns=message.heard_ns)) if waiting is not None else []
        self._clock_ns = message.heard_ns or self._clock_ns
        if isinstance(message, JourneyHeard) and not message.heard_ns:  # There is no other time yet.
            self._clock_ns = max(self._clock_ns, message.time_ns)
        kind = message.kind
        try:
            if self._guard.counts(message):
                problem = self._guard.problem(message)
                if problem:
                    self._reporting.complain(self._clock_ns, problem)
                else:
                    self._act(message)
            for news in self._guard.take_news():
                self._reporting.complain(self._clock_ns, news)
        except Exception as error:
            self._lose(kind, error)
        self._news_pending |= kind in (Kind.RESTRICTION, Kind.TARGET)
        return self._reporting.take()

    def set_clock(self, step_s: float, now_ns: int) -> list[Output]:
        """Take note that the clock that gives the cab its time was set by `step_s` (s; forwards > 0)."""
        self._localisation.set_clock(step_s)
        way = f"{'forward' if step_s > 0 else 'back'} by {abs(step_s):.1f} s"
        text = f"the clock was set {way}; until the next position, the train may be as far off"
        self._reporting.complain(now_ns, text)
        return self._reporting.take()

    def tick(self, now_ns: int, *, dropped: int = 0) -> list[Output]:
        """Advise once and report the status; if anything goes wrong, report why there is no advice.

        `dropped` counts the messages lost in floods since the start. The advice is the last output of a tick.
        """
        for message in self._guard.due(now_ns):
            for output in self.hear(dataclasses.replace(message, heard_ns=now_ns)):
                self._reporting.add(output)
        self._clock_ns = now_ns
        self._news_pending = self._failing = False
        try:
            journey = self._journey  # It is checked again if the clock has entered or left its day.
            if journey is not None and is_of_another_day(journey, now_ns) != self._of_another_day:
                self._begin(dataclasses.replace(journey, heard_ns=now_ns))
            self._answer(now_ns, dropped)
        except Exception as error:  # The error is reported; the next tick tries again.
            return self.fail(now_ns, error)
        return self._reporting.take()

    def fail(self, now_ns: int, error: Exception) -> list[Output]:
        """Withdraw the advice because a tick failed, here or where its answer was used, and report the reason."""
        self._failing = True
        self._reporting.note_internal_error()
        text = self._unforeseen(error)
        self._reporting.add(self._status(now_ns, NodeState.WITHDRAWN, text, Cause.INTERNAL_ERROR))
        self._reporting.add(Advice(time_ns=now_ns, cause=Cause.INTERNAL_ERROR, reason=Reason.of_text(text)))
        return self._reporting.take()

    def _act(self, message: Heard) -> None:
        if self.learning is not None:
            self.learning.receive(message)
        if isinstance(message, JourneyHeard):
            self._begin(message)
        elif isinstance(message, PositionHeard):
            self._localisation.take(message.fix, message.heard_ns)
            self.legs.place(self._localisation.moment)
        elif isinstance(message, DelayHeard):
            self.legs.set_delay(message.delay_s)
        elif isinstance(message, RestrictionsHeard):
            self.legs.set_restrictions([judged(one) for one in message.restrictions])
            if astray := off_route(message.restrictions, self._post.route.length_m):
                self._reporting.complain(self._clock_ns, astray)
            self._trust = dataclasses.replace(self._trust, restrictions_received=True)
        elif isinstance(message, TargetsHeard):
            self.legs.set_targets([one._replace(reason=one.reason[:LONGEST_REASON]) for one in message.targets])

    def _begin(self, journey: JourneyHeard) -> None:
        """Take over a journey or refuse it; after a refusal there is no advice until another journey comes."""
        self._journey, self._of_another_day = journey, is_of_another_day(journey, journey.heard_ns)
        try:
            order = self._post.accept(journey)
            same = order.vehicle is self.legs.situation.vehicle
            self.legs.begin(order, self._localisation.moment if same else None)
        except DasError as error:
            self._refuse(journey.time_ns, str(error))
            return
        if not same:
            self._localisation = Localisation(order.vehicle)
        self._trust = dataclasses.replace(self._trust, journey_refused="")
        if self.learning is not None:
            self.learning.set_vehicle(order.vehicle)
        if not self._reporting.may_report(self._clock_ns):
            return
        names = [stop.name for stop in order.stops]
        self._reporting.event(journey.time_ns, Severity.INFO, f"journey {' – '.join(names)}")
        self._reporting.add(self._status(journey.time_ns, NodeState.READY, f"ready for {' – '.join(names)}"))

    def _refuse(self, time_ns: int, why: str) -> None:
        known = self._trust.journey_refused == why
        self._trust = dataclasses.replace(self._trust, journey_refused=why)
        self.legs.end()
        text = wording.withdrawal(Withdrawal(Cause.JOURNEY_REFUSED, why))
        self._reporting.complain(self._clock_ns, text, Severity.ERROR)
        if not known or self._reporting.may_report(self._clock_ns):
            self._reporting.add(self._status(time_ns, NodeState.WITHDRAWN, text, Cause.JOURNEY_REFUSED))

    def _lose(self, kind: Kind, error: Exception) -> None:
        """Report that a message was not used; an unforeseen error, or lost restrictions, withdraw the advice."""
        if isinstance(error, ArithmeticError | ValueError):
            why = f"a message was ignored ({error})"
            self._reporting.complain(self._clock_ns, f"{kind}: {why}")
        else:
            why = self._unforeseen(error)
            self._trust = dataclasses.replace(self._trust, internal_error=why)
            if kind is Kind.JOURNEY:
                self._refuse(self._clock_ns, why)
        if kind is Kind.RESTRICTION:
            self._guard.unheeded = why

    def _unforeseen(self, error: Exception) -> str:
        """Report an unforeseen error and where it occurred; returns the reported text."""
        raise_interruption(error)
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST_REASON]
        text = f"internal error: {what} ({Path(place.filename).name}:{place.lineno})"
        self._reporting.complain(self._clock_ns, text, Severity.ERROR)
        return text

    def _answer(self, now_ns: int, dropped: int) -> None:
        began = self.legs.preparation.stopwatch()
        if self.learning is not None:
            self.learning.tick(now_ns, contested=self._guard.has_rival_efforts(now_ns))
            if conditions := self.learning.due(now_ns):
                self.legs.set_conditions(conditions)
        advice = self._advise(now_ns)
        took_s = self.legs.preparation.stopwatch() - began
        self._trust = dataclasses.replace(self._trust, internal_error="")
        reporting = self._reporting
        reporting.losses(now_ns, dropped)
        for text, bad in self.legs.take_news():
            if bad:
                reporting.complain(now_ns, text)
            else:
                reporting.event(now_ns, Severity.INFO, text)
        if self.learning is not None and (text := self.learning.news(now_ns)):
            reporting.complain(now_ns, text)
        reason = wording.words(advice.reason, zone=self._zone)
        reporting.changes(advice, reason)
        reporting.rejections(self.here)
        reporting.clocks(self.here)
        leg = self.legs.current
        reporting.plan(leg.planner.plan if leg is not None else None, now_ns)
        if self.learning is not None and (estimated := self.learning.report(now_ns)):
            reporting.add(estimated)
        reporting.advices += 1
        reporting.add(self._status(now_ns, self._state(advice), reason, advice.cause, took_s))
        reporting.add(advice)

    def _advise(self, now_ns: int) -> Advice:
        """The advice for a moment (ns since 1970), after the last word; without advice, one that states the cause."""
        self.here = self._localisation.at(now_ns)
        leg = self.legs.current
        if leg is not None:
            leg.see(self.here)
            self.legs.prepare(now_ns)
        trust = dataclasses.replace(self._trust, **self._guard.doubts(now_ns))
        why = decide(self.here, trust, leg)
        if leg is None:
            assert why is not None
            return Advice(time_ns=now_ns, cause=why.cause, reason=Reason.of_text(wording.withdrawal(why)))
        if why is None:
            try:
                advice, least_ns = leg.advise(self.here), now_ns + self._least_valid_ns
                if advice.mode is not Regime.NONE and advice.valid_until_ns < least_ns:
                    advice = dataclasses.replace(advice, valid_until_ns=least_ns)  # until the next one should have come
                advice = self.legs.judged(advice, self.here)
            except NoPlanError as error:
                why = decide(self.here, trust, leg, no_plan=str(error))
            else:
                quiet = self._quiet.cause(advice, self.here, leg.section)
                why = decide(self.here, trust, leg, quiet=quiet) if quiet else None
                return advice if why is None else leg.withdraw(self.here, why)
        assert why is not None
        self._quiet.forget()
        return leg.withdraw(self.here, why)

    def _state(self, advice: Advice) -> NodeState:
        if advice.mode is not Regime.NONE:
            return NodeState.ADVISING
        if self._trust.journey_refused:
            return NodeState.WITHDRAWN
        if self.legs.current is None:
            return NodeState.WAITING
        return NodeState.WITHDRAWN if self._localisation.received_any else NodeState.READY

    def _status(
        self, time_ns: int, state: NodeState, reason: str, cause: Cause = Cause.NONE, took_s: float = 0.0
    ) -> Status:
        leg = self.legs.current
        return Status(
            time_ns=time_ns,
            state=state,
            reason=reason,
            cause=cause,
            section=leg.section.name if leg is not None else "",
            solve_s=self.legs.preparation.solve_s,
            last_advice_s=took_s,
            advices=self._reporting.advices,
        )


def warm_up() -> None:
    """Run planner, guide and last word on a tiny section, under way and braking for the stop."""
    front = solve_tiny()
    warm_up_advice(front.section, front)


def warm_up_advice(section: Section, front: Front | None = None) -> None:
    """Run guide, planner and last word on a tiny section of 400 m; plans use the given front, or none."""
    start, end = Stop(name="A", position_m=section.start_m), Stop(name="B", position_m=section.end_m)
    leg = Leg(start, end, section, Guide(section, None))
    leg.use(Planner(section, front))
    leg.use_guide(GuideFront(section))
    leg.set_timetable(Timetable(departure_ns=0, arrival_ns=round(60.0 / NS)))
    vehicle = section.vehicle
    basis = BrakingBasis(section.route, vehicle, section.brakes, (), Conditions(), section.start_m, section.end_m)
    for tick, (s_m, speed_mps) in enumerate(((100.0, 10.0), (110.0, 10.0), (385.0, 5.0))):
        localisation = Localisation(vehicle)
        localisation.take(PositionFix(time_ns=tick, s_m=s_m, speed_mps=speed_mps))
        here = localisation.at(tick)
        LastWord().judge(leg.advise(here), here, basis)
