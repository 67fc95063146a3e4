"""The commands below `das-precompute journey`: import, show, check and new, for journey files."""

from __future__ import annotations

import datetime
import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from das.command_line.application import Entry
from das.command_line.files import check_outputs, check_picture, load_route, load_vehicle
from das.command_line.options import JsonOption, OverwriteOption, PlotOption
from das.command_line.printing import busy, loading_solver, paragraph, print_table, tell, typed, warn
from das.domain.errors import DasError
from das.domain.units import KM

if TYPE_CHECKING:
    from das.domain.route import Route
    from precompute.gtfs import TripChoice
    from precompute.journey_import import TimesRead

COMMANDS: Final = (
    Entry(
        name="import",
        where="precompute.cli.journey_files:import_journey",
        summary="Make a journey file from a trip of a GTFS feed.",
        examples=(
            "das-precompute journey import FEED.zip --trip 101 -o j.toml",
            "das-precompute journey import FEED.zip --from Melk --to Linz --at 07:30 --route line.toml -o j.toml",
        ),
    ),
    Entry(
        name="show",
        where="precompute.cli.journey_files:show_journey",
        summary="Show the stops, passings and times of a journey file, as a table and as a time–distance picture.",
        examples=("das-precompute journey show zurich-luzern --route zurich-luzern --plot journey.png",),
    ),
    Entry(
        name="check",
        where="precompute.cli.journey_files:check_journey",
        summary="Check a journey file: what is unusual in it and, with a vehicle, the time each section has to spare.",
        examples=("das-precompute journey check zurich-luzern --route zurich-luzern --vehicle re460-ic",),
    ),
    Entry(
        name="new",
        where="precompute.cli.journey_files:new_journey",
        summary="Write a journey file to fill in: every key with its meaning, with the stops of a route.",
        examples=("das-precompute journey new --route zurich-luzern -o journey.toml",),
    ),
)

LONGEST_S = 3600.0
"""Longest dwell and tolerance (s) that are accepted."""
JourneyFile = Annotated[
    str, typer.Argument(metavar="JOURNEY", help="Bundled journey, TOML file or TTOBench journey (JSON).")
]
OnRouteOption = Annotated[
    str | None,
    typer.Option("--route", metavar="ROUTE", help="Route of the journey: bundled, TOML file or TTOBench track (JSON)."),
]
BackwardsOption = Annotated[bool, typer.Option("--reverse", help="The journey runs from the route's end to its start.")]
OutJourneyOption = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Journey file to write (.toml).")]
FeedArgument = Annotated[Path, typer.Argument(metavar="FEED.zip", help="GTFS feed, as it is published: a zip.")]


@dataclass(frozen=True, kw_only=True)
class TripOfFeed:
    """Which trip of a feed becomes a journey."""

    trip: Annotated[
        str | None, typer.Option("--trip", metavar="ID", help="The trip_id, or a number that only one trip has.")
    ] = None
    from_stop: Annotated[
        str | None, typer.Option("--from", metavar="STOP", help="Where the journey begins: name or stop_id.")
    ] = None
    to_stop: Annotated[
        str | None, typer.Option("--to", metavar="STOP", help="Where the journey ends: name or stop_id.")
    ] = None
    at: Annotated[
        str | None, typer.Option("--at", metavar="HH:MM", help="Without --trip: the first train from then on.")
    ] = None
    day: Annotated[
        str | None,
        typer.Option("--date", metavar="YYYY-MM-DD", help="Only trips that run on this day [default: on any day]."),
    ] = None

    def choice(self) -> TripChoice:
        """The trip that is wanted; DasError for a time or day that is none."""
        from precompute.gtfs import TripChoice, parsed_clock_s

        try:
            day = None if self.day is None else datetime.date.fromisoformat(self.day)
        except ValueError:
            raise DasError(f"--date {self.day}: expected a day like 2026-11-26") from None
        at_s = None if self.at is None else parsed_clock_s("--at", self.at)
        return TripChoice(trip=self.trip, from_stop=self.from_stop, to_stop=self.to_stop, at_s=at_s, day=day)


@dataclass(frozen=True, kw_only=True)
class FeedTimes:
    """How the times of a feed are read."""

    dwell_s: Annotated[
        float,
        typer.Option("--dwell", metavar="S", help="Least dwell (s) where the feed has arrival = departure."),
    ] = 30.0
    rounded_s: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="S",
            help="How much later (s) than the feed says the train may be [default: 59 at departures if all times are "
            "whole minutes, else 0].",
            show_default=False,
        ),
    ] = None

    def read(self) -> TimesRead:
        """The same for `precompute.journey_import`; DasError for an impossible time."""
        from precompute.journey_import import TimesRead

        for option, value_s in (("--dwell", self.dwell_s), ("--tolerance", self.rounded_s)):
            if value_s is not None and not 0 <= value_s <= LONGEST_S:
                raise DasError(f"{option} {value_s:g}: expected seconds from 0 to {LONGEST_S:g}")
        return TimesRead(dwell_s=self.dwell_s, rounded_s=self.rounded_s)


def import_journey(
    feed: FeedArgument,
    out: OutJourneyOption,
    asked: TripOfFeed,
    times: FeedTimes,
    route: OnRouteOption = None,
    reverse: BackwardsOption = False,
    overwrite: OverwriteOption = False,
) -> None:
    """Make a journey file from a trip of a GTFS feed.

    The trip is named by its id (--trip), or is the first from one stop to another at a time or later (--from, --to,
    --at); with --trip, the two stops cut it. With --route, stops are found by their names, else by their places, within
    500 m of the route; stops beyond its ends are left out. Without a route, positions are distances along the feed's
    shape.

    Public timetables are rounded and seldom say how long a train stands. What is assumed is printed, and written in
    the file.
    """
    check_outputs(out, inputs=(feed, route), overwrite=overwrite)
    from das.domain.files.reading import Fields
    from das.domain.files.routes import journey_of
    from das.domain.files.writing import write_whole
    from precompute.gtfs import read_trip
    from precompute.journey_import import journey_text, notes, placed

    choice, read, line = asked.choice(), times.read(), _line(route, reverse)
    with busy("reading the feed …"):
        found = read_trip(feed, choice)
    placement = placed(found, line)
    text = journey_text(found, placement, read, line, "das-precompute journey import")
    made = journey_of(Fields.of(out, tomllib.loads(text)), line)
    write_whole(out, text.encode())
    for note in notes(found, placement, read):
        tell(f"note: {note}")
    way_km = (made.points[-1].position_m - made.points[0].position_m) / KM
    tell(f"written: {out}: {made.name}, {len(made.calls)} stops, {way_km:.1f} km")
    on = route or "ROUTE"
    tell(f"plan it: {typed('das-precompute')} journey {out} {on} VEHICLE{' --reverse' if reverse else ''}")
    tell(f"drive it: {typed('das-sim')} run SCENARIO --journey {out}")


def _line(route: str | None, reverse: bool) -> Route | None:
    """The route that is named, in the direction of the journey."""
    if route is None:
        if reverse:
            raise DasError("--reverse: needs --route")
        return None
    found = load_route(route)
    return found.reversed() if reverse else found


def show_journey(
    journey: JourneyFile,
    route: OnRouteOption = None,
    reverse: BackwardsOption = False,
    plot: PlotOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Show the stops, passings and times of a journey file, as a table and as a time–distance picture.

    A journey that states all positions needs no route.
    """
    check_picture(plot)
    check_outputs(plot, inputs=(journey, route), overwrite=overwrite)
    from das.domain.files.load import load_journey
    from precompute.cli import journey_report

    read = load_journey(journey, _line(route, reverse))
    if plot is not None:
        from das.drawing.timetable import draw_timetable

        draw_timetable(read).save(plot, overwrite=True)
    if as_json:
        print(json.dumps(journey_report.as_dict(read)))
        return
    print_table(journey_report.table(read), journey_report.LEGEND)
    if plot is not None:
        tell(f"written: {plot}")


def check_journey(
    journey: JourneyFile,
    route: OnRouteOption = None,
    reverse: BackwardsOption = False,
    vehicle: Annotated[
        str | None,
        typer.Option("--vehicle", metavar="VEHICLE", help="Train that is to keep the journey; needs --route."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check a journey file: what is unusual in it and, with a vehicle, the time each section has to spare.

    The exit code is 1 if there are warnings, and 2 if the file cannot be used or the train cannot keep its times.
    """
    from das.domain.files.load import load_journey
    from precompute.cli import journey_report

    line = _line(route, reverse)
    if vehicle is not None and line is None:
        raise DasError(f"--vehicle {vehicle}: needs --route")
    read = load_journey(journey, line)
    found = journey_report.warnings(read, line)
    spare: list[dict[str, Any]] = []
    if vehicle is not None and line is not None:
        train = load_vehicle(vehicle)
        with loading_solver():
            from das.solver.journey.plan import JourneyPlanner

            planner = JourneyPlanner(read, line, train)
        spare = journey_report.spare_times(planner)
    if as_json:
        print(json.dumps({"warnings": found, "sections": spare}))
    else:
        for text in found:
            warn(text)
        if spare:
            print_table(journey_report.spare_table(read, spare), journey_report.SPARE_LEGEND)
        tell(f"{read.source}: {len(read.calls)} stops, {len(read.passings)} passings, {len(found)} warnings")
    if found:
        raise typer.Exit(1)


def new_journey(
    out: OutJourneyOption,
    route: OnRouteOption = None,
    reverse: BackwardsOption = False,
    overwrite: OverwriteOption = False,
) -> None:
    """Write a journey file to fill in: every key with its meaning, with the stops of a route.

    Its times are a first guess, from the line's limits; replace them.
    """
    check_outputs(out, inputs=(route,), overwrite=overwrite)
    from das.domain.files.writing import write_whole
    from precompute.cli.journey_report import template

    write_whole(out, template(_line(route, reverse)).encode())
    tell(f"written: {out}")
    paragraph(
        f"Fill it in, then: {typed('das-precompute')} journey check {out}" + (f" --route {route}" if route else "")
    )
