"""A localisation whose clock differs from the node's by less than what makes its positions stale."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest

from das.advice.cause import Cause
from das.bus import das_pb2
from das.bus.topics import POSITION
from das.estimate.clocks import ClockDifference
from das.estimate.localisation_settings import DEFAULT
from tests.support.driven_node import START_NS, DrivenNode, S

SPEED_MPS = 30.0


def driven_with(off_s: float, seconds: int = 60, speed_mps: float = SPEED_MPS) -> DrivenNode:
    """A train whose time stamps are behind the clock by a time; true positions are heard as they are measured."""
    driven = DrivenNode()
    for second in range(1, seconds):
        stamp_ns = START_NS + round((second - off_s) * S)
        s_m = 200.0 + speed_mps * second
        driven.tell(POSITION, das_pb2.Position(time_ns=stamp_ns, s_m=s_m, speed_mps=speed_mps), "a")
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


def test_single_messages_that_were_held_up_do_not_count() -> None:
    clock = ClockDifference(DEFAULT.clock)
    for second in range(1, 20):
        held_up_s = 2.5 if second % 5 == 0 else 0.02
        clock.hear(START_NS + second * S, START_NS + round((second + held_up_s) * S))
        clock.tick(START_NS + round((second + held_up_s) * S) + 1)
    assert clock.seconds == pytest.approx(0.02)


def test_a_clock_that_stands_still_between_ticks_is_no_difference() -> None:
    """A simulation hears the positions of a second by the clock of the second before."""
    clock = ClockDifference(DEFAULT.clock)
    for second in range(1, 20):
        clock.hear(START_NS + second * S, START_NS + (second - 1) * S)
        clock.tick(START_NS + second * S)
        assert clock.seconds == 0.0


def found_with(**settings: float) -> list[float]:
    """The differences found on a run with late messages, others that are held up, and a gap."""
    clock, found = ClockDifference(replace(DEFAULT.clock, **settings)), []
    for second in [*range(1, 80), *range(130, 150)]:
        late_s = 0.1 + 0.01 * second + (25.0 if 20 <= second < 32 else 0.0)
        clock.hear(START_NS + second * S, START_NS + round((second + late_s) * S))
        clock.tick(START_NS + round((second + late_s) * S) + 1)
        found.append(clock.seconds)
    return found


@pytest.mark.parametrize("name", [field.name for field in fields(DEFAULT.clock)])
def test_every_setting_of_the_clock_is_used(name: str) -> None:
    usual = getattr(DEFAULT.clock, name)
    assert any(found_with(**{name: type(usual)(usual * by + 0.5)}) != found_with() for by in (0.1, 10.0))
