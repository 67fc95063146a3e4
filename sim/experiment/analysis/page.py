"""The findings of a study: as sentences, as a page with forest plots, and for programs.

The pictures are dark on white, with units, in colours that are distinguishable with any colour vision.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import sim.review
from das import __version__
from das.drawing.colors import SEVERAL
from sim.experiment.analysis.comparing import (
    LEAST_IN_GROUP,
    SAME,
    ConditionValues,
    Floats,
    FoundDifference,
    RunStudy,
    ShownMeasure,
    StudyFindings,
    conditions_of,
    probability,
    student,
)
from sim.experiment.analysis.together import DRIVER, Together
from sim.experiment.design import Design, PlannedComparison
from sim.experiment.factors import FACTORS
from sim.experiment.study_files import level_meaning
from sim.meanings import LIGHT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGNALS: Final = "signals_passed"
MOST_FAILED: Final = 3
"""Largest number of failed trials listed on the page; failed.csv has all."""
MOST_MISSING: Final = 6
"""Largest number of drivers whose missing trials are listed in a sentence; the page's table has all."""
TEMPLATE: Final = "page.html.j2"
COLUMNS_AT_ONCE: Final = 5
"""Number of measures in a table of the conditions."""
BLUE: Final = SEVERAL[0]
FAINT: Final = "#9aa0a6"
ROW_IN: Final = 0.5
SCATTER: Final = 0.16
"""Largest distance (rows) of drivers' points from the row's centre, so that equal values do not hide each other."""


def hangs_on(found: StudyFindings) -> list[str]:
    """Sentences on the assumptions of all findings: the drivers, and the uncertainty that the intervals cover."""
    sources = tuple(found.study.parts.values()) or (found.study,)
    said = list(dict.fromkeys(line for study in sources for line in _drove(study)))
    if not any(study.with_people for study in sources):
        said[0] = f"No person drove. {said[0]}"
    missing = _missing(found.study)
    if missing:
        named = "; ".join(missing[:MOST_MISSING]) + "; …" * (len(missing) > MOST_MISSING)
        said.append(
            f"{found.study.missing.total()} of the {found.study.planned.total()} planned trials are missing ({named}). "
            "The drivers who stopped, and the trials that failed, may not be like the others, so that the means may be "
            "biased; and the orders of the conditions are no longer balanced as designed."
        )
    return said


def _drove(study: RunStudy) -> list[str]:
    """Sentences on the drivers of a study, and on what the intervals cover."""
    trials = study.trials
    drivers, count = len(np.unique(trials.participant[~trials.practice])), int((~trials.practice).sum())
    if study.with_people:
        return [
            f"{drivers} {'person' if drivers == 1 else 'people'} made {count} trials at the desk, which is not a cab: "
            "nothing moves, and nobody answers for a real train. The intervals cover the sampling of people like "
            "these, not the difference from real service."
        ]
    return [
        f"{drivers} simulated drivers from the population “{study.design.people.population}” made "
        f"{count} trials. How they react, look, follow advice and err are assumptions (docs/reference/populations.md "
        "and drivers.md list them). The figures show the result that would be expected if people were like these "
        "drivers.",
        "The intervals cover the sampling of simulated drivers. They do not cover errors in the assumptions, "
        "and more simulated trials do not reduce that uncertainty.",
    ]


def _missing(study: RunStudy) -> list[str]:
    """A text for each driver with missing planned trials."""
    by_driver, planned = defaultdict(list), Counter[str]()
    for (name, _), count in study.planned.items():
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
    """The name of each planned comparison, with the finding in a sentence or two."""
    if not found.differences and not found.failed:
        return [("", "No comparison was planned; the tables describe the conditions.")]
    broken = [(name, f"The comparison could not be made: {why}.") for name, why in found.failed]
    said = [(one.comparison.title, verdict(one, found.study.design)) for one in found.differences]
    return [*said, *broken, *_safety(found)]


def _safety(found: StudyFindings) -> list[tuple[str, str]]:
    """A sentence on signals passed at danger, if any, even if no planned comparison is about this."""
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
    drivers, pairs = len(one.pairs.participants), len(one.pairs.owner)
    return f"{drivers} driver{'s' * (drivers != 1)}, {pairs} pair{'s' * (pairs != 1)}"


def _reach(shown: ShownMeasure, interval: tuple[float, float]) -> str:
    low, high = interval
    if low < 0 < high:
        return f"from {shown.with_unit(low)} lower to {shown.with_unit(high)} higher"
    near, far = sorted((abs(low), abs(high)))
    return f"{shown.value(near)} to {shown.with_unit(far)} {'lower' if high <= 0 else 'higher'}"


def trial_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """The number of trials driven, and the missing and failed trials."""
    trials, design = found.study.trials, found.study.design
    driven, failed, missing = ~trials.practice, found.study.failed, found.study.missing.total()
    counts = Counter(trials.participant[driven].tolist())
    without = {name: int(np.sum(~np.isfinite(values[driven]))) for name, values in trials.values.items()}
    gaps = ", ".join(f"{found.study.shown(name).name}: {count}" for name, count in without.items() if count)
    return [
        ("drivers", str(len(counts))),
        ("finished trials", str(int(driven.sum()))),
        ("practice trials, left out", str(int(trials.practice.sum()))),
        ("missing trials", f"{missing} of {found.study.planned.total()} planned{': ' * (missing > 0)}"
         f"{'; '.join(_missing(found.study))}"),
        ("failed trials", f"{len(failed)}: {'; '.join(failed[:MOST_FAILED])}{' …' * (len(failed) > MOST_FAILED)}"
         if failed else "0 (a trial fails if the train does not reach its last stop)"),
        ("trials without a value", gaps or "0"),
        ("comparisons planned", f"{len(design.comparisons)}, p corrected by {design.correction.capitalize()}"
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
        text = "people" if name == "driver" and found.study.with_people else f"{level.text}{unit}"
        rows.append((f"not varied: {name if known is None else known.title.lower()}", text))
    for one in design.factors:
        kind = "every driver drives all levels" if one.within else "each driver drives one level"
        rows.append((one.name, f"{', '.join(one.texts)} ({kind})"))
    return [*rows, ("statistically significant", f"if the corrected p is below {design.alpha:g}")]


def level_rows(found: StudyFindings) -> list[tuple[str, str]]:
    """The meaning of each factor's levels, unless their names state it."""
    words = [
        (f"{one.name}: {level.text}", level_meaning(one.name, level))
        for one in found.study.design.factors
        for level in one.levels
    ]
    return [(name, text) for name, text in words if text]


def group_row(one: FoundDifference) -> tuple[str, ...]:
    """The texts of a difference between two groups of drivers, in a measure or in a condition's effect on a measure.

    They are: what differs, and its unit; the mean of each group, with its 95 % interval; the difference; its interval,
    p and effect size; and how many drivers of the second group are within the range of the first, with the number
    expected if both are alike in brackets.
    """
    shown, estimate, compared, groups = one.shown, one.estimate, one.comparison, one.groups
    assert groups is not None
    effect = compared.factor != DRIVER
    where = compared.contrast() if effect else ", ".join(compared.where.values())
    value = shown.difference if effect else shown.value
    means, intervals = (groups.a.mean(), groups.b.mean()), (student(groups.a), student(groups.b))
    inside, others = int(((groups.b >= groups.a.min()) & (groups.b <= groups.a.max())).sum()), len(groups.b)
    unit = shown.difference_unit if effect or shown.unit == shown.difference_unit else f"{shown.unit}; points"
    return (
        f"{shown.name}{f': {where}' if where else ''} ({unit})",
        *(
            value(mean) + (f" ({value(low)} to {value(high)})" if math.isfinite(low) else "")
            for mean, (low, high) in zip(means, intervals, strict=True)
        ),
        shown.difference(estimate.mean),
        shown.range(estimate.interval),
        probability(one.corrected),
        _size(estimate.size),
        f"{inside} of {others} ({others * (len(groups.a) - 1) / (len(groups.a) + 1):.1f})",
    )


def group_words(one: FoundDifference, levels: Sequence[str]) -> str:
    """The difference between two groups of drivers in a sentence."""
    what, *means, difference, interval, p, size, inside = group_row(one)
    known = f" ({interval}), corrected p {p}, d {size}" if interval else ", without an interval"
    return (
        f"{what}: {levels[0]} {means[0]}, {levels[1]} {means[1]}, difference {difference}"
        f"{known}; within the range of {levels[0]}: {inside} of {levels[1]}"
    )


def page(found: StudyFindings, together: Together | None = None) -> str:
    """The page as HTML that needs no other file; with `together`, a section compares the drivers of two studies."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    style = Path(sim.review.__path__[0])  # all pages share their style
    files = FileSystemLoader([Path(__file__).parent, style])
    environment = Environment(loader=files, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    content = environment.get_template(TEMPLATE).render(
        found=found,
        design=found.study.design,
        version=__version__,
        theme=LIGHT,
        **{one.__name__: one for one in (hangs_on, in_short, trial_rows, design_rows, level_rows, probability)},
        size=_size,
        difference_images=_difference_images(found),
        varying=[one for one in found.measures if _varies(found, one)],
        columns_at_once=COLUMNS_AT_ONCE,
        values={(one.condition, one.measure): one for one in found.conditions},
        mean_and_spread=_mean_and_spread,
        together=together,
        group_row=group_row,
    )
    return content.replace(" %", "\u00a0%")  # no line break between a number and its percent sign


def _size(value: float) -> str:
    """An effect in standard deviations with its sign; empty for NaN."""
    return "" if math.isnan(value) else f"{value:+.2f}".replace("-", "−")


def _difference_images(found: StudyFindings) -> list[dict[str, str]]:
    from sim.review.pictures import as_image

    images = []
    for shown in found.measures:
        some = [one for one in found.differences if one.shown.column == shown.column]
        if some:
            image = as_image(differences_figure(some, found.study.design.alpha))
            images.append({"image": image, "text": f"{shown.name}: {shown.text}." if shown.text else shown.name})
    return images


def _varies(found: StudyFindings, shown: ShownMeasure) -> bool:
    """Whether a measure has more than one value; a constant measure shows nothing about the conditions."""
    values = found.study.trials.values[shown.column]
    return len(np.unique(values[np.isfinite(values)])) > 1


def _mean_and_spread(one: ConditionValues, shown: ShownMeasure) -> str:
    if not len(one.means):
        return "–"
    if not np.any(one.means):
        return "0"
    spread = shown.value(float(one.means.std(ddof=1))) if len(one.means) > 1 else ""
    return f"{shown.value(float(one.means.mean()))}{f' ± {spread}' if spread else ''}"


def as_dict(found: StudyFindings, together: Together | None = None) -> dict[str, Any]:
    """The findings for programs: values in the units of the columns of `trials.csv`."""
    design = found.study.design
    said = (f"{name}: {line}" if name else line for name, line in in_short(found))
    content: dict[str, Any] = _plain(
        {
            "study": design.name,
            "design_hash": design.hash,
            "in_words": [*hangs_on(found), *said],
            "alpha": design.alpha,
            "correction": design.correction,
            "differences": [_difference_dict(one, design.alpha) for one in found.differences],
            "not_compared": dict(found.failed),
            "conditions": [_condition_dict(one) for one in found.conditions],
            "trials": dict(trial_rows(found)),
            **({} if together is None else {"together": _together_dict(together, design.alpha)}),
        }
    )
    return content


def _together_dict(together: Together, alpha: float) -> dict[str, Any]:
    tables = {
        title: [_difference_dict(one, alpha) | {"in_words": group_words(one, together.levels)} for one in some]
        for title, some in together.tables.items()
    }
    return {"levels": together.levels, "tables": tables, "without_values": list(together.without)}


def _plain(value: Any) -> Any:
    """A value for JSON: None for unknown numbers and ranges."""
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
    estimate, pairs = one.estimate, one.pairs
    return {
        **asdict(one.comparison),
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


def differences_figure(found: Sequence[FoundDifference], alpha: float) -> Figure:
    """The planned differences of one measure: the mean with its 95 % interval, and a point for each driver."""
    from sim.review.pictures import INK, light_figure, named

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
    """The name of a comparison if the user gave one, else the two levels that are subtracted."""
    return comparison.name if comparison.title == comparison.name else comparison.contrast("\n")


def _beside(count: int) -> Floats:
    """The distances (rows) of `count` points from the row's centre: on alternate sides, in equal steps."""
    steps = np.array([0.0, 0.5, -0.5, 1.0, -1.0])
    return np.asarray(SCATTER * steps[np.arange(count) % len(steps)])
