"""What a driver saw and did on a trial, look by look."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim.drivers.cab import AdviceView, CabView, Driver
from sim.drivers.diary import DriverEvent, kept_by
from sim.plant import kernels
from sim.plant.kernels import Command


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
