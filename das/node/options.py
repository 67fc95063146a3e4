"""The options of das-node, in groups."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import typer

from das.command_line.options import (
    NODE_ENDPOINT,
    BusPlace,
    FromOption,
    LevelOption,
    LoadOption,
    LossMapOption,
    PointMassOption,
    ReverseOption,
    RouteOption,
    TablesOption,
    ToOption,
    VehicleOption,
    WithParentOption,
    listen_option,
)
from das.domain.braking import REACTION_S

FASTEST_HZ, SLOWEST_HZ = 5.0, 0.2
"""The bounds of `--rate`, the rate of advice (Hz)."""


class ClockKind(StrEnum):
    """The clock that the node follows."""

    WALL = "wall"
    BUS = "bus"


@dataclass(frozen=True, kw_only=True)
class LineServed:
    """The line on which the node advises."""

    route: RouteOption
    reverse: ReverseOption = False
    from_stop: FromOption = None
    to_stop: ToOption = None


@dataclass(frozen=True, kw_only=True)
class TrainServed:
    """The train of the node, and other trains that a journey may name."""

    vehicle: VehicleOption
    load: LoadOption = None
    level: LevelOption = None
    loss_map: LossMapOption = None
    point_mass: PointMassOption = False
    other_vehicle: Annotated[
        list[str] | None,
        typer.Option(
            "--other-vehicle",
            metavar="VEHICLE",
            help="Another train that a journey may name, in addition to the bundled ones (may be repeated).",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class NodePlace(BusPlace):
    """Where on the bus the node sends and receives."""

    listen: Annotated[str | None, listen_option(NODE_ENDPOINT)] = None


@dataclass(frozen=True, kw_only=True)
class GuideGiven:
    """Whether the driver is led by the guide, and how drivers brake."""

    guide: Annotated[
        bool,
        typer.Option(
            "--guide/--no-guide",
            help="Lead the driver along a reference plan that the guide keeps as long as possible.",
        ),
    ] = True
    planning_brake: Annotated[
        float | None,
        typer.Option(
            "--planning-brake",
            metavar="M/S2",
            min=0.1,
            max=1.5,
            help="Deceleration that plans assume for limits and stops: the usual one of local drivers "
            "[default: the train's service deceleration].",
            show_default=False,
        ),
    ] = None
    reaction: Annotated[
        float,
        typer.Option(
            "--reaction",
            metavar="S",
            min=0.0,
            max=10.0,
            help="Reaction time that plans allow for before braking.",
        ),
    ] = REACTION_S
    below_limit: Annotated[
        float,
        typer.Option("--below-limit", metavar="KM/H", min=0.0, max=20.0, help="Margin of plans below every limit."),
    ] = 0.0


@dataclass(frozen=True, kw_only=True)
class AdviceGiven:
    """How the node advises."""

    rate: Annotated[
        float,
        typer.Option(
            "--rate",
            metavar="HZ",
            help=f"Rate of advice (Hz) with the wall clock, {SLOWEST_HZ:g} to {FASTEST_HZ:g}; with the "
            "bus clock, the expected rate of Control messages.",
        ),
    ] = 1.0
    clock: Annotated[
        ClockKind,
        typer.Option("--clock", help="wall: advise at --rate; bus: advise at every Control message of a simulation."),
    ] = ClockKind.WALL
    calibrate: Annotated[
        bool,
        typer.Option("--calibrate", help="Estimate mass and resistance from the measured efforts, and plan with them."),
    ] = False
    no_restrictions: Annotated[
        bool,
        typer.Option(
            "--no-restrictions",
            help="Advise without waiting for a list of temporary restrictions, at a site that has none.",
        ),
    ] = False
    led: GuideGiven
    tables: TablesOption = None
    with_parent: WithParentOption = None


@dataclass(frozen=True, kw_only=True)
class NodeOptions:
    """All options of das-node."""

    line: LineServed
    driven: TrainServed
    place: NodePlace
    advice: AdviceGiven
