"""The colours of all pictures, pages and views, each with one meaning, for dark and white backgrounds, and for the
viewer.

No module that draws a drive has its own colours. The exception is a display that shows no mode: its colour is in its
module in `sim/drivers/presentations`. tests/sim/test_meanings.py checks that people can tell the colours apart; lines
on one axis must also be distinguishable with the common kinds of colour blindness.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from das.drawing.colors import BACKGROUND, GRID, INK, LIMIT


class Meaning(StrEnum):
    """The meaning of a colour, which is the same in all pictures."""

    DRIVEN = "driven"
    """Course of the train and settings of the driver."""
    OTHER_DRIVE = "other drive"
    """Course of the train in the drive used for comparison (same trip)."""
    ADVISED = "advised"
    """Results of the node: advice, prediction, estimate."""
    SHOWN = "shown"
    """Contents of the display in the cab."""
    LIMIT = "limit"
    OPTIMUM = "optimum"
    OPERATOR = "operator"
    """Messages of traffic management: delays, targets."""
    GRADIENT = "gradient"
    LOST = "lost"
    """Energy above the optimum."""
    AGAINST = "other than advised"
    """Driving with an effort other than the advised effort."""
    ERROR = "error"
    MASS = "mass"
    RESISTANCE = "resistance"
    NOTE = "note"
    WARNING = "warning"
    DANGER = "danger"
    """A signal at danger."""
    NO_ADVICE = "no advice"


@dataclass(frozen=True, kw_only=True)
class Theme:
    """The colours of a picture, each as "#rrggbb": background, ink, grid, and one for each meaning."""

    name: str
    background: str
    ink: str
    grid: str
    of: dict[Meaning, str]


_COLORS: Final = {
    # on a dark background, on white, and in the viewer
    Meaning.DRIVEN: ("#4aa3ff", "#0072b2", "#2f86d6"),
    Meaning.OTHER_DRIVE: ("#2b55ff", "#00004b", "#a52d87"),
    Meaning.ADVISED: ("#ff9a28", "#d55e00", "#d9730d"),
    Meaning.SHOWN: ("#fff0a0", "#2a1fb0", "#4848f0"),
    Meaning.LIMIT: ("#c8646e", LIMIT, "#b5313a"),
    Meaning.OPTIMUM: ("#35c995", "#009e73", "#14996b"),
    Meaning.OPERATOR: ("#b08ce0", "#6a3fb0", "#9673d3"),
    Meaning.GRADIENT: ("#b59a6a", "#7d6437", "#9c8150"),
    Meaning.LOST: ("#ff7ab8", "#c2185b", "#e0558f"),
    Meaning.AGAINST: ("#8be04a", "#4c7a00", "#57a80a"),
    Meaning.ERROR: ("#9ff0ff", "#00707f", "#1591a8"),
    Meaning.MASS: ("#d6b4ff", "#9b6bd6", "#a800f0"),
    Meaning.RESISTANCE: ("#6fd0c5", "#2a9d8f", "#5d9c93"),
    Meaning.NOTE: ("#ff5ff0", "#c000b4", "#d43cc6"),
    Meaning.WARNING: ("#ffd21f", "#b98900", "#b98900"),
    Meaning.DANGER: ("#ff3b30", "#e3120b", "#ec3c31"),
    Meaning.NO_ADVICE: ("#8a9499", "#7a858a", "#7c878d"),
}
DARK, LIGHT, VIEWER = (
    Theme(name=name, background=background, ink=ink, grid=grid, of={key: found[i] for key, found in _COLORS.items()})
    for i, (name, background, ink, grid) in enumerate(
        (
            ("dark", "#0d1011", "#cad8de", "#2b3236"),
            ("light", BACKGROUND, INK, GRID),
            ("viewer", "#1c1f21", "#7c878d", "#7c878d"),
        )
    )
)
"""The themes for a dark background, for white, and for the viewer. The viewer's background is dark or light, like the
desktop's, so its colours are middle tones that are readable on both."""

COMPARED: Final = (LIGHT.of[Meaning.OTHER_DRIVE], LIGHT.of[Meaning.DRIVEN], "#0000ff", "#0f87ff", "#2d001e", "#0f4bff")
"""Colours of compared drives, in the order of the drives, on white; lines differ in style as well. The first colour
is for the drive with which the others are compared."""


def rgba(color: str) -> int:
    """A colour "#rrggbb" as a number 0xRRGGBBAA for rerun."""
    return int(color[1:], 16) << 8 | 0xFF
