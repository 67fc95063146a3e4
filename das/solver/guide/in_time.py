"""The run of a section's policies that arrives at the wanted time: with one price of time, or two in succession."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property

import numpy as np

from das.domain.errors import InfeasibleError
from das.domain.journey import Window
from das.solver.guide.policies import GuideFront, GuideRun, PolicyFrom
from das.solver.guide.references import LATE_RATIO, NEAR_AT_PLACE_S, NEAR_S, lateness_s
from das.solver.kernels.guide_policy import NO_INSTRUCTION
from das.solver.state import State

SLOWER = (4, 8, 16, 24, 32, 41)
"""Steps down the price ladder, from the higher of two neighbouring prices, to the second prices tried (0.9 to 0.3 of
it). They give arrival times between those of the two neighbours, which may be many seconds apart."""
ROUNDS = 2
"""Number of rounds in which the price after a place is found: price and speed at the place depend on each other."""

Plan = tuple[PolicyFrom, ...]


class _Search:
    """The runs tried so far for a time to a place (m)."""

    def __init__(
        self, front: GuideFront, state: State, time_s: float, told: int, at_m: float, near_s: float = NEAR_S,
        known: dict[Plan, GuideRun] | None = None,
    ) -> None:  # fmt: skip
        self._front, self._state, self._time_s, self._told, self._at_m = front, state, time_s, told, at_m
        self._near_s, self._known = near_s, {} if known is None else known
        self._found: list[tuple[float, GuideRun, Plan]] = []

    def late_s(self, *plan: PolicyFrom) -> float:
        """The lateness (s; early < 0) of the run of a plan; infinity if only this plan makes the train stall."""
        if plan not in self._known:
            try:
                self._known[plan] = self._front.run(self._state, plan, self._told)
            except InfeasibleError:
                if not self._found:
                    raise
                return math.inf
        run = self._known[plan]
        self._found.append((run.passes_s(self._at_m) - self._time_s, run, plan))
        return self._found[-1][0]

    @cached_property
    def spare_s(self) -> float:
        """The wanted time minus the time of the fastest run to the place (s)."""
        elapsed_s = self._state.elapsed_s(self._state.fastest().speeds_mps)
        return self._time_s - float(np.interp(self._at_m, self._state.node_m, elapsed_s))

    @property
    def is_near(self) -> bool:
        """Whether one of the runs is near enough."""
        return any(abs(late_s) < self._near_s for late_s, _, _ in self._found)

    def best(self, price_w: float) -> tuple[float, GuideRun, Plan]:
        """The run with the least energy plus cost of its lateness: the lateness (s; early < 0), the run, its plan."""
        return min(self._found, key=lambda one: one[1].energy_j + price_w * lateness_s(one[0]))

    def has_best_near(self, price_w: float) -> bool:
        """Whether the run with the least energy plus cost of its lateness is near enough."""
        return self.is_near and abs(self.best(price_w)[0]) < self._near_s

    def nearest(self, *, not_early: bool) -> tuple[float, GuideRun]:
        """The run nearest to the wanted time, and its deviation (s), which counts more on the unwanted side."""

        def off_s(late_s: float) -> float:
            unwanted = late_s < 0.0 if not_early else late_s > 0.0
            return abs(late_s) * (LATE_RATIO if unwanted else 1.0)

        late_s, run, _ = min(self._found, key=lambda one: off_s(one[0]))
        return off_s(late_s), run


def in_time(front: GuideFront, state: State, time_s: float, told: int = NO_INSTRUCTION) -> tuple[GuideRun, Plan]:
    """The run from a state that takes about `time_s` to the end, and the plan that it follows.

    `told` is the instruction in force, shown for some time already. If no run is quick enough, the result is the
    quickest run. Raises InfeasibleError if the train stalls.
    """
    search = _Search(front, state, time_s, told, front.section.end_m)
    return search.best(_tried(search, front, state.first_node, len(front.section.decision) - 1))[1:]


def all_tried(front: GuideFront, state: State, times_s: Iterable[float]) -> list[GuideRun]:
    """All different runs found near these times to the end; the search continues beyond a run that is near enough."""
    known: dict[Plan, GuideRun] = {}
    for time_s in times_s:
        search = _Search(front, state, time_s, NO_INSTRUCTION, front.section.end_m, near_s=0.0, known=known)
        _tried(search, front, state.first_node, len(front.section.decision) - 1)
    return list(known.values())


def _tried(search: _Search, front: GuideFront, first: int, last: int, prices: range | None = None) -> float:
    """Try prices of time, singly and in pairs; returns the higher of the two enclosing prices (W).

    The second price begins at a decision node between `first` and `last`. For an arrival (no `prices`), the search ends
    when the run that `best` takes is near; for a place, when any run is.
    """
    at_end, prices = prices is None, front.ladders[0] if prices is None else prices
    slow, quick = _enclosing(search, prices, first)
    price_w = float(front.lambda_w[min(quick, prices[-1])])
    fills = [(quick, PolicyFrom(0, slow)), (slow, PolicyFrom(0, quick, anew=True))] if slow in prices else []
    slower = (max(quick - rungs, prices[0]) for rungs in SLOWER)
    fills += [(quick, PolicyFrom(0, number, anew=True)) for number in slower]
    for number, then in fills if quick in prices else []:
        begin, end = first, last
        while end - begin > 1 and not (search.has_best_near(price_w) if at_end else search.is_near):
            middle = (begin + end) // 2
            late = search.late_s(PolicyFrom(first, number), then._replace(node=middle)) > 0
            begin, end = (middle, end) if late == (number == quick) else (begin, middle)
    return price_w


def _enclosing(search: _Search, prices: range, first: int) -> tuple[int, int]:
    """Indices of two neighbouring prices: late with the first, early with the second, unless a run is near enough.

    By bisection: a higher price does not always give a shorter time, so a search from a guess may find a higher price
    than necessary. For a train that can only be late, the highest price alone is tried.
    """
    slow, quick = prices.start - 1, prices.stop
    number = (prices.start + prices.stop) // 2 if search.spare_s > 0.0 else quick - 1
    while quick - slow > 1 and not search.is_near:
        slow, quick = (number, quick) if search.late_s(PolicyFrom(first, number)) > 0.0 else (slow, number)
        number = (slow + quick) // 2
    return slow, quick


def through(front: GuideFront, state: State, time_s: float, at_m: float, window: Window, told: int) -> GuideRun:
    """The run from a state that passes a place (m) in a window (s from now), and takes about `time_s` to the end.

    There is one price of time before the place and one after it. Raises InfeasibleError if the train stalls.
    """
    node_m = front.section.node_m[front.section.decision]
    node = int(np.searchsorted(node_m, at_m))
    run, _ = in_time(front, state, time_s, told)
    passes_s = run.passes_s(at_m)
    aim_s = min(max(passes_s, window.earliest_s), window.latest_s)
    if node >= len(node_m) - 1 or node <= state.first_node or aim_s == passes_s:
        return run
    found, number = [], -1
    for _ in range(ROUNDS):
        _, plan = _behind(front, run, node, time_s)
        if plan[0].number == number:
            break
        number = plan[0].number
        before = front.until(node, number)
        search = _Search(before, state, aim_s, told, at_m, NEAR_AT_PLACE_S)
        for prices in before.ladders:
            if not search.is_near:
                _tried(search, before, state.first_node, node, prices)
        off_s, run = search.nearest(not_early=aim_s > passes_s)
        found.append((off_s, run))
    run = min(reversed(found), key=lambda one: max(one[0], NEAR_S))[1]
    k, (rest, _) = run.node_at(node), _behind(front, run, node, time_s)
    speeds, said = np.append(run.speeds_mps[:k], rest.speeds_mps), np.append(run.said[:k], rest.said)
    took_s = float(run.elapsed_s[k]) + rest.time_s
    return GuideRun(state=state, speeds_mps=speeds, said=said, time_s=took_s, lambda_w=rest.lambda_w)


def _behind(front: GuideFront, run: GuideRun, node: int, time_s: float) -> tuple[GuideRun, Plan]:
    """The run that arrives in time from a decision node that another run passes, and its plan."""
    k = run.node_at(node)
    state = State.at(front.section, float(run.state.node_m[k]), float(run.speeds_mps[k]))
    return in_time(front, state, max(time_s - float(run.elapsed_s[k]), 1.0), int(run.said[k - 1]))
