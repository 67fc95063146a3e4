"""How many participants an experiment needs, by simulating it: the same test as the analysis, on many made-up studies.

The differences of made-up participants come from the differences of a pilot study, drawn again with replacement
(separately between participants and between trials: Carpenter, Goldstein and Rasbash, Applied Statistics 52 (2003)
431–443), or from bell curves of given standard deviations. `answer` is what `das-sim experiment power` does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from das.domain.files.reading import Fields
from sim.experiment.analysis import sign_flips
from sim.experiment.analysis.differences import PairedTrials, TwoGroups, compared_trials
from sim.experiment.analysis.reading import Floats, RunStudy, ShownMeasure, read_study
from sim.experiment.analysis.spread import as_table, components
from sim.experiment.plan import DEFAULT_ALPHA, LEAST_PARTICIPANTS, PlannedComparison, StudyPlan, plan_of, read_plan
from sim.options import PowerAsked

STUDIES: Final = 2000
"""Made-up studies for each number of participants: a power of 0.8 is known to ±0.02 (95 %)."""
PATTERNS_EACH: Final = 1024
"""Patterns of signs for the test of each made-up study."""
MOST_ROWS: Final = 50
"""Most numbers of participants for which the power is given."""
MOST_PARTICIPANTS: Final = 2000
"""Largest number of participants (in each group) for which experiments are simulated."""
AT_ONCE: Final = 250
"""Studies computed at once, so that memory stays below about 100 MB."""


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
    """Differences of a pilot's participants, drawn again: `between` has one for each, `within` one for each pair.

    Both have mean 0 and the estimated standard deviation of their part. `within` is empty if each participant of the
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
    """The values of a pilot's participants of two groups, drawn again: those of each group have mean 0."""

    a: Floats
    b: Floats
    groups: bool = True

    def draw(self, studies: int, participants: int, rng: np.random.Generator) -> Floats:
        """Value of each made-up participant, (studies, participants): the first half of them are of group a."""
        each = participants // 2
        drawn = [one[rng.integers(0, len(one), (studies, each))] for one in (self.a, self.b)]
        return np.concatenate(drawn, axis=1)


MadeUpDifferences = BellCurves | PilotDifferences | PilotGroups
"""Sources of the differences of made-up participants; their true mean is 0. With `groups` each participant drives one
of two conditions. `draw` then gives their values, the first group before the second."""


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
    means = pairs.means
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
    """Values of mean 0 with this standard deviation; all 0 if they have no spread."""
    found = float(values.std())
    return values * (sd / found) if found > 0 else np.zeros_like(values)


@dataclass(frozen=True, kw_only=True)
class PowerQuestion:
    """What is asked: the true difference to be found, the level of the test, and the source of made-up studies."""

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
    """The power of an experiment with this many participants, in each group if there are two."""
    if not LEAST_PARTICIPANTS <= participants <= MOST_PARTICIPANTS:
        raise DasError(f"{participants} participants: expected {LEAST_PARTICIPANTS} to {MOST_PARTICIPANTS}")
    rng = np.random.default_rng([question.seed, participants])
    signs = sign_flips.signs_of(participants, rng, PATTERNS_EACH)
    found = 0
    for start in range(0, question.studies, AT_ONCE):
        count = min(AT_ONCE, question.studies - start)
        values = question.source.draw(count, (2 if question.source.groups else 1) * participants, rng)
        values[:, :participants] += question.effect
        found += int(np.sum(_chances(values, signs, question.source.groups) < question.alpha))
    return PowerPoint(
        participants=participants, power=found / question.studies, interval=share_interval(found, question.studies)
    )


def _chances(values: Floats, signs: Floats, groups: bool) -> Floats:
    """The p of each study, (studies,), by the method that decides in an analysis."""
    from scipy import stats

    if not groups:
        return sign_flips.probabilities(values, signs)
    a, b = np.split(values, 2, axis=1)
    return np.asarray(stats.ttest_ind(a, b, axis=1, equal_var=False).pvalue)


def participants_needed(question: PowerQuestion, wanted: float) -> int | None:
    """Fewest participants with which enough studies find the difference; None above `MOST_PARTICIPANTS`."""

    def enough(participants: int) -> bool:
        return power_of(question, participants).power >= wanted

    low, high = LEAST_PARTICIPANTS - 1, LEAST_PARTICIPANTS
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

    The test is paired or, with `groups`, compares two groups of this many participants each. The distribution is the
    noncentral t (Cohen, Statistical Power Analysis, 1988, chapter 2).
    """
    from scipy import stats

    freedom = 2 * (participants - 1) if groups else participants - 1
    edge = float(stats.t.ppf(1 - alpha / 2, freedom))
    centre = abs(size) * math.sqrt(participants / 2 if groups else participants)
    return float(stats.nct.sf(edge, freedom, centre) + stats.nct.cdf(-edge, freedom, centre))


def normal_participants(size: float, alpha: float, wanted: float, *, groups: bool = False) -> int | None:
    """Fewest participants for a wanted power of a t test on bell curves, in each group if there are two.

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


@dataclass(frozen=True, kw_only=True)
class PowerAnswer:
    """The power for each number of participants, alone and with corrected p, and how many are needed.

    `strict` and `needed_strict` are empty and None if only one comparison is planned, or p is not corrected.
    """

    about: str
    groups: bool
    points: tuple[PowerPoint, ...]
    strict: tuple[PowerPoint, ...]
    wanted: float
    needed: int | None
    needed_strict: int | None

    @property
    def sentences(self) -> list[str]:
        """How many participants are needed, in words."""

        def many(count: int | None) -> str:
            return f"more than {MOST_PARTICIPANTS}" if count is None else str(count)

        who = "participants in each of the two groups" if self.groups else "participants"
        said = [f"For a power of {self.wanted:.0%}: {many(self.needed)} {who}."]
        if self.strict:
            said.append(f"With p corrected for the planned comparisons: {many(self.needed_strict)} {who}.")
        return said

    def as_dict(self) -> dict[str, Any]:
        """The answer for programs."""
        return {
            "about": self.about,
            "participants_are": "in each of two groups" if self.groups else "all",
            "power": [vars(one) for one in self.points],
            "power_corrected": [vars(one) for one in self.strict] or None,
            "wanted_power": self.wanted,
            "participants_needed": self.needed,
            "participants_needed_corrected": self.needed_strict,
        }


def answer(asked: PowerAsked) -> PowerAnswer:
    """Simulate the experiments that were asked for; DasError if something that is needed is missing."""
    numbers = _counts(asked.participants)
    _check(asked)
    plan, study = _source(asked.source)
    source, effect, about = _made_up(asked, plan, study)
    alpha = asked.alpha if asked.alpha is not None else (plan.alpha if plan else DEFAULT_ALPHA)
    question = PowerQuestion(effect=effect, alpha=alpha, source=source, seed=asked.seed)
    count = 1 if plan is None or plan.correction == "none" else len(plan.comparisons)
    strict = replace(question, alpha=alpha / max(count, 1))  # the first step of Holm, and every step of Bonferroni
    return PowerAnswer(
        about=about,
        groups=source.groups,
        points=tuple(power_of(question, number) for number in numbers),
        strict=tuple(power_of(strict, number) for number in numbers) if count > 1 else (),
        wanted=asked.wanted,
        needed=participants_needed(question, asked.wanted),
        needed_strict=participants_needed(strict, asked.wanted) if count > 1 else None,
    )


def _check(asked: PowerAsked) -> None:
    for option, value in (("--power", asked.wanted), ("--alpha", asked.alpha)):
        if value is not None and not 0.0 < value < 1.0:
            raise DasError(f"{option} {value:g}: expected a number between 0 and 1")
    if asked.sd is not None and not (math.isfinite(asked.sd) and asked.sd > 0):
        raise DasError(f"--sd {asked.sd:g}: expected a number above 0")
    if asked.sd_of_pairs is not None:
        if not (math.isfinite(asked.sd_of_pairs) and asked.sd_of_pairs >= 0):
            raise DasError(f"--sd-pairs {asked.sd_of_pairs:g}: expected a number of at least 0")
        if asked.sd is None:
            raise DasError("--sd-pairs: expected together with --sd; a pilot tells this spread itself")
    elif asked.sd is not None and asked.pairs is not None:
        raise DasError(f"--pairs {asked.pairs}: expected together with --sd-pairs, the spread of pairs")
    if asked.groups and asked.sd is None:
        raise DasError("--groups: expected together with --sd; a pilot tells itself who drove what")


def _counts(text: str) -> list[int]:
    """The numbers of participants in a list with commas, in rising order."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) > MOST_ROWS or not all(part.isascii() and part.isdigit() and len(part) < 8 for part in parts):
        raise DasError(f"--participants {text}: expected at most {MOST_ROWS} whole numbers separated by commas")
    return sorted({int(part) for part in parts})


def _source(path: Path | None) -> tuple[StudyPlan | None, RunStudy | None]:
    """The plan of a design or of a study's folder, and the study of a folder; None for whichever is missing."""
    if path is None:
        return None, None
    if path.is_dir():
        study = read_study(path)
        return study.plan, study
    if path.suffix.lower() == ".json":
        return read_plan(path), None
    from sim.experiment.design import load_design, resolved

    return plan_of(Fields.of(path, resolved(load_design(str(path))))), None


def _made_up(asked: PowerAsked, plan: StudyPlan | None, study: RunStudy | None) -> tuple[MadeUpDifferences, float, str]:
    """The source of made-up differences, the true difference in the same unit, and a sentence about both."""
    if asked.sd is not None:
        groups, within_sd = _in_groups(asked, plan), asked.sd_of_pairs or 0.0
        curves = BellCurves(between_sd=asked.sd, within_sd=within_sd, pairs=asked.pairs or 1, groups=groups)
        single = "trials" if groups else "pairs"
        among = f" and {within_sd:g} between the {single} of one" if within_sd else ""
        among += ", who drive one of two conditions each" if groups else ""
        about = f"bell curves with a standard deviation of {asked.sd:g} between participants{among}"
        return curves, asked.effect, f"True difference {asked.effect:g}; {about}."
    if plan is None or study is None:
        raise DasError("--sd: expected the standard deviation between participants, or the folder of a pilot study")
    comparison = plan.chosen(asked.comparison)
    return _of_study(asked, study, comparison)


def _in_groups(asked: PowerAsked, plan: StudyPlan | None) -> bool:
    """Whether each participant drives one of two conditions: as a design's comparison says, without one as the user."""
    if plan is None or not plan.comparisons:
        if asked.comparison is not None:
            raise DasError(f"--comparison {asked.comparison}: expected a pilot or a design that plans it")
        return asked.groups
    chosen = plan.chosen(asked.comparison)
    within = plan.factor(chosen.factor).within
    if asked.groups and within:
        raise DasError(f"--groups: each participant drives both conditions of {chosen.name}; expected none beside it")
    return not within


def _of_study(
    asked: PowerAsked, study: RunStudy, comparison: PlannedComparison
) -> tuple[MadeUpDifferences, float, str]:
    measure = comparison.measure
    shown = ShownMeasure.of(measure, study.meanings[measure], study.trials.values[measure])
    trials = compared_trials(study, comparison)
    if isinstance(trials, TwoGroups):
        if asked.pairs is not None:
            raise DasError(
                f"--pairs: comparison {comparison.name} is one of two groups, whose participants make no pairs; "
                "expected no number, because each participant drives as many trials as in the pilot"
            )
        source: MadeUpDifferences = of_pilot_groups(trials)
        falls = bool(trials.a.mean() < trials.b.mean())
        drawn = (
            f"two groups: {len(trials.a)} participants of the pilot with {comparison.a} and "
            f"{len(trials.b)} with {comparison.b} are drawn again, each with as many trials as there."
        )
    else:
        pilot = of_pilot(trials, asked.pairs)
        source, falls = pilot, bool(trials.differences.mean() < 0)
        drawn = (
            f"{len(trials.participants)} participants of the pilot are drawn again, each with {pilot.pairs} "
            f"{'pair' if pilot.pairs == 1 else 'pairs'} of trials."
        )
    about = (
        f"True difference {asked.effect:g} {shown.difference_unit} of {shown.name} in the pilot's direction "
        f"({comparison.name}); {drawn}"
    )
    # Differences may be skewed: power depends on their sign.
    return source, (-1.0 if falls else 1.0) * asked.effect / shown.factor, about
