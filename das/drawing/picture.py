"""Draws runs, planned journeys and fronts, one or several in a picture: for `das.plot` and for das-precompute."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.command_line.files import NO_MATPLOTLIB, check_picture, save_figure
from das.domain.errors import DasError
from das.domain.files.writing import check_writable
from das.domain.units import KM, KN, PERMILLE, kmh, kwh
from das.drawing.colors import BACKGROUND, GRID, INK, LIMIT, look_of
from das.drawing.plotted import PlottedFront, PlottedRun

try:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
except ImportError:
    raise DasError(NO_MATPLOTLIB) from None

Floats = NDArray[np.float64]

WIDTH_IN: Final = 10.0
LETTERS: Final = 100
"""Largest number of characters in a line of the title."""
MINUTE_S: Final = 60.0
NAME_APART: Final = 0.012
"""Least distance, as a share of the axis, between the names of two stops; of closer names, the second is left out."""
ALTITUDE_MARGIN_M: Final = 5.0
LEAST_RISE_M: Final = 0.5
"""Largest rise and fall (m) of a line that is drawn as flat."""
LIMITS, LIMITS_OF_FIRST = "limit", "limit of the first run"


class Over(StrEnum):
    """The quantity on the horizontal axis of a picture."""

    DISTANCE = "distance"
    TIME = "time"
    BUFFER = "buffer"
    """Time above the least possible, in %: of fronts alone."""


class Picture(Figure):
    """A figure of matplotlib that a notebook shows, and that `save` writes into a file; no screen is needed."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(facecolor=BACKGROUND, **settings)
        FigureCanvasAgg(self)

    def save(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write the picture as .png, .pdf or .svg; DasError for another suffix, or for an existing file."""
        check_picture(Path(path))
        if Path(path).is_file() and not overwrite:
            raise DasError(f"{path}: exists already; picture.save(…, overwrite=True) replaces it")
        check_writable(Path(path), overwrite=overwrite)
        save_figure(Path(path), self)

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=80)
        return content.getvalue()

    def __repr__(self) -> str:
        return "<Picture: a notebook shows it; in a script, write it with .save('run.png')>"


@dataclass(frozen=True, kw_only=True, eq=False)
class _Runs:
    """The runs of a picture with their labels, and the axis that they are drawn over."""

    runs: Sequence[PlottedRun]
    labels: Sequence[str]
    over: Over

    def x(self, run: PlottedRun) -> Floats:
        """The positions of a run's nodes on the horizontal axis: in km, or in minutes since its beginning."""
        return run.s_m / KM if self.over is Over.DISTANCE else (run.time_s - run.time_s[0]) / MINUTE_S

    def drawn(self) -> Iterator[tuple[PlottedRun, Floats, dict[str, Any]]]:
        """Each run with its coordinates on the horizontal axis and its style."""
        for number, (run, label) in enumerate(zip(self.runs, self.labels, strict=True)):
            yield run, self.x(run), {**look_of(number), "label": label}

    def stops(self) -> list[tuple[str, float]]:
        """Names of the stops of the first run and their coordinates on the horizontal axis."""
        run = self.runs[0]
        if self.over is Over.DISTANCE:
            return [(name, at_m / KM) for name, at_m in run.stops]
        return [(name, float(np.interp(at_m, run.s_m, self.x(run)))) for name, at_m in run.stops]


def draw_runs(runs: Sequence[PlottedRun], over: Over = Over.DISTANCE, labels: Sequence[str] | None = None) -> Picture:
    """Speed with limit and stops, altitude, wheel forces, energy, and the windows of a journey, as far as known. A run
    is named by its label, or else by its differences from the others, and by its time and energy.
    """
    told, title = _told_apart([(*([] if run.route is None else [run.route.name]), *run.names) for run in runs])
    words = told if labels is None else [[label] for label in labels]
    names = [", ".join((*own, run.figures)) for own, run in zip(words, runs, strict=True)]
    shown = _Runs(runs=runs, labels=names, over=over)
    panels = _panels(shown)
    figure, axes = new_figure(list(panels.values()))
    for axis, draw in zip(axes, panels, strict=True):
        draw(axis, shown)
        for _, at in shown.stops():
            axis.axvline(at, color=INK, linewidth=0.6, alpha=0.35)
    name_stops(axes[0], shown.stops())
    axes[-1].set_xlabel("position, km" if over is Over.DISTANCE else "time since the beginning, min", color=INK)
    explain(figure, axes[0], ", ".join(title), credits_of(run.route.credit for run in runs if run.route is not None))
    return figure


def draw_fronts(
    fronts: Sequence[PlottedFront], over: Over = Over.BUFFER, labels: Sequence[str] | None = None
) -> Picture:
    """Least energy over the buffer or the trip time; fronts are named as runs are in `draw_runs`."""
    told, title = _told_apart([front.names for front in fronts])
    names = [", ".join(words) for words in told] if labels is None else labels
    figure, (axis,) = new_figure((4.0,))
    for number, front in enumerate(fronts):
        x = front.buffer_percent if over is Over.BUFFER else front.time_s
        axis.plot(x, kwh(front.energy_j), marker=".", label=names[number], **look_of(number))
    axis.set_xlabel("buffer, % above the least time" if over is Over.BUFFER else "trip time, s", color=INK)
    axis.set_ylabel("energy, kWh", color=INK)
    explain(figure, axis, ", ".join(title), credits_of(front.credit for front in fronts))
    return figure


def _told_apart(names: Sequence[tuple[str, ...]]) -> tuple[list[list[str]], list[str]]:
    """The names of each run that not all runs have, and the names that all have."""
    shared = [name for name in names[0] if all(name in other for other in names)]
    return [[name for name in own if name not in shared] for own in names], shared


def new_figure(heights: Sequence[float], *, below_in: float = 0.0) -> tuple[Picture, list[Any]]:
    """A picture with axes of these heights (in), one below the other, over one horizontal axis.

    With `below_in` (in) there is one more axis, the last, with its own horizontal axis.
    """
    every = [*heights, *([below_in] if below_in else [])]
    figure = Picture(figsize=(WIDTH_IN, sum(every) + 1.4), layout="constrained")
    axes = figure.subplots(len(every), 1, squeeze=False, height_ratios=every)[:, 0].tolist()
    for number, axis in enumerate(axes[: len(heights)]):
        axis.sharex(axes[0]) if number else None
        axis.tick_params(labelbottom=number == len(heights) - 1)
    for axis in axes:
        axis.grid(color=GRID, linewidth=0.6)
        axis.set_axisbelow(True)
        axis.margins(x=0.01)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def credits_of(credits: Iterable[str]) -> str:
    """The origin of the data of a picture's lines; empty if no file states it."""
    return "; ".join(dict.fromkeys(credit for credit in credits if credit))


def explain(figure: Picture, axis: Any, title: str, credit: str = "") -> None:
    """Write the title and the origin of the line's data, and a legend below the picture."""
    lines = [textwrap.fill(title, LETTERS), *([textwrap.fill(f"data: {credit}", LETTERS)] if credit else [])]
    figure.suptitle("\n".join(lines), x=0.01, ha="left", color=INK, fontsize=11)
    handles, labels = axis.get_legend_handles_labels()
    if any(labels):
        figure.legend(handles, labels, loc="outside lower left", ncols=1 + (len(labels) > 4), frameon=False)


def name_stops(axis: Any, stops: Sequence[tuple[str, float]]) -> None:
    """Write the names of stops above an axis, slanted, as far as they do not overlap."""
    low, high = axis.get_xlim()
    last = -math.inf
    for name, at in stops:
        if at - last >= NAME_APART * (high - low):
            last = at
            axis.annotate(
                name, (at, 1.0), (0.0, 3.0), xycoords=("data", "axes fraction"), textcoords="offset points",
                rotation=25, ha="left", color=INK, fontsize=9,
            )  # fmt: skip


def _panels(shown: _Runs) -> dict[Callable[[Any, _Runs], None], float]:
    """The drawing function and the height (in) of each panel that is not empty."""
    runs, first = shown.runs, shown.runs[0]
    rises_m = 0.0 if first.route is None else float(np.ptp(first.route.altitude_m(first.s_m)))
    wanted = (
        (True, _speed, 2.6),
        (rises_m > LEAST_RISE_M, _altitude, 1.0),
        (any(run.force_el_n is not None for run in runs), _force, 1.6),
        (any(run.energy_j is not None for run in runs), _energy, 1.2),
        (any(run.windows for run in runs) and shown.over is Over.DISTANCE, _clock, 1.8),
    )
    return {draw: height_in for is_known, draw, height_in in wanted if is_known}


def _speed(axis: Any, shown: _Runs) -> None:
    """Speeds and limits: over time the limit of the first run, else each that differs from those before."""
    limits: list[Floats] = []
    words = LIMITS_OF_FIRST if shown.over is Over.TIME and len(shown.runs) > 1 else LIMITS
    for run, x, _ in shown.drawn():
        limit = None if run.limit_mps is None else np.column_stack((x, kmh(run.limit_mps)))
        if limit is not None and not any(np.array_equal(limit, other) for other in limits):
            limits.append(limit)
            axis.step(
                *limit.T, where="post", color=LIMIT, linewidth=1.0, alpha=0.8, label=None if limits[1:] else words
            )
        if shown.over is Over.TIME:
            break
    for run, x, look in shown.drawn():
        axis.plot(x, kmh(run.speed_mps), linewidth=1.5, **look)
    axis.set_ylim(bottom=0)
    axis.set_ylabel("speed, km/h", color=INK)


def _altitude(axis: Any, shown: _Runs) -> None:
    """The altitude under the first run, and the steepest gradient under its ends."""
    run = shown.runs[0]
    assert run.route is not None
    altitude_m = run.route.altitude_m(run.s_m)
    low_m, high_m = float(altitude_m.min()) - ALTITUDE_MARGIN_M, float(altitude_m.max()) + ALTITUDE_MARGIN_M
    axis.fill_between(shown.x(run), altitude_m, low_m, color=INK, alpha=0.15, linewidth=0.0)
    axis.set_ylim(low_m, high_m + 0.35 * (high_m - low_m))
    axis.set_ylabel("altitude, m", color=INK)
    inside = run.route.gradients_ratio.at(run.s_m)
    steepest = f"steepest {float(np.abs(inside).max()) / PERMILLE:.1f} ‰"
    axis.text(0.01, 0.92, steepest, transform=axis.transAxes, va="top", fontsize=8, color=INK)


def _force(axis: Any, shown: _Runs) -> None:
    """Wheel forces: for a single run of motors (filled) and friction brake (hatched), for several the sums."""
    for run, x, look in shown.drawn():
        if run.force_el_n is None:
            continue
        friction_n = np.zeros_like(run.force_el_n) if run.force_friction_n is None else run.force_friction_n
        if len(shown.runs) > 1:
            axis.step(x, (run.force_el_n + friction_n) / KN, where="post", linewidth=1.0, **{**look, "label": None})
            continue
        axis.fill_between(x, run.force_el_n / KN, step="post", color=look["color"], alpha=0.6, lw=0.0, label="motors")
        if friction_n.any():
            axis.fill_between(
                x, run.force_el_n / KN, (run.force_el_n + friction_n) / KN, step="post",
                facecolor="none", edgecolor=look["color"], hatch="////", lw=0.0, label="friction brake",
            )  # fmt: skip
            axis.legend(loc="upper right", frameon=False, fontsize=8)
    axis.axhline(0.0, color=INK, linewidth=0.6)
    axis.set_ylabel("wheel force, kN", color=INK)


def _energy(axis: Any, shown: _Runs) -> None:
    """The net energy at the current collector since the beginning."""
    for run, x, look in shown.drawn():
        if run.energy_j is not None:
            axis.plot(x, kwh(run.energy_j), linewidth=1.2, **look)
    axis.set_ylabel("energy, kWh", color=INK)


def _clock(axis: Any, shown: _Runs) -> None:
    """The time since the first departure, and the time windows of the journey; windows of arrivals are hollow."""
    for run, x, look in shown.drawn():
        begin_s = float(run.time_s[0])
        axis.plot(x, (run.time_s - begin_s) / MINUTE_S, linewidth=1.2, **look)
        for one in run.windows:
            for marker, bound_s in (("^", one.window.earliest_s), ("v", one.window.latest_s)):
                if math.isfinite(bound_s):
                    at = one.position_m / KM, (bound_s - begin_s) / MINUTE_S
                    face = "none" if one.of == "arrival" else look["color"]
                    axis.plot(*at, marker, color=look["color"], mfc=face, ms=7)
    axis.set_ylabel("min since the\nfirst departure", color=INK)
    told = "▲ not before  ▼ not after (△▽ arrivals)"
    axis.text(0.01, 0.92, told, transform=axis.transAxes, va="top", fontsize=8, color=INK)
