"""What a driver is shown on five days, before (vector) and after (coach), as pictures for the documentation.

`python -m docs.studies.coach_days` draws docs/images/coach/*.png again, and writes their table (about a minute).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.patches import Patch
from numpy.typing import NDArray

from das.advice.regimes import Regime, mode_name
from das.command_line.files import offscreen_pyplot, save_figure
from das.domain.units import KM, KMH, kwh
from docs.studies.driving import WatchedRun, watched_run
from docs.studies.output import DOCS, write_table
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import present
from sim.world.disturbances import SignalStop, TrainAhead
from sim.world.outcome import outcome
from sim.world.scenario import load_scenario
from sim.world.service import prepare_service

DAYS: Final = ("clear-day", "train-ahead", "restriction-ahead", "departure-delay", "signal-stop")
SEED: Final = 1
FOLDER: Final = DOCS / "images" / "coach"
BEFORE_AND_AFTER: Final = (Presentation.VECTOR, Presentation.COACH)
SIZE_IN, DPI = (11.0, 7.2), 100
HEADROOM: Final = 1.1

INK, LIMIT, DRIVEN, SHOWN = "#222222", "#8c8c8c", "#0072b2", "#d55e00"
"""Colours that people with any kind of colour vision tell apart (Okabe & Ito 2008)."""
MODES: Final = {
    Regime.FULL_TRACTION: "#003f6b",
    Regime.REDUCED_TRACTION: "#56b4e9",
    Regime.CRUISE: "#c8c8c8",
    Regime.COAST: "#f0e442",
    Regime.REDUCED_BRAKE: "#e69f00",
    Regime.FULL_BRAKE: "#b03a00",
    Regime.FRICTION_BRAKE: "#111111",
}

Floats = NDArray[np.float64]


class ShownSecond(NamedTuple):
    """A second of a moving train: place (km), limit, driven and shown speed (km/h; NaN: none), and the mode shown."""

    at_km: float
    limit_kmh: float
    driven_kmh: float
    shown_kmh: float
    mode: Regime


def shown_seconds(one: WatchedRun, presentation: Presentation) -> list[ShownSecond]:
    """What was driven and shown in each second in which the train moved."""
    found = []
    for state, (advice, _) in zip(one.run.states, one.watched, strict=False):
        if state.speed_mps <= 0:
            continue
        view = present(advice, presentation)
        found.append(
            ShownSecond(
                at_km=state.s_m / KM,
                limit_kmh=advice.limit_mps / KMH,
                driven_kmh=state.speed_mps / KMH,
                shown_kmh=math.nan if view is None else view.display_speed_mps / KMH,
                mode=Regime.NONE if view is None else Regime(view.mode),
            )
        )
    return found


def draw_day(path: Path, scenario: str) -> str:
    """Draw a day of a scenario as the default human drove it with vector and with the coach: the same day for both.

    Returns the figures of the two runs as a row of a table in Markdown.
    """
    service = prepare_service(load_scenario(scenario))
    pyplot = offscreen_pyplot()
    figure, axes = pyplot.subplots(4, 1, figsize=SIZE_IN, sharex=True, height_ratios=(8, 1, 8, 1), layout="constrained")
    cells: list[str] = []
    for presentation, pair in zip(BEFORE_AND_AFTER, (axes[:2], axes[2:]), strict=True):
        one = watched_run(service, SEED, presentation)
        figures = _figures(one)
        _draw_run(pair, one, presentation, figures)
        cells += figures
    axes[-1].set_xlabel("position, km")
    lines, names = axes[0].get_legend_handles_labels()
    strips = [Patch(facecolor=color, edgecolor=INK, linewidth=0.4) for color in MODES.values()]
    figure.legend(
        [*lines, *strips], [*names, *(mode_name(mode) for mode in MODES)], loc="outside lower center", ncols=5,
        frameon=False,
    )  # fmt: skip
    figure.suptitle(f"{scenario}, seed {SEED}, default human driver: what was shown before and with the coach", size=13)
    save_figure(path, figure, dpi=DPI)
    pyplot.close(figure)
    return f"| {scenario} | {' | '.join(cells)} |"


def _draw_run(axes: Any, one: WatchedRun, presentation: Presentation, figures: tuple[str, str, str]) -> None:
    """One run in two axes: speeds, and under them a strip of the modes shown."""
    speed, strip = axes
    seconds = shown_seconds(one, presentation)
    at_km = np.array([x.at_km for x in seconds])
    limits = np.array([x.limit_kmh for x in seconds])
    speed.step(at_km, limits, where="post", color=LIMIT, linewidth=1.4, label="speed limit")
    speed.plot(at_km, [x.driven_kmh for x in seconds], color=DRIVEN, linewidth=2.2, label="driven speed")
    speed.step(
        at_km,
        [x.shown_kmh for x in seconds],
        where="post",
        color=SHOWN,
        linewidth=1.1,
        label="speed shown to the driver",
    )
    top = HEADROOM * float(np.nanmax(limits))
    speed.set_ylim(0.0, top)
    speed.set_xlim(at_km[0], at_km[-1])
    speed.set_ylabel("speed, km/h")
    speed.grid(color="#e4e4e4", linewidth=0.6)
    changes, energy, late = figures
    title = f"{presentation}: {changes} changes a minute, {energy} kWh, {late} s at the last stop"
    speed.set_title(title, loc="left", size=11)
    _places(speed, one, top)
    for mode, color in MODES.items():
        strip.broken_barh(_stretches(seconds, mode), (0.0, 1.0), facecolors=color)
    strip.set_yticks([])
    strip.set_ylabel("mode", rotation=0, ha="right", va="center")


def _stretches(seconds: list[ShownSecond], mode: Regime) -> list[tuple[float, float]]:
    """Begin and length (km) of every stretch on which a mode was shown."""
    found: list[tuple[float, float]] = []
    for one, after in pairwise(seconds):
        if one.mode is mode:
            found.append((one.at_km, max(after.at_km - one.at_km, 0.0)))
    return found


def _figures(one: WatchedRun) -> tuple[str, str, str]:
    """Changes a minute, kWh, and seconds late at the last stop."""
    came = outcome(one.day, one.run)
    changes = one.run.stability.changes_per_min
    return f"{changes:.1f}", f"{kwh(came.energies.driven_j):.1f}", f"{came.late_s:+.0f}"


def _places(axis: Any, one: WatchedRun, top: float) -> None:
    """Mark the stops, and a signal at danger."""
    for stop in one.day.service.stops[1:-1]:
        axis.axvline(stop.position_m / KM, color=INK, linewidth=0.7, linestyle=":")
        axis.text(stop.position_m / KM, 0.97 * top, f" {stop.name}", size=9, va="top", color=INK)
    signals_m = [x.at_m for x in one.day.of(SignalStop)] + [x.at_m for x in one.day.of(TrainAhead)]
    for at_m in signals_m:
        axis.axvline(at_m / KM, color=INK, linewidth=1.2, linestyle="--")
        axis.text(at_m / KM, 0.05 * top, " signal at danger", size=9, va="bottom", color=INK)


def days_table() -> Iterator[str]:
    """Draw the pictures of all days; yields the lines of their table, each once its picture is drawn."""
    yield "| day | vector: changes/min | kWh | late, s | coach: changes/min | kWh | late, s |"
    yield "|---|---:|---:|---:|---:|---:|---:|"
    for scenario in DAYS:
        yield draw_day(FOLDER / f"{scenario}.png", scenario)


if __name__ == "__main__":
    write_table(DOCS / "explanation" / "coach.md", "days", days_table())
