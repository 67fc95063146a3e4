"""The design of a worth study: a scenario, drawn drivers, and inputs with a value, a range and a source each.

The format: docs/how-to/what-a-fleet-would-save.md. Inputs that a design does not give are those of `defaults.toml`;
the default values of buffer and receptivity are the scenario's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from das.domain.errors import MISSING, DasError
from das.domain.files.load import bundled_files, locate
from das.domain.files.reading import Fields, number, read_toml
from das.domain.units import PERCENT
from sim.drivers.parameters import DEFAULT, load_population
from sim.experiment.design import study_name
from sim.experiment.factors import FACTORS, FactorLevel, day_of
from sim.world.scenario import Scenario

SCHEMA_VERSION: Final = 1
DRIVERS: Final = (3, 10_000)
"""Fewest drivers, whose mean has an interval, and most."""
USUAL_DRIVERS: Final = 8
DEFAULTS: Final = Path(__file__).parent / "defaults.toml"
"""The file of the inputs' default values, ranges and sources."""


class KnownInput(NamedTuple):
    """An input: its title, unit, least and greatest value, and whether trials are driven at both ends of its range.

    The result is proportional to an input that is not driven.
    """

    title: str
    unit: str
    least: float
    most: float
    driven: bool = False


RECEPTIVITY, BUFFER, HASTE, ELECTRIC = "receptivity_ratio", "buffer_percent", "haste_ratio", "electric_brake_ratio"
PRICE, CO2, FOLLOWERS = "price_eur_per_kwh", "co2_g_per_kwh", "followers_ratio"
TRAINS, DAYS = "trains_per_day", "days_per_year"
INPUTS: Final = {
    PRICE: KnownInput("price of energy", "EUR/kWh", 0.0, 10.0),
    CO2: KnownInput("CO₂ of energy", "g/kWh", 0.0, 3000.0),
    TRAINS: KnownInput("trains a day", "", 0.0, 1e5),
    DAYS: KnownInput("days a year", "", 0.0, 366.0),
    FOLLOWERS: KnownInput("share of trains whose driver follows", "", 0.0, 1.0),
    RECEPTIVITY: KnownInput("receptivity of the network", "", 0.0, 1.0, driven=True),
    BUFFER: KnownInput("buffer of the timetable", "%", 0.0, 1000.0, driven=True),
    HASTE: KnownInput("haste today (1: all-out)", "", 0.0, 1.0, driven=True),
    ELECTRIC: KnownInput("electric share of braking today", "", 0.0, 1.0, driven=True),
}
"""Every input by its key."""


@dataclass(frozen=True, kw_only=True)
class Input:
    """The value of an input, its range, and the source of both."""

    value: float
    low: float
    high: float
    source: str


@dataclass(frozen=True, kw_only=True)
class WorthDesign:
    """A worth study: the scenario, the number of drivers drawn from a population, the seed, and the inputs by key.

    There is no buffer among the inputs if the scenario has times of its own (a journey or running times).
    """

    name: str
    title: str
    source: Path
    scenario: FactorLevel
    drivers: int
    seed: int
    population: str
    inputs: Mapping[str, Input]

    @property
    def values(self) -> dict[str, float]:
        """The value of each input, by key."""
        return {name: one.value for name, one in self.inputs.items()}


def bundled_designs() -> dict[str, Path]:
    """The bundled worth designs, by name."""
    return bundled_files("sim.experiment.worth", "designs")


def load_worth(name_or_path: str, scenario: str | None = None, drivers: int | None = None) -> WorthDesign:
    """Read a bundled worth design or a TOML file; `scenario` (a name or path) and `drivers` replace the design's.

    Raises DasError or InputError (file, key, value, expectation) for anything unusable.
    """
    fields = read_toml(locate(name_or_path, "worth design", bundled_designs()))
    fields.check_schema_version(SCHEMA_VERSION)
    fields.check_keys(["schema_version", "worth", "inputs"])
    main = fields.table("worth")
    main.check_keys(["name", "title", "scenario", "drivers", "seed", "population"])
    count, population = main.whole("drivers", DRIVERS, USUAL_DRIVERS), main.text("population", DEFAULT)
    population = str((fields.source.parent / population).resolve()) if population.endswith(".toml") else population
    load_population(population)
    level = _scenario(main, scenario)
    return WorthDesign(
        name=study_name(main),
        title=main.name("title"),
        source=fields.source,
        scenario=level,
        drivers=count if drivers is None else drivers,
        seed=main.whole("seed", (0, 2**31), 1),
        population=population,
        inputs=_inputs(fields, day_of(level.value)),
    )


def _scenario(main: Fields, asked: str | None) -> FactorLevel:
    """The scenario of the design, or the one asked for on the command line."""
    if asked is None:
        return FACTORS["scenario"].read(main, "scenario", main.data.get("scenario", MISSING))
    try:
        return FactorLevel(text=day_of(asked).id, value=str(Path(asked).resolve()) if Path(asked).suffix else asked)
    except DasError as error:
        raise DasError(f"--scenario: {error}") from None


def _inputs(fields: Fields, scenario: Scenario) -> dict[str, Input]:
    usual, own = read_toml(DEFAULTS).table("inputs"), fields.optional_table("inputs")
    own.check_keys(list(INPUTS))
    timed = scenario.journey is not None or scenario.running_s is not None
    if timed and own.has(BUFFER):
        raise own.error(BUFFER, own.data[BUFFER], f"none, because {scenario.source} states its times")
    receptivity = scenario.truth.conditions[RECEPTIVITY]
    of_scenario = {RECEPTIVITY: 0.5 * (receptivity.low + receptivity.high), BUFFER: scenario.buffer_ratio / PERCENT}
    found = {}
    for name, known in INPUTS.items():
        if own.has(name):
            found[name] = _input(own.table(name), known)
        elif not (timed and name == BUFFER):
            one = _input(usual.table(name), known)
            value = of_scenario.get(name, one.value)
            found[name] = Input(value=value, low=min(one.low, value), high=max(one.high, value), source=one.source)
    return found


def _input(table: Fields, known: KnownInput) -> Input:
    """An input; without `low` or `high` it is not varied in that direction."""
    table.check_keys(["value", "low", "high", "source"])

    def read(key: str, low: float, high: float, default: object = MISSING) -> float:
        value = number(table.source, f"{table.prefix}{key}", table.data.get(key, default))
        if not low <= value <= high:
            raise table.error(key, value, f"a number from {low:g} to {high:g} {known.unit}".rstrip())
        return value

    value = read("value", known.least, known.most)
    low, high = read("low", known.least, value, value), read("high", value, known.most, value)
    return Input(value=value, low=low, high=high, source=table.text("source", table.source.name))
