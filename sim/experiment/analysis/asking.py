"""What `das-sim experiment power` is asked, and what it answers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from das.domain.errors import DasError
from das.domain.files.reading import Fields
from sim.experiment.analysis.pairs import is_paired, paired_trials, two_groups
from sim.experiment.analysis.power import (
    MOST_PARTICIPANTS,
    BellCurves,
    MadeUpDifferences,
    PowerPoint,
    PowerQuestion,
    of_pilot,
    of_pilot_groups,
    participants_needed,
    power_of,
)
from sim.experiment.analysis.reading import RunStudy, read_study
from sim.experiment.analysis.shown import ShownMeasure
from sim.experiment.plan import DEFAULT_ALPHA, PlannedComparison, StudyPlan, plan_of, read_plan


@dataclass(frozen=True, kw_only=True)
class Asked:
    """The question as it was put: the arguments of the command; `effect` and `sd` in the unit that reports show."""

    source: Path | None
    effect: float
    comparison: str | None
    participants: tuple[int, ...]
    wanted: float
    sd: float | None
    sd_of_pairs: float
    pairs: int | None
    alpha: float | None
    seed: int
    groups: bool = False


@dataclass(frozen=True, kw_only=True)
class PowerAnswer:
    """The power for each number of participants, alone and with corrected p, and how many are needed.

    `strict` and `needed_strict` are empty and None where only one comparison is planned, or p is not corrected.
    """

    about: str
    groups: bool
    points: tuple[PowerPoint, ...]
    strict: tuple[PowerPoint, ...]
    wanted: float
    needed: int | None
    needed_strict: int | None

    @property
    def sentences(self) -> list[str]:
        """How many participants are needed, in words."""

        def many(count: int | None) -> str:
            return f"more than {MOST_PARTICIPANTS}" if count is None else str(count)

        who = "participants in each of the two groups" if self.groups else "participants"
        said = [f"For a power of {self.wanted:.0%}: {many(self.needed)} {who}."]
        if self.strict:
            said.append(f"With p corrected for the planned comparisons: {many(self.needed_strict)} {who}.")
        return said

    def as_dict(self) -> dict[str, Any]:
        """The answer for programs."""

        def rows(points: tuple[PowerPoint, ...]) -> list[dict[str, Any]]:
            return [
                {"participants": one.participants, "power": one.power, "interval": list(one.interval)} for one in points
            ]

        return {
            "about": self.about,
            "participants_are": "in each of two groups" if self.groups else "all",
            "power": rows(self.points),
            "power_corrected": rows(self.strict) or None,
            "wanted_power": self.wanted,
            "participants_needed": self.needed,
            "participants_needed_corrected": self.needed_strict,
        }


def answer(asked: Asked) -> PowerAnswer:
    """Simulate the experiments that were asked for; DasError where something that is needed is missing."""
    _check(asked)
    plan, study = _source(asked.source)
    source, effect, about = _made_up(asked, plan, study)
    alpha = asked.alpha if asked.alpha is not None else (plan.alpha if plan else DEFAULT_ALPHA)
    question = PowerQuestion(effect=effect, alpha=alpha, source=source, seed=asked.seed)
    count = 1 if plan is None or plan.correction == "none" else len(plan.comparisons)
    strict = replace(question, alpha=alpha / max(count, 1))  # the first step of Holm, and every step of Bonferroni
    return PowerAnswer(
        about=about,
        groups=source.groups,
        points=tuple(power_of(question, number) for number in asked.participants),
        strict=tuple(power_of(strict, number) for number in asked.participants) if count > 1 else (),
        wanted=asked.wanted,
        needed=participants_needed(question, asked.wanted),
        needed_strict=participants_needed(strict, asked.wanted) if count > 1 else None,
    )


def _check(asked: Asked) -> None:
    for option, value in (("--power", asked.wanted), ("--alpha", asked.alpha)):
        if value is not None and not 0.0 < value < 1.0:
            raise DasError(f"{option} {value:g}: expected a number between 0 and 1")
    if asked.sd is not None and not (math.isfinite(asked.sd) and asked.sd > 0):
        raise DasError(f"--sd {asked.sd:g}: expected a number above 0")
    if not (math.isfinite(asked.sd_of_pairs) and asked.sd_of_pairs >= 0):
        raise DasError(f"--sd-pairs {asked.sd_of_pairs:g}: expected a number of at least 0")
    if asked.sd_of_pairs and asked.sd is None:
        raise DasError("--sd-pairs: expected together with --sd; a pilot tells this spread itself")
    if asked.groups and asked.sd is None:
        raise DasError("--groups: expected together with --sd; a pilot tells itself who drove what")


def _source(path: Path | None) -> tuple[StudyPlan | None, RunStudy | None]:
    """The plan and, where the source is the folder of a study, the study; nothing for no source."""
    if path is None:
        return None, None
    if path.is_dir():
        study = read_study(path)
        return study.plan, study
    if path.suffix.lower() == ".json":
        return read_plan(path), None
    from sim.experiment.design import load_design
    from sim.experiment.freezing import resolved

    return plan_of(Fields.of(path, resolved(load_design(str(path))))), None


def _made_up(asked: Asked, plan: StudyPlan | None, study: RunStudy | None) -> tuple[MadeUpDifferences, float, str]:
    """What draws the differences, the true difference in the same unit, and a sentence about both."""
    if asked.sd is not None:
        groups = asked.groups or _in_groups(asked, plan)
        curves = BellCurves(between_sd=asked.sd, within_sd=asked.sd_of_pairs, pairs=asked.pairs or 1, groups=groups)
        single = "trials" if groups else "pairs"
        among = f" and {asked.sd_of_pairs:g} between the {single} of one" if asked.sd_of_pairs else ""
        among += ", who drive one of two conditions each" if groups else ""
        about = f"bell curves with a standard deviation of {asked.sd:g} between participants{among}"
        return curves, asked.effect, f"True difference {asked.effect:g}; {about}."
    if plan is None or study is None:
        raise DasError("--sd: expected the standard deviation between participants, or the folder of a pilot study")
    comparison = plan.chosen(asked.comparison)
    return _of_study(asked, study, comparison)


def _in_groups(asked: Asked, plan: StudyPlan | None) -> bool:
    """Whether the comparison of a design is one of two groups of participants."""
    if plan is None or not plan.comparisons:
        return False
    return not plan.factor(plan.chosen(asked.comparison).factor).within


def _of_study(asked: Asked, study: RunStudy, comparison: PlannedComparison) -> tuple[MadeUpDifferences, float, str]:
    measure = comparison.measure
    shown = ShownMeasure.of(measure, study.meanings[measure], study.trials.values[measure])
    if not is_paired(study, comparison):
        return _of_groups(asked, study, comparison, shown)
    pairs = paired_trials(study, comparison)
    source = of_pilot(pairs, asked.pairs)
    about = (
        f"True difference {asked.effect:g} {shown.difference_unit} of {shown.name} in the pilot's direction "
        f"({comparison.name}); "
        f"{len(pairs.participants)} participants of the pilot are drawn again, each with {source.pairs} "
        f"{'pair' if source.pairs == 1 else 'pairs'} of trials."
    )
    direction = -1.0 if pairs.differences.mean() < 0 else 1.0  # skewed differences: power is not the same both ways
    return source, direction * asked.effect / shown.factor, about


def _of_groups(
    asked: Asked, study: RunStudy, comparison: PlannedComparison, shown: ShownMeasure
) -> tuple[MadeUpDifferences, float, str]:
    """The same for a comparison of two groups."""
    if asked.pairs is not None:
        raise DasError(
            f"--pairs: comparison {comparison.name} is one of two groups, whose participants make no pairs; expected "
            "no number, because each participant drives as many trials as in the pilot"
        )
    groups = two_groups(study, comparison)
    about = (
        f"True difference {asked.effect:g} {shown.difference_unit} of {shown.name} in the pilot's direction "
        f"({comparison.name}); two groups: {len(groups.a)} participants of the pilot with {comparison.a} and "
        f"{len(groups.b)} with {comparison.b} are drawn again, each with as many trials as there."
    )
    direction = -1.0 if groups.a.mean() < groups.b.mean() else 1.0
    return of_pilot_groups(groups), direction * asked.effect / shown.factor, about
