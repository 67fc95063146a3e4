"""What was driven and how the study was designed, in rows of tables for readers who were not there."""

from __future__ import annotations

from collections import Counter
from typing import Final

import numpy as np

from sim.experiment.analysis.comparing import StudyFindings
from sim.experiment.analysis.shown import ShownMeasure
from sim.experiment.plan import FIXED

CORRECTION_NAMES: Final = {"holm": "Holm", "bonferroni": "Bonferroni", "none": ""}
MOST_FAILED: Final = 3
"""Failed trials that the page names; failed.csv has all."""


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
            f"{missing}, of {', '.join(fewer)}, against drivers who finished {most}" if fewer else "0: all drivers "
            f"finished {most}",
        ),
        ("failed trials", f"{len(failed)}: {'; '.join(failed[:MOST_FAILED])}{' …' * (len(failed) > MOST_FAILED)}"
         if failed else "0 (a trial fails where the train does not reach its last stop)"),
        ("trials without a value", gaps or "0"),
        ("comparisons planned", f"{len(plan.comparisons)}, p corrected by {CORRECTION_NAMES[plan.correction]}"
         if plan.correction != "none" else f"{len(plan.comparisons)}, p not corrected"),
    ]  # fmt: skip


def design_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """The design as it was frozen before the run."""
    plan = found.study.plan
    rows = [("study", plan.name), ("design frozen with hash", plan.hash or "not frozen"), ("seed", str(plan.seed))]
    rows += [row for name, value in plan.setting for row in (_fixed_rows(value) if name == FIXED else [(name, value)])]
    for one in plan.factors:
        kind = "every driver drives all" if one.within else "each driver drives one"
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
    """What the levels of each factor mean, as far as the data say it."""
    rows = []
    for one in found.study.plan.factors:
        words = found.study.level_words.get(one.name, {})
        rows += [(f"{one.name}: {level}", words[level]) for level in one.levels if level in words]
    return rows


def definition_rows(measures: tuple[ShownMeasure, ...]) -> list[tuple[str, str]]:
    """The definition of each measure, as far as the data say it."""
    return [(one.name, f"{one.text[:1].upper()}{one.text[1:]}") for one in measures if one.text]
