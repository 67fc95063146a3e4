"""A picture of a trip: speed of record and smooth run, how far they are apart, forces."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.units import KM, KMH, KN, NS
from sim.trips.estimate import HELD_S, DrivenEstimate, strongest_held_n
from sim.trips.trip import Trip

PANEL_HEIGHTS = (3, 1, 2)
FORCES_SHOWN_RATIO = 1.3
"""Forces are drawn up to so many times the strongest held: a spike of a second shall not set the scale."""


def draw_trip(path: Path, trip: Trip, driven: DrivenEstimate | None) -> None:
    """Draw it over the position as a PNG; without an estimate there are no forces. DasError without matplotlib."""
    try:
        import matplotlib
    except ImportError:
        raise DasError("--plot needs matplotlib: install the extra, pip install '.[view]' in the checkout") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    heights = PANEL_HEIGHTS[: 2 if driven is None else 3]
    figure, axes = pyplot.subplots(
        len(heights), 1, figsize=(12, 3 + sum(heights)), sharex=True, height_ratios=heights, layout="constrained"
    )
    _speeds(axes[0], trip)
    _distances(axes[1], trip)
    if driven is not None:
        _forces(axes[2], driven)
    axes[-1].set_xlabel("position, km")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120)
    pyplot.close(figure)
    write_whole(path, buffer.getvalue())


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


def _forces(axis: Any, driven: DrivenEstimate) -> None:
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
        axis.set_title(f"cut, as shorter than {HELD_S} s: {', '.join(cut)}", fontsize="small")
    axis.legend(loc="upper right")
