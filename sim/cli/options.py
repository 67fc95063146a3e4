"""Options of das-sim that no other program has; each is declared once, with its type, its spelling and its help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation

TripArgument = Annotated[
    Path, typer.Argument(metavar="TRIP", help="Recorded trip: CSV, GPX, or a recording (.mcap) of das-sim.")
]
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
RecordingArgument = Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording (.mcap) to read.")]
SpeedOption = Annotated[
    str, typer.Option("--speed", metavar="TIMES", help="How many times real time; or real, or max (no waiting).")
]
DriverOption = Annotated[DriverKind, typer.Option("--driver", help="Who drives (das-sim drivers explains them).")]
AdviceOption = Annotated[Presentation, typer.Option("--advice", help="What the driver's display shows.")]
FrictionOption = Annotated[
    FrictionPolicy,
    typer.Option(
        "--friction",
        help="How a human driver brakes where the motors could: with a share of friction (as-measured), with the "
        "motors (electric-first), or as measured unless he follows advice on effort (by-advice).",
    ),
]
