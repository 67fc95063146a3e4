"""The motion of a drive, and what the friction brake took where only its measured force is known."""

from __future__ import annotations

import numpy as np
import pytest

from das.bus import das_pb2
from das.bus.recording import Recording
from das.bus.topics import EFFORT, POSITION
from sim.drive.drive import Drive
from sim.drive.legs import _friction_j
from sim.drive.series import series
from sim.drive.table import DriveTable
from sim.drivers.drivers import PerfectDriver
from tests.support.flat_days import flat_day
from tests.support.hand_recorded import in_memory
from tests.support.recorded_days import recorded_day
from tests.support.recordings import at_ns


def measured(*forces: tuple[float, float, float]) -> Recording:
    """A recording with positions and measured forces alone: time (s), force of the motors and of the friction brake."""
    return in_memory(
        *((EFFORT, das_pb2.Effort(time_ns=at_ns(t), force_el_n=el, force_friction_n=fr)) for t, el, fr in forces),
        *((POSITION, das_pb2.Position(time_ns=at_ns(t), s_m=20.0 * t, speed_mps=20.0)) for t in range(11)),
    )


def test_the_friction_brakes_energy_is_its_force_times_the_way() -> None:
    recording = measured((0, 0.0, 0.0), (4, 0.0, 0.0), (5, -1e4, -5e4), (10, -1e4, -5e4))
    times, speeds = np.array([at_ns(t) for t in range(11)]), np.full(11, 20.0)
    found = _friction_j(DriveTable.of(recording), times, speeds)
    assert found is not None
    assert found[4] == 0.0
    assert found[-1] == pytest.approx(5e4 * 20.0 * 5.5)  # half of the second in which it builds up


def test_without_measured_forces_nothing_is_known_of_the_friction_brake() -> None:
    assert _friction_j(DriveTable.of(measured()), np.array([at_ns(0)]), np.zeros(1)) is None


def test_pictures_show_measured_forces_where_no_simulator_tells_the_truth() -> None:
    recording = measured((0, 0.0, 0.0), (5, -1e4, -5e4), (10, 2e4, 0.0))
    at, force_kn = series(DriveTable.of(recording))["force/driven"]
    assert at.tolist() == [at_ns(t) for t in (0, 5, 10)]
    assert force_kn.tolist() == [0.0, -60.0, 20.0]


def test_a_leg_goes_from_stand_to_stand_and_its_times_are_those_of_the_run() -> None:
    day = flat_day()
    recording = recorded_day(day, PerfectDriver(day.service.line))
    (leg,) = Drive(recording=recording).energy.legs
    assert (leg.start.name, leg.end.name) == ("A", "B")
    assert leg.motion.speed_mps[0] == leg.motion.speed_mps[-1] == 0.0
    assert leg.timetable_s == pytest.approx(
        (day.service.timetables[0].arrival_ns - day.service.timetables[0].departure_ns) * 1e-9
    )
    said = [entry.message.message for entry in recording.of("log")]
    late_s = float(said[-1].rsplit(", ", 1)[1].removesuffix(" s"))
    assert leg.end.arrived_late_s == pytest.approx(late_s, abs=0.3)
    assert leg.trip_s == pytest.approx((leg.end.arrived_ns - leg.start.departed_ns) * 1e-9)  # as punctuality says
    assert leg.motion.speed_mps[1] < 0.3 or leg.motion.speed_mps[-2] < 0.3  # a train that creeps still drives
