"""The analysis of a study: its planned comparisons with interval, model and checks, and the spread of its drivers."""

from __future__ import annotations

import contextlib
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from das.domain.errors import DasError
from sim.experiment.analysis.checks import AssumptionCheck, checks_of
from sim.experiment.analysis.differences import (
    ComparedTrials,
    DifferenceEstimate,
    PairedTrials,
    TwoGroups,
    compared_trials,
    corrected,
    estimate_of,
)
from sim.experiment.analysis.mixed_model import MixedFit, fit_mixed_model
from sim.experiment.analysis.power import normal_participants
from sim.experiment.analysis.reading import Bools, Floats, RunStudy, ShownMeasure
from sim.experiment.analysis.spread import DriverSpread, sd_interval, spread_of
from sim.experiment.plan import PlannedComparison

WANTED_POWER: Final = 0.8
ASKED_POINTS: Final = (0.005, 0.01, 0.02)
"""Differences of a ratio for which the report says how many participants it takes to find them."""
ASKED: Final = "asked for"


@dataclass(frozen=True, kw_only=True)
class NeededParticipants:
    """How many participants it takes for 80 % of studies to find a difference of `effect`.

    `interval` is the range of that number, because the spread of participants is not known exactly. In a comparison of
    two groups, the numbers are for each group. None stands for more than a million; `interval` is None as a whole
    if the spread has no interval. `given` is False if the difference came out of the study. `reason` says in words
    why it is listed.
    """

    effect: float
    given: bool
    reason: str
    participants: int | None
    interval: tuple[int | None, int | None] | None


@dataclass(frozen=True, kw_only=True)
class DifferencePart:
    """The difference of a comparison at one level of a factor whose levels the comparison averages over."""

    factor: str
    level: str
    estimate: DifferenceEstimate


@dataclass(frozen=True, kw_only=True)
class FoundDifference:
    """All that was found on a planned comparison. `model_missing` says why there is no model; else it is empty."""

    comparison: PlannedComparison
    shown: ShownMeasure
    estimate: DifferenceEstimate
    corrected: float
    trials: ComparedTrials
    model: MixedFit | None
    model_missing: str
    checks: tuple[AssumptionCheck, ...]
    needed: tuple[NeededParticipants, ...]
    parts: tuple[DifferencePart, ...]

    @property
    def pairs(self) -> PairedTrials | None:
        """The pairs; None if two groups were compared."""
        return self.trials if isinstance(self.trials, PairedTrials) else None

    @property
    def groups(self) -> TwoGroups | None:
        """The two groups; None if every participant drove both conditions."""
        return self.trials if isinstance(self.trials, TwoGroups) else None

    @property
    def title(self) -> str:
        """The name of the comparison; the measure and the contrast if the design gave it no name."""
        short = self.comparison.title
        return short if short == self.comparison.name else f"{self.shown.name}: {short}"

    @property
    def broken(self) -> list[AssumptionCheck]:
        """The assumptions that the deciding method needs and that do not hold."""
        return [check for check in self.checks if check.needed and check.holds is False]

    @property
    def disagreeing(self) -> list[tuple[str, tuple[float, float]]]:
        """The other methods that do not agree with the one that decides, each with its interval.

        A method disagrees if only one of the two intervals holds 0, or if its mean lies outside the deciding interval.
        """
        estimate, model = self.estimate, self.model
        if not estimate.known:
            return []
        others = [] if self.pairs is None else [("Student's t", estimate.mean, estimate.t_interval)]
        others += [] if model is None else [("the mixed model", model.effect, model.interval)]
        return [
            (name, interval)
            for name, mean, interval in others
            if _holds(interval, 0.0) != _holds(estimate.interval, 0.0) or not _holds(estimate.interval, mean)
        ]

    @property
    def opposed(self) -> list[DifferencePart]:
        """The parts whose difference has the opposite sign of the mean and an interval without 0."""
        return [
            one
            for one in self.parts
            if one.estimate.known
            and one.estimate.mean * self.estimate.mean < 0
            and not _holds(one.estimate.interval, 0.0)
        ]


def _holds(interval: tuple[float, float], value: float) -> bool:
    return interval[0] <= value <= interval[1]


@dataclass(frozen=True, kw_only=True)
class ConditionValues:
    """A measure in one condition: the participants' means, and how far drivers and days differ (None: too few)."""

    condition: str
    measure: str
    trials: int
    means: Floats
    spread: DriverSpread | None


@dataclass(frozen=True, kw_only=True)
class StudyFindings:
    """What the analysis of a study found; `failed` has, for each comparison that could not be made, why."""

    study: RunStudy
    measures: tuple[ShownMeasure, ...]
    differences: tuple[FoundDifference, ...]
    failed: tuple[tuple[str, str], ...]
    conditions: tuple[ConditionValues, ...]

    def shown(self, measure: str) -> ShownMeasure:
        """How a measure is shown."""
        return {one.column: one for one in self.measures}[measure]


def analyse_study(study: RunStudy, effects: tuple[float, ...] = ()) -> StudyFindings:
    """Analyse every planned comparison of a study and describe every condition.

    `effects` are differences, in the unit of the report, for which the report says how many participants find them.
    The same study always gives the same figures: the study's seed decides what is drawn.
    """
    measures = tuple(
        ShownMeasure.of(name, study.meanings[name], study.trials.values[name]) for name in study.plan.measures
    )
    shown = {one.column: one for one in measures}
    found, failed = [], []
    for comparison in study.plan.comparisons:
        try:
            found.append(_difference(study, comparison, shown[comparison.measure], effects))
        except DasError as error:
            failed.append((comparison.name, str(error)))
    # Comparisons that could not be made count as well: they were planned.
    chances = np.array([one.estimate.probability for one in found] + [math.nan] * len(failed))
    after = corrected(chances, study.plan.correction)
    return StudyFindings(
        study=study,
        measures=measures,
        differences=tuple(
            replace(one, corrected=float(value)) for one, value in zip(found, after[: len(found)], strict=True)
        ),
        failed=tuple(failed),
        conditions=tuple(_conditions(study)),
    )


def generator(study: RunStudy, what: str) -> np.random.Generator:
    """The random numbers of one part of the analysis; they do not depend on other parts."""
    return np.random.default_rng([study.plan.seed % 2**32, zlib.crc32(what.encode())])


def _difference(
    study: RunStudy, comparison: PlannedComparison, shown: ShownMeasure, effects: tuple[float, ...]
) -> FoundDifference:
    rng = generator(study, comparison.name)
    trials = compared_trials(study, comparison)
    found = FoundDifference(
        comparison=comparison, shown=shown, estimate=estimate_of(trials, rng), corrected=math.nan,
        trials=trials, model=None, model_missing="", checks=tuple(checks_of(study, comparison, trials, shown)),
        needed=(), parts=tuple(_parts(study, comparison)),
    )  # fmt: skip
    needed = tuple(_needed(found, effects, study.plan.alpha, sd_interval(trials.spread, rng)))
    try:
        return replace(found, needed=needed, model=fit_mixed_model(study, comparison))
    except DasError as error:
        return replace(found, needed=needed, model_missing=str(error))


def _parts(study: RunStudy, comparison: PlannedComparison) -> Iterator[DifferencePart]:
    """The difference at each level of the other factors that the comparison leaves open, if it can be computed."""
    for factor in study.plan.factors:
        if factor.name == comparison.factor or factor.name in comparison.where:
            continue
        for level in factor.levels:
            part = replace(comparison, where={**comparison.where, factor.name: level})
            rng = generator(study, f"{comparison.name} {factor.name} {level}")
            with contextlib.suppress(DasError):
                estimate = estimate_of(compared_trials(study, part), rng)
                yield DifferencePart(factor=factor.name, level=level, estimate=estimate)


def _needed(
    found: FoundDifference, asked: tuple[float, ...], alpha: float, spread: tuple[float, float]
) -> Iterator[NeededParticipants]:
    """How many participants it takes to find the difference that was found here, half of it, and others.

    The others are those `asked` for, in the unit of the report, and `ASKED_POINTS`. `spread` is the interval of the
    standard deviation between participants; NaN if it has none.
    """
    estimate, shown = found.estimate, found.shown
    if not estimate.known:
        return

    def participants(effect: float, sd: float) -> int | None:
        groups = found.groups is not None
        return normal_participants(effect / sd, alpha, WANTED_POWER, groups=groups) if sd > 0 else 2

    effects = [(one / shown.factor, ASKED) for one in asked]
    effects += [(estimate.mean, "as found here"), (estimate.mean / 2, "half of that")]
    if shown.factor != 1.0:
        effects += [(one, "") for one in ASKED_POINTS]
    for effect, reason in effects:
        yield NeededParticipants(
            effect=abs(effect), given=reason in ("", ASKED), reason=reason,
            participants=participants(effect, estimate.sd),
            interval=None if math.isnan(spread[0])
            else (participants(effect, spread[0]), participants(effect, spread[1])),
        )  # fmt: skip


def _conditions(study: RunStudy) -> list[ConditionValues]:
    """Every measure in every condition, in the order of the design's levels."""
    trials, found = study.trials, []
    for condition, mine in conditions_of(study):
        for measure in study.plan.measures:
            values = trials.values[measure]
            kept = mine & np.isfinite(values)
            names = np.unique(trials.participant[kept])
            means = np.array([values[kept & (trials.participant == name)].mean() for name in names])
            spread = None
            if len(names) > 1:
                days = trials.day[kept]
                spread = spread_of(values[kept], trials.participant[kept], days, generator(study, condition + measure))
            found.append(
                ConditionValues(
                    condition=condition, measure=measure, trials=int(kept.sum()), means=means, spread=spread
                )
            )
    return found


def conditions_of(study: RunStudy) -> list[tuple[str, Bools]]:
    """The combinations of levels that were driven, each with its trials without practice."""
    trials, factors = study.trials, study.plan.factors
    ranks = np.array([[one.levels.index(str(level)) for level in trials.levels[one.name]] for one in factors])
    found = []
    for combination in np.unique(ranks[:, ~trials.practice], axis=1).T:
        names = [one.levels[rank] for one, rank in zip(factors, combination, strict=True)]
        mine = (ranks == combination[:, None]).all(axis=0) & ~trials.practice
        found.append((", ".join(names), mine))
    return found
