"""A population of human drivers: distributions of their parameters, from which every participant is drawn once.

The values are dependent as in a Gaussian copula: normal numbers with the correlations of the file, each turned into the
distribution of its parameter, cut off at the parameter's range. The format: docs/reference/populations.md.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import MISSING, DasError
from das.domain.files.load import bundled_files, locate
from das.domain.files.reading import Fields, number, read_toml
from sim.drivers.kinds import DriverKind, DriverName
from sim.drivers.parameters import HumanParameters

SCHEMA_VERSION: Final = 1
DEFAULT: Final = "default"
"""Name of the bundled population."""
NORMAL: Final = NormalDist()
MOST_CERTAIN: Final = 1e-12
"""Probabilities are kept this far from 0 and 1, where the normal distribution has no value."""


class Shape(StrEnum):
    """A distribution: of what it is normal, and what its file must give."""

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
"""The keys of the middle and of the spread of each distribution."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How one parameter differs from driver to driver: a distribution within `low` and `high`, and where it is from.

    `middle` is the median (of NORMAL the mean), in the parameter's unit; `sd` is the standard deviation of the value,
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
        """The value that belongs to a number from the standard normal distribution."""
        if self.sd == 0:
            return self.middle
        lowest, highest = (NORMAL.cdf(self._standard(end)) for end in (self.low, self.high))
        share = lowest + NORMAL.cdf(normal) * (highest - lowest)
        cut = NORMAL.inv_cdf(min(max(share, MOST_CERTAIN), 1.0 - MOST_CERTAIN))
        return min(max(self._of_straight(self._straight(self.middle) + self.sd * cut), self.low), self.high)

    def _standard(self, value: float) -> float:
        """How many standard deviations a value is from the middle."""
        return (self._straight(value) - self._straight(self.middle)) / self.sd

    def _straight(self, value: float) -> float:
        """The value, its logarithm or its logit: what is normally distributed."""
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
    """How two parameters go together: the correlation of their normal numbers, and where it is from."""

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

        The same number is the same person whatever happens on a day. A parameter that is added at the end of the file
        leaves the others as they are.
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
    """Number of a driver's streams of chance on a day; 0 is the driver that the day's seed draws."""
    return 0 if who is None else who.number + 1


def participant_of(driver: DriverName, number: int | None, population: str | None) -> Participant | None:
    """The participant that the user asked for, None without a number.

    Raises DasError for a population that cannot be used, for one without a participant, and for a driver who is not
    human.
    """
    if number is None:
        if population is not None:
            raise DasError(f"--population {population}: expected with --participant")
        return None
    if driver is not DriverKind.HUMAN:
        raise DasError(f"--participant {number}: expected with --driver human, who alone has parameters")
    return Participant(population=load_population(population or DEFAULT), number=number)


def bundled_populations() -> dict[str, Path]:
    """The file of each population that comes with the program, by name."""
    return bundled_files("sim.drivers", "populations")


def load_population(name_or_path: str) -> Population:
    """Read a bundled population or a TOML file; raises DasError or InputError for anything unusable."""
    return read_population(locate(name_or_path, "population", bundled_populations()))


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
            or not all(name in names for name in pair)
            or pair[0] == pair[1]
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
    """The number from the standard normal distribution of a participant's parameter, by the parameter's name."""
    stream = np.random.SeedSequence(participant, spawn_key=(zlib.crc32(name.encode()),))
    return float(np.random.default_rng(stream).standard_normal())


def population_rows(population: Population) -> list[Mapping[str, Any]]:
    """What the file says of each parameter, with the values below which 5, 50 and 95 % of the drivers are."""
    return [
        {
            "parameter": spread.name,
            "distribution": str(spread.shape),
            "middle": spread.middle,
            "sd": spread.sd,
            "p05": spread.at(NORMAL.inv_cdf(0.05)),
            "p50": spread.at(0.0),
            "p95": spread.at(NORMAL.inv_cdf(0.95)),
            "unit": HumanParameters.__dataclass_fields__[spread.name].metadata["unit"],
            "source": spread.source,
        }
        for spread in population.spreads
    ]


def population_markdown(population: Population) -> str:
    """The tables of parameters and correlations as docs/reference/populations.md shows them."""
    lines = ["| parameter | distribution | 5 % | median | 95 % | unit | source |", "|---|---|---:|---:|---:|---|---|"]
    for row in population_rows(population):
        spread = f"{row['distribution']}, {row['sd']:g}"
        figures = f"{row['p05']:.3g} | {row['p50']:.3g} | {row['p95']:.3g}"
        lines.append(f"| `{row['parameter']}` | {spread} | {figures} | {row['unit']} | {row['source']} |")
    lines += ["", "| parameter | goes with | correlation | source |", "|---|---|---:|---|"]
    lines += [
        f"| `{one}` | `{other}` | {value:+g} | {source} |" for one, other, value, source in population.correlations
    ]
    return "\n".join(lines)
