"""The test that decides on paired differences: flip the signs of the drivers' differences, and see how often the mean
is as large (R. A. Fisher, The Design of Experiments, 1935, § 21).

If the two conditions are one, a driver's difference might as well have had the other sign. Every pattern of signs is
then equally probable, and p is the share of patterns whose mean is at least as far from 0 as the one found. With few
drivers all patterns are counted, and p is exact; with many, patterns are drawn at random.

The interval holds each true difference that the same test does not reject. A pattern that flips some drivers is as far
from 0 as the one found exactly where the mean of these drivers is on the other side of the true difference, so that the
bounds are means of drivers (J. Hartigan, Journal of the American Statistical Association 64 (1969) 1303–1317).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from sim.experiment.analysis.reading import Floats

MOST_EXACT: Final = 16
"""Most drivers for whom all patterns are counted."""
ALL_PATTERNS: Final = 2 ** (MOST_EXACT - 1)
PATTERNS: Final = 20_000
"""Patterns of an analysis with more drivers, the one found among them: a p of 0.05 is known to 0.003."""
MOST_CELLS: Final = 20_000_000
"""Most signs of a table of patterns (160 MB): with very many drivers there are fewer patterns, but at least 1000."""
ROUNDING: Final = 1e-10
"""Share of the mean magnitude below which a difference of means counts as none."""


def signs_of(drivers: int, rng: np.random.Generator, patterns: int = ALL_PATTERNS) -> Floats:
    """Patterns of signs (patterns, drivers), the one without a flip first.

    They are all patterns if these are no more than `patterns`, else as many drawn at random, but at most `PATTERNS`. A
    pattern stands for its mirror image too, so that the first driver is never flipped.
    """
    if 2 ** (drivers - 1) <= patterns:
        flipped = np.arange(2 ** (drivers - 1))[:, None] >> np.arange(drivers - 1, -1, -1) & 1 == 1
    else:
        count = min(patterns, PATTERNS, max(MOST_CELLS // drivers, 1000))
        flipped = rng.random((count - 1, drivers)) < 0.5
        flipped[:, 0] = False
        flipped = np.concatenate([np.zeros((1, drivers), dtype=bool), flipped[flipped.any(axis=1)]])
    return np.where(flipped, -1.0, 1.0)


def probabilities(differences: Floats, signs: Floats) -> Floats:
    """Two-sided p of each study (studies, drivers): how probable a mean this far from 0 is without a difference."""
    found = np.abs(differences.sum(axis=1, keepdims=True)) - ROUNDING * np.abs(differences).sum(axis=1, keepdims=True)
    return np.asarray((np.abs(differences @ signs.T) >= found).mean(axis=1))


def interval(differences: Floats, signs: Floats, confidence: float) -> tuple[float, float]:
    """The mean differences that the test does not reject at the level 1 − `confidence`; infinite for too few drivers.

    `differences` has one for each driver, (drivers,).
    """
    flipped = signs[1:] < 0
    counts, total = flipped.sum(axis=1), float(differences.sum())
    sums = flipped @ differences
    means = np.sort(np.concatenate([sums / counts, (total - sums) / (len(differences) - counts)]))
    # A true difference is not rejected if its p, which is (1 + means beyond it) / patterns, reaches the level.
    beyond = math.ceil((1.0 - confidence) * len(signs) * (1.0 - ROUNDING)) - 1
    return (float(means[beyond - 1]), float(means[-beyond])) if beyond > 0 else (-math.inf, math.inf)
