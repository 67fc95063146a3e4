"""The command `das-sim trip`: what is in a trip."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from das.commands import busy
from das.domain.errors import DasError
from das.domain.files.writing import check_writable
from das.domain.losses import Level
from sim.options import ReplayOptions

EPILOG = "Example: das-sim trip trip.csv --route track.json --vehicle train.json --line kmposts.csv --plot trip.png"


def trip(
    file: Annotated[Path, typer.Argument(help="Trip: CSV, GPX or MCAP of ours (see docs/trips.md).")],
    route: Annotated[
        str | None, typer.Option(help="Bundled route, TOML or TTOBench track [default: the recording's].")
    ] = None,
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle to estimate forces and energy with [default: the recording's].")
    ] = None,
    reverse: Annotated[
        bool, typer.Option("--reverse", help="The trip runs from the route's end to its start.")
    ] = False,
    line: Annotated[
        Path | None, typer.Option(help="Kilometre posts (CSV) to match GPS to [default: the route's geometry].")
    ] = None,
    from_stop: Annotated[str | None, typer.Option("--from", help="Stop the trip starts at [default: first].")] = None,
    to_stop: Annotated[str | None, typer.Option("--to", help="Stop the trip ends at [default: last].")] = None,
    strict: Annotated[bool, typer.Option("--strict", help="Refuse what would be dropped or turned round.")] = False,
    level: Annotated[Level | None, typer.Option(help="Loss level [default: the vehicle's].")] = None,
    loss_map: Annotated[Path | None, typer.Option(help="CSV loss map: its losses and nothing else.")] = None,
    write: Annotated[Path | None, typer.Option(help="Write the cleaned trip (CSV).")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture (PNG).")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
) -> None:
    """Look at a trip: what was cleaned, how it fits the line, where it stood, what it took."""
    options = ReplayOptions(
        route=route,
        vehicle=vehicle,
        reverse=reverse,
        line=line,
        strict=strict,
        from_stop=from_stop,
        to_stop=to_stop,
        level=level,
        loss_map=loss_map,
    )
    for path in (write, plot):
        if path is not None:
            _check_output(path, file)
    with busy("reading the trip …"), tempfile.TemporaryDirectory(prefix="das-trip-") as folder:
        from sim.estimate import estimate_run
        from sim.job import open_trip, trip_section
        from sim.trip_picture import draw_trip
        from sim.trip_report import describe, print_description
        from sim.trips.writing import write_cleaned

        options, read = open_trip(file, options, Path(folder))
        section = trip_section(read, options) if options.vehicle is not None else None
        found = describe(read, section)
        if write is not None:
            write_cleaned(write, read)
        if plot is not None:
            run = read.run
            driven = estimate_run(section, run.time_s, run.s_m, run.speed_mps) if section is not None else None
            draw_trip(plot, read, driven)
    if as_json:
        print(json.dumps(found))
        return
    print_description(found, read.matched.report.cleaning)
    for path in (write, plot):
        if path is not None:
            print(f"written: {path}")


def _check_output(path: Path, trip_path: Path) -> None:
    if path.resolve() == trip_path.resolve():
        raise DasError(f"{path}: the file to write is the trip to read")
    check_writable(path)
