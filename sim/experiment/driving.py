"""The simulation of a trial: the day of its seed, the participant, the display, and all looks of the driver."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

from mcap.exceptions import McapError
from mcap.reader import make_reader

from das.domain.conditions import Conditions
from das.domain.errors import DasError
from das.domain.levels import Level
from das.domain.units import NS
from sim.drive.table import DriveTable
from sim.drivers.cab import AdviceView, CabView, Driver, DriverEvent, beginning_of, kept_by
from sim.drivers.kinds import DESK
from sim.drivers.parameters import Participant, load_population
from sim.experiment.factors import Setting
from sim.plant import kernels
from sim.plant.kernels import Command, PlantState
from sim.recording.opening import open_recording
from sim.world.driving import How, drive_day
from sim.world.external import AT_THE_DESK, ExternalDriver
from sim.world.loop import LOOK_S, TICK_S, Run
from sim.world.outcome import DayOutcome, outcome, true_fronts
from sim.world.scenario import Scenario
from sim.world.service import Day, Service, make_day, prepare_service

LOOKS_A_TICK: Final = round(TICK_S / LOOK_S)
LINES_KEPT: Final = 3
"""Largest number of solved lines in a process: one for the true train's losses, two for loss levels of the advice.

The fronts of a line take a hundred megabytes.
"""
APART: Final = 1_000_000_007
"""Distance between the numbers of a participant's random streams, greater than every participant's number."""
_services: Final[list[tuple[Level | None, Service]]] = []
"""The services solved in the process, each with its loss level; the one used last comes last."""
_population = cache(load_population)


def participant_name(who: int) -> str:
    """The name of a participant (from 1) in the tables of a study."""
    return f"sub-{who:02d}"


@dataclass(frozen=True, kw_only=True)
class StudyTrial:
    """One trial. `who` is the participant's number in the study (from 1), `person` the number in the population.

    `person` is None for the driver who has the default of every parameter.

    `position` counts the trials of the participant from 1, `session` the sessions. `levels` are the texts of the
    factors' levels in the order of the design. `seed` is the seed of the day, `chance` differs between trials of a
    participant that use different random numbers. `trips` is the number of trips that the participant has made before;
    None if there is no learning.
    """

    number: int
    who: int
    person: int | None
    session: int
    position: int
    practice: bool
    levels: tuple[str, ...]
    setting: Setting
    seed: int
    chance: int
    trips: float | None

    @property
    def stream(self) -> int:
        """Number of the participant's random stream on the day."""
        return (0 if self.person is None else self.person + 1) + APART * self.chance

    @property
    def participant(self) -> str:
        """The participant as named in tables."""
        return participant_name(self.who)

    @property
    def session_name(self) -> str:
        """The session as named in tables."""
        return f"ses-{self.session:02d}"

    @property
    def condition(self) -> str:
        """The levels of all factors, as the condition is named in tables."""
        return "_".join(self.levels)


class DriverLook(NamedTuple):
    """One look of the driver: time (s), position (m), speed and limit (m/s), the display, and the driver's command.

    `shown` is None if the display shows no advice.
    """

    time_s: float
    s_m: float
    speed_mps: float
    limit_mps: float
    shown: AdviceView | None
    command: Command

    @property
    def lever_ratio(self) -> float:
        """The controller's setting (−1 … 1); NaN if the driver commands a speed or a force instead of a setting."""
        if self.command.law == kernels.LEVER:
            return self.command.value
        return 0.0 if self.command == (kernels.FORCE, 0.0, *self.command[2:]) else math.nan


class WatchedDriver:
    """A driver that drives exactly as a given driver, and keeps every look in `looks`."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self.begin = beginning_of(driver)
        """The method `begin` of a driver in another process, called by a run; else None."""
        self.looks: list[DriverLook] = []

    @property
    def events(self) -> Sequence[DriverEvent]:
        """The diary of the watched driver so far."""
        return kept_by(self._driver)

    def command(self, cab: CabView) -> Command:
        """The command of the watched driver."""
        asked = self._driver.command(cab)
        self.looks.append(DriverLook(cab.time_s, cab.s_m, cab.speed_mps, cab.limit_mps, cab.shown, asked))
        return asked


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """A driven trial: the day, the run, its outcome, all looks of the driver, and the table of the drive, if kept."""

    day: Day
    run: Run
    outcome: DayOutcome
    looks: Sequence[DriverLook]
    table: DriveTable | None = None

    @cached_property
    def seconds(self) -> tuple[tuple[PlantState, DriverLook], ...]:
        """The state and the driver's first look of every second."""
        return tuple(zip(self.run.states, self.looks[::LOOKS_A_TICK], strict=False))

    @cached_property
    def moving(self) -> tuple[tuple[PlantState, DriverLook], ...]:
        """The state and the driver's first look of every second that begins with a moving train."""
        return tuple((state, look) for state, look in self.seconds if state.speed_mps > 0)

    @cached_property
    def figures(self) -> Mapping[str, Any]:
        """The figures of the outcome by their names in JSON and in the table of a batch."""
        return self.outcome.as_dict()

    @property
    def moving_min(self) -> float:
        """The time in which the train moved (min)."""
        return len(self.moving) * TICK_S / 60.0

    @property
    def equal_arrival_j(self) -> float:
        """The energy (J) at equal arrival: driven − optimum for the driven times + optimum for the timetable."""
        energies, service = self.outcome.energies, self.day.service
        planned_s = [service.clock_s(one.arrival_ns) - service.clock_s(one.departure_ns) for one in service.timetables]
        fronts = zip(true_fronts(self.day), planned_s, strict=True)
        on_time_j = sum(front.trajectory(time_s).balance.input for front, time_s in fronts)
        return energies.above.difference_j + on_time_j


class JobRecording(NamedTuple):
    """The file in which a job's drive is recorded, and the command for the metadata, with the hash of the inputs."""

    file: Path
    command: str

    @property
    def is_whole(self) -> bool:
        """Whether the recording exists, is not cut off, and was made from the job's inputs."""
        try:
            with self.file.open("rb") as file:
                return any(one.metadata.get("command") == self.command for one in make_reader(file).iter_metadata())
        except (OSError, ValueError, McapError):
            return False


@dataclass(frozen=True, kw_only=True)
class AtDesk:
    """The settings of a trial driven by a person: pace, endpoints of simulator and recorder, further metadata."""

    times_real: float
    driver_at: str
    recorder_at: str
    metadata: Mapping[str, str]


def drive(
    trial: StudyTrial,
    population: str,
    record: JobRecording | None = None,
    *,
    keep: bool = False,
    desk: AtDesk | None = None,
) -> Driven:
    """Drive a trial with a participant of a population; `record`: record it; `keep`: keep the table of the drive.

    With `desk`, a person drives the trial, which must be recorded. Raises DasError for files that cannot be used, and
    if the train does not arrive.
    """
    person = trial.person
    day = _day(trial, None if person is None else Participant(population=_population(population), number=person))
    setting = trial.setting
    driver = WatchedDriver(_driver(day, setting, desk))
    how = How(
        driver=setting.driver, friction=setting.friction, advice=setting.presentation, train="train-1",
        command="" if record is None else record.command, screen=setting.screen,
    )  # fmt: skip
    if desk is not None:
        how = replace(how, driver_at=desk.driver_at, recorder_at=desk.recorder_at, paced=True, metadata=desk.metadata)
    out = None if record is None else record.file
    driven = drive_day(day, driver, how, out, keep=keep)
    # A person does not repeat a drive because of one lost message; `das-sim check` reports the loss.
    if desk is None and driven.traffic is not None and driven.traffic.lost:
        raise DasError(f"{out}: {driven.traffic.lost} messages were lost")
    run, table = driven.run, driven.table
    if keep and out is not None:
        table = DriveTable.of(open_recording(out))
    return Driven(day=day, run=run, outcome=outcome(day, run, setting.driver), looks=driver.looks, table=table)


def _driver(day: Day, setting: Setting, desk: AtDesk | None) -> Driver:
    if desk is not None:
        return ExternalDriver(day, times_real=desk.times_real, patience=AT_THE_DESK)
    if setting.driver is DESK:
        raise DasError(f"driver = {DESK}: people drive these trials, with das-sim experiment desk")
    return day.driver(setting.driver, setting.friction)


def service_of(setting: Setting) -> Service:
    """The service of a setting: line, train, timetable and solved sections.

    Timetable and optimum belong to the true train, whatever losses the advice is planned with. Raises DasError for
    files that cannot be used.
    """
    scenario = setting.read_scenario()
    own = _solved(scenario, None)
    if setting.loss_level is None or setting.loss_level == own.level:
        return own
    _, true_level = scenario.truth.train(own.vehicle, own.level)
    fixed = replace(scenario, truth=replace(scenario.truth, level=true_level))
    planned = _solved(fixed, setting.loss_level)
    times_s = [(table.arrival_ns - table.departure_ns) * NS for table in own.timetables]
    service = replace(
        planned,
        timetables=own.timetables,
        planned=tuple(front.trajectory(time_s) for front, time_s in zip(planned.fronts, times_s, strict=True)),
    )
    if scenario.truth.is_as_planned:
        service.true_fronts[Conditions()] = own.fronts
    return service


def _solved(scenario: Scenario, level: Level | None) -> Service:
    """The scenario's service, planned with a level of losses (None: the vehicle's default)."""
    for i, (kept_level, service) in enumerate(_services):
        if kept_level == level and service.plans(scenario):
            _services.append(_services.pop(i))
            for _, other in _services[:-1]:
                other.true_fronts.clear()
                other.braking_fronts.clear()
            return service.on(scenario)
    solved = prepare_service(scenario, level=level)
    _services.append((level, solved))
    del _services[:-LINES_KEPT]
    return solved.on(scenario)


def _day(trial: StudyTrial, who: Participant | None) -> Day:
    """The day of a trial, with the participant's random stream, the trips made before, and the design's parameters."""
    day = make_day(service_of(trial.setting), trial.seed, who)
    human, scenario = day.human, day.service.scenario
    if trial.trips is not None:
        if "trips" in scenario.human.given:
            expected = "expected none, because the design counts trips (learning)"
            raise DasError(f"{scenario.source}: human.trips: {expected}")
        human = human.after(trial.trips)
    decided: dict[str, Any] = dict(trial.setting.human)
    return replace(day, stream=trial.stream, human=replace(human, **decided))
