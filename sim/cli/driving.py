"""What the commands run and desk share: options on the day and its recording, the recorded drive, and its result."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from das.command_line.files import check_outputs
from das.command_line.options import (
    DEFAULT_TRAIN,
    BusFolderOption,
    InsecureBusOption,
    LevelOption,
    OutRecordingOption,
    OverwriteOption,
    SeedOption,
    TrainOption,
)
from das.command_line.printing import busy, progress_bar
from das.domain.errors import DasError
from das.domain.units import KM
from sim.cli.options import AdviceOption, JourneyOption, naming_recorded
from sim.drivers.kinds import Presentation

if TYPE_CHECKING:
    from das.bus.config import BusFolder
    from sim.drivers.cab import Driver
    from sim.drivers.parameters import Participant
    from sim.world.driving import How
    from sim.world.outcome import DayResult
    from sim.world.scenario import Scenario
    from sim.world.service import Day


@dataclass(frozen=True, kw_only=True)
class DayAsked:
    """Options on the day to simulate, beside its scenario."""

    journey: JourneyOption = None
    advice: AdviceOption = Presentation.GUIDE
    seed: SeedOption = 0
    level: LevelOption = None
    train: TrainOption = DEFAULT_TRAIN


@dataclass(frozen=True, kw_only=True)
class RecordingAsked:
    """Options on where the run is recorded, and over which bus."""

    out: OutRecordingOption = None
    overwrite: OverwriteOption = False
    bus: BusFolderOption = None
    insecure_bus: InsecureBusOption = False

    def check(self) -> None:
        """Raise DasError if the recording cannot be written."""
        check_outputs(self.out, overwrite=self.overwrite)

    def folder(self, train: str) -> BusFolder | None:
        """The folder of bus files for a train; DasError for a bad one, and for a name that no train can have."""
        from das.bus.config import bus_folder
        from das.bus.topics import check_train_name

        return bus_folder(self.bus, self.insecure_bus, check_train_name(train))


def scenario_asked(name_or_path: str, journey: str | None, out: Path | None) -> Scenario:
    """The scenario with its journey; DasError if the recording would replace a file of either."""
    from sim.world.scenario import load_scenario
    from sim.world.service import scenario_files

    scenario = load_scenario(name_or_path, journey)
    for what, path in scenario_files(scenario).items():
        if out is not None and out.resolve() == path.resolve():
            raise DasError(f"{out}: the recording to write would replace the {what.replace('_', ' ')} that is read")
    return scenario


def prepared_day(scenario: Scenario, asked: DayAsked, person: Participant | None = None) -> Day:
    """The day of a seed, with its sections solved; warns of what is unusual about line and train."""
    from das.command_line.files import warn_once, warn_unusual
    from sim.world.service import make_day, prepare_service

    with busy("solving the sections …"):
        day = make_day(prepare_service(scenario, level=asked.level), asked.seed, person)
        warn_unusual(day.service.route, day.service.vehicle, day.plant.vehicle)
        warn_once(*day.service.unkept())
    return day


def drive_recorded(day: Day, driver: Driver, how: How, out: Path | None, speed: float | None) -> DayResult:
    """Run the day: over the bus if there is a recording to write, else in this process, with the table of the drive."""
    from sim.world.disturbances import described
    from sim.world.driving import drive_day
    from sim.world.outcome import DayResult, outcome

    try:
        title = f"{day.service.scenario.id}, {how.driver}"
        first = "starting node and recorder" if out else "driving"
        with naming_recorded(out), progress_bar(title, first, "km") as progress:
            pace = _Pace(None if how.paced else speed, progress)  # at a pace, the external driver alone keeps it
            run, traffic, table = drive_day(day, driver, how, out, pace.tick, keep=out is None)
    except DasError as error:
        if out is None or not out.is_file() or out.stat().st_size == 0:
            raise
        raise DasError(f"{error}; recorded so far: {out}") from error
    return DayResult(
        outcome=outcome(day, run, how.driver),
        driver=how.driver,
        friction=how.friction,
        advice=how.advice,
        happens=described(day.disturbances),
        drawn=day.drawn,
        unkept=tuple(day.service.unkept()),
        wall_s=pace.driven_s,
        file=out,
        traffic=traffic,
        table=table,
    )


class _Pace:
    """Paces a run at a multiple of real time (None: no waiting), and shows its progress."""

    def __init__(self, speed: float | None, progress: Callable[[float, float], None]) -> None:
        self._speed, self._progress = speed, progress
        self._began = self._now = time.perf_counter()
        self._ticks = 0

    @property
    def driven_s(self) -> float:
        """Time (s) since the end of the first tick: node and recorder are still starting before it."""
        return self._now - self._began

    def tick(self, done_m: float, all_m: float) -> None:
        """Count one driven second, and wait until it has passed at the wanted pace."""
        from sim.world.lockstep import sleep_until
        from sim.world.loop import TICK_S

        if self._ticks == 0:
            self._began = time.perf_counter()
        self._ticks += 1
        if self._speed is not None:
            sleep_until(self._began + self._ticks * TICK_S / self._speed)
        self._now = time.perf_counter()
        self._progress(done_m / KM, all_m / KM)


def tell_result(found: DayResult, as_json: bool) -> None:
    """Print the result of a run."""
    from sim.world.outcome import print_result

    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        print_result(found)
