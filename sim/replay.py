"""Replay of a trip against a live node: positions and delay out, advice back, everything recorded.

Open loop: the train drives as it drove, whatever the advice. Time moves in ticks of 1 s; at every tick the node is
asked (Control) and its answer awaited, so nothing is lost at any speed of replay.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message
from mcap.reader import make_reader

from das.bus import das_pb2
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import (
    ADVICE,
    CONTROL,
    DELAY,
    EVENT,
    JOURNEY,
    LOCATION,
    POSITION,
    RECORDER,
    STATUS,
    TRUTH,
    Topic,
)
from das.domain.errors import DasError
from das.domain.units import NS
from das.solver.front import Front, Solution
from sim.estimate import DrivenEstimate
from sim.processes import Process
from sim.trips.trip import Trip

TICK_S = 1.0
DELAY_EVERY_S = 10.0
START_TIMEOUT_S = 120.0
"""The node compiles its solver the first time on a machine."""
ANSWER_TIMEOUT_S = 10.0
RECORDER_WINDOW = 50
"""The recorder may be this many ticks behind before the replay waits for it."""
SENT = (POSITION, DELAY, JOURNEY, CONTROL, TRUTH, LOCATION, EVENT)


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Timetable of the replayed section (ns since 1970) and the moments of the trip."""

    departure_ns: int
    arrival_ns: int
    first_tick_ns: int
    last_tick_ns: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """Everything a replay needs, checked beforehand."""

    train: str
    trip: Trip
    front: Front
    timing: Timing
    reference: Solution
    driven: DrivenEstimate
    names: tuple[str, str]
    reversed: bool
    delay_given: bool
    node_arguments: tuple[str, ...]
    out: Path
    speed: float | None
    metadata: dict[str, str]
    attachments: tuple[Path, ...] = ()
    files_kept: object = None
    """Holds the folder of files taken from a recording for as long as the job lives."""


@dataclass(kw_only=True)
class Outcome:
    """What happened in a replay: counts of messages sent and recorded, seconds it took, limits kept."""

    ticks: int = 0
    replay_s: float = 0.0
    start_s: float = 0.0
    sent: Counter[str] = field(default_factory=Counter)
    recorded: Counter[str] = field(default_factory=Counter)
    advices_given: int = 0
    advices_withdrawn: int = 0
    above_limit: int = 0

    @property
    def lost(self) -> int:
        """Messages sent or answered that are not in the recording."""
        expected = {topic.name: self.sent[topic.name] for topic in SENT if topic is not EVENT}
        expected[ADVICE.name] = self.ticks
        return sum(max(count - self.recorded[name], 0) for name, count in expected.items())


def plan_timing(trip: Trip, arrival_s: float | None, delay_s: float | None) -> Timing:
    """Timetable of a trip: it departed `delay_s` late; the arrival is `arrival_s` after the timetable's departure.

    What is not given is as the recording's journey says, else: no delay, and the arrival of the trip itself.
    """
    run = trip.run
    departed_ns = run.start_time_ns
    arrived_ns = departed_ns + round(float(run.time_s[-1]) / NS)
    departure_ns, arrival_ns = departed_ns, arrived_ns
    if trip.journey is not None:
        departure_ns = trip.journey.stops[0].departure_ns or departure_ns
        arrival_ns = trip.journey.stops[-1].arrival_ns or arrival_ns
    if delay_s is not None:
        departure_ns = departed_ns - round(delay_s / NS)
    if arrival_s is not None:
        arrival_ns = departure_ns + round(arrival_s / NS)
    if arrival_ns <= departure_ns:
        raise DasError(f"the arrival is {(departure_ns - arrival_ns) * NS:.0f} s before the departure")
    first_ns, last_ns = int(trip.matched.time_ns[0]), int(trip.matched.time_ns[-1])
    return Timing(
        departure_ns=departure_ns,
        arrival_ns=arrival_ns,
        first_tick_ns=min(first_ns, departed_ns),
        last_tick_ns=max(last_ns, arrived_ns),
    )


def replay(job: Job, progress: Callable[[int, int], None]) -> Outcome:
    """Run the replay; `progress(tick, ticks)` is called as it goes. Raises DasError where a process fails."""
    outcome = Outcome()
    ports = [endpoint(port) for port in free_ports(3)]
    began = time.perf_counter()
    with ExitStack() as stack:
        recorder = stack.enter_context(_start_recorder(job, ports))
        node = stack.enter_context(_start_node(job, ports))
        bus = stack.enter_context(
            Bus(job.train, listen=ports[0], connect=ports[1:], hear=(ADVICE, STATUS, RECORDER, EVENT))
        )
        player = _Player(job, bus, (node, recorder), outcome)
        player.wait_ready()
        outcome.start_s = time.perf_counter() - began
        began = time.perf_counter()
        player.play(progress)
        outcome.replay_s = time.perf_counter() - began
        player.finish()
        node.stop()
        recorder.stop()
    outcome.recorded = _recorded_counts(job.out)
    return outcome


def _start_recorder(job: Job, ports: list[str]) -> Process:
    arguments = ["--train", job.train, "--listen", ports[1], "--connect", ports[0], "--connect", ports[2]]
    arguments += ["--out", str(job.out), "--metadata", json.dumps(job.metadata)]
    arguments += ["--start-ns", str(job.timing.first_tick_ns)]
    for path in job.attachments:
        arguments += ["--attach", str(path)]
    return Process("recorder", "das.bus.recorder", arguments)


def _start_node(job: Job, ports: list[str]) -> Process:
    arguments = ["--train", job.train, "--listen", ports[2], "--connect", ports[0], "--connect", ports[1]]
    return Process("node", "das.node", [*arguments, "--clock", "bus", *job.node_arguments])


class _Player:
    """Sends the trip tick by tick and keeps count."""

    def __init__(self, job: Job, bus: Bus, processes: tuple[Process, Process], outcome: Outcome) -> None:
        self.job, self.bus, self.processes, self.outcome = job, bus, processes, outcome
        self._state = das_pb2.Status.STATE_STARTING
        self._reason = ""
        self._written = 0
        self._written_tick = 0
        self._answered: Any | None = None

    def wait_ready(self) -> None:
        """Until the recorder hears the node, and the node is ready for the journey."""
        waiting = (das_pb2.Status.STATE_WAITING, das_pb2.Status.STATE_READY)
        # The recorder counts what it heard; before we send anything that can only be the node.
        self._until(lambda: self._written > 0 and self._state in waiting, START_TIMEOUT_S, "node and recorder to start")
        self._send(JOURNEY, self._journey())
        settled = (das_pb2.Status.STATE_READY, das_pb2.Status.STATE_WITHDRAWN)
        self._until(lambda: self._state in settled, START_TIMEOUT_S, "the node to take the journey")
        if self._state == das_pb2.Status.STATE_WITHDRAWN:
            raise DasError(f"the node: {self._reason}")

    def play(self, progress: Callable[[int, int], None]) -> None:
        """All ticks, at the job's speed or as fast as node and recorder keep up."""
        timing, speed = self.job.timing, self.job.speed
        ticks = int(np.ceil((timing.last_tick_ns - timing.first_tick_ns) * NS / TICK_S)) + 1
        feed = _Feed(self.job)
        began = time.perf_counter()
        for tick in range(1, ticks + 1):
            now_ns = timing.first_tick_ns + round((tick - 1) * TICK_S / NS)
            for topic, message in feed.until(now_ns):
                self._send(topic, message)
            if speed is not None:
                self._sleep_until(began + (tick - 1) * TICK_S / speed)
            self._ask(now_ns, tick)
            self.outcome.ticks = tick
            progress(tick, ticks)

    def finish(self) -> None:
        """Tell everyone, and wait until the recorder has written what was sent."""
        last = self.outcome.ticks
        self._until(lambda: self._written_tick >= last, ANSWER_TIMEOUT_S, "the recorder to write the last tick")
        self._send(
            CONTROL,
            das_pb2.Control(
                time_ns=self.job.timing.last_tick_ns, tick=last + 1, command=das_pb2.Control.COMMAND_FINISH
            ),
        )
        self._until(lambda: self._written_tick > last, ANSWER_TIMEOUT_S, "the recorder to finish")

    def _ask(self, now_ns: int, tick: int) -> None:
        self._answered = None
        self._send(CONTROL, das_pb2.Control(time_ns=now_ns, tick=tick))
        self._until(
            lambda: self._answered is not None and self._answered.tick == tick,
            ANSWER_TIMEOUT_S,
            f"the node's advice for second {tick}",
        )
        self._until(lambda: tick - self._written_tick <= RECORDER_WINDOW, ANSWER_TIMEOUT_S, "the recorder to keep up")
        self._count(self._answered)

    def _count(self, advice: Any) -> None:
        if advice.mode == das_pb2.MODE_NONE:
            self.outcome.advices_withdrawn += 1
            return
        self.outcome.advices_given += 1
        if advice.advised_speed_mps > advice.limit_mps + 1e-6:
            self.outcome.above_limit += 1

    def _send(self, topic: Topic, message: Message) -> None:
        self.bus.publish(topic, message)
        self.outcome.sent[topic.name] += 1

    def _until(self, done: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Take messages until a condition holds; DasError when a process ended or it takes too long."""
        deadline = time.monotonic() + timeout_s
        while not done():
            received = self.bus.receive(0.2)
            if received is None:
                for process in self.processes:
                    process.check()
                if time.monotonic() > deadline:
                    raise DasError(f"waited {timeout_s:.0f} s for {what}")
                continue
            message = received.message
            if message is None:
                continue
            if received.topic is ADVICE:
                self._answered = message
            elif received.topic is STATUS:
                self._state, self._reason = message.state, message.reason
            elif received.topic is RECORDER:
                self._written, self._written_tick = message.messages, max(message.tick, self._written_tick)

    def _sleep_until(self, moment: float) -> None:
        while (left := moment - time.perf_counter()) > 0:
            time.sleep(min(left, 0.2))

    def _journey(self) -> das_pb2.Journey:
        job, section = self.job, self.job.front.section
        first, last = job.names
        return das_pb2.Journey(
            time_ns=job.timing.first_tick_ns,
            train=job.train,
            route_id=section.route.id,
            vehicle_id=section.vehicle.id,
            reversed=job.reversed,
            stops=[
                das_pb2.Journey.Stop(name=first, s_m=section.start_m, departure_ns=job.timing.departure_ns),
                das_pb2.Journey.Stop(name=last, s_m=section.end_m, arrival_ns=job.timing.arrival_ns),
            ],
        )


class _Feed:
    """What sensors and operator say, and the truth beside it, in order of time."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self._items = iter(sorted(self._all(), key=lambda item: item[0]))
        self._next = next(self._items, None)

    def until(self, now_ns: int) -> Iterator[tuple[Topic, Message]]:
        """Messages up to a moment, each once."""
        while self._next is not None and self._next[0] <= now_ns:
            _, topic, message = self._next
            yield topic, message
            self._next = next(self._items, None)

    def _all(self) -> Iterator[tuple[int, Topic, Message]]:
        yield from self._positions()
        yield from self._delays()
        yield from self._truth()
        timing = self.job.timing
        late_s = (self.job.trip.run.start_time_ns - timing.departure_ns) * NS
        log = Log(
            level=Log.INFO, message=f"replay of {self.job.trip.path.name}, departed {late_s:.0f} s late", name="das-sim"
        )
        log.timestamp.FromNanoseconds(timing.first_tick_ns)
        yield timing.first_tick_ns, EVENT, log

    def _positions(self) -> Iterator[tuple[int, Topic, Message]]:
        matched = self.job.trip.matched
        good, degraded = das_pb2.Position.QUALITY_GOOD, das_pb2.Position.QUALITY_DEGRADED
        for i, time_ns in enumerate(matched.time_ns.tolist()):
            dropout = bool(matched.dropout[i])
            position = das_pb2.Position(
                time_ns=time_ns,
                s_m=float(matched.s_m[i]),
                speed_mps=float(matched.speed_mps[i]),
                uncertainty_m=float(matched.uncertainty_m[i]),
                quality=das_pb2.Position.QUALITY_INVALID if matched.invalid[i] else degraded if dropout else good,
            )
            yield time_ns, POSITION, position
            if np.isfinite(matched.latitude_deg[i]):
                fix = LocationFix(
                    latitude=float(matched.latitude_deg[i]), longitude=float(matched.longitude_deg[i]), frame_id="train"
                )
                fix.timestamp.FromNanoseconds(time_ns)
                yield time_ns, LOCATION, fix

    def _delays(self) -> Iterator[tuple[int, Topic, Message]]:
        """The recording's own delays, else the deviation from the optimum of the timetable's running time."""
        trip, timing = self.job.trip, self.job.timing
        if trip.delays and not self.job.delay_given:
            for time_ns, delay_s in trip.delays:
                yield time_ns, DELAY, das_pb2.Delay(time_ns=time_ns, delay_s=delay_s)
            return
        planned = self.job.reference.trajectory
        run = trip.run
        for i in range(0, len(run.time_s), round(DELAY_EVERY_S)):
            time_ns = run.start_time_ns + round(float(run.time_s[i]) / NS)
            due_s = float(np.interp(run.s_m[i], planned.s_m, planned.t_s))
            delay_s = (time_ns - timing.departure_ns) * NS - due_s
            yield time_ns, DELAY, das_pb2.Delay(time_ns=time_ns, delay_s=delay_s)

    def _truth(self) -> Iterator[tuple[int, Topic, Message]]:
        run, driven = self.job.trip.run, self.job.driven
        trajectory, index = driven.trajectory, driven.index
        for i in range(len(run.time_s)):
            time_ns = run.start_time_ns + round(float(run.time_s[i]) / NS)
            j = int(np.clip(np.searchsorted(index, i, side="right") - 1, 0, len(index) - 2))
            moving = run.speed_mps[i] > 0
            truth = das_pb2.Truth(
                time_ns=time_ns,
                s_m=float(run.s_m[i]),
                speed_mps=float(run.speed_mps[i]),
                acceleration_mps2=float(run.acceleration_mps2[i]),
                force_el_n=float(trajectory.force_el_n[j]) if moving else 0.0,
                force_friction_n=float(trajectory.force_friction_n[j]) if moving else 0.0,
                energy_input_j=float(driven.energy_input_j[np.searchsorted(index, i, side="right") - 1]),
                gradient_ratio=float(trajectory.grade_ratio[j]),
                limit_mps=float(trajectory.limit_mps[j]),
            )
            yield time_ns, TRUTH, truth


def _recorded_counts(path: Path) -> Counter[str]:
    """Messages in a finished recording by topic name."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    counts: Counter[str] = Counter()
    if summary is not None and summary.statistics is not None:
        for channel, count in summary.statistics.channel_message_counts.items():
            counts[summary.channels[channel].topic.rpartition("/")[2]] += count
    return counts
