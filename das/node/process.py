"""The process das-node: it takes its options, builds the cab, and runs the node until it is stopped.

The loop decides when to look for messages, and when to advise.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
import time

from das.bus.access import Refusals
from das.bus.config import BusFile, bus_options
from das.bus.session import Bus, check_endpoint
from das.bus.topics import CONTROL, DELAY, EFFORT, JOURNEY, POSITION, RESTRICTION, STATUS, TARGET, Topic
from das.cab.outputs import NodeState
from das.cab.warm_up import warm_up, warm_up_tables
from das.command_line.loading import loading_solver
from das.command_line.options import NODE_ENDPOINT
from das.command_line.printing import say
from das.command_line.running import StopFlag, interrupt_on_termination
from das.node.building import plan_cab
from das.node.node import BusClock, Clock, Node, WallClock
from das.node.options import AdviceGiven, ClockKind, NodeOptions

LOOK_S = 0.1
"""The loop looks at clock and messages at least once in this time."""
SEARCH_LOOK_S = 0.005
"""The loop looks at clock and messages at least once in this time while a front is being solved."""
LEAST_GAP_S = 0.05
"""The least time between an advice and one out of turn, however fast the situation changes."""
WAITING_SAID_EVERY_S = 1.0
"""A node on the clock of the bus reports once in this time that it waits for a journey."""
SWITCH_S = 0.0005
"""The thread that solves a front lets the one that advises run once in this time."""
M_MMAP_THRESHOLD, MAPPED_FROM_BYTES = -3, 1_000_000
"""For glibc's mallopt: a block of at least this size is mapped, and returned to the system when it is freed."""


def run(node: Node, stop: StopFlag, refusals: Refusals | None, period_s: float) -> None:
    """Answer until told to stop. With the wall clock, advise once a period and whenever the situation changes."""
    due, last, said = time.monotonic() + period_s, 0.0, 0.0
    by_wall = node.clock.is_wall
    while not stop.stopped and not node.finished:
        longest_s = SEARCH_LOOK_S if node.cab.urgent or node.cab.searching else LOOK_S
        wait_s = min(max(due - time.monotonic(), 0.0), longest_s) if by_wall else LOOK_S
        received = node.bus.receive(wait_s, skip_outdated=True)
        node.look_around()
        if received is not None:
            node.take(received)
        for text in refusals.take() if refusals else ():
            node.event(text)
        now = time.monotonic()
        if by_wall and (now >= due or (node.cab.urgent and now - last >= LEAST_GAP_S)):
            node.tick(node.clock.now_ns())
            last = now
            if now >= due:
                due = max(due + period_s, now)
        elif not by_wall and not node.cab.has_journey and now - said > WAITING_SAID_EVERY_S:
            node.status(NodeState.WAITING, "waiting for a journey")
            said = now


def prepare_process() -> None:
    """Return the memory of freed fronts to the system, and let threads take turns more often than Python's default."""
    sys.setswitchinterval(SWITCH_S)
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # Another C library may have no mallopt.
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, MAPPED_FROM_BYTES)


def serve(options: NodeOptions) -> None:
    """Run a node until it is told to stop. Raises DasError for anything that cannot be used."""
    place, advice = options.place, options.advice
    file = bus_options(place.bus, place.insecure_bus, place.listen, place.connect)
    listen = None if file else check_endpoint(place.listen or NODE_ENDPOINT)
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
