"""Drawing the participants of a study again, with replacement: means and standard deviations without a bell curve.

The method is the studentized bootstrap (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, section 12.5).
Each resample gives the distance of its mean from the study's mean, in standard errors of the resample. The quantiles of
that distance take the place of the quantiles of Student's t. Participants are drawn, not trials, because trials of one
person are not independent. The functions for means work on many studies at once: one row for each study, one column for
each participant.

How far drivers differ from each other, apart from how far one driver differs from day to day, is estimated by moments
(analysis of variance): Searle, Casella and McCulloch, Variance Components, 1992, chapters 3 and 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from sim.experiment.analysis.reading import Floats, Texts
from sim.experiment.plan import LEAST_PARTICIPANTS

RESAMPLES: Final = 19_999
"""Resamples of an analysis: a probability of 0.05 is known to 0.003, and the smallest is 0.0001."""
LEAST_RESAMPLES: Final = 999
"""Fewest resamples, however many participants there are."""
SD_RESAMPLES: Final = 1999
"""Resamples for the interval of a standard deviation."""
MOST_CELLS: Final = 20_000_000
"""Largest number of cells of a table of resamples by participants (160 MB); very many participants get fewer resamples.
"""
NO_RANGE: Final = (math.nan, math.nan)


def weights(participants: int, resamples: int, rng: np.random.Generator) -> Floats:
    """How often each resample draws each participant, (resamples, participants); see `MOST_CELLS`."""
    resamples = min(resamples, max(MOST_CELLS // participants, LEAST_RESAMPLES))
    even = np.full(participants, 1.0 / participants)
    return rng.multinomial(participants, even, size=resamples).astype(np.float64)


class ResampledStudies(NamedTuple):
    """Mean and standard error of each study, (studies,), and distances of its resamples in their own errors."""

    means: Floats
    errors: Floats
    distances: Floats

    @property
    def probabilities(self) -> Floats:
        """Two-sided probability of a mean at least this far from 0 if the true mean is 0, (studies,).

        It is below a level if, and only if, the interval of that level does not contain 0. A study without any spread
        has 1 for a mean of 0, and otherwise NaN, because nothing is known about chance.
        """
        resamples = self.distances.shape[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            found = (self.means / self.errors)[:, None]
        above = (np.sum(self.distances >= found, axis=1) + 1) / (resamples + 1)
        below = (np.sum(self.distances <= found, axis=1) + 1) / (resamples + 1)
        both = np.minimum(2.0 * np.minimum(above, below), 1.0)
        return np.where(self.errors > 0, both, np.where(self.means == 0, 1.0, np.nan))


def resampled(groups: Sequence[Floats], drawn: Sequence[Floats]) -> ResampledStudies:
    """Resample studies, each group by weights of its own.

    One group (studies, participants) has paired differences; two groups have their means compared, first less second.
    """
    moments = [_moments(one, weight) for one, weight in zip(groups, drawn, strict=True)]

    def difference(parts: Sequence[Floats]) -> Floats:
        return parts[0] if len(parts) == 1 else parts[0] - parts[1]

    def together(errors: Sequence[Floats]) -> Floats:
        return errors[0] if len(errors) == 1 else np.hypot(*errors)

    means, errors = difference([one for one, _ in moments]), together([one for _, one in moments])
    return ResampledStudies(
        difference([one.mean(axis=1) for one in groups]),
        together([one.std(axis=1, ddof=1) / np.sqrt(one.shape[1]) for one in groups]),
        _studentized(means, errors),
    )


def _moments(values: Floats, drawn: Floats) -> tuple[Floats, Floats]:
    """Mean less the study's mean, and standard error, of every resample, each (studies, resamples)."""
    count = values.shape[1]
    centred = values - values.mean(axis=1, keepdims=True)
    means = centred @ drawn.T / count
    squares = centred**2 @ drawn.T / count
    variance = np.maximum(squares - means**2, 0.0) * (count / (count - 1))
    return means, np.sqrt(variance / count)


def _studentized(means: Floats, errors: Floats) -> Floats:
    """Distances of resamples in their own standard errors; without spread infinite, or 0 at the mean of the study."""
    tiny = 1e-12 * np.maximum(np.abs(means).max(axis=-1, keepdims=True), 1e-300)
    without_spread = np.where(np.abs(means) > tiny, np.copysign(np.inf, means), 0.0)
    return np.where(errors > tiny, means / np.maximum(errors, tiny), without_spread)


@dataclass(frozen=True, kw_only=True)
class DriverSpread:
    """Standard deviations in the unit of the measure: between drivers, and of one driver from day to day.

    `separate` is False if each driver drove once: `between` then holds both, and `within` is NaN.
    """

    drivers: int
    mean: float
    between: float
    interval: tuple[float, float]
    within: float
    separate: bool


def spread_of(values: Floats, driver: Texts, cell: Texts, rng: np.random.Generator) -> DriverSpread:
    """The spread of values by driver; a cell (day and other conditions) may move all drivers alike."""
    table, shared = as_table(values, driver, cell)
    removed = table.shape[1] - 1 if shared else 0
    between, within = (float(one[0]) for one in components(table[None], removed))
    separate = math.isfinite(within)
    means = np.nanmean(table, axis=1)
    chance = np.nan_to_num(within) ** 2 * float((1.0 / np.isfinite(table).sum(axis=1)).mean())
    low, high = sd_interval(means, rng)
    return DriverSpread(
        drivers=len(table), mean=float(means.mean()), between=between,
        interval=(_less(low, chance), _less(high, chance)), within=within, separate=separate,
    )  # fmt: skip


def _less(sd: float, variance: float) -> float:
    """A standard deviation, less a variance that is part of its square."""
    return math.sqrt(max(sd**2 - variance, 0.0))


def sd_interval(values: Floats, rng: np.random.Generator) -> tuple[float, float]:
    """The 95 % interval of the standard deviation of drivers' values (n,), without a bell curve; NaN for too few.

    It is the studentized bootstrap of the logarithm of the variance, whose standard error comes from the fourth moment.
    """
    if len(values) < LEAST_PARTICIPANTS or float(np.ptp(values)) == 0:
        return NO_RANGE
    log, error = _log_variance(values[None])
    logs, errors = _log_variance(values[rng.integers(0, len(values), (SD_RESAMPLES, len(values)))])
    known = np.isfinite(logs) & (errors > 0)
    low, high = np.quantile((logs[known] - log) / errors[known], (0.025, 0.975))
    return float(np.exp(0.5 * (log[0] - high * error[0]))), float(np.exp(0.5 * (log[0] - low * error[0])))


def _log_variance(values: Floats) -> tuple[Floats, Floats]:
    """Logarithm of the variance of each row of values (rows, n), and its standard error."""
    count = values.shape[1]
    centred = values - values.mean(axis=1, keepdims=True)
    second, fourth = (centred**2).mean(axis=1), (centred**4).mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(second * count / (count - 1)), np.sqrt((fourth / second**2 - 1.0) / count)


def as_table(values: Floats, driver: Texts, cell: Texts) -> tuple[Floats, bool]:
    """Values by driver and cell, (drivers, cells), NaN if there are none; and whether drivers share cells.

    If they share cells, what all drivers have in common in a cell (a hard day) is subtracted. If the drivers have
    different days, the columns are each driver's first, second, … value.
    """
    _, row = np.unique(driver, return_inverse=True)
    names, column = np.unique(cell, return_inverse=True)
    shared = np.bincount(column).mean() >= 2.0 and len(names) > 1
    if not shared:
        column = np.array([np.sum(row[:index] == one) for index, one in enumerate(row)])
    sums = np.zeros((row.max() + 1, column.max() + 1))
    counts = np.zeros_like(sums)
    np.add.at(sums, (row, column), values)
    np.add.at(counts, (row, column), 1.0)
    with np.errstate(invalid="ignore"):
        table = sums / counts
    if shared:
        table = table - np.nanmean(table, axis=0) + np.nanmean(table)
    return np.asarray(table), bool(shared)


def components(tables: Floats, removed: int = 0) -> tuple[Floats, Floats]:
    """Standard deviations between rows and within them, of tables (studies, drivers, cells; NaN: a missing value).

    `removed` is how many differences between cells were taken out of the table. A negative variance between drivers is
    0. If no driver has two values, the first holds the spread of both kinds, and the second is NaN.
    """
    there = np.isfinite(tables)
    counts = there.sum(axis=2)
    drivers, total = (counts > 0).sum(axis=1), counts.sum(axis=1)
    filled = np.where(there, tables, 0.0)
    means = filled.sum(axis=2) / np.maximum(counts, 1)
    grand = filled.sum(axis=(1, 2)) / total
    inside = (np.where(there, tables - means[:, :, None], 0.0) ** 2).sum(axis=(1, 2))
    between = (counts * (means - grand[:, None]) ** 2).sum(axis=1) / np.maximum(drivers - 1, 1)
    freedom = total - drivers - removed
    within = np.where(freedom > 0, inside / np.maximum(freedom, 1), np.nan)
    typical = (total - (counts**2).sum(axis=1) / total) / np.maximum(drivers - 1, 1)
    variance = (between - np.nan_to_num(within)) / np.maximum(typical, 1e-300)
    return np.sqrt(np.maximum(variance, 0.0)), np.sqrt(within)
