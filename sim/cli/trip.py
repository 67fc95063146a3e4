"""The command `das-sim trip`: what is in a recorded trip."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer

from das.command_line.options import JsonOption, OverwriteOption, PlotOption
from das.command_line.outputs import check_outputs, check_picture
from das.command_line.printing import busy, tell
from sim.cli.options import TripArgument
from sim.trips.options import TripOptions


def trip(
    file: TripArgument,
    options: TripOptions,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", "--write", metavar="FILE", help="Cleaned trip (.csv) to write: one row a point."),
    ] = None,
    plot: PlotOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Look at a recorded trip: what was cleaned, how it fits the line, where it stood, its energy."""
    check_picture(plot)
    inputs = (file, options.route, options.vehicle, options.line, options.loss_map)
    check_outputs(out, plot, inputs=inputs, overwrite=overwrite)
    with busy("reading the trip …"):
        found, report = _look(file, options, out, plot)
    if as_json:
        print(json.dumps(found))
        return
    from sim.trips.report import print_description

    print_description(found, report)
    for path in (out, plot):
        if path is not None:
            tell(f"written: {path}")


def _look(file: Path, options: TripOptions, out: Path | None, plot: Path | None) -> tuple[dict[str, Any], Any]:
    """Read the trip and write what is asked for; its description and what was cleaned."""
    from sim.trips.estimate import estimate_run
    from sim.trips.report import describe, draw_trip, write_cleaned
    from sim.trips.trip import open_trip, trip_section

    with tempfile.TemporaryDirectory(prefix="das-trip-") as folder:
        options, read = open_trip(file, options, Path(folder))
        section = trip_section(read, options) if options.vehicle is not None else None
        found = describe(read, section)
        if out is not None:
            write_cleaned(out, read)
        if plot is not None:
            run = read.run
            driven = estimate_run(section, run.time_s, run.s_m, run.speed_mps) if section is not None else None
            draw_trip(plot, read, driven)
    return found, read.matched.report.cleaning
