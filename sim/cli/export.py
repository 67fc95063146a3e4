"""The command `das-sim export`: a recording as tables for other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import JsonOption
from das.command_line.printing import busy, paragraph, tell
from sim.cli.options import RecordingArgument
from sim.cli.shared import chosen
from sim.options import OfTrainOption


def export(
    file: RecordingArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="New folder to write the tables into.")],
    start: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="TIME",
            help="Leave out what was before: 12:34 on the drive's clock, or 08:16:34Z.",
            show_default=False,
        ),
    ] = None,
    end: Annotated[
        str | None,
        typer.Option("--to", metavar="TIME", help="Leave out what came after, in the same form.", show_default=False),
    ] = None,
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
