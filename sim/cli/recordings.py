"""The commands about a recording as a file: check, recover, reproduce, export and view."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.files import check_outputs, check_picture
from das.command_line.options import JsonOption, OverwriteOption
from das.command_line.printing import busy, loading_solver, paragraph, print_table, tell, typed
from das.command_line.process import interrupt_on_termination
from das.domain.errors import DasError
from sim.cli.options import FromTimeOption, RecordingArgument, ToTimeOption, chosen
from sim.options import NodeSaid, OfTrainOption
from sim.progress import progress_bar

if TYPE_CHECKING:
    from sim.recording.check import Checked
    from sim.runs.reproduce.reproduce import Difference, Reproduction


EXIT_FINDINGS = 1


def check(file: RecordingArgument, of_train: OfTrainOption = None, as_json: JsonOption = False) -> None:
    """Check a recording: checksums, holes, topics, rates, gaps, late advice, versions, input files.

    The exit code is 1 where something is wrong, 0 where nothing is.
    """
    from sim.recording.check import check_file

    with busy(f"checking {file} …"):
        found = check_file(file, of_train)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        _print_check(found)
    if found.findings:
        raise typer.Exit(EXIT_FINDINGS)


def _print_check(found: Checked) -> None:
    from rich.table import Table

    from sim.recording.check import RATE_COLUMNS

    figures = Table(title=str(found.recording.path), title_justify="left", show_header=False)
    figures.add_column(no_wrap=True)
    figures.add_column()
    for name, value in found.figures.items():
        figures.add_row(name, value)
    print_table(figures)
    rates = Table(title="topics", title_justify="left")
    rates.add_column(RATE_COLUMNS[0], no_wrap=True)
    for name in RATE_COLUMNS[1:]:
        rates.add_column(name, justify="right")
    for row in found.rate_rows():
        rates.add_row(*row)
    print_table(rates)
    for line in found.lines():
        tell(line)
    if found.recording.health.damage or not found.recording.complete:
        tell(f"save what is sound: {typed('das-sim')} recover {found.recording.path} -o NEW.mcap")


def recover(
    file: RecordingArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="New recording (.mcap) to write.")],
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Save what is sound in a cut or damaged recording into a new file, and say what is gone."""
    check_outputs(out, inputs=(file,), overwrite=overwrite)
    with busy(f"reading {file} …"):
        from sim.recording.course import utc
        from sim.recording.recover import recover as save

        found = save(file, out)
    if as_json:
        print(json.dumps(found.as_dict()))
        return
    for line in found.losses():
        tell(line)
    if found.health.sound:
        tell("nothing was wrong with this recording")
    elif not found.losses():
        tell("it was cut off between two records: all that was written is saved")
    tell(f"saved: {found.messages} messages up to {utc(found.last_ns)} UTC, {found.attachments} attached files")
    tell(f"written: {out}")


EXIT_DIFFERENT = 1
MOST_FIELDS = 12
"""At most this many fields of the first message that differs are shown."""


def reproduce(
    file: RecordingArgument,
    said: NodeSaid,
    of_train: OfTrainOption = None,
    as_json: JsonOption = False,
) -> None:
    """Let today's cab hear a recording again, and compare all that it says with what was recorded.

    The exit code is 1 where something differs, 0 where nothing does.
    """
    interrupt_on_termination()
    with loading_solver():
        from das.cab.warm_up import warm_up
        from sim.runs.reproduce.reproduce import reproduce as run

        warm_up()
    with progress_bar(f"hearing {file.name} again", "solving the first section", "messages") as progress:
        found = run(file, progress, train=of_train, node=said.node, tables=said.tables)
    if as_json:
        print(json.dumps(found.as_dict()))
    else:
        _print_reproduction(found)
    if not found.same:
        raise typer.Exit(EXIT_DIFFERENT)


def _print_reproduction(found: Reproduction) -> None:
    counts = ", ".join(f"{count} {topic}" for topic, count in found.comparison.compared.items())
    tell(f"{found.path}: {found.ticks} ticks, compared: {counts}")
    for note in found.notes:
        tell(f"note: {note}")
    differences = found.comparison.differences
    if not differences:
        tell("today's cab says the same")
        return
    tell(f"{len(differences)} messages differ; the first:")
    _print_first(differences[0], found)
    tell("all fields that differ:")
    for path, (count, most) in found.comparison.by_field.items():
        by = "" if most != most else f", by up to {most:.6g}"  # noqa: PLR0124
        tell(f"  {path}: {count} message{'s' if count > 1 else ''}{by}")
    only = {"recorded only": sum(one.today is None for one in differences)}
    only["said today only"] = sum(one.recorded is None for one in differences)
    for what, count in only.items():
        if count:
            tell(f"  {what}: {count} message{'s' if count > 1 else ''}")


def _print_first(first: Difference, found: Reproduction) -> None:
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
    for before_s, topic, text in found.context:
        tell(f"  heard {before_s:.1f} s before: {topic}: {text[:200]}")


def export(
    file: RecordingArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="New folder to write the tables into.")],
    start: FromTimeOption = None,
    end: ToTimeOption = None,
    trim_ends: Annotated[
        bool,
        typer.Option("--trim-ends", help="Leave out what was before the train first moved and after it last did."),
    ] = False,
    anonymous: Annotated[
        bool,
        typer.Option(
            "--anonymous",
            help="Leave out who and where: names, texts, places on the map, the day, the zero of the route.",
        ),
    ] = False,
    kind: Annotated[str, typer.Option("--format", metavar="FORMAT", help="parquet, csv or both.")] = "both",
    of_train: OfTrainOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write a recording as tables: one a topic, one by time, one by position; units are in their columns."""
    from sim.drive.export.export import ExportSettings, FileFormat
    from sim.drive.export.export import export as write

    settings = ExportSettings(
        start=start,
        end=end,
        trim_ends=trim_ends,
        anonymous=anonymous,
        format=chosen(FileFormat, "--format", kind),
    )
    with busy(f"writing tables to {out} …"):
        found = write(file, out, settings, of_train)
    if as_json:
        print(json.dumps({"folder": str(found.folder), "rows": found.rows, "files": found.files}))
        return
    paragraph("rows: " + ", ".join(f"{name} {rows}" for name, rows in found.rows.items()))
    tell(f"written: {found.files} files in {found.folder}; columns.csv says what each column is")


SaveOption = Annotated[
    Path | None,
    typer.Option("--save", metavar="FILE", help="File for rerun (.rrd) to write, instead of opening the viewer."),
]
PlotOption = Annotated[
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


def view(
    file: RecordingArgument,
    save: SaveOption = None,
    plot: PlotOption = None,
    overwrite: OverwriteOption = False,
    start: FromTimeOption = None,
    end: ToTimeOption = None,
    theme: ThemeOption = "light",
    with_map: MapOption = False,
    of_train: OfTrainOption = None,
) -> None:
    """Look at a recording in the rerun viewer, or as a picture: speed, limits, advice, forces, delay, events.

    For example: das-sim view run.mcap --from 10:00 --to 20:00 --plot part.pdf
    """
    check_picture(plot)
    check_outputs(save, plot, inputs=(file,), overwrite=overwrite)
    from sim.recording.course import part_of
    from sim.recording.opening import open_recording
    from sim.review.colors import THEMES
    from sim.review.view import open_view, save_picture, save_view

    if theme not in THEMES:
        raise DasError(f"--theme {theme}: expected one of {', '.join(THEMES)}")
    with busy(f"reading {file} …"):
        recording = part_of(open_recording(file, of_train), start, end)
    if save is None and plot is None:
        open_view(recording, with_map=with_map)
    if plot is not None:
        with busy(f"drawing {plot} …"):
            save_picture(recording, plot, THEMES[theme])
        tell(f"written: {plot}")
    if save is not None:
        with busy(f"writing {save} …"):
            save_view(recording, save, with_map=with_map)
        tell(f"written: {save}\nopen it with: {typed('rerun')} --bind 127.0.0.1 {shlex.quote(str(save))}")
