"""The command desk: drive a simulated train in the browser, or view a recorded drive as its driver saw it."""

from __future__ import annotations

import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from das.advice.wording import Language
from das.command_line.application import refuse_given
from das.command_line.options import JsonOption
from das.command_line.printing import busy, loading_solver, say
from das.domain.errors import DasError
from sim.cli.options import check_packages, new_recording, removed_if_unused
from sim.cli.run import DayAsked, RecordingAsked, drive_recorded, prepared_day, scenario_asked, tell_result
from sim.drivers.kinds import DESK
from sim.options import MOST_NOTCHES, OfTrainOption, PaceOption, pace_factor, typed_command

if TYPE_CHECKING:
    from sim.world.driving import How
    from sim.world.outcome import DayResult
    from sim.world.scenario import Scenario

USUAL_SCENARIO: Final = "clear-day"
OF_A_DRIVE: Final = (
    *("--journey", "--advice", "--seed", "--level", "--train", "--pace", "--notches", "--punctuality"),
    *("--out", "--overwrite", "--bus", "--insecure-bus", "--json"),
)
"""The options of a drive at the desk, which a replayed recording does not use."""

WhatArgument = Annotated[
    str,
    typer.Argument(
        metavar="[SCENARIO|RECORDING]",
        help="Bundled scenario (das-sim list scenarios lists them) or TOML file to drive; or recording (.mcap) to see.",
    ),
]
AtOption = Annotated[
    str | None,
    typer.Option("--at", metavar="TIME", help="Recording: begin here, 12:34 on the drive's clock."),
]


@dataclass(frozen=True, kw_only=True)
class SessionLooks:
    """Options on the language of the page, and on its address."""

    language: Annotated[Language, typer.Option("--language", help="The language of the page.")] = Language.EN
    opens: Annotated[
        bool, typer.Option("--open/--no-open", help="Open a browser, or print the address alone on a line.")
    ] = True
    port: Annotated[
        int, typer.Option("--port", metavar="PORT", min=0, max=65535, help="Port of the page (0: a free one).")
    ] = 0


@dataclass(frozen=True, kw_only=True)
class DeskLooks(SessionLooks):
    """Options on the appearance of the desk, and on its address."""

    notches: Annotated[
        int,
        typer.Option("--notches", metavar="N", min=0, max=MOST_NOTCHES, help="Steps of the lever each way; 0: none."),
    ] = 10
    punctuality: Annotated[
        bool, typer.Option("--punctuality/--no-punctuality", help="Say on the page how late the train is.")
    ] = True


def desk(
    what: WhatArgument = USUAL_SCENARIO,
    *,
    looks: DeskLooks,
    asked: DayAsked,
    pace: PaceOption = "real",
    recorded: RecordingAsked,
    at: AtOption = None,
    of_train: OfTrainOption = None,
    as_json: JsonOption = False,
) -> None:
    """Drive a simulated train yourself in the browser, or replay a drive as its driver saw it.

    The advice node runs as well, and everything is recorded. A recording plays on the same page, at any pace.
    """
    if Path(what).suffix == ".mcap":
        refuse_given(f"{what} is a recording to look at; nothing is driven, nothing is recorded", *OF_A_DRIVE)
        _look_at(Path(what), of_train, at, looks)
        return
    refuse_given(f"{what} is a scenario; expected a recording (.mcap)", "--at", "--of-train")
    factor = pace_factor(pace)
    if factor is None:
        raise DasError(f"--pace {pace}: a person needs a pace; expected real or a number of times real time")
    _drive_at_desk(what, asked, recorded, factor, looks, as_json=as_json)


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
    """Simulate a day that a person drives in the browser; the page opens before line and train are prepared."""
    recorded.check()
    _check_packages()
    from das.bus.access import Role
    from das.bus.session import endpoint, free_ports
    from sim.desk.host import DeskHost, listening, new_token
    from sim.desk.messages import SETTINGS_KEY, DeskGiven, PageSettings, encoded
    from sim.world.driving import How
    from sim.world.service import lay_out

    files = recorded.folder(asked.train)
    read = scenario_asked(name_or_path, asked.journey, recorded.out)
    # A day that cannot be driven is rejected before a page opens.
    lay_out(read, level=asked.level)
    own = None if files is None else files.file(Role.DESK)
    if own is not None:
        own.config(asked.train)
    places = [endpoint(port) for port in free_ports(2)]
    page = PageSettings(notches=looks.notches, punctuality=looks.punctuality)
    given = DeskGiven(
        door=-1, token=new_token(), scenario=str(read.source), journey=asked.journey, train=asked.train,
        language=str(looks.language), page=page, connect=() if files else tuple(places),
        bus=None if own is None else str(own.path), insecure_bus=recorded.insecure_bus,
    )  # fmt: skip
    how = How(
        driver=DESK, advice=asked.advice, train=asked.train, command=typed_command(), bus=files,
        driver_at=places[0], recorder_at=places[1], paced=True, metadata={SETTINGS_KEY: encoded(page)},
    )  # fmt: skip
    reserved = new_recording("desk") if recorded.out is None else None
    with removed_if_unused(reserved), DeskHost(given, listening(looks.port)) as host:
        show_page(host.address, opens=looks.opens)
        tell_result(_driven(read, asked, how, reserved or recorded.out, factor), as_json)


def _driven(read: Scenario, asked: DayAsked, how: How, out: Path | None, factor: float) -> DayResult:
    with loading_solver():
        from das.cab.cab import warm_up
        from sim.world.external import AT_THE_DESK, ExternalDriver

        warm_up()
    day = prepared_day(read, asked)
    return drive_recorded(day, ExternalDriver(day, times_real=factor, patience=AT_THE_DESK), how, out, factor)


def _check_packages() -> None:
    check_packages("desk", "starlette", "uvicorn", "websockets", "msgspec")


def show_page(address: str, *, opens: bool) -> None:
    """Open the page, or print its address alone on a line; the address is a secret of this run."""
    if not opens:
        print(address, flush=True)
        return
    say(f"the page: {address}")
    if not webbrowser.open(address):
        say("no browser could be opened: open the address yourself, on this machine")
