"""The command `das-sim replay`: a recorded trip against a live node."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Final

from das.command_line.compiling import loading_solver
from das.command_line.options import JsonOption, OutRecordingOption, OverwriteOption
from das.command_line.printing import busy
from das.command_line.running import interrupt_on_termination
from das.domain.errors import DasError
from das.domain.files.writing import check_writable
from sim.cli.options import TripArgument
from sim.cli.shared import new_recording, removed_if_unused
from sim.progress import progress_bar
from sim.recording.metadata import typed_command
from sim.runs.replay.options import ReplayOptions

BUNDLED: Final = "zurich-zug-late.mcap"


def replay(
    trip: TripArgument,
    options: ReplayOptions,
    out: OutRecordingOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Replay a recorded trip: the advice node answers every second, and everything is recorded."""
    if out is not None:
        check_writable(out, overwrite=overwrite)
        _replay(trip, options, out, as_json)
        return
    reserved = new_recording("replay")
    with removed_if_unused(reserved):
        _replay(trip, options, reserved, as_json)


def _replay(trip: Path, options: ReplayOptions, out: Path, as_json: bool) -> None:
    """Replay a trip into a recording, and print the result."""
    with loading_solver():
        from das.cab.warm_up import warm_up
        from sim.runs.replay.job import prepare, trip_energies
        from sim.runs.replay.replay import replay as run_replay
        from sim.runs.replay.report import print_result, result

        warm_up()
    with busy("reading the trip and solving its section …"):
        job = prepare(trip, options, out, typed_command())
    with busy("estimating the energy of the trip, and how well it is known …"):
        energies = trip_energies(job)
    interrupt_on_termination()
    try:
        with progress_bar(f"replaying {trip.name}", "starting node and recorder", "s") as progress:
            outcome = run_replay(job, progress, energies.above.message)
    except KeyboardInterrupt:
        print(f"stopped; recorded so far: {out}", file=sys.stderr)
        raise
    found = result(job, outcome, energies)
    if as_json:
        print(json.dumps(found))
    else:
        print_result(found)


def replay_bundled() -> None:
    """Replay the recording that comes with the program."""
    path = bundled_recording()
    print(
        f"replaying the bundled recording {BUNDLED}: a late train on an illustrative Zürich–Luzern route",
        file=sys.stderr,
    )
    replay(path, ReplayOptions())


def bundled_recording() -> Path:
    """The recording that comes with the program: in an installed package, or in the checkout."""
    package = Path(__file__).parents[1]
    for path in (package / "bundled" / BUNDLED, package.parent / "recordings" / BUNDLED):
        if path.is_file():
            return path
    raise DasError(f"{BUNDLED}: the bundled recording is missing from this installation")
