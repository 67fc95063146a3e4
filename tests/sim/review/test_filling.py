"""A recording of the node alone is filled in: a second witness integrates force over the way, and asks the line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.bus import topics
from das.bus.recording import Recording, read_recording
from das.domain.units import KM, KMH, KN, PERMILLE, kwh
from sim.drive.attribution.inputs import inputs_of
from sim.drive.drive import Drive
from sim.recording.clock import part_of
from sim.review.story import Story

REFERENCE = Path(__file__).parents[3] / "recordings/references/clear-day.mcap"


@pytest.fixture(scope="module")
def alone() -> Recording:
    recording = read_recording(REFERENCE)
    assert not [name for name in recording.topics if name in ("truth", "cab", "effort")]
    return recording


@pytest.mark.slow
def test_line_and_forces_are_filled_in(alone: Recording) -> None:
    story, inputs = Story.of(Drive(source=alone)), inputs_of(alone)
    assert "estimated from positions" in story.filled_from
    at, gradient = story.series["gradient/permille"]
    here_m = story.trip.at(at, story.trip.s_m)
    risen_m = float(np.sum(gradient[:-1] * PERMILLE * np.diff(here_m)))
    ends_m = inputs.route.altitude_m(here_m[[0, -1]])
    assert risen_m == pytest.approx(float(ends_m[1] - ends_m[0]), abs=5.0)
    at, limit = story.series["speed/limit"]
    assert set(np.round(limit, 6)) <= set(np.round(inputs.route.limits_mps.value / KMH, 6))
    assert np.isfinite(limit).all()
    at, force_kn = story.series["force/driven"]
    s_m, moving = story.trip.at(at, story.trip.s_m), np.isfinite(force_kn)
    pulled_j = float(np.sum(np.maximum(force_kn[:-1], 0.0)[moving[:-1]] * KN * np.diff(s_m)[moving[:-1]]))
    drawn_kwh = float(story.series["energy/driven"][1].max())
    assert 0.9 * kwh(pulled_j) < drawn_kwh < 1.4 * kwh(pulled_j)  # what is drawn is the work of pulling and its losses
    assert np.ptp(story.trip.s_m) > 5 * KM
    assert story.way is not None
    steps_m = np.hypot(*np.diff(story.way.plane_m, axis=0).T)
    assert steps_m.sum() == pytest.approx(np.ptp(story.trip.s_m), rel=0.1)


@pytest.mark.slow
def test_a_part_is_filled_in_for_itself(alone: Recording) -> None:
    story = Story.of(Drive(source=part_of(alone, "5:00", "10:00")))
    for name in ("force/driven", "energy/driven", "gradient/permille"):
        at = story.series[name][0]
        assert len(at) > 100
        assert story.trip.time_ns[0] <= at[0] <= at[-1] <= story.trip.time_ns[-1]


def test_without_line_and_train_the_reason_is_told(alone: Recording) -> None:
    journey = alone.of(topics.JOURNEY)[0]
    other = type(journey.message)()
    other.CopyFrom(journey.message)
    other.route_id = "nowhere"
    messages = {**alone.messages, "journey": (journey._replace(message=other),)}
    story = Story.of(Drive(source=replace(alone, messages=messages)))
    assert "not known" in story.filled_from
    assert not len(story.series["force/driven"][0])
