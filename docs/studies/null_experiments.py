"""False positive rate of an experiment's analysis, on generated differences of drivers without an effect.

`python -m docs.studies.null_experiments` prints the table of docs/explanation/experiment-statistics.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from scipy import stats

from sim.experiment.analysis.comparing import ALL_PATTERNS, Floats, probabilities, signs_of

ALPHA: Final = 0.05
SIZES: Final = (8, 12, 24)
STUDIES: Final = 2000
REPEATS: Final = 10
"""Number of sets of `STUDIES` experiments; the table gives the share over all sets, and the lowest and highest."""
PATTERNS: Final = 2048
"""Largest number of sign patterns. The test has its nominal error rate with any number, so few are sufficient."""
AT_ONCE: Final = 250
Draw = Callable[[np.random.Generator, tuple[int, int]], Floats]


def _skewed(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
    return rng.gamma(4.0, size=shape) - 4.0


def _exponential(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
    return rng.exponential(size=shape) - 1.0


def _same_twice(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
    """Difference between two values of a driver, with very skewed values and a spread that differs between drivers."""
    return rng.gamma(3.0, size=shape) * (rng.lognormal(0.0, 0.8, shape) - rng.lognormal(0.0, 0.8, shape))


NULLS: Final[dict[str, Draw]] = {
    "bell curve": lambda rng, shape: rng.normal(size=shape),
    "skewed (gamma, skewness 1)": _skewed,
    "one condition under two names, drivers and trials very skewed": _same_twice,
    "very skewed (exponential, skewness 2): beyond what the test assumes": _exponential,
}
"""Differences of drivers whose mean is 0."""


def false_alarms(
    draw: Draw, drivers: int, seed: int, studies: int = STUDIES, patterns: int = ALL_PATTERNS
) -> tuple[float, float]:
    """The shares of generated experiments in which sign flips, and Student's t, find a difference."""
    rng = np.random.default_rng([seed, drivers])
    values = draw(rng, (studies, drivers))
    signs = signs_of(drivers, rng, patterns)
    blocks = np.split(values, range(AT_ONCE, studies, AT_ONCE))
    flips = np.concatenate([probabilities(block, signs) for block in blocks])
    student = stats.ttest_1samp(values, 0.0, axis=1).pvalue
    return float(np.mean(flips < ALPHA)), float(np.mean(student < ALPHA))


def null_table() -> Iterator[str]:
    """The lines of the table, in Markdown."""
    flips = f"sign flips (lowest to highest of {REPEATS} times {STUDIES})"
    yield f"| differences of drivers | drivers | {flips} | Student's t |"
    yield "|---|---:|---:|---:|"
    for name, draw in NULLS.items():
        for drivers in SIZES:
            found = 100.0 * np.array([false_alarms(draw, drivers, seed, patterns=PATTERNS) for seed in range(REPEATS)])
            (mean, student), low, high = found.mean(axis=0), found[:, 0].min(), found[:, 0].max()
            yield f"| {name} | {drivers} | {mean:.1f} % ({low:.1f} to {high:.1f}) | {student:.1f} % |"


if __name__ == "__main__":
    for row in null_table():
        print(row)
