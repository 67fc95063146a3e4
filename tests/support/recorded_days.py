"""Days driven in this process and recorded in memory, and drivers who each have one planted fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from das.advice.regimes import Regime
from das.bus import codec
from das.bus.recording import Recording, Stamped
from das.bus.topics import CAB, LOG, TRUTH
from das.cab.heard import Heard
from sim.drivers.cab import AdviceView, CabView, Driver
from sim.drivers.kinds import Presentation
from sim.drivers.messages import CabLook, cab_message
from sim.drivers.presentations.presenter import presenter_of
from sim.plant.kernels import Command
from sim.plant.plant import speed
from sim.recording.inputs import DriveInputs
from sim.world.lockstep import happened
from sim.world.loop import BEFORE_S, TRAIN, InProcess, Run, Tick, Told, World
from sim.world.over_bus import _truth
from sim.world.service import Day


class KeptInProcess(InProcess):
    """A node in this process, without a bus; it keeps everything that a recorder would write."""

    def __init__(self, day: Day, *, guide: bool = False) -> None:
        self.day = day
        self.messages: dict[str, list[Stamped]] = {}
        super().__init__(day.service, guide=guide)
        self._keep(
            *codec.encode_input(day.service.journey(TRAIN, day.service.moment_ns(-BEFORE_S))),
            day.service.moment_ns(-BEFORE_S),
        )

    def exchange(self, tick: Tick) -> Any:
        for heard in tick.told:
            self._keep_told(heard, tick.now_ns)
        advice = super().exchange(tick)
        for output in (*self.said, advice):
            self._keep(*codec.encode_output(output, tick.number), tick.now_ns)
        return advice

    def tell(self, now_ns: int, told: Told) -> None:
        self._keep(TRUTH, _truth(self.day, now_ns, told), now_ns)
        look = CabLook(now_ns, told.cab, told.command)
        self._keep(CAB, cab_message(look, self.day.service.line), now_ns)
        for text in told.events:
            self._keep(LOG, happened(now_ns, text), now_ns)

    def _keep_told(self, heard: Heard, now_ns: int) -> None:
        self._keep(*codec.encode_input(heard), now_ns)

    def _keep(self, topic: Any, message: Any, now_ns: int) -> None:
        self.messages.setdefault(topic.name, []).append(Stamped(now_ns, message))


def run_and_recording(
    day: Day, driver: Driver, presentation: Presentation = Presentation.SPEED_AND_EFFORT
) -> tuple[Run, Recording]:
    """Drive a day; the run, and what a recorder would have written, without the attached files."""
    shows = presenter_of(presentation)
    link = KeptInProcess(day, guide=shows.needs_guide)
    run = World(day, driver, presentation, link).run()
    return run, Recording(
        path=Path("day.mcap"), train=TRAIN, trains=(TRAIN,), attachments=(), complete=True,
        messages={name: tuple(entries) for name, entries in link.messages.items()},
        metadata={"run": {"kind": "run", "level": str(day.service.level)}},
    )  # fmt: skip


def recorded_day(day: Day, driver: Driver, presentation: Presentation = Presentation.SPEED_AND_EFFORT) -> Recording:
    """Drive a day and return its recording (see `run_and_recording`)."""
    return run_and_recording(day, driver, presentation)[1]


def inputs_of_day(day: Day) -> DriveInputs:
    """The line and the train of a day; a recording in memory does not contain them."""
    service = day.service
    return DriveInputs(route=service.route, vehicle=service.vehicle, level=service.level, source="the day's")


class CoastsLate:
    """Drives like another driver, but holds the speed for a while when coasting is first advised."""

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
    """Drives like another driver, but brakes only with the friction brake."""

    def __init__(self, follower: Driver) -> None:
        self._follower = follower

    def command(self, cab: CabView) -> Command:
        return self._follower.command(cab)._replace(friction_ratio=1.0)


class DrivesFaster:
    """Drives like another driver, but faster than the advised speed to reach or to hold."""

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
