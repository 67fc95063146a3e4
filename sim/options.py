"""Options of das-sim that packages below its commands keep as data; `sim.cli.options` has the others."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.options import TablesOption
from das.domain.errors import DasError

LineOption = Annotated[
    Path | None,
    typer.Option(
        "--line",
        metavar="CSV",
        help="Kilometre posts with latitude and longitude, to which GPS points are matched [default: the route's map].",
    ),
]
OfTrainOption = Annotated[
    str | None,
    typer.Option(
        "--of-train", metavar="NAME", help="Which train, where the recording holds several.", show_default=False
    ),
]
SpeedOption = Annotated[
    str, typer.Option("--speed", metavar="TIMES", help="How many times real time; or real, or max (no waiting).")
]
ParticipantOption = Annotated[
    int | None,
    typer.Option(
        "--participant",
        metavar="N",
        min=0,
        help="Human driver number N of the population, the same on every day [default: the seed draws the driver].",
        show_default=False,
    ),
]
PopulationOption = Annotated[
    str | None,
    typer.Option(
        "--population",
        metavar="FILE",
        help="From whom participants are drawn: a TOML file [default: the bundled population].",
        show_default=False,
    ),
]


@dataclass(frozen=True, kw_only=True)
class NodeSaid:
    """What a recording's node was started with, where the user says it, and where its tables are."""

    node: Annotated[
        str | None,
        typer.Option(
            "--node", metavar="OPTIONS", show_default=False,
            help="What das-node was started with, in quotes [default: as the recording says].",
        ),
    ] = None  # fmt: skip
    tables: TablesOption = None


SLOWEST, FASTEST = 0.01, 1e6
"""Range of `--speed` in times real time."""


def speed_factor(text: str) -> float | None:
    """Times real time (`real` is 1); None for as fast as it goes."""
    if text == "max":
        return None
    try:
        value = 1.0 if text == "real" else float(text)
    except ValueError:
        value = float("nan")
    if not SLOWEST <= value <= FASTEST:
        raise DasError(f"--speed {text}: expected max, real or a number of times real time, 0.01 to 1000000")
    return value
