"""The process das-node: it reads what it was started with, builds the cab, and runs the node until it is stopped."""

from __future__ import annotations

import contextlib

from das.bus.config import BusFile, bus_options
from das.bus.refusals import Refusals
from das.bus.session import Bus, check_endpoint
from das.bus.topics import CONTROL, DELAY, EFFORT, JOURNEY, POSITION, RESTRICTION, STATUS, TARGET, Topic
from das.cab.outputs import NodeState
from das.cab.warm_up import warm_up, warm_up_tables
from das.command_line.compiling import loading_solver
from das.command_line.printing import say
from das.command_line.running import StopFlag, interrupt_on_termination
from das.node.building import plan_cab
from das.node.clock import BusClock, Clock, WallClock
from das.node.loop import prepare_process, run
from das.node.node import Node
from das.node.options import OWN_ENDPOINT, AdviceGiven, ClockKind, NodeOptions


def serve(options: NodeOptions) -> None:
    """Run a node until it is told to stop. Raises DasError for anything that cannot be used."""
    place, advice = options.place, options.advice
    file = bus_options(place.bus, place.insecure_bus, place.listen, place.connect)
    listen = None if file else check_endpoint(place.listen or OWN_ENDPOINT)
    prepare_process()
    interrupt_on_termination()
    plan = plan_cab(options)
    made = Bus(place.train, listen=listen, connect=place.connect or [], hear=_heard(advice), file=file)
    refusals = Refusals().listen() if file else None
    with made as bus, contextlib.closing(plan.cab()) as cab:
        node = Node(bus, cab, _clock(advice))
        _begin(node, plan.stops_m, tables=advice.tables is not None)
        served = plan.situation
        say(f"das-node {place.train}: {served.route.id}, {served.vehicle.id}, {_whereabouts(file, listen)}")
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


def _clock(advice: AdviceGiven) -> Clock:
    return WallClock() if advice.clock is ClockKind.WALL else BusClock()


def _heard(advice: AdviceGiven) -> tuple[Topic, ...]:
    """The topics the node hears."""
    return (JOURNEY, RESTRICTION, TARGET, POSITION, DELAY, CONTROL, *([EFFORT] if advice.calibrate else []))


def _whereabouts(file: BusFile | None, listen: str | None) -> str:
    return f"bus {file.path}" if file else f"listening on {listen}"
