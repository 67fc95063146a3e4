"""The run of a section's policies that arrives at the wanted time: with one price of time, or two in succession."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

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


@dataclass(eq=False)
class _Search:
    """The search for runs from a state that take a time to a place (m), with the runs tried so far."""

    front: GuideFront
    state: State
    time_s: float
    told: int
    at_m: float
    near_s: float = NEAR_S
    known: dict[Plan, GuideRun] = field(default_factory=dict)
    """The runs of plans, which several searches from a state may share."""
    found: list[tuple[float, GuideRun, Plan]] = field(default_factory=list)

    def late_s(self, *plan: PolicyFrom) -> float:
        """The lateness (s; early < 0) of the run of a plan; infinity if only this plan makes the train stall."""
        if plan not in self.known:
            try:
                self.known[plan] = self.front.run(self.state, plan, self.told)
            except InfeasibleError:
                if not self.found:
                    raise
                return math.inf
        run = self.known[plan]
        self.found.append((run.passes_s(self.at_m) - self.time_s, run, plan))
        return self.found[-1][0]

    @property
    def is_near(self) -> bool:
        """Whether one of the runs is near enough."""
        return any(abs(late_s) < self.near_s for late_s, _, _ in self.found)

    def best(self, price_w: float) -> tuple[float, GuideRun, Plan]:
        """The run with the least energy plus cost of its lateness: the lateness (s; early < 0), the run, its plan."""
        return min(self.found, key=lambda one: one[1].energy_j + price_w * lateness_s(one[0]))

    def _ends(self, price_w: float) -> bool:
        """Whether the search ends: for an arrival when the best run is near, for a place when any run is."""
        return self.is_near and (self.at_m < self.front.section.end_m or abs(self.best(price_w)[0]) < self.near_s)

    def nearest(self, *, not_early: bool) -> tuple[float, GuideRun]:
        """The run nearest to the wanted time, and its deviation (s), which counts more on the unwanted side."""

        def off_s(late_s: float) -> float:
            unwanted = late_s < 0.0 if not_early else late_s > 0.0
            return abs(late_s) * (LATE_RATIO if unwanted else 1.0)

        late_s, run, _ = min(self.found, key=lambda one: off_s(one[0]))
        return off_s(late_s), run

    def try_prices(self, prices: range) -> float:
        """Try prices of time, singly and in pairs; returns the higher of the two enclosing prices (W).

        The second price begins at a decision node between the state and the place.
        """
        front, first = self.front, self.state.first_node
        last = int(np.searchsorted(front.section.node_m[front.section.decision], self.at_m))
        slow, quick = self._enclosing(prices)
        price_w = float(front.lambda_w[min(quick, prices[-1])])
        fills = [(quick, PolicyFrom(0, slow)), (slow, PolicyFrom(0, quick, anew=True))] if slow in prices else []
        slower = (max(quick - rungs, prices[0]) for rungs in SLOWER)
        fills += [(quick, PolicyFrom(0, number, anew=True)) for number in slower]
        for number, then in fills if quick in prices else []:
            begin, end = first, last
            while end - begin > 1 and not self._ends(price_w):
                middle = (begin + end) // 2
                late = self.late_s(PolicyFrom(first, number), then._replace(node=middle)) > 0
                begin, end = (middle, end) if late == (number == quick) else (begin, middle)
        return price_w

    def _enclosing(self, prices: range) -> tuple[int, int]:
        """Indices of two neighbouring prices: late with the first, early with the second, unless a run is near enough.

        By bisection: a higher price does not always give a shorter time, so a search from a guess may find a higher
        price than necessary. For a train that can only be late, the highest price alone is tried.
        """
        slow, quick, first = prices.start - 1, prices.stop, self.state.first_node
        fastest_s = self.state.elapsed_s(self.state.fastest().speeds_mps)
        least_s = float(np.interp(self.at_m, self.state.node_m, fastest_s))
        number = (prices.start + prices.stop) // 2 if self.time_s > least_s else quick - 1
        while quick - slow > 1 and not self.is_near:
            slow, quick = (number, quick) if self.late_s(PolicyFrom(first, number)) > 0.0 else (slow, number)
            number = (slow + quick) // 2
        return slow, quick

    def arrive(self) -> tuple[GuideRun, Plan]:
        """Try prices for an arrival; returns the best run and its plan."""
        return self.best(self.try_prices(self.front.ladders[0]))[1:]


def in_time(front: GuideFront, state: State, time_s: float, told: int = NO_INSTRUCTION) -> tuple[GuideRun, Plan]:
    """The run from a state that takes about `time_s` to the end, and the plan that it follows.

    `told` is the instruction in force, shown for some time already. If no run is quick enough, the result is the
    quickest run. Raises InfeasibleError if the train stalls.
    """
    return _Search(front, state, time_s, told, front.section.end_m).arrive()


def all_tried(front: GuideFront, state: State, times_s: Iterable[float]) -> list[GuideRun]:
    """All different runs found near these times to the end; the search continues beyond a run that is near enough."""
    known: dict[Plan, GuideRun] = {}
    for time_s in times_s:
        _Search(front, state, time_s, NO_INSTRUCTION, front.section.end_m, 0.0, known).arrive()
    return list(known.values())


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
                search.try_prices(prices)
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
