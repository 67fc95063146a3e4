"""The process das-node: it reads what it was started with, builds the cab, and runs the node until it is stopped."""

from __future__ import annotations

import contextlib

from das.advice.coach.settings import CoachSettings, DriverSettings
from das.advice.settings import AdviceSettings
from das.bus.config import BusFile, bus_options
from das.bus.refusals import Refusals
from das.bus.session import Bus, check_endpoint
from das.bus.topics import CONTROL, DELAY, EFFORT, JOURNEY, POSITION, RESTRICTION, STATUS, TARGET, Topic
from das.cab.cab import Cab, CabSettings, no_stopwatch
from das.cab.fronts import Fronts
from das.cab.orders import Post
from das.cab.outputs import NodeState
from das.cab.situation import Situation
from das.cab.trains import Trains
from das.cab.warm_up import warm_up
from das.command_line.compiling import loading_solver
from das.command_line.loading import load_route, load_vehicle, warn_unusual
from das.command_line.printing import say
from das.command_line.running import StopFlag, interrupt_on_termination
from das.domain.clocks import WALL_STOPWATCH
from das.domain.files.loss_map_csv import read_loss_map
from das.domain.route import Route, section_stops
from das.domain.units import KMH
from das.domain.vehicle import Vehicle
from das.node.clock import BusClock, Clock, WallClock
from das.node.loop import prepare_process, run
from das.node.node import Node
from das.node.options import OWN_ENDPOINT, AdviceGiven, ClockKind, LineServed, NodeOptions, TrainServed
from das.table.warm_up import warm_up as warm_up_tables


def serve(options: NodeOptions) -> None:
    """Run a node until it is told to stop. Raises DasError for anything that cannot be used."""
    line, driven, place, advice = options.line, options.driven, options.place, options.advice
    file = bus_options(place.bus, place.insecure_bus, place.listen, place.connect)
    listen = None if file else check_endpoint(place.listen or OWN_ENDPOINT)
    prepare_process()
    interrupt_on_termination()
    route, stops_m = _line(line)
    base = _vehicle(driven)
    started = base if driven.load is None else base.loaded(driven.load)
    situation = Situation(route=route, vehicle=started, level=driven.level, point_mass=driven.point_mass)
    trains = Trains(started, base, driven.other_vehicle or ())
    warn_unusual(*trains.known)
    post = Post(train=place.train, route=route, trains=trains, reverse=line.reverse)
    made = Bus(place.train, listen=listen, connect=place.connect or [], hear=_heard(advice), file=file)
    the_cab = Cab(post, situation, Fronts(advice.tables), _settings(advice))
    refusals = Refusals().listen() if file else None
    with made as bus, contextlib.closing(the_cab) as cab:
        node = Node(bus, cab, _clock(advice))
        _begin(node, stops_m, tables=advice.tables is not None)
        say(f"das-node {place.train}: {route.id}, {started.id}, {_whereabouts(file, listen)}")
        if not cab.has_journey:
            node.status(NodeState.WAITING, "waiting for a journey")
        run(node, StopFlag(with_parent=advice.with_parent), refusals, 1.0 / advice.rate)
        node.status(NodeState.STOPPING, "stopped")


def _begin(node: Node, stops_m: list[float], *, tables: bool) -> None:
    """Load the compiled code, take a journey that is on the bus already, and prepare the first section."""
    node.bus.watch([JOURNEY, RESTRICTION, TARGET, STATUS])
    node.status(NodeState.STARTING, "solving the section")
    with loading_solver():
        warm_up()
        if tables:
            warm_up_tables()
    legs = node.cab.legs
    legs.check(stops_m)
    if node.clock.is_wall:
        node.catch_up()
    if not node.cab.has_journey:
        legs.rehearse(stops_m)


def _line(line: LineServed) -> tuple[Route, list[float]]:
    """The route in the direction it is driven, and the positions (m) of the stops the node is for."""
    route = load_route(line.route)
    route = route.reversed() if line.reverse else route
    start, end = section_stops(route, line.from_stop, line.to_stop)
    return route, [x.position_m for x in route.stops if start.position_m <= x.position_m <= end.position_m]


def _vehicle(driven: TrainServed) -> Vehicle:
    """The train without a load state."""
    vehicle = load_vehicle(driven.vehicle)
    return vehicle.with_loss_map(read_loss_map(driven.loss_map)) if driven.loss_map is not None else vehicle


def _settings(advice: AdviceGiven) -> CabSettings:
    by_wall = advice.clock is ClockKind.WALL
    return CabSettings(
        advice_period_s=1.0 / advice.rate,
        no_restrictions=advice.no_restrictions,
        calibrate=advice.calibrate,
        background=by_wall,
        advice=AdviceSettings(
            coach=CoachSettings(
                enabled=advice.led.coach,
                driver=DriverSettings(
                    planning_brake_mps2=advice.led.planning_brake, below_limit_mps=advice.led.below_limit * KMH
                ),
            )
        ),
        stopwatch=WALL_STOPWATCH if by_wall else no_stopwatch,
    )


def _clock(advice: AdviceGiven) -> Clock:
    return WallClock() if advice.clock is ClockKind.WALL else BusClock()


def _heard(advice: AdviceGiven) -> tuple[Topic, ...]:
    """The topics the node hears."""
    return (JOURNEY, RESTRICTION, TARGET, POSITION, DELAY, CONTROL, *([EFFORT] if advice.calibrate else []))


def _whereabouts(file: BusFile | None, listen: str | None) -> str:
    return f"bus {file.path}" if file else f"listening on {listen}"
