"""The pictures of an analysis: dark on white, with units, for people with any colour vision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sim.experiment.analysis.comparing import ConditionValues, FoundDifference
from sim.experiment.analysis.shown import ShownMeasure
from sim.review.colors import SEVERAL
from sim.review.light import INK, TEXT_POINTS, WIDTH_IN, light_figure, named, plain

if TYPE_CHECKING:
    from sim.experiment.analysis.reading import Floats

BLUE, ORANGE = SEVERAL[0], SEVERAL[1]
FAINT: Final = "#9aa0a6"
ROW_IN: Final = 0.5
SCATTER: Final = 0.16
"""Points of drivers lie at most this far (rows) beside their row, so that equal ones can be counted."""


def differences_figure(found: Sequence[FoundDifference], alpha: float) -> Figure:
    """The planned differences of one measure: the mean with its 95 % interval, and a point for each driver."""
    shown = found[0].shown
    figure, (axis,) = light_figure((max(ROW_IN * len(found) + 0.3, 0.9),))
    for row, one in enumerate(reversed(found)):
        holds = one.corrected < alpha
        if one.pairs is not None:
            values = shown.factor * one.pairs.by_participant(one.pairs.differences)
            axis.plot(values, row - beside(len(values)) - 0.16, ".", color=FAINT, markersize=4.0, zorder=1)
        if one.estimate.known:
            low, high = (shown.factor * bound for bound in one.estimate.interval)
            axis.plot([low, high], [row + 0.2] * 2, color=BLUE, linewidth=2.6, solid_capstyle="butt", zorder=2)
        axis.plot(
            shown.factor * one.estimate.mean, row + 0.2, "o", color=BLUE, markersize=8.0, zorder=3,
            markerfacecolor=BLUE if holds else "white", markeredgewidth=1.6,
        )  # fmt: skip
    axis.axvline(0.0, color=INK, linewidth=0.9)
    axis.set_yticks(range(len(found)), [_label(one) for one in reversed(found)])
    axis.set_ylim(-0.6, len(found) - 0.4)
    axis.grid(visible=False, axis="y")
    named(axis, x=f"{shown.name}: difference ({shown.difference_unit})")
    return figure


def _label(one: FoundDifference) -> str:
    """The own name of a comparison, or what is taken from what."""
    comparison = one.comparison
    named_by_design = not comparison.name.startswith(f"{comparison.measure}: ")
    where = "".join(f"\n{name}: {level}" for name, level in comparison.where.items())
    return comparison.name if named_by_design else f"{comparison.a} minus {comparison.b}{where}"


def beside(count: int) -> Floats:
    """How far (rows) each of some points is drawn beside its row: back and forth, always the same."""
    steps = np.array([0.0, 0.5, -0.5, 1.0, -1.0])
    return np.asarray(SCATTER * steps[np.arange(count) % len(steps)])


def pair_figure(one: FoundDifference) -> Figure:
    """A comparison driver by driver: both conditions joined by a line, and the differences in order of size."""
    assert one.pairs is not None
    pairs, shown = one.pairs, one.shown
    b, a = (shown.factor * pairs.by_participant(values) for values in (pairs.b, pairs.a))
    figure = Figure(figsize=(WIDTH_IN, 3.1), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.6])
    for axis in (left, right):
        plain(axis)
    for before, after in zip(b, a, strict=True):
        color = BLUE if after < before else ORANGE
        left.plot(
            [0, 1], [before, after], color=color, linewidth=0.9, linestyle="-" if after < before else "--", alpha=0.8
        )
    left.plot([0, 1], [b.mean(), a.mean()], color=INK, linewidth=2.6, marker="o")
    left.set_xticks([0, 1], [one.comparison.b, one.comparison.a])
    left.set_xlim(-0.25, 1.25)
    named(left, y=f"{shown.name} ({shown.unit})")
    _sorted_differences(right, a - b, one, shown)
    return figure


def group_figure(one: FoundDifference) -> Figure:
    """A comparison of two groups: a point for each driver's mean, the mean of each group, and the difference."""
    assert one.groups is not None
    groups, shown = one.groups, one.shown
    figure = Figure(figsize=(WIDTH_IN, 2.6), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=[1.6, 1.0])
    for axis in (left, right):
        plain(axis)
    for row, values in enumerate((groups.b, groups.a)):
        means = shown.factor * values
        left.plot(means, row + beside(len(means)), ".", color=FAINT, markersize=6.0)
        left.plot(means.mean(), row, "D", color=BLUE, markersize=7.0)
    left.set_yticks([0, 1], [one.comparison.b, one.comparison.a])
    left.set_ylim(-0.5, 1.5)
    left.grid(visible=False, axis="y")
    named(left, x=f"{shown.name} ({shown.unit})")
    if one.estimate.known:
        right.plot([shown.factor * bound for bound in one.estimate.interval], [0, 0], color=BLUE, linewidth=2.6)
    right.plot(shown.factor * one.estimate.mean, 0, "o", color=BLUE, markersize=8.0)
    right.axvline(0.0, color=INK, linewidth=0.9)
    right.set_yticks([])
    right.grid(visible=False, axis="y")
    named(right, x=f"{one.comparison.a} minus {one.comparison.b} ({shown.difference_unit})")
    return figure


def _sorted_differences(axis: Any, differences: Floats, one: FoundDifference, shown: ShownMeasure) -> None:
    ordered = np.sort(differences)
    numbers = np.arange(1, len(ordered) + 1)
    lower = ordered < 0
    axis.plot(numbers[lower], ordered[lower], "o", color=BLUE, markersize=5.0)
    axis.plot(numbers[~lower], ordered[~lower], "D", color=ORANGE, markersize=4.6)
    axis.axhline(0.0, color=INK, linewidth=0.9)
    axis.axhline(shown.factor * one.estimate.mean, color=INK, linewidth=2.0)
    if one.estimate.known:
        low, high = (shown.factor * bound for bound in one.estimate.interval)
        axis.axhspan(low, high, color=SEVERAL[4], alpha=0.3, linewidth=0.0)
    named(
        axis, x="Drivers in order of their difference",
        y=f"{one.comparison.a} minus {one.comparison.b} ({shown.difference_unit})",
    )  # fmt: skip


def condition_figure(values: Sequence[ConditionValues], shown: ShownMeasure) -> Figure:
    """A measure in every condition: a point for each driver's mean, and the mean of the drivers."""
    figure, (axis,) = light_figure((max(0.36 * len(values) + 0.3, 0.9),))
    for row, one in enumerate(reversed(values)):
        means = shown.factor * one.means
        axis.plot(means, row + beside(len(means)), ".", color=FAINT, markersize=5.0)
        if len(means):
            axis.plot(means.mean(), row, "D", color=BLUE, markersize=7.0)
    axis.set_yticks(range(len(values)), [one.condition for one in reversed(values)])
    axis.set_ylim(-0.6, len(values) - 0.4)
    axis.tick_params(axis="y", labelsize=TEXT_POINTS)
    named(axis, x=f"{shown.name} ({shown.unit})")
    return figure
