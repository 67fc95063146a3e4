"""Few-switch trajectories: those of least cost if every change of the notch has a price.

A notch is one of the few things that a driver does with the controller, one at a time. The backward sweep of
`das.solver.solve` has a second price here: besides energy + λ·time, every change of the notch costs a fixed energy, so
that a change must save at least that much. A state is a decision node, a speed and the notch that the train is in; the
moves do not depend on λ. Only the policy is stored: the best notch of each state, and in which notches a train stays.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import IntEnum
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.solver.few_switch.settings import FewSwitchSettings
from das.solver.front import Sweep
from das.solver.kernels import few_switch_policy as kernels
from das.solver.kernels.driving import run_energy
from das.solver.kernels.few_switch_policy import NO_NOTCH, few_switch_moves, few_switch_roll_out, few_switch_sweep
from das.solver.kernels.tuples import SpeedBounds
from das.solver.policy_store import in_parts
from das.solver.section import Section
from das.solver.solve import DecisionGrid, node_behind, usable_power_w
from das.solver.state import State


class NotchRegime(IntEnum):
    """What a driver does in a notch, with the numbers that the kernels know."""

    TRACTION = kernels.TRACTION
    """A share of the largest traction effort."""
    HOLD = kernels.HOLD
    """The speed is held, by traction or by brakes."""
    COAST = kernels.COAST
    """No effort at all."""
    BRAKE = kernels.BRAKE
    """A share of the largest effort of the electric brake, until the lower speed ahead is reached."""
    CURVE = kernels.CURVE
    """The brakes keep the train on the braking curve of a limit or stop ahead."""


class Notches(NamedTuple):
    """The notches as the kernels take them (M,): the kind of each, and its share of the largest effort."""

    kind: NDArray[np.int64]
    share: NDArray[np.float64]


def make_notches(traction_shares: tuple[float, ...], brake_shares: tuple[float, ...]) -> Notches:
    """The notches with these shares of traction and of the electric brake, and the three that have no share."""
    kinds = [NotchRegime.TRACTION] * len(traction_shares) + [NotchRegime.HOLD, NotchRegime.COAST]
    kinds += [NotchRegime.BRAKE] * len(brake_shares) + [NotchRegime.CURVE]
    shares = (*traction_shares, 0.0, 0.0, *brake_shares, 0.0)
    return Notches(np.array([int(kind) for kind in kinds], dtype=np.int64), np.array(shares))


Floats = NDArray[np.float64]


DEFAULT = FewSwitchSettings()


class FewSwitchMoves(NamedTuple):
    """Where every notch leads (nodes, speeds, notches): time (s), energy (J), target speed and weight (see `Moves`)."""

    time_s: NDArray[np.float32]
    energy_j: NDArray[np.float32]
    target: NDArray[np.int16]
    weight: NDArray[np.float32]


class FewSwitchPolicy(NamedTuple):
    """The best notch of each state (nodes, speeds, multipliers), and the notches in which a train stays, as bits."""

    choice: NDArray[np.uint8]
    stay: NDArray[np.uint16]


@dataclass(frozen=True, kw_only=True, eq=False)
class FewSwitchTrajectory:
    """A few-switch trajectory from a state: speeds at the integration nodes ahead, and the notch of every interval."""

    state: State
    speeds_mps: Floats
    notch: NDArray[np.uint8]
    notches: Notches
    goal_mps: Floats
    """At each node the lower speed that brakes lead to."""
    time_s: float
    energy_j: float
    """The energy at the current collector."""
    lambda_w: float
    """The price of time (W) of the policy that the trajectory follows first."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FewSwitchFront:
    """The few-switch policies of a section for a ladder of multipliers, ascending."""

    section: Section
    lambda_w: Floats
    notches: Notches
    policy: FewSwitchPolicy
    goal_mps: Floats
    """At each integration node the lower speed that brakes lead to."""
    sweep: Sweep | None = None
    """The sweep that has not reached the beginning of the section yet; None if the whole section is solved."""

    def cover(self, s_m: float) -> None:
        """Solve the missing policies for a train at a position (m) and for all places ahead of it."""
        self._cover(State.at(self.section, s_m, 0.0))

    @property
    def nbytes(self) -> int:
        """The size of the policies (bytes)."""
        return self.policy.choice.nbytes + self.policy.stay.nbytes

    def run(self, time_s: float, s_m: float, v_mps: float, notch: int = NO_NOTCH) -> FewSwitchTrajectory:
        """The few-switch trajectory from a state that takes about `time_s`; the fastest one if that is too short.

        `notch` is the notch that the train is in. Raises DasError for a state outside the section, InfeasibleError if
        the train cannot reach the end of the section from it.
        """
        state = State.at(self.section, s_m, v_mps)
        size = len(self.lambda_w)
        slow, quick = -1, size  # The multiplier `slow` takes too long, `quick` does not.
        best = None
        while quick - slow > 1:
            middle = (slow + quick) // 2
            run = self.roll_out(state, middle, middle, 0, notch)
            if run.time_s > time_s:
                slow = middle
            else:
                quick, best = middle, run
        if best is None:
            return self.roll_out(state, size - 1, size - 1, 0, notch)
        if slow < 0:
            return best
        low, high = state.first_node, len(self.section.decision) - 1
        # Quick up to a node, then slow: the earlier the switch, the later the arrival.
        while high - low > 1:
            middle = (low + high) // 2
            run = self.roll_out(state, quick, slow, middle, notch)
            if run.time_s > time_s:
                low = middle
            else:
                high, best = middle, run
        return best

    def roll_out(self, state: State, quick: int, slow: int, switch: int, notch: int = NO_NOTCH) -> FewSwitchTrajectory:
        """The trajectory of multiplier `quick` up to decision node `switch`, then of `slow`."""
        self._cover(state)
        speeds = np.empty(len(state.node_m))
        speeds[0] = state.speed_mps
        notches = np.empty(len(state.step_m), np.uint8)
        notches[0] = notch
        first = len(self.section.node_m) - len(state.node_m)
        time_s = few_switch_roll_out(
            state.first_node, switch, quick, slow, state.decision, state.for_kernels,
            SpeedBounds(state.floor_mps, state.envelope_mps), self.goal_mps[first:], self.notches, self.policy,
            self.section.train, speeds, notches,
        )  # fmt: skip
        self.section.finished_s(time_s, float(state.node_m[0]), state.speed_mps)
        energy_j = run_energy(state.for_kernels, self.section.train, self.section.loss_params, speeds)
        return FewSwitchTrajectory(
            state=state, speeds_mps=speeds, notch=notches, notches=self.notches, goal_mps=self.goal_mps[first:],
            time_s=time_s, energy_j=energy_j, lambda_w=float(self.lambda_w[quick]),
        )  # fmt: skip

    def _cover(self, state: State) -> None:
        if self.sweep is not None and state.first_node < self.sweep.known_from:
            self.sweep.come_down_to(0)


def solve_few_switch(section: Section, settings: FewSwitchSettings = DEFAULT, *, threads: int = 2) -> FewSwitchFront:
    """The few-switch policies of a section."""
    sweep = _FewSwitchSweep(section, settings, threads)
    sweep.come_down_to(0)
    return sweep.front()


def solve_few_switch_ahead(
    section: Section, s_m: float, settings: FewSwitchSettings = DEFAULT, *, threads: int = 2
) -> FewSwitchFront:
    """The few-switch policies of a section for a train at a position (m): only what is ahead of it is solved.

    The part ahead has the same bits as in the front of the whole section. For a trajectory from a position more than
    `BEHIND_M` behind the train, the front first solves the rest.
    """
    sweep = _FewSwitchSweep(section, settings, threads)
    sweep.come_down_to(node_behind(section, s_m))
    return sweep.front()


class _FewSwitchSweep:
    """The sweep of few-switch trajectories from the end of a section towards its beginning, as far as it has come;
    thread-safe."""

    def __init__(self, section: Section, settings: FewSwitchSettings, threads: int) -> None:
        self.grid = DecisionGrid.of(section)
        self.notches = make_notches(settings.traction_shares, settings.brake_shares)
        self.goal_mps = goals(section.envelope_mps)
        usable_w = usable_power_w(section)
        self.ladder = usable_w * np.geomspace(settings.low_ratio, settings.high_ratio, settings.ladder_size)
        self._change_j = np.full(len(self.ladder), settings.change_s * usable_w)
        n, states, size = len(self.grid.node_m) - 1, self.grid.speed_steps + 1, len(self.ladder)
        self._policy = FewSwitchPolicy(np.empty((n, states, size), np.uint8), np.empty((n, states, size), np.uint16))
        self._value_j = np.zeros((states, len(self.notches.kind), size))
        self._threads, self._known_from, self._lock = threads, n, Lock()

    @property
    def known_from(self) -> int:
        """The first decision node whose policies are known."""
        return self._known_from

    def come_down_to(self, first: int) -> None:
        """Solve all nodes from `first` on that are not solved yet."""
        with self._lock:
            last = self._known_from
            if first >= last:
                return
            moves = self._moves(first, last)
            policy = FewSwitchPolicy(self._policy.choice[first:last], self._policy.stay[first:last])
            prices = (self.ladder, self._change_j)
            with ThreadPoolExecutor(self._threads) as pool:
                in_parts(pool, self._threads, len(self.ladder), few_switch_sweep, prices, moves, policy, self._value_j)
            self._known_from = first

    def front(self) -> FewSwitchFront:
        """The front, which continues the sweep when a node further back is needed."""
        return FewSwitchFront(
            section=self.grid.section, lambda_w=self.ladder, notches=self.notches, policy=self._policy,
            goal_mps=self.goal_mps, sweep=self if self._known_from > 0 else None,
        )  # fmt: skip

    def _moves(self, first: int, last: int) -> FewSwitchMoves:
        """The moves of the nodes first … last − 1."""
        grid, section = self.grid, self.grid.section
        shape = (len(grid.node_m) - 1, grid.speed_steps + 1, len(self.notches.kind))
        moves = FewSwitchMoves(
            np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.int16),
            np.empty(shape, np.float32),
        )  # fmt: skip

        def fill(begin: int, end: int) -> None:
            few_switch_moves(
                first + begin, first + end, grid.line, grid.bounds, self.goal_mps[section.decision], grid.speed_steps,
                self.notches, section.train, section.loss_params, moves,
            )  # fmt: skip

        with ThreadPoolExecutor(self._threads) as pool:
            in_parts(pool, self._threads, last - first, fill)
        rows = slice(first, last)
        return FewSwitchMoves(moves.time_s[rows], moves.energy_j[rows], moves.target[rows], moves.weight[rows])


def goals(envelope_mps: Floats) -> Floats:
    """At each node the speed to which the envelope falls from there on, before it rises again."""
    goal = envelope_mps.copy()
    for i in range(len(goal) - 2, -1, -1):
        goal[i] = goal[i + 1] if envelope_mps[i + 1] <= envelope_mps[i] else envelope_mps[i]
    return goal
