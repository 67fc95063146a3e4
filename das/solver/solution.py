"""A solution: a trajectory for a trip time, with its energy balance and its certificate."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from das.domain.route import NEUTRAL
from das.domain.summary import Summary, needs
from das.domain.trajectory import EnergyBalance, Trajectory, mean_resistance_n
from das.solver.line_profile import LineProfile
from das.solver.section import Section

if TYPE_CHECKING:
    from das.offline.bound import Certificate

Floats = NDArray[np.float64]


class Fit(StrEnum):
    """Relation of a trajectory to the requested time."""

    ON_TIME = "on-time"
    LATE = "late"
    """The requested time is below the minimum; the trajectory is the fastest one."""
    EARLY = "early"
    """A slower trajectory would need more energy; the trajectory of least energy arrives before the requested time."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Solution(Summary):
    """A trajectory with its energy balance and certificate.

    `least_time_s` is the time of the fastest trajectory from the same state. `lambda_w` is the price of time at the
    solution (W; inf for the fastest trajectory).

    `certificate` proves a lower bound of the energy (`docs/explanation/bounds.md`). It is computed on first access,
    unless a longer search has supplied it as `proven`; `bound_j`, `gap_ratio` and `gap_reason` are taken from it.
    """

    section: Section
    trajectory: Trajectory
    fit: Fit
    least_time_s: float
    requested_s: float
    lambda_w: float
    feasible: bool
    proven: Certificate | None = None

    @cached_property
    def balance(self) -> EnergyBalance:
        """The energy balance with the section's train and losses (J)."""
        return self.trajectory.balance(self.section.vehicle, self.section.loss)

    def facts(self) -> dict[str, str]:
        """The section's facts, the trajectory's time and energy, and the excess of its time over the minimum."""
        buffer = 100.0 * (self.time_s / self.least_time_s - 1.0)
        return {
            **self.section.facts(),
            "needs": needs(self.time_s, self.balance.input),
            "buffer": f"{buffer:.1f} %",
            "fit": str(self.fit),
        }

    @cached_property
    def time_s(self) -> float:
        """Duration of the trajectory (s)."""
        return self.trajectory.time_s

    @property
    def saves_time(self) -> bool:
        """Whether the trajectory of least energy takes less than the requested time, and is therefore the solution."""
        return self.fit is Fit.EARLY

    @cached_property
    def certificate(self) -> Certificate:
        """The proven lower bound of the energy, or the reason why there is none."""
        from das.offline.bound import certificate

        return certificate(self) if self.proven is None else self.proven

    @property
    def bound_j(self) -> float:
        """A lower bound (J) of the energy of any trajectory of this time; NaN if none is proven (see `gap_reason`)."""
        return self.certificate.bound_j

    @property
    def gap_ratio(self) -> float:
        """(input − bound)/|input|, never negative; NaN if no bound is proven (see `gap_reason`)."""
        return (self.balance.input - self.bound_j) / max(abs(self.balance.input), 1.0)

    @property
    def gap_reason(self) -> str:
        """Why no bound is proven; empty if a bound is proven."""
        return self.certificate.reason


def trajectory_on(section: Section, line: LineProfile, speeds: Floats) -> Trajectory:
    """The trajectory with these speeds at the nodes of `line`, which is the section or a part of it."""
    train, vehicle = section.train, section.vehicle
    step = line.step_m
    running = mean_resistance_n(vehicle.resistance, speeds, line.tunnel_n_per_mps2)
    force = train.inertial_mass_kg * np.diff(speeds**2) / (2.0 * step) + running + line.constant_n
    faster = np.maximum(speeds[:-1], speeds[1:])
    if train.friction_force_n == 0 and not train.brakes_dissipate:
        electric = np.where(line.supply == NEUTRAL, 0.0, force)
        force = electric
    else:
        electric = vehicle.electric_effort_n(force, faster, section.level, line.supply)
    return Trajectory(
        s_m=line.node_m,
        t_s=line.elapsed_s(speeds),
        v_mps=speeds,
        force_el_n=electric,
        force_friction_n=force - electric,
        grade_ratio=line.grade_ratio,
        grade_and_curve_n=line.constant_n,
        tunnel_n_per_mps2=line.tunnel_n_per_mps2,
        limit_mps=line.limit_mps,
        supply=line.supply,
    )
