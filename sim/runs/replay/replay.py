"""Replay of a trip against a live node: positions and delay out, advice back, everything recorded.

The loop is open: the train drives as it was driven, whatever is advised. Time moves in ticks of 1 s; at every tick the
node is asked (Control) and its answer awaited, so nothing is lost at any speed of replay.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from google.protobuf.message import Message

from das.bus import codec, das_pb2
from das.bus.codec import Outgoing
from das.bus.topics import LOCATION, LOG, SAVING, TRUTH
from das.cab.heard import DelayHeard, JourneyHeard, OrderedStop, PositionHeard, RestrictionsHeard
from das.domain.errors import DasError
from das.domain.units import NS
from das.estimate.fix import PositionFix, Quality
from das.solver.front import Front
from das.solver.solution import Solution
from sim.drive.attribution.driven_legs import DrivenLeg
from sim.trips.estimate import DrivenEstimate
from sim.trips.trip import Trip
from sim.world.lockstep import Lockstep, Processes, Traffic, happened, location, sleep_until

TICK_S = 1.0
DELAY_EVERY_S = 10.0


@dataclass(frozen=True, kw_only=True)
class ReplayTiming:
    """The timetable of the replayed section and the first and last tick of the replay (all in ns since 1970)."""

    departure_ns: int
    arrival_ns: int
    first_tick_ns: int
    last_tick_ns: int


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplayJob:
    """Everything that a replay needs, checked beforehand.

    `processes` says how node and recorder are started. `legs` are the trip from stand to stand. `front` and
    `reference` are all runs of the section and the one for the timetable; `driven` is the energy of the trip as
    driven. `speed` is in times real time, None for as fast as it goes. `delay_given`: the user said how late the
    trip departed. `files_kept` holds the folder of files that came out of a recording for as long as the job lives.
    """

    processes: Processes
    trip: Trip
    legs: tuple[DrivenLeg, ...]
    front: Front
    timing: ReplayTiming
    reference: Solution
    driven: DrivenEstimate
    delay_given: bool
    speed: float | None
    files_kept: object = None

    @property
    def departed_ns(self) -> int:
        """When the train left its first stop (ns since 1970)."""
        return int(self.legs[0].motion.time_ns[0])

    @property
    def arrived_ns(self) -> int:
        """When the train came to a stand at its last stop (ns since 1970)."""
        return int(self.legs[-1].motion.time_ns[-1])


@dataclass(frozen=True, kw_only=True)
class ReplayOutcome:
    """What happened in a replay, and the seconds it took."""

    traffic: Traffic
    replay_s: float


def plan_timing(trip: Trip, legs: Sequence[DrivenLeg], arrival_s: float | None, delay_s: float | None) -> ReplayTiming:
    """The timetable of a trip that departed `delay_s` late, with the arrival `arrival_s` after the timetable's
    departure.

    What is not given comes from the recording's journey; without one there is no delay, and the arrival is the trip's.
    """
    departed_ns, arrived_ns = int(legs[0].motion.time_ns[0]), int(legs[-1].motion.time_ns[-1])
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
    return ReplayTiming(
        departure_ns=departure_ns,
        arrival_ns=arrival_ns,
        first_tick_ns=min(first_ns, departed_ns),
        last_tick_ns=max(last_ns, arrived_ns),
    )


def replay(
    job: ReplayJob, progress: Callable[[int, int], None], closing: Callable[[int], Message] | None = None
) -> ReplayOutcome:
    """Run the replay; `progress(tick, ticks)` is called as it goes. Raises DasError where a process fails.

    `closing` gives what is recorded at the end about the energy above the optimum, for the last tick's time (ns).
    """
    with Lockstep(job.processes) as lockstep:
        lockstep.begin(_journey(job))
        began = time.perf_counter()
        _play(job, lockstep, progress)
        replay_s = time.perf_counter() - began
        if closing is not None:
            lockstep.send(SAVING, closing(job.timing.last_tick_ns))
        lockstep.finish(job.timing.last_tick_ns)
    return ReplayOutcome(traffic=lockstep.traffic, replay_s=replay_s)


def _play(job: ReplayJob, lockstep: Lockstep, progress: Callable[[int, int], None]) -> None:
    """Play all ticks, at the job's speed or as fast as node and recorder keep up."""
    timing = job.timing
    ticks = int(np.ceil((timing.last_tick_ns - timing.first_tick_ns) * NS / TICK_S)) + 1
    feed = _Feed(job)
    began = time.perf_counter()
    for tick in range(1, ticks + 1):
        now_ns = timing.first_tick_ns + round((tick - 1) * TICK_S / NS)
        for outgoing in feed.until(now_ns):
            lockstep.send(*outgoing)
        if job.speed is not None:
            sleep_until(began + (tick - 1) * TICK_S / job.speed)
        lockstep.ask(now_ns, tick)
        progress(tick, ticks)


def _journey(job: ReplayJob) -> JourneyHeard:
    section, timing, trip = job.front.section, job.timing, job.trip
    return JourneyHeard(
        time_ns=timing.first_tick_ns,
        train=job.processes.train,
        route_id=section.route.id,
        vehicle_id=section.vehicle.id,
        reversed=trip.reversed,
        stops=(
            OrderedStop(trip.start.name, section.start_m, departure_ns=timing.departure_ns),
            OrderedStop(trip.end.name, section.end_m, arrival_ns=timing.arrival_ns),
        ),
    )


class _Feed:
    """The messages of sensors and operator, and the truth beside them, in order of time."""

    def __init__(self, job: ReplayJob) -> None:
        self.job = job
        self._items = iter(sorted(self._all(), key=lambda item: item[0]))
        self._next = next(self._items, None)

    def until(self, now_ns: int) -> Iterator[Outgoing]:
        """Yield the messages up to a moment, each once."""
        while self._next is not None and self._next[0] <= now_ns:
            yield self._next[1]
            self._next = next(self._items, None)

    def _all(self) -> Iterator[tuple[int, Outgoing]]:
        yield from self._positions()
        yield from self._delays()
        yield from self._truth()
        timing = self.job.timing
        late_s = (self.job.departed_ns - timing.departure_ns) * NS
        text = f"replay of {self.job.trip.path.name}, departed {late_s:.0f} s late"
        # A trip tells of no temporary restrictions; the node must know that there are none.
        at_ns = timing.first_tick_ns
        yield at_ns, codec.encode_input(RestrictionsHeard(time_ns=at_ns, restrictions=()))
        yield at_ns, Outgoing(LOG, happened(at_ns, text))

    def _positions(self) -> Iterator[tuple[int, Outgoing]]:
        matched = self.job.trip.matched
        for i, time_ns in enumerate(matched.time_ns.tolist()):
            dropout = bool(matched.dropout[i])
            fix = PositionFix(
                time_ns=time_ns,
                s_m=float(matched.s_m[i]),
                speed_mps=float(matched.speed_mps[i]),
                uncertainty_m=float(matched.uncertainty_m[i]),
                speed_uncertainty_mps=0.0,
                quality=Quality.INVALID if matched.invalid[i] else Quality.DEGRADED if dropout else Quality.GOOD,
            )
            yield time_ns, codec.encode_input(PositionHeard(fix=fix))
            if np.isfinite(matched.latitude_deg[i]):
                place = float(matched.latitude_deg[i]), float(matched.longitude_deg[i])
                yield time_ns, Outgoing(LOCATION, location(time_ns, *place))

    def _delays(self) -> Iterator[tuple[int, Outgoing]]:
        """The recording's own delays, else the deviation from the optimum of the timetable's running time."""
        trip, timing = self.job.trip, self.job.timing
        if trip.delays and not self.job.delay_given:
            for time_ns, delay_s in trip.delays:
                yield time_ns, codec.encode_input(DelayHeard(time_ns=time_ns, delay_s=delay_s))
            return
        planned = self.job.reference.trajectory
        run = trip.run
        for i in range(0, len(run.time_s), round(DELAY_EVERY_S)):
            time_ns = run.start_time_ns + round(float(run.time_s[i]) / NS)
            due_s = float(np.interp(run.s_m[i], planned.s_m, planned.t_s))
            delay_s = (time_ns - timing.departure_ns) * NS - due_s
            yield time_ns, codec.encode_input(DelayHeard(time_ns=time_ns, delay_s=delay_s))

    def _truth(self) -> Iterator[tuple[int, Outgoing]]:
        run, driven = self.job.trip.run, self.job.driven
        trajectory, index = driven.trajectory, driven.index
        limit_mps = self.job.trip.route.limits_over_train(self.job.front.section.train_length_m).at(run.s_m)
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
                limit_mps=float(limit_mps[i]),
            )
            yield time_ns, Outgoing(TRUTH, truth)
