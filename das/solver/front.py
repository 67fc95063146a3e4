"""Front of a section: the supported time–energy trade-off and the optimal continuation from any state.

For every multiplier λ of a ladder a backward sweep minimises energy + λ·time (`das.solver.solve`). The tables of values
and times-to-go are feedback policies. `Front.trajectory` searches for the trajectory of one trip time from any state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.domain.summary import Summary, needs
from das.solver import tolerances as tol
from das.solver.kernels.tuples import Policies, Policy
from das.solver.section import Section
from das.solver.solution import Fit, Solution
from das.solver.state import RollOut, State, fastest, least_time_s

MAX_ROLL_OUTS: Final = 12
"""Most multipliers that are tried."""
OVERSHOOT_S: Final = 0.15
"""Time (s) beyond the wanted one at which the next trial is aimed, so that two trials enclose it."""
FIRST_STEP: Final = 0.05
"""Least part of a ladder step from the last trial to the next while all are on one side of the wanted time; then four
times as far, and so on."""
BLEND_LOSS_RATIO: Final = 2e-5
"""Share of the train's kinetic energy at the highest speed ahead that a multiplier between those of two trajectories
must be able to save for them not to be blended."""
MAX_BLENDS: Final = 40
"""Most blends of two trajectories that are tried."""
LEAST_SHARE: Final = 0.02
"""Least share of the interval by which the next trial keeps away from both ends, so that the interval shrinks."""

Floats = NDArray[np.float64]


class Sweep(Protocol):
    """The sweep of a section from its end, which has not reached the beginning yet."""

    @property
    def known_from(self) -> int:
        """The first decision node whose policies are known."""

    def come_down_to(self, first: int) -> None:
        """Solve all nodes from `first` on that are not solved yet."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Front(Summary):
    """Policies of a section for a ladder of multipliers.

    `lambda_w` (L,) ascends. `value_j` and `time_to_go_s` have the shape (K + 1 decision nodes, J + 1 speeds, L).

    With a `sweep` only the nodes from `sweep.known_from` on are filled: the front of a train that is under way. The
    methods continue the sweep if they need more.
    """

    section: Section
    lambda_w: Floats
    value_j: Floats
    time_to_go_s: NDArray[np.float32]
    sweep: Sweep | None = None

    def facts(self) -> dict[str, str]:
        """The section's facts, and what its fastest trajectory and one with a tenth more time need."""
        fastest_run = self.fastest()
        told = {"fastest": fastest_run, "with a buffer of 10 %": self.trajectory(1.1 * fastest_run.time_s)}
        return {**self.section.facts(), **{name: needs(run.time_s, run.balance.input) for name, run in told.items()}}

    def cover(self, s_m: float) -> None:
        """Solve the missing policies for a train at a position (m) and for all places ahead of it."""
        self._cover(State.at(self.section, s_m, 0.0))

    @property
    def policies(self) -> Policies:
        """The policies as the kernels take them."""
        return Policies(self.lambda_w, self.value_j, self.time_to_go_s)

    def fastest(self, s_m: float | None = None, v_mps: float | None = None) -> Solution:
        """The fastest trajectory from a state (see `das.solver.state.fastest`, which needs no front)."""
        return fastest(self.section, s_m, v_mps)

    def least_time_s(self, s_m: float, v_mps: float) -> float:
        """Time (s) of the fastest trajectory from a state (see `das.solver.state.least_time_s`; it needs no front)."""
        return least_time_s(self.section, s_m, v_mps)

    def trajectory(
        self,
        time_s: float,
        s_m: float | None = None,
        v_mps: float | None = None,
        *,
        tolerance_s: float = tol.TIME_TOLERANCE_S,
    ) -> Solution:
        """The trajectory of least energy that takes `time_s` from a state (by default from the start of the section).

        A time below the least possible gives the fastest trajectory (`Fit.LATE`). A time so long that no more energy
        can be saved gives the trajectory of least energy (`Fit.EARLY`). Otherwise the time is met to within
        `tolerance_s`.

        Raises DasError for a state outside the section or a time that is not positive, InfeasibleError if the train
        cannot reach the end of the section from the state.
        """
        if not time_s > 0 or math.isinf(time_s):
            raise DasError(f"trip time {time_s} s: expected a finite time > 0 s")
        state = State.at(self.section, s_m, v_mps)
        self._cover(state)
        least_s = least_time_s(self.section, float(state.node_m[0]), state.speed_mps)
        if time_s <= least_s + tolerance_s:
            fit = Fit.ON_TIME if time_s >= least_s - tolerance_s else Fit.LATE
            return state.solution(state.fastest(), least_time_s=least_s, requested_s=time_s, fit=fit)
        return TimeSearch(self.policies, state, time_s, least_time_s=least_s, tolerance_s=tolerance_s).run()

    def by_multiplier(self, s_m: float, v_mps: float) -> tuple[Floats, Floats]:
        """Times (s) of the trajectories from a state under all multipliers of the ladder, and their least costs (J)."""
        state, policies = State.at(self.section, s_m, v_mps), self.policies
        self._cover(state)
        total_j = state.totals(policies).cost_j
        ladder = (Policy(price_w=float(price), ladder_index=i) for i, price in enumerate(self.lambda_w))
        return np.array([state.roll_out(policies, policy).time_s for policy in ladder]), total_j

    def _cover(self, state: State) -> None:
        if self.sweep is not None and state.first_node + 1 < self.sweep.known_from:
            self.sweep.come_down_to(0)


class Trial(NamedTuple):
    """A trajectory that was tried.

    `place` is the index of its multiplier on the ladder, with a fraction if it lies between two steps (inf: the fastest
    trajectory). `miss_s` is how much longer than wanted the trajectory takes.
    """

    place: float
    run: RollOut
    miss_s: float


class TimeSearch:
    """Finds the trajectory from a state that takes a given time: that of a multiplier, or a blend if the front jumps.

    The policies tell where on the ladder to look. Each trial corrects that, and the next one is aimed a little beyond
    the wanted time, so that the two enclose it. The search then goes on by false position (Illinois).
    """

    def __init__(
        self,
        policies: Policies,
        state: State,
        time_s: float,
        *,
        least_time_s: float,
        tolerance_s: float = tol.TIME_TOLERANCE_S,
    ) -> None:
        self.policies, self.state, self.time_s = policies, state, time_s
        self.least_time_s, self.tolerance_s = least_time_s, tolerance_s
        self.last = len(policies.lambda_w) - 1
        self._steps = np.arange(self.last + 1)
        # Where the front almost jumps, the times by the policies may rise with the multiplier.
        self._table_s = np.minimum.accumulate(state.totals(policies).time_s)

    def run(self) -> Solution:
        """The trajectory of the wanted time, or the nearest efficient one (see `Fit`)."""
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

    def attempt(self, place: float) -> Trial:
        """Roll out the multiplier at a place of the ladder."""
        run = self.state.roll_out(self.policies, self.policy(place))
        return Trial(place, run, run.time_s - self.time_s)

    def policy(self, place: float) -> Policy:
        """The policy at a place of the ladder."""
        ladder, index = self.policies.lambda_w, int(place)
        gap = float(ladder[index + 1] - ladder[index]) if place > index else 0.0
        offset = (place - index) * gap
        return Policy(price_w=float(ladder[index]) + offset, ladder_index=index, offset_w=offset, gap_w=gap)

    def price_w(self, place: float) -> float:
        """The multiplier (W) at a place of the ladder."""
        return float(np.interp(place, self._steps, self.policies.lambda_w))

    def _answer(self, run: RollOut, place: float, fit: Fit) -> Solution:
        return self.state.solution(
            run,
            least_time_s=self.least_time_s,
            requested_s=self.time_s,
            fit=fit,
            lambda_w=self.price_w(place),
        )

    def _enclose(self) -> tuple[Trial | None, Trial]:
        """A slow and a quick trial that can be blended; no slow one if even the smallest multiplier is early."""
        slow, quick = None, None
        above, below, kept = 0.0, 0.0, 0
        place, step = self._place(self.time_s), FIRST_STEP
        for _ in range(MAX_ROLL_OUTS):
            trial = self.attempt(place)
            # The end that is kept twice in a row counts half, so that both ends move.
            if trial.miss_s > 0:
                slow, above, below, kept = trial, trial.miss_s, below * (0.5 if kept > 0 else 1.0), 1
            else:
                quick, below, above, kept = trial, trial.miss_s, above * (0.5 if kept < 0 else 1.0), -1
            if abs(trial.miss_s) <= self.tolerance_s or self._blendable(slow, quick):
                break
            if slow is None or quick is None:
                place, step = self._beyond(trial, step), 4 * step
            else:
                place = slow.place + self._share(above, below) * (quick.place - slow.place)
        if quick is None:  # Only the fastest trajectory is quicker than that of the highest multiplier.
            run = self.state.fastest()
            quick = Trial(math.inf, run, run.time_s - self.time_s)
        return slow, quick

    def _share(self, above: float, below: float) -> float:
        """Where between two trials the next one should lie, by their misses (false position)."""
        return float(np.clip(above / (above - below), LEAST_SHARE, 1.0 - LEAST_SHARE))

    def _blendable(self, slow: Trial | None, quick: Trial | None) -> bool:
        """Whether next to nothing can be gained between two trials, or no multiplier lies between them."""
        if slow is None or quick is None:
            return (quick is not None and quick.place <= 0) or (slow is not None and slow.place >= self.last)
        # The front lies above its tangents at both trials, whose slopes are −λ.
        late, early = slow.miss_s, -quick.miss_s
        gain_j = (self.price_w(quick.place) - self.price_w(slow.place)) * late * early / (late + early)
        kinetic_j = 0.5 * self.state.section.train.inertial_mass_kg * float(self.state.envelope_mps.max()) ** 2
        return gain_j <= BLEND_LOSS_RATIO * kinetic_j

    def _place(self, time_s: float) -> float:
        """Where on the ladder a trip time lies according to the policies."""
        return float(np.interp(-time_s, -self._table_s, self._steps))

    def _beyond(self, trial: Trial, step: float) -> float:
        """A place just on the other side of the wanted time, if the policies err there as they did at `trial`."""
        side = math.copysign(1.0, trial.miss_s)
        known_s = float(np.interp(trial.place, self._steps, self._table_s))
        aimed = self._place(known_s - trial.miss_s - side * OVERSHOOT_S)
        place = trial.place + side * max(side * (aimed - trial.place), step)
        return min(max(place, 0.0), float(self.last))

    def _blend(self, slow: Trial, quick: Trial) -> RollOut:
        """The trajectory of the wanted time between two trials; its energy is near the chord between theirs."""
        low, high, above, below = 0.0, 1.0, slow.miss_s, quick.miss_s
        best, kept = slow.run, 0
        for _ in range(MAX_BLENDS):
            share = low + (high - low) * self._share(above, below)
            best = self.state.blend(share, quick.run, slow.run)
            miss = best.time_s - self.time_s
            if abs(miss) <= 0.1 * self.tolerance_s:
                break
            if miss > 0:
                low, above, below, kept = share, miss, below * (0.5 if kept > 0 else 1.0), 1
            else:
                high, below, above, kept = share, miss, above * (0.5 if kept < 0 else 1.0), -1
        return best
