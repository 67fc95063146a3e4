"""A picture of a trip: the recorded speed and the smooth run, how far they are apart, and the forces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from das.command_line.outputs import offscreen_pyplot, save_figure
from das.domain.units import KM, KMH, KN, NS
from sim.trips.estimate import DrivenEstimate, strongest_held_n
from sim.trips.settings import ESTIMATE
from sim.trips.trip import Trip

PANEL_HEIGHTS = (3, 1, 2)
FORCES_SHOWN_RATIO = 1.3
"""Forces are drawn up to this many times the strongest held force, so that no spike of a second sets the scale."""


def draw_trip(path: Path, trip: Trip, driven: DrivenEstimate | None) -> None:
    """Draw a trip over the position; without an estimate there are no forces.

    The suffix of `path` (.png, .pdf, .svg) decides the kind of picture. Raises DasError without matplotlib.
    """
    pyplot = offscreen_pyplot()
    heights = PANEL_HEIGHTS[: 2 if driven is None else 3]
    figure, axes = pyplot.subplots(
        len(heights), 1, figsize=(12, 3 + sum(heights)), sharex=True, height_ratios=heights, layout="constrained"
    )
    _speeds(axes[0], trip)
    _distances(axes[1], trip)
    if driven is not None:
        draw_forces(axes[2], driven)
    axes[-1].set_xlabel("position, km")
    save_figure(path, figure)
    pyplot.close(figure)


def _speeds(axis: Any, trip: Trip) -> None:
    matched, run = trip.matched, trip.run
    axis.plot(run.s_m / KM, trip.route.limits_mps.at(run.s_m) / KMH, color="0.45", linewidth=1, label="limit")
    axis.plot(run.s_m / KM, run.speed_mps / KMH, color="tab:blue", label="smooth run")
    for which, colour, label in (
        (~matched.dropout, "black", "measured"),
        (matched.dropout, "tab:red", "from positions"),
    ):
        shown = which & ~matched.invalid
        if shown.any():
            axis.plot(matched.s_m[shown] / KM, matched.speed_mps[shown] / KMH, ".", color=colour, ms=3, label=label)
    axis.set_ylabel("speed, km/h")
    axis.set_ylim(bottom=0)
    axis.legend(loc="lower center", ncols=4)
    kept = f"{matched.report.cleaning.kept} of {matched.report.cleaning.read} points"
    axis.set_title(f"{trip.path.name}: {trip.start.name} – {trip.end.name}, {kept}")


def _distances(axis: Any, trip: Trip) -> None:
    matched, run = trip.matched, trip.run
    since_s = (matched.time_ns - run.start_time_ns) * NS
    apart_m = matched.s_m - np.interp(since_s, run.time_s, run.s_m)
    axis.plot(matched.s_m[~matched.invalid] / KM, apart_m[~matched.invalid], ".", color="black", ms=3)
    axis.axhline(0, color="0.3", linewidth=0.5)
    axis.set_ylabel("record − run, m")


def draw_forces(axis: Any, driven: DrivenEstimate) -> None:
    """Draw the wheel forces of motors and friction brake; peaks shorter than the held ones are cut, and told so."""
    at_km = driven.trajectory.s_m / KM
    axis.stairs(driven.trajectory.force_el_n / KN, at_km, baseline=0, fill=True, color="tab:orange", label="motors")
    if driven.trajectory.force_friction_n.any():
        axis.stairs(driven.trajectory.force_friction_n / KN, at_km, baseline=0, color="tab:red", label="friction brake")
    axis.axhline(0, color="0.3", linewidth=0.5)
    axis.set_ylabel("wheel force, kN")
    force_kn = (driven.trajectory.force_el_n + driven.trajectory.force_friction_n) / KN
    shown_kn = FORCES_SHOWN_RATIO * max(strongest_held_n(driven)) / KN
    cut = [f"{peak:.0f} kN" for peak in (force_kn.min(), force_kn.max()) if abs(peak) > shown_kn > 0]
    if cut:
        axis.set_ylim(-shown_kn, shown_kn)
        axis.set_title(f"cut, as shorter than {ESTIMATE.held_s} s: {', '.join(cut)}", fontsize="small")
    axis.legend(loc="upper right")
