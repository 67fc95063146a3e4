"""The parameters of human drivers, and populations of drivers with different parameters.

A population gives distributions of parameters, from which every participant is drawn once. Dependence follows a
Gaussian copula: normal numbers with the correlations of the file are transformed into the distributions of the
parameters, cut off at their ranges. The format: docs/reference/populations.md.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import MISSING, DasError, InputError
from das.domain.files.load import bundled_files, locate
from das.domain.files.reading import Fields, number, read_toml
from das.domain.units import KMH
from sim.drivers.kinds import DriverKind, DriverName

ASSUMPTION = "assumption"
ROAD = "assumption, longer than the 0.75 to 1.5 s of road drivers' braking (Green 2000) because advice is not urgent"

REASON = (
    "assumption: a reason has no effect. Road drivers adhere more to justified advice (123 people, Thill et al. "
    "2018, Transp. Res. F 56, 420-435, no rate), while SBB dropped the reason 'eco' because it had no effect"
)


def _parameter(default: float, unit: str, low: float, high: float, meaning: str, source: str = ASSUMPTION) -> Any:
    return field(
        default=default, metadata={"unit": unit, "low": low, "high": high, "meaning": meaning, "source": source}
    )


@dataclass(frozen=True, kw_only=True)
class HumanParameters:
    """The parameters of a human driver in SI; `parameter_table` gives meaning, range and source of each."""

    reaction_median_s: float = _parameter(
        2.0, "s", 0.2, 20.0, "median reaction time (lognormal) to advice once seen, and to permission to depart", ROAD
    )
    reaction_log_sd: float = _parameter(0.4, "–", 0.0, 1.5, "standard deviation of the logarithm of the reaction time")
    expected_ratio: float = _parameter(
        0.6,
        "–",
        0.1,
        1.0,
        "reaction time to an announced change, as a share of that to an unannounced change",
        "road drivers brake for expected events after 0.7 to 0.75 s, for unexpected ones after 1.25 s (Green 2000)",
    )
    glance_mean_s: float = _parameter(
        5.0, "s", 0.2, 60.0, "mean time between glances at the display (excess over `glance_least_s`: exponential)"
    )
    glance_least_s: float = _parameter(1.0, "s", 0.0, 10.0, "least time between glances")
    notches: int = _parameter(0, "notches", 0, 32, "controller notches each for power and brake; 0: percent controller")
    notch_s: float = _parameter(0.7, "s", 0.0, 5.0, "time to move the controller by one notch")
    lever_rate_per_s: float = _parameter(0.4, "1/s", 0.01, 10.0, "speed of a percent controller (1: full scale)")
    lever_least_ratio: float = _parameter(0.03, "–", 0.0, 0.5, "smallest change made with a percent controller")
    speed_error_mps: float = _parameter(
        1.5 * KMH, "m/s", 0.0, 5.0, "standard deviation of the driven speed from the intended one"
    )
    speed_error_s: float = _parameter(30.0, "s", 0.5, 600.0, "correlation time of the speed error")
    force_error_ratio: float = _parameter(0.08, "–", 0.0, 0.5, "standard deviation of an effort's relative error")
    force_error_s: float = _parameter(8.0, "s", 0.5, 600.0, "correlation time of the effort error")
    dead_band_mps: float = _parameter(2.0 * KMH, "m/s", 0.0, 5.0, "speed errors below this are not corrected")
    comply_traction_ratio: float = _parameter(0.95, "–", 0.0, 1.0, "share of advice to accelerate that is followed")
    comply_hold_ratio: float = _parameter(0.9, "–", 0.0, 1.0, "share of advice to hold a speed that is followed")
    comply_coast_ratio: float = _parameter(0.85, "–", 0.0, 1.0, "share of advice to coast that is followed")
    comply_brake_ratio: float = _parameter(0.85, "–", 0.0, 1.0, "share of advice to brake that is followed")
    reason_refusal_ratio: float = _parameter(
        1.0,
        "–",
        0.0,
        1.0,
        "share of the refused advice that is still refused if its reason is shown",
        REASON,
    )
    lapses_per_h: float = _parameter(1.0, "1/h", 0.0, 60.0, "lapses of attention (Poisson process)")
    lapse_mean_s: float = _parameter(
        12.0, "s", 0.1, 120.0, "mean duration of a lapse (exponential); the speed warning ends a lapse early"
    )
    braking_mps2: float = _parameter(0.5, "m/s²", 0.1, 1.5, "deceleration planned for limits and stops")
    early_braking_s: float = _parameter(2.0, "s", 0.0, 20.0, "time by which braking begins earlier than needed")
    below_limit_mps: float = _parameter(2.0 * KMH, "m/s", 0.0, 10.0, "margin below limits")
    stop_error_m: float = _parameter(2.0, "m", 0.0, 8.0, "standard deviation of the stopping error")
    friction_ratio: float = _parameter(
        0.4,
        "–",
        0.0,
        1.0,
        "share of the braking effort by the friction brake although the motors could supply it (policy `as-measured`)",
        "chosen so that the friction brakes take about the 15.1 % of the energy that Nold & Corman (2024) measured: "
        "docs/reference/drivers.md",
    )
    haste_ratio: float = _parameter(
        0.5, "–", 0.0, 1.0, "without advice: 0 = at the highest speed that keeps time, 1 = as fast as allowed"
    )
    learning_trips: float = _parameter(20.0, "trips", 0.1, 1000.0, "trips after which 1/e of the learning is to come")
    learned_ratio: float = _parameter(
        0.6, "–", 0.0, 1.0, "remaining share of reaction, errors, margins and refusals after long practice"
    )

    def __post_init__(self) -> None:
        for item in fields(self):
            value, low, high = getattr(self, item.name), item.metadata["low"], item.metadata["high"]
            counts = isinstance(item.default, int)
            if not low <= value <= high or (counts and value != int(value)):
                unit = "" if item.metadata["unit"] == "–" else f" {item.metadata['unit']}"
                expected = f"{'a whole number, ' if counts else ''}{low:g} to {high:g}{unit}"
                raise InputError("human driver", item.name, value, expected)
        if self.glance_mean_s < self.glance_least_s:
            raise InputError("human driver", "glance_mean_s", self.glance_mean_s, "at least glance_least_s")

    def after(self, trips: float) -> HumanParameters:
        """The driver after n trips with this train, line and display: l + (1 − l)·exp(−n/n₀) of each flaw remains."""
        if not trips >= 0:
            raise InputError("human driver", "trips", trips, "a number >= 0")
        left = self.learned_ratio + (1.0 - self.learned_ratio) * math.exp(-trips / self.learning_trips)
        practised = ("reaction_median_s", "speed_error_mps", "force_error_ratio", "early_braking_s", "stop_error_m")
        refused = [name for name in self.__dataclass_fields__ if name.startswith("comply_")]
        changed = {name: max(left * getattr(self, name), _low(name)) for name in practised}
        changed |= {name: 1.0 - left * (1.0 - getattr(self, name)) for name in refused}
        return replace(self, **changed)


def _low(name: str) -> float:
    return float(HumanParameters.__dataclass_fields__[name].metadata["low"])


def parameter_table() -> list[tuple[str, str, str, str, str, str]]:
    """Name, default, unit, range, meaning and source of each parameter, as text."""
    return [
        (
            item.name,
            f"{item.default:.4g}",
            item.metadata["unit"],
            f"{item.metadata['low']:g} … {item.metadata['high']:g}",
            item.metadata["meaning"],
            item.metadata["source"],
        )
        for item in fields(HumanParameters)
    ]


SCHEMA_VERSION: Final = 1
DEFAULT: Final = "default"
"""Name of the bundled population."""
NORMAL: Final = NormalDist()
MOST_CERTAIN: Final = 1e-12
"""Least distance of probabilities from 0 and 1, because the normal quantile is infinite at 0 and 1."""


class Shape(StrEnum):
    """The distribution of a parameter, named by what is normally distributed: value, logarithm or logit."""

    FIXED = "fixed"
    NORMAL = "normal"
    LOGNORMAL = "lognormal"
    LOGIT_NORMAL = "logit-normal"


KEYS: Final = {
    Shape.FIXED: ("value", None),
    Shape.NORMAL: ("mean", "sd"),
    Shape.LOGNORMAL: ("median", "log_sd"),
    Shape.LOGIT_NORMAL: ("median", "logit_sd"),
}
"""The keys of each distribution in the file: one for its middle, one for its spread."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """The variation of one parameter between drivers: a distribution within `low` and `high`, and its source.

    `middle` is the median (for NORMAL, the mean), in the parameter's unit; `sd` is the standard deviation of the value,
    of its logarithm or of its logit.
    """

    name: str
    shape: Shape
    middle: float
    sd: float
    low: float
    high: float
    source: str

    def at(self, normal: float) -> float:
        """The value for a number from the standard normal distribution."""
        if self.sd == 0:
            return self.middle
        middle = self._straight(self.middle)
        lowest, highest = (NORMAL.cdf((self._straight(end) - middle) / self.sd) for end in (self.low, self.high))
        share = lowest + NORMAL.cdf(normal) * (highest - lowest)
        cut = NORMAL.inv_cdf(min(max(share, MOST_CERTAIN), 1.0 - MOST_CERTAIN))
        return min(max(self._of_straight(middle + self.sd * cut), self.low), self.high)

    def _straight(self, value: float) -> float:
        """The normally distributed quantity: the value, its logarithm or its logit."""
        if self.shape is Shape.LOGNORMAL:
            return math.log(value) if value > 0 else -math.inf
        if self.shape is Shape.LOGIT_NORMAL:
            return math.log(value / (1.0 - value)) if 0 < value < 1 else math.copysign(math.inf, value - 0.5)
        return value

    def _of_straight(self, straight: float) -> float:
        if self.shape is Shape.LOGNORMAL:
            return math.exp(straight)
        return 1.0 / (1.0 + math.exp(-straight)) if self.shape is Shape.LOGIT_NORMAL else straight


class Correlation(NamedTuple):
    """The correlation of the normal numbers of two parameters, and its source."""

    one: str
    other: str
    value: float
    source: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Population:
    """Human drivers who differ from each other; `triangle` is the Cholesky factor of their parameters' correlations."""

    id: str
    title: str
    source: Path
    spreads: tuple[Spread, ...]
    correlations: tuple[Correlation, ...]
    triangle: NDArray[np.float64]

    def draw(self, number: int) -> dict[str, float]:
        """The values of a participant's parameters, by name.

        A number means the same person in every run. A parameter added at the end of the file leaves the others
        unchanged.
        """
        independent = [_normal(number, spread.name) for spread in self.spreads]
        dependent = (self.triangle @ np.array(independent)).tolist() if self.spreads else []
        return {spread.name: spread.at(normal) for spread, normal in zip(self.spreads, dependent, strict=True)}


@dataclass(frozen=True, kw_only=True)
class Participant:
    """One driver of a population, by number."""

    population: Population
    number: int


def stream_of(who: Participant | None) -> int:
    """The number of a driver's random-number stream in a run; 0 for a driver who is no participant."""
    return 0 if who is None else who.number + 1


def participant_of(driver: DriverName, number: int | None, population: str | None) -> Participant | None:
    """The participant that the user chose; None without a number.

    Raises DasError for a population that cannot be used, for a population without a number, and for a number if the
    driver is not the human driver.
    """
    if number is None:
        if population is not None:
            raise DasError(f"--population {population}: needs --participant")
        return None
    if driver is not DriverKind.HUMAN:
        raise DasError(f"--participant {number}: needs --driver human: only this driver has parameters")
    return Participant(population=load_population(DEFAULT if population is None else population), number=number)


def load_population(name_or_path: str) -> Population:
    """Read a bundled population or a TOML file; raises DasError or InputError for anything unusable."""
    return read_population(locate(name_or_path, "population", bundled_files("sim.drivers", "populations")))


def read_population(path: Path) -> Population:
    """Read a population; raises DasError or InputError (file, key, value, expectation) for anything unusable."""
    fields = read_toml(path)
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(["schema_version", "population", "parameters", "correlations"])
    main = fields.table("population")
    main.check_keys(["id", "title"])
    parameters = fields.table("parameters")
    parameters.check_keys(list(HumanParameters.__dataclass_fields__))
    spreads = tuple(_spread(parameters, name) for name in parameters.data)
    correlations = _correlations(fields, [spread.name for spread in spreads])
    return Population(
        id=main.name("id"),
        title=main.name("title"),
        source=path,
        spreads=spreads,
        correlations=correlations,
        triangle=_triangle(path, spreads, correlations),
    )


def _spread(parameters: Fields, name: str) -> Spread:
    table = parameters.table(name)
    shape = table.choice("distribution", Shape)
    middle_key, sd_key = KEYS[shape]
    table.check_keys(["distribution", "source", "low", "high", middle_key, *([sd_key] if sd_key else [])])
    metadata = HumanParameters.__dataclass_fields__[name].metadata
    low = _number(table, "low", (metadata["low"], metadata["high"]), metadata["low"])
    high = _number(table, "high", (low, metadata["high"]), metadata["high"])
    middle = _number(table, middle_key, (low, high))
    if shape is Shape.LOGNORMAL and middle <= 0:
        raise table.error(middle_key, middle, "more than 0")
    if shape is Shape.LOGIT_NORMAL and (not 0 < middle < 1 or metadata["high"] > 1):
        raise table.error(middle_key, middle, "a ratio between 0 and 1, for a parameter of 0 to 1")
    whole = isinstance(HumanParameters.__dataclass_fields__[name].default, int)
    if whole and (shape is not Shape.FIXED or middle % 1):
        raise table.error("distribution", str(shape), "fixed, with a whole number")
    return Spread(
        name=name,
        shape=shape,
        middle=middle,
        sd=_number(table, sd_key, (0.0, 1e3)) if sd_key else 0.0,
        low=low,
        high=high,
        source=table.name("source"),
    )


def _number(table: Fields, key: str, limits: tuple[float, float], default: float | None = None) -> float:
    if not table.has(key) and default is not None:
        return default
    value = number(table.source, f"{table.prefix}{key}", table.data.get(key, MISSING))
    if not limits[0] <= value <= limits[1]:
        raise table.error(key, value, f"{limits[0]:g} to {limits[1]:g}")
    return value


def _correlations(fields: Fields, names: Sequence[str]) -> tuple[Correlation, ...]:
    if not fields.has("correlations"):
        return ()
    found: dict[frozenset[str], Correlation] = {}
    for i, row in enumerate(fields.rows("correlations", "a list of tables")):
        table = Fields.of(fields.source, row, f"correlations[{i}].")
        table.check_keys(["between", "value", "source"])
        pair = table.data.get("between", MISSING)
        if (
            not isinstance(pair, list)
            or len(pair) != 2
            or pair[0] == pair[1]
            or not all(name in names for name in pair)
        ):
            raise table.error("between", pair, "two of the parameters of this population")
        if frozenset(pair) in found:
            raise table.error("between", pair, "each pair once")
        value = _number(table, "value", (-1.0, 1.0))
        found[frozenset(pair)] = Correlation(pair[0], pair[1], value, table.name("source"))
    return tuple(found.values())


def _triangle(path: Path, spreads: Sequence[Spread], correlations: Sequence[Correlation]) -> NDArray[np.float64]:
    place = {spread.name: i for i, spread in enumerate(spreads)}
    matrix = np.eye(len(spreads))
    for one, other, value, _ in correlations:
        matrix[place[one], place[other]] = matrix[place[other], place[one]] = value
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        least = float(np.linalg.eigvalsh(matrix)[0])
        said = f"they contradict each other (least eigenvalue {least:.3g}); expected a positive definite matrix"
        raise DasError(f"{path}: correlations: {said}") from None


def _normal(participant: int, name: str) -> float:
    stream = np.random.SeedSequence(participant, spawn_key=(zlib.crc32(name.encode()),))
    return float(np.random.default_rng(stream).standard_normal())
