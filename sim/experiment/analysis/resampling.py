"""Drawing the participants of a study again, with replacement: the interval of a mean without a bell curve.

The method is the studentized bootstrap (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, section 12.5).
Each resample gives the distance of its mean from that of the study in standard errors of its own, and the quantiles
of that distance take the place of those of Student's t. Participants are drawn, not trials, because trials of one
person are no independent witnesses. All functions work on many studies at once: one row for each study, one column for
each participant.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from sim.experiment.analysis.reading import Floats

RESAMPLES: Final = 19_999
"""Resamples of an analysis: a probability of 0.05 is known to 0.003, and the smallest is 0.0001."""
LEAST_RESAMPLES: Final = 999
MOST_CELLS: Final = 20_000_000
"""Most numbers of a table of resamples by participants (160 MB); with very many participants fewer resamples do."""


def weights(participants: int, resamples: int, rng: np.random.Generator) -> Floats:
    """How often each resample draws each participant, (resamples, participants); see `MOST_CELLS`."""
    resamples = min(resamples, max(MOST_CELLS // participants, LEAST_RESAMPLES))
    even = np.full(participants, 1.0 / participants)
    return rng.multinomial(participants, even, size=resamples).astype(np.float64)


def standard_errors(values: Floats) -> Floats:
    """Standard error of each study's mean, (studies,); NaN for one participant."""
    count = values.shape[1]
    if count < 2:
        return np.full(len(values), np.nan)
    return np.asarray(values.std(axis=1, ddof=1) / np.sqrt(count))


def resampled_moments(values: Floats, drawn: Floats) -> tuple[Floats, Floats]:
    """Mean less the study's mean, and standard error, of every resample, each (studies, resamples)."""
    count = values.shape[1]
    centred = values - values.mean(axis=1, keepdims=True)
    means = centred @ drawn.T / count
    squares = centred**2 @ drawn.T / count
    variance = np.maximum(squares - means**2, 0.0) * (count / (count - 1))
    return means, np.sqrt(variance / count)


def studentized(means: Floats, errors: Floats) -> Floats:
    """Distances in own standard errors; a resample without spread is infinitely far off, or 0 at the very mean."""
    tiny = 1e-12 * np.maximum(np.abs(means).max(axis=-1, keepdims=True), 1e-300)
    without_spread = np.where(np.abs(means) > tiny, np.copysign(np.inf, means), 0.0)
    return np.where(errors > tiny, means / np.maximum(errors, tiny), without_spread)


def probabilities(means: Floats, errors: Floats, distances: Floats) -> Floats:
    """Two-sided probability of a mean at least this far from 0 where the truth is 0, (studies,).

    It is below a level where, and only where, the interval of that level does not hold 0. A study without any spread
    has 1 for a mean of 0, and else NaN: nothing is known about chance there.
    """
    resamples = distances.shape[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        found = (means / errors)[:, None]
    above = (np.sum(distances >= found, axis=1) + 1) / (resamples + 1)
    below = (np.sum(distances <= found, axis=1) + 1) / (resamples + 1)
    both = np.minimum(2.0 * np.minimum(above, below), 1.0)
    return np.where(errors > 0, both, np.where(means == 0, 1.0, np.nan))


def group_probabilities_at_once(values: tuple[Floats, Floats], drawn: tuple[Floats, Floats]) -> Floats:
    """Two-sided probabilities (studies,) of differences of two groups, each (studies, participants), each resampled."""
    moments = [resampled_moments(one, weight) for one, weight in zip(values, drawn, strict=True)]
    (means_a, errors_a), (means_b, errors_b) = moments
    error = np.hypot(*(standard_errors(one) for one in values))
    found = values[0].mean(axis=1) - values[1].mean(axis=1)
    return probabilities(found, error, studentized(means_a - means_b, np.hypot(errors_a, errors_b)))


def probabilities_at_once(values: Floats, drawn: Floats) -> Floats:
    """Two-sided probabilities (studies,) of paired differences (studies, participants), with shared resamples."""
    means, errors = resampled_moments(values, drawn)
    return probabilities(values.mean(axis=1), standard_errors(values), studentized(means, errors))
