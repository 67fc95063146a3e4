"""The command das-node: reads what it was started with, builds the cab, and runs the node until it is stopped."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Annotated

import typer

from das.bus.config import bus_options
from das.bus.refusals import Refusals
from das.bus.session import Bus, check_endpoint
from das.bus.topics import CONTROL, DELAY, EFFORT, JOURNEY, POSITION, RESTRICTION, TARGET
from das.cab.cab import WALL_STOPWATCH, Cab, CabSettings, no_stopwatch
from das.cab.fronts import Fronts
from das.cab.orders import Post
from das.cab.outputs import NodeState
from das.cab.situation import Situation
from das.cab.trains import Trains
from das.cab.warm_up import warm_up
from das.command_line.loading import load_route, load_vehicle, warn_unusual
from das.command_line.printing import say
from das.command_line.running import StopFlag, interrupt_on_termination, run_app
from das.domain.errors import DasError
from das.domain.losses import Level
from das.domain.route import section_stops
from das.node.clock import BusClock, Clock, WallClock
from das.node.loop import prepare_process, run
from das.node.node import Node
from das.node.tls_command import tls_app
from das.table.warm_up import warm_up as warm_up_tables

FASTEST_HZ, SLOWEST_HZ = 5.0, 0.2
OWN_ENDPOINT = "tcp/127.0.0.1:7447"


def command(
    route: Annotated[str, typer.Option(help="Bundled route name, TOML file or TTOBench track (JSON).")],
    vehicle: Annotated[str, typer.Option(help="Bundled vehicle name, TOML file or TTOBench train (JSON).")],
    train: Annotated[str, typer.Option(help="Train name, the second part of every key.")] = "train-1",
    listen: Annotated[
        str | None, typer.Option(help=f"Own endpoint on this machine [default: {OWN_ENDPOINT}].", show_default=False)
    ] = None,
    connect: Annotated[list[str] | None, typer.Option(help="Endpoint of another process (may be repeated).")] = None,
    reverse: Annotated[bool, typer.Option("--reverse", help="The route is driven from its end.")] = False,
    from_stop: Annotated[
        str | None, typer.Option("--from", help="First stop: name or number [default: first].")
    ] = None,
    to_stop: Annotated[str | None, typer.Option("--to", help="Second stop: name or number [default: last].")] = None,
    load: Annotated[str | None, typer.Option(help="Load state of the vehicle, as its file names it.")] = None,
    level: Annotated[Level | None, typer.Option(help="Loss level [default: the vehicle's].")] = None,
    loss_map: Annotated[Path | None, typer.Option(help="CSV loss map: its losses and nothing else.")] = None,
    point_mass: Annotated[bool, typer.Option("--point-mass", help="Take the train's length as 0.")] = False,
    with_parent: Annotated[
        int | None, typer.Option("--with-parent", help="End with the process of this id, which started it.")
    ] = None,
    calibrate: Annotated[
        bool,
        typer.Option("--calibrate", help="Estimate mass and resistance from the measured efforts, and plan with them."),
    ] = False,
    bus_file: Annotated[
        Path | None,
        typer.Option("--bus", help="Zenoh configuration of the site (JSON5) instead of this machine alone."),
    ] = None,
    insecure_bus: Annotated[
        bool, typer.Option("--insecure-bus", help="Let --bus open the bus to the network without mutual TLS.")
    ] = False,
    clock: Annotated[str, typer.Option(help="wall: advise at --rate; bus: at every Control message.")] = "wall",
    rate: Annotated[float, typer.Option(help="Advices per second with the wall clock, 0.2 to 5.")] = 1.0,
    no_restrictions: Annotated[
        bool,
        typer.Option(
            "--no-restrictions",
            help="This site has no temporary restrictions: advise without having heard a list of them.",
        ),
    ] = False,
    tables: Annotated[Path | None, typer.Option(help="Folder of tables made by das-precompute build.")] = None,
    other_vehicle: Annotated[
        list[str] | None,
        typer.Option(help="Another train a journey may name, beside the bundled ones (may be repeated)."),
    ] = None,
) -> None:
    """Advise a train: hears journey, position and delay on the bus, publishes speed and force advice."""
    if clock not in ("wall", "bus"):
        raise DasError(f"--clock {clock}: expected wall or bus")
    if not SLOWEST_HZ <= rate <= FASTEST_HZ:
        raise DasError(f"--rate {rate:g}: expected {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz")
    file = bus_options(bus_file, insecure_bus, listen, connect)
    listen = None if file else check_endpoint(listen or OWN_ENDPOINT)
    prepare_process()
    interrupt_on_termination()  # to compile takes long the first time on a machine
    the_route = load_route(route)
    the_route = the_route.reversed() if reverse else the_route
    the_vehicle = load_vehicle(vehicle)
    if loss_map is not None:
        from das.domain.files.loss_map_csv import read_loss_map

        the_vehicle = the_vehicle.with_loss_map(read_loss_map(loss_map))
    started = the_vehicle if load is None else the_vehicle.loaded(load)
    start, end = section_stops(the_route, from_stop, to_stop)
    stops_m = [x.position_m for x in the_route.stops if start.position_m <= x.position_m <= end.position_m]
    situation = Situation(route=the_route, vehicle=started, level=level, point_mass=point_mass)
    trains = Trains(started, the_vehicle, other_vehicle or ())
    warn_unusual(the_route, *trains.known)
    post = Post(train=train, route=the_route, trains=trains, reverse=reverse)
    by_wall = clock == "wall"
    settings = CabSettings(
        advice_period_s=1.0 / rate,
        no_restrictions=no_restrictions,
        calibrate=calibrate,
        background=by_wall,
        stopwatch=WALL_STOPWATCH if by_wall else no_stopwatch,
    )
    hear = (JOURNEY, RESTRICTION, TARGET, POSITION, DELAY, CONTROL, *([EFFORT] if calibrate else []))
    made = Bus(train, listen=listen, connect=connect or [], hear=hear, file=file)
    the_cab = Cab(post, situation, Fronts(tables), settings)
    the_clock: Clock = WallClock() if by_wall else BusClock()
    refusals = Refusals() if file else None
    with made as bus, contextlib.closing(the_cab) as cab:
        node = Node(bus, cab, the_clock)
        bus.watch([topic for topic in hear if topic.latched])
        node.status(NodeState.STARTING, "solving the section")
        warm_up()
        if tables is not None:
            warm_up_tables()
        cab.legs.check(stops_m)
        if by_wall:
            node.catch_up()
        if not cab.has_journey:
            cab.legs.rehearse(stops_m)
        place = f"bus {bus_file}" if file else f"listening on {listen}"
        say(f"das-node {train}: {the_route.id}, {started.id}, {place}")
        if not cab.has_journey:
            node.status(NodeState.WAITING, "waiting for a journey")
        run(node, StopFlag(with_parent=with_parent), refusals, 1.0 / rate)
        node.status(NodeState.STOPPING, "stopped")


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
app.command(
    epilog="Example: das-node --route zurich-luzern --vehicle re460-ic --from 'Zürich HB' --to Zug --train IC1. "
    "See also: das-node tls-init --help"
)(command)


def main() -> None:
    """Entry point of das-node; `tls-init` is the one word that is not about advising."""
    run_app(tls_app if sys.argv[1:2] == ["tls-init"] else app)
