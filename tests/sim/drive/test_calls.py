"""When a train was at its stops, to a fraction of a second; and their names on every axis of time and of distance."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from sim.drive.calls import as_rows, at_stops, calls_of
from sim.recording.course import DrivenCourse
from sim.review.lanes import lane_of_stops
from tests.sim.drive.events.test_events import STOPS, drive
from tests.support.recordings import at_ns


def test_when_the_train_was_at_its_stops() -> None:
    recording = drive(stops=STOPS)
    trip = DrivenCourse.of(recording)
    first, passed, last = at_stops(calls_of(recording, trip), trip)
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
    passed = as_rows(calls_of(recording, DrivenCourse.of(recording)))[1]
    assert (passed["name"], passed["missed_m"]) == ("Brugg", None)
    assert not any(isinstance(value, float) and math.isnan(value) for value in passed.values())


def test_a_part_of_a_drive_has_the_stops_of_that_part() -> None:
    trip = DrivenCourse.of(drive(stops=STOPS))
    part = slice(50, 120)  # between the first stop and the last
    cut = DrivenCourse(time_ns=trip.time_ns[part], s_m=trip.s_m[part], speed_mps=trip.speed_mps[part])
    assert [stop.name for stop in at_stops(calls_of(drive(stops=STOPS), cut), cut)] == ["Brugg"]


def test_a_picture_names_the_stops_over_distance_and_over_time() -> None:
    pytest.importorskip("matplotlib")
    from sim.review.picture import picture_of

    figure = picture_of(drive(stops=STOPS))
    over_distance, over_time = figure.axes[0], figure.axes[3]
    for axis in (over_distance, over_time):
        assert [text.get_text() for text in axis.texts] == ["Aarau", "Brugg", "Cham"]
    clock = [label.get_text().split("\n")[0] for label in figure.axes[-1].get_xticklabels()]
    assert clock == ["0:00", "0:30", "1:00", "1:30", "2:00", "2:30"]  # 0 is the timetable's departure, 4 s on
    np.testing.assert_allclose(figure.axes[-1].get_xticks(), np.arange(6) * 30.0)


def test_names_of_near_stops_are_in_two_rows_and_none_covers_another() -> None:
    pytest.importorskip("matplotlib")
    from das.drawing.meanings import LIGHT
    from sim.review.canvas import LETTER_SHARE, NAMES_AT_POINTS, Panel, figure_of, name_stops

    _, (axis,) = figure_of([Panel("", 1.0)], 0.5, LIGHT)
    name_stops(axis, [(f"Station {i}", 0.02 * i) for i in range(51)], LIGHT)
    named = [(text.xy[0], text.xyann[1], LETTER_SHARE * len(text.get_text())) for text in axis.texts]
    assert {height for _, height, _ in named} == set(NAMES_AT_POINTS)
    for height in NAMES_AT_POINTS:
        row = sorted((middle, width) for middle, at, width in named if at == height)
        assert all(b - a > 0.5 * (v + w) for (a, v), (b, w) in pairwise(row))
