"""Fronts and runs of the cases, each solved once, and their energy at every level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from das.domain.files.load import load_vehicle
from das.domain.losses import EfficiencyLoss, Level, LossMap
from das.domain.trajectory import Ledger, Trajectory, consumed_j, evaluated_at
from das.domain.units import KMH, PERCENT
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.section import Section
from das.solver.solve import solve_front
from docs.studies.cases import L0_REG, L3, LOWEST_CRUISE_KMH, StudyCase, Variant

ENERGY_MARGIN_RATIO = 2e-5
"""Energies this near to the least (relative to the fastest run's at L3) are the least: slower runs save nothing."""
START_WAY_M = 100.0
"""Way to or from a standstill on which a run may be slower than 20 km/h."""
TIE_RATIO = 1e-4
"""Loss by which ties at L0 REG are broken, as a share of the wheel work in either direction: without losses, braking
and accelerating again costs nothing, and many runs of one time have the same energy. The paper filters such runs."""
SLOWEST_SCAN = 80
"""Number of times at which the least energy of a level is looked for."""
TIME_MARGIN_S = 0.05
"""The time of the slowest run is found to within this."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slowest:
    """The run with the largest useful buffer ("max" in the paper's figures).

    `bound`: "least energy" where a slower run saves nothing more at its level, or "not below 20 km/h" where it would
    run slower than the paper's grid allows.
    """

    trajectory: Trajectory
    buffer_percent: float
    bound: str


def _with_ties_broken(vehicle: Vehicle) -> Vehicle:
    """The vehicle whose L1 is L0 REG but for `TIE_RATIO`."""
    loss = EfficiencyLoss(traction_ratio=TIE_RATIO, brake_ratio=TIE_RATIO)
    return replace(vehicle, losses={**vehicle.losses, Level.L1: loss})


class Workbench:
    """Solves each case and level once, on demand, and answers from that.

    Every train is as its file says, or as `changed` makes it.
    """

    def __init__(self, changed: Callable[[Vehicle], Vehicle] = lambda vehicle: vehicle) -> None:
        self._changed = changed
        self._vehicles: dict[str, Vehicle] = {}
        self._fronts: dict[tuple[StudyCase, Variant], Front] = {}
        self._slowest: dict[tuple[StudyCase, Variant], Slowest] = {}

    def vehicle(self, variant: Variant) -> Vehicle:
        """The train of a variant."""
        if variant.vehicle not in self._vehicles:
            self._vehicles[variant.vehicle] = self._changed(load_vehicle(variant.vehicle))
        return self._vehicles[variant.vehicle]

    def loss_map(self, variant: Variant) -> LossMap:
        """The L3 map of a variant's train."""
        model = self.vehicle(variant).loss_model(L3.level)
        if not isinstance(model, LossMap):
            raise TypeError(f"{variant.vehicle}: its L3 losses are {type(model).__name__}, not a LossMap")
        return model

    def front(self, case: StudyCase, variant: Variant) -> Front:
        """The solved front of a case at a level."""
        key = (case, variant)
        if key not in self._fronts:
            vehicle, level = self.vehicle(variant), variant.level
            if variant == L0_REG:
                vehicle, level = _with_ties_broken(vehicle), Level.L1
            self._fronts[key] = solve_front(case.section(vehicle, level))
        return self._fronts[key]

    def section(self, case: StudyCase, variant: Variant) -> Section:
        """The section of a case at a level."""
        return self.front(case, variant).section

    def fastest(self, case: StudyCase) -> Trajectory:
        """The fastest run (the force limits are the same at every level, and so is this run)."""
        return self.front(case, L3).fastest().trajectory

    def time_s(self, case: StudyCase, buffer_percent: float) -> float:
        """Running time with a buffer (in % of the least running time)."""
        return self.fastest(case).time_s * (1 + buffer_percent * PERCENT)

    def run(self, case: StudyCase, variant: Variant, buffer_percent: float) -> Trajectory | None:
        """The least-energy run of a level with a buffer; None where the level has no use for so large a buffer."""
        if buffer_percent > self.slowest(case, variant).buffer_percent + 1e-9:
            return None
        return self.front(case, variant).trajectory(self.time_s(case, buffer_percent)).trajectory

    def energy_j(self, trajectory: Trajectory, variant: Variant) -> float:
        """Energy the paper compares at a level: irreversible, or positive wheel work at L0 NOREG."""
        return consumed_j(trajectory, self.vehicle(variant), variant.level)

    def ledger(self, trajectory: Trajectory, variant: Variant) -> Ledger:
        """Energy ledger of any run at a level."""
        return evaluated_at(trajectory, self.vehicle(variant), variant.level)

    def reference_j(self, case: StudyCase) -> float:
        """100 %: the energy of the fastest run at L3 with the GTO map."""
        return self.energy_j(self.fastest(case), L3)

    def percent(self, case: StudyCase, trajectory: Trajectory, variant: Variant) -> float:
        """Energy of a run at a level in % of `reference_j`."""
        return self.energy_j(trajectory, variant) / self.reference_j(case) / PERCENT

    def slowest(self, case: StudyCase, variant: Variant) -> Slowest:
        """The run with the largest useful buffer of a level."""
        key = (case, variant)
        if key not in self._slowest:
            self._slowest[key] = self._find_slowest(case, variant)
        return self._slowest[key]

    def _find_slowest(self, case: StudyCase, variant: Variant) -> Slowest:
        front, least_s = self.front(case, variant), self.fastest(case).time_s

        def run(time_s: float) -> Trajectory:
            return front.trajectory(time_s).trajectory

        def creeps(time_s: float) -> bool:
            return lowest_running_speed_mps(run(time_s)) < LOWEST_CRUISE_KMH * KMH * (1 - 1e-6)

        def energy_j(time_s: float) -> float:
            return self.energy_j(run(time_s), variant)

        longest_s = least_s + case.length_m / (LOWEST_CRUISE_KMH * KMH)
        creeping = creeps(longest_s)
        if creeping:
            longest_s = _first_time(creeps, least_s, longest_s) - TIME_MARGIN_S
        times = np.linspace(least_s, min(longest_s, run(longest_s).time_s), SLOWEST_SCAN)
        energies_j = np.array([energy_j(t) for t in times])
        enough_j = float(energies_j.min()) + ENERGY_MARGIN_RATIO * self.reference_j(case)
        i = int(np.flatnonzero(energies_j <= enough_j)[0])
        last = i == len(times) - 1
        time_s = times[i] if i == 0 or last else _first_time(lambda t: energy_j(t) <= enough_j, times[i - 1], times[i])
        trajectory = run(float(time_s))
        return Slowest(
            trajectory=trajectory,
            buffer_percent=(trajectory.time_s / least_s - 1) / PERCENT,
            bound="not below 20 km/h" if creeping and last else "least energy",
        )


def lowest_running_speed_mps(trajectory: Trajectory) -> float:
    """Lowest speed of a run but for the first and last 100 m where it starts or ends slower than 20 km/h.

    The paper's grid has its nodes 100 m apart, and below 20 km/h only starting and stopping (section 4.1).
    """
    s_m, v_mps = trajectory.s_m, trajectory.v_mps
    slow = LOWEST_CRUISE_KMH * KMH
    first_m = s_m[0] + (START_WAY_M if v_mps[0] < slow else 0.0)
    last_m = s_m[-1] - (START_WAY_M if v_mps[-1] < slow else 0.0)
    return float(v_mps[(s_m >= first_m) & (s_m <= last_m)].min())


def _first_time(holds: Callable[[float], bool], low_s: float, high_s: float) -> float:
    """The time (to TIME_MARGIN_S) from which a condition holds that holds at `high_s`; by bisection."""
    while high_s - low_s > TIME_MARGIN_S:
        middle = 0.5 * (low_s + high_s)
        low_s, high_s = (low_s, middle) if holds(middle) else (middle, high_s)
    return high_s
