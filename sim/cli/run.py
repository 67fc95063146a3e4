"""The command run, which simulates one day, or is the driver of one."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

from das.command_line.application import is_given, refuse_given
from das.command_line.options import JsonOption
from das.command_line.printing import loading_solver, one_line, say, typed
from das.domain.errors import DasError
from sim.cli.driving import DayAsked, RecordingAsked, drive_recorded, prepared_day, scenario_asked, tell_result
from sim.cli.options import (
    DEFAULT_DRIVER_AT,
    CardsOption,
    DriverAtOption,
    DriverOption,
    FrictionOption,
    InProcessOption,
    OnlyDriverOption,
    ScenarioArgument,
    new_recording,
    removed_if_unused,
)
from sim.drivers.kinds import (
    DESK,
    EXTERNAL,
    DriverKind,
    DriverName,
    External,
    FrictionPolicy,
    named_driver,
)
from sim.options import (
    LATE_KERNELS,
    PaceOption,
    ParticipantOption,
    PopulationOption,
    pace_factor,
    typed_command,
)

if TYPE_CHECKING:
    from sim.drive.table import DriveTable
    from sim.world.driving import How
    from sim.world.external import ExternalDriver
    from sim.world.service import Day

OF_THE_RUN: Final = (
    *("--advice", "--level", "--journey", "--out", "--overwrite", "--friction", "--pace", "--in-process", "--cards"),
    "--json",
)
"""Options that whoever only drives a run cannot have."""


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
    only_driver: OnlyDriverOption = False,
    cards: CardsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate a day: a train, its driver and the advice node in a closed loop, everything recorded."""
    who, factor = named_driver("--driver", driver), pace_factor(pace)
    if only_driver:
        _only_drive(scenario, (who, participant, population), asked, recorded, driver_at or DEFAULT_DRIVER_AT)
        return
    if who is DESK:
        raise DasError(f"--driver {DESK}: a person drives at the desk: run das-sim desk {scenario}")
    _check_given(who, in_process=in_process, as_json=as_json)
    recorded.check()
    listens = _driver_at(who, in_process, recorded.bus, driver_at)
    with loading_solver(LATE_KERNELS):
        from das.cab.cab import warm_up
        from sim.drivers.own_class import driver_versions
        from sim.drivers.parameters import participant_of
        from sim.world.driving import How

        driver_versions(who)
        person = participant_of(who, participant, population)
        files = recorded.folder(asked.train)
        read = scenario_asked(scenario, asked.journey, recorded.out)
        warm_up()
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
    """Raise DasError for options that would have no effect."""
    if who is not DriverKind.HUMAN:
        refuse_given(f"needs --driver {DriverKind.HUMAN}", "--friction")
    if in_process:
        refuse_given("a run --in-process records nothing", "--out", "--overwrite")
        refuse_given("a run --in-process has no bus", "--bus", "--insecure-bus", "--train")
    if as_json:
        refuse_given("--json prints no cards", "--cards")


def _print_cards(kept: DriveTable | None, recorded: Path | None) -> None:
    """Print what the driver saw, a line for each other instruction or reason, and the node's log in between."""
    from itertools import groupby

    from sim.drive.table import DriveTable
    from sim.recording.opening import open_recording
    from sim.review.words import cards

    assert kept is not None or recorded is not None
    table = kept if kept is not None or recorded is None else DriveTable.of(open_recording(recorded))
    assert table is not None
    changes = (next(same) for _, same in groupby(cards(table), lambda card: card.said))
    said = [(card.time_ns, card.line) for card in changes]
    said += [(line.time_ns, f"  {line.words}") for line in table.said.node]
    for time_ns, text in sorted(said, key=lambda one: one[0]):
        print(f"{table.clock.of_day(time_ns)}  {text}")


def _driver_at(driver: DriverName, in_process: bool, bus: Path | None, endpoint: str | None) -> str | None:
    """Where the run listens for an external driver, None if it has none; DasError if the options contradict that."""
    if driver is not EXTERNAL:
        refuse_given(f"needs --driver {EXTERNAL}", "--driver-at")
        return None
    if in_process:
        raise DasError("--driver external: a run --in-process has no bus")
    if bus is not None:
        refuse_given("with --bus the bus file sets where the run listens", "--driver-at")
    return DEFAULT_DRIVER_AT if endpoint is None else endpoint


def _external(day: Day, how: How, factor: float | None) -> ExternalDriver:
    """The external driver, a process of its own; prints the command that starts it."""
    from sim.world.external import ExternalDriver

    where = f"--bus {how.bus.path}" if how.bus is not None else f"--driver-at {how.driver_at}"
    scenario = shlex.quote(str(day.service.scenario.source))
    command = f"{typed('das-sim')} run {scenario} --only-driver --train {how.train} {where}"
    print(one_line(f"the run waits for its driver, for example: {command}"), file=sys.stderr)
    return ExternalDriver(day, times_real=factor)


def _only_drive(
    scenario: str, who: tuple[DriverName, int | None, str | None], asked: DayAsked, recorded: RecordingAsked, at: str
) -> None:
    """Be the driver of a run that waits elsewhere; DasError for options that only a run has."""
    driver, participant, population = who
    if isinstance(driver, External):
        raise DasError(f"--driver {driver}: this is the external driver; expected who drives in it")
    refuse_given("the run decides that, not its driver", *OF_THE_RUN)
    with loading_solver():
        from das.bus.access import Role
        from das.bus.config import BusFolder, bus_options
        from das.bus.session import Bus
        from sim.drivers.drivers import make_driver
        from sim.drivers.knowledge import LineKnowledge
        from sim.drivers.parameters import participant_of, stream_of
        from sim.world.external import HEARD, answer_looks, warm_up
        from sim.world.scenario import load_scenario
        from sim.world.service import lay_out

        read = load_scenario(scenario)
        route, vehicle, _ = lay_out(read)
        line = LineKnowledge(route=route, vehicle=vehicle)
        person = participant_of(driver, participant, population)
        parameters, _ = read.human.of(asked.seed, person, read.source)
        made = make_driver(driver, line, parameters=parameters, seed=asked.seed, stream=stream_of(person))
        warm_up(line)
    bus, insecure = recorded.bus, recorded.insecure_bus
    folder = None if bus is None else BusFolder(bus, insecure).file(Role.DRIVER).path
    file = bus_options(folder, insecure, None, [at] if is_given("--driver-at") else None)
    there = [] if file is not None else [at]
    with Bus(asked.train, connect=there, hear=HEARD, file=file) as opened:
        say(f"{driver} waits for the run of train {asked.train} at {there[0] if there else bus}")
        looks = answer_looks(opened, made, lambda: say("the run has begun"))
    say(f"the run is over; looks answered: {looks}")
