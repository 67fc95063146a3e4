"""The problems of the paper (sections 4.3 to 4.7) and the levels at which each is solved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from das.domain.files.load import load_route
from das.domain.losses import Level
from das.domain.route import Route, Stretches
from das.domain.units import KM, KMH
from das.domain.vehicle import Vehicle
from das.solver.section import Section, SectionOptions, build_section

ROUTE: Final = "flat-6km"
GTO_VEHICLE: Final = "re460-ic"
IGBT_VEHICLE: Final = "re460-ic-igbt"
TOP_SPEED_MPS: Final = 160 * KMH


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A loss model to plan or to evaluate with: a level of a train."""

    name: str
    label: str
    vehicle: str
    level: Level


L0_NOREG: Final = Variant(name="l0-noreg", label="L0 NOREG", vehicle=GTO_VEHICLE, level=Level.L0_NOREG)
L0_REG: Final = Variant(name="l0-reg", label="L0 REG", vehicle=GTO_VEHICLE, level=Level.L0_REG)
L1: Final = Variant(name="l1", label="L1", vehicle=GTO_VEHICLE, level=Level.L1)
L2: Final = Variant(name="l2", label="L2", vehicle=GTO_VEHICLE, level=Level.L2)
L3: Final = Variant(name="l3-gto", label="L3", vehicle=GTO_VEHICLE, level=Level.L3)
L3_IGBT: Final = Variant(name="l3-igbt", label="L3 IGBT", vehicle=IGBT_VEHICLE, level=Level.L3)
LEVELS: Final = (L0_NOREG, L0_REG, L1, L2, L3)
"""The columns of figs. 5, 7 and 9."""
ALL_VARIANTS: Final = (*LEVELS, L3_IGBT)
"""The columns of Table 2."""


@dataclass(frozen=True, kw_only=True)
class StudyCase:
    """A straight stretch of constant gradient with given speeds at both ends; at most 160 km/h."""

    name: str
    title: str
    length_m: float
    start_speed_mps: float = 0.0
    end_speed_mps: float = 0.0
    gradient_ratio: float = 0.0

    def section(self, vehicle: Vehicle, level: Level, longest_step_m: float | None = None) -> Section:
        """The case with a train at a level, with no decision step longer than `longest_step_m` (m) where that is given.

        Raises DasError where the train cannot run it.
        """
        return build_section(
            self.route(),
            vehicle,
            level=level,
            end_m=self.length_m,
            options=SectionOptions(
                start_speed_mps=self.start_speed_mps,
                end_speed_mps=self.end_speed_mps,
                longest_step_m=longest_step_m,
            ),
        )

    def route(self) -> Route:
        """The bundled flat route, with the gradient of the case all along it."""
        gradients = Stretches(start_m=np.array([0.0]), value=np.array([self.gradient_ratio]))
        return replace(load_route(ROUTE), gradients_ratio=gradients)


ACCELERATION: Final = StudyCase(
    name="acceleration", title="0 to 160 km/h over 4 km", length_m=4 * KM, end_speed_mps=TOP_SPEED_MPS
)
DECELERATION: Final = StudyCase(
    name="deceleration", title="160 km/h to 0 over 4 km", length_m=4 * KM, start_speed_mps=TOP_SPEED_MPS
)
COMPLETE: Final = StudyCase(name="complete", title="standstill to standstill over 6 km", length_m=6 * KM)
UPHILL: Final = StudyCase(name="uphill", title="6 km at +10 ‰", length_m=6 * KM, gradient_ratio=0.010)
DOWNHILL: Final = StudyCase(name="downhill", title="6 km at −10 ‰", length_m=6 * KM, gradient_ratio=-0.010)
