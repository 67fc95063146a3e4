"""The assumptions behind the statistics of a comparison, each checked on the trials."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from sim.experiment.analysis.differences import ComparedTrials, PairedTrials, TwoGroups
from sim.experiment.analysis.reading import SAME, Floats, Ints, RunStudy, ShownMeasure, Texts, probability
from sim.experiment.plan import PlannedComparison

SURE: Final = 0.01
"""P value of its test below which an assumption counts as broken."""
ENOUGH: Final = 5
"""Participants that are enough for a statistical test, and days that are enough to stand for other days."""
ENOUGH_FOR_SKEWNESS: Final = 8
"""With fewer values the test of skewness is not defined."""
EVEN_NOISE: Final = 2.0
"""Largest ratio of standard deviations of conditions that count as equally noisy."""


@dataclass(frozen=True, kw_only=True)
class AssumptionCheck:
    """One assumption: what was found, and what follows from it; `holds` is None if the trials cannot tell.

    `needed` is False if the method that decides does not need the assumption.
    """

    name: str
    found: str
    holds: bool | None
    follows: str
    needed: bool = True

    @classmethod
    def untold(cls, name: str, follows: str) -> AssumptionCheck:
        """The check of an assumption about which the trials say nothing."""
        return cls(name=name, found="cannot be told", holds=None, follows=follows)


def checks_of(
    study: RunStudy, comparison: PlannedComparison, trials: ComparedTrials, shown: ShownMeasure
) -> list[AssumptionCheck]:
    """Every check of a comparison."""
    if isinstance(trials, TwoGroups):
        rows = study.rows(comparison)
        return [
            _balance(study, comparison, rows),
            *_people(study, trials),
            _shape("The drivers of each group are spread alike to both sides", (trials.a, trials.b)),
            _single_driver_of_groups(trials, shown),
            _spread(trials, comparison),
            _drift(study, comparison, shown),
            _same_days(study, comparison, rows),
        ]
    return [
        _shape("The drivers' differences are spread alike to both sides", (trials.means,)),
        _single_driver(trials.participants, float(trials.means.mean()), _without_each(trials.means), shown),
        _noise(trials, comparison),
        _order(trials, comparison, shown),
        _drift(study, comparison, shown),
        _carry_over(study, comparison, shown),
        _days(trials, shown),
    ]


def _few_or_alike(groups: Sequence[Floats], enough: int = ENOUGH) -> bool:
    """Whether some group has too few drivers for a test, or drivers who do not differ."""
    return min(len(one) for one in groups) < enough or min(float(np.ptp(one)) for one in groups) == 0


def _shape(name: str, groups: Sequence[Floats]) -> AssumptionCheck:
    """Whether the drivers of each group are skewed (D'Agostino, Biometrika 57 (1970) 679–681)."""
    from scipy import stats

    follows = "If it does not hold, a difference is found somewhat too often: take a p near the limit with care."
    if _few_or_alike(groups, ENOUGH_FOR_SKEWNESS):
        return AssumptionCheck.untold(name, follows)
    chances = [float(stats.skewtest(one).pvalue) for one in groups]
    skews = " and ".join(f"{float(stats.skew(one)):+.1f}".replace("-", "−") for one in groups)
    found = f"skewness {skews}, p {' and '.join(probability(one) for one in chances)} (D'Agostino)"
    return AssumptionCheck(name=name, found=found, holds=min(chances) >= SURE, follows=follows)


def _without_each(values: Floats) -> Floats:
    """The mean without each value in turn; NaN for a single one."""
    with np.errstate(invalid="ignore"):
        return np.asarray((values.sum() - values) / (len(values) - 1))


def _single_driver_of_groups(groups: TwoGroups, shown: ShownMeasure) -> AssumptionCheck:
    mean_a, mean_b = groups.a.mean(), groups.b.mean()
    without = np.concatenate([_without_each(groups.a) - mean_b, mean_a - _without_each(groups.b)])
    few = min(len(groups.a), len(groups.b)) < 3
    names = () if few else (*groups.a_names, *groups.b_names)
    return _single_driver(names, float(mean_a - mean_b), without, shown)


def _single_driver(names: Sequence[str], mean: float, without: Floats, shown: ShownMeasure) -> AssumptionCheck:
    """Whether the difference keeps its sign whichever driver is left out; `without[i]` is the mean without driver i."""
    name = "No single driver makes the result"
    if len(names) < 3:
        return AssumptionCheck.untold(name, "Too few drivers.")
    far = int(np.argmax(np.abs(without - mean)))
    return AssumptionCheck(
        name=name,
        found=f"{names[far]} moves the mean the most; without him it is {shown.difference(float(without[far]))} "
        f"{shown.difference_unit}",
        holds=bool(np.sign(without[far]) == np.sign(mean)),
        follows="If it does not hold, look at that driver's trials before the result is used.",
    )


def _noise(pairs: PairedTrials, comparison: PlannedComparison) -> AssumptionCheck:
    """Whether both conditions are equally noisy, once the effects of drivers and of other factors are taken out."""
    name = "Both conditions scatter alike from trial to trial"
    follows = "Paired differences do not need it. The mixed model has a noise for each condition."
    spreads = []
    taken = len(np.unique(pairs.others)) - 1
    for values in (pairs.a, pairs.b):
        rest = values - _means(values, pairs.others)
        rest = rest - pairs.by_participant(rest)[pairs.owner]
        spreads.append(float(np.sqrt((rest**2).sum() / max(len(rest) - len(pairs.participants) - taken, 1))))
    if len(pairs.owner) < 2 * len(pairs.participants) or min(spreads) == 0:
        return AssumptionCheck.untold(name, follows)
    factor = max(spreads) / min(spreads)
    louder, quieter = (comparison.a, comparison.b) if spreads[0] > spreads[1] else (comparison.b, comparison.a)
    found = f"{louder} scatters {factor:.1f} times as much as {quieter}"
    return AssumptionCheck(name=name, found=found, holds=factor <= EVEN_NOISE, follows=follows, needed=False)


def _order(pairs: PairedTrials, comparison: PlannedComparison, shown: ShownMeasure) -> AssumptionCheck:
    name = "It does not matter which condition came first"
    what = f"the difference “{comparison.a}” minus “{comparison.b}”, where “{comparison.a}” came first, is"
    tail = " than where it came second"
    follows = "If it matters, a balanced order still gives a fair mean, but people learn between trials."
    count = len(pairs.participants)
    means = []
    for first in (True, False):
        mine = pairs.a_first == first
        sums = np.bincount(pairs.owner[mine], weights=pairs.differences[mine], minlength=count)
        with np.errstate(invalid="ignore"):
            means.append(sums / np.bincount(pairs.owner[mine], minlength=count))
    both = np.isfinite(means[0]) & np.isfinite(means[1])
    if both.sum() >= ENOUGH:
        return _against_chance(name, follows, means[0][both] - means[1][both], shown, (what, tail))
    only = [one[np.isfinite(one)] for one in means]
    if min(len(one) for one in only) < ENOUGH:
        return AssumptionCheck.untold(name, follows)
    from scipy import stats

    chance = float(stats.ttest_ind(*only, equal_var=False).pvalue)
    found = f"{what} {_compared_words(shown, float(only[0].mean() - only[1].mean()), tail)}"
    return AssumptionCheck(
        name=name, found=f"{found}, p {probability(chance)}", holds=not chance < SURE, follows=follows
    )


def _carry_over(study: RunStudy, comparison: PlannedComparison, shown: ShownMeasure) -> AssumptionCheck:
    """Whether a trial depends on the condition of the one before it."""
    trials, rows = study.trials, study.rows(comparison)
    driver, position = trials.participant[rows], trials.position[rows]
    rest = _unexplained(study, comparison, rows)
    carried = [
        _carried(study, comparison, str(one), position[driver == one], rest[driver == one]) for one in np.unique(driver)
    ]
    return _against_chance(
        "A trial does not depend on the condition of the trial before",
        "If it does, a break or another trial must lie between conditions.",
        np.array([one for one in carried if math.isfinite(one)]),
        shown,
        (f"after “{comparison.a}”, the measure is", f" than after “{comparison.b}”"),
    )


def _drift(study: RunStudy, comparison: PlannedComparison, shown: ShownMeasure) -> AssumptionCheck:
    """Whether values drift from trial to trial of a driver."""
    trials, rows = study.trials, study.rows(comparison)
    driver, position = trials.participant[rows], trials.position[rows].astype(np.float64)
    rest = _unexplained(study, comparison, rows)
    slopes = [
        float(np.polyfit(position[driver == one], rest[driver == one], 1)[0])
        for one in np.unique(driver)
        if len(np.unique(position[driver == one])) > 2
    ]
    return _against_chance(
        "Drivers neither tire nor improve from trial to trial", "If they do, order must be balanced.",
        np.array(slopes), shown, ("with each further trial, the measure is", ""),
    )  # fmt: skip


def _unexplained(study: RunStudy, comparison: PlannedComparison, rows: Ints) -> Floats:
    """What remains of each value once the means of its conditions and of its driver are subtracted, (trials,)."""
    trials = study.trials
    rest = trials.values[comparison.measure][rows].copy()
    for names in (study.conditions(rows), trials.participant[rows]):
        rest -= _means(rest, names)
    return rest


def _means(values: Floats, names: Texts) -> Floats:
    _, index = np.unique(names, return_inverse=True)
    return np.asarray((np.bincount(index, weights=values) / np.bincount(index))[index])


def _carried(study: RunStudy, comparison: PlannedComparison, driver: str, position: Ints, rest: Floats) -> float:
    """The mean remainder of one driver after trials at level a, less the mean after b; NaN if either is missing."""
    trials = study.trials
    mine = trials.participant == driver
    before = dict(zip(trials.position[mine].tolist(), trials.levels[comparison.factor][mine].tolist(), strict=True))
    previous = np.array([before.get(int(one) - 1, "") for one in position])
    after_a, after_b = (rest[previous == level] for level in (comparison.a, comparison.b))
    return float(after_a.mean() - after_b.mean()) if len(after_a) and len(after_b) else math.nan


def _days(pairs: PairedTrials, shown: ShownMeasure) -> AssumptionCheck:
    """Whether the days are enough to stand for others: the interval covers other participants, but not other days."""
    name = "The days are many enough to stand for other days"
    if not pairs.same_day:
        return AssumptionCheck(
            name=name, found="the conditions have no day in common; pairs are by participant alone", holds=None,
            follows="What differs between the days is part of the noise.",
        )  # fmt: skip
    days, index = np.unique(pairs.cell, return_inverse=True)
    met = np.bincount(index)
    if met.mean() < 2.0:
        found, holds = ("no two drivers" if met.max() == 1 else "hardly any drivers") + " share a day", True
    else:
        means = np.bincount(index, weights=pairs.differences) / met
        spread = float(means.std(ddof=1)) if len(days) > 1 else math.nan
        found = f"{len(days)} days that drivers share"
        if math.isfinite(spread):
            found += f"; the mean difference has a standard deviation of {shown.with_unit(spread)} from day to day"
        holds = len(days) >= ENOUGH
    follows = "The interval covers other such drivers on other days of the same kinds."
    if not holds:
        follows = "The interval covers other such drivers on these days; for other days it is too narrow."
    return AssumptionCheck(name=name, found=found, holds=holds, follows=follows)


def _compared_words(shown: ShownMeasure, difference: float, tail: str) -> str:
    """A difference in words, then `tail` for the other side: `2.1 points lower than …`, or `the same as …`."""
    changed = shown.changed(difference)
    return changed + (tail.replace(" than ", " as ", 1) if changed == SAME else tail)


def _against_chance(
    name: str, follows: str, values: Floats, shown: ShownMeasure, what: tuple[str, str]
) -> AssumptionCheck:
    """Check whether a figure, one for each participant, differs from 0 only by chance (Student's t).

    `what` are the words before and after the finding.
    """
    from scipy import stats

    if len(values) < ENOUGH:
        return AssumptionCheck.untold(name, follows)
    if float(np.ptp(values)) == 0:
        return AssumptionCheck(name=name, found="no driver differs", holds=bool(values[0] == 0), follows=follows)
    chance = float(stats.ttest_1samp(values, 0.0).pvalue)
    return AssumptionCheck(
        name=name,
        found=f"{what[0]} {_compared_words(shown, float(values.mean()), what[1])}, p {probability(chance)}",
        holds=chance >= SURE,
        follows=follows,
    )


def _balance(study: RunStudy, comparison: PlannedComparison, rows: Ints) -> AssumptionCheck:
    """Whether the groups are of one size and drove the same conditions equally often and equally early."""
    trials, cells = study.trials, study.conditions(rows, without=comparison.factor)
    sizes, shares, places = [], [], []
    for level in (comparison.a, comparison.b):
        mine = trials.levels[comparison.factor][rows] == level
        sizes.append(len(np.unique(trials.participant[rows][mine])))
        shares.append({str(cell): float(np.mean(cells[mine] == cell)) for cell in np.unique(cells)})
        places.append(float(trials.position[rows][mine].mean()))
    uneven = max(abs(shares[0][cell] - shares[1][cell]) for cell in shares[0])
    said = f"{sizes[0]} and {sizes[1]} drivers; mean place in the order {places[0]:.1f} and {places[1]:.1f}"
    if len(study.plan.factors) > 1:
        said += f"; shares of the other conditions differ by at most {100 * uneven:.0f} %"
    return AssumptionCheck(
        name="The groups are of one size and drove the same conditions",
        found=said,
        holds=bool(max(sizes) <= 1.25 * min(sizes) and uneven <= 0.05),
        follows="If they did not, the difference holds what the groups drove beside the factor.",
    )


def _people(study: RunStudy, groups: TwoGroups) -> Iterator[AssumptionCheck]:
    """Whether the drivers of the groups differ by more than chance (Welch, Bonferroni); no check without their data."""
    from scipy import stats

    if not study.people or min(len(groups.a), len(groups.b)) < ENOUGH:
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


def _spread(groups: TwoGroups, comparison: PlannedComparison) -> AssumptionCheck:
    """Whether the drivers of both groups differ equally among themselves (Brown and Forsythe: Levene with medians)."""
    from scipy import stats

    name = "Drivers differ as much in one group as in the other"
    follows = "Welch's t does not need it; the mixed model does."
    both = (groups.a, groups.b)
    if _few_or_alike(both):
        return AssumptionCheck.untold(name, follows)
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


def _same_days(study: RunStudy, comparison: PlannedComparison, rows: Ints) -> AssumptionCheck:
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
    if len(common) < ENOUGH:
        follows += " With few days it is too narrow for others."
    return AssumptionCheck(
        name=name, found=f"{len(common)} of {len(whole)} days in common", holds=common == whole, follows=follows
    )
