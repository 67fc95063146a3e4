"""How a measure is shown to people: its name, its unit, and as many digits as its spread deserves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from das.domain.units import kmh
from sim.experiment.analysis.reading import Floats, MeaningOfColumn

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
"""Units of columns that people read under another name; a ratio is shown in percent."""
SAME: Final = "the same"
PERCENT: Final = 100.0


@dataclass(frozen=True, kw_only=True)
class ShownMeasure:
    """A measure as the report shows it: values times `factor`, in `unit`; a difference of percentages is in points."""

    column: str
    name: str
    text: str
    unit: str
    difference_unit: str
    factor: float
    digits: int

    @classmethod
    def of(cls, column: str, meaning: MeaningOfColumn, values: Floats) -> ShownMeasure:
        """A column with its meaning and its values; a ratio is shown in percent."""
        ratio = meaning.unit in RATIOS and column.endswith("_ratio")
        unit = SHOWN_UNITS.get(meaning.unit, meaning.unit)
        factor = PERCENT if ratio else float(kmh(1.0)) if meaning.unit in SPEEDS else 1.0
        finite = values[np.isfinite(values)]
        spread = factor * float(finite.std()) if len(finite) else 0.0
        digits = 2 if spread == 0 else min(max(2 - math.floor(math.log10(spread)), 0), 4)
        return cls(
            column=column, name=meaning.name, text=meaning.text, unit="%" if ratio else unit,
            difference_unit="points" if ratio else unit, factor=factor, digits=digits,
        )  # fmt: skip

    def value(self, value: float) -> str:
        """A value without its unit; nothing where it is NaN."""
        return self._printed(value).lstrip("+")

    def difference(self, value: float) -> str:
        """A difference with its sign, without its unit; nothing where it is NaN."""
        return self._printed(value)

    def _printed(self, value: float) -> str:
        if not math.isfinite(value):
            return ""
        rounded = round(self.factor * value, self.digits)
        return f"{rounded:+.{self.digits}f}".replace("-", "−") if rounded else f"{0:.{self.digits}f}"

    def range(self, interval: tuple[float, float]) -> str:
        """An interval of differences, without its unit; nothing where it is not known."""
        return f"{self.difference(interval[0])} to {self.difference(interval[1])}" if math.isfinite(interval[0]) else ""

    def changed(self, difference: float) -> str:
        """A difference in words: `2.1 points lower`, or `SAME` where it is smaller than what is printed."""
        if float(self.value(abs(difference))) == 0:
            return SAME
        return f"{self.with_unit(difference)} {'lower' if difference < 0 else 'higher'}"

    def with_unit(self, value: float) -> str:
        """A difference without sign, with its unit."""
        return f"{self.value(abs(value))} {self.difference_unit}"


def probability(value: float) -> str:
    """A probability as it is printed; nothing where it is NaN."""
    if not math.isfinite(value):
        return ""
    return "below 0.001" if value < 0.001 else f"{value:.3f}"
