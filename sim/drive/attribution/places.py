"""Energy by place: per 100 m and per stretch between limits, driven beside the optimum for the same times.

At each place counts the energy at the current collector less the rise of the kinetic energy, E(s) − m·ρ·v(s)²/2, driven
minus optimum. The potential energy is the same on both sides. What a train carries on as speed is therefore not
counted where it was drawn, but where it is lost; both runs begin and end standing, so that the differences sum to that
of the whole leg.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from das.solver.section import Section
from das.solver.solution import Solution
from sim.drive.attribution.energies import LegEnergies
from sim.drive.attribution.motion import DrivenLeg

Floats = NDArray[np.float64]

PLACE_M = 100.0
"""Length of a place (m)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Stretches of a leg, arrays of shape (stretches,): ends (m), times (s) and energies (J), driven and optimum.

    `driven_j` and `optimum_j` are drawn at the current collector there (fed back: negative). `lost_more_j` is by how
    much more energy the drive lost there than the optimum.
    """

    start_m: Floats
    end_m: Floats
    driven_s: Floats
    optimum_s: Floats
    driven_j: Floats
    optimum_j: Floats
    lost_more_j: Floats


def places_between(edges_m: Floats, leg: DrivenLeg, energies: LegEnergies, optimum: Solution) -> Places:
    """The energies between rising positions, of which the first and the last are the ends of the leg."""
    run, section, motion = optimum.trajectory, optimum.section, leg.motion
    inertial_kg = section.vehicle.inertial_mass_kg
    best_j = np.concatenate(([0.0], np.cumsum(run.input_j(run.loss_j(section.loss)))))
    moving = _rising(motion.s_m)
    # A train that stood a little beyond the end of the route was driven there all the same.
    driven_edges_m = np.concatenate((motion.s_m[:1], edges_m[1:-1], motion.s_m[-1:]))

    def driven(values: Floats) -> Floats:
        return np.diff(np.interp(driven_edges_m, motion.s_m[moving], values[moving]))

    def best(values: Floats) -> Floats:
        return np.diff(np.interp(edges_m, run.s_m, values))

    driven_kinetic_j, best_kinetic_j = 0.5 * inertial_kg * motion.speed_mps**2, 0.5 * inertial_kg * run.v_mps**2
    return Places(
        start_m=edges_m[:-1],
        end_m=edges_m[1:],
        driven_s=driven(leg.time_s),
        optimum_s=best(run.t_s),
        driven_j=driven(energies.ledger_j),
        optimum_j=best(best_j),
        lost_more_j=driven(energies.ledger_j - driven_kinetic_j) - best(best_j - best_kinetic_j),
    )


def even_edges(first_m: float, last_m: float) -> Floats:
    """The ends of the leg and every full 100 m between them (m)."""
    inside = np.arange(np.ceil(first_m / PLACE_M), np.floor(last_m / PLACE_M) + 1) * PLACE_M
    return _edges(first_m, inside, last_m)


def limit_edges(section: Section) -> Floats:
    """The ends of the leg and every change of its limit between them (m)."""
    changes = section.node_m[1:-1][np.diff(section.limit_mps) != 0]
    return _edges(section.start_m, changes, section.end_m)


def _edges(first_m: float, inside_m: Floats, last_m: float) -> Floats:
    kept = inside_m[(inside_m > first_m + 1.0) & (inside_m < last_m - 1.0)]
    return np.concatenate(([first_m], kept, [last_m]))


def _rising(s_m: Floats) -> NDArray[np.intp]:
    """Samples at places that rise: of those at one place the last, and at the end of the leg all are one."""
    return np.append(np.flatnonzero(np.diff(s_m) > 0), len(s_m) - 1)
