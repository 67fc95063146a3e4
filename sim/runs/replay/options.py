"""What a user says about a replay."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import typer

from das.command_line.options import DEFAULT_TRAIN, BusFolderOption, InsecureBusOption, TrainOption
from sim.options import SpeedOption
from sim.trips.options import TripOptions


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """How a trip is replayed; None means: as the recording says, or the default.

    `arrival_s` is the timetable's running time, `delay_s` by how much the trip departed late.
    """

    trip: TripOptions = field(default_factory=TripOptions)
    arrival_s: Annotated[
        float | None,
        typer.Option("--arrival", metavar="S", help="Timetable's running time in s [default: that of the trip]."),
    ] = None
    delay_s: Annotated[
        float | None,
        typer.Option("--delay", metavar="S", help="How late in s the trip departed [default: as recorded, or 0]."),
    ] = None
    speed: SpeedOption = "max"
    train: TrainOption = DEFAULT_TRAIN
    bus: BusFolderOption = None
    insecure_bus: InsecureBusOption = False
