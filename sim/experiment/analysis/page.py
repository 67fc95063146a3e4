"""The page of an analysis with its forest plots, and the same findings for programs.

The pictures are dark on white, with units, in colours that people with any colour vision can tell apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.figure import Figure

import sim.review.report
from das import __version__
from das.drawing.colors import SEVERAL
from sim.experiment.analysis import words
from sim.experiment.analysis.comparing import ConditionValues, FoundDifference, StudyFindings
from sim.experiment.analysis.reading import Floats, ShownMeasure, probability
from sim.experiment.design import PlannedComparison
from sim.meanings import LIGHT
from sim.review.canvas import INK, as_image, light_figure, named

TEMPLATE: Final = "page.html.j2"
COLUMNS_AT_ONCE: Final = 5
"""Number of measures in a table of the conditions."""
BLUE: Final = SEVERAL[0]
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
    content = environment.get_template(TEMPLATE).render(
        found=found,
        design=found.study.design,
        version=__version__,
        theme=LIGHT,
        words=words,
        probability=probability,
        size=_size,
        difference_images=_difference_images(found),
        varying=[one for one in found.measures if _varies(found, one)],
        columns_at_once=COLUMNS_AT_ONCE,
        values={(one.condition, one.measure): one for one in found.conditions},
        mean_and_spread=_mean_and_spread,
    )
    return content.replace(" %", "\u00a0%")  # no line ends between a number and its percent sign


def _size(value: float) -> str:
    """An effect in standard deviations with its sign; empty if it is not known."""
    return "" if math.isnan(value) else f"{value:+.2f}".replace("-", "−")


def _difference_images(found: StudyFindings) -> list[dict[str, str]]:
    images = []
    for shown in found.measures:
        some = [one for one in found.differences if one.shown.column == shown.column]
        if some:
            image = as_image(_differences_figure(some, found.study.design.alpha))
            images.append({"image": image, "text": f"{shown.name}: {shown.text}." if shown.text else shown.name})
    return images


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
    design = found.study.design
    said = (f"{name}: {line}" if name else line for name, line in words.in_short(found))
    content: dict[str, Any] = _plain(
        {
            "study": design.name,
            "design_hash": design.hash,
            "in_words": [*words.hangs_on(found), *said],
            "alpha": design.alpha,
            "correction": design.correction,
            "differences": [_difference_dict(one, design.alpha) for one in found.differences],
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
    count = len(one.means)
    return {
        "condition": one.condition,
        "measure": one.measure,
        "trials": one.trials,
        "drivers": count,
        "mean": float(one.means.mean()) if count else None,
        "sd_between_drivers": float(one.means.std(ddof=1)) if count > 1 else None,
    }


def _difference_dict(one: FoundDifference, alpha: float) -> dict[str, Any]:
    comparison, estimate, pairs = one.comparison, one.estimate, one.pairs
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
        "disagrees": one.disagrees,
        "sd": estimate.sd,
        "effect_size": estimate.size,
        "drivers": estimate.participants,
        "pairs": None if pairs is None else len(pairs.owner),
        "unpaired_trials": None if pairs is None else pairs.unpaired,
        "by_driver": None if pairs is None else dict(zip(pairs.participants, pairs.means.tolist(), strict=True)),
        "groups": None if one.groups is None else one.groups.by_driver,
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
