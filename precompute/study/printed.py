"""What Nold & Corman (2024) print, as data, each with its place; "Railway Engineering Science", open access."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, kw_only=True)
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
    PrintedSaving(
        case="acceleration", buffer_percent=2, saving_percent=2.5, up_to=False, place="section 4.3 on fig. 6"
    ),
    PrintedSaving(
        case="acceleration", buffer_percent=15, saving_percent=4.0, up_to=True, place="section 4.3 on fig. 6"
    ),
    PrintedSaving(
        case="deceleration", buffer_percent=2, saving_percent=0.0, up_to=False, place="section 4.4 on fig. 8"
    ),
    PrintedSaving(
        case="deceleration", buffer_percent=5, saving_percent=2.0, up_to=False, place="section 4.4 on fig. 8"
    ),
    PrintedSaving(
        case="deceleration", buffer_percent=15, saving_percent=4.0, up_to=True, place="section 4.4 on fig. 8"
    ),
)
"""Savings stated in the text. "Very large buffers" of the deceleration is read as 15 % and more."""

TABLE2_TRAJECTORIES: Final = ("fastest", "rms", "l0-noreg", "l0-reg", "l1", "l2", "l3-gto", "l3-igbt")
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
