"""The findings of a study in sentences, and the tables of its trials and its design, for readers who did not take
part."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from typing import Final

import numpy as np

from sim.experiment.analysis.comparing import LEAST_IN_GROUP, FoundDifference, StudyFindings, conditions_of
from sim.experiment.analysis.reading import SAME, RunStudy, ShownMeasure, probability
from sim.experiment.design import Design
from sim.experiment.factors import FACTORS
from sim.experiment.study_files import level_words

SIGNALS: Final = "signals_passed"
CORRECTION_NAMES: Final = {"holm": "Holm", "bonferroni": "Bonferroni"}
MOST_FAILED: Final = 3
"""Failed trials that the page names; failed.csv has all."""
MOST_MISSING: Final = 6
"""Drivers whose missing trials are named in a sentence; the table of the page has all."""


def hangs_on(found: StudyFindings) -> list[str]:
    """Sentences on the assumptions of all findings: the drivers, and the uncertainty that the intervals cover."""
    design, trials = found.study.design, found.study.trials
    drivers = len(np.unique(trials.participant[~trials.practice]))
    count = int((~trials.practice).sum())
    said = [
        f"No person drove. {drivers} simulated drivers from the population “{design.people.population}” made {count} "
        "trials. How they react, look, follow advice and err are assumptions (docs/reference/populations.md and "
        "drivers.md list them). The figures show the result that would be expected if people were like these drivers.",
        "The intervals cover the sampling of simulated drivers. They do not cover errors in the assumptions, "
        "and more simulated trials do not reduce that uncertainty.",
    ]
    missing = _missing(found.study)
    if missing:
        named = "; ".join(missing[:MOST_MISSING]) + "; …" * (len(missing) > MOST_MISSING)
        said.append(
            f"{found.study.missing.total()} of the {design.planned.total()} planned trials are missing ({named}). "
            "The drivers who stopped, and the trials that failed, may not be like the others, so that the means may be "
            "biased; and the orders of the conditions are no longer balanced as designed."
        )
    return said


def _missing(study: RunStudy) -> list[str]:
    """The planned trials that are missing, a text for each driver."""
    by_driver, planned = defaultdict(list), Counter[str]()
    for (name, _), count in study.design.planned.items():
        planned[name] += count
    for (name, condition), count in study.missing.items():
        by_driver[name].append((condition, count))
    found = []
    for name, lacking in by_driver.items():
        total = sum(count for _, count in lacking)
        conditions = ", ".join(condition + (f" ({count})" if count > 1 else "") for condition, count in lacking)
        found.append(f"{name}: all {total}" if total == planned[name] else f"{name}: {conditions}")
    return found


def in_short(found: StudyFindings) -> list[tuple[str, str]]:
    """Each planned comparison by its name, with the finding in a sentence or two."""
    if not found.differences and not found.failed:
        return [("", "No comparison was planned; the tables describe the conditions.")]
    broken = [(name, f"The comparison could not be made: {why}.") for name, why in found.failed]
    said = [(one.comparison.title, verdict(one, found.study.design)) for one in found.differences]
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


def verdict(one: FoundDifference, design: Design) -> str:
    """The result of a comparison, and whether it is statistically significant."""
    comparison, shown, estimate = one.comparison, one.shown, one.estimate
    changed = shown.changed(estimate.mean)
    with_b = f"{'as' if changed == SAME else 'than'} with “{comparison.b}”"
    of_what = "; ".join([comparison.factor, *(f"{name}: {level}" for name, level in comparison.where.items())])
    start = f"{shown.name}: {changed} with “{comparison.a}” {with_b} ({of_what})"
    drivers = _drivers(one)
    if not estimate.known:
        return f"{start}, for {drivers}. No interval can be given, because {_why_unknown(one)}."
    said = f"{start}. The 95 % interval is {_reach(shown, estimate.interval)}, from {drivers}."
    chance = f"{'p' if design.correction == 'none' else 'corrected p'} {probability(one.corrected)}"
    other = f"Student's t disagrees ({shown.range(estimate.t_interval)} {shown.difference_unit}): take care."
    but = f" {other}" if one.disagrees else ""
    if one.corrected < design.alpha:
        return f"{said} The difference is statistically significant ({chance}).{but}"
    return (
        f"{said} It is not statistically significant ({chance}): the study neither shows a "
        f"difference nor rules one out within the interval.{but}"
    )


def _why_unknown(one: FoundDifference) -> str:
    """The reason why a difference has no interval."""
    count, sd = one.estimate.participants, one.estimate.sd
    if math.isnan(sd):
        few = f"a group has fewer than {LEAST_IN_GROUP} drivers"
        return "only one driver took part" if one.groups is None else few
    if sd > 0:
        return f"{count} drivers are too few: p exceeds 0.05 for any data"
    return "the drivers do not differ at all"


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


def trial_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """The number of trials driven, and which ones are missing or failed."""
    trials, design = found.study.trials, found.study.design
    driven, failed, missing = ~trials.practice, found.study.failed, found.study.missing.total()
    counts = Counter(trials.participant[driven].tolist())
    without = {name: int(np.sum(~np.isfinite(values[driven]))) for name, values in trials.values.items()}
    gaps = ", ".join(f"{found.shown(name).name}: {count}" for name, count in without.items() if count)
    return [
        ("drivers", str(len(counts))),
        ("finished trials", str(int(driven.sum()))),
        ("practice trials, left out", str(int(trials.practice.sum()))),
        ("missing trials", f"{missing} of {design.planned.total()} planned{': ' * (missing > 0)}"
         f"{'; '.join(_missing(found.study))}"),
        ("failed trials", f"{len(failed)}: {'; '.join(failed[:MOST_FAILED])}{' …' * (len(failed) > MOST_FAILED)}"
         if failed else "0 (a trial fails if the train does not reach its last stop)"),
        ("trials without a value", gaps or "0"),
        ("comparisons planned", f"{len(design.comparisons)}, p corrected by {CORRECTION_NAMES[design.correction]}"
         if design.correction != "none" else f"{len(design.comparisons)}, p not corrected"),
    ]  # fmt: skip


def design_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """The design as frozen before the run."""
    design = found.study.design
    rows = [("study", design.name), ("design frozen with hash", design.hash or "not frozen")]
    procedure = design.procedure
    rows += [
        ("seed", str(design.seed)),
        ("order, days, chances", f"{procedure.order}, {procedure.days}, {procedure.chances}"),
    ]
    for name, level in design.fixed.items():
        known = FACTORS.get(name)
        unit = f" {known.unit}" if known is not None and known.unit and level.text != "all" else ""
        rows.append((f"not varied: {name if known is None else known.title.lower()}", f"{level.text}{unit}"))
    for one in design.factors:
        kind = "every driver drives all levels" if one.within else "each driver drives one level"
        rows.append((one.name, f"{', '.join(one.texts)} ({kind})"))
    return [*rows, ("statistically significant", f"if the corrected p is below {design.alpha:g}")]


def level_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """The meaning of each factor's levels, unless their names state it."""
    words = [
        (f"{one.name}: {level}", level_words(one.name, level))
        for one in found.study.design.factors
        for level in one.texts
    ]
    return [(name, text) for name, text in words if text]
