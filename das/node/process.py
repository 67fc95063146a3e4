"""The process das-node: it builds the cab from its options and runs the node until stopped."""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Callable
from dataclasses import dataclass

from das.bus.config import bus_options
from das.bus.session import Bus, check_endpoint
from das.bus.topics import CONTROL, DELAY, EFFORT, JOURNEY, POSITION, RESTRICTION, STATUS, TARGET
from das.cab.cab import Cab, CabSettings, warm_up
from das.cab.orders import Post, Trains
from das.cab.outputs import NodeState
from das.cab.preparation import Fronts
from das.cab.situation import Situation
from das.command_line.files import load_route, load_vehicle, warn_of_braking, warn_unusual
from das.command_line.options import NODE_ENDPOINT
from das.command_line.printing import loading_solver, say
from das.command_line.process import StopFlag
from das.domain.braking import SiteBraking
from das.domain.clocks import MONOTONIC_S
from das.domain.errors import DasError
from das.domain.files.vehicles import read_loss_map
from das.domain.route import section_stops
from das.domain.units import KMH
from das.node.command import ClockKind, NodeOptions
from das.node.node import BusClock, Node, WallClock

LOOK_S = 0.1
"""Longest interval (s) between two checks of the clock and for messages."""
SEARCH_LOOK_S = 0.005
"""Longest interval (s) between two checks of the clock while a front is being solved or advice is urgent."""
LEAST_GAP_S = 0.05
"""Least interval (s) between two advice messages if a change of the situation makes the second one early."""
WAITING_SAID_EVERY_S = 1.0
"""Period (s) in which a node that follows the clock of the bus reports that it waits for a journey."""
SWITCH_S = 0.0005
"""Python's switch interval (s): the time for which the thread that solves a front may delay the one that advises."""
M_MMAP_THRESHOLD, MAPPED_FROM_BYTES = -3, 1_000_000
"""Parameter of glibc's mallopt, and its value: freed blocks of at least so many bytes are returned to the system."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CabPlan:
    """The inputs of a cab. `stops_m` are the positions (m) of the stops that the node serves."""

    post: Post
    situation: Situation
    fronts: Fronts
    settings: CabSettings
    stops_m: list[float]

    def cab(self) -> Cab:
        """A new cab, which has received no message yet."""
        return Cab(self.post, self.situation, self.fronts, self.settings)


def plan_cab(options: NodeOptions) -> CabPlan:
    """Read the files named in the options. Raises DasError for anything unusable."""
    line, driven, advice = options.line, options.driven, options.advice
    if advice.tables is not None and not advice.guide:
        raise DasError(f"--tables {advice.tables}: tables have the guide's departures: expected no --no-guide")
    route = load_route(line.route)
    route = route.reversed() if line.reverse else route
    start, end = section_stops(route, line.from_stop, line.to_stop)
    base = load_vehicle(driven.vehicle)
    base = base if driven.loss_map is None else base.with_loss_map(read_loss_map(driven.loss_map))
    started = base if driven.load is None else base.loaded(driven.load)
    trains = Trains(started, base, driven.other_vehicle or ())
    warn_unusual(*trains.known)
    for vehicle in trains.known:
        warn_of_braking(vehicle)
    return CabPlan(
        post=Post(train=options.place.train, route=route, trains=trains, reverse=line.reverse),
        situation=Situation(
            route=route,
            vehicle=started,
            level=driven.level,
            point_mass=driven.point_mass,
            braking=SiteBraking(
                deceleration_mps2=advice.planning_brake,
                reaction_s=advice.reaction,
                below_limit_mps=advice.below_limit * KMH,
            ),
        ),
        fronts=Fronts(advice.tables),
        settings=CabSettings(
            advice_period_s=1.0 / advice.rate,
            no_restrictions=advice.no_restrictions,
            calibrate=advice.calibrate,
            background=advice.clock is ClockKind.WALL,
            guide=advice.guide,
        ),
        stops_m=[x.position_m for x in route.stops if start.position_m <= x.position_m <= end.position_m],
    )


def run(node: Node, stop: StopFlag, period_s: float, seconds: Callable[[], float] = MONOTONIC_S) -> None:
    """Run the node until stopped. With the wall clock, advise once per period and whenever the situation changes.

    `seconds` never jump; they determine when a period is over.
    """
    due, last, said = seconds() + period_s, 0.0, 0.0
    by_wall = node.clock.is_wall
    while not stop.stopped and not node.finished:
        longest_s = SEARCH_LOOK_S if node.cab.urgent or node.cab.searching else LOOK_S
        wait_s = min(max(due - seconds(), 0.0), longest_s) if by_wall else LOOK_S
        received = node.bus.receive(wait_s, skip_outdated=True)
        node.look_around()
        if received is not None:
            node.take(received)
        now = seconds()
        if by_wall and (now >= due or (node.cab.urgent and now - last >= LEAST_GAP_S)):
            node.tick(node.clock.now_ns())
            last = now
            if now >= due:
                due = max(due + period_s, now)
        elif not by_wall and not node.cab.has_journey and now - said > WAITING_SAID_EVERY_S:
            node.status(NodeState.WAITING, "waiting for a journey")
            said = now


def prepare_process() -> None:
    """Return the memory of freed fronts to the system, and switch threads more often than by default."""
    sys.setswitchinterval(SWITCH_S)
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # Another C library may have no mallopt.
            ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, MAPPED_FROM_BYTES)


def serve(options: NodeOptions) -> None:
    """Run a node until asked to stop. Raises DasError for anything unusable."""
    place, advice = options.place, options.advice
    file = bus_options(place.bus, place.insecure_bus, place.listen, place.connect)
    listen = None if file else check_endpoint(NODE_ENDPOINT if place.listen is None else place.listen)
    prepare_process()
    plan = plan_cab(options)
    heard = (JOURNEY, RESTRICTION, TARGET, POSITION, DELAY, CONTROL, *([EFFORT] if advice.calibrate else []))
    made = Bus(place.train, listen=listen, connect=place.connect or [], hear=heard, file=file)
    with made as bus, contextlib.closing(plan.cab()) as cab:
        node = Node(bus, cab, WallClock() if advice.clock is ClockKind.WALL else BusClock())
        _begin(node, plan.stops_m)
        served, where = plan.situation, f"bus {file.path}" if file else f"listening on {listen}"
        say(f"das-node {place.train}: {served.route.id}, {served.vehicle.id}, {where}")
        if not cab.has_journey:
            node.status(NodeState.WAITING, "waiting for a journey")
        run(node, StopFlag(with_parent=advice.with_parent), 1.0 / advice.rate)
        node.status(NodeState.STOPPING, "stopped")


def _begin(node: Node, stops_m: list[float]) -> None:
    """Load the compiled code, accept a journey that is already on the bus, and prepare the first section."""
    node.bus.watch([JOURNEY, RESTRICTION, TARGET, STATUS])
    node.status(NodeState.STARTING, "solving the section")
    with loading_solver():
        warm_up()
    legs = node.cab.legs
    legs.check(stops_m)
    if node.clock.is_wall:
        node.catch_up()
    if not node.cab.has_journey:
        legs.rehearse(stops_m)
