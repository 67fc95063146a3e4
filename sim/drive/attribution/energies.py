"""The energy of a driven leg, by the planned train: with the friction brake as used, and with the motors first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossMap
from das.domain.trajectory import Trajectory
from das.solver.section import Section
from sim.drive.attribution.motion import DrivenLeg
from sim.trips.estimate import estimate_run

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LegEnergies:
    """Energies at the current collector up to every sample of a leg (J), arrays of shape (samples,), 0 at the start.

    `ledger_j`: as measured; where nobody measured, `blended_j`. `blended_j`: the same motion with the planned train,
    motors and friction brake sharing the braking as recorded. `motors_j`: likewise, the motors braking first.
    `trajectory` is that last run; `index[i]` is the sample at its node i. `measured` tells whether `ledger_j` was.
    """

    ledger_j: Floats
    blended_j: Floats
    motors_j: Floats
    trajectory: Trajectory
    index: NDArray[np.intp]
    measured: bool


def leg_energies(section: Section, leg: DrivenLeg) -> LegEnergies:
    """The energies of a driven leg by inverse dynamics, and as measured."""
    motion = leg.motion
    driven = estimate_run(section, leg.time_s, motion.s_m, motion.speed_mps)
    nodes, index = np.arange(len(motion.s_m)), driven.index
    motors_j = np.interp(nodes, index, driven.energy_input_j)
    blended_j = motors_j
    if motion.friction_j is not None:
        extra_j = _blended_input_j(section, driven.trajectory, np.diff(motion.friction_j[index]))
        blended_j = np.interp(nodes, index, np.concatenate(([0.0], np.cumsum(extra_j))))
    measured = motion.input_j is not None
    ledger_j = blended_j if motion.input_j is None else motion.input_j - motion.input_j[0]
    return LegEnergies(
        ledger_j=ledger_j,
        blended_j=blended_j,
        motors_j=motors_j,
        trajectory=driven.trajectory,
        index=index,
        measured=measured,
    )


def _blended_input_j(section: Section, run: Trajectory, friction_j: Floats) -> Floats:
    """Energy of each interval (J) where the friction brake took `friction_j` of it and the motors the rest.

    The friction brake takes no more than the motion of the planned train asks of all brakes.
    """
    total_n = run.force_el_n + run.force_friction_n
    friction_n = np.maximum(-friction_j / np.diff(run.s_m), np.minimum(total_n, 0.0))
    electric_n, mean_mps = total_n - friction_n, run.mean_speed_mps()
    if isinstance(section.loss, LossMap):
        mean_mps = np.minimum(mean_mps, section.loss.speed_mps[-1])
        low_n = np.interp(mean_mps, section.loss.speed_mps, section.loss.force_low_n)
        high_n = np.interp(mean_mps, section.loss.speed_mps, section.loss.force_high_n)
        loss_j = section.loss.loss_w(np.clip(electric_n, low_n, high_n), mean_mps) * run.interval_s()
    else:
        loss_j = section.loss.loss_w(electric_n, mean_mps) * run.interval_s()
    gross_j = electric_n * np.diff(run.s_m) + loss_j
    return np.where(gross_j > 0, gross_j, np.clip(run.supply, 0.0, 1.0) * gross_j)
