"""The node's own clock, which somebody sets, and a clock of the positions that differs from it by a few seconds."""

from __future__ import annotations

import pytest

from das.advice.advice import Cause
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


# --- the clock of the positions ----------------------------------------------------------------------------------

SPEED_MPS = 30.0


def driven_with(off_s: float, seconds: int = 60, speed_mps: float = SPEED_MPS) -> DrivenNode:
    """A train whose time stamps are behind the clock by a time; true positions are heard as they are measured."""
    driven = DrivenNode()
    for second in range(1, seconds):
        stamp_ns = START_NS + round((second - off_s) * S)
        s_m = 200.0 + speed_mps * second
        driven.tell(
            POSITION, das_pb2.Position(time_ns=stamp_ns, s_m=s_m, speed_mps=speed_mps, speed_uncertainty_mps=0.2), "a"
        )
        driven.tell_time(second)
    return driven


@pytest.mark.parametrize("off_s", [2.8, -2.8])
def test_clocks_that_differ_by_much_withdraw_the_advice_and_say_so(off_s: float) -> None:
    """At 108 km/h, 2.8 s are 84 m; the limit was over 79 m early, with a stated deviation of 2 m."""
    driven = driven_with(off_s)
    advice = driven.last_advice()
    assert (advice.mode, advice.cause) == (das_pb2.MODE_NONE, Cause.POSITION_UNCERTAIN)
    assert "2.8 s" in driven.sink.events()


@pytest.mark.parametrize("off_s", [0.6, 1.2, -1.2])
def test_the_difference_is_part_of_the_stated_deviation(off_s: float) -> None:
    driven = driven_with(off_s, 40)
    advice = driven.last_advice()
    assert advice.mode != das_pb2.MODE_NONE
    true_m = 200.0 + SPEED_MPS * 39
    assert abs(advice.s_m - true_m) <= advice.position_sd_m
    assert advice.position_sd_m >= SPEED_MPS * abs(off_s)
    assert driven.sink.events().count("its time stamps") == 1


def test_clocks_that_agree_are_not_spoken_of() -> None:
    driven = driven_with(0.0, 40)
    assert "time stamps" not in driven.sink.events()
    assert driven.last_advice().position_sd_m < 9.0


def test_at_walking_pace_a_difference_of_clocks_is_no_reason_to_say_nothing() -> None:
    driven = driven_with(2.0, 40, speed_mps=2.0)
    assert driven.last_advice().mode != das_pb2.MODE_NONE
