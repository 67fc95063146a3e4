"""A solution: a run for a time, with its ledger and its certificate."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from das.domain.route import NEUTRAL
from das.domain.trajectory import Ledger, Trajectory, mean_resistance_n
from das.solver.section import LineProfile, Section

Floats = NDArray[np.float64]


class Fit(StrEnum):
    """How a trajectory relates to the time that was asked for."""

    ON_TIME = "on-time"
    LATE = "late"
    """The time is below the least possible: the trajectory is the fastest run."""
    EARLY = "early"
    """A slower run would cost more energy: the trajectory is the run of least energy."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """A trajectory with its ledger and certificate.

    `least_time_s` is the time of the fastest run from the same state. `lambda_w` is the price of time at the solution
    (W; inf for the fastest run). `bound_j` bounds the energy of any trajectory of this discretisation and time from
    below (the dual bound), and `gap_ratio` = (input − bound)/|input|. The gap can be slightly negative, because the
    trajectory is integrated more finely than the table behind the bound.
    """

    section: Section
    trajectory: Trajectory
    fit: Fit
    least_time_s: float
    requested_s: float
    lambda_w: float
    bound_j: float
    feasible: bool

    @cached_property
    def ledger(self) -> Ledger:
        """Where the energy goes, with the section's train and losses (J)."""
        return self.trajectory.ledger(self.section.vehicle, self.section.loss)

    @property
    def time_s(self) -> float:
        """Duration of the trajectory (s)."""
        return self.trajectory.time_s

    @property
    def gap_ratio(self) -> float:
        """Energy above the dual bound, as a share of the energy."""
        return (self.ledger.input - self.bound_j) / max(abs(self.ledger.input), 1.0)


def trajectory_on(section: Section, line: LineProfile, speeds: Floats) -> Trajectory:
    """Times and forces of a run given by its speeds at the nodes of `line`, which is the section or a part of it."""
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
