"""The convex relaxation of a loss map, as the picture of docs/explanation/bounds.md.

`python -m docs.studies.relaxed_loss` draws relaxed-loss.png into the working folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from das.command_line.files import save_figure
from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.units import KMH
from das.drawing.colors import SEVERAL
from sim.review.pictures import light_figure, named, page_legend

Floats = NDArray[np.float64]
PICTURE: Final = Path("relaxed-loss.png")
SPEEDS_MPS: Final = np.arange(79.0, 160.0, 0.2) * KMH
KWH_PER_KM: Final = 1.0 / 3600.0
"""Energy (kWh/km) of 1 N, which is 1 J/m."""


def energy_per_metre(train: str = "re460-ic") -> Floats:
    """Energy (J/m) at the current collector of a train that holds each of `SPEEDS_MPS` on a level line, at L3."""
    vehicle = load_vehicle(train)
    force_n = vehicle.resistance.force_n(SPEEDS_MPS)
    return np.asarray(force_n + vehicle.loss_model(Level.L3).loss_w(force_n, SPEEDS_MPS) / SPEEDS_MPS)


def lower_hull(x: Floats, y: Floats) -> Floats:
    """The largest convex function of x that is at or below all points (x rising, y), at each x."""
    kept: list[int] = []
    for i in range(x.size):
        while len(kept) > 1 and _above(x, y, kept[-2], kept[-1], i):
            kept.pop()
        kept.append(i)
    return np.interp(x, x[kept], y[kept])


def _above(x: Floats, y: Floats, first: int, middle: int, last: int) -> bool:
    """Whether the middle point is on or above the line through the two others."""
    return bool((y[middle] - y[first]) * (x[last] - x[first]) >= (y[last] - y[first]) * (x[middle] - x[first]))


def relaxed_figure() -> Figure:
    """Energy per kilometre over the speed held, for the map and for its convex hull in the slowness."""
    found = energy_per_metre()
    hull = lower_hull(1.0 / SPEEDS_MPS[::-1], found[::-1])[::-1]
    figure, (axis,) = light_figure((2.8,))
    axis.plot(SPEEDS_MPS / KMH, found * KWH_PER_KM, color=SEVERAL[0], label="loss map of the GTO converters")
    axis.plot(SPEEDS_MPS / KMH, hull * KWH_PER_KM, "--", color=SEVERAL[1], label="its convex hull in the slowness")
    named(axis, x="speed held on a level line, km/h", y="energy, kWh/km")
    page_legend(axis)
    return figure


if __name__ == "__main__":
    save_figure(PICTURE, relaxed_figure())
