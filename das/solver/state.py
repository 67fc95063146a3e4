"""A state of a train on a section, and the trajectories from it; the fastest one needs no front."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.solver import tolerances as tol
from das.solver.kernels.forces import on_supply
from das.solver.kernels.roll_out import blend_runs, fastest_roll_out, least_time, one_step_totals, roll_out
from das.solver.kernels.tuples import DecisionStep, Policies, Policy, SpeedBounds
from das.solver.line_profile import LineProfile
from das.solver.section import Section
from das.solver.solution import Fit, Solution, trajectory_on

Floats = NDArray[np.float64]


class RollOut(NamedTuple):
    """A trajectory from a state: its speeds at the state and at the integration nodes ahead, and its time."""

    speeds_mps: Floats
    time_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class State(LineProfile):
    """A speed at a position of a section, and the line from there to the end of the section.

    `first_node` is the last decision node at or before the position. `decision` holds the indices of the decision nodes
    among the nodes of the state, beginning with 0 for the state itself.
    """

    section: Section
    first_node: int
    floor_mps: Floats
    envelope_mps: Floats
    decision: NDArray[np.int64]
    speed_mps: float

    @classmethod
    def at(cls, section: Section, s_m: float | None = None, v_mps: float | None = None) -> State:
        """The state at a position (m) and speed (m/s), by default at the start of the section.

        Raises DasError for a position outside the section or an impossible speed.
        """
        s_m = section.start_m if s_m is None else float(s_m)
        v_mps = section.start_speed_mps if v_mps is None else float(v_mps)
        check_state(section, s_m, v_mps)
        i = following_node(section, s_m)
        k = int(np.searchsorted(section.decision, i))
        first = slice(i - 1, None)
        node = section.node_m[first].copy()
        node[0] = s_m
        step = section.step_m[first].copy()
        step[0] = node[1] - s_m
        envelope = section.envelope_mps[first].copy()
        envelope[0] = max(envelope[0], v_mps)
        return cls(
            section=section,
            first_node=k - 1,
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

    def fastest(self) -> RollOut:
        """The fastest trajectory; above the envelope the train brakes first. Raises InfeasibleError if it stalls."""
        speeds = self._speeds()
        time_s = fastest_roll_out(self.for_kernels, self.envelope_mps, self.section.train, speeds)
        return self._finished(speeds, time_s)

    def roll_out(self, policies: Policies, policy: Policy) -> RollOut:
        """The trajectory under a policy; raises InfeasibleError if the train stalls."""
        speeds, section = self._speeds(), self.section
        time_s = roll_out(
            self.first_node, self.decision, self.for_kernels, SpeedBounds(self.floor_mps, self.envelope_mps), policy,
            policies, section.train, section.loss_params, speeds,
        )  # fmt: skip
        return self._finished(speeds, time_s)

    def blend(self, share: float, quick: RollOut, slow: RollOut) -> RollOut:
        """The trajectory between two others: v² = share · (v² of the quick one) + (1 − share) · (v² of the slow one).

        Every step is limited to the train's efforts. Raises InfeasibleError if the train stalls.
        """
        speeds = self._speeds()
        time_s = blend_runs(
            share, quick.speeds_mps, slow.speeds_mps, self.for_kernels, self.envelope_mps, self.section.train, speeds
        )
        return self._finished(speeds, time_s)

    def totals(self, policies: Policies) -> tuple[Floats, Floats]:
        """Least total costs (J) and their times (s) for every multiplier of the ladder, according to the policies."""
        cost_j, time_s = np.empty((2, len(policies.lambda_w)))
        one_step_totals(self.speed_mps, self._first_step(), policies, self.section.loss_params, cost_j, time_s)
        return cost_j, time_s

    def solution(
        self,
        run: RollOut,
        *,
        least_time_s: float,
        requested_s: float,
        fit: Fit,
        lambda_w: float = math.inf,
    ) -> Solution:
        """The solution of a trajectory from this state."""
        speeds, section = run.speeds_mps, self.section
        ends_right = speeds[-1] >= section.floor_mps[-1] - tol.SPEED_TOLERANCE_MPS
        return Solution(
            section=section,
            trajectory=trajectory_on(section, self, speeds),
            fit=fit,
            least_time_s=least_time_s,
            requested_s=requested_s,
            lambda_w=lambda_w,
            feasible=bool(ends_right and (speeds <= section.envelope_mps[-len(speeds) :] + 1e-6).all()),
        )

    def _first_step(self) -> DecisionStep:
        """The step from the state to the next decision node."""
        n = int(self.decision[1])
        step = self.step_m[:n]
        length = float(step.sum())
        floor, envelope = float(self.floor_mps[n]), float(self.envelope_mps[n])
        return DecisionStep(
            node=self.first_node + 1,
            length_m=length,
            constant_n=float(self.constant_n[:n] @ step) / length,
            tunnel_n_per_mps2=float(self.tunnel_n_per_mps2[:n] @ step) / length,
            floor_mps=floor,
            envelope_mps=envelope,
            final=len(self.decision) == 2 and floor >= envelope,
            train=on_supply(self.section.train, self.supply[0]),
        )

    def _speeds(self) -> Floats:
        speeds = np.empty(len(self.node_m))
        speeds[0] = self.speed_mps
        return speeds

    def _finished(self, speeds: Floats, time_s: float) -> RollOut:
        return RollOut(speeds, self.section.finished_s(time_s, float(self.node_m[0]), self.speed_mps))


def check_state(section: Section, s_m: float, v_mps: float) -> None:
    """Raise DasError for a position outside the section or an impossible speed."""
    if not section.start_m <= s_m < section.end_m - tol.MIN_STEP_M:
        raise DasError(f"position {s_m} m: expected one in the section {section.start_m:g} … {section.end_m:g} m")
    if not 0 <= v_mps < 200:
        raise DasError(f"speed {v_mps} m/s: expected one from 0 to 200 m/s")


def following_node(section: Section, s_m: float) -> int:
    """Index of the integration node after a position."""
    return int(section.node_m.searchsorted(s_m + tol.MIN_STEP_M, side="right"))


def fastest(section: Section, s_m: float | None = None, v_mps: float | None = None) -> Solution:
    """The fastest trajectory from a position (m) and speed (m/s), by default from the start of the section.

    Raises DasError for a state outside the section, InfeasibleError if the train cannot reach the end from it.
    """
    state = State.at(section, s_m, v_mps)
    run = state.fastest()
    return state.solution(run, least_time_s=run.time_s, requested_s=run.time_s, fit=Fit.ON_TIME)


@lru_cache(maxsize=2)  # Several parts of one advice message need it.
def least_time_s(section: Section, s_m: float, v_mps: float) -> float:
    """Time (s) of the fastest trajectory from a position (m) and speed (m/s); errors as in `fastest`.

    The trajectory is computed only until it meets the section's `fastest_run`.
    """
    check_state(section, s_m, v_mps)
    following = following_node(section, s_m)
    time_s = least_time(
        following - 1, float(section.node_m[following]) - s_m, v_mps, section.for_kernels, section.envelope_mps,
        section.train, section.fastest_run,
    )  # fmt: skip
    return section.finished_s(time_s, s_m, v_mps)
