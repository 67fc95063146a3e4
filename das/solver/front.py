"""Front of a section: the supported points of the time–energy trade-off and the optimal continuation from any state.

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
"""Largest number of multipliers tried."""
OVERSHOOT_S: Final = 0.15
"""Time (s) by which the next trial overshoots the requested one; two trials then enclose the requested time."""
FIRST_STEP: Final = 0.05
"""Least part of a ladder step between two trials while all trials are on one side of the requested time; each further
step is four times as large."""
BLEND_LOSS_RATIO: Final = 2e-5
"""Potential saving, as a share of the kinetic energy at the highest speed ahead, below which two trajectories are
blended instead of trying a multiplier between theirs."""
MAX_BLENDS: Final = 40
"""Largest number of blends tried."""
LEAST_SHARE: Final = 0.02
"""Least distance of the next trial from both ends, as a share of the interval, so that the interval always shrinks."""

Floats = NDArray[np.float64]


class Sweep(Protocol):
    """An incomplete sweep of a section, from its end."""

    @property
    def known_from(self) -> int:
        """The first decision node whose policies are known."""

    def come_down_to(self, first: int) -> None:
        """Solve all unsolved nodes from `first` on."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Front(Summary):
    """Policies of a section for a ladder of multipliers.

    `lambda_w` (L,) ascends. `value_j` and `time_to_go_s` have the shape (K + 1 decision nodes, J + 1 speeds, L).

    With a `sweep` only the nodes from `sweep.known_from` on are filled: the front of a moving train. The methods
    continue the sweep if they need more nodes.
    """

    section: Section
    lambda_w: Floats
    value_j: Floats
    time_to_go_s: NDArray[np.float32]
    sweep: Sweep | None = None

    def facts(self) -> dict[str, str]:
        """The section's facts, with time and energy of its fastest trajectory and of one that takes a tenth longer."""
        fastest_run = self.fastest()
        told = {"fastest": fastest_run, "with a buffer of 10 %": self.trajectory(1.1 * fastest_run.time_s)}
        return {**self.section.facts(), **{name: needs(run.time_s, run.balance.input) for name, run in told.items()}}

    def cover(self, s_m: float) -> None:
        """Solve the missing policies for a train at a position (m) and all positions ahead of it."""
        self._cover(State.at(self.section, s_m, 0.0))

    @property
    def policies(self) -> Policies:
        """The policies in the form required by the kernels."""
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

        For a time below the minimum this is the fastest trajectory (`Fit.LATE`), for a time too long to save more
        energy the trajectory of least energy (`Fit.EARLY`). Otherwise the time is met to within `tolerance_s`.

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
            run, price_w = state.fastest(), math.inf
        else:
            run, price_w, fit = TimeSearch(self.policies, state, time_s, tolerance_s).run()
        return state.solution(run, least_time_s=least_s, requested_s=time_s, fit=fit, lambda_w=price_w)

    def by_multiplier(self, s_m: float, v_mps: float) -> tuple[Floats, Floats]:
        """Times (s) of the trajectories from a state under all multipliers of the ladder, and their least costs (J)."""
        state, policies = State.at(self.section, s_m, v_mps), self.policies
        self._cover(state)
        total_j, _ = state.totals(policies)
        ladder = (Policy(price_w=float(price), ladder_index=i) for i, price in enumerate(self.lambda_w))
        return np.array([state.roll_out(policies, policy).time_s for policy in ladder]), total_j

    def _cover(self, state: State) -> None:
        if self.sweep is not None and state.first_node + 1 < self.sweep.known_from:
            self.sweep.come_down_to(0)


class Trial(NamedTuple):
    """A trajectory that has been tried.

    `place` is the index of its multiplier on the ladder, fractional if it lies between two steps (inf: the fastest
    trajectory). `miss_s` is its time minus the requested time.
    """

    place: float
    run: RollOut
    miss_s: float


class TimeSearch:
    """Search for the trajectory from a state that takes a given time: one for a multiplier, or a blend if the front
    jumps.

    The policies give the first place on the ladder. Each trial corrects it, and the next one aims slightly beyond the
    requested time until two enclose it. Then the search continues by false position (Illinois).
    """

    def __init__(self, policies: Policies, state: State, time_s: float, tolerance_s: float) -> None:
        self.policies, self.state, self.time_s, self.tolerance_s = policies, state, time_s, tolerance_s
        self.last = len(policies.lambda_w) - 1
        self._steps = np.arange(self.last + 1)
        # Where the front almost jumps, the policies' times may rise with the multiplier.
        self._table_s = np.minimum.accumulate(state.totals(policies)[1])

    def run(self) -> tuple[RollOut, float, Fit]:
        """The trajectory of the requested time, or the nearest efficient one, its price of time (W) and its fit."""
        slow, quick = self._enclose()
        for trial in (slow, quick):
            if trial is not None and abs(trial.miss_s) <= self.tolerance_s:
                return trial.run, self.price_w(trial.place), Fit.ON_TIME
        if slow is None:
            return quick.run, self.price_w(quick.place), Fit.EARLY
        run = self._blend(slow, quick)
        miss = run.time_s - self.time_s
        fit = Fit.ON_TIME if abs(miss) <= self.tolerance_s else Fit.LATE if miss > 0 else Fit.EARLY
        return run, self.price_w(0.5 * (slow.place + min(quick.place, self.last))), fit

    def attempt(self, place: float) -> Trial:
        """The trial of the multiplier at a place of the ladder."""
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

    def _enclose(self) -> tuple[Trial | None, Trial]:
        """A slow and a quick trial to blend; None for the slow one if the least multiplier gives an early arrival."""
        slow, quick = None, None
        above, below, kept = 0.0, 0.0, 0
        place, step = self._place(self.time_s), FIRST_STEP
        for _ in range(MAX_ROLL_OUTS):
            trial = self.attempt(place)
            # An end that is kept twice in a row gets half of its weight, so that both ends move.
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
        if quick is None:  # Only the fastest trajectory is faster than the one for the highest multiplier.
            run = self.state.fastest()
            quick = Trial(math.inf, run, run.time_s - self.time_s)
        return slow, quick

    def _share(self, above: float, below: float) -> float:
        """Position of the next trial between two others (a share), from their misses by false position."""
        return float(np.clip(above / (above - below), LEAST_SHARE, 1.0 - LEAST_SHARE))

    def _blendable(self, slow: Trial | None, quick: Trial | None) -> bool:
        """Whether the possible gain between two trials is negligible, or no multiplier lies between them."""
        if slow is None or quick is None:
            return (quick is not None and quick.place <= 0) or (slow is not None and slow.place >= self.last)
        # The front lies above its tangents at both trials, whose slopes are −λ.
        late, early = slow.miss_s, -quick.miss_s
        gain_j = (self.price_w(quick.place) - self.price_w(slow.place)) * late * early / (late + early)
        kinetic_j = 0.5 * self.state.section.train.inertial_mass_kg * float(self.state.envelope_mps.max()) ** 2
        return gain_j <= BLEND_LOSS_RATIO * kinetic_j

    def _place(self, time_s: float) -> float:
        """Place of a trip time on the ladder according to the policies."""
        return float(np.interp(-time_s, -self._table_s, self._steps))

    def _beyond(self, trial: Trial, step: float) -> float:
        """A place just on the other side of the requested time, if the policies' error there equals that at `trial`."""
        side = math.copysign(1.0, trial.miss_s)
        known_s = float(np.interp(trial.place, self._steps, self._table_s))
        aimed = self._place(known_s - trial.miss_s - side * OVERSHOOT_S)
        place = trial.place + side * max(side * (aimed - trial.place), step)
        return min(max(place, 0.0), float(self.last))

    def _blend(self, slow: Trial, quick: Trial) -> RollOut:
        """The trajectory of the requested time between two trials; its energy is close to the chord between theirs."""
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
