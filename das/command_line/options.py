"""Options that several commands have, declared once: type, spelling and help. Nothing heavy is imported here.

Where "default: …" is written in a help text, the option itself defaults to None.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from das.domain.levels import Level

DEFAULT_TRAIN: Final = "train-1"
"""Name of the train on the bus if the user gives none."""
NODE_ENDPOINT: Final = "tcp/127.0.0.1:7447"
"""Default endpoint at which a node listens."""
RECORDER_ENDPOINT: Final = "tcp/127.0.0.1:7449"
"""Default endpoint at which a recorder listens; das-node tls-init gives it the same port."""

_ROUTE = "bundled route, TOML file or TTOBench track (JSON)"
_VEHICLE = "bundled vehicle, TOML file or TTOBench train (JSON)"
_OF_RECORDING = "[default: the recording's]"

# --- what is driven -----------------------------------------------------------------------------------------------

RouteArgument = Annotated[str, typer.Argument(metavar="ROUTE", help=f"Route: {_ROUTE}.")]
VehicleArgument = Annotated[str, typer.Argument(metavar="VEHICLE", help=f"Vehicle: {_VEHICLE}.")]
RouteOption = Annotated[str, typer.Option("--route", metavar="ROUTE", help=f"Route: {_ROUTE}.")]
VehicleOption = Annotated[str, typer.Option("--vehicle", metavar="VEHICLE", help=f"Vehicle: {_VEHICLE}.")]
RecordedRouteOption = Annotated[
    str | None, typer.Option("--route", metavar="ROUTE", help=f"Route: {_ROUTE} {_OF_RECORDING}.")
]
RecordedVehicleOption = Annotated[
    str | None, typer.Option("--vehicle", metavar="VEHICLE", help=f"Vehicle: {_VEHICLE} {_OF_RECORDING}.")
]
FromOption = Annotated[
    str | None,
    typer.Option("--from", metavar="STOP", help="Stop where the section begins: its name or number [default: first]."),
]
ToOption = Annotated[
    str | None,
    typer.Option("--to", metavar="STOP", help="Stop where the section ends: its name or number [default: last]."),
]
ReverseOption = Annotated[bool, typer.Option("--reverse", help="Drive the route from its end to its start.")]
DirectionOption = Annotated[
    bool | None,
    typer.Option(
        "--reverse/--no-reverse",
        help="Direction of the trip: from the route's end to its start, or (--no-reverse) from its start to its end.",
    ),
]
LevelOption = Annotated[Level | None, typer.Option("--level", help="Loss level [default: the vehicle's].")]
LossMapOption = Annotated[
    Path | None,
    typer.Option(
        "--loss-map",
        metavar="CSV",
        help="Loss map (columns speed_kmh, force_n, loss_w) instead of the vehicle's losses; nothing else changes.",
    ),
]
PointMassOption = Annotated[bool, typer.Option("--point-mass", help="Take the train's length as 0.")]
LoadOption = Annotated[
    str | None,
    typer.Option("--load", metavar="NAME", help="Load state or mode in the vehicle's file, or both: LOAD+MODE."),
]
ModeOption = Annotated[
    str | None,
    typer.Option("--mode", metavar="NAME", help="Mode named in the vehicle's file [default: its default_mode]."),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")]

# --- the bus ------------------------------------------------------------------------------------------------------

TrainOption = Annotated[
    str, typer.Option("--train", metavar="NAME", help="Name of the train: the second part of every key on the bus.")
]
ConnectOption = Annotated[
    list[str] | None,
    typer.Option("--connect", metavar="ENDPOINT", help="Endpoint of another process; may be given several times."),
]
BusFileOption = Annotated[
    Path | None,
    typer.Option("--bus", metavar="FILE", help="Zenoh configuration of the site (JSON5) [default: only this machine]."),
]
BusFolderOption = Annotated[
    Path | None,
    typer.Option("--bus", metavar="DIR", help="Folder made by das-node tls-init [default: only this machine]."),
]
InsecureBusOption = Annotated[
    bool, typer.Option("--insecure-bus", help="Let --bus open the bus to the network without mutual TLS.")
]
WithParentOption = Annotated[
    int | None,
    typer.Option("--with-parent", metavar="PID", help="End when the parent process with this id ends."),
]
TablesOption = Annotated[
    Path | None, typer.Option("--tables", metavar="DIR", help="Folder of tables made by das-precompute build.")
]


def listen_option(default: str) -> Any:
    """The option for the endpoint at which a process listens; `default` is named in its help text."""
    return typer.Option("--listen", metavar="ENDPOINT", help=f"Own endpoint on this machine [default: {default}].")


@dataclass(frozen=True, kw_only=True)
class BusPlace:
    """The place of a process on the bus. Each program declares its own `listen`, with its own default endpoint."""

    train: TrainOption = DEFAULT_TRAIN
    listen: str | None = None
    connect: ConnectOption = None
    bus: BusFileOption = None
    insecure_bus: InsecureBusOption = False


# --- what comes out -----------------------------------------------------------------------------------------------

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")]
OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Replace an existing file; symbolic links are rejected.")
]
OutFolder = Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.")]
OutFolderOption = Annotated[Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the results.")]
OutRecordingOption = Annotated[
    Path | None,
    typer.Option(
        "--out", "-o", metavar="FILE", help="Recording (.mcap) to write [default: a new file in ./recordings]."
    ),
]
PlotOption = Annotated[
    Path | None, typer.Option("--plot", metavar="FILE", help="Picture to write: .png, .pdf or .svg.")
]
