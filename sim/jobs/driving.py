"""How a job drives its day: with a service that is solved once, in this process or over the bus with a recording."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from mcap.exceptions import McapError
from mcap.reader import make_reader

from das.domain.errors import DasError
from das.domain.losses import Level
from sim.drivers.cab import Driver
from sim.drivers.presentations.presenter import presenter_of
from sim.world.day import Day
from sim.world.in_process import InProcess
from sim.world.loop import Run, World
from sim.world.over_bus import How, make_crew, run_over_bus
from sim.world.scenario import Scenario
from sim.world.service import Service, prepare_service


class ServiceMemory:
    """Keeps the last few services that a process has solved, because each holds fronts of a hundred megabytes."""

    def __init__(self, most: int = 1) -> None:
        self._most = most
        self._kept: list[tuple[Level | None, Service]] = []

    def of(self, scenario: Scenario, level: Level | None) -> Service:
        """The scenario's service, planned with a level of losses [the vehicle's].

        Raises DasError for anything unusable, InfeasibleError where the train cannot run.
        """
        for i, (kept_level, service) in enumerate(self._kept):
            if kept_level == level and service.plans(scenario):
                self._kept.append(self._kept.pop(i))
                return service.on(scenario)
        solved = prepare_service(scenario, level=level)
        self._kept = [*self._kept, (level, solved)][-self._most :]
        return solved.on(scenario)


class JobRecording(NamedTuple):
    """Where a job's drive is recorded, and the command that the recording names, with the hash of the job's inputs."""

    file: Path
    command: str

    @property
    def is_whole(self) -> bool:
        """Whether the recording is there, not cut off, and made from the job's inputs."""
        try:
            with self.file.open("rb") as file:
                return any(one.metadata.get("command") == self.command for one in make_reader(file).iter_metadata())
        except (OSError, ValueError, McapError):
            return False


def drive_day(day: Day, driver: Driver, how: How, out: Path | None) -> Run:
    """Let a driver drive a day in this process, or, where it is recorded in the file `out`, over the bus.

    Raises DasError where the train does not get there, or where the recording lacks messages.
    """
    if out is None:
        link = InProcess(day.service, coach=presenter_of(how.advice).needs_coach)
        return World(day, driver, how.advice, link, how.screen).run()
    run, traffic = run_over_bus(day, driver, how.advice, make_crew(day, how, out), screen=how.screen)
    if traffic.lost:
        raise DasError(f"{out}: {traffic.lost} messages were lost")
    return run
