"""The study of a worth design: its cases, which are levels of one factor, and the run of its trials.

Every driver drives every case, on the same run and with the same random numbers, so that cases are compared in pairs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from das.command_line.files import warn_once, warn_unusual
from das.command_line.printing import busy
from das.domain.errors import DasError
from das.domain.files.reading import Fields, read_text
from das.domain.files.writing import write_whole
from precompute.workers import Workers
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.experiment.checking import made_folder
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
    freeze,
)
from sim.experiment.driving import service_of
from sim.experiment.factors import FACTORS, OF_HUMAN, FactorLevel
from sim.experiment.study_files import TRIALS_TABLE
from sim.experiment.trials import StudyRun, jobs_of, run_study
from sim.experiment.worth.inputs import BUFFER, ELECTRIC, HASTE, INPUTS, RECEPTIVITY, WorthDesign

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


def study_of(worth: WorthDesign) -> Design:
    """The study of a worth design; drivers who follow advice on effort brake with the motors first."""
    factor = Factor(name=CASE, levels=tuple(_cases(worth)), within=True)
    return Design(
        name=worth.name,
        title=worth.name,  # not worth.title: another title is not another study
        description="",
        source=worth.source,
        seed=worth.seed,
        fixed={
            **defaults(factor.varied),
            "scenario": worth.scenario,
            "friction": _level("friction", FrictionPolicy.BY_ADVICE.value),
        },
        factors=(factor,),
        people=People(count=worth.drivers, population=worth.population),
        procedure=Procedure(order=ConditionOrder.LISTED, chances=Chances.PAIRED),
        measures=MEASURES,
    )


def _cases(worth: WorthDesign) -> Iterator[FactorLevel]:
    today = {name: one.value for name, one in worth.inputs.items() if INPUTS[name].driven}
    yield _case(ALL_OUT, today, DriverKind.FAST)
    yield _case(OBEDIENT, today, DriverKind.PERFECT, Presentation.GUIDE)
    people = {TODAY: today, IN_TIME: {**today, HASTE: 0.0, ELECTRIC: 1.0}}
    for name, ends in ends_of(worth).items():
        people |= {case: {**today, name: value} for case, value in ends.items()}
    for case, values in people.items():
        yield _case(case, values)
        yield _case(f"{case}{GUIDED}", values, shown=Presentation.GUIDE)


def ends_of(worth: WorthDesign) -> dict[str, dict[str, float]]:
    """The cases at the ends of each driven input's range, with its value there; none at an end that is the value."""
    return {
        name: {f"{name}-{end}": at for end, at in (("low", one.low), ("high", one.high)) if at != one.value}
        for name, one in worth.inputs.items()
        if INPUTS[name].driven
    }


def _case(
    name: str,
    values: Mapping[str, float],
    driver: DriverKind = DriverKind.HUMAN,
    shown: Presentation = Presentation.NONE,
) -> FactorLevel:
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

    Warns of a timetable that a train braked as the advice plans cannot keep. Raises DasError for files that cannot be
    used, and for a folder that holds other trials.
    """
    design = study_of(worth)
    if (folder / TRIALS_TABLE).exists() and not (folder / DESIGN_JSON).exists():
        raise DasError(f"{folder / TRIALS_TABLE}: exists without a design: expected a new folder, or one of this study")
    with made_folder(folder):
        with busy("solving the line …"):
            service = service_of(next(design.settings()))
        warn_unusual(service.route, service.vehicle)
        warn_once(*service.unkept())
        freeze(design, folder)
        # Inputs that only scale are not part of the frozen study: they may have changed since the last run.
        write_whole(folder / DESIGN_TEXT, read_text(worth.source).encode())
    return run_study(design, jobs_of(design, folder, record=record), folder, workers)
