"""A plan: the optimal continuation from a state, with what advice reads from it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice import plan_kernels as kernels
from das.domain.units import KMH
from das.solver.section import Section
from das.solver.solution import Solution

Floats = NDArray[np.float64]

MODE_HOLD_S = 3.0
"""A new mode is shown only after the one before has lasted this long, unless it asks for less effort or brakes."""
FULL_EFFORT_RATIO = 0.97
IDLE_EFFORT_RATIO = 0.02
"""Effort over this share of the largest is full; under this one it is none."""
CRUISE_ACCELERATION_MPS2 = 0.02
RIPPLE_MPS = 2.0 * KMH
"""Speeds within so much of each other are one speed to hold: nobody holds it more closely."""
LONGEST_RATIO = 2.5
"""No run is planned to take more than this times the least time from its state: where much more is left, the train
arrives early and waits at the stop rather than crawl (without idle losses, the least energy is a crawl)."""


class Mode(IntEnum):
    """What to do with the controller; the numbers are those of the bus message."""

    NONE = 0
    FULL_TRACTION = 1
    REDUCED_TRACTION = 2
    CRUISE = 3
    COAST = 4
    REDUCED_BRAKE = 5
    FULL_BRAKE = 6
    FRICTION_BRAKE = 7
    STOP = 8


ROLLING = np.array([Mode.REDUCED_TRACTION, Mode.COAST], dtype=np.int64)
"""Modes that are cruising as well between two stretches of it, where the speed changes by no more than a ripple."""
FOUR_MODES = np.arange(len(Mode))
"""Each mode as one of the four that the simplest display knows: traction, a speed to hold, coast, brake."""
FOUR_MODES[[Mode.REDUCED_TRACTION, Mode.REDUCED_BRAKE, Mode.FRICTION_BRAKE]] = (
    Mode.CRUISE,
    Mode.FULL_BRAKE,
    Mode.FULL_BRAKE,
)


WEAK_BRAKE_RATIO = 0.6
"""Less than this share of the electric brake is coasting to who knows full brakes only: he would brake too early."""


class Place(NamedTuple):
    """Where on a plan a position is: its interval, the planned speed (m/s), and the time since the plan's start (s)."""

    interval: int
    speed_mps: float
    time_s: float


@dataclass(frozen=True, eq=False)
class Plan:
    """A solution from a state, with what advice reads from it; one value an interval where not said otherwise."""

    made_ns: int
    solution: Solution
    force_n: Floats
    shown_force_n: Floats
    """The force that goes with the mode: where a short one is left out, no more than that of the mode before it."""
    modes: NDArray[np.int64]
    four_modes: NDArray[np.int64]
    next_change: NDArray[np.int64]
    """The interval in which another mode begins (the number of intervals: none does)."""
    next_four_change: NDArray[np.int64]
    """The same of the four modes."""
    energy_j: Floats
    energy_after_j: Floats
    """Of all intervals behind this one."""
    speed_w: Floats
    """v² at the nodes."""

    @classmethod
    def of(cls, solution: Solution, section: Section, now_ns: int) -> Plan:
        """The plan made at a moment from a solution of the section."""
        run = solution.trajectory
        energy_j = run.input_j(run.loss_j(section.loss))
        planned = classify_modes(solution, section)
        modes = without_short(planned, run.t_s)
        four_modes = _four_modes(modes, solution, section)
        force_n = run.force_el_n + run.force_friction_n
        before = np.maximum.accumulate(np.where(modes == planned, np.arange(len(modes)), 0))
        return cls(
            made_ns=now_ns,
            solution=solution,
            force_n=force_n,
            shown_force_n=np.minimum(force_n, force_n[before]),
            modes=modes,
            four_modes=four_modes,
            next_change=_next_changes(modes),
            next_four_change=_next_changes(four_modes),
            energy_j=energy_j,
            energy_after_j=np.append(energy_j[:0:-1].cumsum()[::-1], 0.0),
            speed_w=run.v_mps**2,
        )

    def speeds_mps(self, s_m: Floats) -> Floats:
        """The planned speeds at positions (before and beyond the run: as at its ends)."""
        return np.asarray(np.sqrt(np.interp(s_m, self.solution.trajectory.s_m, self.speed_w)))

    def at(self, s_m: float) -> Place:
        """Where on the plan a position is (before and beyond the run: at its first, its last interval)."""
        run = self.solution.trajectory
        return Place(*kernels.place(s_m, run.s_m, run.t_s, run.v_mps, self.speed_w))

    def horizon(self, here_s: float, section: Section, envelope_w: Floats, count: int) -> tuple[Floats, Floats]:
        """Speed and force at the next seconds, never above what limits and the stop allow there."""
        run, speeds, forces = self.solution.trajectory, np.empty(count), np.empty(count)
        kernels.horizon(
            here_s, run.s_m, run.t_s, run.v_mps, self.force_n, section.node_m, envelope_w, section.limit_mps,
            speeds, forces,
        )  # fmt: skip
        return speeds, forces


def _next_changes(modes: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each interval that in which another mode begins."""
    changes = np.append(np.flatnonzero(np.diff(modes)) + 1, len(modes))
    return np.asarray(changes[np.searchsorted(changes, np.arange(len(modes)), side="right")])


def _four_modes(modes: NDArray[np.int64], solution: Solution, section: Section) -> NDArray[np.int64]:
    """The four modes of intervals."""
    run = solution.trajectory
    electric_n = section.vehicle.electric_brake_effort_n(np.maximum(run.mean_speed_mps(), 1e-3))
    weak = (modes == Mode.REDUCED_BRAKE) & (-run.force_el_n < WEAK_BRAKE_RATIO * electric_n)
    return np.where(weak, int(Mode.COAST), FOUR_MODES[modes])


def classify_modes(solution: Solution, section: Section) -> NDArray[np.int64]:
    """Mode of each interval of a run, by its forces against what is available and its acceleration.

    Between two stretches of cruising a train that keeps its speed within `RIPPLE_MPS` is cruising as well: to say coast
    and traction in turn would ask for what holding the speed does by itself.
    """
    run, train, vehicle = solution.trajectory, section.train, section.vehicle
    mean = np.maximum(run.mean_speed_mps(), 1e-3)
    rate = np.diff(run.v_mps) / np.maximum(run.interval_s(), 1e-9)
    fastest_rate = FULL_EFFORT_RATIO * train.max_acceleration_mps2
    hardest_rate = -FULL_EFFORT_RATIO * train.max_deceleration_mps2
    accelerating = np.abs(rate) > CRUISE_ACCELERATION_MPS2
    traction, electric = vehicle.traction_effort_n(mean), vehicle.electric_brake_effort_n(mean)
    idle = IDLE_EFFORT_RATIO * train.traction_force_n
    force, friction = run.force_el_n, run.force_friction_n
    modes = np.select(
        [
            friction < -idle,
            ~accelerating & (np.abs(force) > idle),
            (force >= FULL_EFFORT_RATIO * traction) | ((force > idle) & (rate >= fastest_rate)),
            force > idle,
            ((force <= -FULL_EFFORT_RATIO * electric) & (electric > 0)) | ((force < -idle) & (rate <= hardest_rate)),
            force < -idle,
        ],
        [
            Mode.FRICTION_BRAKE,
            Mode.CRUISE,
            Mode.FULL_TRACTION,
            Mode.REDUCED_TRACTION,
            Mode.FULL_BRAKE,
            Mode.REDUCED_BRAKE,
        ],
        Mode.COAST,
    )
    return np.asarray(kernels.without_ripples(modes.astype(np.int64), run.v_mps, int(Mode.CRUISE), ROLLING, RIPPLE_MPS))


def without_short(modes: NDArray[np.int64], t_s: Floats) -> NDArray[np.int64]:
    """Modes per interval without those that end sooner than they can be followed (in all not longer than that).

    They are as the one before; brakes are never left out.
    """
    return np.asarray(kernels.without_short(modes, t_s, int(Mode.REDUCED_BRAKE), MODE_HOLD_S))
