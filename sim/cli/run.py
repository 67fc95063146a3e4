"""The command run, which simulates one day."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from das.command_line.given import refuse_given
from das.command_line.options import JsonOption
from das.command_line.printing import loading_solver, one_line
from das.domain.errors import DasError
from sim.cli.driving import DayAsked, RecordingAsked, drive_recorded, prepared_day, scenario_asked, tell_result
from sim.cli.options import (
    DEFAULT_DRIVER_AT,
    CardsOption,
    DriverAtOption,
    DriverOption,
    FrictionOption,
    InProcessOption,
    ScenarioArgument,
    new_recording,
    removed_if_unused,
)
from sim.drivers.kinds import (
    DESK,
    EXTERNAL,
    DriverKind,
    DriverName,
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
    """Simulate a day: a train, its driver and the advice node in a closed loop, everything recorded."""
    who, factor = named_driver("--driver", driver), pace_factor(pace)
    if who is DESK:
        raise DasError(f"--driver {DESK}: a person drives at the desk: run das-sim desk {scenario}")
    _check_given(who, in_process=in_process, as_json=as_json)
    recorded.check()
    listens = _driver_at(who, in_process, recorded.bus, driver_at)
    with loading_solver(LATE_KERNELS):
        from das.cab.warm_up import warm_up
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
    """The external driver, a process of its own; says where the run waits for it."""
    from sim.world.external import ExternalDriver

    where = how.bus.path if how.bus is not None else how.driver_at
    print(one_line(f"train {how.train} waits for its driver at {where}"), file=sys.stderr)
    return ExternalDriver(day, times_real=factor)
