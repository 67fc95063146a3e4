"""Refinement of many runs of one section, such as those of a front or a table, of which neighbours help each other.

Between two refined runs lies the run of a time between theirs: blended in v² it needs hardly more energy than the best
run, unless the best runs change their kind somewhere between. The prices of time of the two tell which it is. A blend
that is near the tangents of the front at both only needs narrow tubes; any other run is refined from the table's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from das.solver.refinement import SETTINGS, Refinement, RefinementSettings, TubeRun, is_fastest, never, refined
from das.solver.solution import Fit, Solution

QUICK: Final = replace(SETTINGS, shrink=0.45, passes=8, most_rounds=1, blend_loss_ratio=1e-5)
"""A third of the passes of a single run: leaves 0.001 % in the mean, 0.05 % where best runs change their kind."""
NARROW: Final = replace(QUICK, widest_mps=0.3, knot_m=15.0, shrink=0.3, passes=3)
"""Three passes that begin where those of a single run have become narrow: enough for a blend of near neighbours."""


@dataclass(frozen=True, kw_only=True)
class ManySettings:
    """How the runs of a section are refined together."""

    alone: RefinementSettings = SETTINGS
    """For a run that begins from the table's; by default as a single run is refined."""
    between: RefinementSettings = NARROW
    """For a run that begins as the blend of its neighbours."""
    tangent_ratio: float = 3e-4
    """A blend that lies above the tangents at its neighbours by no more than this share of its energy is begun with."""


FRONT: Final = ManySettings()
"""For a few runs that are looked at one by one."""
TABLE: Final = ManySettings(alone=QUICK)
"""For the many runs of a table."""


def refined_runs(
    given: Sequence[Solution],
    settings: ManySettings = FRONT,
    *,
    is_over: Callable[[], bool] = never,
    watch: Callable[[int], None] = lambda _index: None,
) -> list[Solution]:
    """Solutions of one section from its start, each refined: never later and never with more energy than before.

    First the runs of the shortest and of the longest time are refined, then always the one in the middle of two that
    are finished; at last the run of least energy, whose time nobody asked for. `watch` is told the index of each run
    when it is finished. Once `is_over` says so, the runs that are left are returned as they were given.
    `das.solver.refinement.refined` says the rest.
    """
    found = list(given)
    timed = (i for i, one in enumerate(given) if one.fit is Fit.ON_TIME and not is_fastest(one))
    order = sorted(timed, key=lambda i: given[i].time_s)
    for place, before, behind in _in_order(len(order)):
        i = order[place]
        neighbours = (found[order[before]], found[order[behind]]) if before < place else None
        found[i] = _refined(given[i], neighbours, settings, is_over)
        watch(i)
    for i in sorted(set(range(len(given))) - set(order)):
        found[i] = refined(given[i], settings.alone, is_over=is_over)
        watch(i)
    return found


def _in_order(count: int) -> list[tuple[int, int, int]]:
    """Places in the order in which they are refined, each with the finished places before and behind it.

    The first and the last have no others to begin with but themselves.
    """
    ends = sorted({0, count - 1}) if count else []
    found, intervals = [(end, end, end) for end in ends], [(0, count - 1)]
    while intervals:
        before, behind = intervals.pop(0)
        middle = (before + behind) // 2
        if behind - before > 1:
            found.append((middle, before, behind))
            intervals += [(before, middle), (middle, behind)]
    return found


def _refined(
    one: Solution, neighbours: tuple[Solution, Solution] | None, settings: ManySettings, is_over: Callable[[], bool]
) -> Solution:
    if neighbours is not None:
        task = Refinement(one, settings.between)
        start = _blend(task, *neighbours, settings.tangent_ratio)
        if start is not None and not is_over():
            return task.settled(task.search.best(min(task.given, start, key=lambda run: run.energy_j), is_over))
    return refined(one, settings.alone, is_over=is_over)


def _blend(task: Refinement, quick: Solution, slow: Solution, tangent_ratio: float) -> TubeRun | None:
    """The blend of two neighbours that takes the wanted time; None where the front is no smooth curve between them."""
    if not quick.time_s < task.wanted_s < slow.time_s:
        return None
    start = task.search.between(_as_run(slow), _as_run(quick))
    if start is None:
        return None
    tangent_j = max(
        quick.ledger.input - quick.lambda_w * (start.time_s - quick.time_s),
        slow.ledger.input + slow.lambda_w * (slow.time_s - start.time_s),
    )
    return start if start.energy_j - tangent_j <= tangent_ratio * abs(start.energy_j) else None


def _as_run(one: Solution) -> TubeRun:
    return TubeRun(one.trajectory.v_mps, one.ledger.input, one.time_s, one.lambda_w)
