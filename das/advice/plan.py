"""A plan: the optimal continuation from a state, with what advice reads from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice import plan_kernels as kernels
from das.advice.classifying import classify_modes, four_modes, next_changes, without_short
from das.advice.settings import DEFAULT, ModeSettings
from das.domain.units import NS
from das.solver.section import Section
from das.solver.solution import Solution

Floats = NDArray[np.float64]


class Place(NamedTuple):
    """Where on a plan a position is: its interval, the planned speed (m/s), and the time since the plan's start (s)."""

    interval: int
    speed_mps: float
    time_s: float


@dataclass(frozen=True, eq=False)
class Plan:
    """A solution from a state, with what advice reads from it; arrays hold one value an interval unless stated."""

    made_ns: int
    solution: Solution
    force_n: Floats
    shown_force_n: Floats
    """The force shown with the mode (N): where a short mode is left out, no more than that of the mode before it."""
    modes: NDArray[np.int64]
    four_modes: NDArray[np.int64]
    next_change: NDArray[np.int64]
    """For each interval, the next one in which another mode begins (the number of intervals if there is none)."""
    next_four_change: NDArray[np.int64]
    """For each interval, the next one in which another of the four modes begins (their number if there is none)."""
    energy_j: Floats
    energy_after_j: Floats
    """For each interval, the energy of all later intervals (J)."""
    speed_w: Floats
    """v² at the nodes."""

    @classmethod
    def of(cls, solution: Solution, section: Section, now_ns: int, settings: ModeSettings = DEFAULT.modes) -> Plan:
        """The plan made at a moment from a solution of the section."""
        run = solution.trajectory
        energy_j = run.input_j(run.loss_j(section.loss))
        planned = classify_modes(solution, section, settings)
        modes = without_short(planned, run.t_s, settings)
        four = four_modes(modes, solution, section, settings)
        force_n = run.force_el_n + run.force_friction_n
        before = np.maximum.accumulate(np.where(modes == planned, np.arange(len(modes)), 0))
        return cls(
            made_ns=now_ns,
            solution=solution,
            force_n=force_n,
            shown_force_n=np.minimum(force_n, force_n[before]),
            modes=modes,
            four_modes=four,
            next_change=next_changes(modes),
            next_four_change=next_changes(four),
            energy_j=energy_j,
            energy_after_j=np.append(energy_j[:0:-1].cumsum()[::-1], 0.0),
            speed_w=run.v_mps**2,
        )

    def arrival_ns(self, now_ns: int, place: Place) -> int:
        """When a train that is at a place of the plan now arrives (ns since 1970)."""
        return now_ns + round((self.solution.time_s - place.time_s) / NS)

    def speeds_mps(self, s_m: Floats) -> Floats:
        """The planned speeds at positions (before and beyond the run: as at its ends)."""
        return np.asarray(np.sqrt(np.interp(s_m, self.solution.trajectory.s_m, self.speed_w)))

    def at(self, s_m: float) -> Place:
        """Where on the plan a position is (before and beyond the run: in its first, its last interval)."""
        run = self.solution.trajectory
        return Place(*kernels.place(s_m, run.s_m, run.t_s, run.v_mps, self.speed_w))

    def energy_to_go_j(self, interval: int, s_m: float) -> float:
        """The energy (J, at the current collector) from a position in an interval to the end."""
        run = self.solution.trajectory
        part = (run.s_m[interval + 1] - s_m) / (run.s_m[interval + 1] - run.s_m[interval])
        return float(self.energy_j[interval] * part + self.energy_after_j[interval])

    def ahead_m(self, here_s: float, count: int) -> Floats:
        """The planned positions (m) 1, 2 … `count` seconds after a time of the plan (s)."""
        run = self.solution.trajectory
        return np.asarray(np.interp(here_s + np.arange(1.0, count + 1.0), run.t_s, run.s_m))

    def horizon(self, here_s: float, section: Section, envelope_w: Floats, count: int) -> tuple[Floats, Floats]:
        """Planned speed (m/s) and force (N) of the next seconds; no speed is above what limits and the stop allow."""
        run, speeds, forces = self.solution.trajectory, np.empty(count), np.empty(count)
        kernels.horizon(
            here_s, run.s_m, run.t_s, run.v_mps, self.force_n, section.node_m, envelope_w, section.limit_mps,
            speeds, forces,
        )  # fmt: skip
        return speeds, forces
