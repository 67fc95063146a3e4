"""The commands that review recorded drives: report and view."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.advice.wording import Language
from das.command_line.files import check_outputs
from das.command_line.options import JsonOption, OverwriteOption
from das.command_line.printing import busy, loading_solver, new_table, paragraph, print_table, tell, typed, visible
from das.domain.errors import DasError
from sim.cli.options import (
    FromTimeOption,
    RecordingArgument,
    ToTimeOption,
    check_packages,
    chosen,
    tell_energy_range,
    tell_written,
)
from sim.options import OfTrainOption, PageFiles

if TYPE_CHECKING:
    from sim.drive.attribution import Attribution
    from sim.drive.comparison import AlignedDrives
    from sim.drive.drive import Drive
    from sim.drive.events import Filter
    from sim.review.page import ReviewedDrive


class ReportPart(StrEnum):
    """The parts that `das-sim report` prints for each drive."""

    WORDS = "words"
    EVENTS = "events"
    BOOKMARKS = "bookmarks"
    ENERGY = "energy"


@dataclass(frozen=True, kw_only=True)
class ListedEvents:
    """The filter for the events that `das-sim report` lists; with None everywhere, every event passes."""

    kind: Annotated[
        list[str] | None,
        typer.Option("--kind", metavar="KIND", help="Only events of this kind; may be repeated."),
    ] = None
    from_time: FromTimeOption = None
    to_time: ToTimeOption = None

    @property
    def given(self) -> bool:
        """Whether events are filtered at all."""
        return any((self.kind, self.from_time, self.to_time))

    def filter(self, drive: Drive, *, bookmarks: bool) -> Filter:
        """The filter with times on the clock of a drive; raises DasError for an unknown kind or an invalid time."""
        from sim.drive.events import EventKind, Filter

        def moment_ns(text: str | None) -> int | None:
            return None if text is None else drive.table.clock.moment_ns(text)

        return Filter(
            kinds=tuple(chosen(EventKind, "--kind", one) for one in self.kind or ()),
            from_ns=moment_ns(self.from_time),
            to_ns=moment_ns(self.to_time),
            bookmarks=bookmarks,
        )


@dataclass(frozen=True, kw_only=True)
class NewNote:
    """A note to be added to a recording before the report is made."""

    note: Annotated[
        str | None,
        typer.Option("--note", metavar="TEXT", help="Note to save next to the recording, about the time --at."),
    ] = None
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="TIME", help="Time of the note: 12:34 on the drive's clock, or 08:16:34Z."),
    ] = None

    def add(self, files: Sequence[Path]) -> None:
        """Add the note, if any; raises DasError without a time, outside the drive, or for several recordings."""
        if self.note is None and self.at is None:
            return
        from sim.drive.drive import Drive
        from sim.drive.notes import Note, add_note

        if self.note is None or self.at is None or len(files) != 1:
            example = 'das-sim report drive.mcap --note "braked late" --at 12:34'
            raise DasError(f"a note needs its text, --at and one recording, for example: {example}")
        table = Drive.read(files[0]).table
        at_ns, (first_ns, last_ns) = table.clock.moment_ns(self.at), table.course.time_ns[[0, -1]].tolist()
        if not first_ns <= at_ns <= last_ns:
            ends = f"{table.clock.shown(first_ns)} to {table.clock.shown(last_ns)}"
            raise DasError(f"--at {self.at}: expected a time of the drive, {ends}")
        tell_written(add_note(files[0], Note(at_ns, self.note)))


SHOWN = 8
"""Number of stretches in the table of a comparison, which lists those on which the drives differ most."""


def report(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDING…", help="Recordings (.mcap); several drives of one line are compared with the first."
        ),
    ],
    written: PageFiles,
    listed: ListedEvents,
    noted: NewNote,
    show: Annotated[
        list[ReportPart] | None,
        typer.Option("--show", help="Part to print for each drive; may be repeated [default: words]."),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option("--table", metavar="FILE", help="Table (.csv) of the compared drives: a row every 10 m."),
    ] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write a report on recorded drives: one page for an instructor, then figures, pictures and events."""
    parts = tuple(show or (ReportPart.WORDS,))
    whole = as_json or any(path is not None for path in written.paths)
    _check_asked(files, parts, listed, table)
    if whole:
        check_packages("view", "jinja2", "matplotlib")
    written.check(files, table, overwrite=overwrite)
    noted.add(files)
    if not whole and len(files) == 1 and not {ReportPart.WORDS, ReportPart.ENERGY} & {*parts}:
        _print_listed(files[0], parts, listed)
        return
    with loading_solver():
        from sim.drive.comparison import compared
    with busy("reading the recordings and solving their sections …"):
        drives, subjects = _read(files, whole=whole)
        aligned, not_compared = compared(drives)
    if whole:
        from sim.review.page import as_dict, page

        written.write(lambda: page(subjects, aligned, not_compared))
    if table is not None:
        _write_csv(table, aligned, not_compared)
    if as_json:
        print(json.dumps(as_dict(subjects, aligned, not_compared)))
        return
    for drive in drives:
        _print_parts(drive, parts, listed)
    print_comparison(aligned, not_compared)
    tell_written(*written.paths, table)


def _read(files: Sequence[Path], *, whole: bool) -> tuple[list[Drive], list[ReviewedDrive]]:
    """The drives; for a page or JSON (`whole`) also the checks of their recordings."""
    if not whole:
        from sim.drive.drive import Drive

        return [Drive.read(path) for path in files], []
    from sim.review.page import subject_of

    subjects = [subject_of(path) for path in files]
    return [one.drive for one in subjects], subjects


def _check_asked(files: Sequence[Path], parts: Sequence[ReportPart], listed: ListedEvents, table: Path | None) -> None:
    if listed.given and not {ReportPart.EVENTS, ReportPart.BOOKMARKS} & {*parts}:
        raise DasError("--kind, --from and --to select events: expected --show events or --show bookmarks as well")
    if table is not None and len(files) < 2:
        raise DasError("--table: expected two or more recordings, to compare the others with the first")


def _print_listed(file: Path, parts: Sequence[ReportPart], listed: ListedEvents) -> None:
    from sim.drive.drive import Drive

    with busy(f"reading {file} …"):
        drive = Drive.read(file)
    _print_parts(drive, parts, listed)


def _print_parts(drive: Drive, parts: Sequence[ReportPart], listed: ListedEvents) -> None:
    for part in parts:
        if part is ReportPart.WORDS:
            from sim.review.first_page import in_lines

            happened, *others = in_lines(drive)
            for line in (f"{drive.name}: {happened}", *others):
                paragraph(line)
        elif part is ReportPart.ENERGY:
            _print_energy(drive)
        else:
            _print_events(drive, listed.filter(drive, bookmarks=part is ReportPart.BOOKMARKS))


def _write_csv(path: Path, aligned: AlignedDrives | None, not_compared: str) -> None:
    from das.domain.files.writing import write_whole
    from sim.drive.comparison import as_csv

    if aligned is None:
        raise DasError(f"--table: {not_compared}")
    write_whole(path, as_csv(aligned))


def _print_events(drive: Drive, wanted: Filter) -> None:
    from sim.drive.events import place_text

    clock, found = drive.table.clock, wanted.choose(drive.events)
    if not drive.recording.complete:
        tell(f"{drive.recording.path}: this recording was cut off; only events up to that time are listed")
    if not found:
        tell(f"none of the {len(drive.events)} events matches the filter")
        return
    heads = ("time", str(clock.zone), "place", "kind")
    table = new_table("", ("bookmark", "what happened"), whole=heads, lines=True)
    for one in found:
        shown = (clock.shown(one.time_ns), clock.of_day(one.time_ns), place_text(one.s_m), str(one.kind))
        table.add_row(*shown, one.mark, visible(one.text))
    print_table(
        table, {"time": f"minutes and seconds since {clock.of_day(clock.zero_ns)} {clock.zone}, {clock.zero_is}"}
    )


def _print_energy(drive: Drive) -> None:
    attribution = drive.energy.known_attribution
    _print_causes(attribution)
    if not attribution.above.measured:
        tell("The energies are estimates by inverse dynamics from positions, not measured.")
    tell_energy_range(drive.table.inputs.route)


def _print_causes(attribution: Attribution) -> None:
    from rich.table import Table

    from das.domain.units import kwh_figure
    from sim.drive.attribution import OTHER_TRAIN
    from sim.drive.causes import EnergyCause

    legs = attribution.legs
    table = Table(title="energy at the current collector, kWh", title_justify="left")
    table.add_column("")
    for leg in legs:
        table.add_column(f"{leg.leg.start.name} – {leg.leg.end.name}", justify="right")
    table.add_column("all", justify="right", no_wrap=True)

    def total(name: str, of_legs_j: Sequence[float], all_j: float) -> None:
        table.add_row(name, *(kwh_figure(one) for one in (*of_legs_j, all_j)))

    def part(name: str, of_legs_j: Sequence[float], all_j: float) -> None:
        table.add_row(f"  {name}", *(kwh_figure(one, signed=True) for one in (*of_legs_j, all_j)))

    told = dict(attribution.by_cause)
    if attribution.against_timetable is not None and attribution.timetable_j is not None:
        total("optimum for the timetable", [leg.timetable_j or 0.0 for leg in legs], attribution.timetable_j)
        for cause in (EnergyCause.RECOVERED, EnergyCause.ARRIVAL):
            told[cause] = attribution.against_timetable[cause]
            part(cause.label, [(leg.against_timetable or {}).get(cause, 0.0) for leg in legs], told[cause])
        if attribution.other_train_j:
            part(OTHER_TRAIN, [leg.other_train_j for leg in legs], attribution.other_train_j)
    total("optimum for the same times", best := [leg.optimum_j for leg in legs], sum(best))
    for cause, energy_j in attribution.by_cause.items():
        part(cause.label, [leg.by_cause.get(cause, 0.0) for leg in legs], energy_j)
    total("as driven", driven := [leg.driven_j for leg in legs], sum(driven))
    print_table(table, {cause.label: cause.meaning.rstrip(".") for cause in told})


def print_comparison(aligned: AlignedDrives | None, not_compared: str) -> None:
    """Print the differences of each drive from the first, or why none are known; nothing for a single drive."""
    if aligned is None:
        if not_compared:
            tell(f"not compared: {not_compared}")
        return
    from sim.drive.comparison import sentences

    for index in range(1, len(aligned.drives)):
        for line in sentences(aligned, index):
            paragraph(line)
        _print_stretches(aligned, index)
    tell_energy_range(aligned.drives[0].drive.table.inputs.route)


def _print_stretches(aligned: AlignedDrives, index: int) -> None:
    from das.domain.units import kwh

    parted = [
        one for one in aligned.pairs[index].stretches(1) if abs(one.time_s) >= 0.05 or abs(kwh(one.lost_j)) >= 0.005
    ]
    if not parted:
        return
    title = f"where {aligned.drives[index].label} differs from the first"
    table = new_table(title, (), ("from", "to", "time, s", "drawn, kWh", "lost, kWh"), lines=True)
    most = sorted(parted, key=lambda one: -abs(one.lost_j))[:SHOWN]
    for one in sorted(most, key=lambda one: one.start_m):
        table.add_row(*one.cells)
    print_table(table, {"drawn": "at the current collector", "lost": "without the train's kinetic energy"})


def view(
    file: RecordingArgument,
    save: Annotated[
        Path | None,
        typer.Option("--save", metavar="FILE", help="File for rerun (.rrd) to write, instead of opening the viewer."),
    ] = None,
    overwrite: OverwriteOption = False,
    start: FromTimeOption = None,
    end: ToTimeOption = None,
    language: Annotated[Language, typer.Option("--language", help="Language of the driver's display.")] = Language.EN,
    of_train: OfTrainOption = None,
) -> None:
    """Look at a recording in the rerun viewer: speed, limits, advice, forces, delay, events.

    For example: das-sim view run.mcap --from 10:00 --to 20:00 --save part.rrd
    """
    check_outputs(save, inputs=(file,), overwrite=overwrite)
    check_packages("view", "rerun", "rerun_cli")
    from sim.drive.drive import Drive
    from sim.recording.course import part_of
    from sim.recording.opening import open_recording
    from sim.review.view import open_view, save_view

    with busy(f"reading {file} …"):
        drive = Drive(recording=part_of(open_recording(file, of_train), start, end))
    if save is None:
        open_view(drive, language)
        return
    with busy(f"writing {save} …"):
        save_view(drive, save, language)
    tell(f"written: {save}\nopen it with: {typed('rerun')} --bind 127.0.0.1 {shlex.quote(str(save))}")
