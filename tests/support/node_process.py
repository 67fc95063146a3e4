"""A node, or another program of this project, as a real process that uses Zenoh on the loopback interface."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from das.bus import das_pb2
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import ADVICE, EVENT, JOURNEY, PLAN, RESTRICTION, STATUS, Received

TRAIN = "T1"
START_NS = 1_800_000_000_000_000_000
TIMEOUT_S = 120.0
FLAT = ("--route", "flat-6km", "--vehicle", "re460-ic")
"""The line and the train of all these nodes."""


@contextmanager
def process(module: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A context with a running program, killed at the end; its messages can be read from its standard output."""
    child = subprocess.Popen(
        [sys.executable, "-m", module, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def refused(module: str, *arguments: str) -> str:
    """The one-line error of a program for these arguments."""
    with process(module, *arguments) as child:
        said, _ = child.communicate(timeout=60)
        assert child.returncode == 2
    assert len(said.strip().splitlines()) == 1
    return said


@contextmanager
def node(*extra: str, journey: das_pb2.Journey | None = None) -> Iterator[tuple[Bus, subprocess.Popen[str]]]:
    """A context with a node and a bus connected to it; the node has an empty list of restrictions and the journey."""
    ours, theirs = (endpoint(port) for port in free_ports(2))
    arguments = [*FLAT, "--train", TRAIN, "--listen", theirs, "--connect", ours]
    hear = (ADVICE, STATUS, PLAN, EVENT)
    with (
        process("das.node", *arguments, *extra) as child,
        Bus(TRAIN, listen=ours, connect=[theirs], hear=hear) as bus,
    ):
        if "--no-restrictions" not in extra:
            bus.publish(RESTRICTION, das_pb2.Restrictions(time_ns=1))
        if journey is not None:
            until(bus, status(das_pb2.Status.STATE_WAITING), child)
            bus.publish(JOURNEY, journey)
        yield bus, child


def until(
    bus: Bus,
    wanted: Callable[[Received], bool],
    child: subprocess.Popen[str] | None = None,
    meanwhile: Callable[[], None] = lambda: None,
) -> Any:
    """The first message that meets a condition; fails after a while, or with the process. `meanwhile` is repeated."""
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        meanwhile()
        received = bus.receive(0.2)
        if received is not None and received.message is not None and wanted(received):
            return received.message
        if child is not None and child.poll() is not None:
            pytest.fail(f"the process ended: {child.communicate()[0]}")
    return pytest.fail("waited too long")


def status(state: int) -> Callable[[Received], bool]:
    """A test of a message: whether it reports this state of the node."""
    return lambda r: r.topic is STATUS and r.message.state == state


def a_journey(start_ns: int = START_NS, arrival_s: float = 240.0) -> das_pb2.Journey:
    """A journey from A to B on the flat line."""
    return das_pb2.Journey(
        time_ns=start_ns,
        train=TRAIN,
        route_id="flat-6km",
        vehicle_id="re460-ic",
        stops=[
            das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=start_ns),
            das_pb2.Journey.Stop(name="B", s_m=6_000.0, arrival_ns=start_ns + round(arrival_s * 1e9)),
        ],
    )
