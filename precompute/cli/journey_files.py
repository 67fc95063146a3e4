"""The commands below `das-precompute journey`: import, show, check and new, for journey files."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from das.command_line.application import Entry
from das.command_line.files import load_route, load_vehicle
from das.command_line.options import JsonOption
from das.command_line.printing import busy, loading_solver, paragraph, print_table, tell, typed, warn
from das.domain.errors import DasError
from das.domain.units import KM
from precompute.cli.files import MadeFile, ShownFiles, end_check
from precompute.journey_order import TimesRead, TripChoice

if TYPE_CHECKING:
    from das.domain.route import Route

COMMANDS: Final = (
    Entry(
        name="import",
        where="precompute.cli.journey_files:import_journey",
        summary="Make a journey file from a trip of a GTFS feed.",
        examples=(
            "das-precompute journey import FEED.zip --trip 101 -o j.toml",
            "das-precompute journey import FEED.zip --trip 101 --route line.toml -o j.toml",
        ),
    ),
    Entry(
        name="show",
        where="precompute.cli.journey_files:show_journey",
        summary="Show the stops, passings and times of a journey file, as a table and as a time–distance picture.",
        examples=("das-precompute journey show zurich-luzern --route zurich-luzern --plot j.png",),
    ),
    Entry(
        name="check",
        where="precompute.cli.journey_files:check_journey",
        summary="Check a journey file for unusual values; with a vehicle, print the spare time of each section.",
        examples=("das-precompute journey check j.toml --route zurich-luzern --vehicle re460-ic",),
    ),
    Entry(
        name="new",
        where="precompute.cli.journey_files:new_journey",
        summary="Write a journey file to fill in: every key with its meaning, with the stops of a route.",
        examples=("das-precompute journey new --route zurich-luzern -o journey.toml",),
    ),
)

JourneyArgument = Annotated[
    str, typer.Argument(metavar="JOURNEY", help="Bundled journey, TOML file or TTOBench journey (JSON).")
]


@dataclass(frozen=True, kw_only=True)
class OnRoute:
    """The route of a journey, and its direction there."""

    route: Annotated[
        str | None,
        typer.Option(metavar="ROUTE", help="Route of the journey: bundled, TOML file or TTOBench track (JSON)."),
    ] = None
    reverse: Annotated[bool, typer.Option("--reverse", help="The journey runs from the route's end to its start.")] = (
        False
    )

    def line(self) -> Route | None:
        """The route that is named, in the direction of the journey; DasError if it is unusable."""
        if self.route is None:
            if self.reverse:
                raise DasError("--reverse: needs --route")
            return None
        found = load_route(self.route)
        return found.reversed() if self.reverse else found


@dataclass(frozen=True, kw_only=True)
class JourneyFile(MadeFile):
    """The journey file that a command makes."""

    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Journey file to write (.toml).")] = field()


def import_journey(
    feed: Annotated[Path, typer.Argument(metavar="FEED.zip", help="GTFS feed, as published (zip).")],
    choice: TripChoice,
    times: TimesRead,
    on: OnRoute,
    written: JourneyFile,
) -> None:
    """Make a journey file from a trip of a GTFS feed.

    The trip is named by its id (--trip), or is the first from one stop to another at a time or later (--from, --to,
    --at); with --trip, the two stops cut it. With --route, stops are found by their names, else by their places, within
    500 m of the route; stops beyond its ends are left out. Without a route, positions are distances along the feed's
    shape.

    Public timetables are rounded and seldom say how long a train stands. What is assumed is printed, and written in
    the file.
    """
    written.check(feed, on.route)
    from das.domain.files.reading import Fields
    from das.domain.files.routes import journey_of
    from precompute.gtfs import read_trip
    from precompute.journey_import import journey_text, notes, placed

    line = on.line()
    with busy("reading the feed …"):
        found = read_trip(feed, choice)
    placement = placed(found, line)
    text = journey_text(found, placement, times, line, "das-precompute journey import")
    made = journey_of(Fields.of(feed, tomllib.loads(text)), line)
    way_km = (made.points[-1].position_m - made.points[0].position_m) / KM
    about = f"{made.name}, {len(made.calls)} stops, {way_km:.1f} km"
    written.write(text, notes(found, placement, times, line), about)
    words = f"{on.route or 'ROUTE'} VEHICLE{' --reverse' if on.reverse else ''}"
    tell(f"plan it: {typed('das-precompute')} journey {written.out} {words}")
    named = f"--route {on.route or 'ROUTE'} --vehicle VEHICLE{' --reverse' if on.reverse else ''}"
    tell(f"drive it: {typed('das-sim')} make-scenario {named} --journey {written.out} -o day.toml")


def show_journey(journey: JourneyArgument, on: OnRoute, files: ShownFiles) -> None:
    """Show the stops, passings and times of a journey file, as a table and as a time–distance picture.

    A journey that states all positions needs no route.
    """
    files.check(journey, on.route)
    from das.domain.files.load import load_journey
    from precompute.cli import journey_report

    read = load_journey(journey, on.line())
    if files.plot is not None:
        from precompute.drawing.timetable import draw_timetable

        draw_timetable(read).save(files.plot, overwrite=True)
    if files.as_json:
        print(json.dumps(journey_report.as_dict(read)))
        return
    print_table(journey_report.table(read), journey_report.LEGEND)
    files.tell()


def check_journey(
    journey: JourneyArgument,
    on: OnRoute,
    vehicle: Annotated[
        str | None, typer.Option(metavar="VEHICLE", help="Train for the journey; needs --route.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check a journey file for unusual values; with a vehicle, print the spare time of each section.

    The exit code is 1 if there are warnings, and 2 if the file cannot be used or the train cannot keep its times.
    """
    from das.domain.files.load import load_journey
    from precompute.cli import journey_report

    line = on.line()
    if vehicle is not None and line is None:
        raise DasError(f"--vehicle {vehicle}: needs --route")
    read = load_journey(journey, line)
    found = journey_report.warnings(read, line)
    spare: list[dict[str, Any]] = []
    if vehicle is not None and line is not None:
        train = load_vehicle(vehicle)
        with loading_solver():
            from das.offline.journey.plan import JourneyPlanner

            planner = JourneyPlanner(read, line, train)
        spare = journey_report.spare_times(planner)

    def show() -> None:
        for text in found:
            warn(text)
        if spare:
            print_table(journey_report.spare_table(read, spare), journey_report.SPARE_LEGEND)
        tell(f"{read.source}: {len(read.calls)} stops, {len(read.passings)} passings, {len(found)} warnings")

    end_check(found, show, as_json=as_json, sections=spare)


def new_journey(on: OnRoute, written: JourneyFile) -> None:
    """Write a journey file to fill in: every key with its meaning, with the stops of a route.

    Its times are a first guess, from the line's limits; replace them.
    """
    written.check(on.route)
    from precompute.cli.journey_report import template

    written.write(template(on.line()))
    words = f" --route {on.route}" if on.route else ""
    paragraph(f"Fill it in, then: {typed('das-precompute')} journey check {written.out}{words}")
