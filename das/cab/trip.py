"""One train's trip: what has been told of it, a front for every section it comes to, and the advice. No bus, no clock.

A section whose situation changes (a restriction, another train, load or level, a new target) is advised on at once by
the plan of before under the new limits; its front is looked up or solved in the background, or, where time stands still
meanwhile, at once.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import pairwise
from typing import NamedTuple

from das.advice.advisor import AT_STOP_M, Advice, Advisor, Source, Timetable, bare_front
from das.advice.passing import PassingFronts, PassingTarget
from das.advice.plan import Plan
from das.cab.fronts import AS_PLANNED, Found, Fronts, Situation, onboard_ladder
from das.cab.journey_advisor import JourneyAdvisor
from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.losses import Level
from das.domain.route import Restriction, Stop
from das.domain.units import KM, NS
from das.domain.vehicle import Vehicle
from das.estimate.localisation import STANDSTILL_MPS, Estimate, Localisation, PositionFix
from das.solver.section import Section

MOST_STOPS, MOST_RESTRICTIONS, MOST_TARGETS = 200, 100, 100
"""More than this at a time are no sensible message."""
NOT_TOLD = "no list of restrictions has been heard yet (a site that has none says so: das-node --no-restrictions)"
"""Why there is no advice before anybody has said which restrictions are in force, even if there are none."""
MOST_NAMED = 3
"""Of targets that are agreed to, so many are named."""
LEAST_WAY_M = 2.0
"""A point to pass lies at least this far from both ends of its section."""
TRY_AGAIN_S = 10.0
"""A search that failed for a reason nobody foresaw is made again after so long, and whenever something is told."""


class Target(NamedTuple):
    """What traffic management wants: a new arrival at a stop, or the window of a point (ns since 1970; 0: open)."""

    stop: str = ""
    s_m: float = 0.0
    arrival_ns: int = 0
    earliest_ns: int = 0
    latest_ns: int = 0
    reason: str = ""


class News(NamedTuple):
    """Something that happened, for people to read; `bad`: something is not as it should be."""

    text: str
    bad: bool = False


class _Answer(NamedTuple):
    """What a search for a front came to; `refusal`: why there is none; `failed`: for a reason nobody foresaw."""

    found: Found | None
    passing: PassingFronts | None
    refusal: str
    failed: bool
    took_s: float


@dataclass(kw_only=True, eq=False)
class _Leg:
    """A section of the trip: what it was prepared for and why anew, the search under way, and why it has no advice."""

    start: Stop
    end: Stop
    advisor: Advisor
    situation: Situation
    refusal: str = ""
    why: str = ""
    arrival_ns: int | None = None
    points: list[PassingTarget] = field(default_factory=list)
    point: PassingTarget | None = None
    served: PassingTarget | None = None
    ready: bool = False
    search: Future[_Answer] | None = None
    failed_ns: int | None = None
    """When the last search failed, if it did."""
    reached_m: float = -math.inf
    """Where the train was when that was last known."""

    def next_point(self) -> PassingTarget | None:
        """The next point to be passed in a window."""
        here = self.advisor.here
        if here is not None:
            self.reached_m = here.s_m
        return next((point for point in self.points if point.s_m > self.reached_m), None)

    def give_up(self) -> None:
        """What was prepared or is looked for is not what is wanted any more."""
        if self.search is not None:
            self.search.cancel()
        self.ready, self.search = False, None

    def release(self) -> None:
        """Let go of the front of a section that is far off."""
        if self.ready:
            self.advisor.set_front(bare_front(self.advisor.section), Source.FALLBACK)
        self.give_up()


class Trip:
    """Takes what is told, prepares the sections and advises.

    `background`: searches go on in a thread of their own, and the clock with them; else each is over when the call
    returns, so that what is advised depends on what was told alone. Use `close` at the end.

    There is no advice before the restrictions in force are told, even if there are none. `unrestricted`: the site never
    has any, and advice needs no list.
    """

    def __init__(self, situation: Situation, fronts: Fronts, *, background: bool, unrestricted: bool = False) -> None:
        self._situation, self._fronts = situation, fronts
        self._started = situation
        self._pool = ThreadPoolExecutor(1, "solve") if background else None
        self._localisation = Localisation(situation.vehicle)
        self._legs: list[_Leg] = []
        self._journey: JourneyAdvisor | None = None
        self._targets: tuple[Target, ...] = ()
        self._agreed: tuple[Target, ...] = ()
        self._agreed_said: tuple[Target, ...] = ()
        self._now_ns = 0
        self._news = [News(text, True) for text in fronts.notes]
        self._told = False
        self._restrictions_told, self._untold_said = unrestricted, False
        self.solve_s = 0.0
        """What the last search for a front took."""

    @property
    def advisor(self) -> JourneyAdvisor | None:
        """Who advises on the journey that was begun last."""
        return self._journey

    @property
    def here(self) -> Estimate | None:
        """The state behind the last advice."""
        return self._journey.here if self._journey is not None else None

    @property
    def plan(self) -> Plan | None:
        """The plan behind the last advice."""
        return self._journey.plan if self._journey is not None else None

    @property
    def searching(self) -> bool:
        """Whether a front is being looked for."""
        return any(leg.search is not None for leg in self._legs)

    @property
    def has_answer(self) -> bool:
        """Whether something has been found that the last advice did not know."""
        return any(leg.search is not None and leg.search.done() for leg in self._legs)

    def take_news(self) -> list[News]:
        """What has happened since this was last asked."""
        if self._agreed != self._agreed_said:
            self._agreed_said = self._agreed
            self._news.append(News(f"targets: {_named(self._agreed)}"))
        news, self._news = self._news, []
        return news

    def check(self, stops_m: Sequence[float]) -> None:
        """Look at the sections between stops before there is a journey; raises DasError where one cannot be driven."""
        for a, b in pairwise(stops_m):
            self._situation.between(a, b).section(a, b)

    def rehearse(self, stops_m: Sequence[float]) -> None:
        """Prepare the first section before there is a journey; raises DasError."""
        first_m, second_m = stops_m[:2]
        began = time.perf_counter()
        self._fronts.find(self._situation.between(first_m, second_m).section(first_m, second_m))
        self.solve_s = time.perf_counter() - began

    def close(self) -> None:
        """End the thread; what it is solving is given up."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def begin(
        self,
        stops: Sequence[Stop],
        timetables: Sequence[Timetable],
        *,
        vehicle: Vehicle | None = None,
        level: Level | None = None,
    ) -> None:
        """Take over a journey, by default with train and level of the start.

        Raises DasError where it cannot be driven on this line; what was begun before goes on then.
        """
        if len(stops) > MOST_STOPS:
            raise DasError(f"{len(stops)} stops: expected at most {MOST_STOPS}")
        started, before = self._started, self._situation
        situation = replace(before, vehicle=vehicle or started.vehicle, level=level or started.level)
        localisation = self._localisation
        if situation.vehicle is not before.vehicle:
            # What was found of the train before says nothing of this one.
            situation, localisation = replace(situation, conditions=AS_PLANNED), Localisation(situation.vehicle)
        known = {(leg.start.position_m, leg.end.position_m): leg for leg in self._legs}
        legs = [known.get((a.position_m, b.position_m)) or self._new_leg(situation, a, b) for a, b in pairwise(stops)]
        journey = JourneyAdvisor([leg.advisor for leg in legs], localisation)
        journey.set_timetables(timetables)
        for leg, (start, end) in zip(legs, pairwise(stops), strict=True):
            leg.start, leg.end = start, end  # at the same places, perhaps by other names
        self._leave(leg for leg in self._legs if leg not in legs)
        self._situation, self._localisation, self._legs, self._journey = situation, localisation, legs, journey
        self.set_targets(self._targets)

    def end(self) -> None:
        """There is no journey any more."""
        self._leave(self._legs)
        self._legs, self._journey = [], None

    def _leave(self, legs: Iterable[_Leg]) -> None:
        """Nobody waits any more for what is looked for on these."""
        for leg in legs:
            leg.give_up()

    def _new_leg(self, situation: Situation, start: Stop, end: Stop) -> _Leg:
        """A leg that is not prepared yet. Raises DasError where it cannot be driven even without restrictions."""
        free = replace(situation, restrictions=())
        section = free.section(start.position_m, end.position_m)
        advisor = Advisor(bare_front(section), Source.FALLBACK)
        return _Leg(start=start, end=end, advisor=advisor, situation=free)

    def set_restrictions(self, restrictions: Sequence[Restriction]) -> None:
        """Take over all restrictions in force; DasError where they are too many."""
        if len(restrictions) > MOST_RESTRICTIONS:
            raise DasError(f"{len(restrictions)} restrictions: expected at most {MOST_RESTRICTIONS}")
        self._situation = replace(self._situation, restrictions=tuple(restrictions))
        self._restrictions_told = True
        self._heed()

    def set_conditions(self, conditions: Conditions) -> None:
        """Take over what differs from the files; where the train could not drive then, say so and go on as before."""
        situation = replace(self._situation, conditions=conditions)
        now = self._journey.index if self._journey is not None else 0
        try:
            for leg in self._legs[now : now + 2]:
                start_m, end_m = leg.start.position_m, leg.end.position_m
                situation.between(start_m, end_m).section(start_m, end_m)
        except DasError as error:
            self._news.append(News(f"calibration ignored: {error}", True))
            return
        self._situation = situation
        self._heed()

    def set_targets(self, targets: Sequence[Target]) -> None:
        """Take over all targets in force; one that is not on this journey is ignored and said."""
        if len(targets) > MOST_TARGETS:
            raise DasError(f"{len(targets)} targets: expected at most {MOST_TARGETS}")
        self._targets = tuple(targets)
        for leg in self._legs:
            leg.arrival_ns, leg.points = None, []
        agreed = []
        for target in targets if self._legs else ():
            try:
                self._assign(target)
                agreed.append(target)
            except DasError as error:
                self._news.append(News(f"target ignored: {error}", True))
        self._agreed = tuple(agreed)
        for leg in self._legs:
            leg.points.sort(key=lambda point: point.s_m)
        self._heed()

    def _assign(self, target: Target) -> None:
        """Hand a target to its leg."""
        for leg in self._legs:
            end_m = leg.end.position_m
            at_end = leg.end.name.casefold() == target.stop.casefold() if target.stop else target.s_m == end_m
            if at_end:
                if target.arrival_ns <= 0:
                    raise DasError(f"{leg.end.name}: no arrival is given")
                leg.arrival_ns = target.arrival_ns
                return
            if not target.stop and leg.start.position_m + LEAST_WAY_M <= target.s_m <= end_m - LEAST_WAY_M:
                leg.points.append(
                    PassingTarget(
                        s_m=target.s_m,
                        earliest_ns=target.earliest_ns or None,
                        latest_ns=target.latest_ns or None,
                        reason=target.reason,
                    )
                )
                return
        raise DasError(f"{target.stop or f'{target.s_m:.0f} m'} is not on the way to a stop of this journey")

    def set_position(self, fix: PositionFix) -> None:
        """Take over a position."""
        if self._journey is not None:
            self._journey.set_position(fix)
        else:
            self._localisation.take(fix)

    def set_delay(self, delay_s: float) -> None:
        """Take over the operator's word on the delay."""
        if self._journey is not None:
            self._journey.set_delay(delay_s)

    def update(self, now_ns: int) -> Advice:
        """The advice at a moment."""
        self._now_ns = now_ns
        if self._journey is None:
            return Advice(time_ns=now_ns, reason="no journey yet")
        self._journey.locate(now_ns)
        self._prepare()
        if not self._restrictions_told:
            if not self._untold_said:
                self._untold_said = True
                self._news.append(News(NOT_TOLD, True))
            return Advice(time_ns=now_ns, reason=NOT_TOLD)
        leg = self._legs[self._journey.index]
        leg.advisor.refuse(leg.refusal)
        return self._journey.advise()

    def _heed(self) -> None:
        """Something is new: look at once for what it needs; without a thread, when all is told and advice is due."""
        self._told = True
        if self._pool is not None:
            self._prepare()

    def _prepare(self) -> None:
        """Have fronts for the section the train is on and for the next one, and look for no others.

        The one before keeps what it has. Where something is new, a search that failed may go well now.
        """
        if self._journey is None:
            return
        now, told, self._told = self._journey.index, self._told, False
        for i, leg in enumerate(self._legs):
            leg.point = leg.next_point()
            leg.advisor.set_target(leg.arrival_ns, leg.point)
            if now <= i <= now + 1:
                if leg.failed_ns is not None and (told or abs(self._now_ns - leg.failed_ns) * NS >= TRY_AGAIN_S):
                    leg.ready = False
                self._ensure(leg)
            elif i != now - 1:
                leg.release()
            elif leg.search is not None:
                leg.give_up()

    def _ensure(self, leg: _Leg) -> None:
        """Bring a leg to the situation of now: at once what is safe, then its front."""
        wanted = self._situation.between(leg.start.position_m, leg.end.position_m)
        if not wanted.is_like(leg.situation):
            why, refusal = _difference(leg.situation, wanted), ""
            leg.give_up()
            try:
                leg.advisor.set_section(wanted.section(leg.start.position_m, leg.end.position_m), why)
            except DasError as error:
                refusal = f"{why}: {error}"
            # Not before the advisor has it: whatever else goes wrong, it is not taken for prepared.
            leg.situation, leg.refusal, leg.failed_ns, leg.why = wanted, refusal, None, why
        if leg.point is not None and leg.point != leg.served:
            leg.give_up()
        if leg.search is None and not leg.ready and (not leg.refusal or leg.failed_ns is not None):
            leg.served = leg.point
            leg.search = self._submit(leg)
        if leg.search is not None and leg.search.done():
            self._take(leg, leg.search.result())

    def _submit(self, leg: _Leg) -> Future[_Answer]:
        question = _Question.of(leg)
        if self._pool is not None:
            return self._pool.submit(_answered, self._fronts, question)
        answer: Future[_Answer] = Future()
        answer.set_result(_answered(self._fronts, question))
        return answer

    def _take(self, leg: _Leg, answer: _Answer) -> None:
        """Use what a search has found; where it failed, for now."""
        leg.search, leg.ready = None, True
        leg.failed_ns = self._now_ns if answer.failed else None
        self.solve_s = answer.took_s
        if answer.found is None:
            leg.refusal = answer.refusal
            self._news.append(News(f"{leg.advisor.section.name}: no plan: {answer.refusal}", True))
            return
        leg.refusal = ""
        if answer.refusal:
            self._news.append(News(f"target: {answer.refusal}", True))
        self._news += [News(note, True) for note in answer.found.notes]
        leg.advisor.set_front(answer.found.front, answer.found.source, answer.passing)
        how = "from a table" if answer.found.source is Source.TABLE else "solved"
        why, leg.why = f" ({leg.why})" if leg.why else "", ""
        self._news.append(News(f"{leg.start.name} – {leg.end.name}: {how}{why}"))


def _named(targets: Sequence[Target]) -> str:
    """The first few in words."""
    more = [f"{len(targets) - MOST_NAMED} more"] if len(targets) > MOST_NAMED else []
    return "; ".join([*map(_in_words, targets[:MOST_NAMED]), *more]) or "none any more"


def _in_words(target: Target) -> str:
    words = (("at", target.arrival_ns), ("not before", target.earliest_ns), ("not after", target.latest_ns))
    times = (f"{word} {datetime.fromtimestamp(at_ns * NS, UTC):%H:%M:%S}" for word, at_ns in words if at_ns > 0)
    why = f" ({target.reason})" if target.reason else ""
    return " ".join([target.stop or f"km {target.s_m / KM:.1f}", *times]) + why


class _Question(NamedTuple):
    """What a search is for, as it was when it began: a section, a point, and the state the point is planned from."""

    section: Section
    point: PassingTarget | None
    now_ns: int
    arrival_ns: int
    s_m: float
    v_mps: float

    @classmethod
    def of(cls, leg: _Leg) -> _Question:
        advisor, section = leg.advisor, leg.advisor.section
        here, departure_ns = advisor.here, advisor.departure_ns
        if here is None or not section.start_m <= here.s_m < section.end_m - AT_STOP_M:
            return cls(section, leg.point, departure_ns, advisor.arrival_ns, section.start_m, 0.0)
        now_ns = here.time_ns
        if here.speed_mps < STANDSTILL_MPS:
            now_ns = max(now_ns, departure_ns)
        return cls(section, leg.point, now_ns, advisor.arrival_ns, here.s_m, here.speed_mps)


def _answered(fronts: Fronts, question: _Question) -> _Answer:
    """Look for a front, and for those of a point; whatever goes wrong is the answer."""
    began = time.perf_counter()
    found, passing, refusal, failed = None, None, "", False
    try:
        found = fronts.find(question.section)
        passing = _passing(question)
    except DasError as error:
        refusal = str(error)
    except Exception as error:  # no advice is better than a thread that died in silence
        refusal, failed = f"solving failed ({type(error).__name__}: {error})", True
    return _Answer(found, passing, refusal, failed, time.perf_counter() - began)


def _passing(question: _Question) -> PassingFronts | None:
    point = question.point
    if point is None or point.s_m < question.s_m + LEAST_WAY_M:
        return None
    due_ns = point.earliest_ns if point.earliest_ns is not None else point.latest_ns
    if due_ns is None:
        return None
    return PassingFronts.solve(
        question.section,
        point.s_m,
        onboard_ladder(question.section),
        to_point_s=(due_ns - question.now_ns) * NS,
        total_s=(question.arrival_ns - question.now_ns) * NS,
        s_m=question.s_m,
        v_mps=question.v_mps,
    )


def _difference(before: Situation, after: Situation) -> str:
    """What makes two situations differ, in words."""
    if before.vehicle is not after.vehicle:
        return "another train or load"
    if before.level != after.level:
        return "another level"
    if before.restrictions != after.restrictions:
        gone = len(set(before.restrictions) - set(after.restrictions))
        return (
            "restriction lifted" if gone and len(after.restrictions) < len(before.restrictions) else "restriction set"
        )
    found = after.conditions
    return f"mass × {found.mass_ratio:.2f} and resistance × {found.resistance_ratio:.2f} of the plan's"
