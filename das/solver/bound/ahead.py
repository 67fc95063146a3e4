"""Whether no run is ever ahead of the fastest one, and what follows from that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from das.solver.bound.relaxation import Task, acceleration_limits
from das.solver.kernels.fastest import fastest_roll_out
from das.solver.kernels.forces import adhesion_coefficient
from das.solver.params import NO_LIMIT_N, TrainParams


def fastest_is_ahead(task: Task) -> bool:
    """Whether it is sure that no run is anywhere faster than the fastest one.

    That is so where the speed after an interval at full traction rises with the speed before it. The force that the
    motors lose and the resistance gains by a faster start must be below the inertia (`docs/explanation/bounds.md`).
    """
    train, line = task.section.train, task.line
    if not _never_slips(train) or not _keeps_acceleration(task):
        return False
    lost = train.traction_force_n**3 / train.traction_power_w**2 + train.c2_n_per_mps2 + line.tunnel_n_per_mps2
    lost_in_all = line.step_m * lost + (2.0 / 3.0) * abs(train.c1_n_per_mps) * task.allowed_s
    return bool((lost_in_all < train.inertial_mass_kg).all())


def behind_fastest(task: Task) -> Task:
    """The same task with the fastest run as a bound of the speed; only where that is ahead of all others."""
    speeds = np.empty_like(task.envelope_mps)
    speeds[0] = task.speeds_mps[0]
    fastest_roll_out(task.line.for_kernels, task.envelope_mps, task.section.train, speeds)
    return replace(task, envelope_mps=np.minimum(task.envelope_mps, speeds))


def _never_slips(train: TrainParams) -> bool:
    """Whether force and power limit the traction at every speed before adhesion does."""
    if train.adhesive_force_n >= NO_LIMIT_N:
        return True
    corner_mps = train.traction_power_w / max(train.traction_force_n, 1.0)
    return bool(train.adhesive_force_n * adhesion_coefficient(corner_mps) >= train.traction_force_n)


def _keeps_acceleration(task: Task) -> bool:
    """Whether the brakes keep the largest acceleration on every descent, if there is one."""
    train, line = task.section.train, task.line
    lowest_n = train.c0_n + line.constant_n + min(train.c1_n_per_mps, 0.0) * float(task.envelope_mps.max())
    limits = acceleration_limits(task, lowest_n)
    return bool((limits < NO_LIMIT_N).all()) or train.max_acceleration_mps2 >= 1e5
