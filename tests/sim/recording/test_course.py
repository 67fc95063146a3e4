"""A part of a recording between two times holds what holds in it, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from das.bus import topics
from das.bus.recording import Recording, read_recording
from das.domain.errors import DasError
from sim.drive.drive import Drive
from sim.recording.course import DrivenCourse, part_of, stood_ns
from sim.review.scene import ReviewScene
from tests.support.recordings import SECONDS, START_NS, write_recording


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return read_recording(write_recording(tmp_path_factory.mktemp("recordings") / "whole.mcap"))


def since_s(recording: Recording, topic: topics.Topic) -> list[float]:
    return ((recording.columns(topic, "time_ns")["time_ns"] - START_NS) / 1e9).tolist()


def test_what_is_in_the_part(whole: Recording) -> None:
    part = part_of(whole, "1:30", "3:00")
    assert since_s(part, topics.TRUTH) == list(range(90, 181))
    assert since_s(part, topics.DELAY) == [60, 120, 180]  # the one that still holds, and those that came
    assert since_s(part, topics.PLAN) == list(range(0, 181, 10))  # the first plan is the optimum from the start
    assert part.of(topics.JOURNEY) == whole.of(topics.JOURNEY)
    scene = ReviewScene.of(Drive(recording=part))
    assert scene.trip.time_ns[0] == START_NS + 90 * 10**9
    assert np.ptp(scene.trip.time_ns) == 90 * 10**9
    speeds = scene.series["speed/driven"][1]
    assert speeds == pytest.approx(ReviewScene.of(Drive(recording=whole)).series["speed/driven"][1][90:181])


def test_either_end_may_be_left_out(whole: Recording) -> None:
    assert part_of(whole, None, None) is whole
    assert len(DrivenCourse.of(part_of(whole, "9:00", None)).time_ns) == SECONDS - 540
    assert len(DrivenCourse.of(part_of(whole, None, "0:09")).time_ns) == 10


@pytest.mark.parametrize(("start", "end"), [("11:00", None), ("3:00", "2:00"), (None, "−1:00"), ("soon", None)])
def test_times_that_are_not_of_the_drive(whole: Recording, start: str | None, end: str | None) -> None:
    with pytest.raises(DasError, match="expected"):
        part_of(whole, start, end)


@pytest.mark.parametrize(("speed_mps", "way_m", "after_s"), [(2.0, 0.5, 1.0), (4.0, 3.0, 1.5)])
def test_a_train_stops_halfway_between_samples_where_positions_are_too_rough_to_tell(
    speed_mps: float, way_m: float, after_s: float
) -> None:
    """In 2 s a train that brakes from 2 m/s runs 2 m, less than the error of 3 m; from 4 m/s 4 m: 2·Δs/v holds."""
    seen = DrivenCourse(
        time_ns=np.array([0, 2, 4, 6], dtype=np.int64) * 10**9,
        s_m=np.array([0.0, way_m, way_m, 2.0 * way_m]),
        speed_mps=np.array([speed_mps, 0.0, 0.0, speed_mps]),
    )
    _, came_ns, left_ns = stood_ns(way_m, 10.0, seen, seen)
    assert (came_ns / 1e9, left_ns / 1e9) == (after_s, 6.0 - after_s)
