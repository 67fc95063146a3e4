"""The commands that review recorded drives: events and notes, energy, comparison, report, view."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.advice.wording import Language
from das.command_line.files import check_outputs, check_picture, save_figure
from das.command_line.given import refuse_given
from das.command_line.options import JsonOption, OverwriteOption, PlotOption
from das.command_line.printing import busy, loading_solver, new_table, paragraph, print_table, tell, typed, visible
from das.domain.errors import DasError
from sim.cli.options import (
    FromTimeOption,
    RecordingArgument,
    ToTimeOption,
    check_packages,
    tell_energy_range,
    tell_written,
)
from sim.drive.events.event import DriveEvent, EventKind, Filter
from sim.options import OfTrainOption, PageFiles

if TYPE_CHECKING:
    from sim.drive.attribution.attribution import Attribution
    from sim.drive.comparison import AlignedDrives
    from sim.drive.drive import Drive


BesideOption = Annotated[
    Path | None,
    typer.Option(
        "--beside",
        metavar="FILE",
        help="Recording of another drive on the line, whose speed is drawn under this one's.",
    ),
]
SaveOption = Annotated[
    Path | None,
    typer.Option("--save", metavar="FILE", help="File for rerun (.rrd) to write, instead of opening the viewer."),
]
PictureOption = Annotated[
    Path | None,
    typer.Option(
        "--plot",
        "--png",
        metavar="FILE",
        help="Picture to write instead (.png, .pdf or .svg): over distance, over time, and what happened.",
    ),
]
ThemeOption = Annotated[str, typer.Option("--theme", metavar="NAME", help="Picture: light (for paper) or dark.")]
MapOption = Annotated[
    bool,
    typer.Option("--map", help="Viewer: a map as well; it loads its tiles from OpenStreetMap over the network."),
]
LanguageOption = Annotated[
    Language, typer.Option("--language", help="Viewer: the language of what the driver's display shows.")
]
SHOWN = 8
"""The table of a comparison shows this many stretches: those on which the drives differ most."""


def events(
    file: RecordingArgument,
    kind: Annotated[
        list[EventKind] | None, typer.Option("--kind", help="Only events of this kind; may be given several times.")
    ] = None,
    search: Annotated[str, typer.Option("--search", metavar="TEXT", help="Only events whose text holds this.")] = "",
    from_time: FromTimeOption = None,
    to_time: ToTimeOption = None,
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
    _print_events(found, drive)


def _print_events(found: tuple[DriveEvent, ...], drive: Drive) -> None:
    from sim.drive.events.chronicle import place_text

    clock = drive.clock
    heads = ("time", str(clock.zone), "place", "kind")
    table = new_table("", ("bookmark", "what happened"), whole=heads, lines=True)
    for one in found:
        shown = (clock.shown(one.time_ns), clock.of_day(one.time_ns), place_text(one.s_m), str(one.kind))
        table.add_row(*shown, one.mark, visible(one.text))
    print_table(
        table, {"time": f"minutes and seconds since {clock.of_day(clock.zero_ns)} {clock.zone}, {clock.zero_is}"}
    )


def note(
    file: RecordingArgument,
    text: Annotated[str, typer.Argument(metavar="[TEXT]", help="What to remember.")] = "",
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
    author: Annotated[str, typer.Option("--author", metavar="NAME", help="The author of the note.")] = "",
    remove: Annotated[
        int | None, typer.Option("--remove", metavar="NUMBER", help="Take the note of this number away.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Add a note to a recording, or list its notes; they are kept in FILE.notes beside it."""
    from sim.drive.drive import Drive
    from sim.drive.events.event import Note, add_note, remove_note

    if (text == "") is not (at is None):
        example = 'das-sim note drive.mcap --at 12:34 "braked late"'
        raise DasError(f"a note needs its text and --at, for example: {example}")
    if not text:
        refuse_given("needs the text of a note", "--until", "--tag", "--author")
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
    """The first and last moment (ns) of a note; DasError if they are outside the drive."""
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
    from sim.drive.events.event import notes_path, read_notes

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


def energy(
    file: RecordingArgument,
    as_json: JsonOption = False,
) -> None:
    """Say where the energy of a recorded drive went, by cause and by place, against the optimum for the same times."""
    with loading_solver():
        from sim.drive.attribution.attribution import as_dict
        from sim.drive.drive import Drive

    with busy(f"reading {file} and solving its sections …"):
        drive = Drive.read(file)
        attribution = drive.known_attribution
    if as_json:
        print(json.dumps(as_dict(attribution)))
        return
    _print_causes(attribution)
    _print_places(attribution)
    if not attribution.above.measured:
        tell("The energies are estimates by inverse dynamics from positions: nobody measured them.")
    tell_energy_range(drive.inputs.route)


def _print_causes(attribution: Attribution) -> None:
    from rich.table import Table

    from das.domain.units import kwh
    from sim.drive.attribution.attribution import OTHER_TRAIN
    from sim.drive.attribution.causes import EnergyCause

    legs = attribution.legs
    table = Table(title="energy at the current collector, kWh", title_justify="left")
    table.add_column("")
    for leg in legs:
        table.add_column(f"{leg.leg.start.name} – {leg.leg.end.name}", justify="right")
    table.add_column("all", justify="right", no_wrap=True)

    def total(name: str, of_legs_j: Sequence[float], all_j: float) -> None:
        table.add_row(name, *(f"{kwh(one):.1f}" for one in (*of_legs_j, all_j)))

    def part(name: str, of_legs_j: Sequence[float], all_j: float) -> None:
        table.add_row(f"  {name}", *(f"{kwh(one):+.1f}" for one in (*of_legs_j, all_j)))

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


def _print_places(attribution: Attribution) -> None:
    from das.domain.units import kwh
    from sim.drive.attribution.worst import elsewhere, worst_places

    worst = worst_places(attribution)
    if worst:
        told = "; ".join(
            f"{one.where}: {kwh(one.more_j):.1f} kWh, {' and '.join(cause.label for cause in one.causes)}"
            for one in worst
        )
        tell(f"most lost above the optimum: {told}{elsewhere(worst, attribution.above.difference_j)}")


def compare(
    files: Annotated[
        list[Path], typer.Argument(metavar="RECORDING…", help="Two or more recordings (.mcap) of drives on one line.")
    ],
    step: Annotated[
        float, typer.Option("--step", metavar="METRES", help="Distance of the positions that are compared.")
    ] = 10.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Table (.csv) to write: one row a position.")
    ] = None,
    plot: PlotOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Compare recorded drives at the same places: where and by how much their times and energies part."""
    if len(files) < 2:
        raise DasError("expected two recordings or more, of which the first is the one to compare with")
    check_picture(plot)
    check_outputs(out, plot, inputs=files, overwrite=overwrite)
    from das.domain.files.writing import write_whole
    from sim.drive.comparison import AlignedDrives, as_csv, as_dict, drives_on_track
    from sim.drive.drive import Drive

    with busy("reading the recordings …"):
        aligned = AlignedDrives.of(drives_on_track([Drive.read(path) for path in files]), step)
    if out is not None:
        write_whole(out, as_csv(aligned))
    if plot is not None:
        from sim.review.canvas import comparison_figure

        save_figure(plot, comparison_figure(aligned))
    if as_json:
        print(json.dumps(as_dict(aligned)))
        return
    _print_comparison(aligned)
    tell_energy_range(aligned.drives[0].drive.inputs.route)
    tell_written(out, plot)


def _print_comparison(aligned: AlignedDrives) -> None:
    from sim.drive.comparison import sentences

    for index in range(1, len(aligned.drives)):
        for line in sentences(aligned, index):
            paragraph(line)
        _print_stretches(aligned, index)


def _print_stretches(aligned: AlignedDrives, index: int) -> None:
    """Print the stretches on which a drive differs most from the first; nothing if it does not differ."""
    from das.domain.units import kwh
    from sim.drive.events.chronicle import place_text

    parted = [
        one for one in aligned.pairs[index].stretches(1) if abs(one.time_s) >= 0.05 or abs(kwh(one.lost_j)) >= 0.005
    ]
    if not parted:
        return
    title = f"where {aligned.drives[index].label} parts from the first"
    table = new_table(title, (), ("from", "to", "time, s", "drawn, kWh", "lost, kWh"), lines=True)
    most = sorted(parted, key=lambda one: -abs(one.lost_j))[:SHOWN]
    for one in sorted(most, key=lambda one: one.start_m):
        numbers = (f"{one.time_s:+.1f}", f"{kwh(one.energy_j):+.2f}", f"{kwh(one.lost_j):+.2f}")
        table.add_row(place_text(one.start_m), place_text(one.end_m), *numbers)
    print_table(table, {"drawn": "at the current collector", "lost": "without what went into the train's speed"})


def report(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDING…", help="Recordings (.mcap); several drives of one line are compared as well."
        ),
    ],
    written: PageFiles,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write a report about recorded drives: one page for an instructor, then figures, pictures and what happened."""
    check_packages("view", "jinja2", "matplotlib")
    written.check(files, overwrite=overwrite)
    with loading_solver():
        from sim.review.report.page import as_dict, compared, page, subject_of
        from sim.review.report.sentences import paragraph as in_words

    with busy("reading the recordings and solving their sections …"):
        subjects = [subject_of(path) for path in files]
        aligned, not_compared = compared(subjects)
    written.write(lambda: page(subjects, aligned, not_compared))
    if as_json:
        print(json.dumps(as_dict(subjects, aligned, not_compared)))
        return
    for subject in subjects:
        paragraph(f"{subject.drive.name}: {in_words(subject.drive)}")
    tell_written(*written.paths)


def view(
    file: RecordingArgument,
    beside: BesideOption = None,
    save: SaveOption = None,
    plot: PictureOption = None,
    overwrite: OverwriteOption = False,
    start: FromTimeOption = None,
    end: ToTimeOption = None,
    theme: ThemeOption = "light",
    with_map: MapOption = False,
    language: LanguageOption = Language.EN,
    of_train: OfTrainOption = None,
) -> None:
    """Look at a recording in the rerun viewer, or as a picture: speed, limits, advice, forces, delay, events.

    For example: das-sim view run.mcap --from 10:00 --to 20:00 --plot part.pdf
    """
    check_picture(plot)
    check_outputs(save, plot, inputs=(file, beside), overwrite=overwrite)
    from das.drawing.meanings import THEMES
    from sim.drive.comparison import check_one_line
    from sim.recording.course import part_of
    from sim.recording.opening import open_recording
    from sim.review.view import ViewerChoice, open_view, save_picture, save_view

    if plot is None:
        refuse_given("needs --plot: the viewer has a theme of its own", "--theme")
    elif save is None:
        refuse_given("belongs to the viewer; with --plot it needs --save", "--map", "--language")
    if theme not in THEMES:
        raise DasError(f"--theme {theme}: expected one of {', '.join(THEMES)}")
    with busy(f"reading {file} …"):
        recording = part_of(open_recording(file, of_train), start, end)
        other = None if beside is None else open_recording(beside)
        check_one_line([recording] if other is None else [recording, other])
    if save is None and plot is None:
        open_view(recording, ViewerChoice(other, with_map, language))
    if plot is not None:
        with busy(f"drawing {plot} …"):
            save_picture(recording, plot, THEMES[theme], beside=other)
        tell(f"written: {plot}")
    if save is not None:
        with busy(f"writing {save} …"):
            save_view(recording, save, ViewerChoice(other, with_map, language))
        tell(f"written: {save}\nopen it with: {typed('rerun')} --bind 127.0.0.1 {shlex.quote(str(save))}")
