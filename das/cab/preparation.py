"""Fronts for the legs of a journey: solved when they are needed, in the background or at once.

If the situation of a leg changes (a restriction, another train, load or level, a new target), the advice follows the
last plan under the new limits until the new front is found. The search runs in a thread, or at once where time
stands still during a search, as in a simulation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, NamedTuple

from das.advice.advice import Source
from das.advice.goal import AT_STOP_M, PassingTarget
from das.advice.planner import PlanBasis
from das.advice.worker import Worker
from das.cab.fronts import FoundGuide, Fronts
from das.cab.leg import LEAST_WAY_M, Leg
from das.cab.situation import Situation, difference
from das.domain.errors import DasError, RunawayError
from das.domain.units import NS
from das.solver.front import Front
from das.solver.guide.policies import GuideFront
from das.solver.section import Section

TRY_AGAIN_S = 10.0
"""Time (s) after which a search that failed for an unforeseen reason is repeated; it is also repeated whenever
something changes."""


class News(NamedTuple):
    """A text about something that happened; `bad`: something is not as it should be."""

    text: str
    bad: bool = False


class _Answer(NamedTuple):
    """The result of a search for a front; `refusal`: why there is none; `failed`: whether that was unforeseen."""

    found: Front | None
    passing: GuideFront | None
    refusal: str
    failed: bool
    took_s: float


@dataclass(kw_only=True, eq=False)
class _Prepared:
    """The state of a leg's preparation.

    `situation` is the one prepared for, `why` the reason for preparing again, `refusal` why the leg cannot be driven.
    """

    situation: Situation
    refusal: str = ""
    why: str = ""
    served: PassingTarget | None = None
    """The point to pass for which the front was found, or is being searched for."""
    held_from_m: float = math.inf
    """Place (m) from which the brakes hold the train, if the leg is refused for a descent; it is judged again there."""
    ready: bool = False
    search: Future[_Answer] | None = None
    guide: Future[FoundGuide | str] | None = None
    """The search for the guide's policies, which follows that for the front; a text says why there are
    none."""
    failed_ns: int | None = None
    """Time of the last search that failed for an unforeseen reason; None if it did not."""

    def give_up(self) -> None:
        """Give up the searches under way: the leg has to be prepared again."""
        for search in (self.search, self.guide):
            if search is not None:
                search.cancel()
        self.ready, self.search, self.guide = False, None, None

    @property
    def searches(self) -> list[Future[Any]]:
        """The searches under way."""
        return [one for one in (self.search, self.guide) if one is not None]


class Preparation:
    """Keeps the legs that are near prepared for the present situation.

    With `background`, searches for fronts run in a thread of their own, and all work for the guide in another one;
    otherwise each is over when the call returns, so that the advice depends on the messages alone. `stopwatch` gives
    seconds, which go into `solve_s` only. Call `close` at the end.
    """

    def __init__(
        self, fronts: Fronts, stopwatch: Callable[[], float], *, background: bool, guide: bool = False
    ) -> None:
        self._fronts, self._stopwatch, self._guide = fronts, stopwatch, guide
        self._solver = Worker("solve", background=background)
        self.guide_worker = Worker("guide", background=background)
        """Finds policies and makes references, for which the advice does not wait."""
        self._prepared: dict[Leg, _Prepared] = {}
        self._news = [News(text, True) for text in fronts.notes]
        self.solve_s = 0.0
        """The duration of the last search for a front (s)."""

    @property
    def in_background(self) -> bool:
        """Whether searches run in a thread of their own."""
        return self._solver.in_background

    @property
    def searching(self) -> bool:
        """Whether a search is under way."""
        return any(one.searches for one in self._prepared.values())

    @property
    def has_answer(self) -> bool:
        """Whether a search has ended whose result the last advice did not use."""
        return any(search.done() for one in self._prepared.values() for search in one.searches)

    def refusal(self, leg: Leg) -> str:
        """Why a leg cannot be driven; empty if it can."""
        return self._prepared[leg].refusal

    def report(self, news: News) -> None:
        """Add news."""
        self._news.append(news)

    def take_news(self) -> list[News]:
        """The news since the last call."""
        news, self._news = self._news, []
        return news

    def add(self, leg: Leg, situation: Situation) -> None:
        """Add a new leg, which is not prepared yet."""
        self._prepared[leg] = _Prepared(situation=situation)

    def drop(self, legs: Iterable[Leg]) -> None:
        """Remove legs and give up their searches."""
        for leg in legs:
            self._prepared.pop(leg).give_up()

    def rehearse(self, section: Section) -> None:
        """Find the front of a section before there is a journey; raises DasError if there is none.

        In the background the search for the guide's policies goes on afterwards, as for a leg under way:
        the front alone is enough to advise.
        """
        began = self._stopwatch()
        self._fronts.find(section)
        self.solve_s = self._stopwatch() - began
        if self._guide:
            guide = self.guide_worker.submit(lambda: self._fronts.find_guide(section))
            if not self.guide_worker.in_background:
                guide.result()

    def close(self) -> None:
        """End the threads and give up what they are solving."""
        self._solver.close()
        self.guide_worker.close()

    def prepare(self, legs: Sequence[Leg], index: int, situation: Situation, now_ns: int, *, changed: bool) -> None:
        """Prepare the leg of number `index`, on which the train is, and the next one, and no others.

        The leg before keeps its front. If something has `changed`, a search that failed is repeated.
        """
        for i, leg in enumerate(legs):
            leg.refresh_goal()
            one = self._prepared[leg]
            if index <= i <= index + 1:
                if one.failed_ns is not None and (changed or abs(now_ns - one.failed_ns) * NS >= TRY_AGAIN_S):
                    one.ready = False
                self._ensure(leg, one, situation, now_ns)
            elif i != index - 1:
                _release(leg, one)
            elif one.searches:
                one.give_up()

    def _ensure(self, leg: Leg, one: _Prepared, situation: Situation, now_ns: int) -> None:
        """Bring a leg up to date with the situation: its safe limits at once, then its front."""
        wanted = situation.between(leg.start.position_m, leg.end.position_m)
        if not wanted.is_like(one.situation) or leg.progress.reached_m >= one.held_from_m:
            _change_situation(leg, one, wanted)
        point = leg.goal.passing
        if point is not None and point != one.served:
            one.give_up()
        if one.search is None and not one.ready and (not one.refusal or one.failed_ns is not None):
            one.served = point
            question = _Question.of(leg)
            one.search = self._solver.submit(lambda: _search_front(self._fronts, question, self._stopwatch))
        if one.search is not None and one.search.done():
            self._take(leg, one, one.search.result(), now_ns)
        if one.guide is not None and one.guide.done():
            self._take_guide(leg, one, one.guide.result())

    def _take(self, leg: Leg, one: _Prepared, answer: _Answer, now_ns: int) -> None:
        """Use the result of a search, or keep why it failed."""
        one.search, one.ready = None, True
        one.failed_ns = now_ns if answer.failed else None
        self.solve_s = answer.took_s
        found = answer.found
        if found is None:
            one.refusal = answer.refusal
            self._news.append(News(f"{leg.section.name}: no plan: {answer.refusal}", True))
            return
        one.refusal = ""
        if answer.refusal:
            self._news.append(News(f"target: {answer.refusal}", True))
        section = found.section
        leg.use(PlanBasis(section=section, front=found, source=Source.SOLVED, passing=answer.passing))
        why, one.why = one.why, ""
        self._news.append(News(f"{leg.start.name} – {leg.end.name}: solved" + (f" ({why})" if why else "")))
        if self._guide:
            s_m = _Question.of(leg).s_m
            one.guide = self.guide_worker.submit(lambda: _search_guide(self._fronts, section, s_m))

    def _take_guide(self, leg: Leg, one: _Prepared, answer: FoundGuide | str) -> None:
        """Let the guide lead by the policies found; without any, the leg goes on without a guide."""
        one.guide = None
        if isinstance(answer, str):
            self._news.append(News(f"no guide: {answer}", True))
            return
        self._news += [News(note, True) for note in answer.notes]
        if answer.front.references is not None:
            self._news.append(News(f"{leg.start.name} – {leg.end.name}: references from a table"))
        leg.use_guide(answer.front)


def _change_situation(leg: Leg, one: _Prepared, wanted: Situation) -> None:
    """Take over another situation: its safe limits hold at once."""
    why, refusal, held_from_m = difference(one.situation, wanted), "", math.inf
    one.give_up()
    try:
        start_m, end_m = leg.start.position_m, leg.end.position_m
        leg.use_meanwhile(wanted.section_ahead(start_m, end_m, leg.progress.reached_m))
    except DasError as error:
        refusal = f"{why}: {error}"
        held_from_m = error.held_from_m if isinstance(error, RunawayError) else math.inf
    # Only after the leg has taken over the situation: if that fails, the leg does not count as prepared.
    one.situation, one.refusal, one.failed_ns, one.why = wanted, refusal, None, why
    one.held_from_m = held_from_m


def _release(leg: Leg, one: _Prepared) -> None:
    """Drop the front of a leg that is far away."""
    if one.ready:
        leg.use(PlanBasis(section=leg.section))
    one.give_up()


class _Question(NamedTuple):
    """What a search starts from: the section, the point to pass, and the place of the train (m) when it began."""

    section: Section
    point: PassingTarget | None
    s_m: float

    @classmethod
    def of(cls, leg: Leg) -> _Question:
        section, here = leg.section, leg.here
        inside = here is not None and section.start_m <= here.s_m < section.end_m - AT_STOP_M
        return cls(section, leg.goal.passing, here.s_m if here is not None and inside else section.start_m)


def _search_front(fronts: Fronts, question: _Question, stopwatch: Callable[[], float]) -> _Answer:
    """Search for a front, and for policies if there is a point to pass; any error becomes part of the answer."""
    began = stopwatch()
    found, passing, refusal, failed = None, None, "", False
    try:
        found = fronts.find(question.section, question.s_m)
        passing = _passing(fronts, question, found.section)
    except DasError as error:
        refusal = str(error)
    except Exception as error:  # A thread must not die in silence: giving no advice is better.
        refusal, failed = f"solving failed ({type(error).__name__}: {error})", True
    return _Answer(found, passing, refusal, failed, stopwatch() - began)


def _search_guide(fronts: Fronts, section: Section, s_m: float) -> FoundGuide | str:
    """Search for the policies of a section; after an error, return its text."""
    try:
        return fronts.find_guide(section, s_m)
    except Exception as error:  # Advice without a guide is better than a thread that dies in silence.
        return str(error) if isinstance(error, DasError) else f"solving failed ({type(error).__name__}: {error})"


def _passing(fronts: Fronts, question: _Question, section: Section) -> GuideFront | None:
    """The guide's policies if a point is to be passed; None if the point sets no time or is already reached."""
    point = question.point
    if point is None or point.s_m < question.s_m + LEAST_WAY_M or (point.earliest_ns or point.latest_ns) is None:
        return None
    return fronts.find_guide(section, question.s_m).front
