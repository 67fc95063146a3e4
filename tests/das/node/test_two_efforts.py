"""Two publishers of the efforts of one train: calibration is off, says so, and forgets what it learned of them."""

from __future__ import annotations

from das.bus import das_pb2
from das.bus.topics import EFFORT, ESTIMATE
from das.cab.cab import CabSettings
from tests.support.driven_node import START_NS, DrivenNode, S


def effort(second: int, force_n: float) -> das_pb2.Effort:
    return das_pb2.Effort(time_ns=START_NS + second * S, force_el_n=force_n)


def test_two_publishers_of_the_effort_switch_calibration_off() -> None:
    driven = DrivenNode(CabSettings(calibrate=True))
    for second in range(1, 31):
        driven.tell(EFFORT, effort(second, 20e3), source="sensor-a")
        if 10 <= second < 15:
            driven.tell(EFFORT, effort(second, 15e3), source="sensor-b")
        assert driven.tick(second).mode != 0  # the advice goes on with the train as planned
    events = driven.sink.events()
    assert "effort: one of a second publisher, sensor-b, was ignored" in events
    assert "calibration off: two publishers of the efforts" in events
    assert "calibration on again" in events
    doubts = [estimate.doubt for estimate in driven.sink.of(ESTIMATE)]
    assert doubts[0] == ""
    assert "two-publishers" in doubts
    assert doubts[-1] == ""


def test_one_publisher_of_the_effort_is_not_doubted() -> None:
    driven = DrivenNode(CabSettings(calibrate=True))
    for second in range(1, 31):
        driven.tell(EFFORT, effort(second, 20e3), source="sensor-a")
        driven.tick(second)
    assert "calibration off" not in driven.sink.events()


def test_efforts_by_another_clock_than_the_positions_switch_calibration_off() -> None:
    """Forces of 1 s ago, set against the acceleration of now, make a train of another mass."""
    driven = DrivenNode(CabSettings(calibrate=True))
    for second in range(1, 31):
        driven.tell(EFFORT, effort(second - 1, 20e3), source="sensor-a")
        assert driven.tick(second).mode != 0
    assert "calibration off: the clocks of efforts and positions differ" in driven.sink.events()
    assert driven.sink.of(ESTIMATE)[-1].doubt == "clocks"
