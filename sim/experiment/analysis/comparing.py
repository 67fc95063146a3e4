"""A study read from its folder, and its analysis: planned comparisons with intervals, and every condition.

A comparison has pairs, or two groups of participants. A pair is two trials of one participant on one day under two
conditions; its difference is one value minus the other. An estimate has the mean, its interval, its p value, and its
size in standard deviations. One method decides on significance: sign flips for pairs, Welch's t for
groups. For pairs, Student's t is a second opinion.

Sign flips (R. A. Fisher, The Design of Experiments, 1935, § 21): if the two conditions are equivalent, a driver's
difference might as well have had the other sign. Every pattern of signs is then equally probable, and p is the share of
patterns whose mean is at least as far from 0 as the observed mean. With few drivers all patterns are counted, and p is
exact; with many, patterns are drawn at random. The interval contains each true difference that the same test does not
reject. The mean of a pattern that flips some drivers is as far from 0 as the observed mean exactly if the mean of these
drivers is on the other side of the true difference, so that the bounds are means of drivers (J. Hartigan, Journal of
the American Statistical Association 64 (1969) 1303–1317).
"""

from __future__ import annotations

import csv
import io
import math
import zlib
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.reading import read_text
from das.domain.units import kmh
from sim.drivers.kinds import DESK
from sim.experiment.design import Design, PlannedComparison, as_text, read_frozen
from sim.experiment.measures import MEASURES, UNIT_OF
from sim.experiment.study_files import FAILED_TABLE, PEOPLE_FOLDER, TRIALS_TABLE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Texts = NDArray[np.str_]

NAMED: Final = ("trial", "participant", "position", "practice", "seed")
"""Columns that the table of trials must have in addition to those of factors and measures."""
SHOWN_UNITS: Final = {"1": "times", "m/s": "km/h", "1/min": "per minute"}
"""The names of units in the report, if different from the unit; a ratio is shown in percent."""
SAME: Final = "the same"
PERCENT: Final = 100.0


@dataclass(frozen=True, kw_only=True)
class ShownMeasure:
    """The format of a measure in the report: values times `factor`, in `unit`; differences are in `difference_unit`.

    A ratio is shown in percent, a difference in points. `digits` is the number of digits after the decimal point.
    """

    column: str
    name: str
    text: str
    unit: str
    difference_unit: str
    factor: float
    digits: int

    @classmethod
    def of(cls, column: str, values: Floats) -> ShownMeasure:
        """The format of a column: for a measure of this program by its definition, else by the unit in its name.

        The spread of the values determines the number of digits.
        """
        known = MEASURES.get(column)
        plain, _, suffix = column.rpartition("_")
        unit = UNIT_OF.get(suffix, suffix) if known is None else known.unit
        ratio = unit == "1" and column.endswith("_ratio")
        shown = SHOWN_UNITS.get(unit, unit)
        factor = PERCENT if ratio else float(kmh(1.0)) if unit == "m/s" else 1.0
        finite = values[np.isfinite(values)]
        spread = factor * float(finite.std()) if len(finite) else 0.0
        digits = 2 if spread == 0 else min(max(2 - math.floor(math.log10(spread)), 0), 4)
        return cls(
            column=column, name=(plain or suffix).replace("_", " ") if known is None else known.title,
            text="" if known is None else f"{known.formula} ({known.source})", unit="%" if ratio else shown,
            difference_unit="points" if ratio else shown, factor=factor, digits=digits,
        )  # fmt: skip

    def value(self, value: float) -> str:
        """A value without its unit; empty for NaN."""
        return self.difference(value).lstrip("+")

    def difference(self, value: float) -> str:
        """A difference with its sign, without its unit; empty for NaN."""
        if not math.isfinite(value):
            return ""
        rounded = round(self.factor * value, self.digits)
        return f"{rounded:+.{self.digits}f}".replace("-", "−") if rounded else f"{0:.{self.digits}f}"

    def range(self, interval: tuple[float, float]) -> str:
        """An interval of differences, without unit; empty for an unknown interval."""
        return f"{self.difference(interval[0])} to {self.difference(interval[1])}" if math.isfinite(interval[0]) else ""

    def changed(self, difference: float) -> str:
        """A difference in words: `2.1 points lower`, or `SAME` if it is too small for the printed digits."""
        if float(self.value(abs(difference))) == 0:
            return SAME
        return f"{self.with_unit(difference)} {'lower' if difference < 0 else 'higher'}"

    def with_unit(self, value: float) -> str:
        """A difference without sign, with its unit."""
        return f"{self.value(abs(value))} {self.difference_unit}"


def probability(value: float) -> str:
    """A probability as printed; empty for NaN."""
    if not math.isfinite(value):
        return ""
    return "below 0.001" if value < 0.001 else f"{value:.3f}"


@dataclass(frozen=True, kw_only=True)
class FinishedTrials:
    """The trials of a study, including practice: each array has one entry for each trial.

    `levels` has the level of each factor as text. `values` has the measures in the units of their columns; NaN for
    a missing value. `position` counts the trials of one participant.
    """

    participant: Texts
    position: Ints
    practice: Bools
    day: Texts
    levels: Mapping[str, Texts]
    values: Mapping[str, Floats]

    def __len__(self) -> int:
        return len(self.participant)


@dataclass(frozen=True, kw_only=True)
class RunStudy:
    """A completed study: its folder, its frozen design, and its trials.

    `failed` has a sentence for each failed trial: its driver, its condition and the reason. `parts` has the studies
    that were joined, by their level of the factor `driver`; it is empty for a study that was run.
    """

    folder: Path
    design: Design
    trials: FinishedTrials
    failed: tuple[str, ...] = ()
    parts: Mapping[str, RunStudy] = field(default_factory=dict)

    def chosen(self, comparison: PlannedComparison) -> Bools:
        """The mask of the trials of a comparison: not practice, at its levels, and with a value of its measure."""
        trials = self.trials
        kept = ~trials.practice & np.isfinite(trials.values[comparison.measure])
        kept &= np.isin(trials.levels[comparison.factor], (comparison.a, comparison.b))
        for name, level in comparison.where.items():
            kept &= trials.levels[name] == level
        return kept

    def shown(self, measure: str) -> ShownMeasure:
        """The format of a measure."""
        return ShownMeasure.of(measure, self.trials.values[measure])

    @property
    def driven(self) -> Ints:
        """The indices of all trials without practice."""
        return np.flatnonzero(~self.trials.practice)

    @property
    def with_people(self) -> bool:
        """Whether people drove at the desk, instead of simulated drivers."""
        driver = self.design.fixed.get("driver")
        return (driver is not None and driver.text == DESK) or (self.folder / PEOPLE_FOLDER).is_dir()

    @property
    def planned(self) -> Counter[tuple[str, str]]:
        """The number of planned trials without practice, by participant and condition."""
        if not self.parts:
            return self.design.planned
        planned = ((level, one) for level, study in self.parts.items() for one in study.planned.items())
        return Counter({(f"{level} {who}", f"{level} {which}"): count for level, ((who, which), count) in planned})

    @property
    def missing(self) -> Counter[tuple[str, str]]:
        """The number of planned trials that are not finished, by participant and condition."""
        names = self.trials.participant[self.driven].tolist()
        return self.planned - Counter(zip(names, self.conditions(self.driven).tolist(), strict=True))

    def conditions(self, rows: Ints, without: str = "") -> Texts:
        """The condition of each trial of `rows` as one text: the levels of all factors except `without`."""
        levels = [self.trials.levels[one.name] for one in self.design.factors if one.name != without]
        return np.array([" ".join(str(one[row]) for one in levels) for row in rows], dtype=np.str_)


def read_study(folder: Path) -> RunStudy:
    """Read `design.json`, `trials.csv` and, if any, `failed.csv` in a study's folder; DasError for unusable files."""
    if not folder.is_dir():
        raise DasError(f"{folder}: expected the folder of a study that was run")
    design = read_frozen(folder)
    return RunStudy(
        folder=folder,
        design=design,
        trials=_trials(folder / TRIALS_TABLE, design),
        failed=_failed(folder / FAILED_TABLE),
    )


def _failed(path: Path) -> tuple[str, ...]:
    """A sentence for each failed trial; none if there is no such file."""
    if not path.is_file():
        return ()
    rows = csv.DictReader(io.StringIO(read_text(path)))
    return tuple(f"{row.get('participant')} with {row.get('condition')}: {row.get('error')}" for row in rows)


def _trials(path: Path, design: Design) -> FinishedTrials:
    reader = csv.reader(io.StringIO(read_text(path)))
    header = next(reader, [])
    wanted = [*NAMED, *(one.name for one in design.factors), *design.measures]
    for name in wanted:
        if name not in header:
            raise InputError(path, f"column {name}", MISSING, f"a column of this name among {', '.join(header)}")
        if header.count(name) > 1:
            raise InputError(path, f"column {name}", header.count(name), "one column of this name")
    rows: list[list[str]] = []
    for row in reader:
        if row and len(row) != len(header):
            raise InputError(path, f"line {reader.line_num}", len(row), f"{len(header)} values")
        if row:
            rows.append(row)
    cells = {name: [row[header.index(name)] for row in rows] for name in wanted}
    trials = FinishedTrials(
        participant=np.array(cells["participant"], dtype=np.str_),
        position=_whole(path, "position", cells["position"]),
        practice=_whole(path, "practice", cells["practice"], most=1) == 1,
        day=np.array([as_text(one) for one in cells["seed"]], dtype=np.str_),
        levels={one.name: _levels(path, one.name, cells[one.name], one.texts) for one in design.factors},
        values={name: _numbers(path, name, cells[name]) for name in design.measures},
    )
    if not len(trials) or trials.practice.all():
        raise DasError(f"{path}: no finished trial that is not practice, so there is nothing to analyse")
    _check_once(path, cells["trial"])
    return trials


def _check_once(path: Path, trials: list[str]) -> None:
    """Raise InputError if two rows have the same trial."""
    seen: set[str] = set()
    for line, trial in enumerate(trials, start=2):
        if trial in seen:
            raise InputError(path, f"line {line}, trial", trial, "each trial once")
        seen.add(trial)


def _whole(path: Path, name: str, texts: list[str], most: int = 1_000_000) -> Ints:
    for line, text in enumerate(texts, start=2):
        if not (text.isascii() and text.isdigit() and int(text) <= most):
            raise InputError(path, f"line {line}, {name}", text, f"a whole number from 0 to {most}")
    return np.array([int(text) for text in texts], dtype=np.int64)


def _levels(path: Path, name: str, texts: list[str], levels: tuple[str, ...]) -> Texts:
    found = [as_text(text) for text in texts]
    for line, level in enumerate(found, start=2):
        if level not in levels:
            raise InputError(path, f"line {line}, {name}", level, f"one of the design's levels {', '.join(levels)}")
    return np.array(found, dtype=np.str_)


def _numbers(path: Path, name: str, texts: list[str]) -> Floats:
    """A column of numbers; NaN for an empty cell and for the missing values of pandas and R."""
    values = np.full(len(texts), np.nan)
    for row, text in enumerate(texts):
        if text.strip().lower() in ("", "nan", "na", "n/a"):
            continue
        try:
            values[row] = float(text)
        except ValueError:
            values[row] = math.inf
        if not math.isfinite(values[row]):
            raise InputError(path, f"line {row + 2}, {name}", text, "a finite number, or nothing where it is missing")
    return values


MOST_EXACT: Final = 16
"""Largest number of drivers for which all patterns are counted."""
ALL_PATTERNS: Final = 2 ** (MOST_EXACT - 1)
PATTERNS: Final = 20_000
"""Number of patterns with more drivers, including the observed pattern: a p of 0.05 is known to 0.003."""
MOST_CELLS: Final = 20_000_000
"""Largest number of signs in a table of patterns (160 MB): very many drivers have fewer patterns, at least 1000."""
ROUNDING: Final = 1e-10
"""Share of the mean magnitude below which a difference of means counts as zero."""


def signs_of(drivers: int, rng: np.random.Generator, patterns: int = ALL_PATTERNS) -> Floats:
    """Patterns of signs (patterns, drivers); the pattern without flips is first.

    All patterns are returned if there are at most `patterns`, else that number drawn at random, but at most `PATTERNS`.
    A pattern represents its mirror image too, so that the first driver is never flipped.
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
    """Two-sided p of each study (studies, drivers): the probability of a mean at least this far from 0 by chance."""
    found = np.abs(differences.sum(axis=1, keepdims=True)) - ROUNDING * np.abs(differences).sum(axis=1, keepdims=True)
    return np.asarray((np.abs(differences @ signs.T) >= found).mean(axis=1))


def interval(differences: Floats, signs: Floats, confidence: float) -> tuple[float, float]:
    """The mean differences that the test does not reject at the level 1 − `confidence`; infinite for too few drivers.

    `differences` has a value for each driver, (drivers,).
    """
    flipped = signs[1:] < 0
    counts, total = flipped.sum(axis=1), float(differences.sum())
    sums = flipped @ differences
    means = np.sort(np.concatenate([sums / counts, (total - sums) / (len(differences) - counts)]))
    # A true difference is not rejected if its p, which is (1 + means beyond it) / patterns, reaches the level.
    beyond = math.ceil((1.0 - confidence) * len(signs) * (1.0 - ROUNDING)) - 1
    return (float(means[beyond - 1]), float(means[-beyond])) if beyond > 0 else (-math.inf, math.inf)


CONFIDENCE: Final = 0.95
FLIPS, SOME_FLIPS, WELCH = "exact sign flips", "sign flips drawn at random", "Welch's t"
"""The names of the methods that decide on significance."""
NO_RANGE: Final = (math.nan, math.nan)
LEAST_IN_GROUP: Final = 3
"""Smallest number of participants for an interval of their mean by Student's t, and for a group."""


@dataclass(frozen=True, kw_only=True)
class PairedTrials:
    """The pairs of a comparison between conditions that every participant drove.

    Each array has an entry for each pair: `owner` is the participant's index in `participants`, `differences` the value
    at level a minus the value at level b (means if a trial was driven twice). `unpaired` counts trials without a
    partner, which are left out. `same_day` is False if no two trials had the same day, so that pairs were made by
    participant alone.
    """

    participants: tuple[str, ...]
    owner: Ints
    differences: Floats
    unpaired: int
    same_day: bool

    @property
    def means(self) -> Floats:
        """Mean difference of each participant, (participants,)."""
        return np.asarray(np.bincount(self.owner, weights=self.differences) / np.bincount(self.owner))


@dataclass(frozen=True, kw_only=True)
class TwoGroups:
    """The means of the participants of two groups, for a factor with one level for each participant."""

    a: Floats
    b: Floats
    a_names: tuple[str, ...]
    b_names: tuple[str, ...]

    @property
    def by_driver(self) -> dict[str, dict[str, float]]:
        """The means of the participants of both groups, by name."""
        both = {"a": (self.a_names, self.a), "b": (self.b_names, self.b)}
        return {group: dict(zip(names, means.tolist(), strict=True)) for group, (names, means) in both.items()}


ComparedTrials = PairedTrials | TwoGroups


def compared_trials(study: RunStudy, comparison: PlannedComparison) -> ComparedTrials:
    """The pairs of a comparison, or the two groups if each participant drove one condition."""
    within = study.design.factor(comparison.factor).within
    return paired_trials(study, comparison) if within else two_groups(study, comparison)


def paired_trials(study: RunStudy, comparison: PlannedComparison) -> PairedTrials:
    """The pairs of a comparison; raises DasError if no participant drove both conditions."""
    same_day = _paired(study, comparison, with_day=True)
    found = same_day if len(same_day.owner) else _paired(study, comparison, with_day=False)
    if not len(found.owner):
        raise DasError(
            f"{study.folder}: comparison {comparison.name}: no participant has finished trials with both "
            f"{comparison.factor} = {comparison.a} and {comparison.b}"
        )
    return found


def _paired(study: RunStudy, comparison: PlannedComparison, *, with_day: bool) -> PairedTrials:
    trials, rows = study.trials, np.flatnonzero(study.chosen(comparison))
    level, values = trials.levels[comparison.factor], trials.values[comparison.measure]
    # By what the trials of a pair share: participant, day, and levels of other factors.
    cells: dict[tuple[str, str, str], dict[str, list[int]]] = defaultdict(lambda: {comparison.a: [], comparison.b: []})
    for row, others in zip(rows, study.conditions(rows, without=comparison.factor), strict=True):
        cell = str(trials.participant[row]), str(trials.day[row]) if with_day else "", str(others)
        cells[cell][str(level[row])].append(int(row))
    whole = {cell: (one[comparison.a], one[comparison.b]) for cell, one in sorted(cells.items()) if all(one.values())}
    names = tuple(sorted({who for who, _, _ in whole}))
    number = {name: index for index, name in enumerate(names)}
    return PairedTrials(
        participants=names,
        owner=np.array([number[who] for who, _, _ in whole], dtype=np.int64),
        differences=np.array([values[a].mean() - values[b].mean() for a, b in whole.values()]),
        unpaired=len(rows) - sum(len(a) + len(b) for a, b in whole.values()),
        same_day=with_day,
    )


def two_groups(study: RunStudy, comparison: PlannedComparison) -> TwoGroups:
    """The mean of each participant's trials, in two groups; DasError if a group is empty."""
    trials, kept = study.trials, study.chosen(comparison)
    found = {}
    for level in (comparison.a, comparison.b):
        mine = kept & (trials.levels[comparison.factor] == level)
        names = np.unique(trials.participant[mine])
        if not len(names):
            raise DasError(
                f"{study.folder}: comparison {comparison.name}: no finished trial with {comparison.factor} = {level}"
            )
        values = trials.values[comparison.measure]
        found[level] = (names, np.array([values[mine & (trials.participant == name)].mean() for name in names]))
    (a_names, a), (b_names, b) = found[comparison.a], found[comparison.b]
    return TwoGroups(a=a, b=b, a_names=tuple(map(str, a_names)), b_names=tuple(map(str, b_names)))


@dataclass(frozen=True, kw_only=True)
class DifferenceEstimate:
    """A mean difference between two conditions, in the unit of its measure.

    `interval` (95 %) and `probability` are by `method`, which decides; `t_interval` is by Student's t (Welch's t for
    two groups). `size` is the mean in standard deviations between participants (d_z for pairs, d for two groups).
    """

    mean: float
    sd: float
    participants: int
    interval: tuple[float, float] = NO_RANGE
    probability: float = math.nan
    t_interval: tuple[float, float] = NO_RANGE
    size: float = math.nan
    method: str

    @property
    def known(self) -> bool:
        """Whether the difference has an interval; False without any spread, or with too few participants."""
        return math.isfinite(self.interval[0])


def paired_estimate(differences: Floats, rng: np.random.Generator) -> DifferenceEstimate:
    """The mean of one difference for each participant (n,), with the interval and p of sign flips.

    With fewer than 6 participants there is no interval, because no pattern of signs is rare enough.
    """
    count, mean = len(differences), float(differences.mean())
    signs = signs_of(count, rng)
    method = FLIPS if count <= MOST_EXACT else SOME_FLIPS
    if _without_spread(differences):
        alike = count > 1
        same = 1.0 if alike and mean == 0 else math.nan  # Chance cannot be estimated if all differ by the same amount.
        sd = 0.0 if alike else math.nan
        return DifferenceEstimate(mean=mean, sd=sd, participants=count, probability=same, method=method)
    sd = float(differences.std(ddof=1))
    low, high = interval(differences, signs, CONFIDENCE)
    return DifferenceEstimate(
        mean=mean, sd=sd, participants=count, interval=(low, high) if math.isfinite(low) else NO_RANGE,
        probability=float(probabilities(differences[None], signs)[0]),
        t_interval=student(differences),
        size=mean / sd, method=method,
    )  # fmt: skip


def student(values: Floats) -> tuple[float, float]:
    """The 95 % interval of the mean of one value for each participant (n,), by Student's t; NaN for too few."""
    from scipy import stats

    if len(values) < LEAST_IN_GROUP or _without_spread(values):
        return NO_RANGE
    reach = stats.ttest_1samp(values, 0.0).confidence_interval(CONFIDENCE)
    return float(reach.low), float(reach.high)


def group_estimate(a: Floats, b: Floats) -> DifferenceEstimate:
    """The difference of the means of two groups of participants (a minus b), with the interval and p of Welch's t."""
    from scipy import stats

    mean, count = float(a.mean() - b.mean()), len(a) + len(b)
    few = min(len(a), len(b)) < LEAST_IN_GROUP
    if few or (_without_spread(a) and _without_spread(b)):
        sd = math.nan if few else 0.0
        return DifferenceEstimate(mean=mean, sd=sd, participants=count, method=WELCH)
    sd = math.sqrt(0.5 * (float(a.var(ddof=1)) + float(b.var(ddof=1))))
    test = stats.ttest_ind(a, b, equal_var=False)
    low, high = test.confidence_interval(CONFIDENCE)
    interval = (float(low), float(high))
    return DifferenceEstimate(
        mean=mean, sd=sd, participants=count, interval=interval, probability=float(test.pvalue), t_interval=interval,
        size=mean / sd, method=WELCH,
    )  # fmt: skip


def _without_spread(values: Floats) -> bool:
    """Whether all values are the same except for rounding."""
    return len(values) < 2 or float(np.ptp(values)) <= 1e-12 * max(float(np.abs(values).max()), 1e-300)


def corrected(probabilities: Floats, correction: str) -> Floats:
    """Probabilities corrected for the number of planned comparisons; NaN stays NaN, but counts as a comparison.

    `holm`: Holm, Scandinavian Journal of Statistics 6 (1979) 65–70. `bonferroni`: multiplied by the number of
    comparisons. `none`: unchanged.
    """
    if correction == "none" or not len(probabilities):
        return probabilities
    count = len(probabilities)
    raised = np.minimum(count * probabilities, 1.0)
    if correction == "holm":
        order = np.argsort(np.nan_to_num(probabilities, nan=1.0), kind="stable")
        steps = np.minimum((count - np.arange(count)) * np.nan_to_num(probabilities, nan=1.0)[order], 1.0)
        raised[order] = np.maximum.accumulate(steps)
    return np.where(np.isnan(probabilities), np.nan, raised)


@dataclass(frozen=True, kw_only=True)
class FoundDifference:
    """The findings on a planned comparison; `corrected` is p corrected for the number of comparisons."""

    comparison: PlannedComparison
    shown: ShownMeasure
    estimate: DifferenceEstimate
    corrected: float
    trials: ComparedTrials

    @property
    def pairs(self) -> PairedTrials | None:
        """The pairs; None if two groups were compared."""
        return self.trials if isinstance(self.trials, PairedTrials) else None

    @property
    def groups(self) -> TwoGroups | None:
        """The two groups; None if every participant drove both conditions."""
        return self.trials if isinstance(self.trials, TwoGroups) else None

    @property
    def title(self) -> str:
        """The name of the comparison; the measure and the contrast if the design gave it no name."""
        short = self.comparison.title
        return short if short == self.comparison.name else f"{self.shown.name}: {short}"

    @property
    def disagrees(self) -> bool:
        """Whether Student's t disagrees with sign flips, which decide: only one of the intervals contains 0."""
        estimate = self.estimate
        return estimate.known and _holds_0(estimate.interval) != _holds_0(estimate.t_interval)


def _holds_0(interval: tuple[float, float]) -> bool:
    return interval[0] <= 0.0 <= interval[1]


@dataclass(frozen=True, kw_only=True)
class ConditionValues:
    """A measure in one condition: the number of trials, and the mean of each participant, (participants,)."""

    condition: str
    measure: str
    trials: int
    means: Floats


@dataclass(frozen=True, kw_only=True)
class StudyFindings:
    """The findings of the analysis of a study; `failed` has each comparison that could not be made, with the reason."""

    study: RunStudy
    measures: tuple[ShownMeasure, ...]
    differences: tuple[FoundDifference, ...]
    failed: tuple[tuple[str, str], ...]
    conditions: tuple[ConditionValues, ...]


def analyse_study(study: RunStudy) -> StudyFindings:
    """Analyse every planned comparison of a study and describe every condition.

    The same study always gives the same figures: random numbers are drawn with the study's seed.
    """
    measures = tuple(study.shown(name) for name in study.design.measures)
    found, failed = [], []
    for comparison in study.design.comparisons:
        try:
            found.append(difference_of(study, comparison, compared_trials(study, comparison)))
        except DasError as error:
            failed.append((comparison.name, str(error)))
    # Comparisons that could not be made count as well: they were planned.
    chances = np.array([one.estimate.probability for one in found] + [math.nan] * len(failed))
    after = corrected(chances, study.design.correction)
    return StudyFindings(
        study=study,
        measures=measures,
        differences=tuple(
            replace(one, corrected=float(value)) for one, value in zip(found, after[: len(found)], strict=True)
        ),
        failed=tuple(failed),
        conditions=tuple(_conditions(study)),
    )


def generator(study: RunStudy, what: str) -> np.random.Generator:
    """The random-number generator for one part of the analysis, independent of other parts."""
    return np.random.default_rng([study.design.seed % 2**32, zlib.crc32(what.encode())])


def difference_of(study: RunStudy, comparison: PlannedComparison, trials: ComparedTrials) -> FoundDifference:
    """The finding on a comparison from its pairs or groups; p is not corrected yet."""
    if isinstance(trials, TwoGroups):
        estimate = group_estimate(trials.a, trials.b)
    else:
        estimate = paired_estimate(trials.means, generator(study, comparison.name))
    shown = study.shown(comparison.measure)
    return FoundDifference(comparison=comparison, shown=shown, estimate=estimate, corrected=math.nan, trials=trials)


def _conditions(study: RunStudy) -> list[ConditionValues]:
    """Every measure in every condition, in the order of the design's levels."""
    trials, found = study.trials, []
    for condition, mine in conditions_of(study):
        for measure in study.design.measures:
            values = trials.values[measure]
            kept = mine & np.isfinite(values)
            names = np.unique(trials.participant[kept])
            means = np.array([values[kept & (trials.participant == name)].mean() for name in names])
            found.append(ConditionValues(condition=condition, measure=measure, trials=int(kept.sum()), means=means))
    return found


def conditions_of(study: RunStudy) -> list[tuple[str, Bools]]:
    """The combinations of levels that were driven, each with the mask of its trials without practice."""
    trials, factors = study.trials, study.design.factors
    found = []
    for levels in product(*(one.texts for one in factors)):
        mine = ~trials.practice
        for factor, level in zip(factors, levels, strict=True):
            mine &= trials.levels[factor.name] == level
        if mine.any():
            found.append((", ".join(levels), mine))
    return found
