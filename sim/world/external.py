"""An external driver: a separate process that receives the cab over the bus and sets the controller.

At every look, the simulation sends the cab and the driver answers. If the driver is silent, the train is braked.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message

from das.bus import das_pb2
from das.bus.topics import CAB, CONTROLS, LOG
from das.domain.clocks import WALL, Clocks
from das.domain.errors import DasError
from sim.drivers.cab import CabView
from sim.drivers.kinds import DESK, EXTERNAL, External
from sim.drivers.messages import CabLook, cab_message, command_of
from sim.plant.kernels import Command
from sim.plant.plant import COAST, lever
from sim.world.lockstep import Lockstep, happened
from sim.world.loop import LOOK_S
from sim.world.scenario import EarlyDeparture
from sim.world.service import Day


@dataclass(frozen=True, kw_only=True)
class Patience:
    """The times (s) for which a run waits for its driver, and the name of the driver in errors.

    After `silent_s` without an answer the dead-man brake is applied. Before it begins, a run waits `awaited_s` for its
    driver. A run ends if the driver has not answered for `given_up_s` and the dead-man brake has stopped the train.
    """

    silent_s: float = 2.0
    given_up_s: float = 30.0
    awaited_s: float = 120.0
    driver: External = EXTERNAL


AT_THE_DESK: Final = Patience(given_up_s=600.0, awaited_s=math.inf, driver=DESK)
"""The waiting times for a person, who reads before a run begins, and may return after a break."""


class DeadMan:
    """The dead-man brake: applied after a silence of the driver.

    The brake is released when the driver answers again, the train stands, and the controller requests no traction;
    never while the train moves, and never while traction is requested.
    """

    def __init__(self, silent_s: float = Patience.silent_s) -> None:
        self._limit_s = silent_s
        self.silent_s = 0.0
        """The time (s) without an answer, added up since the last answer."""
        self.braking = False
        """Whether the brake is applied."""

    def answered(self, *, standing: bool, pulls: bool = False) -> str | None:
        """Record an answer; returns a sentence if the brake is released, else None.

        `pulls`: the controller requests traction.
        """
        self.silent_s = 0.0
        if not self.braking or not standing or pulls:
            return None
        self.braking = False
        return "the external driver answers again: the dead-man brake is released"

    def silent(self, span_s: float) -> str | None:
        """Record a time (s) without an answer; returns a sentence if the brake is applied now, else None."""
        self.silent_s += span_s
        if self.braking or self.silent_s < self._limit_s - 1e-9:
            return None
        self.braking = True
        return f"the external driver has been silent for {self._limit_s:.0f} s: the dead-man brake is applied"


LEAST_LISTENING: Final = 0.5
"""Least share of the duration of a look that remains for the driver's answer when the run keeps a pace."""
SLIPS_SAID_S: Final = 1.0
"""Loss of time (s) between two reports of a run that cannot keep its pace."""
BRAKES: Final = lever(-1.0)


class Pace:
    """The due times of looks in a run that keeps a pace; a run that is late does not hurry to catch up.

    `look_s` is the duration of a look by `clock` (s), which may be any clock that does not go back.
    """

    def __init__(self, look_s: float, clock: Callable[[], float]) -> None:
        self._look_s, self._clock = look_s, clock
        self._due_s = clock()
        self._slipped_s = self._said_s = 0.0

    def left_s(self) -> float:
        """The time (s) until the next look; to be called once for each look."""
        self._due_s += self._look_s
        now_s = self._clock()
        late_s = now_s + LEAST_LISTENING * self._look_s - self._due_s
        if late_s > 0:
            self._slipped_s += late_s
            self._due_s += late_s
        return self._due_s - now_s

    def slipped(self) -> str | None:
        """A sentence if the run has lost noticeably more time than at the last report, else None."""
        if self._slipped_s - self._said_s < SLIPS_SAID_S:
            return None
        self._said_s = self._slipped_s
        return f"the run could not keep its pace: it is {self._slipped_s:.1f} s behind so far"


class ExternalDriver:
    """A driver in a process on the bus, asked for the controller's setting five times per second of the run.

    Without `times_real` (as fast as possible) the run waits for each answer, so that the result does not depend on the
    speed of the machine. With `times_real`, this driver alone keeps the pace of the run: a look lasts as long as the
    pace allows, and the newest answer counts. `clocks` are injected. If the driver is silent, `DeadMan` brakes the
    train; meanwhile no advice is shown. An answer with `paused` stops the run until an answer without it.
    """

    def __init__(
        self, day: Day, *, times_real: float | None = None, patience: Patience | None = None, clocks: Clocks = WALL
    ) -> None:
        self._day, self._clocks, self._patience = day, clocks, patience or Patience()
        self._look_s = None if times_real is None else LOOK_S / times_real
        self._lockstep: Lockstep | None = None
        self._pace: Pace | None = None
        self._dead_man = DeadMan(self._patience.silent_s)
        self._command = COAST
        self._look, self._heard_look = 0, 0
        self._heard_s = 0.0
        self._crowded = False

    def begin(self, lockstep: Lockstep) -> None:
        """Wait until the driver has published an answer; raises DasError if none comes in time."""
        answers, awaited_s = lockstep.answers, self._patience.awaited_s
        plant, stop_m = self._day.plant, self._day.service.stops[0].position_m
        plant.advance(plant.at(stop_m), COAST, LOOK_S)  # loads the compiled code, so that no look waits for it
        if not lockstep.hear(lambda: answers.controls is not None, awaited_s):
            key = CONTROLS.key(lockstep.processes.train)
            raise DasError(f"--driver {self._patience.driver}: no driver has published {key} in {awaited_s:.0f} s")
        self._lockstep, self._heard_s = lockstep, self._clocks.seconds()
        if self._look_s is not None:
            self._pace = Pace(self._look_s, self._clocks.seconds)

    def command(self, cab: CabView) -> Command:
        """The driver's answer to this look, or full braking while the dead-man brake is applied."""
        assert self._lockstep is not None
        self._look += 1
        now_ns = self._day.service.moment_ns(cab.time_s)
        self._lockstep.send(CAB, self._message(now_ns, cab))
        answer = self._answer(self._lockstep, cab)
        if answer is not None:
            told = self._dead_man.answered(standing=cab.speed_mps <= 0, pulls=answer.lever_ratio > 0)
        else:
            told = self._dead_man.silent(self._patience.silent_s if self._pace is None else LOOK_S)
        self._tell(now_ns, told)
        if self._dead_man.braking:
            self._lockstep.answers.driver = ""  # the driver may have been restarted
            self._command = BRAKES
        elif answer is not None:
            self._command = command_of(answer, cab.time_s)
        return self._command

    def _message(self, now_ns: int, cab: CabView) -> Message:
        """The cab message of this look. While the dead-man brake is applied, no advice is shown."""
        overruled = das_pb2.Cab.INTERLOCK_NONE
        if self._dead_man.braking:
            cab, overruled = cab._replace(advice=None), das_pb2.Cab.INTERLOCK_SILENCE
        elif not cab.may_depart and self._day.service.scenario.early_departure is EarlyDeparture.WITHHELD:
            overruled = das_pb2.Cab.INTERLOCK_DOORS
        wall_ns = 0 if self._pace is None else self._clocks.now_ns()
        look = CabLook(now_ns, cab, self._command, self._look, overruled, wall_ns)
        return cab_message(look, self._day.service.line)

    def _tell(self, now_ns: int, told: str | None) -> None:
        """Record `told`, a loss of pace and, once, that another process tries to drive as well."""
        assert self._lockstep is not None
        other = None
        if self._lockstep.answers.other_drivers and not self._crowded:
            self._crowded = True
            other = "another process answers as well; the first one drives"
        for text in (other, told, self._pace and self._pace.slipped()):
            if text:
                self._lockstep.send(LOG, happened(now_ns, text, Log.WARNING))

    def _answer(self, lockstep: Lockstep, cab: CabView) -> Any | None:
        """The answer to this look; None if none comes in time, DasError if the driver has not answered for too long."""
        answers, least = lockstep.answers, self._look
        if self._pace is not None:
            lockstep.hear(lambda: False, self._pace.left_s())
            least = self._heard_look + 1
        elif self._dead_man.braking and cab.speed_mps <= 0:
            lockstep.hear(lambda: answers.answered(self._look), self._patience.given_up_s)
        else:
            # A first answer may need code to be loaded.
            patience_s = self._patience.silent_s if self._look > 1 else self._patience.given_up_s
            lockstep.hear(lambda: answers.answered(self._look), 0.0 if self._dead_man.braking else patience_s)
        controls = answers.controls
        if controls is None or not least <= controls.look <= self._look:
            self._check_there(cab)
            return None
        self._heard_look = controls.look
        if controls.paused:
            controls = self._after_pause(lockstep, cab)
        self._heard_s = self._clocks.seconds()
        return controls

    def _after_pause(self, lockstep: Lockstep, cab: CabView) -> Any | None:
        """The answer that ends a pause; None if none comes in `given_up_s`. The run's clock is stopped meanwhile."""
        answers, began_s = lockstep.answers, self._clocks.seconds()
        ended = lockstep.hear(
            lambda: answers.controls is not None and not answers.controls.paused, self._patience.given_up_s
        )
        paused_s = self._clocks.seconds() - began_s
        text = f"the driver asked for a pause: the run waited for {paused_s:.1f} s"
        lockstep.send(LOG, happened(self._day.service.moment_ns(cab.time_s), text, Log.INFO))
        if self._look_s is not None:
            self._pace = Pace(self._look_s, self._clocks.seconds)
        return answers.controls if ended else None

    def _check_there(self, cab: CabView) -> None:
        """Raise DasError if the dead-man brake has stopped the train and the driver has been away for too long."""
        away_s = self._clocks.seconds() - self._heard_s
        if self._dead_man.braking and cab.speed_mps <= 0 and away_s >= self._patience.given_up_s:
            raise DasError(
                f"--driver {self._patience.driver}: the driver is gone, and the dead-man brake has stopped the train "
                f"({cab.s_m:.0f} m, {cab.time_s:.0f} s after the departure)"
            )
