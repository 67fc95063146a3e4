"""How many participants an experiment needs, by simulating it: the same test as the analysis, on many made-up studies.

The differences of made-up participants come from those of a pilot study, drawn again with replacement (the part between
participants and the part between trials apart: Carpenter, Goldstein and Rasbash, Applied Statistics 52 (2003) 431–443),
or from bell curves of given standard deviations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from das.domain.errors import DasError
from sim.experiment.analysis.pairs import PairedTrials, TwoGroups
from sim.experiment.analysis.reading import Floats
from sim.experiment.analysis.resampling import (
    group_probabilities_at_once,
    probabilities_at_once,
    weights,
)
from sim.experiment.analysis.spread import as_table, components
from sim.experiment.plan import LEAST_PARTICIPANTS

STUDIES: Final = 2000
"""Made-up studies for each number of participants: a power of 0.8 is known to ±0.02 (95 %)."""
RESAMPLES: Final = 999
MOST_PARTICIPANTS: Final = 2000
"""No experiment with more participants is looked for."""
FEWEST: Final = LEAST_PARTICIPANTS
AT_ONCE: Final = 250
"""Studies computed at once, so that memory stays below about 100 MB."""


class MadeUpDifferences(Protocol):
    """Where the differences of made-up participants come from; their true mean is 0.

    With `groups` each participant drives one of two conditions. What is drawn are then their values, those of the first
    group before those of the second.
    """

    @property
    def groups(self) -> bool:
        """Whether participants are in two groups."""
        ...

    def draw(self, studies: int, participants: int, rng: np.random.Generator) -> Floats:
        """Mean difference of each made-up participant, (studies, participants)."""
        ...


@dataclass(frozen=True, kw_only=True)
class BellCurves:
    """Differences from bell curves: between participants, and between the pairs (or trials) of one participant."""

    between_sd: float
    within_sd: float = 0.0
    pairs: int = 1
    groups: bool = False

    def draw(self, studies: int, participants: int, rng: np.random.Generator) -> Floats:
        """Mean difference of each made-up participant, (studies, participants)."""
        sd = math.hypot(self.between_sd, self.within_sd / math.sqrt(self.pairs))
        return rng.normal(0.0, sd, (studies, participants))


@dataclass(frozen=True, kw_only=True)
class PilotDifferences:
    """Differences of a pilot's participants, drawn again: `between` one each, `within` those of their single pairs.

    Both have mean 0 and the estimated standard deviation of their part. `within` is empty where each participant of the
    pilot drove one pair: `between` then has the differences as they are.
    """

    between: Floats
    within: Floats
    pairs: int
    groups: bool = False

    def draw(self, studies: int, participants: int, rng: np.random.Generator) -> Floats:
        """Mean difference of each made-up participant, (studies, participants)."""
        drawn = self.between[rng.integers(0, len(self.between), (studies, participants))]
        if len(self.within):
            # Means of resampled pairs, as many as each participant drives.
            for _ in range(self.pairs):
                drawn = drawn + self.within[rng.integers(0, len(self.within), drawn.shape)] / self.pairs
        return np.asarray(drawn)


@dataclass(frozen=True, kw_only=True)
class PilotGroups:
    """The values of a pilot's participants of two groups, drawn again: each group's have mean 0."""

    a: Floats
    b: Floats
    groups: bool = True

    def draw(self, studies: int, participants: int, rng: np.random.Generator) -> Floats:
        """Value of each made-up participant, (studies, participants): the first half of them are of group a."""
        each = participants // 2
        drawn = [one[rng.integers(0, len(one), (studies, each))] for one in (self.a, self.b)]
        return np.concatenate(drawn, axis=1)


def of_pilot_groups(groups: TwoGroups) -> PilotGroups:
    """The participants of a pilot's two groups, each with as many trials as in the pilot."""
    for values in (groups.a, groups.b):
        if len(values) < 3:
            raise DasError(
                f"a pilot with {len(values)} participants in a group cannot tell how far participants differ: expected "
                "3 or more"
            )
    a, b = ((one - one.mean()) * math.sqrt(len(one) / (len(one) - 1)) for one in (groups.a, groups.b))
    return PilotGroups(a=a, b=b)


def of_pilot(pairs: PairedTrials, pairs_each: int | None) -> PilotDifferences:
    """The differences of a pilot for participants who drive `pairs_each` pairs (None: as many as in the pilot)."""
    differences, count = pairs.differences, len(pairs.participants)
    if count < 3:
        raise DasError(f"a pilot of {count} participants cannot tell how far participants differ: expected 3 or more")
    means = pairs.by_participant(differences)
    usual = max(round(len(pairs.owner) / count), 1)
    centred = means - means.mean()
    if len(pairs.owner) == count:
        if pairs_each not in (None, 1):
            raise DasError("--pairs: the pilot has one pair for each participant, so the spread of pairs is not known")
        return PilotDifferences(between=centred * math.sqrt(count / (count - 1)), within=np.zeros(0), pairs=1)
    table, shared = as_table(differences, np.array([str(one) for one in pairs.owner]), pairs.cell)
    between_sd, within_sd = (float(one[0]) for one in components(table[None], table.shape[1] - 1 if shared else 0))
    rest = differences - means[pairs.owner]
    return PilotDifferences(
        between=_scaled(centred, between_sd), within=_scaled(rest, within_sd), pairs=pairs_each or usual
    )


def _scaled(values: Floats, sd: float) -> Floats:
    """Values of mean 0 with this standard deviation; all 0 where they have no spread."""
    found = float(values.std())
    return values * (sd / found) if found > 0 else np.zeros_like(values)


@dataclass(frozen=True, kw_only=True)
class PowerQuestion:
    """What is asked: the true difference to be found, the level of the test, and what draws the made-up studies."""

    effect: float
    alpha: float
    source: MadeUpDifferences
    seed: int = 0
    studies: int = STUDIES


@dataclass(frozen=True, kw_only=True)
class PowerPoint:
    """The share of made-up studies with this many participants that find the difference, with its 95 % interval."""

    participants: int
    power: float
    interval: tuple[float, float]


def power_of(question: PowerQuestion, participants: int) -> PowerPoint:
    """The power of an experiment with this many participants (at least `FEWEST`), in each group where there are two."""
    if not FEWEST <= participants <= MOST_PARTICIPANTS:
        raise DasError(f"{participants} participants: expected {FEWEST} to {MOST_PARTICIPANTS}")
    rng = np.random.default_rng([question.seed, participants])
    groups = 2 if question.source.groups else 1
    drawn = [weights(participants, RESAMPLES, rng) for _ in range(groups)]
    found = 0
    for start in range(0, question.studies, AT_ONCE):
        count = min(AT_ONCE, question.studies - start)
        values = question.source.draw(count, groups * participants, rng)
        values[:, :participants] += question.effect
        if question.source.groups:
            both = (values[:, :participants], values[:, participants:])
            chances = group_probabilities_at_once(both, (drawn[0], drawn[1]))
        else:
            chances = probabilities_at_once(values, drawn[0])
        found += int(np.sum(chances < question.alpha))
    return PowerPoint(
        participants=participants, power=found / question.studies, interval=share_interval(found, question.studies)
    )


def participants_needed(
    question: PowerQuestion, wanted: float, progress: Callable[[int], None] = lambda _: None
) -> int | None:
    """Fewest participants with which enough studies find the difference; None above `MOST_PARTICIPANTS`."""

    def enough(participants: int) -> bool:
        progress(participants)
        return power_of(question, participants).power >= wanted

    low, high = FEWEST - 1, FEWEST
    while not enough(high):
        if high == MOST_PARTICIPANTS:
            return None
        low, high = high, min(2 * high, MOST_PARTICIPANTS)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def share_interval(found: int, whole: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share (Journal of the American Statistical Association 22 (1927) 209–212)."""
    z = 1.959964
    share, wide = found / whole, z * z / whole
    centre = (share + wide / 2) / (1 + wide)
    reach = z * math.sqrt(share * (1 - share) / whole + wide / (4 * whole)) / (1 + wide)
    return centre - reach, centre + reach


def normal_power(size: float, participants: int, alpha: float, *, groups: bool = False) -> float:
    """Power of a t test on bell curves, for an effect in standard deviations between participants.

    The test is paired, or with `groups` of two groups of so many participants each. The distribution is the noncentral
    t (Cohen, Statistical Power Analysis, 1988, chapter 2).
    """
    from scipy import stats

    freedom = 2 * (participants - 1) if groups else participants - 1
    edge = float(stats.t.ppf(1 - alpha / 2, freedom))
    centre = abs(size) * math.sqrt(participants / 2 if groups else participants)
    return float(stats.nct.sf(edge, freedom, centre) + stats.nct.cdf(-edge, freedom, centre))


def normal_participants(size: float, alpha: float, wanted: float, *, groups: bool = False) -> int | None:
    """Fewest participants for a wanted power of a t test on bell curves, in each group where there are two.

    None stands for more than a million.
    """
    from scipy import stats

    if not abs(size) > 0:
        return None
    z = float(stats.norm.ppf(1 - alpha / 2) + stats.norm.ppf(wanted))
    guess = (2 if groups else 1) * (z / abs(size)) ** 2
    if not guess < 1e6:
        return None
    participants = max(math.floor(guess) - 2, 3)
    while normal_power(size, participants, alpha, groups=groups) < wanted:
        participants += 1
    return participants


def smallest(values: Sequence[int | None]) -> int | None:
    """The smallest of some numbers of participants, None standing for more than can be said."""
    return min((one for one in values if one is not None), default=None)
