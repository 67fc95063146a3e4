"""The command without arguments: the bundled trip as it was recorded, and driven by the same driver with the coach."""

from __future__ import annotations

import shlex
import sys
import tempfile
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

from das.command_line.printing import busy, paragraph, progress_bar, tell, typed
from das.domain.errors import DasError
from das.domain.files.writing import new_file
from das.domain.units import KM, NS, PERCENT, kwh
from sim.cli.options import new_recording, removed_if_unused
from sim.cli.trips import replayed
from sim.drivers.kinds import Presentation
from sim.options import ReplayOptions, WhatIfKind

if TYPE_CHECKING:
    from sim.drive.comparison import AlignedDrives
    from sim.drive.drive import Drive

BUNDLED: Final = "zurich-zug-late.mcap"
DRIVER: Final = "sim.bundled.recorded_driver:RecordedDriver"
"""The driver of the bundled recording, who can be shown the coach."""
HANGS_ON: Final = (
    "but he is simulated, minds no clock when alone, does what the coach says, and brakes with the motors first in both "
    "drives: drivers who keep time by themselves saved little or nothing (docs/explanation/coach.md)."
)
"""What the figure hangs on, as the end of the sentence that gives it."""


def first_minute() -> None:
    """Replay the bundled recording, drive its trip anew with the coach, and print what came of both."""
    trip = bundled_recording()
    print(f"replaying the bundled recording {BUNDLED}, then driving its trip with the coach", file=sys.stderr)
    recorded = new_recording("replay")
    with removed_if_unused(recorded):
        replayed(trip, ReplayOptions(), recorded)
    coached = new_file(recorded.with_name(f"{recorded.stem}-coach.mcap"))
    with removed_if_unused(coached):
        found = _with_coach(recorded, coached)
    _print(found)
    tell(f"See both drives, and what the coach said: {typed('das-sim')} view {shlex.quote(str(coached))}")


def bundled_recording() -> Path:
    """The recording that comes with the program: in an installed package, or in the checkout."""
    package = Path(__file__).parents[1]
    for path in (package / "bundled" / BUNDLED, package.parent / "recordings" / BUNDLED):
        if path.is_file():
            return path
    raise DasError(f"{BUNDLED}: the bundled recording is missing from this installation")


def _with_coach(recorded: Path, coached: Path) -> AlignedDrives:
    """Drive a replayed trip anew by the same driver with the coach, and put the two drives beside each other."""
    from sim.drive.comparison import AlignedDrives, drives_on_track
    from sim.drive.drive import Drive
    from sim.runs.what_if.anew import day_again, drive_again
    from sim.runs.what_if.origin import Origin
    from sim.runs.what_if.otherwise import DrivenOtherwise, Otherwise

    new = Otherwise(driven=DrivenOtherwise(driver=DRIVER, advice=Presentation.COACH))
    with tempfile.TemporaryDirectory(prefix="das-first-minute-") as folder:
        with busy("reading the recorded day …"):
            again = day_again(Origin.read(recorded, None, Path(folder)), new)
        with progress_bar("driving the trip with the coach", "starting node and recorder", "m") as progress:
            drive_again(again, coached, progress)
    with busy("comparing …"):
        return AlignedDrives.of(drives_on_track([Drive.read(recorded), Drive.read(coached)]))


def _print(found: AlignedDrives) -> None:
    """Print both drives beside each other, and in one sentence what the coach was worth and what that hangs on."""
    before, after = (one.drive for one in found.drives)
    alone, coached = (float(one[-1]) for one in found.energy_j)
    start, end = before.calls[0], before.calls[-1]
    rows = (
        ("", "as recorded", "with the coach"),
        (f"leaves {start.name} (due {_clock(before, start.due_departure_ns)})", *_times(found, first=True)),
        (f"arrives at {end.name} (due {_clock(before, end.due_arrival_ns)})", *_times(found, first=False)),
        ("energy drawn", f"{kwh(alone):.0f} kWh", f"{kwh(coached):.0f} kWh"),
        ("instructions in the cab", "none", f"{after.instructions.changes}"),
    )
    way = f"{before.travelled.way_m / KM:.0f} km on an illustrative line"
    tell(f"A late train from {start.name} to {end.name}, {way}, twice with the same driver:")
    width = max(len(name) for name, _, _ in rows)
    for name, one, other in rows:
        tell(f"{name:<{width}}  {one:>12}  {other:>14}")
    paragraph(_result(found, alone, coached))


def _result(found: AlignedDrives, alone_j: float, coached_j: float) -> str:
    """The result in one sentence, with what the figure hangs on."""
    change = (coached_j - alone_j) / alone_j / PERCENT
    equal = found.equal_arrival(1)
    at_equal = equal.why_not if equal.ratio is None else f"{-equal.ratio / PERCENT:.0f} % at equal arrival"
    return f"With the coach he needed {-change:.0f} % less energy, {at_equal}; {HANGS_ON}"


def _times(found: AlignedDrives, *, first: bool) -> list[str]:
    """When each drive left its first stop, or came to its last one."""
    calls = [one.drive.calls[0 if first else -1] for one in found.drives]
    times = [call.departed_ns if first else call.arrived_ns for call in calls]
    return [_clock(one.drive, time_ns) for one, time_ns in zip(found.drives, times, strict=True)]


def _clock(drive: Drive, time_ns: int) -> str:
    """A moment on the clock of the line, "09:05:30"."""
    return f"{datetime.fromtimestamp(round(time_ns * NS), drive.zone):%H:%M:%S}"
