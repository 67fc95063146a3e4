"""The other side of an external driver: a process that answers every look of a run over the bus."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import CAB, CONTROL, CONTROLS
from das.domain.errors import DasError
from sim.drivers.cab import CabView, Driver
from sim.drivers.kinds import DriverKind
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.messages import cab_view, controls_message
from sim.drivers.registry import make_driver

HEARD = (CAB, CONTROL)
"""Topics that such a process must hear."""
CALLED_EVERY_S: Final = 0.2
"""Until the run begins, the process says this often that it is there."""
LOST_S: Final = 60.0
"""A run that says nothing for this long (s) is taken to be gone."""


def answer_looks(bus: Bus, driver: Driver, begun: Callable[[], None] = lambda: None) -> int:
    """Drive a run: answer every look until the run is over. Returns how many looks there were.

    `begun` is called at the first look. Raises DasError where the run falls silent.
    """
    looks, heard_s = 0, time.monotonic()
    _say_it_is_there(bus)
    while True:
        received = bus.receive(CALLED_EVERY_S)
        if received is None:
            if not looks:
                _say_it_is_there(bus)
            elif time.monotonic() - heard_s > LOST_S:
                raise DasError(f"nothing has been heard of the run for {LOST_S:.0f} s, after {looks} looks")
            continue
        heard_s, message = time.monotonic(), received.message
        if message is None:
            continue
        if received.topic is CONTROL and message.command == das_pb2.Control.COMMAND_FINISH:
            return looks
        if received.topic is CAB and message.look:
            if not looks:
                begun()
            looks += 1
            bus.publish(CONTROLS, controls_message(message.look, driver.command(cab_view(message))))


def warm_up(line: LineKnowledge) -> None:
    """Load the compiled code that drivers use, before the first look asks for an answer within 2 s."""
    s_m = float(line.limits_mps.start_m[0])
    cab = CabView(
        time_s=0.0, s_m=s_m, speed_mps=10.0, limit_mps=20.0, stop_m=s_m + 5000.0, departure_s=-10.0, arrival_s=300.0
    )
    for kind in (DriverKind.HUMAN, DriverKind.PERFECT):
        make_driver(kind, line).command(cab)


def _say_it_is_there(bus: Bus) -> None:
    bus.publish(CONTROLS, das_pb2.Controls())
