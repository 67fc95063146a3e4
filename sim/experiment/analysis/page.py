"""The page of an analysis, and the same for programs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined

import sim.review.report
from das import __version__
from sim.experiment.analysis import figures, study_words, words
from sim.experiment.analysis.checks import SURE
from sim.experiment.analysis.comparing import WANTED_POWER, DifferencePart, FoundDifference, StudyFindings
from sim.experiment.analysis.pairs import TwoGroups
from sim.review.colors import LIGHT
from sim.review.light import as_image

TEMPLATE: Final = "page.html.j2"


def page(found: StudyFindings) -> str:
    """The page as HTML, which needs nothing besides itself."""
    folders = [
        Path(__file__).parent,
        Path(sim.review.report.__path__[0]),
    ]  # the second has the style that all pages share
    environment = Environment(
        loader=FileSystemLoader(folders), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    plan = found.study.plan
    rows = words.difference_rows(found)
    content = environment.get_template(TEMPLATE).render(
        title=f"Analysis of the study “{plan.name}”",
        version=__version__,
        theme=LIGHT,
        about=plan.about,
        simulated=plan.simulated,
        hangs_on=words.hangs_on(found),
        in_short=words.in_short(found),
        difference_images=_difference_images(found),
        differences=rows,
        any_t=any(one["interval"].endswith("(t)") for one in rows),
        any_pairs=any(one.pairs is not None for one in found.differences),
        parts=words.part_rows(found),
        levels=study_words.level_rows(found),
        definitions=study_words.definition_rows(found.measures),
        singular=words.singular_fits(found),
        sure=f"{SURE:g}",
        any_unpaired=any(one["unpaired"] not in ("", "0") for one in rows),
        comparisons=[_comparison(one) for one in found.differences],
        models=words.model_rows(found),
        needs=[
            {
                "name": words.title(one.comparison, one.shown),
                "groups": one.groups is not None,
                "rows": words.needed_rows(one),
            }
            for one in found.differences
            if one.needed
        ],
        wanted=f"{100 * WANTED_POWER:.0f} %",
        alpha=f"{plan.alpha:g}",
        measures=_measures(found),
        others=words.other_tables(found),
        trials=study_words.trial_rows(found),
        design=study_words.design_rows(found),
        terms=words.TERMS,
    )
    return content.replace(" %", "\u00a0%")  # no line ends between a number and its percent sign


def _difference_images(found: StudyFindings) -> list[dict[str, str]]:
    images = []
    for shown in found.measures:
        some = [one for one in found.differences if one.shown.column == shown.column]
        if some:
            image = as_image(figures.differences_figure(some, found.study.plan.alpha))
            images.append({"image": image, "text": f"{shown.name}: {shown.text}." if shown.text else shown.name})
    return images


def _comparison(one: FoundDifference) -> dict[str, Any]:
    return {
        "name": words.title(one.comparison, one.shown),
        "contrast": words.contrast(one.comparison),
        "image": as_image(figures.pair_figure(one) if one.pairs is not None else figures.group_figure(one)),
        "groups": one.groups is not None,
        "checks": one.checks,
    }


def _measures(found: StudyFindings) -> list[dict[str, Any]]:
    """The measures that a comparison is about, each with its picture and its table."""
    compared = {one.comparison.measure for one in found.differences}
    measures = []
    for shown in found.measures:
        if shown.column not in compared:
            continue
        values = [one for one in found.conditions if one.measure == shown.column]
        rows = words.condition_rows(values, shown)
        measures.append(
            {
                "name": shown.name,
                "text": f"{shown.text[:1].upper()}{shown.text[1:]}",
                "unit": shown.unit,
                "image": as_image(figures.condition_figure(values, shown)),
                "rows": rows,
                "repeated": any(row["within"] for row in rows),
            }
        )
    return measures


def as_dict(found: StudyFindings) -> dict[str, Any]:
    """The findings for programs: values in the units of the columns of `trials.csv`."""
    plan = found.study.plan
    return {
        "study": plan.name,
        "design_hash": plan.hash,
        "simulated_drivers": plan.simulated,
        "in_words": [
            *words.hangs_on(found),
            *(f"{name}: {line}" if name else line for name, line in words.in_short(found)),
        ],
        "alpha": plan.alpha,
        "correction": plan.correction,
        "differences": [_difference_dict(one, plan.alpha) for one in found.differences],
        "not_compared": dict(found.failed),
        "conditions": [
            {
                "condition": one.condition,
                "measure": one.measure,
                "trials": one.trials,
                "drivers": len(one.means),
                "mean": _known(float(one.means.mean())) if len(one.means) else None,
                "sd_between_drivers": None if one.spread is None else _known(one.spread.between),
                "sd_between_drivers_interval": None if one.spread is None else _range(one.spread.interval),
                "sd_within_driver": None if one.spread is None else _known(one.spread.within),
            }
            for one in found.conditions
        ],
        "trials": dict(study_words.trial_rows(found)),
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
        "interval": _range(estimate.interval),
        "method": "studentized bootstrap of drivers" if estimate.resampled else "Student's t",
        "p": _known(estimate.probability),
        "p_corrected": _known(one.corrected),
        "stands_out": bool(one.corrected < alpha),
        "t_interval": _range(estimate.t_interval),
        "sd": _known(estimate.sd),
        "effect_size": _known(estimate.size),
        "effect_size_interval": _range(estimate.size_interval),
        "drivers": estimate.participants,
        "pairs": None if pairs is None else len(pairs.owner),
        "unpaired_trials": None if pairs is None else pairs.unpaired,
        "by_driver": None
        if pairs is None
        else dict(zip(pairs.participants, pairs.by_participant(pairs.differences).tolist(), strict=True)),
        "groups": None if one.groups is None else _groups_dict(one.groups),
        "model": None
        if fit is None
        else {
            "effect": _known(fit.effect),
            "interval": _range(fit.interval),
            "sd_of_levels": _known(fit.level_sd),
            "sd_of_effects": _known(fit.effect_sd),
            "noise": [_known(value) for value in fit.noise],
            "singular": fit.singular,
            "converged": fit.converged,
            "remarks": list(fit.remarks),
        },
        "no_model_because": one.model_missing or None,
        "parts": [_part_dict(part) for part in one.parts],
        "checks": [{"name": check.name, "found": check.found, "holds": check.holds} for check in one.checks],
        "participants_needed": [
            {"effect": need.effect, "participants": need.participants, "range": list(need.interval)}
            for need in one.needed
        ],
    }


def _part_dict(part: DifferencePart) -> dict[str, Any]:
    """The difference at one level of another factor."""
    estimate = part.estimate
    return {
        "factor": part.factor, "level": part.level, "mean": estimate.mean, "interval": _range(estimate.interval),
    }  # fmt: skip


def _groups_dict(groups: TwoGroups) -> dict[str, dict[str, float]]:
    """The means of the drivers of both groups."""
    return {
        "a": dict(zip(groups.a_names, groups.a.tolist(), strict=True)),
        "b": dict(zip(groups.b_names, groups.b.tolist(), strict=True)),
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _range(interval: tuple[float, float]) -> list[float] | None:
    return list(interval) if math.isfinite(interval[0]) else None
