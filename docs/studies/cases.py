"""The problems of the paper (sections 4.3 to 4.7), the levels at which each is solved, and what the paper prints.

Source of all that is printed: Nold & Corman (2024), Railway Engineering Science, open access.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.files.load import load_route
from das.domain.losses import Level
from das.domain.route import Route, Stretches
from das.domain.units import KM, KMH
from das.domain.vehicle import Vehicle
from das.solver.section import Section, SectionOptions, build_section

Floats = NDArray[np.float64]

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


@dataclass(frozen=True)
class PrintedSaving:
    """What L3 saves against the other levels, in % of the fastest run's energy, all evaluated at L3.

    `up_to`: the paper gives the largest saving from `buffer_percent` on, not the one at it.
    """

    case: str
    buffer_percent: float
    saving_percent: float
    up_to: bool
    place: str


CRUISING_MINIMUM_KMH: Final = 63.0
"""Speed of the least energy per kilometre at L2 (section 4.2, fig. 4d)."""
CRUISING_DEVIATION_RATIO: Final = 0.005
"""Mean deviation of the L3 losses from their L2 fit when cruising (section 4.2, fig. 4b)."""
LOWEST_CRUISE_KMH: Final = 20.0
"""Below this the paper's grid only accelerates from, or brakes to, a standstill (section 4.1)."""
BUFFERS_PERCENT: Final = (0.0, 2.0, 7.0, 15.0, 25.0)
"""Travel time buffers drawn in figs. 5, 7 and 9, besides the largest."""
TABLE2_BUFFER_PERCENT: Final = 7.0
"""Buffer of Table 2 and of fig. 10 (sections 4.6, 4.7)."""

SAVINGS: Final = (
    PrintedSaving("acceleration", 2, 2.5, up_to=False, place="section 4.3 on fig. 6"),
    PrintedSaving("acceleration", 15, 4.0, up_to=True, place="section 4.3 on fig. 6"),
    PrintedSaving("deceleration", 2, 0.0, up_to=False, place="section 4.4 on fig. 8"),
    PrintedSaving("deceleration", 5, 2.0, up_to=False, place="section 4.4 on fig. 8"),
    PrintedSaving("deceleration", 15, 4.0, up_to=True, place="section 4.4 on fig. 8"),
)
"""Savings stated in the text. "Very large buffers" of the deceleration is read as 15 % and more."""

TABLE2_LEVELS: Final = ("l0-noreg", "l0-reg", "l1", "l2", "l3-gto", "l3-igbt")

TABLE2_ROWS: Final = {
    "fastest": (176.16, 48.51, 94.08, 97.33, 100.00, 92.23),
    "rms": (133.81, 40.74, 74.73, 81.15, 84.07, 76.16),
    "l0-noreg": (121.97, 40.80, 71.28, 78.41, 80.86, 75.35),
    "l0-reg": (134.29, 40.74, 74.92, 81.31, 84.16, 76.34),
    "l1": (121.98, 40.80, 71.27, 78.40, 81.71, 74.59),
    "l2": (121.98, 40.80, 71.27, 78.40, 81.71, 74.59),
    "l3-gto": (123.77, 40.79, 71.80, 78.83, 79.99, None),
    "l3-igbt": (125.29, 40.86, 72.06, 79.03, None, 73.50),
}
TABLE2_TRAJECTORIES: Final = tuple(TABLE2_ROWS)
TABLE2: Final[dict[tuple[str, str], float | None]] = {
    (trajectory, level): value
    for trajectory, row in TABLE2_ROWS.items()
    for level, value in zip(TABLE2_LEVELS, row, strict=True)
}
"""Table 2 by (trajectory, level): energy in % of the fastest run's at L3 GTO; None where none is printed."""

ENERGY_SHARES_PERCENT: Final = {
    "component_loss": 32.5,
    "resistance": 24.3,
    "friction_brake": 15.1,
    "comfort": 28.1,
}
"""Shares of the energy net of regeneration: 49 measured Intercity runs Zürich–Luzern (60 km, 2 intermediate stops)."""
