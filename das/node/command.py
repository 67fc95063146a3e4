"""The commands das-node and das-node tls-init; the code behind them is imported only when they run."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.application import imported, run_app, single_command
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
from das.command_line.printing import typed
from das.domain.braking import REACTION_S
from das.domain.errors import DasError

FASTEST_HZ, SLOWEST_HZ = 5.0, 0.2
"""The bounds of `--rate`, the rate of advice (Hz)."""


class ClockKind(StrEnum):
    """The clock that the node uses."""

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
    """Endpoints at which the node sends and receives."""

    listen: Annotated[str | None, listen_option(NODE_ENDPOINT)] = None


@dataclass(frozen=True, kw_only=True)
class AdviceGiven:
    """Options of the node's advice: when it advises, whether the guide leads the driver, and how drivers brake."""

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
    tables: TablesOption = None
    with_parent: WithParentOption = None


@dataclass(frozen=True, kw_only=True)
class NodeOptions:
    """All options of das-node."""

    line: LineServed
    driven: TrainServed
    place: NodePlace
    advice: AdviceGiven


EXAMPLES = (
    "das-node --route zurich-luzern --vehicle re460-ic --from 'Zürich HB' --to Zug --train IC1",
    "das-node --route route.toml --vehicle vehicle.toml --train IC1 --tables tables --calibrate",
    "das-node tls-init -h",
)
TLS_EXAMPLES = ("das-node tls-init bus-tls --train IC1",)


def advise(options: NodeOptions) -> None:
    """Advise a train: receive journey, position and delay on the bus, publish speed and force advice.

    The node advises only after it has received a list of the temporary restrictions in force, even an empty one.
    """
    if not SLOWEST_HZ <= options.advice.rate <= FASTEST_HZ:
        raise DasError(f"--rate {options.advice.rate:g}: expected {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz")
    imported("das.node.process:serve")(options)


LAST_PORT = 65535


def tls_init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to create; must not exist yet.")],
    train: Annotated[str, typer.Option(help="Train name, the second part of every key.")] = "train-1",
    port: Annotated[int, typer.Option(help="The node's port; simulator and recorder take the next two.", min=1)] = 7447,
    days: Annotated[float, typer.Option(help="How long the certificates are valid.", max=3650)] = 90.0,
) -> None:
    """Make a test authority, certificates and bus files for every role (node, recorder, cab, sensors, operator …).

    For tests and trials on one machine, not a public-key infrastructure.
    """
    from das.bus.access import LISTENERS, write_bus_folder
    from das.bus.topics import check_train_name

    if not days > 0:
        raise DasError(f"--days {days:g}: expected more than 0")
    if port > LAST_PORT + 1 - len(LISTENERS):
        raise DasError(f"--port {port}: expected at most {LAST_PORT + 1 - len(LISTENERS)}")
    ports = {role: port + i for i, role in enumerate(LISTENERS)}
    until = write_bus_folder(folder, check_train_name(train), ports, days)
    print(f"written: {folder}, valid until {until:%Y-%m-%d %H:%M} UTC")
    print("for tests and trials, not a public-key infrastructure; the authority's key is discarded")
    print(f"use it with: {typed('das-sim')} run clear-day --bus {folder} --train {train}")
    print(f"or one by one: {typed('das-node')} … --bus {folder / 'node.json5'} --train {train}")


def main() -> None:
    """Entry point of das-node: run `tls-init` if that is the first word, else advise."""
    if sys.argv[1:2] == ["tls-init"]:
        del sys.argv[1]
        run_app(single_command("das-node tls-init", tls_init, TLS_EXAMPLES), "das-node tls-init")
    else:
        run_app(single_command("das-node", advise, EXAMPLES), "das-node")
