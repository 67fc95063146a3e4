"""Refinement: a trajectory of the table is improved in a narrow tube around it, with the same arrival.

The table has decision nodes at most 150 m apart, with about two hundred speeds at each. Its trajectories are near the
optimum of the section, but not optimal. `refined` places a few lines on each side of the trajectory, finds the best
trajectory between them by a dynamic program on the section's own integration grid (`das.offline.tube_kernels`), places
closer lines around that trajectory, and so on. Every pass chooses the price of time that keeps the arrival the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.offline.tube_kernels import Tube, TubeMoves, all_moves, tube_roll_out, tube_sweep
from das.solver import tolerances as tol
from das.solver.kernels.driving import run_energy
from das.solver.kernels.roll_out import blend_runs
from das.solver.solution import Fit, Solution
from das.solver.state import RollOut, State
from das.solver.warm_up import warm_up

LINES: Final = 3
"""Lines on each side of the trajectory. Seven in total give the same result as thirteen, in a third of the time."""
REFERENCE_SPEED_MPS: Final = 20.0
"""Speed (m/s) for which widths are given. Lines are even in v²: a constant shift in v² leaves the force unchanged."""
CLOSED_RATIO: Final = 2e-4
"""Least saving of a round, as a share of the energy, for another round to follow."""
MOST_TRIALS: Final = 8
"""Largest number of prices of time that are tried in a pass."""
EARLY_S: Final = 1e-3
"""Largest earliness (s) of the refined trajectory against the given one; the refined one is never later."""
MOST_BLENDS: Final = 20
"""Largest number of blends of two trajectories that are tried in a pass."""
TANGENT_RATIO: Final = 3e-4
"""Share of its energy by which a blend that begins a refinement may exceed the front's tangents at its neighbours."""

Floats = NDArray[np.float64]

LARGEST_SHARE = 0.8
"""Largest share by which the outermost lines lower v², so that no line is at standstill."""
FIRST_FACTOR = 1.03
"""Factor from the first to the second price of time that a pass tries, either way."""


@dataclass(frozen=True, kw_only=True)
class RefinementSettings:
    """The width of the tubes, how they shrink, and when the refinement ends."""

    widest_mps: float = 2.0
    """Distance of the outermost lines of the first pass from the trajectory, m/s at `REFERENCE_SPEED_MPS`."""
    shrink: float = 0.6
    """Factor by which each pass is narrower than the one before."""
    passes: int = 12
    """Passes of a round; the last one has lines 2 mm/s apart."""
    knot_m: float = 100.0
    """Distance (m) of the knots, where the train may change its line, in the first pass. Knots become closer in step
    with the lines, so that a change of line stays a gentle change of force. In the end every node is a knot."""
    most_rounds: int = 3
    """Most rounds of all passes; another follows while the last has saved more than `CLOSED_RATIO`."""
    blend_loss_ratio: float = 1e-6
    """Largest share of the energy that a price between those of two trajectories may save if they are to be blended."""


SETTINGS: Final = RefinementSettings()


class TubeRun(NamedTuple):
    """A trajectory with its price of time."""

    speeds_mps: Floats
    energy_j: float
    time_s: float
    price_w: float


def refined(solution: Solution, settings: RefinementSettings = SETTINGS) -> Solution:
    """The solution, improved in a tube around its trajectory; never later and never with more energy than before.

    A trajectory that is `Fit.EARLY` may take the requested time. The fastest trajectory is returned unchanged, because
    no other takes its time. If nothing is saved, the solution itself is returned.
    """
    if is_fastest(solution):
        return solution
    task = Refinement(solution, settings)
    return task.settled(task.search.best(task.given))


def is_fastest(solution: Solution) -> bool:
    """Whether a solution is the fastest trajectory, which leaves nothing to choose."""
    return solution.fit is Fit.LATE or math.isinf(solution.lambda_w)


class Refinement:
    """The refinement of one solution: its trajectory, the search around it, and the solution of a better trajectory."""

    def __init__(self, solution: Solution, settings: RefinementSettings = SETTINGS) -> None:
        run = solution.trajectory
        self.solution = solution
        self.wanted_s = solution.requested_s if solution.fit is Fit.EARLY else run.time_s
        state = State.at(solution.section, float(run.s_m[0]), float(run.v_mps[0]))
        self.search = TubeSearch(state, self.wanted_s, settings)
        self.given = self.search.known(run.v_mps, solution.lambda_w)

    def settled(self, best: TubeRun) -> Solution:
        """The solution of a trajectory that was found; the given solution if the trajectory is not better."""
        given = self.solution
        if best is self.given:
            return given
        found = self.search.state.solution(
            RollOut(best.speeds_mps, best.time_s),
            least_time_s=given.least_time_s,
            requested_s=given.requested_s,
            fit=given.fit,
            lambda_w=best.price_w,
        )
        in_time = found.time_s <= max(given.time_s, self.wanted_s)
        is_better = in_time and found.feasible and found.balance.input < given.balance.input
        return found if is_better else given


def warm_up_refinement() -> None:
    """Refine a trajectory of a tiny section to compile or load every kernel; about 10 s on a new machine."""
    front = warm_up()
    refined(front.trajectory(1.1 * front.fastest().time_s), replace(SETTINGS, passes=1, most_rounds=1))


class TubeSearch:
    """Improves a trajectory that starts from a state and is to take `wanted_s`, in ever narrower tubes."""

    def __init__(self, state: State, wanted_s: float, settings: RefinementSettings = SETTINGS) -> None:
        self.state, self.wanted_s, self.settings = state, wanted_s, settings
        self._on = (state.for_kernels, state.section.train, state.section.loss_params)

    def known(self, speeds_mps: Floats, price_w: float) -> TubeRun:
        """A trajectory by its speeds at the nodes of the state, with its energy and time."""
        energy_j = run_energy(*self._on, speeds_mps)
        return TubeRun(speeds_mps, energy_j, float(self.state.elapsed_s(speeds_mps)[-1]), price_w)

    def best(self, run: TubeRun) -> TubeRun:
        """The best trajectory found from a given one by rounds of passes with shrinking tubes, or the given one."""
        settings = self.settings
        for _ in range(settings.most_rounds):
            before_j = run.energy_j
            for number in range(settings.passes):
                run = self._one_pass(run, settings.shrink**number)
            if before_j - run.energy_j <= CLOSED_RATIO * abs(before_j):
                break
        return run

    def _one_pass(self, run: TubeRun, width: float) -> TubeRun:
        """The best trajectory in a tube around a given one, never late; `width` is relative to the first tube's."""
        tube = self.tube_around(run.speeds_mps, width)
        moves = all_moves(tube, *self._on)
        slow, quick = self._enclose(tube, moves, run.price_w)
        found = [one for one in (quick, self.between(slow, quick)) if one is not None]
        return min([run, *found], key=lambda one: one.energy_j)

    def tube_around(self, speeds_mps: Floats, width: float) -> Tube:
        """The lines of a pass around a trajectory; `width` is relative to the first tube's."""
        settings, state = self.settings, self.state
        squared = speeds_mps**2
        knot = _knots(state.node_m, settings.knot_m * width)
        spacing = 2.0 * REFERENCE_SPEED_MPS * settings.widest_mps * width / LINES
        slowest = np.maximum(state.floor_mps, tol.CREST_MPS) ** 2
        return Tube(
            squared=squared,
            low=np.minimum(slowest, squared),
            high=np.maximum(state.envelope_mps**2, squared),
            share=_shares(state.node_m, knot),
            knot=knot,
            spacing=np.minimum(spacing, LARGEST_SHARE * squared[knot] / LINES),
            lines=LINES,
        )

    def _enclose(self, tube: Tube, moves: TubeMoves, price_w: float) -> tuple[TubeRun | None, TubeRun | None]:
        """A trajectory that is late and one that is in time, at neighbouring prices of time; None for one not found."""
        value = np.full((len(tube.knot), 2 * tube.lines + 1), tol.INFEASIBLE)
        value[-1, tube.lines] = 0.0
        slow = quick = None
        factor = FIRST_FACTOR
        for _ in range(MOST_TRIALS):
            speeds = np.empty(len(tube.squared))
            tube_sweep(price_w, moves, value)
            energy_j, time_s = tube_roll_out(price_w, tube, *self._on, value, speeds)
            if time_s <= 0:  # it does not reach the end
                break
            trial = TubeRun(speeds, energy_j, time_s, price_w)
            if trial.time_s > self.wanted_s:
                slow = trial
            else:
                quick = trial
            if slow is not None and quick is not None:
                if self._is_enclosed(slow, quick):
                    break
                share = (slow.time_s - self.wanted_s) / (slow.time_s - quick.time_s)
                price_w = slow.price_w + min(max(share, 0.1), 0.9) * (quick.price_w - slow.price_w)
                continue
            if quick is not None and price_w <= 0.0:
                break
            lower_w = 0.0 if factor > 10.0 else price_w / factor
            price_w = price_w * factor if quick is None else lower_w
            factor = factor**2
        return slow, quick

    def _is_enclosed(self, slow: TubeRun, quick: TubeRun) -> bool:
        """Whether one of two trajectories is within `EARLY_S` of the wanted time, or any gain between is negligible."""
        late, early = slow.time_s - self.wanted_s, self.wanted_s - quick.time_s
        if min(late, early) <= EARLY_S:
            return True
        gain_j = (quick.price_w - slow.price_w) * late * early / (late + early)
        return gain_j <= self.settings.blend_loss_ratio * abs(quick.energy_j)

    def between(self, slow: TubeRun | None, quick: TubeRun | None) -> TubeRun | None:
        """The blend of two trajectories that takes the wanted time; None if one is missing or no blend is possible."""
        if slow is None or quick is None:
            return None
        low, high, above, below = 0.0, 1.0, slow.time_s - self.wanted_s, quick.time_s - self.wanted_s
        found, kept = None, 0
        for _ in range(MOST_BLENDS):
            share = low + (high - low) * min(max(above / (above - below), 0.02), 0.98)
            trial = self._blended(share, slow, quick)
            if trial is None:
                return None
            miss = trial.time_s - self.wanted_s
            if miss <= 0:
                found = trial
                if miss >= -EARLY_S:
                    break
                high, below, above, kept = share, miss, above * (0.5 if kept < 0 else 1.0), -1
            else:
                low, above, below, kept = share, miss, below * (0.5 if kept > 0 else 1.0), 1
        return found

    def _blended(self, share: float, slow: TubeRun, quick: TubeRun) -> TubeRun | None:
        speeds, state = np.empty(len(slow.speeds_mps)), self.state
        time_s = blend_runs(
            share, quick.speeds_mps, slow.speeds_mps, state.for_kernels, state.envelope_mps, state.section.train, speeds
        )
        if time_s < 0 or abs(speeds[-1] - quick.speeds_mps[-1]) > tol.SPEED_TOLERANCE_MPS:
            return None
        return self.known(speeds, slow.price_w + share * (quick.price_w - slow.price_w))


def _knots(node_m: Floats, apart_m: float) -> NDArray[np.int64]:
    """Integration nodes about `apart_m` apart, the first and the last among them."""
    _, first = np.unique(np.floor((node_m - node_m[0]) / apart_m), return_index=True)
    return np.unique(np.append(first, len(node_m) - 1)).astype(np.int64)


def _shares(node_m: Floats, knot: NDArray[np.int64]) -> Floats:
    """The distance of each node from the knot before, as a share of the distance between its knots; 1 at a knot."""
    behind = np.searchsorted(knot, np.arange(len(node_m)))
    before_m, behind_m = node_m[knot[np.maximum(behind - 1, 0)]], node_m[knot[behind]]
    return np.where(behind_m > before_m, (node_m - before_m) / np.maximum(behind_m - before_m, 1e-9), 1.0)


QUICK: Final = replace(SETTINGS, shrink=0.45, passes=8, most_rounds=1, blend_loss_ratio=1e-5)
"""A third of the passes of a single trajectory: 0.001 % of the energy remains unsaved on average, and 0.05 % where the
sequence of modes in the best trajectories changes."""
NARROW: Final = replace(QUICK, widest_mps=0.3, knot_m=15.0, shrink=0.3, passes=3)
"""Three passes, the first as narrow as the later passes of `SETTINGS`: enough for a blend of near neighbours."""


def refined_runs(
    given: Sequence[Solution],
    alone: RefinementSettings = SETTINGS,
    *,
    watch: Callable[[int], None] = lambda _index: None,
) -> list[Solution]:
    """Solutions of one section from its start, each refined: never later and never with more energy than before.

    First the trajectories of the shortest and of the longest time are refined, then always the middle one between two
    finished ones; last those whose time was not requested: the one of least energy, and the fastest, which remains
    unchanged. `watch` is called with the index of each one that is finished.
    """
    found = list(given)
    timed = (i for i, one in enumerate(given) if one.fit is Fit.ON_TIME and not is_fastest(one))
    order = sorted(timed, key=lambda i: given[i].time_s)
    for i, neighbours in _in_order(order):
        found[i] = _refined(given[i], [found[j] for j in neighbours], alone)
        watch(i)
    for i in sorted(set(range(len(given))) - set(order)):
        found[i] = refined(given[i], alone)
        watch(i)
    return found


def _in_order(indices: list[int]) -> Iterator[tuple[int, list[int]]]:
    """Indices in the order of refinement, each with the finished one on either side (none for first and last)."""
    for end in dict.fromkeys(indices[:1] + indices[-1:]):
        yield end, []
    intervals = [indices]
    while intervals:
        between = intervals.pop(0)
        if len(between) > 2:
            middle = (len(between) - 1) // 2
            yield between[middle], [between[0], between[-1]]
            intervals += [between[: middle + 1], between[middle:]]


def _refined(one: Solution, neighbours: Sequence[Solution], alone: RefinementSettings) -> Solution:
    if neighbours:
        task = Refinement(one, NARROW)
        start = _blend(task, *neighbours)
        if start is not None:
            return task.settled(task.search.best(min(task.given, start, key=lambda run: run.energy_j)))
    return refined(one, alone)


def _blend(task: Refinement, quick: Solution, slow: Solution) -> TubeRun | None:
    """The blend of two neighbours that takes the wanted time; None if the front is no smooth curve between them."""
    if not quick.time_s < task.wanted_s < slow.time_s:
        return None
    later, sooner = (
        TubeRun(one.trajectory.v_mps, one.balance.input, one.time_s, one.lambda_w) for one in (slow, quick)
    )
    start = task.search.between(later, sooner)
    if start is None:
        return None
    tangent_j = max(
        quick.balance.input - quick.lambda_w * (start.time_s - quick.time_s),
        slow.balance.input + slow.lambda_w * (slow.time_s - start.time_s),
    )
    return start if start.energy_j - tangent_j <= TANGENT_RATIO * abs(start.energy_j) else None
