"""A trial that was driven: what the driver saw and did, look by look, and all else that its measures are found from."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from sim.drivers.cab import AdviceView, CabView, Driver, DriverEvent, kept_by
from sim.plant import kernels
from sim.plant.kernels import Command
from sim.plant.plant import PlantState
from sim.world.day import Day
from sim.world.loop import LOOK_S, TICK_S, Run
from sim.world.outcome import DayOutcome, true_fronts

LOOKS_A_TICK: Final = round(TICK_S / LOOK_S)


class DriverLook(NamedTuple):
    """One look of the driver: time (s), position (m), speed and limit (m/s), what is shown, and what he asks for."""

    time_s: float
    s_m: float
    speed_mps: float
    limit_mps: float
    shown: AdviceView | None
    command: Command

    @property
    def lever_ratio(self) -> float:
        """The controller's setting (−1 … 1); NaN where the driver asks for a speed or a force instead."""
        if self.command.law == kernels.LEVER:
            return self.command.value
        return 0.0 if self.command == (kernels.FORCE, 0.0, *self.command[2:]) else math.nan


class WatchedDriver:
    """Drives as another driver does, and notes every look."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self.looks: list[DriverLook] = []

    @property
    def events(self) -> Sequence[DriverEvent]:
        """What the driver did and felt so far."""
        return kept_by(self._driver)

    def command(self, cab: CabView) -> Command:
        """What the watched driver asks for."""
        asked = self._driver.command(cab)
        self.looks.append(DriverLook(cab.time_s, cab.s_m, cab.speed_mps, cab.limit_mps, cab.shown, asked))
        return asked


def lever_trace_sha256(looks: Sequence[DriverLook]) -> str:
    """Hash of all that a driver asked of the train, look by look; equal hashes are equal drives at the controller."""
    return hashlib.sha256(np.array([look.command for look in looks], dtype=np.float64).tobytes()).hexdigest()


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """A driven trial: the day, the run, its outcome, and all looks of the driver."""

    day: Day
    run: Run
    outcome: DayOutcome
    looks: Sequence[DriverLook]

    @cached_property
    def seconds(self) -> tuple[tuple[PlantState, DriverLook], ...]:
        """The state and the driver's first look of every second."""
        return tuple(zip(self.run.states, self.looks[::LOOKS_A_TICK], strict=False))

    @cached_property
    def moving(self) -> tuple[tuple[PlantState, DriverLook], ...]:
        """The seconds that begin with a moving train."""
        return tuple((state, look) for state, look in self.seconds if state.speed_mps > 0)

    @property
    def moving_min(self) -> float:
        """How long the train moved (min)."""
        return len(self.moving) * TICK_S / 60.0

    @property
    def equal_arrival_j(self) -> float:
        """The energy (J) at equal arrival: driven − optimum for the times as driven + optimum for the timetable's."""
        energies, service = self.outcome.energies, self.day.service
        planned_s = [service.clock_s(one.arrival_ns) - service.clock_s(one.departure_ns) for one in service.timetables]
        fronts = zip(true_fronts(self.day), planned_s, strict=True)
        on_time_j = sum(front.trajectory(time_s).ledger.input for front, time_s in fronts)
        return energies.driven_j - energies.hindsight_j + on_time_j
