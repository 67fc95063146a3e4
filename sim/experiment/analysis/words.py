"""The findings of a study in plain words and in rows of tables, for readers who were not there."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, Final

import numpy as np

from sim.experiment.analysis.comparing import ConditionValues, FoundDifference, NeededParticipants, StudyFindings
from sim.experiment.analysis.plan import PlannedDifference, StudyPlan
from sim.experiment.analysis.shown import SAME, ShownMeasure, probability

Row = dict[str, str]
CORRECTION_NAMES: Final = {"holm": "Holm", "bonferroni": "Bonferroni", "none": ""}
MOST_COUNTED: Final = 10_000
"""Numbers of participants above this are not told apart."""
MOST_FAILED: Final = 3
"""Failed trials that the page names; failed.csv has all."""
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
        "How often chance alone would show a difference at least this large if there were none. A small p does not say "
        "that the difference is large, and a large p does not say that there is none.",
    ),
    (
        "Corrected p",
        "Among many comparisons, chance alone makes some look large. The p is therefore raised for the number of "
        "comparisons planned.",
    ),
    (
        "Effect in standard deviations (d)",
        "The mean difference, divided by how far the drivers' own differences lie apart. At 0.2 many drivers show the "
        "opposite; at 2 hardly any does.",
    ),
    (
        "Standard deviation",
        "How far single values lie from their mean: about two thirds are closer than one standard deviation. It "
        "is called spread here for short.",
    ),
    (
        "Mixed model",
        "A second computation of the same difference. It gives every driver a level and an effect of his own. It is "
        "called singular where the trials cannot tell such a part from chance.",
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
            "advice and err are assumptions. The figures say what would come out if people were like these drivers.",
            "The intervals cover the chance of drawing other simulated drivers. They do not cover that the "
            "assumptions may be wrong, and more simulated trials do not make that doubt smaller.",
        ]
    return said


def in_short(found: StudyFindings) -> list[tuple[str, str]]:
    """Each planned comparison by its name, with what was found in a sentence or two."""
    if not found.differences and not found.failed:
        return [("", "No comparison was planned; the tables describe the conditions.")]
    broken = [(name, f"It could not be made. {why}.") for name, why in found.failed]
    return [*((one.comparison.name, verdict(one, found.study.plan)) for one in found.differences), *broken]


def verdict(one: FoundDifference, plan: StudyPlan) -> str:
    """What was found on one comparison, and whether it stands out from chance."""
    comparison, shown, estimate = one.comparison, one.shown, one.estimate
    changed = shown.changed(estimate.mean)
    with_b = f"{'as' if changed == SAME else 'than'} with {comparison.b}"
    of_what = "; ".join([comparison.factor, *(f"{name}: {level}" for name, level in comparison.where.items())])
    start = f"{shown.name}: {changed} with {comparison.a} {with_b} ({of_what})"
    drivers = _drivers(one)
    if not estimate.known:
        why = "only one driver took part" if estimate.participants < 2 else "the drivers do not differ at all"
        return f"{start}, for {drivers}. No interval can be given, because {why}."
    said = f"{start}. The 95 % interval is {_reach(shown, estimate.interval)}, from {drivers}."
    chance = f"{'p' if plan.correction == 'none' else 'corrected p'} {probability(one.corrected)}"
    if one.corrected < plan.alpha:
        return f"{said} The difference stands out from chance ({chance})."
    return (
        f"{said} It does not stand out from chance ({chance}): the study neither shows a "
        "difference nor rules one out within the interval."
    )


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
                "name": one.comparison.name,
                "less": _less(one.comparison),
                "measure": f"{shown.name} ({shown.difference_unit})",
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


def _less(comparison: PlannedDifference) -> str:
    """What is taken from what, in words."""
    where = "".join(f", {name}: {level}" for name, level in comparison.where.items())
    return f"{comparison.a} less {comparison.b}{where}"


def _plain_range(interval: tuple[float, float]) -> str:
    low, high = interval
    return "" if math.isnan(low) else f"{low:+.2f} to {high:+.2f}".replace("-", "−")


def model_rows(found: StudyFindings) -> list[Row]:
    """What the mixed model says on each comparison, beside the mean of the pairs."""
    rows = []
    for one in found.differences:
        fit, shown = one.model, one.shown
        row = {"name": one.comparison.name, "unit": shown.difference_unit, "pairs": shown.difference(one.estimate.mean)}
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

    return [row(need) for need in one.needed]


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
    spread = shown.value(float(one.means.std(ddof=1))) if len(one.means) > 1 else ""
    return f"{shown.value(float(one.means.mean()))}{f' ± {spread}' if spread else ''}"


def trial_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """What was driven, and what is missing."""
    trials, plan = found.study.trials, found.study.plan
    driven, failed = ~trials.practice, found.study.failed
    counts = Counter(trials.participant[driven].tolist())
    most = max(counts.values())
    fewer = sorted(name for name, count in counts.items() if count < most)
    missing = sum(most - count for count in counts.values())
    without = {name: int(np.sum(~np.isfinite(values[driven]))) for name, values in trials.values.items()}
    gaps = ", ".join(f"{found.shown(name).name}: {count}" for name, count in without.items() if count)
    return [
        ("drivers", str(len(counts))),
        ("finished trials", str(int(driven.sum()))),
        ("practice trials, left out", str(int(trials.practice.sum()))),
        (
            "missing trials",
            f"{missing}, of {', '.join(fewer)}, against drivers who finished {most}" if fewer else "none: all drivers "
            f"finished {most}",
        ),
        ("failed trials", f"{len(failed)}: {'; '.join(failed[:MOST_FAILED])}{' …' * (len(failed) > MOST_FAILED)}"
         if failed else "none"),
        ("trials without a value", gaps or "none"),
        ("comparisons planned", f"{len(plan.comparisons)}, p corrected by {CORRECTION_NAMES[plan.correction]}"
         if plan.correction != "none" else f"{len(plan.comparisons)}, p not corrected"),
    ]  # fmt: skip


def design_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """The design as it was frozen before the run."""
    plan = found.study.plan
    rows = [("study", plan.name), ("design frozen with hash", plan.hash or "not frozen"), ("seed", str(plan.seed))]
    rows += list(plan.setting)
    for one in plan.factors:
        kind = "every driver drives all" if one.within else "each driver drives one"
        rows.append((one.name, f"{', '.join(one.levels)} ({kind})"))
    return [*rows, ("stands out from chance", f"where the corrected p is below {plan.alpha:g}")]
