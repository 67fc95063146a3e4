"""The command das-record and its options in groups; what it does is imported only when it runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.application import single_command
from das.command_line.options import RECORDER_ENDPOINT, BusPlace, WithParentOption, listen_option
from das.command_line.running import run_command


@dataclass(frozen=True, kw_only=True)
class RecorderPlace(BusPlace):
    """Where the recorder hears."""

    listen: Annotated[str | None, listen_option(RECORDER_ENDPOINT)] = None


@dataclass(frozen=True, kw_only=True)
class FileMade:
    """What is recorded into, and what is put into it beside the messages."""

    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Recording (.mcap) to write; where it is there already, a new one beside it [default: TRAIN.mcap].",
        ),
    ] = None
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Write to --out even if it is there already.")] = False
    metadata: Annotated[
        str | None,
        typer.Option("--metadata", metavar="JSON", help="JSON object of texts, stored as metadata record 'run'."),
    ] = None
    attach: Annotated[
        list[Path] | None,
        typer.Option("--attach", metavar="FILE", help="File to put into the recording (may be repeated)."),
    ] = None


@dataclass(frozen=True, kw_only=True)
class RecorderOptions:
    """All of it."""

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


EXAMPLES = (
    "das-record --train IC1 -o ic1.mcap --connect tcp/127.0.0.1:7447 --connect tcp/127.0.0.1:7448",
    "das-record --train IC1 -o ic1.mcap --bus bus-tls/recorder.json5",
)


def record(options: RecorderOptions) -> None:
    """Record everything that is said on the bus about a train into an MCAP file, until it is stopped.

    It hears those to whom it connects, by default the node. What it heard is on the disk within a second.
    """
    from das.recorder.process import record as run

    run(options)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of das-record; `arguments` stand for the command line's."""
    command = single_command("das-record", record, EXAMPLES)
    run_command(lambda: command(args=arguments, standalone_mode=False, prog_name="das-record"))
