"""The commands about recorded trips: look at one, or replay it."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from das.command_line.files import check_outputs
from das.command_line.given import refuse_given
from das.command_line.options import JsonOption, OutRecordingOption, OverwriteOption
from das.command_line.printing import busy, loading_solver, progress_bar
from das.domain.errors import DasError
from sim.cli.options import TripArgument, naming_recorded, new_recording, removed_if_unused, tell_written
from sim.options import LATE_KERNELS, ReplayOptions, TripOptions, VehiclesOption, typed_command

if TYPE_CHECKING:
    from das.domain.vehicle import Vehicle


def trip(
    file: TripArgument,
    options: TripOptions,
    vehicles: VehiclesOption = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Cleaned trip (.csv) to write: one row a point."),
    ] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse a recorded trip: cleaning, match with the line, standstills, energy, train."""
    inputs = (file, options.route, options.vehicle, options.posts, options.loss_map)
    check_outputs(out, inputs=inputs, overwrite=overwrite)
    trains = None if vehicles is None else _trains(vehicles, options)
    with busy("reading the trip …") if trains is None else loading_solver():
        found, report = _look(file, options, trains, out)
    if as_json:
        print(json.dumps(found))
        return
    from sim.trips.report import print_description

    print_description(found, report)
    if found["trains"] is not None:
        from sim.runs.found_trains import print_trains

        print_trains(found["trains"])
    tell_written(out)


def _trains(vehicles: str, options: TripOptions) -> list[tuple[str, Vehicle]]:
    """The trains that may have driven a trip; DasError if one cannot be used."""
    from sim.trips.find_train import candidates

    for name, value in (("--vehicle", options.vehicle), ("--loss-map", options.loss_map)):
        if value is not None:
            raise DasError(f"{name} {value}: expected either {name} or --vehicles, which finds the train")
    return candidates(vehicles)


def _look(
    file: Path, options: TripOptions, trains: list[tuple[str, Vehicle]] | None, out: Path | None
) -> tuple[dict[str, Any], Any]:
    """Read the trip and write what is asked for; returns its description and the report on its cleaning."""
    from sim.runs.replay import stated_parts
    from sim.trips.report import describe, write_cleaned
    from sim.trips.trip import open_trip, trip_section

    with tempfile.TemporaryDirectory(prefix="das-trip-") as folder:
        options, read = open_trip(file, options, Path(folder))
        section, tried = None, None
        if trains is not None:
            from sim.runs.found_trains import described_trains

            tried, section = described_trains(read, trains, options)
        elif options.vehicle is not None:
            section = trip_section(read, options)
        else:
            refuse_given("needs --vehicle or --vehicles", "--level", "--loss-map", "--point-mass")
        parts, part = (None, "") if section is None else stated_parts(read, section)
        found = {**describe(read, section, parts, part), "trains": tried}
        if out is not None:
            write_cleaned(out, read)
    return found, read.matched.report.cleaning


BUNDLED: Final = "zurich-zug-late.mcap"


def replay(
    trip: TripArgument,
    options: ReplayOptions,
    out: OutRecordingOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Replay a recorded trip: the advice node answers every second, and everything is recorded."""
    check_outputs(out, overwrite=overwrite)
    reserved = new_recording("replay") if out is None else None
    with removed_if_unused(reserved):
        load_solver()
        found = replayed(trip, options, out or reserved or trip)
    if as_json:
        print(json.dumps(found))
        return
    from sim.runs.replay_figures import print_result

    print_result(found)


def replayed(trip: Path, options: ReplayOptions, out: Path) -> dict[str, Any]:
    """Replay a trip into a recording, with a solver that is loaded; the figures of the replay."""
    from sim.runs.replay import prepare
    from sim.runs.replay import replay as run_replay
    from sim.runs.replay_figures import result, trip_energies

    with busy("reading the trip and solving its section …"):
        job = prepare(trip, options, out, typed_command())
    with busy("estimating the energy of the trip and its uncertainty …"):
        energies = trip_energies(job)
    with (
        naming_recorded(out),
        progress_bar(f"replaying {trip.name}", "starting node and recorder", "s") as progress,
    ):
        outcome = run_replay(job, progress, energies.above.message)
    return result(job, outcome, energies)


def load_solver() -> None:
    """Load the compiled solver, or compile it. A signal ends the process at once, so nothing may be open yet."""
    with loading_solver(LATE_KERNELS):
        from das.cab.warm_up import warm_up

        warm_up()


def bundled_recording() -> Path:
    """The recording that comes with the program: in an installed package, or in the checkout."""
    package = Path(__file__).parents[1]
    for path in (package / "bundled" / BUNDLED, package.parent / "recordings" / BUNDLED):
        if path.is_file():
            return path
    raise DasError(f"{BUNDLED}: the bundled recording is missing from this installation")
