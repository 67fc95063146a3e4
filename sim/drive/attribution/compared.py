"""A driven leg beside its optimum, and how far the energy above the optimum of an estimated drive may be wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Final

from das.domain.errors import DasError
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from sim.drive.above_optimum import EnergyBand, SectionEnergy
from sim.drive.attribution.driven_legs import DrivenLeg, LegEnergies, leg_energies
from sim.trips.estimate import BRAKING, DrivenCase, EnergyRange, Unknown, one_by_one, over_unknowns

MOST_LEGS: Final = 3
"""The likely range of a drive of more legs is not asked for: every unknown solves each leg twice anew."""

Smoothed = Callable[[float], Sequence[DrivenLeg]]
"""The legs of a drive whose record is smoothed with another density of the jerk (m²/s⁵)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ComparedLeg:
    """A driven leg, all best runs of the planned train, the one in the time as driven, and the energies as driven.

    The line has no temporary restrictions.
    """

    leg: DrivenLeg
    front: Front
    optimum: Solution
    energies: LegEnergies

    @classmethod
    def of(cls, leg: DrivenLeg, front: Front) -> ComparedLeg:
        """A driven leg beside the best runs of its section."""
        optimum, energies = front.trajectory(leg.trip_s), leg_energies(front.section, leg)
        return cls(leg=leg, front=front, optimum=optimum, energies=energies)

    @property
    def driven_j(self) -> float:
        """Energy at the current collector as driven (J)."""
        return float(self.energies.balance_j[-1])

    @property
    def optimum_j(self) -> float:
        """Least energy for the same time (J)."""
        return self.optimum.balance.input

    @property
    def section_energy(self) -> SectionEnergy:
        """The energies of the leg as driven and of its optimum."""
        names = self.leg.start.name, self.leg.end.name
        found = SectionEnergy.of(*names, self.leg.trip_s, self.driven_j, self.optimum)
        return replace(found, optimum_j=self.optimum_j)


def likely_band(middle_j: float, unknowns: Iterable[Unknown]) -> EnergyBand:
    """The likely band of an energy: its unknowns are independent of each other, so that deviations add as squares.

    How the train braked is no deviation but another train; it is in the outermost range alone.
    """
    spread = [one for one in unknowns if one.name != BRAKING]
    low_j = math.hypot(*(min(one.low_j - middle_j, 0.0) for one in spread))
    high_j = math.hypot(*(max(one.high_j - middle_j, 0.0) for one in spread))
    return EnergyBand(middle_j - low_j, middle_j + high_j)


def range_above(legs: Sequence[ComparedLeg], smoothed: Smoothed) -> EnergyRange:
    """Energy of a trip as driven minus that of the optimum with the same arrivals (J), in every case of the unknowns.

    Train, wind and brakes are the same on both sides and in all legs; the smoothing concerns the record alone. A case
    in which the train could not have driven a leg in its time is left out; the train as assumed could.
    """
    return over_unknowns(_above_in_cases(legs, smoothed))


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


def likely_range(legs: Sequence[ComparedLeg]) -> LikelyRange | None:
    """The likely range of what a drive took above the optimum, by energies that are estimated; None where it is long.

    Train, wind and brakes are the same for the drive and its optimum in every case.
    """
    if len(legs) > MOST_LEGS:
        return None
    above_j = _above_in_cases(legs)
    unknowns = tuple(one for one in one_by_one(above_j) if one.high_j > one.low_j)
    likely = likely_band(sum(one.driven_j for one in legs) - sum(one.optimum_j for one in legs), unknowns)
    known = any(leg.leg.motion.friction_j is not None for leg in legs)
    friction_j = None if known else above_j(DrivenCase(all_friction=True))
    return LikelyRange(
        low_j=likely.low_j,
        high_j=likely.high_j,
        by_friction_j=math.nan if friction_j is None else friction_j,
        unknowns=unknowns,
    )


def _above_in_cases(
    legs: Sequence[ComparedLeg], smoothed: Smoothed | None = None
) -> Callable[[DrivenCase], float | None]:
    """The energy above the optimum (J) in a case; None where such a train could not have driven so.

    Without `smoothed` the motion is taken as it is, however the record may be smoothed.
    """
    best_runs = [cache(partial(_best_run, one)) for one in legs]
    again = None if smoothed is None else cache(smoothed)
    as_assumed = DrivenCase().jerk_psd_m2ps5

    def above_j(case: DrivenCase) -> float | None:
        jerk, case = case.jerk_psd_m2ps5, replace(case, jerk_psd_m2ps5=as_assumed)
        driven = [one.leg for one in legs] if again is None or jerk == as_assumed else again(jerk)
        total_j = 0.0
        for one, leg, best_run in zip(legs, driven, best_runs, strict=True):
            # How the train braked is no unknown where it was measured.
            best = best_run(case if leg.motion.friction_j is None else replace(case, all_friction=False))
            if best is None:
                return None
            same = best is one.optimum and leg is one.leg
            driven_j = one.driven_j if same else float(leg_energies(best.section, leg).balance_j[-1])
            total_j += driven_j - best.balance.input
        return total_j

    return above_j


def _best_run(one: ComparedLeg, case: DrivenCase) -> Solution | None:
    """The best run of a leg in a case; None where such a train could not have driven so."""
    if case == DrivenCase():
        return one.optimum
    try:
        best = solve_front(section_in(one.front.section, case)).trajectory(one.leg.trip_s)
    except DasError:  # such a train cannot run here
        return None
    return None if best.fit is Fit.LATE else best


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
