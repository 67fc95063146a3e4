"""The node's own clock, which somebody sets, and a clock of the positions that differs from it by a few seconds."""

from __future__ import annotations

import pytest

from das.advice.advice import Cause
from das.bus import das_pb2
from das.bus.topics import ADVICE, EVENT, JOURNEY, POSITION, RESTRICTION
from das.domain.clocks import Clocks
from das.domain.units import NS
from das.node.command import AdviceGiven
from das.node.node import BusClock, Node, WallClock
from das.node.process import run
from tests.support.driven_node import START_NS, DrivenNode, S, Sink, journey, make_node


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


# --- when it advises ---------------------------------------------------------------------------------------------


class QuietBus(Sink):
    """A bus on which nothing comes: time passes while the node listens. It is stopped after a time."""

    def __init__(self, time: Time, ends_s: float) -> None:
        super().__init__()
        self.time, self.ends_s = time, ends_s

    def receive(self, wait_s: float, *, skip_outdated: bool) -> None:
        """Nothing, after the whole time and a little more, as on a machine with other work."""
        assert skip_outdated
        self.time.passed_ns += round((wait_s + 0.003) * S)

    @property
    def stopped(self) -> bool:
        return self.time.passed_ns >= self.ends_s * S


@pytest.mark.parametrize(("rate_hz", "count"), [(AdviceGiven.rate, 10), (0.5, 5), (5.0, 50)])
def test_a_node_advises_once_a_period_by_its_own_clock(rate_hz: float, count: int) -> None:
    """Once a second without the option --rate; each interval counts, and no delay adds up."""
    time = Time()
    bus = QuietBus(time, 10.05)
    cab = make_node(bus).cab
    node = Node(bus, cab, WallClock(time.clocks))  # type: ignore[arg-type]
    run(node, bus, 1.0 / rate_hz, time.clocks.seconds)  # type: ignore[arg-type]
    advised_s = [(advice.time_ns - START_NS) * NS for advice in bus.of(ADVICE)]
    assert advised_s == pytest.approx([(number + 1) / rate_hz for number in range(count)], abs=0.01)
    assert AdviceGiven.rate == 1.0


# --- the clock of the positions ----------------------------------------------------------------------------------

SPEED_MPS = 30.0


def driven_with(off_s: float, seconds: int = 60, speed_mps: float = SPEED_MPS) -> DrivenNode:
    """A train whose time stamps are behind the clock by a time; true positions are heard as they are measured."""
    driven = DrivenNode(stood=False)
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


@pytest.mark.parametrize("off_s", [0.6, 1.1, -1.1])
def test_the_difference_is_part_of_the_stated_deviation(off_s: float) -> None:
    driven = driven_with(off_s, 40)
    advice = driven.last_advice()
    assert advice.mode != das_pb2.MODE_NONE
    true_m = 200.0 + SPEED_MPS * 39
    assert abs(advice.s_m - true_m) <= advice.position_sd_m
    assert advice.position_sd_m >= SPEED_MPS * abs(off_s)
    assert driven.sink.events().count("position: time stamps") == 1


def test_clocks_that_agree_are_not_spoken_of() -> None:
    driven = driven_with(0.0, 40)
    assert "time stamps" not in driven.sink.events()
    assert driven.last_advice().position_sd_m < 11.0


def test_at_walking_pace_a_difference_of_clocks_is_no_reason_to_say_nothing() -> None:
    driven = driven_with(2.0, 40, speed_mps=2.0)
    assert driven.last_advice().mode != das_pb2.MODE_NONE
