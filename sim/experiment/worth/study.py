"""The design of a worth study: inputs with a value, a range and a source each, and the study that they lead to.

The format: docs/how-to/what-a-fleet-would-save.md. The cases of the study are levels of one factor: every driver drives
every case, on the same run and with the same random numbers, so that cases are compared in pairs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from das.domain.errors import MISSING, DasError
from das.domain.files.load import bundled_files, locate
from das.domain.files.reading import Fields, read_text, read_toml
from das.domain.files.writing import write_whole
from precompute.workers import Workers
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.experiment.checking import checked_in
from sim.experiment.design import (
    DESIGN_JSON,
    DESIGN_TEXT,
    Chances,
    ConditionOrder,
    Design,
    Factor,
    People,
    Procedure,
    defaults,
    population_of,
    real,
    study_name,
)
from sim.experiment.factors import FACTORS, OF_HUMAN, FactorLevel, day_of
from sim.experiment.study_files import TRIALS_TABLE
from sim.experiment.trials import StudyRun, jobs_of, run_study
from sim.options import DRAWN_DRIVERS
from sim.world.scenario import Scenario

SCHEMA_VERSION: Final = 1


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
    HASTE: KnownInput("haste today (1: as fast as people can)", "", 0.0, 1.0, driven=True),
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
    """A worth study with its title, and its inputs by key; no buffer if the scenario has a journey or running times."""

    title: str
    study: Design
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
    population = population_of(main)
    scenario = FACTORS["scenario"].read(main, "scenario", main.data.get("scenario", MISSING))
    inputs, count = _inputs(fields.table("inputs"), day_of(scenario.value)), main.whole("drivers", DRAWN_DRIVERS, 8)
    factor = Factor(name=CASE, levels=tuple(_cases(inputs)), within=True)
    # Drivers who follow advice on effort brake with the motors first.
    fixed = {"scenario": scenario, "friction": _level("friction", FrictionPolicy.BY_ADVICE.value)}
    study = Design(
        name=study_name(main),
        title=study_name(main),  # another title is not another study
        description="",
        source=fields.source,
        seed=main.whole("seed", (0, 2**31), 1),
        fixed={**defaults(factor.varied), **fixed},
        factors=(factor,),
        people=People(count=count if drivers is None else drivers, population=population),
        procedure=Procedure(order=ConditionOrder.LISTED, chances=Chances.PAIRED),
        measures=MEASURES,
    )
    return WorthDesign(title=main.name("title"), study=study, inputs=inputs)


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
    value = real(table, "value", (known.least, known.most), unit=known.unit)
    low = real(table, "low", (known.least, value), unit=known.unit)
    high = real(table, "high", (value, known.most), unit=known.unit)
    return Input(value=value, low=low, high=high, source=table.text("source"))


CASE: Final = "case"
"""Name of the factor, and of its column in the table of trials."""
ALL_OUT, OBEDIENT, TODAY, IN_TIME = "all-out", "obedient", "today", "in-time"
"""Cases: a driver who goes as fast as allowed and waits at stops; one who follows the guide exactly; people without
advice who drive and brake as the inputs say; and who use all of the timetable's time and brake with the motors first.
"""
GUIDED: Final = "-guided"
"""Ending of the name of a case of people that is driven with the guide."""
ENERGY, EQUAL, OPTIMUM = "energy_kwh", "energy_at_equal_arrival_kwh", "energy_optimum_kwh"
COMPARABLE: Final = "above_optimum_kwh"
"""Measure that is empty if a drive cannot be compared with its optimum."""
LATE: Final = "late_s"
MEASURES: Final = (
    *(ENERGY, OPTIMUM, EQUAL, COMPARABLE, LATE, "energy_blending_kwh", "friction_brake_kwh", "unreturned_kwh"),
    *("compliance_ratio", "over_limit_s", "signals_passed", "stops_missed"),
)


def _cases(inputs: Mapping[str, Input]) -> Iterator[FactorLevel]:
    today = {name: one.value for name, one in inputs.items() if INPUTS[name].driven}
    yield _case(ALL_OUT, today, DriverKind.FAST, Presentation.NONE)
    yield _case(OBEDIENT, today, DriverKind.PERFECT, Presentation.GUIDE)
    people = {TODAY: today, IN_TIME: {**today, HASTE: 0.0, ELECTRIC: 1.0}}
    for name, ends in ends_of(inputs).items():
        people |= {case: {**today, name: value} for case, value in ends.items()}
    for case, values in people.items():
        yield _case(case, values, DriverKind.HUMAN, Presentation.NONE)
        yield _case(f"{case}{GUIDED}", values, DriverKind.HUMAN, Presentation.GUIDE)


def ends_of(inputs: Mapping[str, Input]) -> dict[str, dict[str, float]]:
    """The cases at the ends of each driven input's range, with its value there; none at an end that is the value."""
    return {
        name: {f"{name}-{end}": at for end, at in (("low", one.low), ("high", one.high)) if at != one.value}
        for name, one in inputs.items()
        if INPUTS[name].driven
    }


def _case(name: str, values: Mapping[str, float], driver: DriverKind, shown: Presentation) -> FactorLevel:
    """A case by its name, with the values of the driven inputs, as a named level."""
    settings = {
        "driver": driver.value,
        "presentation": shown.value,
        f"{OF_HUMAN}haste_ratio": values[HASTE],
        f"{OF_HUMAN}friction_ratio": 1.0 - values[ELECTRIC],
        **{one: values[one] for one in (RECEPTIVITY, BUFFER) if one in values},
    }
    return FactorLevel(text=name, settings={key: _level(key, value) for key, value in settings.items()})


def _level(factor: str, value: object) -> FactorLevel:
    return FACTORS[factor].read(Fields.of(Path(), {}), factor, value)


def run_worth(worth: WorthDesign, folder: Path, workers: Workers, *, record: bool = False) -> StudyRun:
    """Drive the unfinished trials of a worth study.

    The first run warns of timetables that a train braked as the advice plans cannot keep. Raises DasError for files
    that cannot be used, and for a folder that holds other trials.
    """
    design = worth.study
    if (folder / TRIALS_TABLE).exists() and not (folder / DESIGN_JSON).exists():
        raise DasError(f"{folder / TRIALS_TABLE}: exists without a design: expected a new folder, or one of this study")
    checked_in(design, folder)
    # Inputs that only scale are not part of the frozen study: they may have changed since the last run.
    write_whole(folder / DESIGN_TEXT, read_text(design.source).encode())
    return run_study(design, jobs_of(design, folder, record=record), folder, workers)
