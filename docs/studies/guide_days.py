"""Picture of the advice shown to a driver from Zürich to Zug: speed and effort above, the guide below.

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
from das.command_line.files import save_figure
from das.domain.units import KM, KMH, kwh
from das.drawing.colors import MODES
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import present, presenter_of
from sim.meanings import LIGHT, Meaning
from sim.review.pictures import INK, TEXT_POINTS, light_figure, named, stops
from sim.world.in_process import InProcess
from sim.world.loop import Run, Tick, World
from sim.world.outcome import DayOutcome, outcome
from sim.world.scenario import load_scenario
from sim.world.service import Day, Service, make_day, prepare_service

DAY: Final = "restriction-ahead"
SECTIONS: Final = 2
"""Number of sections; the run ends at the second stop, Zug."""
SEED: Final = 1
BEFORE_AND_AFTER: Final = (Presentation.SPEED_AND_EFFORT, Presentation.GUIDE)
HEIGHTS_IN: Final = (2.6, 0.25, 2.6, 0.25)
HEADROOM: Final = 1.1

DRAWN: Final = tuple(mode for mode in Regime if mode_name(mode) in MODES and mode not in (Regime.STOP, Regime.DEPART))
"""The modes of a moving train."""

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
    """A finished run with the advice of each tick: `watched[i]` was given in `run.states[i]`."""

    day: Day
    run: Run
    watched: list[Advice]


def watched_run(service: Service, seed: int, presentation: Presentation) -> WatchedRun:
    """Simulate a run of a service with the default human driver."""
    day = make_day(service, seed)
    link = WatchedLink(service, guide=presenter_of(presentation).needs_guide)
    driver = day.driver(DriverKind.HUMAN, FrictionPolicy.AS_MEASURED)
    return WatchedRun(day, World(day, driver, presentation, link).run(), link.watched)


class ShownSecond(NamedTuple):
    """A second of a moving train: position (km), limit, driven and shown speed (km/h; NaN: none), mode shown."""

    at_km: float
    limit_kmh: float
    driven_kmh: float
    shown_kmh: float
    mode: Regime


def shown_seconds(one: WatchedRun, presentation: Presentation) -> list[ShownSecond]:
    """The driven and shown values of each second in which the train moved."""
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
    """Draw one scenario with the default human driver, with speed and effort and with the guide."""
    whole = load_scenario(scenario)
    service = prepare_service(replace(whole, to_stop="Zug", running_s=(whole.running_s or ())[:SECTIONS]))
    figure, axes = light_figure(HEIGHTS_IN)
    for presentation, pair in zip(BEFORE_AND_AFTER, (axes[:2], axes[2:]), strict=True):
        one = watched_run(service, SEED, presentation)
        came = outcome(one.day, one.run)
        _draw_run(pair, one, presentation, came)
    named(axes[-1], x="position, km")
    lines, names = axes[0].get_legend_handles_labels()
    strips = [Patch(color=MODES[mode_name(mode)]) for mode in DRAWN]
    figure.legend(
        [*lines, *strips], [*names, *(mode_name(mode) for mode in DRAWN)], loc="outside lower center", ncols=5,
        frameon=False, fontsize=TEXT_POINTS, labelcolor=INK,
    )  # fmt: skip
    save_figure(path, figure)


def _draw_run(axes: Any, one: WatchedRun, presentation: Presentation, came: DayOutcome) -> None:
    """Draw one run in two axes: speeds, and below them a strip of the modes shown."""
    speed, strip = axes
    seconds = shown_seconds(one, presentation)
    at_km = np.array([x.at_km for x in seconds])
    limits = np.array([x.limit_kmh for x in seconds])
    shown = [x.shown_kmh for x in seconds]
    speed.step(at_km, limits, where="post", color=LIGHT.of[Meaning.LIMIT], linewidth=1.1, label="limit")
    speed.plot(at_km, [x.driven_kmh for x in seconds], color=LIGHT.of[Meaning.DRIVEN], linewidth=1.6, label="driven")
    speed.step(at_km, shown, where="post", color=LIGHT.of[Meaning.SHOWN], linewidth=0.9, label="shown")
    speed.set_ylim(0.0, HEADROOM * float(np.nanmax(limits)))
    places = [(stop.name, stop.position_m) for stop in one.day.service.stops]
    speed.set_xlim(places[0][1] / KM, places[-1][1] / KM)
    named(speed, y="speed, km/h")
    changes = one.run.stability.changes_per_min
    title = f"{presentation}: {changes:.1f} changes a minute, {kwh(came.energies.above.driven_j):.1f} kWh, "
    title += f"{came.late_s:+.0f} s at the last stop"
    speed.set_title(title, loc="left", color=INK, fontsize=TEXT_POINTS, pad=18.0)
    stops(speed, places, at_points=(4.0,))
    for mode in DRAWN:
        strip.broken_barh(_stretches(seconds, mode), (0.0, 1.0), facecolors=MODES[mode_name(mode)])
    strip.set_yticks([])
    strip.grid(visible=False)


def _stretches(seconds: list[ShownSecond], mode: Regime) -> list[tuple[float, float]]:
    """Start and length (km) of every stretch on which a mode was shown."""
    found: list[tuple[float, float]] = []
    for one, after in pairwise(seconds):
        if one.mode is mode:
            found.append((one.at_km, max(after.at_km - one.at_km, 0.0)))
    return found


if __name__ == "__main__":
    draw_day(Path(f"{DAY}.png"), DAY)
