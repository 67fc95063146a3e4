"""What a comparison of two groups of participants assumes, and whether the trials bear it out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from sim.experiment.analysis.checks import LEAST, SURE, AssumptionCheck, drift
from sim.experiment.analysis.pairs import TwoGroups
from sim.experiment.analysis.reading import Floats, Ints, RunStudy
from sim.experiment.analysis.shown import ShownMeasure, probability
from sim.experiment.plan import PlannedComparison

UNTOLD: Final = "cannot be told"


def group_checks_of(
    study: RunStudy, comparison: PlannedComparison, groups: TwoGroups, shown: ShownMeasure
) -> list[AssumptionCheck]:
    """Every check of a comparison between conditions of which each participant drove one."""
    rows = np.flatnonzero(study.chosen(comparison))
    return [
        _balance(study, comparison, rows),
        *_people(study, groups),
        _shape(groups),
        _single_driver(groups, shown),
        _spread(groups, comparison),
        drift(study, comparison, shown),
        _days(study, comparison, rows),
    ]


def _balance(study: RunStudy, comparison: PlannedComparison, rows: Ints) -> AssumptionCheck:
    """Whether the groups are of one size and drove the same conditions equally often, at the same places."""
    trials, others = study.trials, [one.name for one in study.plan.factors if one.name != comparison.factor]
    sizes, shares, places = [], [], []
    cells = np.array([" ".join(str(trials.levels[name][row]) for name in others) for row in rows], dtype=np.str_)
    for level in (comparison.a, comparison.b):
        mine = trials.levels[comparison.factor][rows] == level
        sizes.append(len(np.unique(trials.participant[rows][mine])))
        shares.append({str(cell): float(np.mean(cells[mine] == cell)) for cell in np.unique(cells)})
        places.append(float(trials.position[rows][mine].mean()))
    uneven = max(abs(shares[0][cell] - shares[1][cell]) for cell in shares[0])
    said = f"{sizes[0]} and {sizes[1]} drivers; mean place in the order {places[0]:.1f} and {places[1]:.1f}"
    if others:
        said += f"; shares of the other conditions differ by at most {100 * uneven:.0f} %"
    return AssumptionCheck(
        name="The groups are of one size and drove the same conditions",
        found=said,
        holds=bool(max(sizes) <= 1.25 * min(sizes) and uneven <= 0.05),
        follows="If they did not, the difference holds what the groups drove beside the factor.",
    )


def _people(study: RunStudy, groups: TwoGroups) -> Iterator[AssumptionCheck]:
    """Whether the groups differ in who they are by more than a draw does (Welch, Bonferroni); nothing without data."""
    from scipy import stats

    if not study.people or min(len(groups.a), len(groups.b)) < LEAST:
        return
    names = list(next(iter(study.people.values())))
    chances, sizes = [], []
    for name in names:
        a, b = (
            np.array([study.people[one][name] for one in some if one in study.people])
            for some in (groups.a_names, groups.b_names)
        )
        spread = float(np.sqrt(0.5 * (a.var(ddof=1) + b.var(ddof=1))))
        sizes.append(abs(float(a.mean() - b.mean())) / spread if spread > 0 else 0.0)
        chances.append(float(stats.ttest_ind(a, b, equal_var=False).pvalue) if spread > 0 else 1.0)
    far = int(np.argmin(chances))
    yield AssumptionCheck(
        name="The groups are alike in who they are",
        found=f"they differ most in {names[far]}, by {sizes[far]:.1f} standard deviations, p "
        f"{probability(min(1.0, chances[far] * len(names)))} (corrected for {len(names)} parameters of the drivers)",
        holds=chances[far] * len(names) >= SURE,
        follows="Groups that are drawn differ by chance, and the interval has that in it. Pairs would not have it.",
    )


def _shape(groups: TwoGroups) -> AssumptionCheck:
    from scipy import stats

    name = "The drivers of each group are spread like a bell curve"
    follows = "The first interval does not need it; Student's t and the mixed model do."
    both = (groups.a, groups.b)
    if min(len(one) for one in both) < LEAST or min(float(np.ptp(one)) for one in both) == 0:
        return AssumptionCheck(name=name, found=UNTOLD, holds=None, follows=follows)
    chances = [float(stats.shapiro(one).pvalue) for one in both]
    skews = " and ".join(f"{float(stats.skew(one)):+.1f}".replace("-", "−") for one in both)
    found = f"skewness {skews}, p {' and '.join(probability(one) for one in chances)} (Shapiro–Wilk)"
    return AssumptionCheck(name=name, found=found, holds=min(chances) >= SURE, follows=follows, needed=False)


def _without_each(values: Floats) -> Floats:
    """The mean without each value in turn."""
    return np.asarray((values.sum() - values) / (len(values) - 1))


def _single_driver(groups: TwoGroups, shown: ShownMeasure) -> AssumptionCheck:
    name = "No single driver makes the result"
    if min(len(groups.a), len(groups.b)) < 3:
        return AssumptionCheck(name=name, found=UNTOLD, holds=None, follows="Too few drivers.")
    mean = float(groups.a.mean() - groups.b.mean())
    without = np.concatenate([_without_each(groups.a) - groups.b.mean(), groups.a.mean() - _without_each(groups.b)])
    far = int(np.argmax(np.abs(without - mean)))
    who = (*groups.a_names, *groups.b_names)[far]
    return AssumptionCheck(
        name=name,
        found=f"{who} moves the mean the most; without him it is {shown.difference(float(without[far]))} "
        f"{shown.difference_unit}",
        holds=bool(np.sign(without[far]) == np.sign(mean)),
        follows="If it does not hold, look at that driver's trials before the result is used.",
    )


def _spread(groups: TwoGroups, comparison: PlannedComparison) -> AssumptionCheck:
    """Brown and Forsythe's test: Levene's with medians."""
    from scipy import stats

    name = "Drivers differ as much in one group as in the other"
    follows = "The intervals (resampled, and Welch's) do not need it; the mixed model does."
    both = (groups.a, groups.b)
    if min(len(one) for one in both) < LEAST or min(float(np.ptp(one)) for one in both) == 0:
        return AssumptionCheck(name=name, found=UNTOLD, holds=None, follows=follows)
    factor = float(groups.a.std(ddof=1) / groups.b.std(ddof=1))
    wide, narrow = (comparison.a, comparison.b) if factor >= 1 else (comparison.b, comparison.a)
    chance = float(stats.levene(*both, center="median").pvalue)
    return AssumptionCheck(
        name=name,
        found=f"the standard deviation with {wide} is {max(factor, 1 / factor):.1f} times that with {narrow}, "
        f"p {probability(chance)} (Brown–Forsythe)",
        holds=chance >= SURE,
        follows=follows,
        needed=False,
    )


def _days(study: RunStudy, comparison: PlannedComparison, rows: Ints) -> AssumptionCheck:
    """Whether the groups met the same days; if not, luck with days is part of the noise."""
    trials = study.trials
    met = [set(trials.day[rows][trials.levels[comparison.factor][rows] == one]) for one in (comparison.a, comparison.b)]
    common, whole = met[0] & met[1], met[0] | met[1]
    name = "The groups met the same days"
    if not common:
        found = f"{len(met[0])} and {len(met[1])} days, none in common"
        follows = 'Luck with days is part of the noise. Common days (days = "common") would take it out.'
        return AssumptionCheck(name=name, found=found, holds=None, follows=follows)
    follows = "The interval covers other such drivers, on these days."
    if len(common) < LEAST:
        follows += " With few days it is too narrow for others."
    return AssumptionCheck(
        name=name, found=f"{len(common)} of {len(whole)} days in common", holds=common == whole, follows=follows
    )
