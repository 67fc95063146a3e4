"""The paper's problems (sections 4.3 to 4.7) and printed figures, and the workbench that solves each problem once.

Source of all printed figures: Nold & Corman (2024), Railway Engineering Science, open access.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap
from das.domain.trajectory import EnergyBalance, Trajectory
from das.domain.units import KM, KMH, PERCENT
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import solve_front

Floats = NDArray[np.float64]

ROUTE: Final = "flat-6km"
GTO_VEHICLE: Final = "re460-ic"
IGBT_VEHICLE: Final = "re460-ic-igbt"
TOP_SPEED_MPS: Final = 160 * KMH


def evaluated_at(trajectory: Trajectory, vehicle: Vehicle, level: Level) -> EnergyBalance:
    """Energy balance of any trajectory at any loss level, with the brakes of that level (cross-evaluation).

    Raises DasError if the vehicle has no such level or its loss map does not cover the trajectory.
    """
    total_n = trajectory.force_el_n + trajectory.force_friction_n
    faster_mps = np.maximum(trajectory.v_mps[:-1], trajectory.v_mps[1:])
    electric_n = vehicle.electric_effort_n(total_n, faster_mps, level, trajectory.supply)
    braked = replace(trajectory, force_el_n=electric_n, force_friction_n=total_n - electric_n)
    return braked.balance(vehicle, vehicle.loss_model(level))


def consumed_j(trajectory: Trajectory, vehicle: Vehicle, level: Level) -> float:
    """Energy (J) with which the paper compares trajectories at a level: the irreversible energy E_IC (eqs. 9 to 12).

    At L0 NOREG it is the positive wheel work (eq. 8), which counts the brakes' losses before they occur.
    """
    balance = evaluated_at(trajectory, vehicle, level)
    return balance.input if level is Level.L0_NOREG else balance.irreversible


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A loss model to plan or to evaluate with: a level of a train."""

    name: str
    label: str
    vehicle: str
    level: Level


L0_NOREG: Final = Variant(name="l0-noreg", label="L0 NOREG", vehicle=GTO_VEHICLE, level=Level.L0_NOREG)
L0_REG: Final = Variant(name="l0-reg", label="L0 REG", vehicle=GTO_VEHICLE, level=Level.L0_REG)
L1: Final = Variant(name="l1", label="L1", vehicle=GTO_VEHICLE, level=Level.L1)
L2: Final = Variant(name="l2", label="L2", vehicle=GTO_VEHICLE, level=Level.L2)
L3: Final = Variant(name="l3-gto", label="L3", vehicle=GTO_VEHICLE, level=Level.L3)
L3_IGBT: Final = Variant(name="l3-igbt", label="L3 IGBT", vehicle=IGBT_VEHICLE, level=Level.L3)
LEVELS: Final = (L0_NOREG, L0_REG, L1, L2, L3)
"""The columns of figs. 5, 7 and 9."""
ALL_VARIANTS: Final = (*LEVELS, L3_IGBT)
"""The columns of Table 2."""


def label(name: str) -> str:
    """The heading of a trajectory or level in a table."""
    labels = {"fastest": "fastest", "top-speed": "top speed", "l3-gto": "L3 GTO"}
    return labels.get(name) or next(v.label for v in ALL_VARIANTS if v.name == name)


@dataclass(frozen=True, kw_only=True)
class StudyCase:
    """A straight and level stretch with given speeds at both ends and a limit of 160 km/h."""

    name: str
    title: str
    length_m: float
    start_speed_mps: float = 0.0
    end_speed_mps: float = 0.0

    def section(self, vehicle: Vehicle, level: Level, longest_step_m: float | None = None) -> Section:
        """The section of the case with a train at a level; a given `longest_step_m` (m) bounds the decision steps.

        Raises DasError if the train cannot run it.
        """
        return build_section(
            load_route(ROUTE),
            vehicle,
            level=level,
            end_m=self.length_m,
            options=SectionOptions(
                start_speed_mps=self.start_speed_mps,
                end_speed_mps=self.end_speed_mps,
                longest_step_m=longest_step_m,
            ),
        )


ACCELERATION: Final = StudyCase(
    name="acceleration", title="0 to 160 km/h over 4 km", length_m=4 * KM, end_speed_mps=TOP_SPEED_MPS
)
DECELERATION: Final = StudyCase(
    name="deceleration", title="160 km/h to 0 over 4 km", length_m=4 * KM, start_speed_mps=TOP_SPEED_MPS
)
COMPLETE: Final = StudyCase(name="complete", title="standstill to standstill over 6 km", length_m=6 * KM)


@dataclass(frozen=True)
class PrintedSaving:
    """The printed saving of L3 over the other levels, in % of the fastest run's energy, all evaluated at L3.

    `up_to`: the paper gives the largest saving at `buffer_percent` or more, not the saving at that buffer.
    """

    case: str
    buffer_percent: float
    saving_percent: float
    up_to: bool


CRUISING_MINIMUM_KMH: Final = 63.0
"""Speed of the least energy per kilometre at L2 (section 4.2, fig. 4d)."""
LOWEST_CRUISE_KMH: Final = 20.0
"""Speed (km/h) below which the paper's grid only accelerates from standstill or brakes to it (section 4.1)."""
BUFFERS_PERCENT: Final = (0.0, 2.0, 7.0, 15.0, 25.0)
"""Travel time buffers drawn in figs. 5, 7 and 9, in addition to the largest."""
TABLE2_BUFFER_PERCENT: Final = 7.0
"""Buffer of Table 2 and of fig. 10 (sections 4.6, 4.7)."""

SAVINGS: Final = (
    PrintedSaving("acceleration", 2, 2.5, up_to=False),
    PrintedSaving("acceleration", 15, 4.0, up_to=True),
    PrintedSaving("deceleration", 2, 0.0, up_to=False),
    PrintedSaving("deceleration", 5, 2.0, up_to=False),
    PrintedSaving("deceleration", 15, 4.0, up_to=True),
)
"""Savings stated in the text (section 4.3 on fig. 6, section 4.4 on fig. 8).

The text's "very large buffers" are taken as 15 % and more."""

NOT_PRINTED: Final = float("nan")
TABLE2_LEVELS: Final = tuple(variant.name for variant in ALL_VARIANTS)
TABLE2: Final = {
    "fastest": (176.16, 48.51, 94.08, 97.33, 100.00, 92.23),
    "top-speed": (133.81, 40.74, 74.73, 81.15, 84.07, 76.16),
    "l0-noreg": (121.97, 40.80, 71.28, 78.41, 80.86, 75.35),
    "l0-reg": (134.29, 40.74, 74.92, 81.31, 84.16, 76.34),
    "l1": (121.98, 40.80, 71.27, 78.40, 81.71, 74.59),
    "l2": (121.98, 40.80, 71.27, 78.40, 81.71, 74.59),
    "l3-gto": (123.77, 40.79, 71.80, 78.83, 79.99, NOT_PRINTED),
    "l3-igbt": (125.29, 40.86, 72.06, 79.03, NOT_PRINTED, 73.50),
}
"""Table 2: 6 km, energy in % of the fastest run's at L3 GTO; rows by run, columns `TABLE2_LEVELS`."""

ENERGY_SHARES_PERCENT: Final = {
    "component_loss": 32.5,
    "resistance": 24.3,
    "friction_brake": 15.1,
    "comfort": 28.1,
}
"""Shares of the energy net of regeneration: 49 measured Intercity runs Zürich–Luzern (60 km, 2 intermediate stops)."""

ENERGY_MARGIN_RATIO = 2e-5
"""Largest difference from the least energy (relative to the fastest run's at L3) at which an energy counts as the
least: slower runs save nothing."""
START_WAY_M = 100.0
"""Distance from a start or to a stop on which a run may be slower than 20 km/h."""
TIE_RATIO = 1e-4
"""Loss that breaks ties at L0 REG, as a share of the wheel work in either direction: without losses, braking and
accelerating again cost nothing, and many runs of the same time have the same energy. The paper filters such runs."""
SLOWEST_SCAN = 80
"""Number of trip times at which the energy of a level is evaluated in the search for the least energy."""
TIME_MARGIN_S = 0.05
"""Tolerance (s) of the time of the slowest run."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slowest:
    """The run with the largest useful buffer ("max" in the paper's figures).

    `bound`: "least energy" if a slower run saves nothing more at its level, or "not below 20 km/h" if it would run
    slower than the paper's grid allows.
    """

    trajectory: Trajectory
    buffer_percent: float
    bound: str


def _with_ties_broken(vehicle: Vehicle) -> Vehicle:
    """The vehicle with a level L1 that is L0 REG except for the loss `TIE_RATIO`."""
    loss = EfficiencyLoss(traction_ratio=TIE_RATIO, brake_ratio=TIE_RATIO)
    return replace(vehicle, losses={**vehicle.losses, Level.L1: loss})


class Workbench:
    """The workbench, which solves each case and level once, on demand, and stores the result."""

    def __init__(self) -> None:
        self._vehicles: dict[str, Vehicle] = {}
        self._fronts: dict[tuple[StudyCase, Variant], Front] = {}
        self._slowest: dict[tuple[StudyCase, Variant], Slowest] = {}

    def vehicle(self, variant: Variant) -> Vehicle:
        """The train of a variant."""
        if variant.vehicle not in self._vehicles:
            self._vehicles[variant.vehicle] = load_vehicle(variant.vehicle)
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
        """The fastest run, which is the same at every level because the force limits are."""
        return self.front(case, L3).fastest().trajectory

    def time_s(self, case: StudyCase, buffer_percent: float) -> float:
        """Running time with a buffer (in % of the least running time)."""
        return self.fastest(case).time_s * (1 + buffer_percent * PERCENT)

    def run(self, case: StudyCase, variant: Variant, buffer_percent: float) -> Trajectory | None:
        """The least-energy run of a level with a buffer; None if the buffer exceeds the level's largest useful one."""
        if buffer_percent > self.slowest(case, variant).buffer_percent + 1e-9:
            return None
        return self.front(case, variant).trajectory(self.time_s(case, buffer_percent)).trajectory

    def energy_j(self, trajectory: Trajectory, variant: Variant) -> float:
        """The paper's energy for comparisons at a level: irreversible energy, or positive wheel work at L0 NOREG."""
        return consumed_j(trajectory, self.vehicle(variant), variant.level)

    def balance(self, trajectory: Trajectory, variant: Variant) -> EnergyBalance:
        """Energy balance of any run at a level."""
        return evaluated_at(trajectory, self.vehicle(variant), variant.level)

    def reference_j(self, case: StudyCase) -> float:
        """The reference energy (100 %), of the fastest run at L3 with the GTO map."""
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
    """Lowest speed of a run, without the first or last 100 m if it starts or ends there below 20 km/h.

    The nodes of the paper's grid are 100 m apart; below 20 km/h it has only starting and stopping (section 4.1).
    """
    s_m, v_mps = trajectory.s_m, trajectory.v_mps
    slow = LOWEST_CRUISE_KMH * KMH
    first_m = s_m[0] + (START_WAY_M if v_mps[0] < slow else 0.0)
    last_m = s_m[-1] - (START_WAY_M if v_mps[-1] < slow else 0.0)
    return float(v_mps[(s_m >= first_m) & (s_m <= last_m)].min())


def _first_time(holds: Callable[[float], bool], low_s: float, high_s: float) -> float:
    """The time (to within TIME_MARGIN_S) from which a condition holds, by bisection; it holds at `high_s`."""
    while high_s - low_s > TIME_MARGIN_S:
        middle = 0.5 * (low_s + high_s)
        low_s, high_s = (low_s, middle) if holds(middle) else (middle, high_s)
    return high_s
