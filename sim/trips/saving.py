"""What advice would have saved on a trip, and how far that is known.

The unknowns are the same for the optimum and for the trip.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from das.domain.errors import DasError
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit
from das.solver.solve import solve_front
from sim.trips.estimate import DrivenCase, EnergyRange, driven_energy, over_unknowns
from sim.trips.matching import MatchedTrip
from sim.trips.settings import SMOOTHING


def saving_range(front: Front, matched: MatchedTrip, trip_s: float) -> EnergyRange:
    """Energy as driven minus that of the optimum with the same arrival (J), in every case of the unknowns.

    Train, wind and brakes are the same on both sides; the smoothing concerns the record alone. A case in which the
    train could not have arrived after `trip_s` is left out. `front` is that of the train as assumed, which could.
    """
    section = front.section
    driven_j = driven_energy(section, matched)

    @cache
    def optimum_j(case: DrivenCase) -> float | None:
        try:
            other = front if case == DrivenCase() else solve_front(section_in(section, case))
        except DasError:  # such a train cannot run here
            return None
        found = other.trajectory(trip_s)
        return None if found.fit is Fit.LATE else found.ledger.input

    def saved_j(case: DrivenCase) -> float | None:
        least_j = optimum_j(replace(case, jerk_psd_m2ps5=SMOOTHING.jerk_psd_m2ps5))
        return None if least_j is None else driven_j(case) - least_j

    return over_unknowns(saved_j)


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
