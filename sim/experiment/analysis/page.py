"""The page of an analysis with its pictures, and the same findings for programs.

The pictures are dark on white, with units, in colours that people with any colour vision can tell apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import sim.review.report
from das import __version__
from das.drawing.colors import SEVERAL
from sim.experiment.analysis import words
from sim.experiment.analysis.checks import SURE
from sim.experiment.analysis.comparing import (
    WANTED_POWER,
    ConditionValues,
    FoundDifference,
    StudyFindings,
)
from sim.experiment.analysis.reading import Floats, ShownMeasure, probability
from sim.experiment.plan import PlannedComparison
from sim.meanings import LIGHT
from sim.review.canvas import INK, PAGE_WIDTH_IN, TEXT_POINTS, as_image, light_figure, named, plain

TEMPLATE: Final = "page.html.j2"
COLUMNS_AT_ONCE: Final = 5
"""Number of columns in the table of those measures that belong to no comparison."""
BLUE, ORANGE = SEVERAL[0], SEVERAL[1]
FAINT: Final = "#9aa0a6"
ROW_IN: Final = 0.5
SCATTER: Final = 0.16
"""Largest distance (rows) of drivers' points from their row, so that equal values do not hide each other."""


def page(found: StudyFindings) -> str:
    """The page as HTML that needs no other file."""
    style = Path(sim.review.report.__path__[0])  # all pages share their style
    environment = Environment(
        loader=FileSystemLoader([Path(__file__).parent, style]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    compared = {one.comparison.measure for one in found.differences}
    content = environment.get_template(TEMPLATE).render(
        found=found,
        plan=found.study.plan,
        version=__version__,
        theme=LIGHT,
        words=words,
        probability=probability,
        signed=_signed,
        sure=f"{SURE:g}",
        wanted=f"{100 * WANTED_POWER:.0f} %",
        difference_images=_difference_images(found),
        comparison_image=lambda one: as_image(_pair_figure(one) if one.pairs is not None else _group_figure(one)),
        measures=[_measure(found, one) for one in found.measures if one.column in compared],
        others=[one for one in found.measures if one.column not in compared and _varies(found, one)],
        columns_at_once=COLUMNS_AT_ONCE,
        values={(one.condition, one.measure): one for one in found.conditions},
        mean_and_spread=_mean_and_spread,
    )
    return content.replace(" %", "\u00a0%")  # no line ends between a number and its percent sign


def _signed(*values: float) -> str:
    """Numbers with their signs as text, a range with "to" between its ends; empty if they are not known."""
    return "" if math.isnan(values[0]) else " to ".join(f"{one:+.2f}".replace("-", "−") for one in values)


def _difference_images(found: StudyFindings) -> list[dict[str, str]]:
    images = []
    for shown in found.measures:
        some = [one for one in found.differences if one.shown.column == shown.column]
        if some:
            image = as_image(_differences_figure(some, found.study.plan.alpha))
            images.append({"image": image, "text": f"{shown.name}: {shown.text}." if shown.text else shown.name})
    return images


def _measure(found: StudyFindings, shown: ShownMeasure) -> dict[str, Any]:
    """A measure of some comparison, with its values in every condition and their picture."""
    values = [one for one in found.conditions if one.measure == shown.column]
    repeated = any(one.spread is not None and one.spread.separate for one in values)
    return {"shown": shown, "image": as_image(_condition_figure(values, shown)), "rows": values, "repeated": repeated}


def _varies(found: StudyFindings, shown: ShownMeasure) -> bool:
    """Whether a measure has more than one value; one that has not says nothing about the conditions."""
    values = found.study.trials.values[shown.column]
    return len(np.unique(values[np.isfinite(values)])) > 1


def _mean_and_spread(one: ConditionValues, shown: ShownMeasure) -> str:
    if not len(one.means):
        return "–"
    if not np.any(one.means):
        return "0"
    spread = shown.value(float(one.means.std(ddof=1))) if len(one.means) > 1 else ""
    return f"{shown.value(float(one.means.mean()))}{f' ± {spread}' if spread else ''}"


def as_dict(found: StudyFindings) -> dict[str, Any]:
    """The findings for programs: values in the units of the columns of `trials.csv`."""
    plan = found.study.plan
    said = (f"{name}: {line}" if name else line for name, line in words.in_short(found))
    content: dict[str, Any] = _plain(
        {
            "study": plan.name,
            "design_hash": plan.hash,
            "simulated_drivers": plan.simulated,
            "in_words": [*words.hangs_on(found), *said],
            "alpha": plan.alpha,
            "correction": plan.correction,
            "differences": [_difference_dict(one, plan.alpha) for one in found.differences],
            "not_compared": dict(found.failed),
            "conditions": [_condition_dict(one) for one in found.conditions],
            "trials": dict(words.trial_rows(found)),
        }
    )
    return content


def _plain(value: Any) -> Any:
    """A value as JSON takes it: None for numbers and ranges that are not known."""
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        listed = [_plain(one) for one in value]
        return None if isinstance(value, tuple) and isinstance(value[0], float) and listed[0] is None else listed
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _condition_dict(one: ConditionValues) -> dict[str, Any]:
    spread = one.spread
    return {
        "condition": one.condition,
        "measure": one.measure,
        "trials": one.trials,
        "drivers": len(one.means),
        "mean": float(one.means.mean()) if len(one.means) else None,
        "sd_between_drivers": None if spread is None else spread.between,
        "sd_between_drivers_interval": None if spread is None else spread.interval,
        "sd_within_driver": None if spread is None else spread.within,
    }


def _difference_dict(one: FoundDifference, alpha: float) -> dict[str, Any]:
    comparison, estimate, fit = one.comparison, one.estimate, one.model
    pairs = one.pairs
    return {
        "name": comparison.name,
        "measure": comparison.measure,
        "factor": comparison.factor,
        "a": comparison.a,
        "b": comparison.b,
        "where": dict(comparison.where),
        "mean": estimate.mean,
        "interval": estimate.interval,
        "method": estimate.method,
        "p": estimate.probability,
        "p_corrected": one.corrected,
        "stands_out": bool(one.corrected < alpha),
        "t_interval": estimate.t_interval,
        "disagreeing": [name for name, _ in one.disagreeing],
        "sd": estimate.sd,
        "effect_size": estimate.size,
        "effect_size_interval": estimate.size_interval,
        "drivers": estimate.participants,
        "pairs": None if pairs is None else len(pairs.owner),
        "unpaired_trials": None if pairs is None else pairs.unpaired,
        "by_driver": None if pairs is None else dict(zip(pairs.participants, pairs.means.tolist(), strict=True)),
        "groups": None if one.groups is None else one.groups.by_driver,
        "model": None
        if fit is None
        else {
            "effect": fit.effect,
            "interval": fit.interval,
            "sd_of_levels": fit.level_sd,
            "sd_of_effects": fit.effect_sd,
            "noise": list(fit.noise),
            "remark": fit.remark or None,
        },
        "no_model_because": one.model_missing or None,
        "parts": [
            {"factor": part.factor, "level": part.level, "mean": part.estimate.mean, "interval": part.estimate.interval}
            for part in one.parts
        ],
        "checks": [{"name": check.name, "found": check.found, "holds": check.holds} for check in one.checks],
        "participants_needed": [
            {"effect": need.effect, "participants": need.participants, "range": need.interval and list(need.interval)}
            for need in one.needed
        ],
    }


def _differences_figure(found: Sequence[FoundDifference], alpha: float) -> Figure:
    """The planned differences of one measure: the mean with its 95 % interval, and a point for each driver."""
    shown = found[0].shown
    figure, (axis,) = light_figure((max(ROW_IN * len(found) + 0.3, 0.9),))
    for row, one in enumerate(reversed(found)):
        holds = one.corrected < alpha
        if one.pairs is not None:
            values = shown.factor * one.pairs.means
            axis.plot(values, row - _beside(len(values)) - 0.16, ".", color=FAINT, markersize=4.0, zorder=1)
        if one.estimate.known:
            low, high = (shown.factor * bound for bound in one.estimate.interval)
            axis.plot([low, high], [row + 0.2] * 2, color=BLUE, linewidth=2.6, solid_capstyle="butt", zorder=2)
        axis.plot(
            shown.factor * one.estimate.mean, row + 0.2, "o", color=BLUE, markersize=8.0, zorder=3,
            markerfacecolor=BLUE if holds else "white", markeredgewidth=1.6,
        )  # fmt: skip
    axis.axvline(0.0, color=INK, linewidth=0.9)
    axis.set_yticks(range(len(found)), [_label(one.comparison) for one in reversed(found)])
    axis.set_ylim(-0.6, len(found) - 0.4)
    axis.grid(visible=False, axis="y")
    named(axis, x=f"{shown.name}: difference ({shown.difference_unit})")
    return figure


def _label(comparison: PlannedComparison) -> str:
    """The name of a comparison if the user gave one, else which level is subtracted from which."""
    return comparison.name if comparison.title == comparison.name else comparison.contrast("\n")


def _beside(count: int) -> Floats:
    """How far (rows) each of `count` points is drawn beside its row: on alternate sides, always by the same steps."""
    steps = np.array([0.0, 0.5, -0.5, 1.0, -1.0])
    return np.asarray(SCATTER * steps[np.arange(count) % len(steps)])


def _side_by_side(height_in: float, widths: tuple[float, float]) -> tuple[Figure, Any, Any]:
    """A figure with two axes beside each other."""
    figure = Figure(figsize=(PAGE_WIDTH_IN, height_in), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=widths)
    for axis in (left, right):
        plain(axis)
    return figure, left, right


def _pair_figure(one: FoundDifference) -> Figure:
    """A comparison driver by driver: both conditions joined by a line, and the differences in order of size."""
    assert one.pairs is not None
    pairs, shown = one.pairs, one.shown
    b, a = (shown.factor * pairs.by_participant(values) for values in (pairs.b, pairs.a))
    figure, left, right = _side_by_side(3.1, (1.0, 1.6))
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


def _group_figure(one: FoundDifference) -> Figure:
    """A comparison of two groups: a point for each driver's mean, the mean of each group, and the difference."""
    assert one.groups is not None
    groups, shown = one.groups, one.shown
    figure, left, right = _side_by_side(2.6, (1.6, 1.0))
    for row, values in enumerate((groups.b, groups.a)):
        means = shown.factor * values
        left.plot(means, row + _beside(len(means)), ".", color=FAINT, markersize=6.0)
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


def _condition_figure(values: Sequence[ConditionValues], shown: ShownMeasure) -> Figure:
    """A measure in every condition: a point for each driver's mean, and the mean of the drivers."""
    figure, (axis,) = light_figure((max(0.36 * len(values) + 0.3, 0.9),))
    for row, one in enumerate(reversed(values)):
        means = shown.factor * one.means
        axis.plot(means, row + _beside(len(means)), ".", color=FAINT, markersize=5.0)
        if len(means):
            axis.plot(means.mean(), row, "D", color=BLUE, markersize=7.0)
    axis.set_yticks(range(len(values)), [one.condition for one in reversed(values)])
    axis.set_ylim(-0.6, len(values) - 0.4)
    axis.tick_params(axis="y", labelsize=TEXT_POINTS)
    named(axis, x=f"{shown.name} ({shown.unit})")
    return figure
