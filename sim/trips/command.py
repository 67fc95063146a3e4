"""The command `das-sim trip`: what is in a trip."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.printing import busy
from das.domain.errors import DasError
from das.domain.files.writing import check_writable
from sim.cli.options import (
    FromOption,
    LevelOption,
    LineOption,
    LossMapOption,
    ReplayOptions,
    ReverseOption,
    RouteOption,
    StrictOption,
    ToOption,
    TripArgument,
    VehicleOption,
)

EPILOG = "Example: das-sim trip trip.csv --route track.json --vehicle train.json --line kmposts.csv --plot trip.png"


def trip(
    file: TripArgument,
    route: RouteOption = None,
    vehicle: VehicleOption = None,
    reverse: ReverseOption = None,
    line: LineOption = None,
    from_stop: FromOption = None,
    to_stop: ToOption = None,
    strict: StrictOption = False,
    level: LevelOption = None,
    loss_map: LossMapOption = None,
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
        from sim.replay.job import open_trip, trip_section
        from sim.trips.estimate import estimate_run
        from sim.trips.picture import draw_trip
        from sim.trips.report import describe, print_description
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
