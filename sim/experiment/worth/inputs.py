"""The design of a worth study: a scenario, drawn drivers, and inputs with a value, a range and a source each.

The format: docs/how-to/what-a-fleet-would-save.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from das.domain.errors import MISSING
from das.domain.files.load import bundled_files, locate
from das.domain.files.reading import Fields, number, read_toml
from sim.drivers.parameters import DEFAULT, load_population
from sim.experiment.design import study_name
from sim.experiment.factors import FACTORS, FactorLevel, day_of
from sim.world.scenario import Scenario

SCHEMA_VERSION: Final = 1
DRIVERS: Final = (3, 10_000)
"""Fewest drivers, whose mean has an interval, and most."""
USUAL_DRIVERS: Final = 8


class KnownInput(NamedTuple):
    """An input: its title, unit, least and greatest value, and whether trials are driven at both ends of its range.

    The result is proportional to an input that is not driven, which is therefore above 0.
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
    PRICE: KnownInput("price of energy", "EUR/kWh", 1e-3, 10.0),
    CO2: KnownInput("CO₂ of energy", "g/kWh", 1e-3, 3000.0),
    TRAINS: KnownInput("trains a day", "", 1e-3, 1e5),
    DAYS: KnownInput("days a year", "", 1e-3, 366.0),
    FOLLOWERS: KnownInput("share of trains whose driver follows", "", 1e-3, 1.0),
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


def load_worth(name_or_path: str, drivers: int | None = None) -> WorthDesign:
    """Read a bundled worth design or a TOML file; `drivers` replaces the design's number of drivers.

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
    scenario = FACTORS["scenario"].read(main, "scenario", main.data.get("scenario", MISSING))
    return WorthDesign(
        name=study_name(main),
        title=main.name("title"),
        source=fields.source,
        scenario=scenario,
        drivers=count if drivers is None else drivers,
        seed=main.whole("seed", (0, 2**31), 1),
        population=population,
        inputs=_inputs(fields.table("inputs"), day_of(scenario.value)),
    )


def _inputs(own: Fields, scenario: Scenario) -> dict[str, Input]:
    """The inputs of a design; a buffer only if the scenario has no times of its own."""
    timed = scenario.journey is not None or scenario.running_s is not None
    if timed and own.has(BUFFER):
        raise own.error(BUFFER, own.data[BUFFER], f"none, because {scenario.source} states its times")
    names = [name for name in INPUTS if not (timed and name == BUFFER)]
    own.check_keys(names)
    return {name: _input(own.table(name), INPUTS[name]) for name in names}


def _input(table: Fields, known: KnownInput) -> Input:
    table.check_keys(["value", "low", "high", "source"])

    def read(key: str, low: float, high: float) -> float:
        value = number(table.source, f"{table.prefix}{key}", table.data.get(key, MISSING))
        if not low <= value <= high:
            raise table.error(key, value, f"a number from {low:g} to {high:g} {known.unit}".rstrip())
        return value

    value = read("value", known.least, known.most)
    low, high = read("low", known.least, value), read("high", value, known.most)
    return Input(value=value, low=low, high=high, source=table.text("source"))
