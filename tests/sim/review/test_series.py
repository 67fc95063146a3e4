"""The quantities of a drive over time, as recorded, and filled in where the node alone recorded: a second witness."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.bus import das_pb2, topics
from das.bus.recording import Recording, read_recording
from das.domain.units import KM, KMH, KN, PERMILLE, kwh
from sim.drive.drive import Drive
from sim.drive.series import series
from sim.drive.table import DriveTable
from sim.recording.course import part_of
from sim.recording.opening import inputs_of
from sim.review.scene import ReviewScene
from tests.support.hand_recorded import advice, cab, recorded
from tests.support.recordings import at_ns

REFERENCE = Path(__file__).parents[3] / "recordings/references/clear-day.mcap"


def test_cab_and_estimates_are_series() -> None:
    shows = {"presentation": 3, "advised_speed_mps": 19.0, "advised_lever_ratio": 0.25, "lever_ratio": -0.5}
    estimate = das_pb2.Estimate(time_ns=at_ns(10), mass_ratio=1.15, mass_sd_ratio=0.02, resistance_ratio=0.9)
    recording = recorded(
        cab(0, **shows), cab(1, **{**shows, "presentation": 0}), (topics.ESTIMATE, estimate),
        advice(2, s_m=43.0, position_sd_m=1.5), advice(3, s_m=59.0, position_sd_m=0.0),
    )  # fmt: skip
    data = series(DriveTable.of(recording))
    assert data["speed/shown"][1][0] == pytest.approx(68.4)
    assert np.isnan(data["speed/shown"][1][1])
    assert data["lever/shown"][1][0] == pytest.approx(25.0)
    assert data["lever/set"][1][:2] == pytest.approx([-50.0, -50.0])
    assert data["estimate/error"][1] == pytest.approx([3.0])
    assert data["estimate/sd"][1] == pytest.approx([1.5])
    assert data["calibration/mass"][1] == pytest.approx([15.0])
    assert data["calibration/mass_sd"][1] == pytest.approx([2.0])
    assert data["calibration/resistance"][1] == pytest.approx([-10.0])


@pytest.fixture(scope="module")
def alone() -> Recording:
    recording = read_recording(REFERENCE)
    assert not [name for name in recording.topics if name in ("truth", "cab", "effort")]
    return recording


def test_line_and_forces_are_filled_in(alone: Recording) -> None:
    scene, inputs = ReviewScene.of(Drive(recording=alone)), inputs_of(alone)
    assert "estimated from positions" in scene.filled_from
    at, gradient = scene.series["gradient/permille"]
    here_m = scene.trip.at(at, scene.trip.s_m)
    risen_m = float(np.sum(gradient[:-1] * PERMILLE * np.diff(here_m)))
    ends_m = inputs.route.altitude_m(here_m[[0, -1]])
    assert risen_m == pytest.approx(float(ends_m[1] - ends_m[0]), abs=5.0)
    at, limit = scene.series["speed/limit"]
    assert set(np.round(limit, 6)) <= set(np.round(inputs.route.limits_mps.value / KMH, 6))
    assert np.isfinite(limit).all()
    at, force_kn = scene.series["force/driven"]
    s_m, moving = scene.trip.at(at, scene.trip.s_m), np.isfinite(force_kn)
    pulled_j = float(np.sum(np.maximum(force_kn[:-1], 0.0)[moving[:-1]] * KN * np.diff(s_m)[moving[:-1]]))
    drawn_kwh = float(scene.series["energy/driven"][1].max())
    assert 0.9 * kwh(pulled_j) < drawn_kwh < 1.4 * kwh(pulled_j)  # what is drawn is the work of pulling and its losses
    assert np.ptp(scene.trip.s_m) > 5 * KM


@pytest.mark.slow
def test_a_part_is_filled_in_for_itself(alone: Recording) -> None:
    scene = ReviewScene.of(Drive(recording=part_of(alone, "5:00", "10:00")))
    for name in ("force/driven", "energy/driven", "gradient/permille"):
        at = scene.series[name][0]
        assert len(at) > 100
        assert scene.trip.time_ns[0] <= at[0] <= at[-1] <= scene.trip.time_ns[-1]


def test_without_line_and_train_the_reason_is_told(alone: Recording) -> None:
    journey = alone.of(topics.JOURNEY)[0]
    other = type(journey.message)()
    other.CopyFrom(journey.message)
    other.route_id = "nowhere"
    messages = {**alone.messages, "journey": (journey._replace(message=other),)}
    scene = ReviewScene.of(Drive(recording=replace(alone, messages=messages)))
    assert "not known" in scene.filled_from
    assert not len(scene.series["force/driven"][0])


def test_values_of_the_view(whole: Path) -> None:
    scene = ReviewScene.of(Drive(recording=read_recording(whole)))
    data = scene.series
    assert data["speed/driven"][1].max() == pytest.approx(144.0)
    assert data["speed/advised"][1][0] == pytest.approx(1.8)
    assert np.flatnonzero(np.isnan(data["speed/advised"][1])).tolist() == list(range(200, 220))
    assert data["force/driven"][1][0] == pytest.approx(100.0)
    assert data["gradient/permille"][1][0] == pytest.approx(5.0)
    assert data["buffer/percent"][1][0] == pytest.approx(7.0)
