"""Colours and line styles that all pictures on white share, here and in `sim.review`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

BACKGROUND, INK, GRID = "#ffffff", "#222222", "#d9d9d9"
QUIET, SOFT = "#888888", "#555555"
"""Curves and words of secondary importance."""
LIMIT: Final = "#8c1d18"
"""The speed limit, wherever it is drawn on white."""
SEVERAL: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
"""Colours of runs or drives that are compared, or of groups, in their order: those of Okabe and Ito, which people with
any colour vision can distinguish. No colour has a fixed meaning; lines differ in style as well."""
LINES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
"""Line styles of runs or drives that are compared, in their order."""
MODES: Final = {
    "full traction": "#7a9a2e",
    "reduced traction": "#bccf7a",
    "cruise": "#6f86a6",
    "coast": "#d8d2c4",
    "reduced brake": "#e3b3c6",
    "full brake": "#c4739a",
    "friction brake": "#84345f",
    "stop": "#4c4654",
    "depart": "#664d80",
}
"""Colours of the advised modes, as patches in lanes; the same on either background."""


def look_of(number: int, colors: Sequence[str] = SEVERAL) -> dict[str, Any]:
    """Colour and line style of the run or drive with a number, counted from 0; the first 36 all look different."""
    again, which = divmod(number, len(colors))
    return {"color": colors[which], "linestyle": LINES[(which + again) % len(LINES)]}
