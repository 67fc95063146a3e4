"""What the statistics of a comparison assume, and whether the trials bear it out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from sim.experiment.analysis.pairs import PairedTrials
from sim.experiment.analysis.reading import Floats, Ints, RunStudy, Texts
from sim.experiment.analysis.shown import SAME, ShownMeasure, probability
from sim.experiment.plan import PlannedComparison

SURE: Final = 0.01
"""An assumption counts as broken where chance alone would show as much less often than this."""
LEAST: Final = 5
"""Fewest participants for a check by a test."""
EVEN_NOISE: Final = 2.0
"""Conditions whose standard deviations differ by more than this factor have no common noise."""


@dataclass(frozen=True, kw_only=True)
class AssumptionCheck:
    """One assumption: what was found, and what follows; `holds` is None where the trials cannot tell.

    `needed` is False where the first interval does not need the assumption.
    """

    name: str
    found: str
    holds: bool | None
    follows: str
    needed: bool = True


def checks_of(
    study: RunStudy, comparison: PlannedComparison, pairs: PairedTrials, shown: ShownMeasure
) -> list[AssumptionCheck]:
    """Every check of a comparison between conditions that each participant drove."""
    means = pairs.by_participant(pairs.differences)
    return [
        _shape(means),
        _single_driver(means, pairs.participants, shown),
        _noise(pairs, comparison),
        _order(pairs, comparison, shown),
        *_along_the_session(study, comparison, shown),
        _days(pairs, shown),
    ]


def _shape(means: Floats) -> AssumptionCheck:
    from scipy import stats

    name = "The drivers' differences are spread like a bell curve"
    follows = "The first interval does not need it; Student's t and the mixed model do."
    if len(means) < LEAST or float(np.ptp(means)) == 0:
        return AssumptionCheck(name=name, found="cannot be told", holds=None, follows=follows)
    chance = float(stats.shapiro(means).pvalue)
    skew = float(stats.skew(means))
    found = f"skewness {skew:+.1f}, p {probability(chance)} (Shapiro–Wilk)".replace("-", "−")
    return AssumptionCheck(name=name, found=found, holds=chance >= SURE, follows=follows, needed=False)


def _single_driver(means: Floats, names: tuple[str, ...], shown: ShownMeasure) -> AssumptionCheck:
    name = "No single driver makes the result"
    count = len(means)
    if count < 3:
        return AssumptionCheck(name=name, found="cannot be told", holds=None, follows="Too few drivers.")
    without = (means.sum() - means) / (count - 1)
    far = int(np.argmax(np.abs(without - means.mean())))
    changes = np.sign(without[far]) != np.sign(means.mean())
    found = (
        f"{names[far]} moves the mean the most; without him it is {shown.difference(float(without[far]))} "
        f"{shown.difference_unit}"
    )
    return AssumptionCheck(
        name=name,
        found=found,
        holds=not changes,
        follows="If it does not hold, look at that driver's trials before the result is used.",
    )


def _noise(pairs: PairedTrials, comparison: PlannedComparison) -> AssumptionCheck:
    """Noise is what remains in a condition when drivers and what the other factors do are taken out."""
    name = "Both conditions scatter alike from trial to trial"
    follows = "Paired differences do not need it. The mixed model has a noise for each condition."
    spreads = []
    taken = len(np.unique(pairs.others)) - 1
    for values in (pairs.a, pairs.b):
        rest = values - _means(values, pairs.others)
        rest = rest - pairs.by_participant(rest)[pairs.owner]
        spreads.append(float(np.sqrt((rest**2).sum() / max(len(rest) - len(pairs.participants) - taken, 1))))
    if len(pairs.owner) < 2 * len(pairs.participants) or min(spreads) == 0:
        return AssumptionCheck(name=name, found="cannot be told", holds=None, follows=follows)
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
    if both.sum() >= LEAST:
        return _against_chance(
            name,
            follows,
            means[0][both] - means[1][both],
            shown,
            (what, tail),
        )
    only = [one[np.isfinite(one)] for one in means]
    if min(len(one) for one in only) < LEAST:
        return AssumptionCheck(name=name, found="cannot be told", holds=None, follows=follows)
    from scipy import stats

    chance = float(stats.ttest_ind(*only, equal_var=False).pvalue)
    found = f"{what} {compared_words(shown, float(only[0].mean() - only[1].mean()), tail)}"
    return AssumptionCheck(
        name=name, found=f"{found}, p {probability(chance)}", holds=not chance < SURE, follows=follows
    )


def _along_the_session(study: RunStudy, comparison: PlannedComparison, shown: ShownMeasure) -> list[AssumptionCheck]:
    """Whether values drift from trial to trial, and whether a trial depends on the condition of the one before it."""
    trials, rows = study.trials, np.flatnonzero(study.chosen(comparison))
    driver, position = trials.participant[rows], trials.position[rows]
    rest = _unexplained(study, comparison, rows)
    carried = [
        _carried(study, comparison, str(one), position[driver == one], rest[driver == one]) for one in np.unique(driver)
    ]
    found = np.array([one for one in carried if math.isfinite(one)])
    return [
        drift(study, comparison, shown),
        _against_chance(
            "A trial does not depend on the condition of the trial before",
            "If it does, a break or another trial must lie between conditions.",
            found, shown, (f"after “{comparison.a}”, the measure is", f" than after “{comparison.b}”"),
        ),
    ]  # fmt: skip


def drift(study: RunStudy, comparison: PlannedComparison, shown: ShownMeasure) -> AssumptionCheck:
    """Whether values drift from trial to trial of a driver."""
    trials, rows = study.trials, np.flatnonzero(study.chosen(comparison))
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
    """What remains of each value without the mean of its conditions and of its driver, (trials,)."""
    trials = study.trials
    rest = trials.values[comparison.measure][rows].copy()
    cells = [" ".join(str(trials.levels[one.name][row]) for one in study.plan.factors) for row in rows]
    for names in (np.array(cells), trials.participant[rows]):
        rest -= _means(rest, names)
    return rest


def _means(values: Floats, names: Texts) -> Floats:
    _, index = np.unique(names, return_inverse=True)
    return np.asarray((np.bincount(index, weights=values) / np.bincount(index))[index])


def _carried(study: RunStudy, comparison: PlannedComparison, driver: str, position: Ints, rest: Floats) -> float:
    """What remains after trials at level a, less after trials at level b, of one driver; NaN where he lacks one."""
    trials = study.trials
    mine = trials.participant == driver
    before = dict(zip(trials.position[mine].tolist(), trials.levels[comparison.factor][mine].tolist(), strict=True))
    previous = np.array([before.get(int(one) - 1, "") for one in position])
    after_a, after_b = (rest[previous == level] for level in (comparison.a, comparison.b))
    return float(after_a.mean() - after_b.mean()) if len(after_a) and len(after_b) else math.nan


def _days(pairs: PairedTrials, shown: ShownMeasure) -> AssumptionCheck:
    """Whether the result would move with other days: participants are resampled, days are not."""
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
        holds = len(days) >= LEAST
    follows = "The interval covers other such drivers on other days of the same kinds."
    if not holds:
        follows = "The interval covers other such drivers on these days; for other days it is too narrow."
    return AssumptionCheck(name=name, found=found, holds=holds, follows=follows)


def compared_words(shown: ShownMeasure, difference: float, tail: str) -> str:
    """A difference in words with what it is compared with: `2.1 points lower than …`, or `the same as …`."""
    changed = shown.changed(difference)
    return changed + (tail.replace(" than ", " as ", 1) if changed == SAME else tail)


def _against_chance(
    name: str, follows: str, values: Floats, shown: ShownMeasure, what: tuple[str, str]
) -> AssumptionCheck:
    """A check that the mean of a figure of each participant is 0 but for chance (Student's t).

    `what` is said before and after what was found.
    """
    from scipy import stats

    if len(values) < LEAST:
        return AssumptionCheck(name=name, found="cannot be told", holds=None, follows=follows)
    if float(np.ptp(values)) == 0:
        return AssumptionCheck(name=name, found="no driver differs", holds=bool(values[0] == 0), follows=follows)
    chance = float(stats.ttest_1samp(values, 0.0).pvalue)
    return AssumptionCheck(
        name=name,
        found=f"{what[0]} {compared_words(shown, float(values.mean()), what[1])}, p {probability(chance)}",
        holds=chance >= SURE,
        follows=follows,
    )
