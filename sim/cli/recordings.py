"""The commands on a recording: check, reproduce, export, what-if."""

from __future__ import annotations

import json
import shlex
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.application import refuse_given
from das.command_line.files import check_outputs
from das.command_line.options import JsonOption, OverwriteOption
from das.command_line.printing import busy, loading_solver, new_table, paragraph, print_table, progress_bar, tell, typed
from das.domain.files.writing import new_file
from sim.cli.options import (
    FromTimeOption,
    RecordingArgument,
    ToTimeOption,
    chosen,
    naming_recorded,
    removed_if_unused,
)
from sim.drivers.kinds import Presentation
from sim.options import NodeSaid, OfTrainOption, WhatIfKind
from sim.runs.what_if.otherwise import CabOtherwise, DrivenOtherwise, Otherwise, read_restriction

if TYPE_CHECKING:
    from sim.recording.check import Checked
    from sim.recording.recover import Recovered
    from sim.runs.reproduce import Difference, Reproduction
    from sim.runs.what_if.origin import Origin


MOST_FIELDS = 12
"""Largest number of fields shown for the first message that differs."""
WAYS = {
    WhatIfKind.OPEN_LOOP: "the recorded drive, with the advice that it would have received",
    WhatIfKind.DRIVEN_ANEW: "the recorded run, driven by a simulated driver",
}
"""Recorded and recomputed parts of each kind of what-if."""
FROM_A_DRIVE = (
    "the run was made from received messages: timetable, late departures, restrictions; delays between stops, "
    "wind and rail are not in it. Simulate it with advice and with --advice none to find what advice saved"
)
"""A note on what the new simulation of a real drive leaves out."""


def check(
    file: RecordingArgument,
    of_train: OfTrainOption = None,
    save: Annotated[
        Path | None,
        typer.Option(
            "--save", metavar="FILE", help="New recording (.mcap) to write, with the intact parts of this one."
        ),
    ] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Check a recording: checksums, missing messages, topics, rates, gaps, late advice, versions, inputs.

    The exit code is 1 if something is wrong, else 0. With --save, the intact parts of a cut or damaged recording are
    first saved in a new file, and losses are reported.
    """
    check_outputs(save, inputs=(file,), overwrite=overwrite)
    from sim.recording.check import check_file
    from sim.recording.recover import recover

    with busy(f"checking {file} …"):
        saved = None if save is None else recover(file, save)
        found = check_file(file, of_train)
    if as_json:
        print(json.dumps({**found.as_dict(), "saved": None if saved is None else saved.as_dict()}))
    else:
        _print_check(found)
        if saved is not None:
            _print_saved(saved)
        elif found.recording.health.damage or not found.recording.complete:
            tell(f"save the intact parts: {typed('das-sim')} check {found.recording.path} --save NEW.mcap")
    if found.findings:
        raise typer.Exit(1)


def _print_check(found: Checked) -> None:
    from rich.table import Table

    from sim.recording.check import RATE_COLUMNS

    figures = Table(title=str(found.recording.path), title_justify="left", show_header=False)
    figures.add_column(no_wrap=True)
    figures.add_column()
    for name, value in found.figures.items():
        figures.add_row(name, value)
    print_table(figures)
    rates = new_table("topics", (), RATE_COLUMNS[1:], whole=RATE_COLUMNS[:1], lines=True)
    for row in found.rate_rows():
        rates.add_row(*row)
    print_table(rates)
    for line in found.lines():
        tell(line)


def _print_saved(found: Recovered) -> None:
    from sim.recording.course import utc

    for line in found.losses():
        tell(line)
    if found.health.sound:
        tell("this recording is intact")
    elif not found.losses():
        tell("it was cut off between two records: everything written is saved")
    tell(f"saved: {found.messages} messages up to {utc(found.last_ns)} UTC, {found.attachments} attached files")
    tell(f"written: {found.out}")


def reproduce(
    file: RecordingArgument,
    said: NodeSaid,
    of_train: OfTrainOption = None,
    as_json: JsonOption = False,
) -> None:
    """Feed a recording to the cab of this version, and compare its messages with the recorded ones.

    The exit code is 1 if something differs, else 0.
    """
    with loading_solver():
        from das.cab.cab import warm_up
        from sim.runs.reproduce import reproduce as run

        warm_up()
    with progress_bar(f"replaying {file.name}", "solving the first section", "messages") as progress:
        found = run(file, progress, train=of_train, node=said.node, tables=said.tables)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        _print_reproduction(found)
    if not found.same:
        raise typer.Exit(1)


def _print_reproduction(found: Reproduction) -> None:
    counts = ", ".join(f"{count} {topic}" for topic, count in found.comparison.compared.items())
    tell(f"{found.path}: {found.ticks} ticks, compared: {counts}")
    for note in found.notes:
        tell(f"note: {note}")
    differences = found.comparison.differences
    if not differences:
        tell("today's cab gives the same messages")
        return
    tell(f"{len(differences)} messages differ; the first:")
    _print_first(differences[0])
    tell("all fields that differ:")
    for path, (count, most) in found.comparison.by_field.items():
        by = "" if most != most else f", by up to {most:.6g}"  # noqa: PLR0124
        tell(f"  {path}: {count} message{'s' if count > 1 else ''}{by}")
    only = {"recorded only": sum(one.today is None for one in differences)}
    only["said today only"] = sum(one.recorded is None for one in differences)
    for what, count in only.items():
        if count:
            tell(f"  {what}: {count} message{'s' if count > 1 else ''}")


def _print_first(first: Difference) -> None:
    from sim.recording.course import utc

    tell(f"  {first.topic} of tick {first.tick}, {utc(first.time_ns)} UTC")
    if first.today is None or first.recorded is None:
        which, message = ("recorded", first.recorded) if first.today is None else ("said today", first.today)
        tell(f"  only {which}: {' '.join(str(message).split())[:400]}")
    for one in first.fields[:MOST_FIELDS]:
        by = "" if one.by != one.by else f" (by {one.by:.6g})"
        tell(f"  {one.path}: recorded {one.recorded!r}, today {one.today!r}{by}")
    if len(first.fields) > MOST_FIELDS:
        tell(f"  and {len(first.fields) - MOST_FIELDS} more fields")


def export(
    file: RecordingArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="New folder to write the tables into.")],
    start: FromTimeOption = None,
    end: ToTimeOption = None,
    trim_ends: Annotated[
        bool,
        typer.Option("--trim-ends", help="Leave out the time before the train first moved and after it last moved."),
    ] = False,
    anonymous: Annotated[
        bool,
        typer.Option(
            "--anonymous",
            help="Remove identifying data: names, texts, coordinates, the date, the zero of the route.",
        ),
    ] = False,
    kind: Annotated[str, typer.Option("--format", metavar="FORMAT", help="parquet, csv or both.")] = "both",
    of_train: OfTrainOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write a recording as tables: one per topic and one by time; column names state units."""
    from sim.drive.export import ExportSettings, FileFormat
    from sim.drive.export import export as write

    settings = ExportSettings(
        start=start,
        end=end,
        trim_ends=trim_ends,
        anonymous=anonymous,
        format=chosen(FileFormat, "--format", kind),
    )
    with busy(f"writing tables to {out} …"):
        found = write(file, out, settings, of_train)
    files = len(list(out.iterdir()))
    if as_json:
        print(json.dumps({"folder": str(out), "rows": found, "files": files}))
        return
    paragraph("rows: " + ", ".join(f"{name} {rows}" for name, rows in found.items()))
    tell(f"written: {files} files in {out}; columns.csv explains each column")


@dataclass(frozen=True, kw_only=True)
class WhatIfAsked:
    """Options for the changes to a recorded run; if `anew` is None, the other options decide the kind of what-if."""

    cab: CabOtherwise
    driven: DrivenOtherwise
    restriction: Annotated[
        list[str] | None,
        typer.Option(
            "--restriction",
            metavar="KM-KM:KM/H",
            help="One more temporary restriction, known from the beginning; may be given several times.",
        ),
    ] = None
    without_restrictions: Annotated[
        bool, typer.Option("--without-restrictions", help="Leave out the announced restrictions.")
    ] = False
    anew: Annotated[
        bool | None,
        typer.Option(
            "--driven-anew/--open-loop",
            help="Simulate the run again, or keep the recorded drive [default: again if a driver or display is named].",
        ),
    ] = None

    def otherwise(self) -> Otherwise:
        """The changes; raises DasError for an impossible restriction."""
        return Otherwise(
            cab=self.cab,
            driven=self.driven,
            restrictions=tuple(read_restriction(one) for one in self.restriction or ()),
            without_restrictions=self.without_restrictions,
        )


def what_if(
    file: RecordingArgument,
    asked: WhatIfAsked,
    said: NodeSaid,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="Recording (.mcap) to write [default: next to the old one]."),
    ] = None,
    overwrite: OverwriteOption = False,
    of_train: OfTrainOption = None,
    as_json: JsonOption = False,
) -> None:
    """Try a what-if in a new recording: other advice for a recorded drive, or its run simulated again.

    Anything that no option changes stays as recorded. Without any change, the new recording holds the same messages.
    """
    check_outputs(out, inputs=(file,), overwrite=overwrite)
    new = asked.otherwise()
    with loading_solver():
        from sim.runs.what_if.origin import Origin

    with tempfile.TemporaryDirectory(prefix="das-what-if-") as folder:
        with busy(f"reading {file} …"):
            origin = Origin.read(file, of_train, Path(folder))
        origin.check_on_the_way(new)
        kind = _kind_of(origin, new, asked.anew)
        # A new file is removed again if it stays empty.
        reserved = new_file(file.with_name(f"{file.stem}-what-if.mcap")) if out is None else None
        written = out or reserved or file
        with removed_if_unused(reserved):
            notes = _write_what_if(origin, new, kind, said, written)
        with busy("comparing …"):
            compare = _compared_advice if kind is WhatIfKind.OPEN_LOOP else _compared_drives
            found, print_difference = compare((file, written), origin.train)
    if as_json:
        made = {"kind": str(kind), "recording": str(file), "written": str(written), "otherwise": new.described()}
        print(json.dumps({**made, **found, "notes": notes}))
        return
    tell(f"{kind}: {WAYS[kind]}")
    tell(f"otherwise: {'; '.join(new.described()) or 'nothing'}")
    print_difference()
    for note in notes:
        tell(f"note: {note}")
    tell(f"written: {written}")
    both = f"{shlex.quote(str(file))} {shlex.quote(str(written))}"
    tell(f"compare them: {typed('das-sim')} report {both} -o what-if.html")


def _kind_of(origin: Origin, new: Otherwise, anew: bool | None) -> WhatIfKind:
    if anew is None:
        anew = new.driven.asks_for_a_driver or not origin.has_advice
    if anew:
        return WhatIfKind.DRIVEN_ANEW
    refuse_given("there is no driver in an open loop", "--driver", "--friction", "--participant", "--population")
    if new.driven.advice not in (None, Presentation.GUIDE, Presentation.SPEED_AND_EFFORT):
        refuse_given(
            "there is no display in an open loop: expected guide or speed-and-effort, or --driven-anew",
            "--advice",
        )
    return WhatIfKind.OPEN_LOOP


def _write_what_if(origin: Origin, new: Otherwise, kind: WhatIfKind, said: NodeSaid, out: Path) -> list[str]:
    if kind is WhatIfKind.OPEN_LOOP:
        from sim.runs.what_if.open_loop import advise_otherwise

        with progress_bar(f"replaying {origin.path.name}", "solving the first section", "messages") as progress:
            return advise_otherwise(origin, new, said, out, progress)
    from sim.runs.what_if.anew import day_again, drive_again

    refuse_given("a run driven anew solves its sections", "--tables")
    if origin.is_simulated:
        refuse_given("a simulated run is driven anew by its scenario", "--node")
    with busy("solving the sections …"):
        day, how = day_again(origin, new, said.node)
    with (
        naming_recorded(out),
        progress_bar(f"driving {origin.path.name} again", "starting node and recorder", "m") as progress,
    ):
        drive_again(day, how, out, progress)
    return [] if origin.is_simulated else [FROM_A_DRIVE]


def _compared_advice(files: Sequence[Path], train: str) -> tuple[dict[str, object], Callable[[], None]]:
    """The differences in the advice of an open loop, for programs, and a function that prints the differences."""
    from sim.runs.what_if.open_loop import advice_apart

    apart = advice_apart(files[0], files[1], train)
    return {"advice": apart._asdict()}, lambda: paragraph(apart.sentence)


def _compared_drives(files: Sequence[Path], train: str) -> tuple[dict[str, object], Callable[[], None]]:
    """The differences of two drives, for programs, and a function that prints the differences as in a report."""
    from sim.cli.review import print_comparison
    from sim.drive.comparison import as_dict, compared
    from sim.drive.drive import Drive
    from sim.recording.opening import open_recording

    aligned, why_not = compared([Drive(recording=open_recording(path, train)) for path in files])
    found: dict[str, object] = {"comparison": None if aligned is None else as_dict(aligned), "not_compared": why_not}
    return found, lambda: print_comparison(aligned, why_not)
