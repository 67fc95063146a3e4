"""The command desk: drive a simulated train in the browser, watch one on the bus, or view a recorded drive."""

from __future__ import annotations

import os
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from das.advice.wording import Language
from das.command_line.application import refuse_given
from das.command_line.options import NODE_ENDPOINT, ConnectOption, JsonOption
from das.command_line.printing import busy, loading_solver, say
from das.domain.errors import DasError
from sim.cli.options import check_packages, new_recording, removed_if_unused
from sim.cli.run import DayAsked, RecordingAsked, drive_recorded, prepared_day, scenario_asked, tell_result
from sim.drivers.kinds import DESK, Presentation
from sim.options import MOST_NOTCHES, OfTrainOption, PaceOption, pace_factor, typed_command

if TYPE_CHECKING:
    from sim.world.driving import How
    from sim.world.outcome import DayResult
    from sim.world.scenario import Scenario

USUAL_SCENARIO: Final = "clear-day"
PUBLISHER_ENDPOINT: Final = "tcp/127.0.0.1:7448"
"""Endpoint at which the examples' publishers of journey and position listen."""
OF_A_DRIVE: Final = ("--journey", "--seed", "--level", "--pace", "--notches", "--lsl", "--out", "--overwrite", "--json")
"""Options for driving at the desk only: rejected when viewing a recording or watching a train."""
OF_THE_BUS: Final = ("--advice", "--train", "--punctuality", "--bus", "--insecure-bus")
"""Options for driving that also apply to --watch."""
OF_A_WATCH: Final = ("--route", "--vehicle", "--connect")

WhatArgument = Annotated[
    str,
    typer.Argument(
        metavar="[SCENARIO|RECORDING]",
        help="Bundled scenario (das-sim list scenarios lists them) or TOML file to drive; or recording (.mcap) to see.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class WatchAsked:
    """Options for watching a train."""

    watch: Annotated[bool, typer.Option("--watch", help="Show a train on the bus; nothing is driven.")] = False
    route: Annotated[str | None, typer.Option("--route", metavar="ROUTE", help="--watch: the node's route.")] = None
    vehicle: Annotated[
        str | None, typer.Option("--vehicle", metavar="VEHICLE", help="--watch: the node's vehicle.")
    ] = None
    connect: ConnectOption = None


@dataclass(frozen=True, kw_only=True)
class SessionLooks:
    """Options for the language, the address and the streams of the page."""

    language: Annotated[Language, typer.Option("--language", help="The language of the page.")] = Language.EN
    opens: Annotated[bool, typer.Option("--open/--no-open", help="Open a browser, or only print the address.")] = True
    port: Annotated[
        int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="Port of the page (0: a free one).")
    ] = 0
    lsl: Annotated[
        bool, typer.Option("--lsl", help="Also stream lever, marks and cab over LSL, to the whole local network.")
    ] = False


@dataclass(frozen=True, kw_only=True)
class DeskLooks(SessionLooks):
    """Options for the appearance of the desk and the address of its page."""

    notches: Annotated[
        int,
        typer.Option("--notches", metavar="N", min=0, max=MOST_NOTCHES, help="Lever steps each way; 0: no steps."),
    ] = 10
    punctuality: Annotated[
        bool, typer.Option("--punctuality/--no-punctuality", help="Show on the page how late the train is.")
    ] = True


def desk(
    what: WhatArgument = USUAL_SCENARIO,
    *,
    looks: DeskLooks,
    asked: DayAsked,
    pace: PaceOption = "real",
    recorded: RecordingAsked,
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="TIME", help="Recording: begin here, 12:34 on the drive's clock."),
    ] = None,
    of_train: OfTrainOption = None,
    watched: WatchAsked,
    as_json: JsonOption = False,
) -> None:
    """Drive a simulated train yourself in the browser, replay a drive as its driver saw it, or watch a train.

    In a drive, the advice node runs as well and everything is recorded. Recordings play on the same page, at any pace.
    """
    if watched.watch:
        refuse_given("--watch shows a train on the bus; nothing is driven", *OF_A_DRIVE, "--at", "--of-train")
        if what != USUAL_SCENARIO:
            raise DasError(f"{what}: --watch shows a train on the bus: expected neither a scenario nor a recording")
        _watch(watched, asked, recorded, looks)
        return
    refuse_given("only --watch uses it", *OF_A_WATCH)
    if Path(what).suffix == ".mcap":
        why = f"{what} is a recording to look at; nothing is driven, nothing is recorded"
        refuse_given(why, *OF_A_DRIVE, *OF_THE_BUS)
        _look_at(Path(what), of_train, at, looks)
        return
    refuse_given(f"{what} is a scenario; expected a recording (.mcap)", "--at", "--of-train")
    factor = pace_factor(pace)
    if factor is None:
        raise DasError(f"--pace {pace}: a person needs a pace: expected real or a multiple of real time")
    check_lsl(looks)
    _drive_at_desk(what, asked, recorded, factor, looks, as_json=as_json)


def _watch(watched: WatchAsked, asked: DayAsked, recorded: RecordingAsked, looks: DeskLooks) -> None:
    if watched.route is None or watched.vehicle is None:
        raise DasError("--watch: needs --route and --vehicle, as given to the node")
    if asked.advice not in (Presentation.GUIDE, Presentation.SPEED_AND_EFFORT):
        raise DasError(f"--advice {asked.advice}: expected guide or speed-and-effort, which a node sends")
    _check_packages()
    from das.bus.access import BusFolder, Role
    from das.bus.config import bus_options

    with loading_solver():
        from das.bus.session import Bus
        from das.command_line.files import load_route, load_vehicle
        from sim.desk.host import address_of, listening, new_token
        from sim.desk.messages import PageSettings
        from sim.desk.watch import HEARD, WatchedTrain, watch

        train = WatchedTrain(load_route(watched.route), load_vehicle(watched.vehicle), asked.advice)
    folder = None if recorded.bus is None else BusFolder(recorded.bus).file(Role.CAB).path
    file = bus_options(folder, recorded.insecure_bus, None, watched.connect)
    connect = watched.connect or [NODE_ENDPOINT, PUBLISHER_ENDPOINT]
    bus, token = Bus(asked.train, connect=connect, hear=HEARD, file=file), new_token()
    with listening(looks.port) as door:
        show_page(address_of(door, token), opens=looks.opens)
        say(f"the page shows {asked.train} until Ctrl-C")
        watch(train, bus, (str(looks.language), PageSettings(punctuality=looks.punctuality)), door, token)


def _look_at(path: Path, train: str | None, at: str | None, looks: DeskLooks) -> None:
    _check_packages()
    with loading_solver():
        from sim.desk.host import address_of, listening, new_token
        from sim.desk.replay import Replay, play
        from sim.drive.drive import Drive
        from sim.recording.opening import open_recording

    with busy(f"reading {path} …"):
        replay = Replay(Drive(recording=open_recording(path, train)), str(looks.language), at=at)
    token = new_token()
    with listening(looks.port) as door:
        show_page(address_of(door, token), opens=looks.opens)
        say("the page is open until Ctrl-C")
        play(replay, door, token)


def _drive_at_desk(
    name_or_path: str, asked: DayAsked, recorded: RecordingAsked, factor: float, looks: DeskLooks, *, as_json: bool
) -> None:
    """Simulate a run that a person drives in the browser; the page opens before line and train are prepared."""
    recorded.check()
    _check_packages()
    if os.name != "posix":
        raise DasError("desk: driving works on Linux and macOS only: expected --watch on this system")
    from das.bus.access import Role
    from das.bus.session import endpoint, free_ports
    from sim.desk.host import DeskHost, listening, new_token
    from sim.desk.messages import DeskBus, DeskGiven, PageSettings
    from sim.world.driving import How
    from sim.world.service import lay_out

    files = recorded.folder(asked.train)
    read = scenario_asked(name_or_path, asked.journey, recorded.out)
    # A run that cannot be driven is rejected before a page opens.
    lay_out(read, level=asked.level)
    own = None if files is None else files.file(Role.DESK)
    if own is not None:
        own.config(asked.train)
    places = [endpoint(port) for port in free_ports(2)]
    page = PageSettings(notches=looks.notches, punctuality=looks.punctuality)
    bus = DeskBus(
        train=asked.train, connect=() if files else tuple(places), file=None if own is None else str(own.path),
        insecure=recorded.insecure_bus, lsl=asked.train if looks.lsl else "",
    )  # fmt: skip
    given = DeskGiven(
        door=-1, token=new_token(), scenario=str(read.source), journey=asked.journey,
        language=str(looks.language), bus=bus, page=page,
    )  # fmt: skip
    how = How(
        driver=DESK, advice=asked.advice, train=asked.train, command=typed_command(), bus=files,
        driver_at=places[0], recorder_at=places[1], paced=True, metadata=page.metadata,
    )  # fmt: skip
    reserved = new_recording("desk") if recorded.out is None else None
    with removed_if_unused(reserved), DeskHost(given, listening(looks.port)) as host:
        show_page(host.address, opens=looks.opens)
        tell_result(_driven(read, asked, how, reserved or recorded.out, factor), as_json)


def _driven(read: Scenario, asked: DayAsked, how: How, out: Path | None, factor: float) -> DayResult:
    with loading_solver():
        from das.solver.warm_up import warm_up
        from sim.world.external import AT_THE_DESK, ExternalDriver

        warm_up()
    day = prepared_day(read, asked)
    return drive_recorded(day, ExternalDriver(day, times_real=factor, patience=AT_THE_DESK), how, out, factor)


def check_lsl(looks: SessionLooks) -> None:
    """Raise DasError if streams over LSL are asked for, but the library is missing."""
    if looks.lsl:
        from sim.desk.lsl import lsl_library

        lsl_library()


def _check_packages() -> None:
    check_packages("desk", "starlette", "uvicorn", "websockets", "msgspec")


def show_page(address: str, *, opens: bool) -> None:
    """Open the page, or only print its address, which contains the secret token of this run."""
    if not opens:
        print(address, flush=True)
        return
    say(f"the page: {address}")
    if not webbrowser.open(address):
        say("no browser could be opened: open the address yourself, on this machine")
