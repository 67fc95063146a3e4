"""The command `das-sim what-if`: a recorded day with something otherwise."""

from __future__ import annotations

import json
import shlex
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.loading import loading_solver
from das.command_line.options import JsonOption, OverwriteOption
from das.command_line.outputs import check_outputs
from das.command_line.printing import busy, paragraph, print_table, tell, typed
from das.command_line.running import interrupt_on_termination
from das.domain.errors import DasError
from das.domain.files.writing import new_file
from sim.cli.options import RecordingArgument, removed_if_unused
from sim.options import NodeSaid, OfTrainOption, WhatIfKind
from sim.progress import progress_bar
from sim.runs.what_if.otherwise import CabOtherwise, DrivenOtherwise, Otherwise, read_restriction

if TYPE_CHECKING:
    from sim.runs.what_if.difference import Changed
    from sim.runs.what_if.origin import Origin

WAYS = {
    WhatIfKind.OPEN_LOOP: "the recorded drive, and the advice that it would have had",
    WhatIfKind.DRIVEN_ANEW: "the recorded day, driven by a simulated driver",
}


@dataclass(frozen=True, kw_only=True)
class WhatIfAsked:
    """What is to be otherwise, as options; `anew` is None where the kind follows from them."""

    cab: CabOtherwise
    driven: DrivenOtherwise
    restriction: Annotated[
        list[str] | None,
        typer.Option(
            "--restriction",
            metavar="KM-KM:KM/H[@HH:MM-HH:MM]",
            help="One more temporary restriction, known from the beginning, with a window (UTC) if it has one; may be "
            "given several times.",
        ),
    ] = None
    without_restrictions: Annotated[
        bool, typer.Option("--without-restrictions", help="Leave out the restrictions that were told on the day.")
    ] = False
    anew: Annotated[
        bool | None,
        typer.Option(
            "--driven-anew/--open-loop",
            help="Drive the day anew, or keep the drive as it was [default: anew where a driver or display is named].",
            show_default=False,
        ),
    ] = None

    def otherwise(self, departure_ns: int = 0) -> Otherwise:
        """The same checked, on the day of a departure (ns since 1970); DasError for a restriction that nobody means."""
        return Otherwise(
            cab=self.cab,
            driven=self.driven,
            restrictions=tuple(read_restriction(one, departure_ns) for one in self.restriction or ()),
            without_restrictions=self.without_restrictions,
        )


def what_if(
    file: RecordingArgument,
    asked: WhatIfAsked,
    said: NodeSaid,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Recording (.mcap) to write [default: beside the old one]."),
    ] = None,
    overwrite: OverwriteOption = False,
    of_train: OfTrainOption = None,
    as_json: JsonOption = False,
) -> None:
    """Ask what would have been: other advice for a recorded drive, or its day driven anew; into a new recording.

    What is not said stays as it was. With nothing otherwise, the new recording holds the same messages.
    """
    check_outputs(out, inputs=(file,), overwrite=overwrite)
    asked.otherwise()  # Before anything is read or solved.
    interrupt_on_termination()
    with loading_solver():
        from sim.runs.what_if.difference import changed
        from sim.runs.what_if.origin import Origin

    with tempfile.TemporaryDirectory(prefix="das-what-if-") as folder:
        with busy(f"reading {file} …"):
            origin = Origin.read(file, of_train, Path(folder))
        new = asked.otherwise(origin.journey.stops[0].departure_ns)
        origin.check_on_the_way(new)
        kind = _kind(origin, new, asked.anew)
        with _place(file, out) as written:
            notes = _make(origin, new, kind, said, written)
        with busy("comparing …"):
            found = changed(kind, file, written, origin.train)
    if as_json:
        print(json.dumps(_as_dict(found, new, file, written, notes)))
    else:
        _print(found, new, (file, written), notes)


def _kind(origin: Origin, new: Otherwise, anew: bool | None) -> WhatIfKind:
    """The kind that is asked for; DasError for options of the other one."""
    if anew is None:
        anew = new.driven.asks_for_a_driver or not origin.has_advice
    if anew:
        return WhatIfKind.DRIVEN_ANEW
    for name in ("driver", "friction", "participant", "population"):
        value = getattr(new.driven, name)
        if value is not None:
            raise DasError(f"--{name} {value}: nobody drives anew in an open loop")
    return WhatIfKind.OPEN_LOOP


@contextmanager
def _place(file: Path, out: Path | None) -> Iterator[Path]:
    """Where to write; a file made for it is taken away again where nothing was recorded."""
    reserved = new_file(file.with_name(f"{file.stem}-what-if.mcap")) if out is None else None
    with removed_if_unused(reserved):
        yield out or reserved or file


def _make(origin: Origin, new: Otherwise, kind: WhatIfKind, said: NodeSaid, out: Path) -> list[str]:
    """Write the what-if; returns what should be known about it."""
    if kind is WhatIfKind.OPEN_LOOP:
        from sim.runs.what_if.open_loop import advise_otherwise

        with progress_bar(f"hearing {origin.path.name} again", "solving the first section", "messages") as progress:
            return advise_otherwise(origin, new, said, out, progress)
    from sim.runs.what_if.anew import day_again, drive_again

    if said.tables is not None:
        raise DasError(f"--tables {said.tables}: a day driven anew solves its sections")
    with busy("solving the sections …"):
        again = day_again(origin, new, said.node)
    try:
        with progress_bar(f"driving {origin.path.name} anew", "starting node and recorder", "m") as progress:
            drive_again(again, out, progress)
    except KeyboardInterrupt:
        print(f"stopped; recorded so far: {out}", file=sys.stderr)
        raise
    return [] if origin.is_simulated else [FROM_A_DRIVE]


FROM_A_DRIVE = (
    "the day was made from what was heard: timetable, late departures, restrictions; what held the train up between "
    "stops, wind and rail are not in it"
)


def _as_dict(found: Changed, new: Otherwise, file: Path, written: Path, notes: list[str]) -> dict[str, object]:
    return {
        "kind": str(found.kind),
        "recording": str(file),
        "written": str(written),
        "otherwise": new.described(),
        **found.as_dict(),
        "notes": notes,
    }


def _print(found: Changed, new: Otherwise, files: tuple[Path, Path], notes: list[str]) -> None:
    from rich.table import Table

    from sim.runs.what_if.difference import NAMES

    tell(f"{found.kind}: {WAYS[found.kind]}")
    tell(f"otherwise: {'; '.join(new.described()) or 'nothing'}")
    table = Table()
    table.add_column("")
    for name in NAMES:
        table.add_column(name, justify="right")
    for row in found.rows():
        table.add_row(*row)
    if table.row_count:
        print_table(table)
    for line in found.sentences():
        paragraph(line)
    for note in notes:
        tell(f"note: {note}")
    old, written = files
    tell(f"written: {written}")
    both = f"{shlex.quote(str(old))} {shlex.quote(str(written))}"
    tell(f"compare them: {typed('das-sim')} report {both} -o what-if.html")
