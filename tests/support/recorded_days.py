"""Runs simulated in this process and recorded in memory, and drivers with one planted fault each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from das.advice.regimes import Regime
from das.bus.recording import Recording
from sim.drivers.cab import AdviceView, CabView, Driver
from sim.drivers.kinds import DriverKind, Presentation
from sim.plant.kernels import Command
from sim.plant.plant import speed
from sim.recording.opening import DriveInputs
from sim.world.driving import How, drive_kept
from sim.world.in_process import TRAIN
from sim.world.loop import Run
from sim.world.service import Day


def run_and_recording(
    day: Day, driver: Driver, presentation: Presentation = Presentation.SPEED_AND_EFFORT
) -> tuple[Run, Recording]:
    """Simulate a run; returns it and its recording without files, energies, measures and decisions."""
    how = How(driver=DriverKind.HUMAN, advice=presentation, train=TRAIN, command="test")
    run, table = drive_kept(day, driver, how)
    metadata = {"run": {"kind": "run", "level": str(day.service.level)}}
    left_out = ("saving", "measures", "decision")
    messages = {name: some for name, some in table.recording.messages.items() if name not in left_out}
    return run, replace(table.recording, path=Path("day.mcap"), metadata=metadata, messages=messages)


def recorded_day(day: Day, driver: Driver, presentation: Presentation = Presentation.SPEED_AND_EFFORT) -> Recording:
    """Simulate a run and return its recording (see `run_and_recording`)."""
    return run_and_recording(day, driver, presentation)[1]


def inputs_of_day(day: Day) -> DriveInputs:
    """The line and the train of a run; a recording in memory does not contain them."""
    service = day.service
    return DriveInputs(route=service.route, vehicle=service.vehicle, level=service.level, source="the day's")


class CoastsLate:
    """A driver like another one, except that the speed is held for a while when coasting is first advised."""

    def __init__(self, follower: Driver, late_s: float) -> None:
        self._follower, self._late_s = follower, late_s
        self._since_s: float | None = None
        self._held_mps = 0.0

    def command(self, cab: CabView) -> Command:
        wanted = self._follower.command(cab)
        view = cab.shown
        if view is None or view.mode not in (Regime.COAST, Regime.REDUCED_BRAKE):
            self._since_s = None
            return wanted
        if self._since_s is None:
            self._since_s = cab.time_s if view.mode == Regime.COAST else -1e9
            self._held_mps = cab.speed_mps
        late = cab.time_s - self._since_s < self._late_s and view.mode == Regime.COAST
        return speed(min(self._held_mps, cab.limit_mps)) if late else wanted


class BrakesByFriction:
    """A driver like another one, but braking only with the friction brake."""

    def __init__(self, follower: Driver) -> None:
        self._follower = follower

    def command(self, cab: CabView) -> Command:
        return self._follower.command(cab)._replace(friction_ratio=1.0)


class DrivesFaster:
    """A driver like another one, but faster than the advised speed to reach or to hold."""

    def __init__(self, follower: Driver, over_mps: float, from_mps: float = 15.0) -> None:
        self._follower, self._over_mps, self._from_mps = follower, over_mps, from_mps

    def command(self, cab: CabView) -> Command:
        view = cab.shown
        if view is None or view.mode not in (Regime.CRUISE, Regime.REDUCED_TRACTION) or view.speed_mps < self._from_mps:
            return self._follower.command(cab)
        return self._follower.command(cab._replace(advice=self._raised(view)))

    def _raised(self, view: AdviceView) -> AdviceView:
        raised: Callable[[float], float] = lambda v: v + self._over_mps  # noqa: E731
        return replace(
            view, speed_mps=raised(view.speed_mps), horizon_speed_mps=tuple(map(raised, view.horizon_speed_mps))
        )
