"""Fronts for the legs of a journey: stored, or solved when needed, in the background or immediately.

If the situation of a leg changes (a restriction, another train, load or level, a new target), the advice follows the
last plan under the new limits until the new front is found.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from das.advice.goal import AT_STOP_M, PassingTarget
from das.advice.guide.drift import Drift
from das.advice.guide.guide import Guide
from das.advice.planner import Planner
from das.advice.worker import worker
from das.cab.leg import LEAST_WAY_M, Leg
from das.cab.situation import Situation, difference
from das.domain.clocks import WALL_STOPWATCH
from das.domain.errors import DasError, RunawayError, raise_interruption
from das.domain.units import NS
from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.guide.policies import DEFAULT, GuideFront
from das.solver.guide.references import References
from das.solver.section import Section
from das.solver.solve import default_ladder, solve_ahead
from das.table import OLD, Table, TableError, key_of, section_facts, section_sha256, table_name

KEPT_BYTES = 60_000_000
"""Total size (bytes) up to which fronts are kept (30 km take 18 MB); the newest front is always kept."""
EVERY_MULTIPLIER = 3
"""Step in the solver's multipliers on board. With every third one, a front takes 0.4 of the memory and costs 0.003 to
0.03 % of the energy on average, 0.15 % at worst (buffers of 0.5 to 40 %); the solving time is nearly the same."""

T = TypeVar("T")


class _Kept(Generic[T]):
    """Keeps results by key up to a total size, dropping the least recently used; several threads may use it."""

    def __init__(self, most_bytes: int, size: Callable[[T], int]) -> None:
        self._most_bytes, self._size = most_bytes, size
        self._lock = Lock()
        self._known: OrderedDict[str, T] = OrderedDict()

    def get(self, key: str) -> T | None:
        with self._lock:
            known = self._known.get(key)
            if known is not None:
                self._known.move_to_end(key)
        return known

    def put(self, key: str, found: T) -> T:
        """Keep a result, drop the least recently used ones if the size is exceeded, and return the result."""
        with self._lock:
            self._known[key] = found
            while len(self._known) > 1 and sum(map(self._size, self._known.values())) > self._most_bytes:
                self._known.popitem(last=False)
        return found


class FoundGuide(NamedTuple):
    """The policies of the guide on a section, and why a table made for the section cannot be used."""

    front: GuideFront
    notes: tuple[str, ...] = ()


class Fronts:
    """Finds the fronts of sections and the policies of the guide; several threads may use it."""

    def __init__(self, tables: Path | None = None, *, threads: int = 2, kept_bytes: int = KEPT_BYTES) -> None:
        """Check a folder of tables; `notes` lists faults of the folder. DasError if there is no such folder."""
        self.notes: list[str] = []
        self._threads = threads
        self._known = _Kept[Front](kept_bytes, lambda front: front.value_j.nbytes + front.time_to_go_s.nbytes)
        self._guides = _Kept[FoundGuide](kept_bytes, lambda guide: guide.front.nbytes)
        self._folder, self._missed = tables, set[str]()
        if tables is None:
            return
        if not tables.is_dir():
            raise DasError(f"{tables}: no such folder of tables")
        if any(tables.glob(OLD)):
            self.notes.append(f"{tables}: tables of an earlier release, no longer usable; build them again")
        elif not any(tables.glob("*.json")):
            self.notes.append(f"{tables}: no table in this folder")

    def find(self, section: Section, s_m: float | None = None) -> Front:
        """The front of a section: kept, or solved now; raises as `solve_front` does.

        For a train at a position (m), the line behind it is not solved; the answers are the same.
        """
        key = section_sha256(section)
        s_m = section.start_m if s_m is None else s_m
        known = self._known.get(key)
        if known is not None:
            known.cover(s_m)
            return known
        front = solve_ahead(section, s_m, threads=self._threads, lambda_w=onboard_ladder(section))
        return self._known.put(key, front)

    def find_guide(self, section: Section, s_m: float | None = None) -> FoundGuide:
        """The policies of the guide on a section: kept, or begun now, with the finished references of its table.

        For a train at a position (m), the line behind it is not solved; the answers are the same.
        """
        key = key_of(section, DEFAULT)
        known = self._guides.get(key)
        if known is not None:
            known.front.cover(section.start_m if s_m is None else s_m)
            return known
        references, notes = self._references(section)
        front = GuideFront(section, s_m=s_m, threads=self._threads, references=references)
        return self._guides.put(key, FoundGuide(front, notes))

    def _references(self, section: Section) -> tuple[References | None, tuple[str, ...]]:
        """The references of a section's table; without a table that fits, None and why."""
        if self._folder is None:
            return None, ()
        path = self._folder / table_name(section_facts(section))
        try:
            if path.exists():
                return Table.read(path).references_for(section, DEFAULT), ()
        except TableError as error:
            return None, (f"{error}; references are solved instead",)
        if section.name in self._missed:
            return None, ()
        self._missed.add(section.name)  # reported once, however often restrictions change
        return None, (f"{self._folder}: no table of {section.name}; references are solved instead",)


def onboard_ladder(section: Section) -> NDArray[np.float64]:
    """The multipliers of a front that is solved on board (W)."""
    ladder, lowest = default_ladder(section), len(tol.LADDER_LOWEST_RATIOS)
    return np.unique(np.concatenate((ladder[:lowest], ladder[lowest::EVERY_MULTIPLIER], ladder[-1:])))


TRY_AGAIN_S = 10.0
"""Time (s) until a search that failed for an unforeseen reason is repeated; any change repeats it as well."""


class News(NamedTuple):
    """A text about an event; `bad`: it reports a fault."""

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

    The leg is prepared for `situation`; `why` is the reason for preparing it again.
    """

    situation: Situation
    why: str = ""
    served: PassingTarget | None = None
    """The point to pass for which the front was found, or is being searched for."""
    held_from_m: float = math.inf
    """Place (m) after which the brakes hold the train, if a leg is refused for a descent; it is checked again there."""
    ready: bool = False
    search: Future[_Answer] | None = None
    guide: Future[FoundGuide] | None = None
    """The search for the guide's policies, after the search for the front."""
    failed_ns: int | None = None
    """Time of the last search that failed for an unforeseen reason; None if it did not."""

    def give_up(self) -> None:
        """Give up the searches under way: the leg has to be prepared again."""
        for search in self.searches:
            search.cancel()
        self.ready, self.search, self.guide = False, None, None

    @property
    def searches(self) -> list[Future[Any]]:
        """The searches under way."""
        return [one for one in (self.search, self.guide) if one is not None]


class Preparation:
    """Keeps the legs that are near prepared for the present situation.

    With `background`, searches for fronts run in a separate thread, and all work for the guide in another; otherwise
    each is finished when the call returns, so that the advice depends on the messages alone. Call `close` at the end.
    """

    def __init__(self, fronts: Fronts, *, background: bool, guide: bool = False) -> None:
        self._fronts, self._guide = fronts, guide
        self.stopwatch: Callable[[], float] = WALL_STOPWATCH if background else lambda: 0.0
        """The clock (s) for durations that are reported; without a background, it always reads 0."""
        self.in_background = background
        """Whether searches run in a separate thread."""
        self._solver = worker("solve", background=background)
        self.guide_worker = worker("guide", background=background)
        """Executor of the work on policies and references, for which the advice does not wait."""
        self._prepared: dict[Leg, _Prepared] = {}
        self._news = [News(text, True) for text in fronts.notes]
        self.solve_s = 0.0
        """The duration of the last search for a front (s)."""

    @property
    def searching(self) -> bool:
        """Whether a search is under way."""
        return any(one.searches for one in self._prepared.values())

    @property
    def has_answer(self) -> bool:
        """Whether a finished search has a result that the last advice did not use."""
        return any(search.done() for one in self._prepared.values() for search in one.searches)

    def report(self, news: News) -> None:
        """Add events to report."""
        self._news.append(news)

    def take_news(self) -> list[News]:
        """The events to report since the last call."""
        news, self._news = self._news, []
        return news

    def new_guide(self, section: Section, drift: Drift) -> Guide | None:
        """The guide of a section, without policies yet, for a driver with a drift; None if there is to be no guide."""
        return Guide(section, None, self.guide_worker, drift) if self._guide else None

    def take_over(self, legs: Sequence[Leg], situation: Situation) -> None:
        """Take over the legs of a journey, new ones as planned for a situation; searches for others are given up."""
        for leg in [one for one in self._prepared if one not in legs]:
            self._prepared.pop(leg).give_up()
        for leg in legs:
            self._prepared.setdefault(leg, _Prepared(situation=situation))

    def rehearse(self, section: Section) -> None:
        """Find the front of a section before there is a journey; raises DasError if there is none.

        In the background the search for the guide's policies continues: the front alone suffices for advice.
        """
        began = self.stopwatch()
        self._fronts.find(section)
        self.solve_s = self.stopwatch() - began
        if self._guide:
            guide = self.guide_worker.submit(lambda: self._fronts.find_guide(section))
            if not self.in_background:
                guide.result()

    def close(self) -> None:
        """End the threads and give up what they are solving."""
        for one in (self._solver, self.guide_worker):
            one.shutdown(cancel_futures=True)

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
            elif one.ready and i != index - 1:  # far away: its front is dropped
                leg.use(Planner(leg.section))
                one.give_up()
            elif one.searches:
                one.give_up()

    def _ensure(self, leg: Leg, one: _Prepared, situation: Situation, now_ns: int) -> None:
        """Bring a leg up to date with the situation: its safe limits immediately, then its front."""
        wanted = situation.between(leg.start.position_m, leg.end.position_m)
        if not wanted.is_like(one.situation) or leg.reached_m >= one.held_from_m:
            _change_situation(leg, one, wanted)
        point = leg.goal.passing
        if point is not None and point != one.served:
            one.give_up()
        if one.search is None and not one.ready and (not leg.refusal or one.failed_ns is not None):
            one.served = point
            section, s_m = leg.section, _place_m(leg)
            one.search = self._solver.submit(lambda: self._search_front(section, s_m, point))
        if one.search is not None and one.search.done():
            self._take(leg, one, one.search.result(), now_ns)
        if one.guide is not None and one.guide.done():
            self._take_guide(leg, one, one.guide)

    def _take(self, leg: Leg, one: _Prepared, answer: _Answer, now_ns: int) -> None:
        """Use the result of a search, or keep the reason why the search failed."""
        one.search, one.ready = None, True
        one.failed_ns = now_ns if answer.failed else None
        self.solve_s = answer.took_s
        found = answer.found
        if found is None:
            leg.refusal = answer.refusal
            self._news.append(News(f"{leg.section.name}: no plan: {answer.refusal}", True))
            return
        leg.refusal = ""
        if answer.refusal:
            self._news.append(News(f"target: {answer.refusal}", True))
        section = found.section
        leg.use(Planner(section, found, passing=answer.passing))
        why, one.why = one.why, ""
        self._news.append(News(f"{leg.start.name} – {leg.end.name}: solved" + (f" ({why})" if why else "")))
        if self._guide:
            s_m = _place_m(leg)
            one.guide = self.guide_worker.submit(lambda: self._fronts.find_guide(section, s_m))

    def _take_guide(self, leg: Leg, one: _Prepared, search: Future[FoundGuide]) -> None:
        """Let the guide use the policies found; after any error, the leg continues without a guide."""
        one.guide = None
        if error := search.exception():
            self._news.append(News(f"no guide: {_why_failed(error)}", True))
            return
        answer = search.result()
        self._news += [News(note, True) for note in answer.notes]
        if answer.front.references is not None:
            self._news.append(News(f"{leg.start.name} – {leg.end.name}: references from a table"))
        leg.use_guide(answer.front)

    def _search_front(self, section: Section, s_m: float, point: PassingTarget | None) -> _Answer:
        """Search for a front, and for policies if a point ahead must be passed in a window of time.

        Any error becomes part of the answer.
        """
        began = self.stopwatch()
        found, passing, refusal, failed = None, None, "", False
        try:
            found = self._fronts.find(section, s_m)
            if point is not None and point.s_m >= s_m + LEAST_WAY_M and (point.earliest_ns or point.latest_ns):
                passing = self._fronts.find_guide(found.section, s_m).front
        except Exception as error:  # A thread must not end unnoticed: withdrawing the advice is better.
            refusal, failed = _why_failed(error), not isinstance(error, DasError)
        return _Answer(found, passing, refusal, failed, self.stopwatch() - began)


def _why_failed(error: BaseException) -> str:
    """The reason for a failed search; KeyboardInterrupt is raised again."""
    raise_interruption(error)
    return str(error) if isinstance(error, DasError) else f"solving failed ({type(error).__name__}: {error})"


def _change_situation(leg: Leg, one: _Prepared, wanted: Situation) -> None:
    """Take over another situation; its safe limits apply immediately."""
    why, refusal, held_from_m = difference(one.situation, wanted), "", math.inf
    one.give_up()
    try:
        start_m, end_m = leg.start.position_m, leg.end.position_m
        leg.use_meanwhile(wanted.section_ahead(start_m, end_m, leg.reached_m))
    except DasError as error:
        refusal = f"{why}: {error}"
        held_from_m = error.held_from_m if isinstance(error, RunawayError) else math.inf
    # Only after the leg has taken over the situation: if that fails, the leg does not count as prepared.
    leg.refusal = refusal
    one.situation, one.held_from_m, one.failed_ns, one.why = wanted, held_from_m, None, why


def _place_m(leg: Leg) -> float:
    """The place of the train (m) from which a search starts: the start of the section, if it is not inside."""
    section, here = leg.section, leg.here
    inside = here is not None and section.start_m <= here.s_m < section.end_m - AT_STOP_M
    return here.s_m if here is not None and inside else section.start_m
