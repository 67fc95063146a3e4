"""Options of a replay, and of a look at a trip."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from das.domain.losses import Level

TripArgument = Annotated[Path, typer.Argument(help="Trip: CSV, GPX or MCAP of ours (see docs/reference/trips.md).")]
RouteOption = Annotated[
    str | None, typer.Option(help="Bundled route, TOML or TTOBench track [default: the recording's].")
]
VehicleOption = Annotated[
    str | None, typer.Option(help="Bundled vehicle, TOML or TTOBench train [default: the recording's].")
]
ReverseOption = Annotated[
    bool | None,
    typer.Option("--reverse/--no-reverse", help="The trip runs from the route's end to its start, or does not."),
]
LineOption = Annotated[
    Path | None, typer.Option(help="Kilometre posts (CSV) to match GPS to [default: the route's geometry].")
]
FromOption = Annotated[str | None, typer.Option("--from", help="Stop the trip starts at [default: first].")]
ToOption = Annotated[str | None, typer.Option("--to", help="Stop the trip ends at [default: last].")]
StrictOption = Annotated[bool, typer.Option("--strict", help="Refuse what would be dropped or turned round.")]
LevelOption = Annotated[Level | None, typer.Option(help="Loss level [default: the vehicle's].")]
LossMapOption = Annotated[Path | None, typer.Option(help="CSV loss map: its losses and nothing else.")]


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """What `das-sim replay` or `trip` is told besides the trip; None = from the recording, or the default.

    `reverse` None: nobody says which way. `speed` is in times real time, None for as fast as node and recorder keep up.
    """

    route: str | None = None
    vehicle: str | None = None
    reverse: bool | None = None
    line: Path | None = None
    strict: bool = False
    from_stop: str | None = None
    to_stop: str | None = None
    arrival_s: float | None = None
    delay_s: float | None = None
    speed: float | None = None
    level: Level | None = None
    loss_map: Path | None = None
    point_mass: bool = False
    train: str = "train-1"
    bus: Path | None = None
    insecure_bus: bool = False
    out: Path | None = None
    as_json: bool = False
