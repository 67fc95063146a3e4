"""Common parts of all pictures of the study: colours of levels and buffers, runs drawn over distance and over speed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator, PercentFormatter

from das.domain.losses import LossMap
from das.domain.trajectory import Trajectory
from das.domain.units import KM, KMH, KN
from das.domain.vehicle import Vehicle
from docs.studies.cases import Floats
from precompute.loss_maps import draw_efficiency_map

STYLE: dict[Any, Any] = {
    "font.size": 10,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 11,
    "axes.labelsize": 10,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": False,
    "path.simplify": True,
}
LEVEL_COLOURS = {
    "fastest": "#555555",
    "l0-noreg": "#56b4e9",
    "l0-reg": "#0072b2",
    "l1": "#e69f00",
    "l2": "#cc79a7",
    "l3-gto": "#009e73",
    "l3-igbt": "#d55e00",
}
"""Colour of each level in every picture (from Okabe and Ito, distinguishable for the colour-blind)."""
DASHES: dict[str, Any] = {"l1": (0, (5, 3)), "l0-noreg": (0, (1, 1.5))}
"""Dashes of the levels whose curves coincide with another level's; they are drawn last."""
BUFFER_COLOURS = ("#12a150", "#1f6fe0", "#9a3fd6", "#e02424", "#e0a100", "#000000")
"""Colours of the buffers 0, 2, 7, 15, 25 % and the largest, as the paper's: green, blue, purple, red, yellow, black."""
GREYISH = "#7a7a7a"
GREY_SHARE = 0.75
"""Share of grey in the colour of a run at its end."""
MAP_COLOURS = ("#6f8ea6", "#ffffff")
"""Colours of the least and the most efficient operating points: pale, for contrast with the coloured runs."""
SHADES = 24
"""Number of shades along a run."""
CROSS_STEP_M = 200.0
"""Distance (m) between crosses along a run."""
PANEL_GAP_IN = 0.09
"""Space (inches) at the left and right of each panel, which keeps labels off the next panel."""


@contextmanager
def style() -> Iterator[None]:
    """Use the style of the study for drawing and saving, regardless of the user's settings."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield


def new_figure(width_in: float, height_in: float) -> Any:
    """An empty figure with constrained layout, outside pyplot's global state."""
    return Figure(figsize=(width_in, height_in), layout=ConstrainedLayoutEngine(w_pad=PANEL_GAP_IN))


def draw_speed(axes: Any, run: Trajectory, colour: str) -> None:
    """Speed over distance, shaded from bright (start) to greyish (end), with crosses at equal distances."""
    _shaded(axes, (run.s_m - run.s_m[0]) / KM, run.v_mps / KMH, run, colour)
    at_m, v_mps, _ = _cross_points(run)
    _crosses(axes, at_m / KM, v_mps / KMH, at_m / at_m[-1], colour)


def draw_force(axes: Any, run: Trajectory, colour: str) -> None:
    """Wheel force over speed, shaded like the speed, with crosses at equal distances."""
    speed = 0.5 * (run.v_mps[:-1] + run.v_mps[1:]) / KMH
    force = (run.force_el_n + run.force_friction_n) / KN
    _shaded(axes, speed, force, run, colour)
    at_m, v_mps, force_n = _cross_points(run)
    _crosses(axes, v_mps / KMH, force_n / KN, at_m / at_m[-1], colour)


def shades(colour: str, count: int) -> list[tuple[float, float, float]]:
    """Colours from bright to greyish."""
    bright, grey = np.array(to_rgb(colour)), np.array(to_rgb(GREYISH))
    mix = GREY_SHARE * np.linspace(0, 1, count)[:, np.newaxis]
    return [(float(r), float(g), float(b)) for r, g, b in (1 - mix) * bright + mix * grey]


def _shaded(axes: Any, x: Floats, y: Floats, run: Trajectory, colour: str) -> None:
    along = (run.s_m[: len(x)] - run.s_m[0]) / (run.s_m[-1] - run.s_m[0])
    edges = np.searchsorted(along, np.linspace(0, 1, SHADES + 1)).clip(0, len(x) - 1)
    pieces = [np.column_stack((x[a : b + 1], y[a : b + 1])) for a, b in pairwise(edges)]
    drawn = [(piece, shade) for piece, shade in zip(pieces, shades(colour, SHADES), strict=True) if len(piece) > 1]
    lines = [piece for piece, _ in drawn]
    axes.add_collection(LineCollection(lines, colors=[shade for _, shade in drawn], linewidths=1.5, capstyle="round"))
    axes.autoscale_view()


def _cross_points(run: Trajectory) -> tuple[Floats, Floats, Floats]:
    """Distance from the start (m), speed and force at equally spaced points."""
    length_m = float(run.s_m[-1] - run.s_m[0])
    at_m = np.arange(CROSS_STEP_M, length_m - 1e-6, CROSS_STEP_M)
    i = np.clip(np.searchsorted(run.s_m, run.s_m[0] + at_m, side="right") - 1, 0, len(run.force_el_n) - 1)
    v2 = np.interp(run.s_m[0] + at_m, run.s_m, run.v_mps**2)
    return at_m, np.sqrt(v2), (run.force_el_n + run.force_friction_n)[i]


def _crosses(axes: Any, x: Floats, y: Floats, along: Floats, colour: str) -> None:
    palette = shades(colour, SHADES)
    colours = [palette[min(int(a * SHADES), SHADES - 1)] for a in along]
    axes.scatter(x, y, marker="x", s=16, linewidths=1.1, color=colours, zorder=3)


def draw_map(axes: Any, loss_map: LossMap, vehicle: Vehicle, highest_mps: float) -> Any:
    """The efficiency map in pale colours, bright = efficient, up to a speed; returns it for `efficiency_bar`."""
    drawn = draw_efficiency_map(axes, loss_map, vehicle)
    drawn.set_cmap(LinearSegmentedColormap.from_list("pale", list(MAP_COLOURS)))
    axes.set_xlim(0, highest_mps / KMH)
    axes.set_xlabel("speed, km/h")
    return drawn


def efficiency_bar(figure: Any, drawn: Sequence[Any], axes: Sequence[Any]) -> None:
    """Put maps on one scale, with a colour bar next to their axes."""
    scale = Normalize(min(item.levels[0] for item in drawn), max(item.levels[-1] for item in drawn))
    for item in drawn:
        item.set_norm(scale)
    figure.colorbar(
        ScalarMappable(scale, drawn[0].cmap),
        ax=list(axes),
        label="efficiency of the traction chain",
        pad=0.01,
        extend="min",
        ticks=MultipleLocator(0.05),
        format=PercentFormatter(1.0, decimals=0),
    )


def crossed_handles(labels: dict[str, str]) -> list[Any]:
    """Legend handles of runs with crosses, from labels and colours."""
    return [
        Line2D([], [], color=colour, linewidth=2, marker="x", markersize=5, label=label)
        for colour, label in labels.items()
    ]
