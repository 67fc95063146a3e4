"""The findings of a study in plain words and in rows of tables, for readers who were not there."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from sim.experiment.analysis.comparing import (
    ConditionValues,
    FoundDifference,
    NeededParticipants,
    StudyFindings,
    conditions_of,
)
from sim.experiment.analysis.shown import SAME, ShownMeasure, probability
from sim.experiment.plan import PlannedComparison, StudyPlan

Row = dict[str, str]
MOST_COUNTED: Final = 10_000
"""Numbers of participants above this are not told apart."""
SIGNALS: Final = "signals_passed"
COLUMNS_AT_ONCE: Final = 5
"""Measures beside each other in the table of those that no comparison is about."""

TERMS: Final = (
    (
        "Paired difference",
        "Each driver drives the same day under both conditions. One value is taken from the other, so that what makes "
        "a driver or a day different drops out. Then the mean is taken, first for each driver, and over the drivers.",
    ),
    (
        "Points",
        "The difference of two percentages: from 8 % to 6 % are 2 points.",
    ),
    (
        "95 % interval",
        "The range of differences that this study is compatible with. If the study were made again and again with "
        "other drivers of the same kind, 95 of 100 such ranges would hold the true difference.",
    ),
    (
        "Resampled drivers",
        "The interval comes from drawing the study's drivers again at random, thousands of times, some twice and some "
        "not at all, and looking how the mean moves (studentized bootstrap). It does not assume a bell curve.",
    ),
    (
        "p",
        "How often chance alone would show a difference at least this large if there were none, by the same resampled "
        "drivers as the interval. A small p does not say that the difference is large, and a large p does not say that "
        "there is none.",
    ),
    (
        "Corrected p",
        "Among many comparisons, chance alone makes some look large. The p is therefore raised for the number of "
        "comparisons planned. By Holm's method the smallest is raised the most, and the largest not at all.",
    ),
    (
        "Effect in standard deviations (d)",
        "The mean difference, divided by how far the drivers' own differences lie apart (d_z, interval from the "
        "noncentral t distribution). At 0.2 many drivers show the opposite; at 2 hardly any does. For two groups it is "
        "divided by how far drivers of one group lie apart (d, interval by Bonett 2008), and is much smaller.",
    ),
    (
        "Two groups",
        "Where each driver drives one of the two conditions only, the means of two groups of drivers are compared. "
        "What makes drivers different stays in the difference, so that many more of them are needed.",
    ),
    (
        "Standard deviation",
        "How far single values lie from their mean: about two thirds are closer than one standard deviation. It "
        "is called spread here for short.",
    ),
    (
        "Mixed model",
        "A second computation of the same difference. It gives every driver a level and an effect of his own. It is "
        "called singular where the trials cannot tell such a part from chance. Value = level + condition + day or "
        "other conditions + place in the order + driver's own level + driver's own effect + noise of the condition, by "
        "restricted maximum likelihood; its interval is Student's t with one degree of freedom less than drivers.",
    ),
)


def hangs_on(found: StudyFindings) -> list[str]:
    """What the answer hangs on: said before any figure."""
    plan, trials = found.study.plan, found.study.trials
    population = dict(plan.setting).get("drivers drawn from the population")
    drawn = f" from the population “{population}”" if population else ""
    drivers = len(np.unique(trials.participant[~trials.practice]))
    count = int((~trials.practice).sum())
    if not plan.simulated:
        said = [
            f"{drivers} people drove {count} trials. What they did holds for people like them, on this line and train."
        ]
    else:
        said = [
            f"Nobody drove. {drivers} simulated drivers{drawn} made {count} trials. How they react, look, follow "
            "advice and err are assumptions (docs/reference/populations.md and drivers.md list them). The figures say "
            "what would come out if people were like these drivers.",
            "The intervals cover the chance of drawing other simulated drivers. They do not cover that the "
            "assumptions may be wrong, and more simulated trials do not make that doubt smaller.",
        ]
    return said


def in_short(found: StudyFindings) -> list[tuple[str, str]]:
    """Each planned comparison by its name, with what was found in a sentence or two."""
    if not found.differences and not found.failed:
        return [("", "No comparison was planned; the tables describe the conditions.")]
    broken = [(name, f"It could not be made. {why}.") for name, why in found.failed]
    said = [(short_title(one.comparison), verdict(one, found.study.plan)) for one in found.differences]
    return [*said, *broken, *_safety(found)]


def _safety(found: StudyFindings) -> list[tuple[str, str]]:
    """A sentence on signals that were passed at danger, whether or not a comparison was planned about them."""
    trials = found.study.trials
    if SIGNALS not in trials.values:
        return []
    passed = np.nan_to_num(trials.values[SIGNALS]) * ~trials.practice
    where = [
        f"{int(passed[mine].sum())} with {name}" for name, mine in conditions_of(found.study) if passed[mine].any()
    ]
    count = int(passed.sum())
    if not count:
        return []
    times = "1 signal was" if count == 1 else f"{count} signals were"
    return [("Safety", f"{times} passed at danger in {int((~trials.practice).sum())} trials ({'; '.join(where)}).")]


def title(comparison: PlannedComparison, shown: ShownMeasure) -> str:
    """The name of a comparison, or in words where the design gave it none of its own."""
    short = short_title(comparison)
    return short if short == comparison.name else f"{shown.name}: {short}"


def short_title(comparison: PlannedComparison) -> str:
    """The name of a comparison, or what is taken from what where the design gave it no name of its own."""
    return contrast(comparison) if comparison.name.startswith(f"{comparison.measure}: ") else comparison.name


def contrast(comparison: PlannedComparison) -> str:
    """What is taken from what, in words."""
    where = "".join(f", {name}: {level}" for name, level in comparison.where.items())
    return f"{comparison.a} minus {comparison.b}{where}"


def verdict(one: FoundDifference, plan: StudyPlan) -> str:
    """What was found on one comparison, and whether it stands out from chance."""
    comparison, shown, estimate = one.comparison, one.shown, one.estimate
    changed = shown.changed(estimate.mean)
    with_b = f"{'as' if changed == SAME else 'than'} with “{comparison.b}”"
    of_what = "; ".join([comparison.factor, *(f"{name}: {level}" for name, level in comparison.where.items())])
    start = f"{shown.name}: {changed} with “{comparison.a}” {with_b} ({of_what})"
    drivers = _drivers(one)
    if not estimate.known:
        why = "only one driver took part" if estimate.participants < 2 else "the drivers do not differ at all"
        return f"{start}, for {drivers}. No interval can be given, because {why}."
    said = f"{start}. The 95 % interval is {_reach(shown, estimate.interval)}, from {drivers}."
    chance = f"{'p' if plan.correction == 'none' else 'corrected p'} {probability(one.corrected)}"
    if one.corrected < plan.alpha:
        return f"{said} The difference stands out from chance ({chance}).{_but(one)}"
    return (
        f"{said} It does not stand out from chance ({chance}): the study neither shows a "
        f"difference nor rules one out within the interval.{_but(one)}"
    )


def _but(one: FoundDifference) -> str:
    """What limits a verdict: conditions that go the other way, assumptions that do not hold."""
    said = ""
    if one.opposed:
        parts = "; ".join(
            f"{part.factor} {part.level}: {one.shown.changed(part.estimate.mean)}" for part in one.opposed
        )
        said += f" This is a mean over conditions that differ: the other way round with {parts}."
    if one.broken:
        names = "; ".join(f"“{check.name}”" for check in one.broken)
        said += f" What does not hold below: {names}."
    return said


def _drivers(one: FoundDifference) -> str:
    if one.groups is not None:
        return f"two groups of {len(one.groups.a)} and {len(one.groups.b)} drivers"
    assert one.pairs is not None
    return f"{len(one.pairs.participants)} drivers, {len(one.pairs.owner)} pairs"


def _reach(shown: ShownMeasure, interval: tuple[float, float]) -> str:
    low, high = interval
    if low < 0 < high:
        return f"from {shown.with_unit(low)} lower to {shown.with_unit(high)} higher"
    near, far = sorted((abs(low), abs(high)))
    return f"{shown.value(near)} to {shown.with_unit(far)} {'lower' if high <= 0 else 'higher'}"


def difference_rows(found: StudyFindings) -> list[Row]:
    """The planned differences, the interval first."""
    rows = []
    for one in found.differences:
        estimate, shown = one.estimate, one.shown
        rows.append(
            {
                "name": title(one.comparison, shown),
                "less": contrast(one.comparison),
                "unit": shown.difference_unit,
                "mean": shown.difference(estimate.mean),
                "interval": shown.range(estimate.interval)
                + ("" if estimate.resampled or not estimate.known else " (t)"),
                "corrected": probability(one.corrected),
                "plain": probability(estimate.probability),
                "size": "" if math.isnan(estimate.size) else f"{estimate.size:+.2f}".replace("-", "−"),
                "size_interval": _plain_range(estimate.size_interval),
                "t": shown.range(estimate.t_interval),
                "drivers": str(estimate.participants),
                "pairs": "" if one.pairs is None else str(len(one.pairs.owner)),
                "unpaired": "" if one.pairs is None else str(one.pairs.unpaired),
            }
        )
    return rows


def _plain_range(interval: tuple[float, float]) -> str:
    low, high = interval
    return "" if math.isnan(low) else f"{low:+.2f} to {high:+.2f}".replace("-", "−")


def model_rows(found: StudyFindings) -> list[Row]:
    """What the mixed model says on each comparison, beside the mean of the pairs."""
    rows = []
    for one in found.differences:
        fit, shown = one.model, one.shown
        row = {
            "name": title(one.comparison, shown),
            "unit": shown.difference_unit,
            "pairs": shown.difference(one.estimate.mean),
        }
        if fit is None:
            row |= dict.fromkeys(("effect", "interval", "level", "own", "noise_a", "noise_b"), "")
            rows.append({**row, "remarks": f"No model: {one.model_missing}."})
            continue
        rows.append(
            {
                **row,
                "effect": shown.difference(fit.effect),
                "interval": shown.range(fit.interval),
                "level": shown.value(fit.level_sd),
                "own": shown.value(fit.effect_sd),
                "noise_a": shown.value(fit.noise[0]),
                "noise_b": shown.value(fit.noise[1]),
                "remarks": " ".join(fit.remarks),
            }
        )
    return rows


def singular_fits(found: StudyFindings) -> list[str]:
    """The comparisons whose mixed model is singular."""
    fitted = [one for one in found.differences if one.model is not None and one.model.singular]
    return [title(one.comparison, one.shown) for one in fitted]


def needed_rows(one: FoundDifference) -> list[Row]:
    """How many participants would find a difference."""

    def many(count: int | None) -> str:
        return f"over {MOST_COUNTED}" if count is None or count > MOST_COUNTED else str(count)

    def row(need: NeededParticipants) -> Row:
        low, high = need.interval
        named = f" ({need.reason})" if need.reason else ""
        between = f"{many(low)} to {many(high)}"
        given = f"{one.shown.factor * need.effect:g} {one.shown.difference_unit}" if need.given else ""
        size = "1 point" if given == "1 points" else given
        return {
            "effect": (size or one.shown.with_unit(need.effect)) + named,
            "count": many(need.participants),
            "range": between,
        }

    return [row(need) for need in sorted(one.needed, key=lambda need: -need.effect)]


def part_rows(found: StudyFindings) -> list[Row]:
    """Each planned difference at each level of the other factors that it is a mean over."""
    return [
        {
            "name": title(one.comparison, one.shown),
            "where": f"{part.factor}: {part.level}",
            "unit": one.shown.difference_unit,
            "mean": one.shown.difference(part.estimate.mean),
            "interval": one.shown.range(part.estimate.interval),
            "drivers": str(part.estimate.participants),
        }
        for one in found.differences
        for part in one.parts
    ]


def condition_rows(values: list[ConditionValues], shown: ShownMeasure) -> list[Row]:
    """A measure in every condition."""
    rows = []
    for one in values:
        spread = one.spread
        bounds = (math.nan, math.nan) if spread is None else spread.interval
        between = "" if spread is None else shown.value(spread.between)
        if between and math.isfinite(bounds[0]):
            between += f" ({shown.value(bounds[0])} to {shown.value(bounds[1])})"
        rows.append(
            {
                "condition": one.condition,
                "trials": str(one.trials),
                "drivers": str(len(one.means)),
                "mean": shown.value(float(one.means.mean())) if len(one.means) else "",
                "between": between,
                "within": "" if spread is None or not spread.separate else shown.value(spread.within),
                "range": f"{shown.value(float(one.means.min()))} to {shown.value(float(one.means.max()))}"
                if len(one.means)
                else "",
            }
        )
    return rows


def other_tables(found: StudyFindings) -> list[dict[str, Any]]:
    """The measures that no comparison is about, a few beside each other: mean ± spread of the drivers."""
    compared = {one.comparison.measure for one in found.differences}
    others = [one for one in found.measures if one.column not in compared]
    values = {(one.condition, one.measure): one for one in found.conditions}
    conditions = list(dict.fromkeys(one.condition for one in found.conditions))
    tables = []
    for start in range(0, len(others), COLUMNS_AT_ONCE):
        some = others[start : start + COLUMNS_AT_ONCE]
        rows = [
            {"condition": condition, "cells": [_mean_and_spread(values[condition, one.column], one) for one in some]}
            for condition in conditions
        ]
        tables.append({"heads": [f"{one.name} ({one.unit})" for one in some], "rows": rows})
    return tables


def _mean_and_spread(one: ConditionValues, shown: ShownMeasure) -> str:
    if not len(one.means):
        return "–"
    if not np.any(one.means):
        return "0"
    spread = shown.value(float(one.means.std(ddof=1))) if len(one.means) > 1 else ""
    return f"{shown.value(float(one.means.mean()))}{f' ± {spread}' if spread else ''}"
