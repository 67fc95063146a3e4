"""How sure the energy above the optimum is where nobody measured it: each unknown of the train at either end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from das.domain.errors import DasError
from das.solver.solution import Fit
from das.solver.solve import solve_front
from sim.drive.above_optimum import likely_band, section_in
from sim.drive.attribution.account import Account, LegAccount
from sim.drive.attribution.energies import leg_energies
from sim.trips.estimate import DrivenCase, Unknown, one_by_one

MOST_LEGS: Final = 3
"""Drives of more legs are not asked: every unknown solves each leg twice anew."""


@dataclass(frozen=True, kw_only=True)
class LikelyRange:
    """The likely range (J) of the energy above the optimum, and that of each unknown on its own.

    Mass, resistance and wind are independent of each other, so their deviations add as squares. How the train braked is
    no deviation: `by_friction_j` is the energy above the optimum if the friction brake did all braking, in the drive
    and in its optimum; NaN where such a train could not have driven so, or where forces were measured.
    """

    low_j: float
    high_j: float
    by_friction_j: float
    unknowns: tuple[Unknown, ...]


def likely_range(account: Account) -> LikelyRange | None:
    """The likely range of what an estimated drive took above the optimum; None where it was measured, or is long.

    Train, wind and brakes are the same for the drive and its optimum in every case.
    """
    if account.measured or len(account.legs) > MOST_LEGS:
        return None

    def above_j(case: DrivenCase) -> float | None:
        found = [_above_j(leg, case) for leg in account.legs]
        return None if any(one is None for one in found) else sum(one for one in found if one is not None)

    unknowns = tuple(one for one in one_by_one(above_j) if one.high_j > one.low_j)
    likely = likely_band(account.difference_j, unknowns)
    known = any(leg.leg.motion.friction_j is not None for leg in account.legs)
    friction_j = None if known else above_j(DrivenCase(all_friction=True))
    return LikelyRange(
        low_j=likely.low_j,
        high_j=likely.high_j,
        by_friction_j=math.nan if friction_j is None else friction_j,
        unknowns=unknowns,
    )


def _above_j(leg: LegAccount, case: DrivenCase) -> float | None:
    """The energy above the optimum (J) of a leg in a case; None where such a train could not have driven so."""
    section, motion = leg.optimum.section, leg.leg.motion
    case = replace(case, jerk_psd_m2ps5=DrivenCase().jerk_psd_m2ps5)  # the motion is already smooth
    if motion.friction_j is not None:
        case = replace(case, all_friction=False)  # how the train braked was measured
    if case == DrivenCase():
        return leg.driven_j - leg.optimum_j
    try:
        other = section_in(section, case)
        best = solve_front(other).trajectory(leg.leg.trip_s)
    except DasError:
        return None
    if best.fit is Fit.LATE:
        return None
    return float(leg_energies(other, leg.leg).ledger_j[-1]) - best.ledger.input
