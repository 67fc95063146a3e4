"""A plan: a trajectory from the train's state to the end of the section, with the mode of each of its intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice import kernels
from das.advice.regimes import FULL_RATIO, Regime
from das.domain.units import KMH
from das.solver.section import Section
from das.solver.solution import Solution

IDLE_EFFORT_RATIO: Final = 0.02
"""Share of the largest traction force below which a force counts as none."""
CRUISE_ACCELERATION_MPS2: Final = 0.02
"""Acceleration (m/s²) below which a train counts as holding its speed."""
RIPPLE_MPS: Final = 2.0 * KMH
"""Range of speeds (m/s) that counts as one speed to hold: drivers do not hold a speed more closely."""
HOLD_S: Final = 3.0
"""Least duration (s) of a mode before one with more traction or less braking is shown."""

Floats = NDArray[np.float64]


def classify_modes(solution: Solution, section: Section) -> NDArray[np.int64]:
    """The mode of each interval of a trajectory, from its acceleration and its share of the available force.

    A stretch between two stretches of cruising counts as cruising too if its speed changes by less than `RIPPLE_MPS`.
    """
    run, train, vehicle = solution.trajectory, section.train, section.vehicle
    mean = np.maximum(run.mean_speed_mps(), 1e-3)
    rate = np.diff(run.v_mps) / np.maximum(run.interval_s(), 1e-9)
    fastest_rate, hardest_rate = FULL_RATIO * train.max_acceleration_mps2, -FULL_RATIO * train.max_deceleration_mps2
    accelerating = np.abs(rate) > CRUISE_ACCELERATION_MPS2
    traction, electric = vehicle.traction_effort_n(mean), vehicle.electric_brake_effort_n(mean)
    idle = IDLE_EFFORT_RATIO * train.traction_force_n
    force, friction = run.force_el_n, run.force_friction_n
    modes = np.select(
        [
            friction < -idle,
            ~accelerating & (np.abs(force) > idle),
            (force >= FULL_RATIO * traction) | ((force > idle) & (rate >= fastest_rate)),
            force > idle,
            ((force <= -FULL_RATIO * electric) & (electric > 0)) | ((force < -idle) & (rate <= hardest_rate)),
            force < -idle,
        ],
        [
            *(Regime.FRICTION_BRAKE, Regime.CRUISE, Regime.FULL_TRACTION),
            *(Regime.REDUCED_TRACTION, Regime.FULL_BRAKE, Regime.REDUCED_BRAKE),
        ],
        Regime.COAST,
    )
    return np.asarray(kernels.without_ripples(modes.astype(np.int64), run.v_mps, RIPPLE_MPS))


class Place(NamedTuple):
    """A position on a plan: its interval, the planned speed there (m/s), and the planned time since the start (s)."""

    interval: int
    speed_mps: float
    time_s: float


@dataclass(frozen=True, eq=False)
class Plan:
    """A solution from the train's state, with a value of each quantity of the advice for each interval."""

    made_ns: int
    solution: Solution
    force_n: Floats
    shown_force_n: Floats
    """The force shown with the mode (N); where a short mode was replaced, at most the force of the mode before."""
    modes: NDArray[np.int64]
    next_change: NDArray[np.int64]
    """The index of the next interval with another mode, for each interval (number of intervals if there is none)."""
    energy_j: Floats
    energy_after_j: Floats
    """The energy of all later intervals (J), for each interval."""
    speed_w: Floats
    """v² at the nodes (m²/s²)."""

    @classmethod
    def of(cls, solution: Solution, section: Section, now_ns: int) -> Plan:
        """The plan that follows a solution of the section; `now_ns` is when it is made."""
        run = solution.trajectory
        energy_j = run.input_j(run.loss_j(section.loss))
        planned = classify_modes(solution, section)
        modes = kernels.without_short(planned, run.t_s, HOLD_S)
        force_n = run.force_el_n + run.force_friction_n
        changes = np.append(np.flatnonzero(np.diff(modes)) + 1, len(modes))
        before = np.maximum.accumulate(np.where(modes == planned, np.arange(len(modes)), 0))
        return cls(
            made_ns=now_ns,
            solution=solution,
            force_n=force_n,
            shown_force_n=np.minimum(force_n, force_n[before]),
            modes=modes,
            next_change=changes[np.searchsorted(changes, np.arange(len(modes)), side="right")],
            energy_j=energy_j,
            energy_after_j=np.append(energy_j[:0:-1].cumsum()[::-1], 0.0),
            speed_w=run.v_mps**2,
        )

    def at(self, s_m: float) -> Place:
        """The place of a position (m) on the plan; beyond either end of the plan, that end."""
        run = self.solution.trajectory
        return Place(*kernels.place(s_m, run.s_m, run.t_s, run.v_mps, self.speed_w))

    def energy_to_go_j(self, interval: int, s_m: float) -> float:
        """The planned energy (J, at the current collector) from a position in an interval to the end."""
        run = self.solution.trajectory
        part = (run.s_m[interval + 1] - s_m) / (run.s_m[interval + 1] - run.s_m[interval])
        return float(self.energy_j[interval] * part + self.energy_after_j[interval])
