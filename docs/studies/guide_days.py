"""What a driver is shown from Zürich to Zug, speed and effort above and the guide below, as a picture for the pages.

`python -m docs.studies.guide_days` draws restriction-ahead.png into the working folder.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.patches import Patch
from numpy.typing import NDArray

from das.advice.advice import Advice
from das.advice.regimes import Regime, mode_name
from das.command_line.files import offscreen_pyplot, save_figure
from das.domain.units import KM, KMH, kwh
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import present, presenter_of
from sim.world.loop import InProcess, Run, Tick, World
from sim.world.outcome import DayOutcome, outcome
from sim.world.scenario import load_scenario
from sim.world.service import Day, Service, make_day, prepare_service

DAY: Final = "restriction-ahead"
SECTIONS: Final = 2
"""The day ends at its second stop, Zug."""
SEED: Final = 1
BEFORE_AND_AFTER: Final = (Presentation.SPEED_AND_EFFORT, Presentation.GUIDE)
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


class WatchedLink(InProcess):
    """A link to an on-board system that keeps the advice of every tick."""

    def __init__(self, service: Service, *, guide: bool) -> None:
        self.watched: list[Advice] = []
        super().__init__(service, guide=guide)

    def exchange(self, tick: Tick) -> Advice:
        """The advice for a tick."""
        self.watched.append(super().exchange(tick))
        return self.watched[-1]


class WatchedRun(NamedTuple):
    """A finished run of a day with the advice of each tick: `watched[i]` was given in `run.states[i]`."""

    day: Day
    run: Run
    watched: list[Advice]


def watched_run(service: Service, seed: int, presentation: Presentation) -> WatchedRun:
    """Drive a day of a service with the default human driver."""
    day = make_day(service, seed)
    link = WatchedLink(service, guide=presenter_of(presentation).needs_guide)
    driver = day.driver(DriverKind.HUMAN, FrictionPolicy.AS_MEASURED)
    return WatchedRun(day, World(day, driver, presentation, link).run(), link.watched)


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
    for state, advice in zip(one.run.states, one.watched, strict=False):
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


def draw_day(path: Path, scenario: str) -> None:
    """Draw one day of a scenario, driven by the default human with speed and effort and with the guide."""
    whole = load_scenario(scenario)
    service = prepare_service(replace(whole, to_stop="Zug", running_s=(whole.running_s or ())[:SECTIONS]))
    pyplot = offscreen_pyplot()
    figure, axes = pyplot.subplots(4, 1, figsize=SIZE_IN, sharex=True, height_ratios=(8, 1, 8, 1), layout="constrained")
    for presentation, pair in zip(BEFORE_AND_AFTER, (axes[:2], axes[2:]), strict=True):
        one = watched_run(service, SEED, presentation)
        came = outcome(one.day, one.run)
        _draw_run(pair, one, presentation, came)
    axes[-1].set_xlabel("position, km")
    lines, names = axes[0].get_legend_handles_labels()
    strips = [Patch(facecolor=color, edgecolor=INK, linewidth=0.4) for color in MODES.values()]
    figure.legend(
        [*lines, *strips], [*names, *(mode_name(mode) for mode in MODES)], loc="outside lower center", ncols=5,
        frameon=False,
    )  # fmt: skip
    figure.suptitle(f"{scenario}, seed {SEED}, default human driver: what was shown before and with the guide", size=13)
    save_figure(path, figure, dpi=DPI)
    pyplot.close(figure)


def _draw_run(axes: Any, one: WatchedRun, presentation: Presentation, came: DayOutcome) -> None:
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
    changes = one.run.stability.changes_per_min
    title = f"{presentation}: {changes:.1f} changes a minute, {kwh(came.energies.driven_j):.1f} kWh, "
    title += f"{came.late_s:+.0f} s at the last stop"
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


def _places(axis: Any, one: WatchedRun, top: float) -> None:
    """Mark the stops."""
    for stop in one.day.service.stops[1:-1]:
        axis.axvline(stop.position_m / KM, color=INK, linewidth=0.7, linestyle=":")
        axis.text(stop.position_m / KM, 0.97 * top, f" {stop.name}", size=9, va="top", color=INK)


if __name__ == "__main__":
    draw_day(Path(f"{DAY}.png"), DAY)
