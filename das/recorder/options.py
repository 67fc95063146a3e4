"""What das-record is started with, in groups; nothing heavy is imported here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import (
    DEFAULT_TRAIN,
    BusFileOption,
    ConnectOption,
    InsecureBusOption,
    TrainOption,
)

OWN_ENDPOINT = "tcp/127.0.0.1:7449"
"""Where the recorder listens; das-node tls-init gives it the same port."""
NODE_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a node listens that is not told otherwise."""


@dataclass(frozen=True, kw_only=True)
class BusHeard:
    """Where the recorder hears."""

    train: TrainOption = DEFAULT_TRAIN
    listen: Annotated[
        str | None,
        typer.Option(
            "--listen",
            metavar="ENDPOINT",
            help=f"Own endpoint on this machine [default: {OWN_ENDPOINT}].",
            show_default=False,
        ),
    ] = None
    connect: ConnectOption = None
    bus: BusFileOption = None
    insecure_bus: InsecureBusOption = False


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

    place: BusHeard
    made: FileMade
    start_ns: Annotated[
        int | None,
        typer.Option(
            "--start-ns",
            metavar="NS",
            help="The run's clock before its first Control message, ns since 1970 [default: the time of day].",
        ),
    ] = None
    with_parent: Annotated[
        int | None,
        typer.Option("--with-parent", metavar="PID", help="End with the process of this id, which started it."),
    ] = None
