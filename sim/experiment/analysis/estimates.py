"""The estimate of a difference: its mean, interval, probability under chance, and size in standard deviations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from sim.experiment.analysis.reading import Floats
from sim.experiment.analysis.resampling import (
    probabilities,
    resampled_moments,
    standard_errors,
    studentized,
    weights,
)
from sim.experiment.plan import LEAST_PARTICIPANTS

CONFIDENCE: Final = 0.95
MOST_WITHOUT_SPREAD: Final = 0.005
"""Largest share of resamples without spread; an interval of 95 % leaves out 2.5 % at either end."""
NO_RANGE: Final = (math.nan, math.nan)


@dataclass(frozen=True, kw_only=True)
class DifferenceEstimate:
    """A mean difference between two conditions, in the unit of its measure.

    `interval` (95 %) and `probability` come from resampled participants, where there are enough that differ, else from
    Student's t; `resampled` says which. `t_interval` and `t_probability` are Student's (Welch's for two groups).
    `size` is the mean in standard deviations between participants (d_z for pairs, d for two groups); its interval is
    that of the noncentral t distribution, for two groups Bonett's.
    """

    mean: float
    sd: float
    participants: int
    interval: tuple[float, float]
    probability: float
    t_interval: tuple[float, float]
    t_probability: float
    size: float
    size_interval: tuple[float, float]
    resampled: bool

    @property
    def known(self) -> bool:
        """Whether there was any spread to judge the difference by."""
        return math.isfinite(self.interval[0])


def paired_estimate(differences: Floats, resamples: int, rng: np.random.Generator) -> DifferenceEstimate:
    """The mean of one difference for each participant (n,), with its interval."""
    from scipy import stats

    count, mean = len(differences), float(differences.mean())
    sd = float(differences.std(ddof=1)) if count > 1 else math.nan
    if _without_spread(differences):
        return _unknown(mean, 0.0 if count > 1 else math.nan, count)
    error = sd / math.sqrt(count)
    reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2, count - 1)) * error
    t_probability = float(2 * stats.t.sf(abs(mean) / error, count - 1))
    interval, probability = (mean - reach, mean + reach), t_probability
    resampled = count >= LEAST_PARTICIPANTS
    if resampled:
        one = differences[None, :]
        distances = studentized(*resampled_moments(one, weights(count, resamples, rng)))
        resampled = _enough_spread(distances[0])
        if resampled:
            interval = _interval(mean, error, distances[0])
            probability = float(probabilities(np.array([mean]), standard_errors(one), distances)[0])
    return DifferenceEstimate(
        mean=mean, sd=sd, participants=count, interval=interval, probability=probability,
        t_interval=(mean - reach, mean + reach), t_probability=t_probability,
        size=mean / sd, size_interval=size_interval(mean / sd, count), resampled=resampled,
    )  # fmt: skip


def group_estimate(a: Floats, b: Floats, resamples: int, rng: np.random.Generator) -> DifferenceEstimate:
    """The difference of the means of two groups of participants (a less b), each group resampled by itself."""
    from scipy import stats

    mean, count = float(a.mean() - b.mean()), len(a) + len(b)
    if min(len(a), len(b)) < 2 or (_without_spread(a) and _without_spread(b)):
        return _unknown(mean, math.nan, count)
    error = math.hypot(*(float(standard_errors(one[None, :])[0]) for one in (a, b)))
    welch = stats.ttest_ind(a, b, equal_var=False)
    reach = float(stats.t.ppf(0.5 + CONFIDENCE / 2, welch.df)) * error
    sd = math.sqrt(0.5 * (float(a.var(ddof=1)) + float(b.var(ddof=1))))
    interval, probability = (mean - reach, mean + reach), float(welch.pvalue)
    resampled = min(len(a), len(b)) >= LEAST_PARTICIPANTS
    if resampled:
        (means_a, errors_a), (means_b, errors_b) = (
            resampled_moments(one[None, :], weights(len(one), resamples, rng)) for one in (a, b)
        )
        distances = studentized(means_a - means_b, np.hypot(errors_a, errors_b))
        resampled = _enough_spread(distances[0])
        if resampled:
            interval = _interval(mean, error, distances[0])
            probability = float(probabilities(np.array([mean]), np.array([error]), distances)[0])
    return DifferenceEstimate(
        mean=mean, sd=sd, participants=count, interval=interval, probability=probability,
        t_interval=(mean - reach, mean + reach), t_probability=float(welch.pvalue),
        size=mean / sd, size_interval=group_size_interval(a, b), resampled=resampled,
    )  # fmt: skip


def group_size_interval(a: Floats, b: Floats) -> tuple[float, float]:
    """The 95 % interval of the difference of two groups in standard deviations (root of their mean variance).

    The groups may differ in variance: Bonett, Psychological Methods 13 (2008) 99–109, equations 8 and 9.
    """
    from scipy import stats

    variances = [float(one.var(ddof=1)) for one in (a, b)]
    freedoms = [len(one) - 1 for one in (a, b)]
    middle = 0.5 * sum(variances)
    size = float(a.mean() - b.mean()) / math.sqrt(middle)
    of_size = size**2 * sum(one**2 / free for one, free in zip(variances, freedoms, strict=True)) / (8.0 * middle**2)
    of_means = sum(one / free for one, free in zip(variances, freedoms, strict=True)) / middle
    reach = float(stats.norm.ppf(0.5 + CONFIDENCE / 2)) * math.sqrt(of_size + of_means)
    return size - reach, size + reach


def size_interval(size: float, participants: int) -> tuple[float, float]:
    """The 95 % interval of an effect in standard deviations, from the noncentral t distribution.

    Cumming and Finch, Educational and Psychological Measurement 61 (2001) 532–574.
    """
    from scipy import optimize, stats

    root, freedom = math.sqrt(participants), participants - 1
    found = abs(size) * root
    around = 6.0 * math.sqrt(1.0 + found**2 / (2.0 * freedom))

    def bound(share: float) -> float:
        centre = optimize.brentq(lambda one: stats.nct.cdf(found, freedom, one) - share, found - around, found + around)
        return float(centre) / root

    try:
        low, high = bound(0.5 + CONFIDENCE / 2), bound(0.5 - CONFIDENCE / 2)
    except ValueError:  # no sign change: the effect is so large that the distribution cannot be computed
        return NO_RANGE
    return (low, high) if size >= 0 else (-high, -low)


def _enough_spread(distances: Floats) -> bool:
    """Whether few enough resamples are without spread: where hardly any driver differs, many draw equal ones only."""
    return float(np.mean(np.isinf(distances))) < MOST_WITHOUT_SPREAD


def _interval(mean: float, error: float, distances: Floats) -> tuple[float, float]:
    low, high = np.quantile(distances, (0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2))
    return float(mean - high * error), float(mean - low * error)


def _without_spread(values: Floats) -> bool:
    """Whether all values are the same but for rounding."""
    return len(values) < 2 or float(np.ptp(values)) <= 1e-12 * max(float(np.abs(values).max()), 1e-300)


def _unknown(mean: float, sd: float, count: int) -> DifferenceEstimate:
    """An estimate without interval: one participant, or no spread between them."""
    nothing = 1.0 if mean == 0 and sd == 0 else math.nan
    return DifferenceEstimate(
        mean=mean, sd=sd, participants=count, interval=NO_RANGE, probability=nothing, t_interval=NO_RANGE,
        t_probability=nothing, size=math.nan, size_interval=NO_RANGE, resampled=False,
    )  # fmt: skip


def corrected(probabilities: Floats, correction: str) -> Floats:
    """Probabilities corrected for the number of planned comparisons; NaN stays NaN, but counts as a comparison.

    `holm`: Holm, Scandinavian Journal of Statistics 6 (1979) 65–70. `bonferroni`: each times their number. `none`: as
    they are.
    """
    count = len(probabilities)
    if correction == "none":
        return probabilities
    if correction == "bonferroni":
        return np.minimum(probabilities * count, 1.0)
    order = np.argsort(probabilities)  # NaN last
    steps = probabilities[order] * (count - np.arange(count))
    result = np.empty(count)
    result[order] = np.minimum(np.fmax.accumulate(steps), 1.0)
    result[np.isnan(probabilities)] = np.nan
    return result
