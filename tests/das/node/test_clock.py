"""The node's own clock: that it was set is told by the seconds that never jump, and said."""

from __future__ import annotations

from das.bus import das_pb2
from das.bus.topics import EVENT, JOURNEY, POSITION, RESTRICTION
from das.domain.clocks import Clocks
from das.domain.units import NS
from das.node.node import BusClock, Node, WallClock
from tests.support.driven_node import START_NS, DrivenNode, S, journey


class Time:
    """A time of day that can be set, and seconds that cannot."""

    def __init__(self) -> None:
        self.set_ns, self.passed_ns = START_NS, 0

    @property
    def clocks(self) -> Clocks:
        return Clocks(now_ns=lambda: self.set_ns + self.passed_ns, seconds=lambda: self.passed_ns * NS)


def test_a_clock_that_was_set_says_so_once() -> None:
    time = Time()
    clock = WallClock(time.clocks)
    time.passed_ns += 3600 * S
    assert clock.set_by_s() == 0.0
    time.set_ns -= 2 * S
    assert round(clock.set_by_s(), 3) == -2.0
    assert clock.set_by_s() == 0.0
    assert BusClock().set_by_s() == 0.0


def test_until_the_next_position_the_way_of_the_step_is_part_of_the_deviation() -> None:
    time, driven = Time(), DrivenNode(told=False)
    driven.node = Node(driven.sink, driven.node.cab, WallClock(time.clocks))  # type: ignore[arg-type]
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS), "a")
    driven.tell(JOURNEY, journey(), "a")

    def advice(*, told: bool = True) -> das_pb2.Advice:
        time.passed_ns += S
        now_ns = time.set_ns + time.passed_ns
        driven.node.look_around()
        if told:
            position = das_pb2.Position(time_ns=now_ns, s_m=20.0 * time.passed_ns * NS, speed_mps=20.0)
            driven.tell(POSITION, position, "a")
        driven.node.tick(now_ns)
        return driven.last_advice()

    for _ in range(10):
        usual_m = advice().position_sd_m
    time.set_ns += 1 * S
    assert advice(told=False).position_sd_m > 20.0
    assert "the clock was set forward by 1.0 s" in driven.sink.of(EVENT)[-1].message + driven.sink.events()
    assert advice().position_sd_m < 2 * usual_m
