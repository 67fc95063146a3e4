"""The commands on recorded trips (analyse, replay), and the demonstration that das-sim runs without a command."""

from __future__ import annotations

import json
import shlex
import tempfile
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from das.command_line.application import refuse_given
from das.command_line.files import check_outputs
from das.command_line.options import JsonOption, OutRecordingOption, OverwriteOption
from das.command_line.printing import busy, loading_solver, paragraph, progress_bar, tell, typed
from das.domain.errors import DasError
from das.domain.files.writing import new_file
from das.domain.units import KM, NS, PERCENT, kwh_figure, kwh_words
from sim.cli.options import TripArgument, naming_recorded, new_recording, removed_if_unused, tell_written
from sim.drivers.kinds import Presentation
from sim.options import LATE_KERNELS, ReplayOptions, TripOptions, VehiclesOption, typed_command

if TYPE_CHECKING:
    from das.domain.vehicle import Vehicle
    from sim.drive.comparison import AlignedDrives


def trip(
    file: TripArgument,
    options: TripOptions,
    vehicles: VehiclesOption = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Cleaned trip (.csv) to write: one row per point."),
    ] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse a recorded trip: cleaning, map matching, standstills, energy, train."""
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
    from sim.trips.find_train import candidates

    for name, value in (("--vehicle", options.vehicle), ("--loss-map", options.loss_map)):
        if value is not None:
            raise DasError(f"{name} {value}: --vehicles identifies the train: expected no {name} with it")
    return candidates(vehicles)


def _look(
    file: Path, options: TripOptions, trains: list[tuple[str, Vehicle]] | None, out: Path | None
) -> tuple[dict[str, Any], Any]:
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
            refuse_given("needs --vehicle or --vehicles", "--level", "--loss-map")
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
    """Replay a trip into a recording and return the figures of the replay; the solver must be loaded."""
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
    """Load or compile the solver. Meanwhile a signal ends the process immediately, so no file may be open."""
    with loading_solver(LATE_KERNELS):
        from das.cab.cab import warm_up

        warm_up()


def bundled_recording() -> Path:
    """The bundled recording: in an installed package, or in the checkout."""
    package = Path(__file__).parents[1]
    for path in (package / "bundled" / BUNDLED, package.parent / "recordings" / BUNDLED):
        if path.is_file():
            return path
    raise DasError(f"{BUNDLED}: the bundled recording is missing from this installation")


DRIVER: Final = "sim.bundled.recorded_driver:RecordedDriver"
"""The driver of the bundled recording, who can also drive with the guide."""
HANGS_ON: Final = (
    "This driver follows the guide, brakes with the motors first, and ignores the timetable without advice; "
    "drivers who keep to it save less (docs/explanation/guide-figures.md)."
)
"""A sentence on the conditions on which the figures of the result depend."""
LOOK_AGAIN_S: Final = 0.2
"""Interval (s) at which the progress of the drive with the guide is shown."""


def first_minute() -> None:
    """Replay the bundled recording while its trip is simulated with the guide, and print both results."""
    trip = bundled_recording()
    recorded = new_recording("replay", "start das-sim in a folder where it can write")
    with removed_if_unused(recorded):
        load_solver()
    guided = new_file(recorded.with_name(f"{recorded.stem}-guide.mcap"))
    with removed_if_unused(recorded), removed_if_unused(guided), naming_recorded(guided):
        with _Guided(trip, guided) as drive:
            replayed(trip, ReplayOptions(), recorded)
            with naming_recorded(recorded):
                drive.finish()
        from sim.drive.comparison import AlignedDrives, drives_on_track
        from sim.drive.drive import Drive

        with busy("comparing …"):
            found = AlignedDrives.of(drives_on_track([Drive.read(recorded), Drive.read(guided)]))
    _print(found)
    tell(f"See it: {typed('das-sim')} view {shlex.quote(str(guided))}")


class _Guided:
    """A new simulation of a recorded trip by the same driver with the guide, in a thread; a context manager.

    Each drive mostly waits for a node of its own, so that two at a time take little longer than one. If the block
    ends early, the drive is ended too.
    """

    def __init__(self, trip: Path, out: Path) -> None:
        self._trip, self._out = trip, out
        self._pool = ThreadPoolExecutor(1, "guided")
        self._done_m, self._whole_m, self._ended = 0.0, 0.0, False

    def __enter__(self) -> _Guided:
        self._drive = self._pool.submit(self._run)
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self._pool.shutdown(wait=True)

    def finish(self) -> None:
        """Show progress until the drive has ended; raises the error that ended the drive early, if any."""
        if not self._drive.done():
            with progress_bar("driving the trip with the guide", "under way", "m") as progress:
                while wait([self._drive], LOOK_AGAIN_S).not_done:
                    if self._whole_m:
                        progress(self._done_m, self._whole_m)
        self._drive.result()

    def _run(self) -> None:
        from sim.runs.what_if.anew import day_again, drive_again
        from sim.runs.what_if.origin import Origin
        from sim.runs.what_if.otherwise import DrivenOtherwise, Otherwise

        new = Otherwise(driven=DrivenOtherwise(driver=DRIVER, advice=Presentation.GUIDE))
        with tempfile.TemporaryDirectory(prefix="das-first-minute-") as folder:
            drive_again(*day_again(Origin.read(self._trip, None, Path(folder)), new), self._out, self._progress)

    def _progress(self, done_m: float, whole_m: float) -> None:
        if self._ended:
            raise DasError("the drive with the guide was ended early")
        self._done_m, self._whole_m = done_m, whole_m


def _print(found: AlignedDrives) -> None:
    """Print both drives side by side, and sentences on the guide's saving and the conditions for it."""
    before, after = (one.drive for one in found.drives)
    alone_j, guided_j = (float(one[-1]) for one in found.energy_j)
    start, end = before.calls[0], before.calls[-1]
    rows = (
        ("", "as recorded", "with the guide"),
        (f"leaves {start.name} (due {before.table.clock.of_day(start.due_departure_ns)})", *_times(found, first=True)),
        (f"arrives at {end.name} (due {before.table.clock.of_day(end.due_arrival_ns)})", *_times(found, first=False)),
        ("energy (estimated)", kwh_words(alone_j, finer=-1), kwh_words(guided_j, finer=-1)),
        ("instructions in the cab", "none", f"{after.figures.instructions.instructions}"),
    )
    way = f"from {start.name} to {end.name}, {before.travelled.way_m / KM:.0f} km"
    tell(f"A late train {way}, driven twice by the same simulated driver:")
    width = max(len(name) for name, _, _ in rows)
    for name, one, other in rows:
        tell(f"{name:<{width}}  {one:>12}  {other:>14}")
    equal = found.equal_arrival(1)
    if equal.more_j is None or equal.ratio is None:
        at_equal = equal.why_not
    else:
        share = f"{abs(equal.ratio) / PERCENT:.0f}\u00a0% of the optimum"
        at_equal = f"at the same arrival time {_less(equal.more_j)} ({share})"
    later_s = (after.calls[-1].arrived_ns - before.calls[-1].arrived_ns) * NS
    came = f"arrived {abs(later_s):.0f} s {'later' if later_s >= 0 else 'earlier'}"
    paragraph(f"With the guide the same driver {came} and needed {_less(guided_j - alone_j)}; {at_equal}. {HANGS_ON}")


def _less(energy_j: float) -> str:
    return f"{kwh_figure(abs(energy_j), finer=-1)}\u00a0kWh {'less' if energy_j < 0 else 'more'}"


def _times(found: AlignedDrives, *, first: bool) -> list[str]:
    calls = [one.drive.calls[0 if first else -1] for one in found.drives]
    times = [call.departed_ns if first else call.arrived_ns for call in calls]
    return [one.drive.table.clock.of_day(time_ns) for one, time_ns in zip(found.drives, times, strict=True)]
