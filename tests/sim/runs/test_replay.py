"""A replayed trip is the same drive as its recording; one with stops on the way is compared leg by leg."""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from das.bus import codec, das_pb2
from das.bus.recording import Recording, Stamped
from das.domain.errors import DasError
from das.domain.route import Stop
from das.domain.units import KMH, NS
from das.domain.vehicle import Resistance, Vehicle
from das.solver.section import build_section
from das.solver.solve import solve_front
from sim.cli.trips import bundled_recording
from sim.drive.drive import Drive
from sim.drive.events import EventKind
from sim.drive.legs import EQUAL_MPS, fast_enough
from sim.drive.series import driven as series
from sim.options import ReplayOptions, TripOptions
from sim.recording.course import OWN_TIMETABLE
from sim.recording.opening import DriveInputs
from sim.review.first_page import LESS_THAN_BEST, how_sure, page_dict
from sim.review.tables import stop_rows
from sim.runs.replay import (
    ReplayJob,
    _feed,
    _journey,
    check_timing,
    compared_legs,
    driven_legs,
    plan_timing,
    prepare,
)
from sim.runs.replay_figures import TripEnergies, trip_energies
from sim.trips.estimate import estimate_run
from sim.trips.record import read_trip
from sim.trips.trip import Trip, load_trip
from sim.world.lockstep import Processes
from tests.support.dirt import Point, write
from tests.support.making import flat, make_train
from tests.support.sparse import sparse_cuts

LENGTH_M, MIDDLE_M, DWELL_S = 5000.0, 2000.0, 45
FIRST_S, SECOND_S = 120.0, 185.0
Driven = tuple[ReplayJob, TripEnergies, list[float]]
"""The replay of a trip, its energies, and the least energy of each of its sections (J)."""


@pytest.fixture(autouse=True, scope="module")
def sparse() -> Iterator[None]:
    with sparse_cuts():
        yield


def job_of(trip: Trip) -> ReplayJob:
    """The replay of a trip with the train that drove it, of which no process is started."""
    front, run = solve_front(build_section(trip.route, make_train(resistance=(3000.0, 0.0, 12.0)))), trip.run
    legs = driven_legs(trip, run)
    timing = plan_timing(trip, legs, ReplayOptions())
    processes = Processes(
        train="train-1", node_arguments=(), out=Path("x.mcap"), metadata={}, start_ns=timing.first_tick_ns
    )
    driven = estimate_run(front.section, run.time_s, run.s_m, run.speed_mps)
    return ReplayJob(
        processes=processes, trip=trip, legs=legs, front=front, timing=timing, reference=front.fastest(), driven=driven,
        speed=None,
    )  # fmt: skip


def recorded(job: ReplayJob, energies: TripEnergies | None = None) -> Recording:
    """What a replay records of the drive, without what its node says."""
    messages = defaultdict(list)
    for one in (codec.encode_input(_journey(job)), *(sent for _, sent in _feed(job))):
        messages[one.topic.name].append(Stamped(0, one.message))
    if energies is not None:
        messages["saving"] = [Stamped(0, energies.above.message(7))]
    return Recording(
        path=Path("replay.mcap"), train="train-1", trains=("train-1",), metadata={"run": {"kind": "replay"}},
        messages={name: tuple(some) for name, some in messages.items()}, attachments=(), complete=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """The optimum of both sections with a stand between them, as a record once a second; and its energies (J)."""
    ends = flat(LENGTH_M, 120 * KMH)
    first, last = ends.stops
    route = replace(ends, stops=(first, Stop(name="M", position_m=MIDDLE_M), last))
    train = make_train(resistance=(3000.0, 0.0, 12.0))
    points: list[Point] = []
    energies: list[float] = []
    t0 = 0.0
    for start_m, end_m, trip_s in ((0.0, MIDDLE_M, FIRST_S), (MIDDLE_M, LENGTH_M, SECOND_S)):
        best = solve_front(build_section(route, train, start_m=start_m, end_m=end_m)).trajectory(trip_s)
        run, t = best.trajectory, np.arange(0.0, trip_s + 1.0)
        rows = zip(t, np.interp(t, run.t_s, run.s_m), np.interp(t, run.t_s, run.v_mps), strict=True)
        points += [Point(t0 + float(a), float(b), float(c)) for a, b, c in rows]
        points += [Point(t0 + trip_s + i, end_m, 0.0) for i in range(1, DWELL_S)]
        energies.append(best.balance.input)
        t0 += trip_s + DWELL_S
    path = write(tmp_path_factory.mktemp("trip"), points, on_route=True)
    job = job_of(load_trip(path, read_trip(path), route, TripOptions()))
    return job, trip_energies(job), energies


def given_inputs(job: ReplayJob, vehicle: Vehicle | None = None) -> DriveInputs:
    """Line and train of a replay, or another train."""
    section = job.front.section
    return DriveInputs(route=job.trip.route, vehicle=vehicle or section.vehicle, level=section.level, source="test")


@pytest.fixture(scope="module")
def replayed(driven: Driven) -> Drive:
    """The drive of a replay's recording."""
    job, found, _ = driven
    return Drive(recording=recorded(job, found), given=given_inputs(job))


def test_who_drove_both_sections_as_well_as_possible_is_not_above_the_optimum(driven: Driven) -> None:
    job, found, energies = driven
    assert [(one.start.name, one.end.name) for one in job.legs] == [
        (job.trip.start.name, "M"),
        ("M", job.trip.end.name),
    ]
    assert [one.trip_s for one in job.legs] == pytest.approx([FIRST_S, SECOND_S], abs=2.0)
    above_j, likely = found.above.above_j, found.likely
    assert above_j is not None
    assert likely is not None
    assert abs(above_j) < 0.015 * sum(energies)
    assert likely.low_j <= above_j <= likely.high_j <= likely.by_friction_j
    through = job.front.trajectory(float(job.trip.run.time_s[-1])).balance.input
    assert through < 0.9 * sum(energies)  # the optimum that does not stop would have claimed a saving that nobody had


def test_what_is_recorded_above_the_optimum_is_the_sum_of_its_sections(driven: Driven) -> None:
    above, likely = driven[1].above, driven[1].likely
    assert likely is not None
    message = das_pb2.Saving.FromString(above.message(7).SerializeToString())
    assert (message.time_ns, message.measured, message.comparable) == (7, False, True)
    assert message.driven_j == pytest.approx(math.fsum(one.driven_j for one in message.sections))
    assert message.optimum_j == pytest.approx(math.fsum(one.optimum_j for one in message.sections))
    assert (message.likely_low_j, message.likely_high_j) == (likely.low_j, likely.high_j)
    assert likely.low_j < message.driven_j - message.optimum_j < likely.high_j
    untold = replace(above, why_not="why", likely=None).message(7)
    assert not untold.comparable
    assert math.isnan(untold.likely_low_j)


def test_a_replay_without_a_timetable_says_so_in_its_recording(driven: Driven) -> None:
    job, _, _ = driven
    assert OWN_TIMETABLE in job.timing.metadata
    for given in (ReplayOptions(running_time_s=600.0), ReplayOptions(running_time_s=600.0, delay_s=5.0)):
        assert plan_timing(job.trip, job.legs, given).metadata == {}


def journey_of(job: ReplayJob, departs_s: float | None, arrives_s: float | None) -> das_pb2.Journey:
    """A recording's journey with times after the driven departure (s); None: it states none."""
    due = [0 if time_s is None else job.departed_ns + round(time_s / NS) for time_s in (departs_s, arrives_s)]
    stops = das_pb2.Journey.Stop(name="A", departure_ns=due[0]), das_pb2.Journey.Stop(name="B", arrival_ns=due[1])
    return das_pb2.Journey(stops=stops)


def test_a_delay_needs_a_time_at_which_the_train_is_due(driven: Driven) -> None:
    """Else the arrival as driven would be the due one, which nobody said."""
    job, _, _ = driven
    untimed = replace(job.trip, journey=journey_of(job, -30.0, None))
    for trip in (job.trip, untimed):
        with pytest.raises(DasError, match=r"^--delay 0: needs --running-time: no arrival is due in the recording"):
            plan_timing(trip, job.legs, ReplayOptions(delay_s=0.0))
    timed_one = plan_timing(
        replace(job.trip, journey=journey_of(job, -30.0, 500.0)), job.legs, ReplayOptions(delay_s=10.0)
    )
    assert (job.departed_ns - timed_one.departure_ns) * NS == pytest.approx(10.0)
    assert (timed_one.arrival_ns - job.departed_ns) * NS == pytest.approx(500.0)


def test_a_recording_without_a_time_of_arrival_has_no_timetable(driven: Driven) -> None:
    job, _, _ = driven
    for journey in (journey_of(job, None, None), journey_of(job, -30.0, None), das_pb2.Journey()):
        timing = plan_timing(replace(job.trip, journey=journey), job.legs, ReplayOptions())
        assert timing.own
        assert (timing.departure_ns, timing.arrival_ns) == (job.departed_ns, job.arrived_ns)
    timing = plan_timing(replace(job.trip, journey=journey_of(job, None, 500.0)), job.legs, ReplayOptions())
    assert (timing.own, timing.departure_ns) == (False, job.departed_ns)
    assert (timing.arrival_ns - job.departed_ns) * NS == pytest.approx(500.0)


def test_recorded_delays_are_those_of_the_recorded_timetable(driven: Driven) -> None:
    job, _, _ = driven
    trip = replace(job.trip, journey=journey_of(job, 0.0, 475.0), delays=((job.departed_ns + 10**9, 95.0),))
    for given, kept in ((ReplayOptions(), True), (ReplayOptions(running_time_s=600.0), False)):
        timing = plan_timing(trip, job.legs, given)
        delays_s = [one.message.delay_s for one in recorded(replace(job, trip=trip, timing=timing)).messages["delay"]]
        assert (delays_s == [95.0]) is kept


def test_nothing_is_late_or_early_without_a_timetable(driven: Driven) -> None:
    """No delay goes over the bus, and calls, lateness, events and curves have no times that somebody made up."""
    job, energies, _ = driven
    found = recorded(job, energies)
    assert "delay" not in found.messages
    (log,) = (one.message.message for one in found.messages["log"])
    assert log.endswith("no timetable was given")
    own = replace(found, metadata={"run": {"kind": "replay", **job.timing.metadata}})
    late = Stamped(0, das_pb2.Delay(time_ns=job.departed_ns + 10**9, delay_s=95.0))  # older replays made delays up
    drive = Drive(recording=replace(own, messages={**own.messages, "delay": (late,)}), given=given_inputs(job))
    assert [one.timed for one in drive.calls] == [False, False]
    assert math.isnan(drive.late_s)
    assert {EventKind.DELAY, EventKind.DEVIATION}.isdisjoint(one.kind for one in drive.events)
    assert not any("on time" in one.text or "late" in one.text for one in drive.events)
    assert "deviation/operator" not in series(drive.table)
    assert drive.table.clock.zero_is == "the departure of the trip"
    assert all(row["due"] == row["leaves"] == "" for row in stop_rows(drive))
    arrival = page_dict(drive)["figures"][0]
    assert (arrival[1], arrival[2].endswith("no timetable was given")) == ("not known", True)


def timed(folder: Path, trip: Trip, departure: str, arrival: str) -> Path:
    """A journey from the first to the last stop of a trip."""
    path = folder / "journey.toml"
    ends = f'[[stops]]\nstop = "{trip.start.name}"\n{departure}\n[[stops]]\nstop = "{trip.end.name}"\n{arrival}\n'
    path.write_text(f'schema_version = 1\n[journey]\nid = "j"\nname = "J"\nsource = "s"\n{ends}')
    return path


def clock(time_ns: int, zone: str) -> str:
    """A moment as a clock shows it in a time zone."""
    return datetime.fromtimestamp(round(time_ns * NS), ZoneInfo(zone)).strftime("%H:%M:%S")


@pytest.mark.parametrize("zone", ["UTC", "Europe/Zurich", "Pacific/Auckland"])
def test_a_journey_times_a_replay_on_the_day_of_the_trip(driven: Driven, tmp_path: Path, zone: str) -> None:
    job, _, _ = driven
    trip = replace(job.trip, route=replace(job.trip.route, time_zone=zone))
    due = [clock(time_ns, zone) for time_ns in (job.departed_ns - round(40 / NS), job.arrived_ns - round(65 / NS))]
    path = timed(tmp_path, trip, f'departure = "{due[0]}"', f'arrival = "{due[1]}"')
    timing = plan_timing(trip, job.legs, ReplayOptions(journey=str(path)))
    assert (job.departed_ns - timing.departure_ns) * NS == pytest.approx(40.0, abs=1.0)
    assert (job.arrived_ns - timing.arrival_ns) * NS == pytest.approx(65.0, abs=1.0)
    assert not timing.own


def test_a_train_due_before_midnight_that_departs_after_it_is_late_by_minutes(driven: Driven, tmp_path: Path) -> None:
    job, _, _ = driven
    midnight_ns = job.trip.route.midnight_ns(job.departed_ns)
    legs = [replace(job.legs[0], motion=replace(job.legs[0].motion, time_ns=np.array([midnight_ns + round(120 / NS)])))]
    path = timed(tmp_path, job.trip, 'departure = "23:59:00"', 'arrival = "24:10:00"')
    timing = plan_timing(job.trip, legs, ReplayOptions(journey=str(path)))
    assert (midnight_ns - timing.departure_ns) * NS == pytest.approx(60.0)
    assert (timing.arrival_ns - timing.departure_ns) * NS == pytest.approx(660.0)


def test_the_stops_of_a_wifi_portal_time_a_replay(driven: Driven, tmp_path: Path) -> None:
    job, _, _ = driven
    stops = [(job.trip.start.name, job.departed_ns - 40 * 10**9), (job.trip.end.name, job.arrived_ns - 65 * 10**9)]
    path = tmp_path / "stops.jsonl"
    listed = [{"label": name, "theoricDate": time_ns // 10**6, "duration": 0} for name, time_ns in stops]
    path.write_text(json.dumps({"number": "1", "stops": listed}) + "\n")
    timing = plan_timing(job.trip, job.legs, ReplayOptions(journey=str(path)))
    assert (job.departed_ns - timing.departure_ns) * NS == pytest.approx(40.0, abs=0.002)
    assert (job.arrived_ns - timing.arrival_ns) * NS == pytest.approx(65.0, abs=0.002)


def test_a_journey_that_is_not_of_the_trip_is_refused(driven: Driven, tmp_path: Path) -> None:
    job, _, _ = driven
    path = timed(tmp_path, job.trip, 'departure = "08:00:00"', 'arrival = "08:10:00"')
    asked = ReplayOptions(journey=str(path))
    elsewhere = replace(job.trip, end=Stop(name="M", position_m=MIDDLE_M))
    with pytest.raises(DasError, match="M: expected a stop there, where the trip begins or ends"):
        plan_timing(elsewhere, job.legs, asked)
    calls = path.read_text().replace('departure = "08:00:00"', 'departure = "08:00:00"\n[[stops]]\nstop = "M"')
    path.write_text(calls)
    with pytest.raises(DasError, match="M: expected a time of arrival"):
        plan_timing(elsewhere, job.legs, asked)
    with pytest.raises(DasError, match="--delay 5: not allowed with --journey"):
        check_timing(replace(asked, delay_s=5.0))


def test_the_recording_of_a_replay_has_the_legs_and_the_figures_of_the_replay(driven: Driven, replayed: Drive) -> None:
    """Its journey does not name the stop on the way, at which the trip stood; the energies are those that it said."""
    (job, found, _), drive = driven, replayed
    for ours, theirs in zip(job.legs, drive.energy.legs, strict=True):
        assert (ours.start.name, ours.end.name, ours.trip_s) == (theirs.start.name, theirs.end.name, theirs.trip_s)
        np.testing.assert_array_equal(ours.motion.time_ns, theirs.motion.time_ns)
        np.testing.assert_array_equal(ours.motion.s_m, theirs.motion.s_m)
    assert drive.late_s == pytest.approx((job.arrived_ns - job.timing.arrival_ns) * 1e-9)
    attribution, likely = drive.energy.known_attribution, drive.energy.likely
    assert attribution.above.difference_j == pytest.approx(found.above.above_j)
    assert likely is not None
    assert (likely.low_j, likely.high_j) == found.above.likely


def test_less_than_the_best_possible_is_told_to_be_an_error(driven: Driven, replayed: Drive) -> None:
    """The best run of a train that is said to be held back more than the true one takes more than was driven."""
    job, found, _ = driven
    resistance = Resistance(c0_n=5000.0, c1_n_per_mps=0.0, c2_n_per_mps2=12.0)
    given = given_inputs(job, replace(job.front.section.vehicle, resistance=resistance))
    held_back = Drive(recording=recorded(job, found), given=given)
    assert [LESS_THAN_BEST in how_sure(drive) for drive in (replayed, held_back)] == [False, True]


def test_a_trip_that_needs_more_force_than_its_train_has_is_doubted_on_page_one(
    driven: Driven, replayed: Drive
) -> None:
    job, found, _ = driven
    vehicle = job.front.section.vehicle
    weak = replace(vehicle, traction=replace(vehicle.traction, max_force_n=0.6 * vehicle.traction.max_force_n))
    too_weak = Drive(recording=recorded(job, found), given=given_inputs(job, weak))
    said = [page_dict(drive)["right_train"] for drive in (replayed, too_weak)]
    assert said[0] == ""
    assert re.match(r"The trip needs more force than the assumed train has for \d+ % of the time\.", said[1])


def test_a_recorded_trip_and_its_replay_are_one_drive(tmp_path: Path) -> None:
    """The bundled recording: it left 90 s late and drove for 1133 s, and its receiver tells so once a second."""
    job = prepare(bundled_recording(), ReplayOptions(), tmp_path / "out.mcap", "test")
    source, again = Drive.read(bundled_recording()), Drive(recording=recorded(job))
    for drive in (source, again):
        assert drive.calls[0].departed_late_s == pytest.approx(90.0, abs=0.6)
        assert drive.late_s == pytest.approx(-25.0, abs=0.6)
    for leg in (*source.energy.legs, *job.legs):
        assert leg.trip_s == pytest.approx(1133.0, abs=0.6)
    np.testing.assert_allclose(source.energy.legs[0].motion.s_m, job.legs[0].motion.s_m)


def test_a_trip_without_stops_on_the_way_is_one_leg(driven: Driven) -> None:
    trip = driven[0].trip
    other = replace(trip.route, stops=(trip.route.stops[0], trip.route.stops[-1]))
    (only,) = driven_legs(replace(trip, route=other), trip.run)
    assert only.trip_s == pytest.approx(FIRST_S + DWELL_S + SECOND_S, abs=2.0)


def test_a_trip_that_does_not_stand_at_its_stops_is_one_leg_over_its_whole_run(driven: Driven) -> None:
    trip = driven[0].trip
    part = replace(trip, matched=replace(trip.matched, ends=trip.matched.ends._replace(starts_standing=False)))
    (only,) = driven_legs(part, trip.run)
    assert only.trip_s == pytest.approx(float(trip.run.time_s[-1]))
    found = trip_energies(replace(driven[0], trip=part, legs=(only,)))
    assert found.above.part == "km 0.0 at 0 km/h to km 5.0 at 0 km/h"  # equal speeds: it stood there all the same
    assert [one.end for one in found.above.sections] == ["M", "km 5.0 at 0 km/h"]
    assert found.above.above_j == pytest.approx(driven[1].above.above_j, abs=0.01 * found.above.driven_j)


def test_an_open_trip_is_compared_over_its_longest_part_between_equal_speeds(driven: Driven) -> None:
    """The record ends as the train brakes: the part begins when it was as fast, and its optimum is as fast there."""
    trip = driven[0].trip
    cut = int(np.searchsorted(trip.run.s_m, LENGTH_M - 150.0))
    run = replace(trip.run, **{name: getattr(trip.run, name)[:cut] for name in ("time_s", "s_m", "speed_mps")})
    ends = trip.matched.ends._replace(ends_standing=False)
    part = replace(trip, run=run, matched=replace(trip.matched, ends=ends))
    found = trip_energies(replace(driven[0], trip=part))
    first, last = found.legs[0], found.legs[-1]
    assert first.leg.motion.s_m[0] < 1000.0
    assert last.leg.motion.s_m[-1] > LENGTH_M - 450.0
    assert abs(first.leg.motion.speed_mps[0] - last.leg.motion.speed_mps[-1]) <= 2 * EQUAL_MPS
    for speeds in (first.optimum.trajectory.v_mps[0], first.leg.motion.speed_mps[0]):
        assert speeds == pytest.approx(first.front.section.start_speed_mps)
    assert last.optimum.trajectory.v_mps[-1] == pytest.approx(last.leg.motion.speed_mps[-1])
    assert len(found.legs) == 2  # it stood at M
    assert 0.0 < found.above.above_j < 0.02 * found.above.driven_j  # type: ignore[operator]
    assert found.likely is not None
    assert found.likely.low_j < found.above.above_j < found.likely.high_j  # type: ignore[operator]
    assert found.energy.low_j < found.above.driven_j < found.energy.high_j


def test_a_part_of_less_than_a_kilometre_is_not_compared(driven: Driven) -> None:
    """It only accelerates; and a train of 60 km/h has no part of a drive of 108 km/h."""
    trip = driven[0].trip
    cut = int(np.searchsorted(trip.run.s_m, 800.0))
    run = replace(trip.run, **{name: getattr(trip.run, name)[:cut] for name in ("time_s", "s_m", "speed_mps")})
    part = replace(trip, run=run)
    section = driven[0].front.section
    slow = replace(section, vehicle=replace(section.vehicle, max_speed_mps=60 * KMH))
    with pytest.raises(DasError, match=r"not comparable: .*, nor does it have equal speeds 1 km apart$"):
        compared_legs(part, section)
    with pytest.raises(DasError, match="but the top speed of this train is 60 km/h"):
        compared_legs(part, slow)


def test_a_train_that_was_driven_a_little_too_fast_is_that_fast(driven: Driven) -> None:
    motion, train = driven[0].legs[0].motion, driven[0].front.section.vehicle
    top_mps = float(motion.speed_mps.max())
    near, far = (replace(train, max_speed_mps=top_mps / ratio) for ratio in (1.04, 1.06))
    assert fast_enough(near, motion).max_speed_mps == top_mps
    assert fast_enough(far, motion) is far
    assert fast_enough(train, motion) is train
