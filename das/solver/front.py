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
from typing import NamedTuple

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

    trajectory: Trajectory
    ledger: Ledger
    fit: Fit
    least_time_s: float
    requested_s: float
    lambda_w: float
    bound_j: float
    feasible: bool

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
class Transitions:
    """All moves of the speed grid between decision nodes; none depends on λ (see kernels.transitions)."""

    time_s: NDArray[np.float32]
    energy_j: Floats
    target: NDArray[np.int16]
    weight: NDArray[np.float32]
    count: NDArray[np.int16]


@dataclass(frozen=True, kw_only=True, eq=False)
class Front:
    """Policies of a section for a ladder of multipliers.

    `lambda_w` (L,) ascending; `value_j` and `time_to_go_s` (K + 1 decision nodes, J + 1 speeds, L).
    """

    section: Section
    lambda_w: Floats
    value_j: Floats
    time_to_go_s: NDArray[np.float32]

    def fastest(self, s_m: float | None = None, v_mps: float | None = None) -> Solution:
        """The fastest run from a state (default: the start of the section)."""
        state = self._state(s_m, v_mps)
        run = self._fastest(state)
        return self._solution(state, run, run.time_s, run.time_s, Fit.ON_TIME, math.inf)

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
            return self._solution(state, quickest, quickest.time_s, time_s, fit, math.inf)
        return _TimeSearch(self, state, time_s, quickest, tolerance_s).run()

    def _state(self, s_m: float | None, v_mps: float | None) -> _State:
        section = self.section
        s_m = section.start_m if s_m is None else float(s_m)
        v_mps = section.start_speed_mps if v_mps is None else float(v_mps)
        if not section.start_m <= s_m < section.end_m - tol.MIN_STEP_M:
            raise DasError(f"position {s_m} m: expected one in the section {section.start_m:g} … {section.end_m:g} m")
        if not 0 <= v_mps < 200:
            raise DasError(f"speed {v_mps} m/s: expected one from 0 to 200 m/s")
        i = int(np.searchsorted(section.node_m, s_m + tol.MIN_STEP_M, side="right"))
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
        if not 0 <= time_s < math.inf:
            raise InfeasibleError(
                f"{self.section.route.source}: the train stalls after {state.node_m[0]:.1f} m "
                f"from {state.speed_mps / KMH:.1f} km/h"
            )
        return _Run(speeds, float(time_s))

    def one_step_totals(self, state: _State) -> tuple[Floats, Floats]:
        """Least total cost (J) and time (s) from the state for every λ of the ladder."""
        section, n = self.section, int(state.decision[1])
        step = state.step_m[:n]
        length = float(step.sum())
        total, time_s = np.empty(len(self.lambda_w)), np.empty(len(self.lambda_w))
        rollout_kernels.one_step_totals(
            state.k0 + 1, state.speed_mps, length, float(state.constant_n[:n] @ step) / length,
            float(state.tunnel_n_per_mps2[:n] @ step) / length, float(state.floor_mps[n]), float(state.envelope_mps[n]),
            len(state.decision) == 2, self.lambda_w, self.value_j, self.time_to_go_s,
            kernels.on_supply(section.train, state.supply[0]), section.loss_params, total, time_s,
        )  # fmt: skip
        return total, time_s

    def _bound_j(self, state: _State, time_s: float) -> float:
        """Dual bound: max over λ of (least total cost − λ·time); −inf where the table does not know the state."""
        if state.speed_mps > self.section.envelope_mps[-len(state.node_m)] + tol.SPEED_TOLERANCE_MPS:
            return -math.inf
        total, _ = self.one_step_totals(state)
        known = total < tol.UNREACHABLE
        return float((total[known] - self.lambda_w[known] * time_s).max(initial=-math.inf))

    def least_time_s(self, s_m: float, v_mps: float) -> float:
        """Time of the fastest run from a state; raises as `trajectory` does."""
        state = self._state(s_m, v_mps)
        known, to_go = self._known_fastest
        speeds, ahead = np.empty(len(state.node_m)), len(known) - len(state.node_m)
        speeds[0] = v_mps
        time_s = rollout_kernels.least_time(
            *state.for_kernels, state.envelope_mps, self.section.train, speeds, known[ahead:], to_go[ahead:]
        )
        return self._checked(state, speeds, time_s).time_s

    @cached_property
    def _known_fastest(self) -> tuple[Floats, Floats]:
        """The section's fastest run: speed at every integration node, and time to go from there (s)."""
        run = self.fastest().trajectory
        return run.v_mps, run.time_s - run.t_s

    def _solution(
        self, state: _State, run: _Run, least_time_s: float, requested_s: float, fit: Fit, lambda_w: float
    ) -> Solution:
        speeds = run.speeds_mps
        trajectory = trajectory_on(self.section, state, speeds)
        section = self.section
        ledger = trajectory.ledger(section.vehicle, section.loss)
        ends_right = abs(speeds[-1] - section.end_speed_mps) <= tol.SPEED_TOLERANCE_MPS
        return Solution(
            trajectory=trajectory,
            ledger=ledger,
            fit=fit,
            least_time_s=least_time_s,
            requested_s=requested_s,
            lambda_w=lambda_w,
            bound_j=ledger.input if math.isinf(lambda_w) else self._bound_j(state, trajectory.time_s),
            feasible=bool(ends_right and (speeds <= section.envelope_mps[-len(speeds) :] + 1e-6).all()),
        )


class _TimeSearch:
    """Finds the run that takes a given time: a multiplier, or what lies between two of them where the front jumps."""

    MAX_ROLL_OUTS = 7
    BLENDABLE_S = 0.5
    """Two runs this near in time are blended: what another multiplier would gain is of second order."""
    MAX_BLENDS = 40

    def __init__(self, front: Front, state: _State, time_s: float, quickest: _Run, tolerance_s: float) -> None:
        self.front, self.state, self.time_s, self.quickest = front, state, time_s, quickest
        self.tolerance_s = tolerance_s

    def run(self) -> Solution:
        slow, quick, index = self._neighbours()
        price_w = float(self.front.lambda_w[index])
        if quick is None:
            on_time = abs(slow.time_s - self.time_s) <= self.tolerance_s
            return self._answer(slow, price_w, Fit.ON_TIME if on_time else Fit.EARLY)
        if quick is not self.quickest:
            slow, quick, price_w = self._narrow(slow, quick, index)
        run = self._blend(slow, quick)
        miss = run.time_s - self.time_s
        fit = Fit.ON_TIME if abs(miss) <= self.tolerance_s else Fit.LATE if miss > 0 else Fit.EARLY
        return self._answer(run, price_w, fit)

    def _answer(self, run: _Run, price_w: float, fit: Fit) -> Solution:
        return self.front._solution(self.state, run, self.quickest.time_s, self.time_s, fit, price_w)

    def _neighbours(self) -> tuple[_Run, _Run | None, int]:
        """Runs that enclose the time, at a multiplier and the next (or the fastest run), and the first one's index.

        The quick one is None where even the smallest multiplier is early.
        """
        front, last = self.front, len(self.front.lambda_w) - 1
        _, estimate_s = front.one_step_totals(self.state)
        index = int(np.clip(np.count_nonzero(estimate_s >= self.time_s) - 1, 0, last))
        slow, quick = front._roll(self.state, self._ladder(index)), None
        while slow.time_s < self.time_s:
            if index == 0:
                return slow, None, 0
            index, quick = index - 1, slow
            slow = front._roll(self.state, self._ladder(index))
        while quick is None and index < last:
            faster = front._roll(self.state, self._ladder(index + 1))
            if faster.time_s <= self.time_s:
                quick = faster
            else:
                index, slow = index + 1, faster
        return slow, quick or self.quickest, index

    def _ladder(self, index: int) -> _Policy:
        return _Policy(price_w=float(self.front.lambda_w[index]), index=index)

    def _narrow(self, slow: _Run, quick: _Run, index: int) -> tuple[_Run, _Run, float]:
        """Move both runs towards the time by multipliers between two neighbours (Illinois false position)."""
        base = float(self.front.lambda_w[index])
        gap = float(self.front.lambda_w[index + 1]) - base
        low, high = 0.0, gap
        above, below = slow.time_s - self.time_s, quick.time_s - self.time_s
        kept = 0
        for _ in range(self.MAX_ROLL_OUTS):
            near = min(abs(slow.time_s - self.time_s), abs(quick.time_s - self.time_s)) <= self.tolerance_s
            if near or slow.time_s - quick.time_s <= self.BLENDABLE_S:
                break
            offset = low + (high - low) * float(np.clip(above / (above - below), 0.02, 0.98))
            policy = _Policy(price_w=base + offset, index=index, offset_w=offset, gap_w=gap)
            run = self.front._roll(self.state, policy)
            miss = run.time_s - self.time_s
            # The end kept twice in a row counts half, so that both ends move.
            if miss > 0:
                slow, low, above, below = run, offset, miss, below * (0.5 if kept > 0 else 1.0)
                kept = 1
            else:
                quick, high, below, above = run, offset, miss, above * (0.5 if kept < 0 else 1.0)
                kept = -1
        return slow, quick, base + 0.5 * (low + high)

    def _blend(self, slow: _Run, quick: _Run) -> _Run:
        """The run of the wanted time between two runs; its energy is near the chord between theirs."""
        for run in (slow, quick):
            if abs(run.time_s - self.time_s) <= self.tolerance_s:
                return run
        low, high, above, below = 0.0, 1.0, slow.time_s - self.time_s, quick.time_s - self.time_s
        best, kept = slow, 0
        for _ in range(self.MAX_BLENDS):
            share = low + (high - low) * float(np.clip(above / (above - below), 0.02, 0.98))
            best = self.front._blend(self.state, share, quick, slow)
            miss = best.time_s - self.time_s
            if abs(miss) <= 0.1 * self.tolerance_s:
                break
            if miss > 0:
                low, above, below, kept = share, miss, below * (0.5 if kept > 0 else 1.0), 1
            else:
                high, below, above, kept = share, miss, above * (0.5 if kept < 0 else 1.0), -1
        return best


def solve_front(section: Section, *, threads: int = 2, lambda_w: Floats | None = None) -> Front:
    """Solve a section for a ladder of multipliers (default: `default_ladder`).

    The transitions are computed once, in blocks of nodes; the sweeps run in blocks of multipliers. Both on `threads`
    threads (the kernels release the GIL and share nothing they write).
    """
    ladder = default_ladder(section) if lambda_w is None else np.asarray(lambda_w, dtype=float)
    moves = transitions(section, threads=threads)
    return sweep(section, moves, ladder, threads=threads)


def default_ladder(section: Section) -> Floats:
    """A few very small multipliers, then a geometric ladder to well above the power the train can use here (W)."""
    lowest = np.array(tol.LADDER_LOWEST_RATIOS)
    ladder = np.geomspace(tol.LADDER_LOW_RATIO, tol.LADDER_HIGH_RATIO, tol.LADDER_SIZE - len(lowest))
    usable_w = min(section.train.traction_power_w, section.train.traction_force_n * section.envelope_mps.max())
    return np.asarray(usable_w * np.concatenate((lowest, ladder)), dtype=float)


def transitions(section: Section, *, threads: int = 2) -> Transitions:
    """All moves between the decision nodes of a section."""
    n, steps = len(section.decision) - 1, section.speed_steps
    states = steps + 1
    shape = (n, states, kernels.LANDINGS)
    result = Transitions(
        time_s=np.empty(shape, np.float32),
        energy_j=np.empty(shape),
        target=np.empty(shape, np.int16),
        weight=np.empty(shape, np.float32),
        count=np.empty(shape[:2], np.int16),
    )
    node = section.node_m[section.decision]
    starts = section.decision[:-1]
    length = np.diff(node)
    constant = np.add.reduceat(section.constant_n * section.step_m, starts) / length
    tunnel = np.add.reduceat(section.tunnel_n_per_mps2 * section.step_m, starts) / length
    supply = section.supply[starts]
    floor = np.ascontiguousarray(section.floor_mps[section.decision])
    envelope = np.ascontiguousarray(section.envelope_mps[section.decision])

    def block(first: int, last: int) -> None:
        kernels.transitions(
            first, last, node, constant, tunnel, supply, floor, envelope, steps, section.train, section.loss_params,
            result.time_s, result.energy_j, result.target, result.weight, result.count,
        )  # fmt: skip

    _in_blocks(block, n, threads)
    return result


def sweep(section: Section, moves: Transitions, lambda_w: Floats, *, threads: int = 2) -> Front:
    """Backward sweeps of all multipliers over given transitions."""
    n, states = moves.count.shape
    size = len(lambda_w)
    value = np.empty((n + 1, states, size))
    time_to_go = np.empty((n + 1, states, size), np.float32)
    value[-1], time_to_go[-1] = 0.0, 0.0

    def block(first: int, last: int) -> None:
        kernels.backward_sweep(
            first, last, lambda_w, moves.time_s, moves.energy_j, moves.target, moves.weight, moves.count,
            value, time_to_go,
        )  # fmt: skip

    _in_blocks(block, size, threads)
    return Front(section=section, lambda_w=lambda_w, value_j=value, time_to_go_s=time_to_go)


def _in_blocks(work: Callable[[int, int], None], size: int, threads: int) -> None:
    """Call work(first, last) for equal blocks of range(size), on that many threads."""
    edges = [round(size * i / threads) for i in range(threads + 1)]
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work, a, b) for a, b in pairwise(edges)]
        for future in futures:
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
