"""Driven anew: the recorded day's disturbances, timetable and seed, and a simulated driver who drives it again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from das.cab.warm_up import warm_up
from das.domain.errors import DasError
from das.domain.levels import Level
from das.domain.units import KMH
from sim.drivers.kinds import DriverKind, DriverName, External, FrictionPolicy, OwnClass, Presentation, named_driver
from sim.drivers.own_class import driver_versions
from sim.drivers.population import DEFAULT, Participant, load_population, participant_of
from sim.drivers.screen import recorded_screen
from sim.recording.inputs import sha256
from sim.recording.metadata import WhatIfKind, typed_command
from sim.runs.reproduce.hearing import HeardAgain
from sim.runs.what_if.origin import Origin
from sim.runs.what_if.otherwise import CabOtherwise, Otherwise
from sim.runs.what_if.recorded_scenario import attached_scenario, scenario_of_drive
from sim.world.day import Day, make_day, with_disturbances
from sim.world.disturbances import AnnouncedRestriction
from sim.world.over_bus import How, make_crew, run_over_bus
from sim.world.scenario import Scenario
from sim.world.service import prepare_service

TRUE_LEVEL: Final = "what_if_true_level"
"""The key of the metadata that says with which losses the train was driven, where its advice is planned with others."""
BEFORE_THE_CHOICE: Final = FrictionPolicy.BY_ADVICE
"""How human drivers braked before that could be chosen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AgainDay:
    """A day to be driven anew, how, and what its recording says about it."""

    day: Day
    how: How
    metadata: Mapping[str, str]


def day_again(origin: Origin, new: Otherwise, node: str | None = None) -> AgainDay:
    """The recorded day with what is otherwise; raises DasError where it cannot be had again.

    Of a simulated day, scenario and seed are the recorded ones. Of any other drive the scenario is made from what was
    heard, and the driver is a simulated one with seed 0.
    """
    whole = new.over(Otherwise.of(origin.run))
    scenario = attached_scenario(origin) if origin.is_simulated else scenario_of_drive(origin, node)
    how = _how(origin, new)
    driver_versions(how.driver)
    person = _participant(origin, new, how.driver)
    warm_up()
    level, true_level = _levels(origin, new.cab, scenario)
    scenario = _scenario(scenario, whole.cab, true_level)
    service = prepare_service(scenario, level=level)
    _check_stops(origin, [stop.name for stop in service.stops])
    day = make_day(service.timed(origin.timetables()), _seed(origin), person)
    metadata = origin.metadata(WhatIfKind.DRIVEN_ANEW, new, whole)
    metadata |= {} if true_level is None else {TRUE_LEVEL: str(true_level)}
    return AgainDay(day=_restricted(day, whole), how=how, metadata=metadata)


def drive_again(again: AgainDay, out: Path, progress: HeardAgain) -> None:
    """Drive the day into a recording, with node and recorder as processes; DasError where it cannot be driven."""
    day, how = again.day, again.how
    crew = make_crew(day, how, out)
    crew = replace(crew, metadata={**crew.metadata, **again.metadata})
    assert not isinstance(how.driver, External)
    run_over_bus(day, day.driver(how.driver, how.friction), how.advice, crew, progress, screen=how.screen)


def _scenario(scenario: Scenario, cab: CabOtherwise, true_level: Level | None) -> Scenario:
    """The scenario with another train or other braking of the coach; `true_level`: the losses that the train keeps."""
    if cab.vehicle is not None:
        scenario = replace(scenario, vehicle=cab.vehicle, load=cab.load, loss_map=None)
    elif cab.load is not None:
        scenario = replace(scenario, load=cab.load)
    braking = scenario.braking
    if cab.planning_brake is not None:
        braking = replace(braking, deceleration_mps2=cab.planning_brake)
    if cab.below_limit is not None:
        braking = replace(braking, below_limit_mps=cab.below_limit * KMH)
    truth = scenario.truth if true_level is None else replace(scenario.truth, level=true_level)
    return replace(scenario, braking=braking, truth=truth)


def _levels(origin: Origin, cab: CabOtherwise, scenario: Scenario) -> tuple[Level | None, Level | None]:
    """The level of the advice, and that of the true train where it must stay another one than the advice's."""
    recorded = None if cab.vehicle is not None else _level(origin, "level")
    if cab.level is None or cab.vehicle is not None:
        return cab.level or recorded, None if cab.vehicle is not None else _level(origin, TRUE_LEVEL)
    fixed = scenario.truth.level is not None or scenario.truth.loss_map is not None
    return cab.level, None if fixed else _level(origin, TRUE_LEVEL) or recorded


def _level(origin: Origin, key: str) -> Level | None:
    name = origin.run.get(key) or (origin.journey.level if key == "level" else "")
    if name and name not in list(Level):
        raise DasError(f"{origin.path}: {key} {name!r}: expected one of {', '.join(Level)}")
    return Level(name) if name else None


def _seed(origin: Origin) -> int:
    text = origin.run.get("seed", "0") if origin.is_simulated else "0"
    if not text.isdecimal():
        raise DasError(f"{origin.path}: seed {text!r}: expected a number")
    return int(text)


def _how(origin: Origin, new: Otherwise) -> How:
    """The driver, the display and the policy of braking: each as the user asks for, else as recorded."""
    run, driven = origin.run if origin.is_simulated else {}, new.driven
    if driven.driver is not None:
        driver = named_driver("--driver", driven.driver)
    else:
        driver = named_driver(f"{origin.path}: driver", run.get("driver", DriverKind.HUMAN))
        if isinstance(driver, OwnClass):
            raise DasError(
                f"{origin.path}: was driven by the class {driver}, which is not run unasked: "
                f"expected --driver {driver}, or another driver"
            )
    if isinstance(driver, External):
        if driven.driver is not None:
            raise DasError(f"--driver {driver}: expected a driver who drives within this process")
        raise DasError(f"{origin.path}: was driven by a process of its own: say who drives it anew (--driver)")
    shown = Presentation.COACH if origin.has_coach else Presentation.VECTOR
    missing = BEFORE_THE_CHOICE if origin.is_simulated else FrictionPolicy.AS_MEASURED
    try:
        return How(
            driver=driver,
            friction=driven.friction or FrictionPolicy(run.get("friction_policy", missing)),
            advice=driven.advice or Presentation(run.get("advice", shown)),
            train=origin.train,
            command=typed_command(),
            screen=recorded_screen(run),
        )
    except ValueError as error:
        raise DasError(f"{origin.path}: how it was driven is not known to this version ({error})") from None


def _participant(origin: Origin, new: Otherwise, driver: DriverName) -> Participant | None:
    """The person who drives: the participant asked for, else the recorded one, else nobody in particular."""
    driven = new.driven
    if driven.participant is not None:
        return participant_of(driver, driven.participant, driven.population)
    try:
        drawn = json.loads(origin.run.get("drawn", "{}")) if origin.is_simulated else {}
        number, recorded = drawn.get("human", {}).get("participant"), drawn.get("population", {})
    except (ValueError, AttributeError) as error:
        raise DasError(f"{origin.path}: metadata run.drawn: cannot be read ({error})") from None
    if number is None or driver is not DriverKind.HUMAN:
        return participant_of(driver, None, driven.population)
    population = load_population(driven.population or DEFAULT)
    if driven.population is None and sha256(population.source) != recorded.get("sha256"):
        raise DasError(f"{origin.path}: its driver is of the population {recorded.get('id')!r}: expected --population")
    return Participant(population=population, number=int(number))


def _check_stops(origin: Origin, names: list[str]) -> None:
    recorded = [stop.name for stop in origin.journey.stops]
    if names != recorded:
        raise DasError(f"{origin.path}: its journey calls at {', '.join(recorded)}, the line has {', '.join(names)}")


def _restricted(day: Day, whole: Otherwise) -> Day:
    """The day with its restrictions and those that are added, which everybody knows from the beginning."""
    kept = [
        one for one in day.disturbances if not (whole.without_restrictions and isinstance(one, AnnouncedRestriction))
    ]
    added = [
        AnnouncedRestriction(
            from_m=one.start_m,
            to_m=one.end_m,
            speed_mps=one.limit_mps,
            announced_m=day.service.route.length_m,
            valid_from_s=day.service.clock_s(one.valid_from_ns) if one.valid_from_ns else None,
            valid_until_s=day.service.clock_s(one.valid_until_ns) if one.valid_until_ns else None,
        )
        for one in whole.restrictions
    ]
    return with_disturbances(day, [*kept, *added]) if added or len(kept) < len(day.disturbances) else day
