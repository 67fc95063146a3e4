"""Planes below the energy of an interval: no run needs less energy a metre than any of them."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import EfficiencyLoss, LossMap
from das.solver import tolerances as tol
from das.solver.bound.relaxation import LEAST_FORCE_N, Task
from das.solver.kernels.loss_planes import MapRows, MeanSpeeds, loss_planes, row_hulls
from das.solver.kernels.relaxed_tuples import Planes

Floats = NDArray[np.float64]

NEAR_FORCES_N: Final = (0.0, 8e3, -8e3)
"""A loss map gets a plane at the force of the given run, and at forces this much (N) beside it."""
NEAR_COASTING_N: Final = (-500.0, 500.0)
"""It gets planes on both sides of coasting (N), and at half of the largest forces."""
LIMIT_SLACK: Final = 1e-6
"""Runs keep the limits of their forces to within this ratio."""


def efficiency_planes(loss: EfficiencyLoss, supply: Floats) -> Planes:
    """The planes (N) of constant efficiencies and an idle power; the line takes the share `supply` of what is fed back.

    The energy per metre is the larger of gross and share·gross, and gross the larger of (1 + a)·f + idle·τ and
    (1 − b)·f + idle·τ: together exactly the largest of three planes, of two where the share is 1.
    """
    share = np.clip(supply, 0.0, 1.0)
    one = np.ones_like(share)
    driving, braking = 1.0 + loss.traction_ratio, 1.0 - loss.brake_ratio
    kinds = [(one, driving), (one, braking)] + ([] if (share == 1.0).all() else [(share, braking)])
    force = np.stack([weight * slope for weight, slope in kinds], axis=1)
    slowness = np.stack([weight * loss.idle_w for weight, _ in kinds], axis=1)
    return Planes(force, slowness, np.zeros_like(force), np.zeros_like(force))


class MapPlanes:
    """Planes (N) below the energy of a loss map for a task.

    Where the line does not take all that is fed back, each plane also counts with the share that it takes.
    """

    def __init__(self, task: Task, loss: LossMap) -> None:
        self.task = task
        self._rows = map_rows(task, loss)

    def of_run(self, force_n: Floats, lambda_w: float) -> Planes:
        """Planes near the given run, whose motors give `force_n` in each interval, at a price of time (W)."""
        train, speeds = self.task.section.train, self.task.speeds_mps
        offsets = [force_n + offset for offset in NEAR_FORCES_N]
        fixed = [*NEAR_COASTING_N, 0.5 * train.traction_force_n, -0.5 * train.electric_force_n]
        forces = np.stack(offsets + [np.full_like(force_n, force) for force in fixed], axis=1)
        squares = 0.5 * speeds**2
        state = MeanSpeeds(2.0 / (speeds[:-1] + speeds[1:]), squares[:-1] + squares[1:])
        return self.near(forces, state, lambda_w)

    def near(self, forces_n: Floats, state: MeanSpeeds, lambda_w: float) -> Planes:
        """Planes near the forces (n, planes) at a mean speed of each interval and a price of time (W)."""
        found = np.empty((*forces_n.shape, 4))
        loss_planes(
            np.ascontiguousarray(forces_n), state, lambda_w, (self.task.low_tau, self.task.high_tau), self._rows, found
        )
        share = np.clip(self.task.line.supply, 0.0, 1.0)
        if (share < 1.0).any():
            found = np.concatenate((found, share[:, None, None] * found), axis=1)
        return Planes(*(np.ascontiguousarray(found[:, :, i]) for i in range(4)))


def joined(planes: Planes, more: Planes) -> Planes:
    """The planes of both."""
    return Planes(*(np.concatenate(pair, axis=1) for pair in zip(planes, more, strict=True)))


def map_rows(task: Task, loss: LossMap) -> MapRows:
    """Energies per metre at the speeds and forces of the map that the task's train can reach."""
    train = task.section.train
    fastest_mps = float(task.envelope_mps.max()) + tol.SPEED_TOLERANCE_MPS
    size = min(int(np.searchsorted(loss.speed_mps, fastest_mps)) + 1, len(loss.speed_mps))
    speed = loss.speed_mps[1:size]
    slower = loss.speed_mps[: size - 1]
    psi = loss.force_n + loss.filled_w[1:size] / speed[:, None]
    # A force between two speeds is at most the limit at the slower one; the next force of the map is beyond it.
    most = np.minimum(train.traction_force_n, train.traction_power_w / np.maximum(slower, tol.CREEP_MPS))
    least = np.minimum(train.electric_force_n, train.electric_power_w / np.maximum(slower, tol.CREEP_MPS))
    allowed = 1.0 + LIMIT_SLACK
    last = np.minimum(np.searchsorted(loss.force_n, allowed * most + LEAST_FORCE_N), len(loss.force_n) - 1)
    first = np.maximum(np.searchsorted(loss.force_n, -allowed * least - LEAST_FORCE_N, side="right") - 1, 0)
    hull_force, hull_psi, count = np.empty_like(psi), np.empty_like(psi), np.empty(len(speed), np.int64)
    row_hulls(np.array(loss.force_n), psi, first, last, hull_force, hull_psi, count)
    standing_w = float(loss.filled_w[0, first[0] : last[0] + 1].min())
    return MapRows(1.0 / speed, standing_w, hull_force, hull_psi, count)
