"""A day driven in this process, with everything that a recorder would have written kept in memory, as one table."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, NamedTuple

from das.advice.advice import Advice
from das.bus import codec
from das.bus.recording import Recording, Stamped
from das.bus.topics import CAB, DECISION, LOG, MEASURES, SAVING, TRUTH, Topic
from das.domain.errors import DasError
from sim.drive.table import DriveTable
from sim.drivers.cab import Driver
from sim.drivers.messages import CabLook, cab_message
from sim.drivers.presentations.presenter import presenter_of
from sim.recording.inputs import DriveInputs
from sim.world.lockstep import happened
from sim.world.loop import BEFORE_S, TRAIN, InProcess, Progress, Run, Tick, Told, World
from sim.world.outcome import above_optimum
from sim.world.over_bus import How, decision_message, measures_message, run_metadata, truth_message
from sim.world.service import Day


class KeptRun(NamedTuple):
    """A run in this process, and the table of its drive."""

    run: Run
    table: DriveTable


class KeptInProcess(InProcess):
    """The link to an on-board system in this process; `messages` has what a recorder would write, by topic."""

    def __init__(self, day: Day, *, guide: bool = False) -> None:
        self._day = day
        self.messages: dict[str, list[Stamped]] = {}
        super().__init__(day.service, guide=guide)
        began_ns = day.service.moment_ns(-BEFORE_S)
        self.keep(*codec.encode_input(day.service.journey(TRAIN, began_ns)), began_ns)

    def exchange(self, tick: Tick) -> Advice:
        """The advice for a tick."""
        for heard in tick.told:
            self.keep(*codec.encode_input(heard), tick.now_ns)
        advice = super().exchange(tick)
        for output in (*self.said, advice):
            self.keep(*codec.encode_output(output, tick.number), tick.now_ns)
        return advice

    def tell(self, now_ns: int, told: Told) -> None:
        """Keep what the on-board system does not receive."""
        self.keep(TRUTH, truth_message(self._day, now_ns, told), now_ns)
        self.keep(CAB, cab_message(CabLook(now_ns, told.cab, told.command), self._day.service.line), now_ns)
        for text in told.events:
            self.keep(LOG, happened(now_ns, text), now_ns)
        for event in told.decisions:
            self.keep(DECISION, decision_message(self._day, event), now_ns)

    def keep(self, topic: Topic, message: Any, now_ns: int) -> None:
        """Keep a message that was sent at a time (ns since 1970)."""
        self.messages.setdefault(topic.name, []).append(Stamped(now_ns, message))


def drive_kept(day: Day, driver: Driver, how: How, progress: Progress | None = None) -> KeptRun:
    """Drive a day in this process, and make the table of the drive; DasError if the train does not arrive."""
    link = KeptInProcess(day, guide=presenter_of(how.advice).needs_guide)
    run = World(day, driver, how.advice, link, how.screen).run(progress)
    end_ns = day.service.moment_ns(run.states[-1].time_s)
    link.keep(MEASURES, measures_message(end_ns, run.stability), end_ns)
    with contextlib.suppress(DasError):  # the losses do not cover the true train's efforts; the outcome says so
        link.keep(SAVING, above_optimum(day, run).message(end_ns), end_ns)
    service = day.service
    given = DriveInputs(
        route=service.route, vehicle=service.vehicle, level=service.level, source="those of the day"
    )  # fmt: skip
    recording = Recording(
        path=Path(f"{service.scenario.id} in memory"), train=TRAIN, trains=(TRAIN,), attachments=(), complete=True,
        messages={name: tuple(entries) for name, entries in link.messages.items()},
        metadata={"run": run_metadata(day, how)},
    )  # fmt: skip
    return KeptRun(run, DriveTable.of(recording, given))
