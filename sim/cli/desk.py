"""The command desk: drive a simulated train in the browser, or look at a recorded drive as its driver saw it."""

from __future__ import annotations

import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from das.advice.wording import Language
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
from das.command_line.printing import busy, loading_solver, say
from das.domain.errors import DasError
from sim.cli.driving import (
    DayAsked,
    RecordingAsked,
    check_not_an_input,
    check_run_outputs,
    drive_recorded,
    prepared_day,
    tell_result,
)
from sim.cli.options import AdviceOption, JourneyOption, check_packages, new_recording, removed_if_unused
from sim.drivers.kinds import DESK, Presentation
from sim.options import OfTrainOption, SpeedOption, speed_factor, typed_command

if TYPE_CHECKING:
    from sim.world.over_bus import How
    from sim.world.scenario import Scenario

USUAL_SCENARIO: Final = "clear-day"
MOST_NOTCHES: Final = 20


WhatArgument = Annotated[
    str,
    typer.Argument(
        metavar="[SCENARIO|RECORDING]",
        help="Bundled scenario (das-sim scenarios lists them) or TOML file to drive; or recording (.mcap) to see.",
    ),
]
AtOption = Annotated[
    str | None,
    typer.Option("--at", metavar="TIME", help="Recording: begin here, 12:34 on the drive's clock.", show_default=False),
]


@dataclass(frozen=True, kw_only=True)
class DeskLooks:
    """Options on how the desk looks, and where it is found."""

    language: Annotated[
        Language, typer.Option("--language", help="The language of the page at first; a key changes it.")
    ] = Language.EN
    opens: Annotated[
        bool, typer.Option("--open/--no-open", help="Open a browser, or print the address alone on a line.")
    ] = True
    port: Annotated[
        int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="Port of the page (0: a free one).")
    ] = 0
    notches: Annotated[
        int,
        typer.Option("--notches", metavar="N", min=0, max=MOST_NOTCHES, help="Steps of the lever each way; 0: none."),
    ] = 10
    punctuality: Annotated[
        bool, typer.Option("--punctuality/--no-punctuality", help="Say on the page how late the train is.")
    ] = True


def desk(
    looks: DeskLooks,
    what: WhatArgument = USUAL_SCENARIO,
    journey: JourneyOption = None,
    advice: AdviceOption = Presentation.COACH,
    seed: SeedOption = 0,
    speed: SpeedOption = "real",
    out: OutRecordingOption = None,
    overwrite: OverwriteOption = False,
    level: LevelOption = None,
    train: TrainOption = DEFAULT_TRAIN,
    bus: BusFolderOption = None,
    insecure_bus: InsecureBusOption = False,
    at: AtOption = None,
    of_train: OfTrainOption = None,
    as_json: JsonOption = False,
) -> None:
    """Drive a simulated train yourself, in the browser; or look at a drive as its driver saw it.

    The advice node runs beside it, and everything is recorded. A recording plays on the same page, at any speed.
    """
    if Path(what).suffix == ".mcap":
        if out is not None:
            raise DasError(f"--out: {what} is a recording to look at; nothing is recorded")
        _look_at(Path(what), of_train, at, looks)
        return
    if at is not None or of_train is not None:
        raise DasError(f"--at and --of-train: {what} is a scenario; expected a recording (.mcap)")
    asked = DayAsked(scenario=what, journey=journey, seed=seed, level=level, advice=advice, train=train)
    recorded = RecordingAsked(out=out, overwrite=overwrite, bus=bus, insecure_bus=insecure_bus, as_json=as_json)
    factor = speed_factor(speed)
    if factor is None:
        raise DasError("--speed max: a person needs a pace; expected real or a number of times real time")
    drive_at_desk(asked, recorded, factor, looks)


def _look_at(path: Path, train: str | None, at: str | None, looks: DeskLooks) -> None:
    """Show a recording until Ctrl-C."""
    _check_packages()
    with loading_solver():
        from sim.desk.host import address_of, listening, new_token
        from sim.desk.replay import Replay, play
        from sim.drive.drive import Drive
        from sim.recording.opening import open_recording

    with busy(f"reading {path} …"):
        replay = Replay(Drive(source=open_recording(path, train)), str(looks.language), at=at)
    token = new_token()
    with listening(looks.port) as door:
        _show(address_of(door, token), looks)
        say("the page is there until Ctrl-C")
        play(replay, door, token)


def drive_at_desk(asked: DayAsked, recorded: RecordingAsked, speed: float, looks: DeskLooks) -> None:
    """Simulate a day that a person drives in the browser, and print the result.

    The page is there first. Line and train are prepared while the person reads it, and the run begins when the person
    is ready.
    """
    check_run_outputs(False, recorded.out, recorded.bus, overwrite=recorded.overwrite)
    _check_packages()
    from das.bus.access import Role
    from das.bus.config import bus_folder
    from das.bus.session import endpoint, free_ports
    from das.bus.topics import check_train_name
    from sim.desk.host import DeskHost, listening, new_token
    from sim.desk.messages import DeskGiven
    from sim.world.scenario import load_scenario
    from sim.world.service import lay_out

    files = bus_folder(recorded.bus, recorded.insecure_bus, check_train_name(asked.train))
    read = load_scenario(asked.scenario)
    read = read if asked.journey is None else read.timed_by(asked.journey)
    check_not_an_input(recorded.out, read)
    lay_out(read, level=asked.level)  # what cannot be driven is refused before anybody sees a page
    places = [endpoint(port) for port in free_ports(2)]
    given = DeskGiven(
        door=-1, token=new_token(), scenario=str(read.source), journey=asked.journey, train=asked.train,
        language=str(looks.language), notches=looks.notches, punctuality=looks.punctuality,
        connect=() if files else tuple(places), bus=None if files is None else str(files.file(Role.DESK).path),
        insecure_bus=recorded.insecure_bus,
    )  # fmt: skip
    from sim.world.over_bus import How

    how = How(
        driver=DESK, advice=asked.advice, train=asked.train, command=typed_command(), bus=files,
        driver_at=places[0], recorder_at=places[1], paced=True,
    )  # fmt: skip
    reserved = new_recording("desk") if recorded.out is None else None
    with removed_if_unused(reserved), DeskHost(given, listening(looks.port)) as host:
        _show(host.address, looks)
        _drive(asked, read, how, recorded, reserved or recorded.out, speed)


def _drive(asked: DayAsked, read: Scenario, how: How, recorded: RecordingAsked, out: Path | None, speed: float) -> None:
    """Prepare the day while the person reads the page, then let the person drive it."""
    with loading_solver():
        from das.cab.warm_up import warm_up
        from sim.world.external import AT_THE_DESK, ExternalDriver

        warm_up()
    day = prepared_day(read, asked.level, asked.seed)
    driver = ExternalDriver(day, times_real=speed, patience=AT_THE_DESK)
    tell_result(drive_recorded(day, driver, how, out, speed), recorded.as_json)


def _check_packages() -> None:
    check_packages("desk", "starlette", "uvicorn", "websockets", "msgspec")


def _show(address: str, looks: DeskLooks) -> None:
    """Open the page, or print its address alone on a line; the address is a secret of this run."""
    if not looks.opens:
        print(address, flush=True)
        return
    say(f"the page: {address}")
    if not webbrowser.open(address):
        say("no browser could be opened: open the address yourself, on this machine")
