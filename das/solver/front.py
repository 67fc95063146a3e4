"""Front of a section: the supported time–energy trade-off and the optimal continuation from any state.

For every multiplier λ of a ladder a backward sweep minimises energy + λ·time (`das.solver.solve`). The tables of values
and times-to-go are feedback policies. `Front.trajectory` answers for one trip time from any state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.solver import fastest as without_front
from das.solver import tolerances as tol
from das.solver.kernels.tuples import PackedTimes, Policies, Policy
from das.solver.search import TimeSearch
from das.solver.section import Section
from das.solver.solution import Fit, Solution
from das.solver.state import State

Floats = NDArray[np.float64]


class Sweep(Protocol):
    """The sweep of a section from its end, which has not come to the begin yet."""

    @property
    def known_from(self) -> int:
        """The first decision node whose policies are known."""

    def come_down_to(self, first: int) -> None:
        """Solve all nodes from `first` on that are not solved yet."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Front:
    """Policies of a section for a ladder of multipliers.

    `lambda_w` (L,) ascends. `value_j` and `time_to_go_s` have the shape (K + 1 decision nodes, J + 1 speeds, L). A
    solved front holds them as float64 and float32; a large one, and a table on disk, as float32 and packed.

    With a `sweep` only the nodes from `sweep.known_from` on are filled: the front of a train that is under way. The
    methods let the sweep go on where a question needs more.
    """

    section: Section
    lambda_w: Floats
    value_j: Floats | NDArray[np.float32]
    time_to_go_s: NDArray[np.float32] | PackedTimes
    sweep: Sweep | None = None

    def cover(self, s_m: float) -> None:
        """Have the policies for a train at a position (m), and ahead of it."""
        self._cover(State.at(self.section, s_m, 0.0))

    @property
    def policies(self) -> Policies:
        """The policies as the kernels take them."""
        return Policies(self.lambda_w, self.value_j, self.time_to_go_s)

    def fastest(self, s_m: float | None = None, v_mps: float | None = None) -> Solution:
        """The fastest run from a state (see `das.solver.fastest.fastest`, which needs no front)."""
        return without_front.fastest(self.section, s_m, v_mps)

    def least_time_s(self, s_m: float, v_mps: float) -> float:
        """Time of the fastest run from a state (see `das.solver.fastest.least_time_s`, which needs no front)."""
        return without_front.least_time_s(self.section, s_m, v_mps)

    def trajectory(
        self,
        time_s: float,
        s_m: float | None = None,
        v_mps: float | None = None,
        *,
        tolerance_s: float = tol.TIME_TOLERANCE_S,
    ) -> Solution:
        """The least-energy run of duration `time_s` from a state (by default from the start of the section).

        A time below the least possible gives the fastest run (`Fit.LATE`); one beyond the least-energy run gives
        that run (`Fit.EARLY`). Otherwise the time is hit to within `tolerance_s`.

        Raises DasError for a state outside the section or a time that is not positive, InfeasibleError where the
        section cannot be finished from the state.
        """
        if not time_s > 0 or math.isinf(time_s):
            raise DasError(f"trip time {time_s} s: expected a finite time > 0 s")
        state = State.at(self.section, s_m, v_mps)
        self._cover(state)
        quickest = state.fastest()
        if time_s <= quickest.time_s + tolerance_s:
            fit = Fit.ON_TIME if time_s >= quickest.time_s - tolerance_s else Fit.LATE
            return state.solution(quickest, least_time_s=quickest.time_s, requested_s=time_s, fit=fit)
        return TimeSearch(self.policies, state, time_s, quickest=quickest, tolerance_s=tolerance_s).run()

    def ladder_times_s(self) -> Floats:
        """Time of the whole section under every multiplier, as the policies know it (s)."""
        state = State.at(self.section)
        self._cover(state)
        return state.totals(self.policies).time_s

    def by_multiplier(self, s_m: float, v_mps: float) -> tuple[Floats, Floats]:
        """Times (s) of the runs from a state under every multiplier of the ladder, and their least costs (J)."""
        state, policies = State.at(self.section, s_m, v_mps), self.policies
        self._cover(state)
        total_j = state.totals(policies).cost_j
        ladder = (Policy(price_w=float(price), ladder_index=i) for i, price in enumerate(self.lambda_w))
        return np.array([state.roll_out(policies, policy).time_s for policy in ladder]), total_j

    def _cover(self, state: State) -> None:
        if self.sweep is not None and state.first_node + 1 < self.sweep.known_from:
            self.sweep.come_down_to(0)
