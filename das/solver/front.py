"""Front of a section: the supported time–energy trade-off and the optimal continuation from any state.

For every multiplier λ of a ladder a backward sweep minimises energy + λ·time (design §5); the tables of values and
times-to-go are feedback policies. `Front.trajectory` answers for one trip time from any state.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError, InfeasibleError
from das.domain.route import NEUTRAL
from das.domain.trajectory import Ledger, Trajectory, mean_resistance_n
from das.domain.units import KMH
from das.solver import kernels, rollout_kernels
from das.solver import tolerances as tol
from das.solver.section import LineProfile, Section

Floats = NDArray[np.float64]

BLOCK_NODES = 32
"""Decision nodes whose transitions are kept at a time: a few MB, and the threads wait for each other rarely."""


class Fit(StrEnum):
    """How a trajectory relates to the time that was asked for."""

    ON_TIME = "on-time"
    LATE = "late"
    """The time is below the least possible: this is the fastest run."""
    EARLY = "early"
    """A slower run would cost more energy: this is the least energy."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """A trajectory with its ledger and certificate.

    `least_time_s` is the time of the fastest run from the same state.
    `lambda_w` is the price of time at the solution (W; inf for the fastest run). `bound_j` bounds the energy of any
    trajectory of this discretisation and time from below (the dual bound); `gap_ratio` = (input − bound)/|input|. It
    can be slightly negative, because the trajectory is integrated more finely than the table.
    """

    section: Section
    trajectory: Trajectory
    fit: Fit
    least_time_s: float
    requested_s: float
    lambda_w: float
    bound_j: float
    feasible: bool

    @cached_property
    def ledger(self) -> Ledger:
        """Where the energy goes, with the section's train and losses."""
        return self.trajectory.ledger(self.section.vehicle, self.section.loss)

    @property
    def time_s(self) -> float:
        return self.trajectory.time_s

    @property
    def gap_ratio(self) -> float:
        return (self.ledger.input - self.bound_j) / max(abs(self.ledger.input), 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _State(LineProfile):
    """What lies ahead of a state: the section from there on; `k0` is the last decision node before it."""

    k0: int
    floor_mps: Floats
    envelope_mps: Floats
    decision: NDArray[np.int64]
    speed_mps: float


@dataclass(frozen=True, kw_only=True)
class _Policy:
    """A multiplier between two neighbours of the ladder (see rollout_kernels)."""

    price_w: float
    index: int
    offset_w: float = 0.0
    gap_w: float = 0.0


class _Run(NamedTuple):
    """Speeds at the integration nodes ahead, and the trip time."""

    speeds_mps: Floats
    time_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Front:
    """Policies of a section for a ladder of multipliers.

    `lambda_w` (L,) ascending; `value_j` and `time_to_go_s` (K + 1 decision nodes, J + 1 speeds, L), float64 and float32
    as solved, float32 and packed as a table on disk holds them.
    """

    section: Section
    lambda_w: Floats
    value_j: Floats | NDArray[np.float32]
    time_to_go_s: NDArray[np.float32] | rollout_kernels.PackedTimes

    def fastest(self, s_m: float | None = None, v_mps: float | None = None) -> Solution:
        """The fastest run from a state (default: the start of the section)."""
        state = self._state(s_m, v_mps)
        run = self._fastest(state)
        return self._solution(state, run, run.time_s, run.time_s, Fit.ON_TIME)

    def trajectory(
        self,
        time_s: float,
        s_m: float | None = None,
        v_mps: float | None = None,
        *,
        tolerance_s: float = tol.TIME_TOLERANCE_S,
    ) -> Solution:
        """The least-energy run of duration `time_s` from a state (default: the start of the section).

        A time below the least possible gives the fastest run (`Fit.LATE`); one beyond the least-energy run gives
        that run (`Fit.EARLY`). Otherwise the time is hit to within `tolerance_s`.

        Raises DasError for a state outside the section or a time that is not positive, InfeasibleError where the
        section cannot be finished from the state.
        """
        if not time_s > 0 or math.isinf(time_s):
            raise DasError(f"trip time {time_s} s: expected a finite time > 0 s")
        state = self._state(s_m, v_mps)
        quickest = self._fastest(state)
        if time_s <= quickest.time_s + tolerance_s:
            fit = Fit.ON_TIME if time_s >= quickest.time_s - tolerance_s else Fit.LATE
            return self._solution(state, quickest, quickest.time_s, time_s, fit)
        return _TimeSearch(self, state, time_s, quickest, tolerance_s).run()

    def _state(self, s_m: float | None, v_mps: float | None) -> _State:
        section = self.section
        s_m = section.start_m if s_m is None else float(s_m)
        v_mps = section.start_speed_mps if v_mps is None else float(v_mps)
        check_state(section, s_m, v_mps)
        i = _following(section, s_m)
        k = int(np.searchsorted(section.decision, i))
        first = slice(i - 1, None)
        node = section.node_m[first].copy()
        node[0] = s_m
        step = section.step_m[first].copy()
        step[0] = node[1] - s_m
        envelope = section.envelope_mps[first].copy()
        envelope[0] = max(envelope[0], v_mps)
        return _State(
            k0=k - 1,
            node_m=node,
            step_m=step,
            grade_ratio=section.grade_ratio[first],
            constant_n=section.constant_n[first],
            tunnel_n_per_mps2=section.tunnel_n_per_mps2[first],
            limit_mps=section.limit_mps[first],
            supply=section.supply[first],
            floor_mps=section.floor_mps[first],
            envelope_mps=envelope,
            decision=np.concatenate(([0], section.decision[k:] - (i - 1))),
            speed_mps=v_mps,
        )

    def _roll(self, state: _State, policy: _Policy) -> _Run:
        """The run under a policy."""
        section = self.section
        speeds = np.empty(len(state.node_m))
        speeds[0] = state.speed_mps
        time_s = rollout_kernels.roll_out(
            state.k0, policy.price_w, policy.index, policy.offset_w, policy.gap_w, state.decision,
            *state.for_kernels, state.floor_mps, state.envelope_mps,
            self.value_j, self.time_to_go_s, section.train, section.loss_params, speeds,
        )  # fmt: skip
        return self._checked(state, speeds, time_s)

    def _fastest(self, state: _State) -> _Run:
        """The fastest run; from above the envelope it brakes first."""
        speeds = np.empty(len(state.node_m))
        speeds[0] = state.speed_mps
        time_s = rollout_kernels.fastest_roll_out(*state.for_kernels, state.envelope_mps, self.section.train, speeds)
        return self._checked(state, speeds, time_s)

    def _blend(self, state: _State, share: float, quick: _Run, slow: _Run) -> _Run:
        """The run between two runs (see rollout_kernels.blend_runs)."""
        speeds = np.empty(len(state.node_m))
        time_s = rollout_kernels.blend_runs(
            share, quick.speeds_mps, slow.speeds_mps, *state.for_kernels, state.envelope_mps, self.section.train, speeds
        )
        return self._checked(state, speeds, time_s)

    def _checked(self, state: _State, speeds: Floats, time_s: float) -> _Run:
        return _Run(speeds, _finished_s(self.section, time_s, state.node_m[0], state.speed_mps))

    def one_step_totals(self, state: _State) -> tuple[Floats, Floats]:
        """Least total cost (J) and time (s) from the state for every λ of the ladder."""
        section, n = self.section, int(state.decision[1])
        step = state.step_m[:n]
        length = float(step.sum())
        total, time_s = np.empty(len(self.lambda_w)), np.empty(len(self.lambda_w))
        rollout_kernels.one_step_totals(
            state.k0 + 1, state.speed_mps, length, float(state.constant_n[:n] @ step) / length,
            float(state.tunnel_n_per_mps2[:n] @ step) / length, float(state.floor_mps[n]), float(state.envelope_mps[n]),
            len(state.decision) == 2 and bool(state.floor_mps[n] >= state.envelope_mps[n]), self.lambda_w,
            self.value_j, self.time_to_go_s,
            kernels.on_supply(section.train, state.supply[0]), section.loss_params, total, time_s,
        )  # fmt: skip
        return total, time_s

    def _bound_j(self, state: _State, totals: tuple[Floats, Floats], time_s: float) -> float:
        """Dual bound: max over λ of (least total cost − λ·time); −inf where the table does not know the state.

        `totals` as `one_step_totals` gives them.
        """
        if state.speed_mps > self.section.envelope_mps[-len(state.node_m)] + tol.SPEED_TOLERANCE_MPS:
            return -math.inf
        total, _ = totals
        known = total < tol.UNREACHABLE
        return float((total[known] - self.lambda_w[known] * time_s).max(initial=-math.inf))

    def ladder_times_s(self) -> Floats:
        """Time of the whole section under every multiplier, as the policies know it (s)."""
        return self.one_step_totals(self._state(None, None))[1]

    def by_multiplier(self, s_m: float, v_mps: float) -> tuple[Floats, Floats]:
        """Times (s) of the runs from a state under every multiplier of the ladder, and their least costs (J)."""
        state = self._state(s_m, v_mps)
        total_j, _ = self.one_step_totals(state)
        policies = (_Policy(price_w=float(price), index=i) for i, price in enumerate(self.lambda_w))
        return np.array([self._roll(state, policy).time_s for policy in policies]), total_j

    def least_time_s(self, s_m: float, v_mps: float) -> float:
        """Time of the fastest run from a state; raises as `trajectory` does."""
        section = self.section
        check_state(section, s_m, v_mps)
        following = _following(section, s_m)
        time_s = rollout_kernels.least_time(
            following - 1, float(section.node_m[following]) - s_m, v_mps, *section.for_kernels, section.envelope_mps,
            section.train, *self._known_fastest,
        )  # fmt: skip
        return _finished_s(section, time_s, s_m, v_mps)

    @cached_property
    def _known_fastest(self) -> tuple[Floats, Floats]:
        """The section's fastest run: speed at every integration node, and time to go from there (s)."""
        run = self.fastest().trajectory
        return run.v_mps, run.time_s - run.t_s

    def _solution(
        self,
        state: _State,
        run: _Run,
        least_time_s: float,
        requested_s: float,
        fit: Fit,
        lambda_w: float = math.inf,
        bound_j: float | None = None,
    ) -> Solution:
        """The run with its ledger; without a price and a bound it is the fastest, the only one of its time."""
        speeds = run.speeds_mps
        section = self.section
        trajectory = trajectory_on(section, state, speeds)
        if bound_j is None:
            bound_j = float(trajectory.input_j(trajectory.loss_j(section.loss)).sum())
        ends_right = speeds[-1] >= section.floor_mps[-1] - tol.SPEED_TOLERANCE_MPS
        return Solution(
            section=section,
            trajectory=trajectory,
            fit=fit,
            least_time_s=least_time_s,
            requested_s=requested_s,
            lambda_w=lambda_w,
            bound_j=bound_j,
            feasible=bool(ends_right and (speeds <= section.envelope_mps[-len(speeds) :] + 1e-6).all()),
        )


def check_state(section: Section, s_m: float, v_mps: float) -> None:
    """Raise DasError for a position outside the section or a speed no train has."""
    if not section.start_m <= s_m < section.end_m - tol.MIN_STEP_M:
        raise DasError(f"position {s_m} m: expected one in the section {section.start_m:g} … {section.end_m:g} m")
    if not 0 <= v_mps < 200:
        raise DasError(f"speed {v_mps} m/s: expected one from 0 to 200 m/s")


def _following(section: Section, s_m: float) -> int:
    """The integration node after a position."""
    return int(section.node_m.searchsorted(s_m + tol.MIN_STEP_M, side="right"))


def _finished_s(section: Section, time_s: float, s_m: float, v_mps: float) -> float:
    """A kernel's trip time from a state; InfeasibleError where the train did not get to the end."""
    if not 0 <= time_s < math.inf:
        raise InfeasibleError(f"{section.route.source}: the train stalls after {s_m:.1f} m from {v_mps / KMH:.1f} km/h")
    return float(time_s)


class _Trial(NamedTuple):
    """A run tried: its place on the ladder (a λ between two of its steps; inf: the fastest run), and how late it is."""

    place: float
    run: _Run
    miss_s: float


class _TimeSearch:
    """Finds the run that takes a given time: a multiplier, or what lies between two of them where the front jumps.

    The table tells where on the ladder to look. Each run tried corrects it, and the next one is aimed a little beyond
    the wanted time, so that the two enclose it; from there by false position (Illinois).
    """

    MAX_ROLL_OUTS = 12
    OVERSHOOT_S = 0.15
    FIRST_STEP = 0.05
    """As long as all runs tried are on one side, the next is at least so far from the last one, then four times it."""
    BLEND_LOSS_RATIO = 2e-5
    """Two runs are blended when no multiplier between theirs could save more than this share of the train's kinetic
    energy at the highest speed ahead."""
    MAX_BLENDS = 40

    def __init__(self, front: Front, state: _State, time_s: float, quickest: _Run, tolerance_s: float) -> None:
        self.front, self.state, self.time_s, self.quickest = front, state, time_s, quickest
        self.tolerance_s = tolerance_s
        self.last = len(front.lambda_w) - 1
        self.steps = np.arange(self.last + 1)
        self.totals = front.one_step_totals(state)
        # Where the front is almost a jump the table's times need not fall.
        self.table_s = np.minimum.accumulate(self.totals[1])

    def run(self) -> Solution:
        slow, quick = self._enclose()
        for trial in (slow, quick):
            if trial is not None and abs(trial.miss_s) <= self.tolerance_s:
                return self._answer(trial.run, trial.place, Fit.ON_TIME)
        if slow is None:
            return self._answer(quick.run, quick.place, Fit.EARLY)
        run = self._blend(slow, quick)
        miss = run.time_s - self.time_s
        fit = Fit.ON_TIME if abs(miss) <= self.tolerance_s else Fit.LATE if miss > 0 else Fit.EARLY
        return self._answer(run, 0.5 * (slow.place + min(quick.place, self.last)), fit)

    def _answer(self, run: _Run, place: float, fit: Fit) -> Solution:
        bound_j = self.front._bound_j(self.state, self.totals, run.time_s)
        return self.front._solution(
            self.state, run, self.quickest.time_s, self.time_s, fit, self._price_w(place), bound_j
        )

    def _enclose(self) -> tuple[_Trial | None, _Trial]:
        """A slow and a quick run that can be blended; no slow one where even the smallest multiplier is early."""
        slow, quick = None, _Trial(math.inf, self.quickest, self.quickest.time_s - self.time_s)
        above, below, kept = 0.0, 0.0, 0
        place, step = self._place(self.time_s), self.FIRST_STEP
        for _ in range(self.MAX_ROLL_OUTS):
            trial = self._try(place)
            # The end kept twice in a row counts half, so that both ends move.
            if trial.miss_s > 0:
                slow, above, below, kept = trial, trial.miss_s, below * (0.5 if kept > 0 else 1.0), 1
            else:
                quick, below, above, kept = trial, trial.miss_s, above * (0.5 if kept < 0 else 1.0), -1
            if abs(trial.miss_s) <= self.tolerance_s or self._blendable(slow, quick):
                break
            if slow is None or math.isinf(quick.place):
                place, step = self._beyond(trial, step), 4 * step
            else:
                share = float(np.clip(above / (above - below), 0.02, 0.98))
                place = slow.place + share * (quick.place - slow.place)
        return slow, quick

    def _blendable(self, slow: _Trial | None, quick: _Trial) -> bool:
        """Whether next to nothing is to be gained between two runs, or no multiplier lies between them."""
        if slow is None:
            return quick.place <= 0
        if math.isinf(quick.place):
            return slow.place >= self.last
        # The front lies above its tangents at both runs, whose slopes are −λ.
        late, early = slow.miss_s, -quick.miss_s
        gain_j = (self._price_w(quick.place) - self._price_w(slow.place)) * late * early / (late + early)
        kinetic_j = 0.5 * self.front.section.train.inertial_mass_kg * float(self.state.envelope_mps.max()) ** 2
        return gain_j <= self.BLEND_LOSS_RATIO * kinetic_j

    def _place(self, time_s: float) -> float:
        """Where on the ladder the table puts a trip time."""
        return float(np.interp(-time_s, -self.table_s, self.steps))

    def _beyond(self, trial: _Trial, step: float) -> float:
        """Where a run should lie just on the other side of the wanted time, if the table errs there as at `trial`."""
        side = math.copysign(1.0, trial.miss_s)
        known_s = float(np.interp(trial.place, self.steps, self.table_s))
        aimed = self._place(known_s - trial.miss_s - side * self.OVERSHOOT_S)
        place = trial.place + side * max(side * (aimed - trial.place), step)
        return min(max(place, 0.0), float(self.last))

    def _price_w(self, place: float) -> float:
        return float(np.interp(place, self.steps, self.front.lambda_w))

    def _try(self, place: float) -> _Trial:
        run = self.front._roll(self.state, self._policy(place))
        return _Trial(place, run, run.time_s - self.time_s)

    def _policy(self, place: float) -> _Policy:
        ladder, index = self.front.lambda_w, int(place)
        gap = float(ladder[index + 1] - ladder[index]) if place > index else 0.0
        offset = (place - index) * gap
        return _Policy(price_w=float(ladder[index]) + offset, index=index, offset_w=offset, gap_w=gap)

    def _blend(self, slow: _Trial, quick: _Trial) -> _Run:
        """The run of the wanted time between two runs; its energy is near the chord between theirs."""
        low, high, above, below = 0.0, 1.0, slow.miss_s, quick.miss_s
        best, kept = slow.run, 0
        for _ in range(self.MAX_BLENDS):
            share = low + (high - low) * float(np.clip(above / (above - below), 0.02, 0.98))
            best = self.front._blend(self.state, share, quick.run, slow.run)
            miss = best.time_s - self.time_s
            if abs(miss) <= 0.1 * self.tolerance_s:
                break
            if miss > 0:
                low, above, below, kept = share, miss, below * (0.5 if kept > 0 else 1.0), 1
            else:
                high, below, above, kept = share, miss, above * (0.5 if kept < 0 else 1.0), -1
        return best


def solve_front(
    section: Section,
    *,
    threads: int = 2,
    lambda_w: Floats | None = None,
    end_value_j: Floats | None = None,
    block_nodes: int = BLOCK_NODES,
) -> Front:
    """Solve a section for a ladder of multipliers (default: `default_ladder`).

    `end_value_j` (J + 1,): what lies ahead of a section with a free end speed costs, by the speeds of its last node.
    From the end in blocks of decision nodes: first the transitions of a block, each thread some of its nodes, then the
    sweep through it, each thread some of the multipliers (the kernels release the GIL and share nothing they write).
    Only one block's transitions are kept: all of them together would be as large as the result, and fresh memory is
    slow. Threads and blocks change no bit of the result.
    """
    ladder = default_ladder(section) if lambda_w is None else np.asarray(lambda_w, dtype=float)
    grid = DecisionGrid.of(section)
    n, states, size = len(grid.node_m) - 1, grid.speed_steps + 1, len(ladder)
    value, time_to_go = np.empty((n + 1, states, size)), np.empty((n + 1, states, size), np.float32)
    value[-1] = 0.0 if end_value_j is None else end_value_j[:, np.newaxis]
    time_to_go[-1] = 0.0
    working_space = Transitions.empty(min(block_nodes, n), states)
    with ThreadPoolExecutor(threads) as pool:
        for end in range(n, 0, -block_nodes):
            start = max(end - block_nodes, 0)
            moves = working_space.rows(0, end - start)
            in_parts(pool, threads, end - start, grid.fill, start, moves)
            in_parts(pool, threads, size, moves.sweep, ladder, value[start : end + 1], time_to_go[start : end + 1])
    return Front(section=section, lambda_w=ladder, value_j=value, time_to_go_s=time_to_go)


def default_ladder(section: Section) -> Floats:
    """A few very small multipliers, then a geometric ladder to well above the power the train can use here (W)."""
    lowest = np.array(tol.LADDER_LOWEST_RATIOS)
    ladder = np.geomspace(tol.LADDER_LOW_RATIO, tol.LADDER_HIGH_RATIO, tol.LADDER_SIZE - len(lowest))
    usable_w = min(section.train.traction_power_w, section.train.traction_force_n * section.envelope_mps.max())
    return np.asarray(usable_w * np.concatenate((lowest, ladder)), dtype=float)


@dataclass(frozen=True, kw_only=True, eq=False)
class Transitions:
    """Moves from the speeds of some decision nodes to the next nodes'; none depends on λ (see kernels.transitions)."""

    time_s: NDArray[np.float32]
    energy_j: Floats
    target: NDArray[np.int16]
    weight: NDArray[np.float32]
    count: NDArray[np.int16]

    @classmethod
    def empty(cls, nodes: int, states: int) -> Self:
        """Room for the moves of so many nodes."""
        shape = (nodes, states, kernels.PADDED_LANDINGS)
        return cls(
            time_s=np.empty(shape, np.float32),
            energy_j=np.empty(shape),
            target=np.empty(shape, np.int16),
            weight=np.empty(shape, np.float32),
            count=np.empty(shape[:2], np.int16),
        )

    def rows(self, first: int, last: int) -> Transitions:
        """The part of the nodes first … last − 1 (a view)."""
        return Transitions(**{name: array[first:last] for name, array in vars(self).items()})

    def sweep(
        self, first: int, last: int, lambda_w: Floats, value_j: Floats, time_to_go_s: NDArray[np.float32]
    ) -> None:
        """Fill values and times-to-go of these nodes for multipliers first … last − 1 from those of the node after."""
        kernels.backward_sweep(
            first, last, lambda_w, self.time_s, self.energy_j, self.target, self.weight, self.count, value_j,
            time_to_go_s,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class DecisionGrid:
    """The line between the decision nodes of a section, as kernels.transitions takes it."""

    section: Section
    node_m: Floats
    constant_n: Floats
    tunnel_n_per_mps2: Floats
    supply: Floats
    floor_mps: Floats
    envelope_mps: Floats

    @classmethod
    def of(cls, section: Section) -> Self:
        """Means of the integration steps of each decision step."""
        node, starts = section.node_m[section.decision], section.decision[:-1]
        length = np.diff(node)
        return cls(
            section=section,
            node_m=node,
            constant_n=np.add.reduceat(section.constant_n * section.step_m, starts) / length,
            tunnel_n_per_mps2=np.add.reduceat(section.tunnel_n_per_mps2 * section.step_m, starts) / length,
            supply=section.supply[starts],
            floor_mps=np.ascontiguousarray(section.floor_mps[section.decision]),
            envelope_mps=np.ascontiguousarray(section.envelope_mps[section.decision]),
        )

    @property
    def speed_steps(self) -> int:
        """Steps of the speed grid."""
        return self.section.speed_steps

    def fill(self, first: int, last: int, start: int, moves: Transitions) -> None:
        """Fill rows first … last − 1 of `moves`, whose row 0 is decision node `start`."""
        rows = moves.rows(first, last)
        kernels.transitions(
            start + first, start + last, self.node_m, self.constant_n, self.tunnel_n_per_mps2, self.supply,
            self.floor_mps, self.envelope_mps, self.speed_steps, self.section.train, self.section.loss_params,
            rows.time_s, rows.energy_j, rows.target, rows.weight, rows.count,
        )  # fmt: skip


def in_parts(pool: ThreadPoolExecutor, threads: int, size: int, work: Callable[..., None], *args: object) -> None:
    """Call work(first, last, *args) for equal parts of range(size), on that many threads."""
    edges = [round(size * i / threads) for i in range(threads + 1)]
    for future in [pool.submit(work, first, last, *args) for first, last in pairwise(edges)]:
        future.result()


def trajectory_on(section: Section, line: LineProfile, speeds: Floats) -> Trajectory:
    """Times and forces of a run given by its speeds at the nodes of `line`, the section or a part of it."""
    train, vehicle = section.train, section.vehicle
    step = line.step_m
    interval = 2.0 * step / (speeds[:-1] + speeds[1:])
    running = mean_resistance_n(vehicle.resistance, speeds, line.tunnel_n_per_mps2)
    force = train.inertial_mass_kg * np.diff(speeds**2) / (2.0 * step) + running + line.constant_n
    faster = np.maximum(speeds[:-1], speeds[1:])
    if train.friction_force_n == 0 and not train.brakes_dissipate:
        electric = np.where(line.supply == NEUTRAL, 0.0, force)
        force = electric
    else:
        electric = vehicle.electric_effort_n(force, faster, section.level, line.supply)
    return Trajectory(
        s_m=line.node_m,
        t_s=np.concatenate(([0.0], np.cumsum(interval))),
        v_mps=speeds,
        force_el_n=electric,
        force_friction_n=force - electric,
        grade_ratio=line.grade_ratio,
        grade_and_curve_n=line.constant_n,
        tunnel_n_per_mps2=line.tunnel_n_per_mps2,
        limit_mps=line.limit_mps,
        supply=line.supply,
    )
