"""Replay of a trip against a live node: positions and delay out, advice back, everything recorded.

The loop is open: the train moves as recorded, whatever is advised. Time moves in ticks of 1 s; at every tick the node
is asked (Control) and its answer is awaited, so that no message is lost at any speed of replay.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from google.protobuf.message import Message

from das import __version__
from das.bus import codec, das_pb2
from das.bus.access import bus_folder
from das.bus.codec import Outgoing
from das.bus.topics import LOCATION, LOG, SAVING, TRUTH, check_train_name
from das.cab.cab import warm_up
from das.cab.heard import DelayHeard, JourneyHeard, PositionHeard, RestrictionsHeard
from das.domain.errors import DasError
from das.domain.journey import OrderedStop
from das.domain.units import NS
from das.estimate.estimate import PositionFix, Quality
from das.offline.asked_journey import Call, Journey
from das.solver.front import Front
from das.solver.section import Section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from sim.drive.above_optimum import part_between
from sim.drive.calls import KeptCall, calls_on_the_way, kept_calls
from sim.drive.legs import DrivenLeg, DrivenMotion, Smoothed, legs_of, open_calls
from sim.options import ReplayOptions, TripOptions, pace_factor
from sim.recording.course import OWN_TIMETABLE
from sim.recording.opening import input_files, sha256
from sim.trips.estimate import DrivenEstimate, DrivenPart, SmoothedParts, estimate_run
from sim.trips.portal_stops import journey_file, trip_journey
from sim.trips.profile import DrivenRun, to_profile
from sim.trips.trip import Trip, open_trip, trip_section
from sim.world.lockstep import Lockstep, Processes, Traffic, happened, location, sleep_until

LONGEST_S = 86400.0
"""Upper bound (s) of running times and delays: a day."""
DAY_NS = round(LONGEST_S / NS)


@dataclass(frozen=True, kw_only=True)
class ReplayTiming:
    """The timetable of the replayed section and the first and last tick of the replay (all in ns since 1970).

    `own`: no timetable was given, and the times of the trip itself are used. `retimed`: the user gave another one than
    the recording has, so that its delays do not count.
    """

    departure_ns: int
    arrival_ns: int
    first_tick_ns: int
    last_tick_ns: int
    own: bool
    retimed: bool

    @property
    def metadata(self) -> dict[str, str]:
        """The origin of the timetable, as recorded."""
        return {OWN_TIMETABLE: "yes"} if self.own else {}


def check_timing(options: ReplayOptions) -> None:
    """Raise DasError for an unusable running time or delay, or for one given together with a journey."""
    given = {"--running-time": options.running_time_s, "--delay": options.delay_s}
    for name, value in given.items():
        if value is not None and not 0 <= value < LONGEST_S:
            raise DasError(f"{name} {value:g}: expected seconds >= 0, less than a day")
        if value is not None and options.journey is not None:
            raise DasError(f"{name} {value:g}: not allowed with --journey, which has the times")
    if options.running_time_s is not None and options.running_time_s <= 0:
        raise DasError(f"--running-time {options.running_time_s:g}: expected a running time > 0 s")


def plan_timing(trip: Trip, legs: Sequence[DrivenLeg], options: ReplayOptions) -> ReplayTiming:
    """The timetable of a trip: a journey's, or the two figures of the options, or the recording's.

    Without a due arrival in any of them, the trip itself is the timetable: it is on time. Raises DasError for a delay
    without a due arrival, for a journey that is not of this trip, and for a train that is due to arrive before it
    departs.
    """
    departed_ns, arrived_ns = int(legs[0].motion.time_ns[0]), int(legs[-1].motion.time_ns[-1])
    departure_ns, arrival_ns = departed_ns, 0
    if options.journey is not None:
        departure_ns, arrival_ns = _due_ns(trip, trip_journey(options.journey, trip.route, departed_ns), departed_ns)
    elif trip.journey is not None and trip.journey.stops:  # on the bus, a time of 0 means that none is set
        departure_ns = trip.journey.stops[0].departure_ns or departed_ns
        arrival_ns = trip.journey.stops[-1].arrival_ns
    if options.delay_s is not None:
        departure_ns = departed_ns - round(options.delay_s / NS)
    if options.running_time_s is not None:
        arrival_ns = departure_ns + round(options.running_time_s / NS)
    own = arrival_ns == 0
    if own and options.delay_s is not None:
        raise DasError(f"--delay {options.delay_s:g}: needs --running-time: no arrival is due in the recording")
    if own:
        departure_ns, arrival_ns = departed_ns, arrived_ns
    if arrival_ns <= departure_ns:
        raise DasError(f"the arrival is {(departure_ns - arrival_ns) * NS:.0f} s before the departure")
    first_ns, last_ns = int(trip.matched.time_ns[0]), int(trip.matched.time_ns[-1])
    return ReplayTiming(
        departure_ns=departure_ns,
        arrival_ns=arrival_ns,
        first_tick_ns=min(first_ns, departed_ns),
        last_tick_ns=max(last_ns, arrived_ns),
        own=own,
        retimed=any(one is not None for one in (options.journey, options.running_time_s, options.delay_s)),
    )


def _due_ns(trip: Trip, journey: Journey, departed_ns: int) -> tuple[int, int]:
    """The due departure and arrival of a trip (ns since 1970), on the day nearest to its actual departure."""
    departure_s = _call(journey, trip.start.name).departure.earliest_s
    arrival_s = _call(journey, trip.end.name).arrival.latest_s
    for name, time_s, what in ((trip.start.name, departure_s, "departure"), (trip.end.name, arrival_s, "arrival")):
        if not math.isfinite(time_s):
            raise DasError(f"{journey.source}: {name}: expected a time of {what}, which the replayed trip needs")
    midnights_ns = [trip.route.midnight_ns(departed_ns + day * DAY_NS) for day in (-1, 0, 1)]
    due_ns = [zero_ns + round(departure_s / NS) for zero_ns in midnights_ns]
    departure_ns = min(due_ns, key=lambda one_ns: abs(one_ns - departed_ns))
    return departure_ns, departure_ns + round((arrival_s - departure_s) / NS)


def _call(journey: Journey, stop: str) -> Call:
    for call in journey.calls:
        if call.name == stop:
            return call
    names = ", ".join(call.name for call in journey.calls)
    raise DasError(f"{journey.source}: {stop}: expected a stop there, where the trip begins or ends (journey: {names})")


TICK_S = 1.0
DELAY_EVERY_S = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ReplayJob:
    """The inputs of a replay, checked beforehand.

    `processes` has the settings of node and recorder. `legs` are the parts of the trip from one stop to the next.
    `front` has the optimal runs of the section for all times, `reference` is the optimal run for the timetable;
    `driven` is the energy of the trip as driven. `speed` is a multiple of real time; None: as fast as possible.
    `files_kept` keeps the folder of files extracted from a recording until the job ends.
    """

    processes: Processes
    trip: Trip
    legs: tuple[DrivenLeg, ...]
    front: Front
    timing: ReplayTiming
    reference: Solution
    driven: DrivenEstimate
    speed: float | None
    files_kept: object = None

    @property
    def departed_ns(self) -> int:
        """Time at which the train left its first stop (ns since 1970)."""
        return int(self.legs[0].motion.time_ns[0])

    @property
    def arrived_ns(self) -> int:
        """Time at which the train came to a stand at its last stop (ns since 1970)."""
        return int(self.legs[-1].motion.time_ns[-1])


@dataclass(frozen=True, kw_only=True)
class ReplayOutcome:
    """The result of a replay, and its duration (s)."""

    traffic: Traffic
    replay_s: float


def prepare(trip_path: Path, options: ReplayOptions, out: Path, command: str) -> ReplayJob:
    """Read trip, route and vehicle, solve the section and estimate the energy as driven.

    `command` is what the user typed; the recording keeps it. Raises DasError for anything unusable.
    """
    check_train_name(options.train)
    pace_factor(options.pace)
    check_timing(options)
    if out.resolve() == trip_path.resolve():
        raise DasError(f"{out}: the recording to write would replace the trip being read")
    bus = bus_folder(options.bus, options.insecure_bus, options.train)
    folder = tempfile.TemporaryDirectory(prefix="das-replay-")
    of_trip, trip = open_trip(trip_path, options.trip, Path(folder.name))
    section = trip_section(trip, of_trip)
    warm_up()
    front = solve_front(section)
    legs = driven_legs(trip, trip.run)
    timing = plan_timing(trip, legs, options)
    given = [] if of_trip.posts is None else [of_trip.posts]
    given += [] if options.journey is None else [journey_file(options.journey)]
    processes = Processes(
        train=options.train,
        node_arguments=_node_arguments(of_trip, trip.start.name, trip.end.name),
        out=out,
        metadata={**_metadata(trip, section, of_trip), **timing.metadata, "command": command, "train": options.train},
        start_ns=timing.first_tick_ns,
        attachments=(*_input_files(of_trip).values(), *given),
        bus=bus,
    )
    run = trip.run
    return ReplayJob(
        processes=processes,
        trip=trip,
        front=front,
        legs=legs,
        timing=timing,
        reference=front.trajectory((timing.arrival_ns - timing.departure_ns) * NS),
        driven=estimate_run(section, run.time_s, run.s_m, run.speed_mps),
        speed=pace_factor(options.pace),
        files_kept=folder,
    )


def driven_legs(trip: Trip, run: DrivenRun) -> tuple[DrivenLeg, ...]:
    """The legs of a trip, cut and timed as for every drive; one leg if the train does not stand at both end stops."""
    motion = DrivenMotion.of_run(run)
    ends = [OrderedStop(one.name, one.position_m) for one in (trip.start, trip.end)]
    start, end = kept_calls(ends, motion, trip.matched)
    if not trip.whole:
        return (DrivenLeg(start=start, end=end, motion=motion),)
    return legs_of(trip.path, motion, [start, *_on_the_way(trip, motion), end])


def _on_the_way(trip: Trip, motion: DrivenMotion) -> tuple[KeptCall, ...]:
    stood = [one for one in trip.route.stops if one.name in trip.stops_on_the_way]
    return calls_on_the_way(stood, motion, trip.matched)


def smoothed_legs(trip: Trip) -> Smoothed:
    """The legs of a trip under another smoothing of its record."""
    return cache(lambda jerk_ratio: driven_legs(trip, to_profile(trip.matched, jerk_ratio)))


def compared_legs(trip: Trip, section: Section) -> Smoothed:
    """The legs of a trip that can be compared with the optima of a section's train, under another smoothing.

    If the trip does not stand at both its stops, they cover its longest part between equal speeds. Smoothing changes
    neither the times nor the speeds of its ends, so that no kinetic energy is counted. DasError if there is no such
    part.
    """
    if trip.whole:
        return smoothed_legs(trip)
    vehicle = replace(section.vehicle, train_length_m=section.train_length_m)
    motion = DrivenMotion.of_run(trip.run)
    calls = open_calls(trip.path, motion, trip.route, vehicle, _on_the_way(trip, motion))
    return cache(lambda jerk: legs_of(trip.path, DrivenMotion.of_run(to_profile(trip.matched, jerk)), calls))


def parts_of(legs: Smoothed) -> SmoothedParts:
    """The motion of legs."""
    return lambda jerk: [DrivenPart(one.time_s, one.motion.s_m, one.motion.speed_mps) for one in legs(jerk)]


def stated_parts(trip: Trip, section: Section) -> tuple[SmoothedParts, str]:
    """The legs of a trip with stated energies, and words for the part of the trip that they cover (empty: all)."""
    try:
        legs = compared_legs(trip, section)
    except DasError:  # no part of an open trip can be compared with this train
        return parts_of(smoothed_legs(trip)), ""
    made = legs(1.0)
    return parts_of(legs), part_between(made[0].start.name, made[-1].end.name)


def _node_arguments(options: TripOptions, start: str, end: str) -> tuple[str, ...]:
    arguments = ["--route", str(options.route), "--vehicle", str(options.vehicle), "--from", start, "--to", end]
    if options.reverse:
        arguments.append("--reverse")
    if options.level is not None:
        arguments += ["--level", str(options.level)]
    if options.loss_map is not None:
        arguments += ["--loss-map", str(options.loss_map)]
    return tuple(arguments)


def _input_files(options: TripOptions) -> dict[str, Path]:
    """The paths of route, vehicle and loss map by those names; a loss map that is given replaces the vehicle's own."""
    files = input_files(str(options.route), str(options.vehicle))
    return files if options.loss_map is None else {**files, "loss_map": options.loss_map}


def _metadata(trip: Trip, section: Section, options: TripOptions) -> dict[str, str]:
    report = trip.matched.report
    return {
        "kind": "replay",
        "version": __version__,
        "trip": trip.path.name,
        "trip_sha256": sha256(trip.path),
        "route": section.route.name,
        "vehicle": section.vehicle.name,
        **{f"{name}_sha256": sha256(path) for name, path in _input_files(options).items()},
        "level": str(section.level),
        "map_anchor": report.anchor,
        "map_scale": f"{report.scale:.6f}",
        "map_offset_m": f"{report.offset_m:.1f}",
        "map_median_cross_track_m": _metres(report.median_cross_track_m),
        "map_p95_cross_track_m": _metres(report.p95_cross_track_m),
        "map_max_cross_track_m": _metres(report.max_cross_track_m),
        "gps_dropout_points": str(np.count_nonzero(trip.matched.dropout)),
        "cleaning": report.cleaning.summary,
    }


def _metres(distance_m: float | None) -> str:
    return "no line" if distance_m is None else f"{distance_m:.1f}"


def replay(
    job: ReplayJob, progress: Callable[[int, int], None], closing: Callable[[int], Message] | None = None
) -> ReplayOutcome:
    """Run the replay; `progress(tick, ticks)` is called as it goes. Raises DasError if a process fails.

    `closing` makes the last message of the recording, on the energy above the optimum, with the last tick's time (ns).
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
    timing = job.timing
    ticks = int(np.ceil((timing.last_tick_ns - timing.first_tick_ns) * NS / TICK_S)) + 1
    feed = deque(_feed(job))
    began = time.perf_counter()
    for tick in range(1, ticks + 1):
        now_ns = timing.first_tick_ns + round((tick - 1) * TICK_S / NS)
        while feed and feed[0][0] <= now_ns:
            lockstep.send(*feed.popleft()[1])
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


def _feed(job: ReplayJob) -> list[tuple[int, Outgoing]]:
    """The messages of sensors and operator, and the truth, with their times (ns since 1970) and in order of them."""
    timing = job.timing
    late_s = (job.departed_ns - timing.departure_ns) * NS
    late = "no timetable was given" if timing.own else f"departed {late_s:.0f} s late"
    text = f"replay of {job.trip.path.name}, {late}"
    # A recorded trip contains no temporary restrictions; the node needs an empty list.
    at_ns = timing.first_tick_ns
    first = codec.encode_input(RestrictionsHeard(time_ns=at_ns, restrictions=())), Outgoing(LOG, happened(at_ns, text))
    sent = [*_positions(job.trip), *_delays(job), *_truth(job), *((at_ns, one) for one in first)]
    return sorted(sent, key=lambda item: item[0])


def _positions(trip: Trip) -> Iterator[tuple[int, Outgoing]]:
    matched = trip.matched
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


def _delays(job: ReplayJob) -> Iterator[tuple[int, Outgoing]]:
    """The recorded delays, else those from the optimum of the running time; none without a timetable."""
    trip, timing = job.trip, job.timing
    if timing.own:
        return
    if trip.delays and not timing.retimed:
        for time_ns, delay_s in trip.delays:
            yield time_ns, codec.encode_input(DelayHeard(time_ns=time_ns, delay_s=delay_s))
        return
    planned = job.reference.trajectory
    run = trip.run
    for i in range(0, len(run.time_s), round(DELAY_EVERY_S)):
        time_ns = run.start_time_ns + round(float(run.time_s[i]) / NS)
        due_s = float(np.interp(run.s_m[i], planned.s_m, planned.t_s))
        delay_s = (time_ns - timing.departure_ns) * NS - due_s
        yield time_ns, codec.encode_input(DelayHeard(time_ns=time_ns, delay_s=delay_s))


def _truth(job: ReplayJob) -> Iterator[tuple[int, Outgoing]]:
    run, driven = job.trip.run, job.driven
    trajectory, index = driven.trajectory, driven.index
    limit_mps = job.trip.route.limits_over_train(job.front.section.train_length_m).at(run.s_m)
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
