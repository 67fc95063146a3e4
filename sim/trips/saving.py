"""What advice would have saved on a trip, and how far that is known.

The unknowns are the same for the optimum and for the trip.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Final, NamedTuple

from das.domain.errors import DasError
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from sim.trips.estimate import BRAKING, DrivenCase, EnergyRange, driven_energy, over_unknowns
from sim.trips.sections import DrivenSection
from sim.trips.settings import SMOOTHING


class LikelySaving(NamedTuple):
    """The likely range of a saving (J): the deviations of each unknown but the braking, added as squares."""

    low_j: float
    high_j: float


NOT_COMPARABLE: Final = "not comparable"
"""What every command says in the place of a saving, or of a distance to the optimum, that cannot be stated."""


def why_not_comparable(
    driven: Sequence[tuple[Solution, float]], *, whole: bool = True, direction_known: bool = True
) -> str:
    """Why a drive cannot be compared with its optimum, in words; nothing where it can.

    `driven` has the optimum of each section and the time (s) that the section took. A drive that is faster than its
    train can be has no optimum, nor has one that does not go from stand to stand at stops, or in an unknown direction.
    """
    late_s = math.fsum(best.time_s - trip_s for best, trip_s in driven)
    if any(best.fit is Fit.LATE for best, _ in driven):
        return (
            f"this train cannot arrive as early as the trip did: the optimum is its fastest run, {late_s:.1f} s later"
        )
    if not whole:
        return "the trip does not run from standstill to standstill at the stops"
    return "" if direction_known else "the direction of the trip is not known"


def saving_range(sections: Sequence[DrivenSection]) -> EnergyRange:
    """Energy as driven minus that of the optimum with the same arrivals (J), in every case of the unknowns.

    Train, wind and brakes are the same on both sides and in all sections; the smoothing concerns the record alone. A
    case in which the train could not have driven a section in its time is left out; the train as assumed could.
    """
    each = [_saved(section) for section in sections]

    def saved_j(case: DrivenCase) -> float | None:
        found = [saved(case) for saved in each]
        return None if any(one is None for one in found) else math.fsum(one for one in found if one is not None)

    return over_unknowns(saved_j)


def likely_saving(saved: EnergyRange) -> LikelySaving:
    """The likely range of a saving: mass, resistance, wind and smoothing are independent of each other.

    How the train braked is no deviation but another train; it is in the outermost range alone.
    """
    spread = [one for one in saved.unknowns if one.name != BRAKING]
    low_j = math.hypot(*(min(one.low_j - saved.estimate_j, 0.0) for one in spread))
    high_j = math.hypot(*(max(one.high_j - saved.estimate_j, 0.0) for one in spread))
    return LikelySaving(saved.estimate_j - low_j, saved.estimate_j + high_j)


def _saved(driven: DrivenSection) -> Callable[[DrivenCase], float | None]:
    """What is saved on a section (J) in a case; None where the train could not have driven it so."""
    section = driven.front.section
    driven_j = driven_energy(section, driven.matched)

    @cache
    def optimum_j(case: DrivenCase) -> float | None:
        try:
            other = driven.front if case == DrivenCase() else solve_front(section_in(section, case))
        except DasError:  # such a train cannot run here
            return None
        found = other.trajectory(driven.trip_s)
        return None if found.fit is Fit.LATE else found.ledger.input

    def saved_j(case: DrivenCase) -> float | None:
        least_j = optimum_j(replace(case, jerk_psd_m2ps5=SMOOTHING.jerk_psd_m2ps5))
        return None if least_j is None else driven_j(case) - least_j

    return saved_j


def section_in(section: Section, case: DrivenCase) -> Section:
    """The section with the train and the brakes of a case; raises DasError if that train cannot run there."""
    return build_section(
        section.route,
        case.train(section.vehicle),
        level=section.level,
        start_m=section.start_m,
        end_m=section.end_m,
        options=SectionOptions(
            start_speed_mps=section.start_speed_mps,
            end_speed_mps=section.end_speed_mps,
            point_mass=section.train_length_m == 0,
            brakes=case.brakes(section),
        ),
    )
