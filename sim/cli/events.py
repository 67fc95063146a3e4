"""The commands `das-sim events` and `das-sim note`: what happened on a recorded drive, and people's notes on it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.options import JsonOption
from das.command_line.printing import busy, print_table, tell, visible
from das.domain.errors import DasError
from sim.drive.events.event import DriveEvent, EventKind, Filter

if TYPE_CHECKING:
    from sim.drive.drive import Drive

RecordingArgument = Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording (.mcap).")]
FromTime = Annotated[
    str | None,
    typer.Option("--from", metavar="TIME", help="Only from here on: 12:34 on the drive's clock, or 08:16:34Z."),
]
ToTime = Annotated[str | None, typer.Option("--to", metavar="TIME", help="Only what happened up to here.")]


def events(
    file: RecordingArgument,
    kind: Annotated[
        list[EventKind] | None, typer.Option("--kind", help="Only events of this kind; may be given several times.")
    ] = None,
    search: Annotated[str, typer.Option("--search", metavar="TEXT", help="Only events whose text holds this.")] = "",
    from_time: FromTime = None,
    to_time: ToTime = None,
    bookmarks: Annotated[
        bool, typer.Option("--bookmarks", help="Only what a reviewer wants to see first, and the notes of people.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List what happened on a recorded drive, when, where and why, with the notes that people made."""
    from sim.drive.drive import Drive
    from sim.drive.events.chronicle import as_rows

    with busy(f"reading {file} …"):
        drive = Drive.read(file)
    clock = drive.clock
    wanted = Filter(
        kinds=tuple(kind or ()),
        text=search,
        from_ns=None if from_time is None else clock.moment_ns(from_time),
        to_ns=None if to_time is None else clock.moment_ns(to_time),
        bookmarks=bookmarks,
    )
    found = wanted.choose(drive.events)
    if as_json:
        print(json.dumps({"recording": str(file), "zero_ns": clock.zero_ns, "events": as_rows(found, clock)}))
        return
    if not drive.recording.complete:
        tell(f"{file}: this recording was cut off; these are the events before that")
    if not found:
        tell(f"no such events among {len(drive.events)}")
        return
    _print(found, drive)


def _print(found: tuple[DriveEvent, ...], drive: Drive) -> None:
    from rich.table import Table

    from sim.drive.events.chronicle import place_text

    clock = drive.clock
    table = Table()
    for name in ("time", "UTC", "place", "kind"):
        table.add_column(name, no_wrap=True)
    table.add_column("bookmark")
    table.add_column("what happened")
    for one in found:
        shown = (clock.shown(one.time_ns), clock.of_day(one.time_ns), place_text(one.s_m), str(one.kind))
        table.add_row(*shown, one.mark, visible(one.text))
    print_table(table, {"time": f"minutes and seconds since {clock.of_day(clock.zero_ns)} UTC, {clock.zero_is}"})


def note(
    file: RecordingArgument,
    text: Annotated[str, typer.Argument(metavar="[TEXT]", help="What to remember.", show_default=False)] = "",
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="TIME", help="When: 12:34 on the drive's clock, or 08:16:34Z."),
    ] = None,
    until: Annotated[
        str | None, typer.Option("--until", metavar="TIME", help="End, for a note about a while [default: the same].")
    ] = None,
    tag: Annotated[
        list[str] | None, typer.Option("--tag", metavar="WORD", help="A tag; may be given several times.")
    ] = None,
    author: Annotated[str, typer.Option("--author", metavar="NAME", help="Who makes the note.")] = "",
    remove: Annotated[
        int | None, typer.Option("--remove", metavar="NUMBER", help="Take the note of this number away.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Add a note to a recording, or list its notes; they are kept in FILE.notes.mcap beside it."""
    from sim.drive.drive import Drive
    from sim.drive.events.notes import Note, add_note, remove_note

    if (text == "") is not (at is None):
        example = 'das-sim note drive.mcap --at 12:34 "braked late"'
        raise DasError(f"a note needs its text and --at, for example: {example}")
    if remove is not None and text:
        raise DasError("--remove: expected no text beside it")
    drive = Drive.read(file)
    if remove is not None:
        remove_note(file, remove)
    if at is not None:
        start_ns, end_ns = _times(drive, at, until)
        add_note(file, Note(time_ns=start_ns, end_ns=end_ns, text=text, tags=tuple(tag or ()), author=author))
    _list_notes(file, drive, as_json)


def _times(drive: Drive, at: str, until: str | None) -> tuple[int, int]:
    """The first and last moment (ns) of a note; DasError where they are not of the drive."""
    clock, trip = drive.clock, drive.course
    start_ns = clock.moment_ns(at)
    end_ns = start_ns if until is None else clock.moment_ns(until)
    first_ns, last_ns = int(trip.time_ns[0]), int(trip.time_ns[-1])
    if not first_ns <= start_ns <= last_ns:
        raise DasError(f"--at {at}: expected a time of the drive, {clock.shown(first_ns)} to {clock.shown(last_ns)}")
    if end_ns < start_ns:
        raise DasError(f"--until {until}: expected a time after --at {at}")
    return start_ns, end_ns


def _list_notes(file: Path, drive: Drive, as_json: bool) -> None:
    from sim.drive.events.notes import notes_path, read_notes

    clock, kept = drive.clock, read_notes(file)
    if as_json:
        found = [
            {
                "number": number,
                "time_s": clock.since_s(one.time_ns),
                "end_s": clock.since_s(one.end_ns),
                "text": one.text,
                "tags": list(one.tags),
                "author": one.author,
            }
            for number, one in enumerate(kept, start=1)
        ]
        print(json.dumps({"recording": str(file), "file": str(notes_path(file)), "notes": found}))
        return
    tell(f"{notes_path(file)}:" if kept else f"{file} has no notes yet")
    for number, one in enumerate(kept, start=1):
        tags = f" [{', '.join(one.tags)}]" if one.tags else ""
        tell(f"{number}. {clock.shown(one.time_ns)} {one.text}{tags}")
