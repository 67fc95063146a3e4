"""How far drivers differ from each other, apart from how far one driver differs from day to day.

Both are estimated by moments (analysis of variance): Searle, Casella and McCulloch, Variance Components, 1992, chapters
3 and 4. The interval comes from drawing the study's drivers again, with replacement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from sim.experiment.analysis.reading import Floats, Texts
from sim.experiment.plan import LEAST_PARTICIPANTS

SD_RESAMPLES: Final = 1999
"""Resamples for the interval of a standard deviation."""
NO_RANGE: Final = (math.nan, math.nan)
WIDEST: Final = 5.0
"""Largest ratio of the ends of a given interval of a standard deviation; beyond it the drivers are too few. At the ends
of a wider one, the numbers of participants needed differ more than 25-fold."""


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

    They are too few below `LEAST_PARTICIPANTS`, and where the ends of the interval differ more than `WIDEST`-fold.

    It is the studentized bootstrap of the logarithm of the variance, whose standard error comes from the fourth moment.
    """
    if len(values) < LEAST_PARTICIPANTS or float(np.ptp(values)) == 0:
        return NO_RANGE
    log, error = _log_variance(values[None])
    logs, errors = _log_variance(values[rng.integers(0, len(values), (SD_RESAMPLES, len(values)))])
    known = np.isfinite(logs) & (errors > 0)
    low, high = np.quantile((logs[known] - log) / errors[known], (0.025, 0.975))
    if 0.5 * (high - low) * error[0] > math.log(WIDEST):
        return NO_RANGE
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
