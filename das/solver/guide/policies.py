"""Policies over instructions on a section, for a ladder of prices of time, and the runs that follow them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from threading import Lock
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.units import KMH
from das.solver.guide.references import References
from das.solver.kernels.driving import run_energy, trip_time
from das.solver.kernels.guide_policy import (
    CODE,
    COLUMNS,
    LANDED,
    MANNERS,
    NO_INSTRUCTION,
    WORD,
    GuideGrid,
    GuideMoves,
    GuidePolicy,
    GuidePrices,
    guide_moves,
    guide_sweep,
)
from das.solver.kernels.guide_run import STALLED, FineCurve, guide_roll_out
from das.solver.kernels.schedule import BACK_SHARE  # noqa: F401 - it counts in the keys of tables
from das.solver.section import Section
from das.solver.solve import DecisionGrid, in_parts, node_behind, usable_power_w
from das.solver.state import State

STEP_MPS: Final = 5.0 * KMH
"""The step (m/s) of advised speeds; limits are advised exactly."""
LEAST_MPS: Final = 10.0 * KMH
"""The lowest advised speed (m/s), unless a limit is lower."""
CHANGE_TIME_S: Final = 0.3
"""The time (s) whose cost, at the price of time, a change must save too: a hurrying train changes less often."""
LOW_RATIO: Final = 0.001
"""The lowest price of time, as a share of the traction power that can be used on the section."""
HIGH_RATIO: Final = 2.0
"""The highest price of time, as a multiple of the same power, however late the train is. A weak train on a slow line
needs almost as much to keep a timetable with a buffer of 8 %."""
DEAREST_RATIO: Final = 0.25
"""The price of a second of a reserve, as a share of the energy of the train's full power in a second: twice the price
of a second with a buffer of 8 %."""

Floats = NDArray[np.float64]
SAME_MPS = 1e-6
"""Speeds of a section that differ by less come from rounding."""
MOST_SPEEDS = NO_INSTRUCTION // CODE
"""Largest number of speeds that fit in the number of an instruction."""
WAITING = 40
"""Number of negative prices of time, without a lowest speed, for a train that waits for its window at a point."""


@dataclass(frozen=True, kw_only=True)
class PolicySettings:
    """The costs of changes of the instruction, and the resolution of the policies."""

    change_s: float = 0.08
    """The time (s) of the train's full power whose energy a change must save, besides the cost of `CHANGE_TIME_S`."""
    young_s: float = 0.6
    """The value of `change_s` for a change before the present instruction has been shown for `STANDS_S`."""
    line_mps: float = 1.0 * KMH
    """The spacing of the speed grid (m/s): a fifth of a step, so that every advised speed is on a line. With 2.5 km/h,
    a freight train, which gains less than that in a decision step, needs up to a fifth more energy."""
    ladder_ratio: float = 1.03
    """The ratio of each price of time to the one before."""
    kept_bytes: int = 100_000_000
    """The size (bytes) up to which the policies used last are kept: ten to twenty for 30 km, four for 100 km."""


DEFAULT = PolicySettings()


class PolicyFrom(NamedTuple):
    """A price whose policy is followed from a decision node on; `anew`: it begins with a new instruction."""

    node: int
    number: int
    anew: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class GuideRun:
    """A run from a state that follows policies: speeds at the nodes ahead, and the instruction of every interval."""

    state: State
    speeds_mps: Floats
    said: NDArray[np.int64]
    """The instructions as numbers of the kernels: x · `CODE` + manner."""
    time_s: float
    lambda_w: float
    """The price of time (W) of the first policy."""

    @cached_property
    def elapsed_s(self) -> Floats:
        """The times at the nodes (s)."""
        return self.state.elapsed_s(self.speeds_mps)

    def passes_s(self, at_m: float) -> float:
        """The time (s) at which the train passes a place."""
        return float(np.interp(at_m, self.state.node_m, self.elapsed_s))

    def node_at(self, node: int) -> int:
        """The place of a decision node of the section among the nodes of the run."""
        return int(self.state.decision[node - self.state.first_node])

    @cached_property
    def energy_j(self) -> float:
        """The energy at the current collector (J)."""
        section = self.state.section
        return float(run_energy(self.state.for_kernels, section.train, section.loss_params, self.speeds_mps))


class _Behind(NamedTuple):
    """The behaviour of a train from a decision node on: the last rows of its policy, and the costs at the node."""

    policy: GuidePolicy
    costs_j: Floats


class GuideFront:
    """The policies of a section for a ladder of prices of time (W, ascending), each solved when it is first needed.

    The front begins at the start of the section, or a little behind the position `s_m` (m). `references` are finished
    schedules of the section; None: there are none. `curve` is the braking curve by integration node; `power_w` is the
    traction power usable on the section (W), the unit of prices. Thread-safe.
    """

    def __init__(
        self,
        section: Section,
        settings: PolicySettings = DEFAULT,
        s_m: float | None = None,
        *,
        threads: int = 2,
        references: References | None = None,
    ) -> None:
        self.section, self.settings, self.references = section, settings, references
        self._first = node_behind(section, section.start_m if s_m is None else s_m)
        self._threads, self._lock = threads, Lock()
        self.speeds_mps = told_speeds(section)
        goal_mps, foot_m = falls_to(section.envelope_mps, section.node_m)
        self.curve = FineCurve(goal_mps, self._nearest(goal_mps), foot_m)
        grid, decision = DecisionGrid.of(section), section.decision
        # If the envelope begins to fall within a step, the whole step belongs to the braking curve.
        goal_mps, _ = falls_to(grid.bounds.envelope_mps, grid.node_m)
        self._grid = GuideGrid(
            grid.line, grid.bounds.envelope_mps, np.minimum.reduceat(section.limit_mps, decision[:-1]),
            goal_mps, self._nearest(goal_mps), *crests(section), self.speeds_mps, settings.line_mps,
        )  # fmt: skip
        self.power_w = usable_power_w(section)
        size = 1 + math.ceil(math.log(HIGH_RATIO / LOW_RATIO) / math.log(settings.ladder_ratio))
        self.lambda_w = self.power_w * HIGH_RATIO * settings.ladder_ratio ** np.arange(1.0 - size, 1.0)
        self._least_mps = np.zeros(size)
        # Moves and policies begin at a decision node and end with the section: the fewer rows, the further ahead.
        self._moves: GuideMoves | None = None
        self._kept: dict[int, GuidePolicy] = {}  # by number of the price, in the order of their use
        self._behind: _Behind | None = None

    @property
    def ladders(self) -> tuple[range, range]:
        """The numbers of the prices of time, and of those that go with a lowest speed; each from slow to quick."""
        size = len(self.lambda_w) - np.count_nonzero(self._least_mps)
        return range(size), range(size, len(self.lambda_w))

    @property
    def dearest(self) -> int:
        """The number of the highest price of time up to which a reserve is kept."""
        return int(np.searchsorted(self.lambda_w, DEAREST_RATIO * self.power_w, side="right")) - 1

    @property
    def nbytes(self) -> int:
        """The size of the moves and of the policies that are kept (bytes)."""
        return sum(map(_size, [self._moves or (), *self._kept.values()]))

    def cover(self, s_m: float) -> None:
        """Solve policies, from now on, for a train at a position (m) and for all places ahead of it."""
        with self._lock:
            first = node_behind(self.section, s_m)
            if first < self._first:
                self._first, self._moves, self._kept = first, None, {}

    def prices(self, number: int) -> GuidePrices:
        """The prices that go with a price of time."""
        lambda_w, settings = float(self.lambda_w[number]), self.settings
        change_j = self.change_j(lambda_w)
        young_j = change_j + max(settings.young_s - settings.change_s, 0.0) * self.power_w
        return GuidePrices(lambda_w, change_j, young_j, float(self._least_mps[number]))

    def change_j(self, lambda_w: float) -> float:
        """The price of a change of the instruction (J) at a price of time (W)."""
        return self.settings.change_s * self.power_w + CHANGE_TIME_S * max(lambda_w, 0.0)

    def run(self, state: State, plan: Sequence[PolicyFrom], told: int = NO_INSTRUCTION) -> GuideRun:
        """The run from a state that follows the policies of a plan, in the order of its nodes.

        `told` is the instruction in force, shown for long enough. Raises InfeasibleError if the train stalls.
        """
        section = self.section
        if state.first_node < self._first:
            self.cover(float(state.node_m[0]))
        solved = self._policies([one.number for one in plan], state.first_node)
        first = len(section.node_m) - len(state.node_m)
        goal_mps, goal_x, foot_m = self.curve
        curve = FineCurve(goal_mps[first:], goal_x[first:], foot_m[first:] - state.node_m)
        speeds, said = np.empty(len(state.node_m)), np.empty(len(state.step_m), np.int64)
        speeds[0], now = state.speed_mps, (told, math.inf)
        nodes = [0, *(max(one.node - state.first_node, 0) for one in plan[1:]), len(state.decision) - 1]
        for one, policy, begin, end in zip(plan, solved, nodes[:-1], nodes[1:], strict=True):
            row_0 = len(self._grid.limit_mps) - len(policy.choice)
            anew = one.anew and one.node > state.first_node  # A train beyond that node already has its instruction.
            now = guide_roll_out(
                (begin, end), state.first_node, state.decision, state.for_kernels, state.envelope_mps, curve,
                self._grid, section.train, row_0, policy, now, anew, speeds, said,
            )  # fmt: skip
            if now[0] == STALLED:
                break
        time_s = -1.0 if now[0] == STALLED else trip_time(state.step_m, speeds)
        section.finished_s(time_s, float(state.node_m[0]), state.speed_mps)
        price_w = float(self.lambda_w[plan[0].number])
        return GuideRun(state=state, speeds_mps=speeds, said=said, time_s=float(time_s), lambda_w=price_w)

    def _nearest(self, goal_mps: Floats) -> NDArray[np.int64]:
        """The number X of each of these speeds; -1 for standstill."""
        nearest = np.abs(goal_mps[:, np.newaxis] - self.speeds_mps).argmin(axis=1)
        return np.where(goal_mps > SAME_MPS, nearest, -1)

    def _moves_from(self, node: int) -> GuideMoves:
        """The moves from a decision node to the end; those of the whole front are computed when first needed."""
        if self._moves is None:
            self._moves = self._all_moves(self._first)
        return GuideMoves._make(rows[node - len(self._grid.limit_mps) :] for rows in self._moves)

    def _all_moves(self, first: int) -> GuideMoves:
        """The moves from a decision node to the end, computed."""
        last = len(self._grid.limit_mps)
        lines = int(np.ceil(self._grid.envelope_mps[first:].max() / self.settings.line_mps - SAME_MPS)) + 1
        shape = (last - first, lines, COLUMNS)
        moves = GuideMoves(
            np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.int16),
            np.empty(shape, np.float32),
        )  # fmt: skip

        def fill(begin: int, end: int) -> None:
            section = self.section
            guide_moves(first + begin, first + end, self._grid, section.train, section.loss_params, begin, moves)

        with ThreadPoolExecutor(self._threads) as pool:
            in_parts(pool, self._threads, last - first, fill)
        return moves

    def _policies(self, numbers: Sequence[int], node: int) -> list[GuidePolicy]:
        """The policies of these prices from a decision node on, or from one before it.

        Policies that are not kept are solved, several at a time in threads: from the train's place on, which takes far
        less time near the end of a section.
        """
        with self._lock:
            moves, kept = self._moves_from(node), self._kept
            known = {one: kept.pop(one, None) for one in dict.fromkeys(numbers)}
            rows = len(moves.target)
            found = {one: policy for one, policy in known.items() if policy is not None and len(policy.choice) >= rows}
            missing = [one for one in known if one not in found]
            if len(missing) > 1:
                with ThreadPoolExecutor(self._threads) as pool:
                    found.update(zip(missing, pool.map(lambda one: self._solved(one, moves), missing), strict=True))
            elif missing:  # In this thread, because Ctrl-C would wait for another one to compile.
                found[missing[0]] = self._solved(missing[0], moves)
            kept.update(found)
            while len(kept) > len(found) and sum(map(_size, kept.values())) > self.settings.kept_bytes:
                del kept[next(iter(kept))]
            return [found[one] for one in numbers]

    def until(self, node: int, number: int) -> GuideFront:
        """The policies up to a decision node, for a ladder of prices, of a train that follows one price behind it.

        The policies use the value of a speed at the node, so they need no rule for accelerating again. Prices may be
        negative here, because a train that must not be too early at the node gains by being slow. Between two of them
        the time may jump by a minute: from a fast train that coasts to one that brakes and then crawls. The last prices
        therefore each have a lowest speed, to which such a train brakes.
        """
        (policy,) = self._policies([number], node)
        moves = self._moves_from(node)
        behind = GuidePolicy._make(kept[-len(moves.target) :].copy() for kept in policy)
        costs_j = self._swept(len(self._grid.limit_mps), self._free(moves), moves, number, behind)
        found = copy(self)
        waiting, braking = np.geomspace(1.0, LOW_RATIO, WAITING), np.ones_like(self.speeds_mps)
        found.lambda_w = np.concatenate((-self.power_w * waiting, self.lambda_w, -self.power_w * braking))
        found._least_mps = np.concatenate((np.zeros(WAITING), self._least_mps, self.speeds_mps))
        found._behind = _Behind(behind, costs_j)
        found._kept, found._lock = {}, Lock()
        return found

    def _solved(self, number: int, moves: GuideMoves) -> GuidePolicy:
        """The policy of a price for the nodes of these moves."""
        nodes, lines, _ = moves.target.shape
        words = -(-len(self.speeds_mps) // WORD)
        policy = GuidePolicy(
            np.empty((nodes, lines), np.uint16), np.empty((nodes, lines, MANNERS, 2, words), np.uint32)
        )
        last, costs_j = len(self._grid.limit_mps), self._free(moves)
        if self._behind is not None:
            behind, costs_j = self._behind
            rows = len(behind.choice)
            last -= rows
            policy.choice[-rows:], policy.stay[-rows:] = behind
        self._swept(last, costs_j, moves, number, policy)
        return policy

    def _free(self, moves: GuideMoves) -> Floats:
        """The costs at the end of the section: none."""
        return np.zeros((moves.target.shape[1] + 1, LANDED + 1, 2, len(self.speeds_mps)))

    def _swept(self, last: int, costs_j: Floats, moves: GuideMoves, number: int, policy: GuidePolicy) -> Floats:
        """Fill a policy up to decision node `last`, from the costs there; returns the costs at the policy's first node.

        The moves begin at the same node as the policy.
        """
        first, grid, prices = len(self._grid.limit_mps) - len(policy.choice), self._grid, self.prices(number)
        train, losses = self.section.train, self.section.loss_params
        return np.asarray(guide_sweep(first, last, costs_j.copy(), grid, train, losses, moves, prices, policy))


def _size(arrays: Iterable[np.ndarray]) -> int:
    return sum(one.nbytes for one in arrays)


def falls_to(envelope_mps: Floats, node_m: Floats) -> tuple[Floats, Floats]:
    """The speed to which the envelope falls strictly from each node on, and the place where it has fallen (m)."""
    goal, foot_m = envelope_mps.copy(), node_m.copy()
    for i in range(len(goal) - 2, -1, -1):
        if envelope_mps[i + 1] < envelope_mps[i] - SAME_MPS:
            goal[i], foot_m[i] = goal[i + 1], foot_m[i + 1]
    return goal, foot_m


def crests(section: Section) -> tuple[Floats, Floats]:
    """The speed from which the envelope falls up to the end of each decision step, and the length (m) of that fall."""
    envelope, node_m, starts, ends = section.envelope_mps, section.node_m, section.decision[:-1], section.decision[1:]
    level = np.flatnonzero(np.append(True, envelope[1:] >= envelope[:-1] - SAME_MPS))
    begins = np.maximum(level[np.searchsorted(level, ends, side="right") - 1], starts)
    return envelope[begins], node_m[ends] - node_m[begins]


def told_speeds(section: Section) -> Floats:
    """The speeds that may be advised on a section, ascending: its limits, and steps from the lowest to the highest.

    If there are more than fit in the number of an instruction, only every second one (third, …) is kept.
    """
    envelope, step = section.envelope_mps, STEP_MPS
    exact = np.unique(np.concatenate((section.limit_mps, falls_to(envelope, section.node_m)[0])))
    exact = exact[(exact > SAME_MPS) & (exact <= envelope.max() + SAME_MPS)]
    steps = step * np.arange(math.ceil(LEAST_MPS / step), math.floor(envelope.max() / step) + 1)
    near = (np.abs(steps[:, np.newaxis] - exact) <= SAME_MPS).any(axis=1)
    found = np.sort(np.concatenate((exact, steps[~near])))
    if not found.size:  # a section so short that the train does not even reach `LEAST_MPS`
        return np.array([envelope.max()])
    found = found[np.append(True, np.diff(found) > SAME_MPS)]
    return np.asarray(found[:: -(-len(found) // MOST_SPEEDS)])
