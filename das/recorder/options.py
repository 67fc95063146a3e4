"""The options of das-record, in groups."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import RECORDER_ENDPOINT, BusPlace, WithParentOption, listen_option


@dataclass(frozen=True, kw_only=True)
class RecorderPlace(BusPlace):
    """Where on the bus the recorder listens."""

    listen: Annotated[str | None, listen_option(RECORDER_ENDPOINT)] = None


@dataclass(frozen=True, kw_only=True)
class FileMade:
    """The file to record into, and what it holds besides the messages."""

    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Recording (.mcap) to write; if it exists, a new one is written next to it [default: TRAIN.mcap].",
        ),
    ] = None
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the recording if it exists already.")] = False
    metadata: Annotated[
        str | None,
        typer.Option("--metadata", metavar="JSON", help="JSON object of texts, stored as metadata record 'run'."),
    ] = None
    attach: Annotated[
        list[Path] | None,
        typer.Option("--attach", metavar="FILE", help="File to attach to the recording (may be repeated)."),
    ] = None


@dataclass(frozen=True, kw_only=True)
class RecorderOptions:
    """All options of das-record."""

    place: RecorderPlace
    made: FileMade
    start_ns: Annotated[
        int | None,
        typer.Option(
            "--start-ns",
            metavar="NS",
            help="The run's clock before its first Control message, ns since 1970 [default: the time of day].",
        ),
    ] = None
    with_parent: WithParentOption = None
