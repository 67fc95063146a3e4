"""What helps a driver in a presentation: the same days, with the display of the vector changed in one thing at a time.

`python -m docs.studies.display` writes the table into docs/reference/drivers.md again (about five minutes on one core).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from das.advice.regimes import Regime
from das.domain.units import KMH
from docs.studies.driving import driven, human_of
from docs.studies.output import DOCS, write_table
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import EFFORT_STEP_RATIO
from sim.experiment.factors import day_of
from sim.jobs.report import with_interval
from sim.plant.kernels import Command
from sim.world.outcome import outcome
from sim.world.service import Service, make_day, prepare_service

SEEDS: Final = tuple(range(12))
REFRESHED_S: Final = 10.0


class ShownAsIs:
    """A display that shows the advice as it is; derived displays change it. `show` is called at every look."""

    def show(self, view: AdviceView, now_s: float) -> AdviceView:
        """The advice as this display shows it."""
        return view


class Steps(ShownAsIs):
    """Shows effort in steps of 20 % of the controller."""

    def show(self, view: AdviceView, now_s: float) -> AdviceView:
        return replace(
            view, lever_ratio=_in_steps(view.lever_ratio), next_effort_ratio=_in_steps(view.next_effort_ratio)
        )


class Refreshed(ShownAsIs):
    """Is refreshed every 10 s; in between nothing changes, not even the preview."""

    def __init__(self) -> None:
        self._kept: AdviceView | None = None

    def show(self, view: AdviceView, now_s: float) -> AdviceView:
        if self._kept is None or now_s >= self._kept.time_s + REFRESHED_S:
            self._kept = view
        return replace(self._kept, valid_until_s=view.valid_until_s)


class Unannounced(ShownAsIs):
    """Does not say what comes next or when, except how to depart."""

    def show(self, view: AdviceView, now_s: float) -> AdviceView:
        if view.mode == Regime.DEPART:
            return view
        return replace(view, next_mode=Regime.NONE, next_change_s=float("nan"))


class WithoutPreview(ShownAsIs):
    """Shows the present speed and effort, but not the speeds and efforts of the next 30 s."""

    def show(self, view: AdviceView, now_s: float) -> AdviceView:
        return replace(view, horizon_speed_mps=(), horizon_force_n=())


class TargetSpeed(ShownAsIs):
    """Shows the mode and the speed that it leads to, in whole km/h, but neither effort nor preview.

    When accelerating or braking, this is the speed at the next change, if the preview reaches that far.
    """

    def show(self, view: AdviceView, now_s: float) -> AdviceView:
        if view.mode == Regime.DEPART:
            return replace(view, next_effort_ratio=math.nan)
        target_mps = view.shown_speed_mps
        if view.mode != Regime.CRUISE and view.horizon_speed_mps:
            last_s = len(view.horizon_speed_mps)
            ahead_s = last_s if math.isnan(view.next_change_s) else min(max(int(view.next_change_s), 1), last_s)
            target_mps = view.horizon_speed_mps[ahead_s - 1]
        shown_mps = round(target_mps / KMH) * KMH
        return replace(
            view,
            speed_mps=shown_mps,
            display_speed_mps=shown_mps,
            lever_ratio=math.nan,
            force_n=math.nan,
            horizon_speed_mps=(),
            horizon_force_n=(),
        )


def _in_steps(ratio: float) -> float:
    return ratio if math.isnan(ratio) else round(ratio / EFFORT_STEP_RATIO) * EFFORT_STEP_RATIO


class Looking:
    """A human driver behind a display; with a `tone` the driver looks at it at each change of the mode."""

    def __init__(self, human: HumanDriver, display: ShownAsIs, *, tone: bool = False) -> None:
        self.human, self._display, self._tone = human, display, tone
        self._mode: int | None = None

    def command(self, cab: CabView) -> Command:
        """What the driver sets."""
        view = cab.shown
        if view is None:
            return self.human.command(cab)
        shown = self._display.show(view, cab.time_s)
        if self._tone and shown.mode != self._mode:
            self.human._display._glance_s = min(self.human._display._glance_s, cab.time_s)
        self._mode = shown.mode
        return self.human.command(cab._replace(advice=shown))


class DisplayVariant(NamedTuple):
    """A display, and whether a tone calls for a look at each change of the mode."""

    says: str
    display: Callable[[], ShownAsIs]
    tone: bool = False


AS_IT_IS: Final = DisplayVariant("vector as it is", ShownAsIs)
VARIANTS: Final = (
    DisplayVariant("a tone at each change of the mode: he looks at once", ShownAsIs, tone=True),
    DisplayVariant("effort in steps of 20 %", Steps),
    DisplayVariant("a target speed without effort or preview", TargetSpeed),
    DisplayVariant("refreshed every 10 s", Refreshed),
    DisplayVariant("next change not announced", Unannounced),
    DisplayVariant("no preview of the next 30 s", WithoutPreview),
)


class DisplayFigures(NamedTuple):
    """The gap of a run to the optimum of its own times (%), how late it was (s), and how often the controller moved."""

    gap_percent: float
    late_s: float
    moves: float


def figures(service: Service, seed: int, variant: DisplayVariant) -> DisplayFigures:
    """Drive a day behind a display."""
    day = make_day(service, seed)
    human = human_of(day)
    driver = Looking(human, variant.display(), tone=variant.tone)
    found = outcome(day, driven(day, driver, Presentation.VECTOR))
    gap = found.energies.above.ratio
    assert gap is not None
    moves = sum(event.what == "lever" for event in human.events)
    return DisplayFigures(100.0 * gap, found.late_s, 60.0 * moves / found.running_time_s)


def display_table(
    services: Sequence[Service], seeds: Sequence[int] = SEEDS, variants: Sequence[DisplayVariant] = VARIANTS
) -> Iterator[str]:
    """The lines of the table: each variant against the display as it is, on the same days of each service."""
    names = [service.scenario.id for service in services]
    yield f"| display | {' | '.join(f'{name}: gap, % | points | late, s | moves a minute' for name in names)} |"
    yield f"|---|{'---:|---:|---:|---:|' * len(names)}"
    first: list[np.ndarray] = []
    for variant in (AS_IT_IS, *variants):
        found = [np.array([figures(service, seed, variant) for seed in seeds]) for service in services]
        first = first or found
        cells = [_cells(one, before) for one, before in zip(found, first, strict=True)]
        yield f"| {variant.says} | {' | '.join(cells)} |"


def _cells(found: np.ndarray, first: np.ndarray) -> str:
    """Means of the days' figures, and how much the gap differs from the first display's, with its interval."""
    gap, late_s, moves = found.mean(axis=0)
    points = "" if found is first else with_interval(found[:, 0] - first[:, 0])
    return f"{gap:.1f} | {points} | {late_s:+.0f} | {moves:.1f}"


if __name__ == "__main__":
    write_table(
        DOCS / "reference" / "drivers.md",
        "display",
        display_table([prepare_service(day_of(name)) for name in ("clear-day", "flat-6km")]),
    )
