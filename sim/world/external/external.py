"""A driver that is a process of its own, as the simulator sees it: every look is asked over the bus and answered."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus.topics import CAB, LOG
from das.domain.errors import DasError
from sim.drivers.cab import CabView
from sim.drivers.messages import CabLook, cab_message, command_of
from sim.plant.plant import COAST, Command, lever
from sim.world.day import Day
from sim.world.external.dead_man import SILENT_S, DeadMan
from sim.world.processes.lockstep import Lockstep
from sim.world.processes.messages import happened

LOOK_S: Final = 0.2
"""A driver is asked this often, as every simulated driver is."""
AWAITED_S: Final = 120.0
"""A run waits this long (s) for its driver before it starts."""
GIVEN_UP_S: Final = 30.0
"""A train that the dead-man brake has stopped waits this long (s) for its driver; then the run ends."""
LEAST_LISTENING: Final = 0.5
"""At a pace, at least this share of a look is left for the driver's answer."""
BRAKES: Final = lever(-1.0)


class ExternalDriver:
    """Asks a process on the bus what the controller is set to, five times a second of the run.

    Without `times_real` (as fast as it goes) the run waits for each answer, so that it does not depend on how fast the
    machine is. With it, a look lasts as long as the pace lets it, and the newest answer counts. `clock` (s) may be any
    that does not go back. A driver who is silent is braked for: `DeadMan`.
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
        """Wait until the driver is there; DasError where it does not come."""
        answers = lockstep.answers
        if not lockstep.hear(lambda: answers.controls is not None, AWAITED_S):
            raise DasError(
                f"--driver external: no driver has published sim/{lockstep.crew.train}/controls in {AWAITED_S:.0f} s"
            )
        self._lockstep, self._due = lockstep, self._clock()

    def command(self, cab: CabView) -> Command:
        """What the driver answers to this look; the brakes while it is silent for too long."""
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
        """Record what happened, and once that another process would drive as well."""
        assert self._lockstep is not None
        if self._lockstep.answers.other_drivers and not self._crowded:
            self._crowded = True
            other = "another process answers as well; the first one drives"
            self._lockstep.send(LOG, happened(now_ns, other, Log.WARNING))
        if told is not None:
            self._lockstep.send(LOG, happened(now_ns, told, Log.WARNING))

    def _answer(self, lockstep: Lockstep, cab: CabView) -> Any | None:
        """The answer to this look, None where there is none in time; DasError where the driver is gone for good."""
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
            # A run that fell behind its pace catches up, but never without listening.
            self._due += self._look_s
            lockstep.hear(lambda: False, max(self._due - self._clock(), LEAST_LISTENING * self._look_s))
        controls = answers.controls
        least = self._look if self._look_s is None else self._heard_look + 1
        if controls is None or not least <= controls.look <= self._look:
            return None
        self._heard_look = controls.look
        return controls
