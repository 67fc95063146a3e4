"""A study that was run, read from its folder: its design, its trials, and how their columns are shown in the report."""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.reading import read_text
from das.domain.units import kmh
from sim.experiment.design import Design, PlannedComparison, as_text, read_frozen
from sim.experiment.measures import MEASURES
from sim.experiment.study_files import FAILED_TABLE, TRIALS_TABLE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Texts = NDArray[np.str_]

NAMED: Final = ("trial", "participant", "position", "practice", "seed")
"""Columns that the table of trials must have besides the columns of the factors and of the measures."""
RATIOS: Final = frozenset({"ratio", "1", "share"})
SPEEDS: Final = frozenset({"m/s", "mps"})
SHOWN_UNITS: Final = {
    "1": "times",
    "m/s": "km/h",
    "mps": "km/h",
    "kwh": "kWh",
    "mps3": "m/s³",
    "1/min": "per minute",
    "min": "per minute",
}
"""The report's names for units of columns, if they differ; a ratio is shown in percent."""
SAME: Final = "the same"
PERCENT: Final = 100.0


@dataclass(frozen=True, kw_only=True)
class ShownMeasure:
    """A measure as the report shows it: values times `factor`, in `unit`; differences are in `difference_unit`.

    A ratio is shown in percent, its difference in points. `digits` is the number of digits after the decimal point.
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
        """How to show a column: a measure of this program by its definition, another by the unit in its name.

        The spread of the values decides the digits.
        """
        known = MEASURES.get(column)
        plain, _, suffix = column.rpartition("_")
        unit = suffix if known is None else known.unit
        ratio = unit in RATIOS and column.endswith("_ratio")
        shown = SHOWN_UNITS.get(unit, unit)
        factor = PERCENT if ratio else float(kmh(1.0)) if unit in SPEEDS else 1.0
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
        return self._printed(value).lstrip("+")

    def difference(self, value: float) -> str:
        """A difference with its sign, without its unit; empty for NaN."""
        return self._printed(value)

    def _printed(self, value: float) -> str:
        if not math.isfinite(value):
            return ""
        rounded = round(self.factor * value, self.digits)
        return f"{rounded:+.{self.digits}f}".replace("-", "−") if rounded else f"{0:.{self.digits}f}"

    def range(self, interval: tuple[float, float]) -> str:
        """An interval of differences, without its unit; empty if it is not known."""
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
    """A probability as it is printed; empty for NaN."""
    if not math.isfinite(value):
        return ""
    return "below 0.001" if value < 0.001 else f"{value:.3f}"


@dataclass(frozen=True, kw_only=True)
class FinishedTrials:
    """The trials of a study, practice among them: each array has one entry for each trial.

    `levels` has the level of each factor as text. `values` has the measures in the units of their columns; NaN if
    the table has none. `position` counts the trials of one participant.
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
    """A study that was run: where its files are, its frozen design, and its trials.

    `failed` has a sentence for each trial that failed: who drove it, its condition and why.
    """

    folder: Path
    design: Design
    trials: FinishedTrials
    failed: tuple[str, ...] = ()

    def chosen(self, comparison: PlannedComparison) -> Bools:
        """Which trials belong to a comparison: no practice, at its levels, with a value of its measure."""
        trials = self.trials
        kept = ~trials.practice & np.isfinite(trials.values[comparison.measure])
        kept &= np.isin(trials.levels[comparison.factor], (comparison.a, comparison.b))
        for name, level in comparison.where.items():
            kept &= trials.levels[name] == level
        return kept

    def rows(self, comparison: PlannedComparison) -> Ints:
        """The indices of the trials that belong to a comparison."""
        return np.flatnonzero(self.chosen(comparison))

    @property
    def driven(self) -> Ints:
        """The indices of all trials without practice."""
        return np.flatnonzero(~self.trials.practice)

    @property
    def missing(self) -> Counter[tuple[str, str]]:
        """How many planned trials are not among the finished ones, by participant and condition."""
        names = self.trials.participant[self.driven].tolist()
        return self.design.planned - Counter(zip(names, self.conditions(self.driven).tolist(), strict=True))

    def conditions(self, rows: Ints, without: str = "") -> Texts:
        """The condition of each trial of `rows` as one text: its levels of all factors except the one `without`."""
        levels = [self.trials.levels[one.name] for one in self.design.factors if one.name != without]
        return np.array([" ".join(str(one[row]) for one in levels) for row in rows], dtype=np.str_)


def read_study(folder: Path) -> RunStudy:
    """Read a study's folder: `design.json`, `trials.csv` and, if there, `failed.csv`; DasError if one is unusable."""
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
    """The trials that failed, each in a sentence; none if there is no such file."""
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
    """InputError if two rows are of one trial."""
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
    """A column of numbers; a cell that is empty, or missing as pandas or R writes it, is NaN."""
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
