"""An external driver: a process of its own that sees the cab over the bus and sets the controller.

At every look, the simulation sends the cab and the driver answers. If the driver is silent, the train is braked.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import CAB, CONTROL, CONTROLS, LOG
from das.domain.errors import DasError
from sim.drivers.cab import CabView, Driver
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.messages import CabLook, cab_message, cab_view, command_of, controls_message
from sim.plant.kernels import Command
from sim.plant.plant import COAST, lever
from sim.world.lockstep import Lockstep, happened
from sim.world.loop import LOOK_S
from sim.world.service import Day

SILENT_S: Final = 2.0
"""A driver who has not answered for this long (s) is taken to be gone."""


class DeadMan:
    """The dead-man brake: applied after `SILENT_S` without an answer of the driver.

    It is released when the driver answers again and the train stands, not in the middle of braking.
    """

    def __init__(self) -> None:
        self.silent_s = 0.0
        """Time (s) since the last answer."""
        self.braking = False
        """Whether the brake is applied."""

    def answered(self, *, standing: bool) -> str | None:
        """Take note of an answer; returns a sentence if the brake is released, else None."""
        self.silent_s = 0.0
        if not self.braking or not standing:
            return None
        self.braking = False
        return "the external driver answers again: the dead-man brake is released"

    def silent(self, span_s: float) -> str | None:
        """Take note of a time (s) without an answer; returns a sentence if the brake is applied, else None."""
        self.silent_s += span_s
        if self.braking or self.silent_s < SILENT_S - 1e-9:
            return None
        self.braking = True
        return f"the external driver has been silent for {SILENT_S:.0f} s: the dead-man brake is applied"


AWAITED_S: Final = 120.0
"""A run waits this long (s) for its driver before it begins."""
GIVEN_UP_S: Final = 30.0
"""When the dead-man brake has stopped the train, the run waits this long (s) for the driver and then ends."""
LEAST_LISTENING: Final = 0.5
"""When the run keeps a pace, the driver has at least this share of the time of a look to answer."""
BRAKES: Final = lever(-1.0)


class ExternalDriver:
    """Asks a process on the bus for the controller's setting, five times per second of the run.

    Without `times_real` (as fast as possible) the run waits for each answer, so that its result does not depend on the
    speed of the machine. With `times_real`, a look lasts as long as the pace allows, and the newest answer counts.
    `clock` (s) may be any clock that does not go back. If the driver is silent, `DeadMan` brakes the train.
    """

    def __init__(
        self, day: Day, *, times_real: float | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._day, self._clock = day, clock
        self._look_s = None if times_real is None else LOOK_S / times_real
        self._lockstep: Lockstep | None = None
        self._dead_man = DeadMan()
        self._command = COAST
        self._look, self._heard_look = 0, 0
        self._due = 0.0
        self._crowded = False

    def begin(self, lockstep: Lockstep) -> None:
        """Wait until the driver has published something; DasError if it does not within `AWAITED_S`."""
        answers = lockstep.answers
        if not lockstep.hear(lambda: answers.controls is not None, AWAITED_S):
            raise DasError(
                f"--driver external: no driver has published sim/{lockstep.processes.train}/controls "
                f"in {AWAITED_S:.0f} s"
            )
        self._lockstep, self._due = lockstep, self._clock()

    def command(self, cab: CabView) -> Command:
        """The driver's answer to this look, or full braking while the dead-man brake is applied."""
        assert self._lockstep is not None
        self._look += 1
        now_ns = self._day.service.moment_ns(cab.time_s)
        look = CabLook(now_ns, cab, self._command, self._look)
        self._lockstep.send(CAB, cab_message(look, self._day.service.line))
        answer = self._answer(self._lockstep, cab)
        if answer is not None:
            told = self._dead_man.answered(standing=cab.speed_mps <= 0)
        else:
            told = self._dead_man.silent(SILENT_S if self._look_s is None else LOOK_S)
        self._tell(now_ns, told)
        if self._dead_man.braking:
            self._lockstep.answers.driver = ""  # the driver may have been started anew
            self._command = BRAKES
        elif answer is not None:
            self._command = command_of(answer, cab.time_s)
        return self._command

    def _tell(self, now_ns: int, told: str | None) -> None:
        """Record what happened; also record, once, that another process tries to drive as well."""
        assert self._lockstep is not None
        if self._lockstep.answers.other_drivers and not self._crowded:
            self._crowded = True
            other = "another process answers as well; the first one drives"
            self._lockstep.send(LOG, happened(now_ns, other, Log.WARNING))
        if told is not None:
            self._lockstep.send(LOG, happened(now_ns, told, Log.WARNING))

    def _answer(self, lockstep: Lockstep, cab: CabView) -> Any | None:
        """The answer to this look; None if none comes in time, DasError if the driver is gone for good."""
        answers = lockstep.answers
        if self._dead_man.braking and cab.speed_mps <= 0:
            if not lockstep.hear(lambda: answers.answered(self._look), GIVEN_UP_S):
                raise DasError(
                    f"--driver external: the driver is gone, and the dead-man brake has stopped the train "
                    f"({cab.s_m:.0f} m, {cab.time_s:.0f} s after the departure)"
                )
            self._due = self._clock()
        elif self._look_s is None:
            patience_s = SILENT_S if self._look > 1 else GIVEN_UP_S  # a first answer may need code to be loaded
            lockstep.hear(lambda: answers.answered(self._look), 0.0 if self._dead_man.braking else patience_s)
        else:
            # A run that fell behind its pace catches up, but still listens at every look.
            self._due += self._look_s
            lockstep.hear(lambda: False, max(self._due - self._clock(), LEAST_LISTENING * self._look_s))
        controls = answers.controls
        least = self._look if self._look_s is None else self._heard_look + 1
        if controls is None or not least <= controls.look <= self._look:
            return None
        self._heard_look = controls.look
        return controls


HEARD = (CAB, CONTROL)
"""Topics that the process of an external driver must receive."""
CALLED_EVERY_S: Final = 0.2
"""Until the run begins, the driver's process announces itself at this interval (s)."""
LOST_S: Final = 60.0
"""A run that sends nothing for this long (s) is taken to be gone."""


def answer_looks(bus: Bus, driver: Driver, begun: Callable[[], None] = lambda: None) -> int:
    """Answer every look of a run until the run is over; returns the number of looks.

    `begun` is called at the first look. Raises DasError if the run falls silent.
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
    """Load the compiled code of the drivers before the first look, which must be answered in time."""
    s_m = float(line.limits_mps.start_m[0])
    cab = CabView(
        time_s=0.0, s_m=s_m, speed_mps=10.0, limit_mps=20.0, stop_m=s_m + 5000.0, departure_s=-10.0, arrival_s=300.0
    )
    for kind in (DriverKind.HUMAN, DriverKind.PERFECT):
        make_driver(kind, line).command(cab)


def _say_it_is_there(bus: Bus) -> None:
    bus.publish(CONTROLS, das_pb2.Controls())
