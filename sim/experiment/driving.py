"""Drives one trial: the day of its seed, its participant, and the display as its setting has it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Final

from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.units import NS
from sim.drivers.population import Participant, Population, load_population
from sim.experiment.driven import Driven, WatchedDriver
from sim.experiment.setting import Setting
from sim.experiment.trials import StudyTrial
from sim.jobs.driving import JobRecording, ServiceMemory, drive_day
from sim.world.day import Day, make_day
from sim.world.outcome import outcome
from sim.world.over_bus import How
from sim.world.service import Service

LINES_KEPT: Final = 3
"""Solved lines that a process keeps: that of the true train's losses, and those of two levels of the advice's."""
_services = ServiceMemory(most=LINES_KEPT)


@dataclass(frozen=True, kw_only=True)
class TrialCall:
    """What is needed to drive a trial: the trial, the population, and where it is recorded (None: not at all)."""

    trial: StudyTrial
    population: str
    record: JobRecording | None = None


def drive(call: TrialCall) -> Driven:
    """Drive a trial; raises DasError for files that cannot be used, and where the train does not get there."""
    trial = call.trial
    day = _day(trial, Participant(population=_population(call.population), number=trial.person))
    driver = WatchedDriver(day.driver(trial.setting.driver, trial.setting.friction))
    setting, record = trial.setting, call.record
    how = How(
        driver=setting.driver,
        friction=setting.friction,
        advice=setting.presentation,
        train="train-1",
        command="" if record is None else record.command,
        screen=setting.screen,
    )
    run = drive_day(day, driver, how, None if record is None else record.file)
    return Driven(day=day, run=run, outcome=outcome(day, run), looks=driver.looks)


def service_of(setting: Setting) -> Service:
    """The service of a setting, with the timetable and the optimum of the true train whatever the advice is planned
    with.

    Raises DasError for files that cannot be used.
    """
    scenario = setting.read_scenario()
    own = _services.of(scenario, None)
    if setting.loss_level is None or setting.loss_level == own.level:
        return own
    _, true_level = scenario.truth.train(own.vehicle, own.level)
    fixed = replace(scenario, truth=replace(scenario.truth, level=true_level))
    planned = _services.of(fixed, setting.loss_level)
    times_s = [(table.arrival_ns - table.departure_ns) * NS for table in own.timetables]
    service = replace(
        planned,
        timetables=own.timetables,
        planned=tuple(front.trajectory(time_s) for front, time_s in zip(planned.fronts, times_s, strict=True)),
    )
    if scenario.truth.is_as_planned:
        service.true_fronts[Conditions()] = own.fronts
    return service


def _day(trial: StudyTrial, who: Participant) -> Day:
    """The day of a trial, with the participant's own chances and the trips that were made before."""
    day = make_day(service_of(trial.setting), trial.seed, who)
    day = replace(day, stream=trial.stream)
    if trial.trips is None:
        return day
    if "trips" in day.service.scenario.human.given:
        source = day.service.scenario.source
        raise DasError(f"{source}: human.trips: expected no trips here, because the design counts them (learning)")
    return replace(day, human=day.human.after(trial.trips))


@cache
def _population(name_or_path: str) -> Population:
    return load_population(name_or_path)
