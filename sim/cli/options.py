"""Options of das-sim that no other program has; each is declared once, with its type, its spelling and its help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from sim.drivers.kinds import FrictionPolicy, Presentation

DEFAULT_DRIVER_AT: Final = "tcp/127.0.0.1:7450"
"""Where a run listens for an external driver."""

TripArgument = Annotated[
    Path, typer.Argument(metavar="TRIP", help="Recorded trip: CSV, GPX, or a recording (.mcap) of das-sim.")
]
RecordingArgument = Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording (.mcap) to read.")]
DriverOption = Annotated[
    str,
    typer.Option(
        "--driver",
        metavar="DRIVER",
        help="Who drives: perfect, fast, rms, timetable, human, a class of your own (package.module:Class), or "
        "external, a process of its own (das-sim drivers explains them).",
    ),
]
AdviceOption = Annotated[Presentation, typer.Option("--advice", help="What the driver's display shows.")]
FrictionOption = Annotated[
    FrictionPolicy,
    typer.Option(
        "--friction",
        help="How a human driver brakes where the motors could: with a share of friction (as-measured), with the "
        "motors (electric-first), or as measured unless he follows advice on effort (by-advice).",
    ),
]
DriverAtOption = Annotated[
    str | None,
    typer.Option(
        "--driver-at",
        metavar="ENDPOINT",
        help=f"Where the run listens for an external driver [default: {DEFAULT_DRIVER_AT}].",
        show_default=False,
    ),
]
DriverHereOption = Annotated[
    str,
    typer.Option(
        "--driver", metavar="DRIVER", help="Who drives: a name, or a class of your own (package.module:Class)."
    ),
]
RunAtOption = Annotated[
    str | None,
    typer.Option(
        "--connect",
        metavar="ENDPOINT",
        help=f"Where the run listens [default: {DEFAULT_DRIVER_AT}].",
        show_default=False,
    ),
]
DriversOption = Annotated[
    str,
    typer.Option(
        "--drivers",
        metavar="LIST",
        help="Who drives, with commas between: names (das-sim drivers lists them) or classes of your own "
        "(package.module:Class).",
    ),
]
ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="Bundled scenario (das-sim scenarios lists them) or TOML file.")
]
InProcessOption = Annotated[
    bool, typer.Option("--in-process", help="Run without bus and recording: the same brain in this process.")
]
ParticipantsOption = Annotated[
    str | None,
    typer.Option(
        "--participants",
        metavar="LIST",
        help="Human drivers of the population, like 1-30, each on every day [default: the seed draws the driver].",
        show_default=False,
    ),
]
