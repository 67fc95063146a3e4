"""The commands das-node and das-node tls-init and their options; what they do is imported only when they run."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.application import single_command
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
from das.command_line.running import run_app
from das.domain.braking import REACTION_S

FASTEST_HZ, SLOWEST_HZ = 5.0, 0.2
"""Advice is given no more often and no more rarely than this."""


class ClockKind(StrEnum):
    """Which clock the node goes by."""

    WALL = "wall"
    BUS = "bus"


@dataclass(frozen=True, kw_only=True)
class LineServed:
    """The line the node is for."""

    route: RouteOption
    reverse: ReverseOption = False
    from_stop: FromOption = None
    to_stop: ToOption = None


@dataclass(frozen=True, kw_only=True)
class TrainServed:
    """The train the node rides in, and others that a journey may name."""

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
            help="Another train that a journey may name, beside the bundled ones (may be repeated).",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class NodePlace(BusPlace):
    """Where the node speaks and hears."""

    listen: Annotated[str | None, listen_option(NODE_ENDPOINT)] = None


@dataclass(frozen=True, kw_only=True)
class CoachGiven:
    """How the driver is led, and how he brakes."""

    coach: Annotated[
        bool,
        typer.Option("--coach/--no-coach", help="Lead the driver along a reference that stands (the field coach)."),
    ] = True
    planning_brake: Annotated[
        float | None,
        typer.Option(
            "--planning-brake",
            metavar="M/S2",
            min=0.1,
            max=1.5,
            help="Deceleration for limits and stops to plan with, as drivers here brake "
            "[default: that of the train in service].",
            show_default=False,
        ),
    ] = None
    reaction: Annotated[
        float,
        typer.Option(
            "--reaction", metavar="S", min=0.0, max=10.0, help="How late drivers begin to brake, to plan with."
        ),
    ] = REACTION_S
    below_limit: Annotated[
        float,
        typer.Option("--below-limit", metavar="KM/H", min=0.0, max=20.0, help="Margin to limits to plan with."),
    ] = 0.0


@dataclass(frozen=True, kw_only=True)
class AdviceGiven:
    """How the node advises."""

    rate: Annotated[
        float,
        typer.Option(
            "--rate",
            metavar="HZ",
            help=f"Advices per second with the wall clock, {SLOWEST_HZ:g} to {FASTEST_HZ:g}.",
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
            help="This site has no temporary restrictions: advise without having heard a list of them.",
        ),
    ] = False
    led: CoachGiven
    tables: TablesOption = None
    with_parent: WithParentOption = None


@dataclass(frozen=True, kw_only=True)
class NodeOptions:
    """All of it."""

    line: LineServed
    driven: TrainServed
    place: NodePlace
    advice: AdviceGiven


EXAMPLES = (
    "das-node --route zurich-luzern --vehicle re460-ic --from 'Zürich HB' --to Zug --train IC1",
    "das-node --route route.toml --vehicle vehicle.toml --train IC1 --tables tables --calibrate",
    "das-node tls-init -h",
)


def advise(line: LineServed, driven: TrainServed, place: NodePlace, advice: AdviceGiven) -> None:
    """Advise a train: hear journey, position and delay on the bus, publish speed and force advice.

    The node advises only after it has heard a list of the temporary restrictions in force, possibly an empty one.
    """
    from das.domain.errors import DasError

    if not SLOWEST_HZ <= advice.rate <= FASTEST_HZ:
        raise DasError(f"--rate {advice.rate:g}: expected {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz")
    from das.node.process import serve

    serve(NodeOptions(line=line, driven=driven, place=place, advice=advice))


tls_app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
LAST_PORT = 65535


@tls_app.callback()
def _several() -> None:
    """Keep `tls-init` a word of its own: typer would swallow the name of an only command."""


@tls_app.command("tls-init", epilog="Example: das-node tls-init bus-tls --train IC1")
def tls_init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make; must not be there yet.")],
    train: Annotated[str, typer.Option(help="Train name, the second part of every key.")] = "train-1",
    port: Annotated[int, typer.Option(help="The node's port; simulator and recorder take the next two.", min=1)] = 7447,
    days: Annotated[float, typer.Option(help="How long the certificates are valid.", max=3650)] = 90.0,
) -> None:
    """Make a test authority, certificates and bus files for every role (node, recorder, cab, sensors, operator …).

    For tests and trials on one machine, not a public-key infrastructure.
    """
    from das.bus.topics import check_train_name
    from das.command_line.printing import typed
    from das.domain.errors import DasError

    try:
        from das.bus.tls import LISTENERS, write_bus_folder
    except ImportError as error:
        raise DasError("tls-init needs the package trustme: pip install driver-advisory-system[tls]") from error
    if not days > 0:
        raise DasError(f"--days {days:g}: expected more than 0")
    if port > LAST_PORT + 1 - len(LISTENERS):
        raise DasError(f"--port {port}: expected at most {LAST_PORT + 1 - len(LISTENERS)}")
    ports = {role: port + i for i, role in enumerate(LISTENERS)}
    until = write_bus_folder(folder, check_train_name(train), ports, days)
    print(f"written: {folder}, valid until {until:%Y-%m-%d %H:%M} UTC")
    print("for tests and trials, not a public-key infrastructure; the authority's key is thrown away")
    print(f"use it with: {typed('das-sim')} run clear-day --bus {folder} --train {train}")
    print(f"or one by one: {typed('das-node')} … --bus {folder / 'node.json5'} --train {train}")


def main() -> None:
    """Entry point of das-node; `tls-init` is the one word that is not about advising."""
    if sys.argv[1:2] == ["tls-init"]:
        run_app(tls_app, "das-node")
    else:
        run_app(single_command("das-node", advise, EXAMPLES), "das-node")
