"""The findings of a study in sentences, and the tables of its trials and its design, for readers who were not there."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from itertools import pairwise, permutations
from typing import Final

import numpy as np

from sim.experiment.analysis.comparing import FoundDifference, NeededParticipants, StudyFindings, conditions_of
from sim.experiment.analysis.differences import LEAST_IN_GROUP
from sim.experiment.analysis.reading import SAME, RunStudy, ShownMeasure, probability
from sim.experiment.plan import FIXED, StudyPlan

MOST_COUNTED: Final = 10_000
"""Number of participants above which all are given as "over" it."""
SIGNALS: Final = "signals_passed"
CORRECTION_NAMES: Final = {"holm": "Holm", "bonferroni": "Bonferroni", "none": ""}
MOST_FAILED: Final = 3
"""Failed trials that the page names; failed.csv has all."""
MOST_MISSING: Final = 6
"""Drivers whose missing trials are named in a sentence; the table of the page has all."""


def hangs_on(found: StudyFindings) -> list[str]:
    """Sentences on what all findings depend on: who drove, and what the intervals cover."""
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
    missing = _missing(found.study)
    if missing:
        named = "; ".join(missing[:MOST_MISSING]) + "; …" * (len(missing) > MOST_MISSING)
        said.append(
            f"{found.study.missing.total()} of the {plan.planned.total()} planned trials are missing ({named}). "
            "The drivers who stopped, and the trials that failed, may not be like the others, so that the means may be "
            "off; and the orders of the conditions are no longer balanced as designed."
        )
    return said


def _missing(study: RunStudy) -> list[str]:
    """The planned trials that are missing, a text for each driver."""
    by_driver, planned = defaultdict(list), Counter[str]()
    for (name, _), count in study.plan.planned.items():
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
    """Each planned comparison by its name, with what was found in a sentence or two."""
    if not found.differences and not found.failed:
        return [("", "No comparison was planned; the tables describe the conditions.")]
    broken = [(name, f"The comparison could not be made: {why}.") for name, why in found.failed]
    said = [(one.comparison.title, verdict(one, found.study.plan)) for one in found.differences]
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


def verdict(one: FoundDifference, plan: StudyPlan) -> str:
    """The result of a comparison, and whether it stands out from chance."""
    comparison, shown, estimate = one.comparison, one.shown, one.estimate
    changed = shown.changed(estimate.mean)
    with_b = f"{'as' if changed == SAME else 'than'} with “{comparison.b}”"
    of_what = "; ".join([comparison.factor, *(f"{name}: {level}" for name, level in comparison.where.items())])
    start = f"{shown.name}: {changed} with “{comparison.a}” {with_b} ({of_what})"
    drivers = _drivers(one)
    if not estimate.known:
        return f"{start}, for {drivers}. No interval can be given, because {_why_unknown(one)}."
    said = f"{start}. The 95 % interval is {_reach(shown, estimate.interval)}, from {drivers}."
    chance = f"{'p' if plan.correction == 'none' else 'corrected p'} {probability(one.corrected)}"
    if one.corrected < plan.alpha:
        return f"{said} The difference stands out from chance ({chance}).{_but(one)}"
    return (
        f"{said} It does not stand out from chance ({chance}): the study neither shows a "
        f"difference nor rules one out within the interval.{_but(one)}"
    )


def _why_unknown(one: FoundDifference) -> str:
    """Why a difference has no interval."""
    count, sd = one.estimate.participants, one.estimate.sd
    if math.isnan(sd):
        few = f"a group has fewer than {LEAST_IN_GROUP} drivers"
        return "only one driver took part" if one.groups is None else few
    if sd > 0:
        return f"{count} drivers are too few: whatever they do, p is above 0.05"
    return "the drivers do not differ at all"


def _but(one: FoundDifference) -> str:
    """What limits a verdict: other methods, conditions with the opposite difference, assumptions that do not hold."""
    said = ""
    if one.disagreeing:
        given = "; ".join(
            f"{name} gives {one.shown.range(interval)} {one.shown.difference_unit}"
            for name, interval in one.disagreeing
        )
        said += f" Not every method agrees ({given}), so take this result with care."
    if one.opposed:
        parts = "; ".join(
            f"{part.factor} {part.level}: {one.shown.changed(part.estimate.mean)}" for part in one.opposed
        )
        said += f" This is a mean over conditions that differ; the difference is the other way round with {parts}."
    if one.broken:
        names = "; ".join(f"“{check.name}”" for check in one.broken)
        said += f" Assumptions that do not hold (see the checks below): {names}."
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


def needed_rows(one: FoundDifference) -> list[dict[str, str]]:
    """How many participants a study would need to find a difference, one row for each size of the difference."""

    def many(count: int | None) -> str:
        return f"over {MOST_COUNTED}" if count is None or count > MOST_COUNTED else str(count)

    def row(need: NeededParticipants) -> dict[str, str]:
        named = f" ({need.reason})" if need.reason else ""
        between = "too few drivers to tell" if need.interval is None else " to ".join(map(many, need.interval))
        given = f"{one.shown.factor * need.effect:g} {one.shown.difference_unit}" if need.given else ""
        size = "1 point" if given == "1 points" else given
        return {
            "effect": (size or one.shown.with_unit(need.effect)) + named,
            "count": many(need.participants),
            "range": between,
        }

    return [row(need) for need in sorted(one.needed, key=lambda need: -need.effect)]


def trial_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """How many trials were driven, and which are missing or failed."""
    trials, plan = found.study.trials, found.study.plan
    driven, failed = ~trials.practice, found.study.failed
    counts = Counter(trials.participant[driven].tolist())
    without = {name: int(np.sum(~np.isfinite(values[driven]))) for name, values in trials.values.items()}
    gaps = ", ".join(f"{found.shown(name).name}: {count}" for name, count in without.items() if count)
    return [
        ("drivers", str(len(counts))),
        ("finished trials", str(int(driven.sum()))),
        ("practice trials, left out", str(int(trials.practice.sum()))),
        ("missing trials", _missing_words(found.study, counts)),
        *_order_rows(found.study),
        ("failed trials", f"{len(failed)}: {'; '.join(failed[:MOST_FAILED])}{' …' * (len(failed) > MOST_FAILED)}"
         if failed else "0 (a trial fails where the train does not reach its last stop)"),
        ("trials without a value", gaps or "0"),
        ("comparisons planned", f"{len(plan.comparisons)}, p corrected by {CORRECTION_NAMES[plan.correction]}"
         if plan.correction != "none" else f"{len(plan.comparisons)}, p not corrected"),
    ]  # fmt: skip


def _missing_words(study: RunStudy, counts: Counter[str]) -> str:
    """Which trials are missing: of those planned; where the design does not say them, of what other drivers drove."""
    planned, missing = study.plan.planned.total(), study.missing.total()
    if planned:
        return f"{missing} of {planned} planned" + (f": {'; '.join(_missing(study))}" if missing else "")
    most = max(counts.values())
    fewer = sorted(name for name, count in counts.items() if count < most)
    if not fewer:
        return f"0: all drivers finished {most}"
    missing = sum(most - count for count in counts.values())
    return f"{missing}: {', '.join(fewer)} finished fewer than the {most} of the other drivers"


def _order_rows(study: RunStudy) -> list[tuple[str, str]]:
    """How often conditions of one driver followed each other in the finished trials; no row for a single condition."""
    trials, rows = study.trials, study.driven
    inside = [trials.levels[one.name] for one in study.plan.factors if one.within]
    condition = {row: tuple(str(one[row]) for one in inside) for row in rows.tolist()}
    every = sorted(set(condition.values()))
    if len(every) < 2:
        return []
    followed = Counter(dict.fromkeys(permutations(every, 2), 0))
    ordered = sorted(condition, key=lambda row: (str(trials.participant[row]), trials.position[row]))
    for before, after in pairwise(ordered):
        next_to = trials.position[after] == trials.position[before] + 1
        same = trials.participant[after] == trials.participant[before]
        if same and next_to and condition[before] != condition[after]:
            followed[condition[before], condition[after]] += 1
    least, most = min(followed.values()), max(followed.values())
    times = "once" if most == 1 else f"{most} times"
    said = (
        f"every condition followed every other {times}"
        if least == most
        else (f"not balanced: a condition followed another {least} to {most} times")
    )
    return [("order as driven", said)]


def design_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """The design as it was frozen before the run."""
    plan = found.study.plan
    rows = [("study", plan.name), ("design frozen with hash", plan.hash or "not frozen"), ("seed", str(plan.seed))]
    rows += [row for name, value in plan.setting for row in (_fixed_rows(value) if name == FIXED else [(name, value)])]
    for one in plan.factors:
        kind = "every driver drives all levels" if one.within else "each driver drives one level"
        rows.append((one.name, f"{', '.join(one.levels)} ({kind})"))
    rows += list(found.study.made.items())
    return [*rows, ("stands out from chance", f"where the corrected p is below {plan.alpha:g}")]


def _fixed_rows(value: str) -> list[tuple[str, str]]:
    """A row for each factor that was the same on all trials, under the name that people know."""
    from sim.experiment.factors import FACTORS

    rows = []
    for one in value.split(", "):
        name, _, level = one.partition(": ")
        known = FACTORS.get(name)
        if known is None:
            rows.append((f"{FIXED}: {name}", level))
            continue
        unit = f" {known.unit}" if known.unit and level != "all" else ""
        said = "simulated human driver" if (name, level) == ("driver", "human") else f"{level}{unit}"
        rows.append((f"{FIXED}: {known.title[:1].lower()}{known.title[1:]}", f"{said} ({known.meaning})"))
    return rows


def level_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """What the levels of each factor mean, as far as the data describe them."""
    rows = []
    for one in found.study.plan.factors:
        words = found.study.level_words.get(one.name, {})
        rows += [(f"{one.name}: {level}", words[level]) for level in one.levels if level in words]
    return rows
