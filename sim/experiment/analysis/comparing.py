"""The analysis of a study: its planned comparisons with intervals, and what was measured in every condition."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np

from das.domain.errors import DasError
from sim.experiment.analysis.differences import (
    ComparedTrials,
    DifferenceEstimate,
    PairedTrials,
    TwoGroups,
    compared_trials,
    corrected,
    estimate_of,
)
from sim.experiment.analysis.reading import Bools, Floats, RunStudy, ShownMeasure
from sim.experiment.design import PlannedComparison


@dataclass(frozen=True, kw_only=True)
class FoundDifference:
    """All that was found on a planned comparison; `corrected` is its p, corrected for the number of comparisons."""

    comparison: PlannedComparison
    shown: ShownMeasure
    estimate: DifferenceEstimate
    corrected: float
    trials: ComparedTrials

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
    def disagrees(self) -> bool:
        """Whether Student's t disagrees with sign flips, which decide: only one of their intervals holds 0."""
        estimate = self.estimate
        return estimate.known and _holds_0(estimate.interval) != _holds_0(estimate.t_interval)


def _holds_0(interval: tuple[float, float]) -> bool:
    return interval[0] <= 0.0 <= interval[1]


@dataclass(frozen=True, kw_only=True)
class ConditionValues:
    """A measure in one condition: the number of trials, and the mean of each participant, (participants,)."""

    condition: str
    measure: str
    trials: int
    means: Floats


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


def analyse_study(study: RunStudy) -> StudyFindings:
    """Analyse every planned comparison of a study and describe every condition.

    The same study always gives the same figures: the study's seed decides what is drawn.
    """
    measures = tuple(ShownMeasure.of(name, study.trials.values[name]) for name in study.design.measures)
    shown = {one.column: one for one in measures}
    found, failed = [], []
    for comparison in study.design.comparisons:
        try:
            found.append(_difference(study, comparison, shown[comparison.measure]))
        except DasError as error:
            failed.append((comparison.name, str(error)))
    # Comparisons that could not be made count as well: they were planned.
    chances = np.array([one.estimate.probability for one in found] + [math.nan] * len(failed))
    after = corrected(chances, study.design.correction)
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
    return np.random.default_rng([study.design.seed % 2**32, zlib.crc32(what.encode())])


def _difference(study: RunStudy, comparison: PlannedComparison, shown: ShownMeasure) -> FoundDifference:
    trials = compared_trials(study, comparison)
    estimate = estimate_of(trials, generator(study, comparison.name))
    return FoundDifference(comparison=comparison, shown=shown, estimate=estimate, corrected=math.nan, trials=trials)


def _conditions(study: RunStudy) -> list[ConditionValues]:
    """Every measure in every condition, in the order of the design's levels."""
    trials, found = study.trials, []
    for condition, mine in conditions_of(study):
        for measure in study.design.measures:
            values = trials.values[measure]
            kept = mine & np.isfinite(values)
            names = np.unique(trials.participant[kept])
            means = np.array([values[kept & (trials.participant == name)].mean() for name in names])
            found.append(ConditionValues(condition=condition, measure=measure, trials=int(kept.sum()), means=means))
    return found


def conditions_of(study: RunStudy) -> list[tuple[str, Bools]]:
    """The combinations of levels that were driven, each with its trials without practice."""
    trials, factors = study.trials, study.design.factors
    ranks = np.array([[one.texts.index(str(level)) for level in trials.levels[one.name]] for one in factors])
    found = []
    for combination in np.unique(ranks[:, ~trials.practice], axis=1).T:
        names = [one.texts[rank] for one, rank in zip(factors, combination, strict=True)]
        mine = (ranks == combination[:, None]).all(axis=0) & ~trials.practice
        found.append((", ".join(names), mine))
    return found
