"""Replay of a trip against a live node: positions and delay out, advice back, everything recorded.

Open loop: the train drives as it drove, whatever the advice. Time moves in ticks of 1 s; at every tick the node is
asked (Control) and its answer awaited, so nothing is lost at any speed of replay.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from google.protobuf.message import Message

from das.bus import das_pb2
from das.bus.config import BusFolder
from das.bus.topics import DELAY, LOCATION, LOG, POSITION, RESTRICTION, TRUTH, Topic
from das.cab.heard import JourneyHeard, OrderedStop
from das.domain.errors import DasError
from das.domain.units import NS
from das.solver.front import Front
from das.solver.solution import Solution
from sim.processes.lockstep import Crew, Lockstep, Traffic, sleep_until
from sim.processes.messages import happened, location
from sim.trips.estimate import DrivenEstimate
from sim.trips.trip import Trip

TICK_S = 1.0
DELAY_EVERY_S = 10.0


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
    bus: BusFolder | None = None
    files_kept: object = None
    """Holds the folder of files taken from a recording for as long as the job lives."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What happened in a replay, and the seconds it took."""

    traffic: Traffic
    replay_s: float


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
    crew = Crew(
        train=job.train,
        node_arguments=job.node_arguments,
        out=job.out,
        metadata=job.metadata,
        start_ns=job.timing.first_tick_ns,
        attachments=job.attachments,
        bus=job.bus,
    )
    with Lockstep(crew) as lockstep:
        lockstep.begin(_journey(job))
        began = time.perf_counter()
        _play(job, lockstep, progress)
        replay_s = time.perf_counter() - began
        lockstep.finish(job.timing.last_tick_ns)
    return Outcome(traffic=lockstep.traffic, replay_s=replay_s)


def _play(job: Job, lockstep: Lockstep, progress: Callable[[int, int], None]) -> None:
    """All ticks, at the job's speed or as fast as node and recorder keep up."""
    timing = job.timing
    ticks = int(np.ceil((timing.last_tick_ns - timing.first_tick_ns) * NS / TICK_S)) + 1
    feed = _Feed(job)
    began = time.perf_counter()
    for tick in range(1, ticks + 1):
        now_ns = timing.first_tick_ns + round((tick - 1) * TICK_S / NS)
        for topic, message in feed.until(now_ns):
            lockstep.send(topic, message)
        if job.speed is not None:
            sleep_until(began + (tick - 1) * TICK_S / job.speed)
        lockstep.ask(now_ns, tick)
        progress(tick, ticks)


def _journey(job: Job) -> JourneyHeard:
    section, timing = job.front.section, job.timing
    return JourneyHeard(
        time_ns=timing.first_tick_ns,
        train=job.train,
        route_id=section.route.id,
        vehicle_id=section.vehicle.id,
        reversed=job.reversed,
        stops=(
            OrderedStop(job.names[0], section.start_m, departure_ns=timing.departure_ns),
            OrderedStop(job.names[1], section.end_m, arrival_ns=timing.arrival_ns),
        ),
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
        text = f"replay of {self.job.trip.path.name}, departed {late_s:.0f} s late"
        # A trip tells of no temporary restrictions; the node must know that there are none.
        yield timing.first_tick_ns, RESTRICTION, das_pb2.Restrictions(time_ns=timing.first_tick_ns)
        yield timing.first_tick_ns, LOG, happened(timing.first_tick_ns, text)

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
                place = float(matched.latitude_deg[i]), float(matched.longitude_deg[i])
                yield time_ns, LOCATION, location(time_ns, *place)

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
