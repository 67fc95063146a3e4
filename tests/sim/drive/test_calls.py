"""When a train was at its stops, to a fraction of a second; and their names over an axis."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from sim.drive.calls import as_rows, at_stops, calls
from sim.drive.table import DriveTable
from sim.recording.course import DrivenCourse, part_of
from sim.review.pictures import LETTER_SHARE, NAMES_AT_POINTS, light_figure, name_stops
from sim.review.scene import lane_of_stops
from tests.sim.drive.test_events import STOPS, drive
from tests.support.recordings import at_ns


def test_when_the_train_was_at_its_stops() -> None:
    recording = drive(stops=STOPS)
    trip = DrivenCourse.of(recording)
    first, passed, last = at_stops(calls(DriveTable.of(recording)), trip)
    assert (first.name, passed.name, last.name) == ("Aarau", "Brugg", "Cham")
    assert first.start_ns == at_ns(0)
    assert first.end_ns / 1e9 == pytest.approx(at_ns(10) / 1e9, abs=0.1)
    assert passed.start_ns == passed.end_ns
    assert (passed.start_ns - at_ns(0)) / 1e9 == pytest.approx(80.0, abs=1.0)  # 100 m to 10 m/s, then 500 m at it
    assert last.start_ns / 1e9 == pytest.approx(at_ns(150) / 1e9, abs=0.1)
    assert last.end_ns == at_ns(170)
    changes = lane_of_stops((first, passed, last)).changes
    assert [change.state for change in changes] == ["Aarau", "to Brugg", "to Cham", "Cham", ""]
    assert [change.time_ns for change in changes] == sorted(change.time_ns for change in changes)


def test_a_stop_that_was_passed_has_no_figures_for_programs() -> None:
    recording = drive(stops=STOPS)
    passed = as_rows(calls(DriveTable.of(recording)), 0)[1]
    assert (passed["name"], passed["stopping_error_m"]) == ("Brugg", None)
    assert not any(isinstance(value, float) and math.isnan(value) for value in passed.values())


def test_a_part_of_a_drive_has_the_stops_of_that_part() -> None:
    table = DriveTable.of(part_of(drive(stops=STOPS), "0:46", "1:55"))  # between the first stop and the last
    assert [stop.name for stop in at_stops(calls(table), table.course)] == ["Brugg"]


def test_names_of_near_stops_are_in_two_rows_and_none_covers_another() -> None:
    _, (axis,) = light_figure((1.0,))
    name_stops(axis, [(f"Station {i}", 0.02 * i) for i in range(51)])
    named = [(text.xy[0], text.xyann[1], LETTER_SHARE * len(text.get_text())) for text in axis.texts]
    assert {height for _, height, _ in named} == set(NAMES_AT_POINTS)
    for height in NAMES_AT_POINTS:
        row = sorted((middle, width) for middle, at, width in named if at == height)
        assert all(b - a > 0.5 * (v + w) for (a, v), (b, w) in pairwise(row))
