"""The command run, which simulates one run, and the parts that the command desk shares."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from das.command_line.application import refuse_given
from das.command_line.files import check_outputs
from das.command_line.options import (
    DEFAULT_TRAIN,
    BusFolderOption,
    InsecureBusOption,
    JsonOption,
    LevelOption,
    OutRecordingOption,
    OverwriteOption,
    SeedOption,
    TrainOption,
)
from das.command_line.printing import busy, loading_solver, one_line, progress_bar
from das.domain.errors import DasError
from das.domain.units import KM
from sim.cli.options import FrictionOption, naming_recorded, new_recording, removed_if_unused
from sim.drivers.kinds import DESK, EXTERNAL, DriverKind, DriverName, FrictionPolicy, Presentation, named_driver
from sim.options import LATE_KERNELS, PaceOption, ParticipantOption, PopulationOption, pace_factor, typed_command

if TYPE_CHECKING:
    from das.bus.access import BusFolder
    from sim.drive.table import DriveTable
    from sim.drivers.cab import Driver
    from sim.drivers.parameters import Participant
    from sim.world.driving import How
    from sim.world.external import ExternalDriver
    from sim.world.outcome import DayResult
    from sim.world.scenario import Scenario
    from sim.world.service import Day

DEFAULT_DRIVER_AT: Final = "tcp/127.0.0.1:7450"
"""Endpoint at which a run listens for an external driver."""
DriverOption = Annotated[
    str,
    typer.Option(
        "--driver",
        metavar="DRIVER",
        help="The driver: perfect, literal, fast, top-speed, timetable, human, a class of your own "
        "(package.module:Class), or external, a separate process (explained by das-sim list drivers).",
    ),
]
AdviceOption = Annotated[Presentation, typer.Option("--advice", help="What the driver's display shows.")]
DriverAtOption = Annotated[
    str | None,
    typer.Option(
        "--driver-at",
        metavar="ENDPOINT",
        help=f"Where a run listens for an external driver [default: {DEFAULT_DRIVER_AT}].",
    ),
]
ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="Bundled scenario (das-sim list scenarios lists them) or TOML file.")
]
JourneyOption = Annotated[
    str | None,
    typer.Option(
        "--journey",
        metavar="FILE",
        help="Stops, dwells, passings and times of a journey file, or of a bundled journey, instead of the scenario's; "
        "the times count on the day of the scenario's departure.",
    ),
]
InProcessOption = Annotated[
    bool, typer.Option("--in-process", help="Run without bus and recording: the same on-board system in this process.")
]
CardsOption = Annotated[
    bool, typer.Option("--cards", help="Also print what the driver saw, a card for each change, and the node's log.")
]


@dataclass(frozen=True, kw_only=True)
class DayAsked:
    """Options for the run to simulate, apart from the scenario."""

    journey: JourneyOption = None
    advice: AdviceOption = Presentation.GUIDE
    seed: SeedOption = 0
    level: LevelOption = None
    train: TrainOption = DEFAULT_TRAIN


@dataclass(frozen=True, kw_only=True)
class RecordingAsked:
    """Options for the recording and the bus of the run."""

    out: OutRecordingOption = None
    overwrite: OverwriteOption = False
    bus: BusFolderOption = None
    insecure_bus: InsecureBusOption = False

    def check(self) -> None:
        """Raise DasError if the recording cannot be written."""
        check_outputs(self.out, overwrite=self.overwrite)

    def folder(self, train: str) -> BusFolder | None:
        """The folder of bus files for a train; raises DasError for a bad folder or an impossible name of a train."""
        from das.bus.access import bus_folder
        from das.bus.topics import check_train_name

        return bus_folder(self.bus, self.insecure_bus, check_train_name(train))


def scenario_asked(name_or_path: str, journey: str | None, out: Path | None) -> Scenario:
    """The scenario with its journey; raises DasError if the recording would replace a file that is read."""
    from sim.world.scenario import load_scenario
    from sim.world.service import scenario_files

    scenario = load_scenario(name_or_path, journey)
    for what, path in scenario_files(scenario).items():
        if out is not None and out.resolve() == path.resolve():
            raise DasError(f"{out}: the recording to write would replace the {what.replace('_', ' ')} that is read")
    return scenario


def prepared_day(scenario: Scenario, asked: DayAsked, person: Participant | None = None) -> Day:
    """The run of a seed, with its sections solved; prints warnings about unusual values of line and train."""
    from das.command_line.files import warn_once, warn_unusual
    from sim.world.service import make_day, prepare_service

    with busy("solving the sections …"):
        day = make_day(prepare_service(scenario, level=asked.level), asked.seed, person)
        warn_unusual(day.service.route, day.service.vehicle, day.plant.vehicle)
        warn_once(*day.service.unkept())
    return day


def drive_recorded(day: Day, driver: Driver, how: How, out: Path | None, speed: float | None) -> DayResult:
    """Simulate the run: over the bus if a recording is written, else in this process, keeping the drive's table."""
    from sim.world.disturbances import described
    from sim.world.driving import drive_day
    from sim.world.outcome import DayResult, outcome

    try:
        title = f"{day.service.scenario.id}, {how.driver}"
        first = "starting node and recorder" if out else "driving"
        with naming_recorded(out), progress_bar(title, first, "km") as progress:
            pace = _Pace(None if how.paced else speed, progress)  # only the external driver waits at a pace
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
        """Time (s) since the end of the first tick, before which node and recorder are still starting."""
        return self._now - self._began

    def tick(self, done_m: float, all_m: float) -> None:
        """Count one simulated second, and wait until it has passed at the wanted pace."""
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


def run(
    scenario: ScenarioArgument,
    *,
    driver: DriverOption = DriverKind.HUMAN,
    asked: DayAsked,
    friction: FrictionOption = FrictionPolicy.AS_MEASURED,
    pace: PaceOption = "max",
    recorded: RecordingAsked,
    in_process: InProcessOption = False,
    participant: ParticipantOption = None,
    population: PopulationOption = None,
    driver_at: DriverAtOption = None,
    cards: CardsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate a run: a train, its driver and the advice node in a closed loop, everything recorded."""
    who, factor = named_driver("--driver", driver), pace_factor(pace)
    if who is DESK:
        raise DasError(f"--driver {DESK}: a person drives at the desk: run das-sim desk {scenario}")
    _check_given(who, in_process=in_process, as_json=as_json)
    recorded.check()
    listens = _driver_at(who, in_process, recorded.bus, driver_at)
    with loading_solver(LATE_KERNELS):
        from das.solver.warm_up import warm_up
        from sim.drivers.own_class import driver_versions
        from sim.drivers.parameters import participant_of
        from sim.world.driving import How

        driver_versions(who)
        person = participant_of(who, participant, population)
        files = recorded.folder(asked.train)
        read = scenario_asked(scenario, asked.journey, recorded.out)
        warm_up()
        if in_process:  # otherwise the cab is in the node, which loads its code while it starts
            from das.cab.cab import warm_up as warm_up_cab

            warm_up_cab()
    day, paced = prepared_day(read, asked, person), who is EXTERNAL and factor is not None
    reserved = new_recording("run") if recorded.out is None and not in_process else None
    how = How(driver=who, friction=friction, advice=asked.advice, train=asked.train, command=typed_command(), bus=files,
              driver_at=listens, paced=paced)  # fmt: skip
    made = _external(day, how, factor) if who is EXTERNAL else day.driver(who, friction)
    with removed_if_unused(reserved):
        found = drive_recorded(day, made, how, out := recorded.out or reserved, factor)
        tell_result(found, as_json)
        if cards:
            _print_cards(found.table, out)


def _check_given(who: DriverName, *, in_process: bool, as_json: bool) -> None:
    if who is not DriverKind.HUMAN:
        refuse_given(f"needs --driver {DriverKind.HUMAN}", "--friction")
    if in_process:
        refuse_given("a run --in-process records nothing", "--out", "--overwrite")
        refuse_given("a run --in-process has no bus", "--bus", "--insecure-bus", "--train")
    if as_json:
        refuse_given("--json prints no cards", "--cards")


def _print_cards(table: DriveTable | None, recorded: Path | None) -> None:
    """Print what the driver saw, a line for each change of instruction or reason, and the node's log in between."""
    from itertools import groupby

    from sim.drive.table import DriveTable
    from sim.recording.opening import open_recording
    from sim.review.words import cards

    if table is None:
        assert recorded is not None
        table = DriveTable.of(open_recording(recorded))
    changes = (next(same) for _, same in groupby(cards(table), lambda card: card.said))
    said = [(card.time_ns, card.line) for card in changes]
    said += [(line.time_ns, f"  {line.words}") for line in table.said.node]
    for time_ns, text in sorted(said, key=lambda one: one[0]):
        print(f"{table.clock.of_day(time_ns)}  {text}")


def _driver_at(driver: DriverName, in_process: bool, bus: Path | None, endpoint: str | None) -> str | None:
    """The endpoint for an external driver; None without one. Raises DasError if the options contradict each other."""
    if driver is not EXTERNAL:
        refuse_given(f"needs --driver {EXTERNAL}", "--driver-at")
        return None
    if in_process:
        raise DasError("--driver external: a run --in-process has no bus")
    if bus is not None:
        refuse_given("with --bus the bus file sets where the run listens", "--driver-at")
    return DEFAULT_DRIVER_AT if endpoint is None else endpoint


def _external(day: Day, how: How, factor: float | None) -> ExternalDriver:
    """The external driver, in a separate process; prints the endpoint at which the run waits for it."""
    from sim.world.external import ExternalDriver

    where = how.bus.path if how.bus is not None else how.driver_at
    print(one_line(f"train {how.train} waits for its driver at {where}"), file=sys.stderr)
    return ExternalDriver(day, times_real=factor)
