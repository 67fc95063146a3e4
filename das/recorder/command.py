"""The command das-record; the code that records is imported only when it runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.application import imported, run_app, single_command
from das.command_line.options import RECORDER_ENDPOINT, BusPlace, WithParentOption, listen_option


@dataclass(frozen=True, kw_only=True)
class RecorderPlace(BusPlace):
    """Endpoints at which the recorder listens."""

    listen: Annotated[str | None, listen_option(RECORDER_ENDPOINT)] = None


@dataclass(frozen=True, kw_only=True)
class RecorderOptions:
    """All options of das-record: its place on the bus, the file to record into and its contents besides messages."""

    place: RecorderPlace
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
    start_ns: Annotated[
        int | None,
        typer.Option(
            "--start-ns",
            metavar="NS",
            min=0,
            help="The run's clock before its first Control message, ns since 1970 [default: the time of day].",
        ),
    ] = None
    with_parent: WithParentOption = None


EXAMPLES = (
    "das-record --train IC1 -o ic1.mcap --connect tcp/127.0.0.1:7447 --connect tcp/127.0.0.1:7448",
    "das-record --train IC1 -o ic1.mcap --bus bus-tls/recorder.json5",
)


def record(options: RecorderOptions) -> None:
    """Record every message on the bus about a train in an MCAP file, until stopped.

    It receives messages from the processes to which it connects, by default the node. Each message is on the disk
    within a second.
    """
    imported("das.recorder.process:record")(options)


def main() -> None:
    """Entry point of das-record."""
    run_app(single_command("das-record", record, EXAMPLES), "das-record")
