"""When an instruction that is wanted takes the place of the one shown."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from das.advice.advice import Instruction
from das.advice.goal import TrainState
from das.advice.guide.guard import Proposal
from das.advice.guide.memory import Lead, Memory, brake, coast, hold, traction
from das.advice.guide.showing import LEADS_S, Opening, has_led, opening
from das.advice.regimes import InstructionKind
from das.solver.kernels.guide_policy import STANDS_S
from tests.support.keeping import ns

HOLD, UP, ROLL, SLOW = hold(25.0), traction(0.8, 30.0), coast(20.0), brake(0.6, 15.0)


def shown(one: Instruction, *, for_s: float = 60.0, announced: Instruction | None = None) -> Memory:
    """The memory at second 100 of an instruction that has stood for a time; `announced`: a change, for long."""
    memory = Memory(shown=one, since_ns=ns(100.0 - for_s))
    if announced is not None:
        for second in range(88, 101):
            told = replace(announced, in_s=100.0 - second)
            memory = replace(memory, announced=memory.noted((told,), ns(second)))
    return memory


def opens(memory: Memory, one: Instruction, **more: object) -> Opening:
    """Whether the gate opens for an instruction at second 100, for a train with 25 m/s."""
    asked: dict[str, object] = {
        "is_safe": True,
        "next_s": math.inf,
        "in_s": 0.0,
        "mode": Lead.FOLLOW,
        "v_mps": 25.0,
    }
    asked |= more
    wanted = Proposal(one, float(asked["in_s"]), asked["mode"])  # type: ignore[arg-type]
    return opening(
        memory, wanted, TrainState(ns(100.0), 1000.0, float(asked["v_mps"])), is_safe=bool(asked["is_safe"]),  # type: ignore[arg-type]
        next_s=float(asked["next_s"]),  # type: ignore[arg-type]
    )  # fmt: skip


@pytest.mark.parametrize("one", [UP, ROLL, SLOW])
def test_a_change_that_was_not_announced_waits_8_s(one: Instruction) -> None:
    assert opens(shown(HOLD), one) == Opening(False, STANDS_S)


def test_a_brake_that_limits_ask_for_does_not_wait_for_its_notice() -> None:
    state, brakes = TrainState(ns(100.0), 1000.0, 25.0), Proposal(SLOW, 2.0, waits=False)
    found = opening(shown(HOLD), brakes, state, is_safe=True, next_s=math.inf)
    assert found == Opening(True, 2.0)


@pytest.mark.parametrize("one", [UP, ROLL, SLOW])
def test_a_change_that_was_announced_comes(one: Instruction) -> None:
    assert opens(shown(HOLD, announced=one), one) == Opening(True, 0.0)


def test_what_is_shown_stands_8_s_unless_a_brake_comes() -> None:
    for one in (UP, ROLL):
        assert opens(shown(HOLD, for_s=3.0, announced=one), one) == Opening(False, STANDS_S - 3.0)
        assert opens(shown(HOLD, for_s=STANDS_S, announced=one), one).now
    assert opens(shown(HOLD, for_s=3.0, announced=SLOW), SLOW).now


@pytest.mark.parametrize(("one", "kind"), [(UP, InstructionKind.TRACTION), (ROLL, InstructionKind.COAST)])
def test_a_change_is_shown_its_lead_before_it_is_due(one: Instruction, kind: InstructionKind) -> None:
    announced = shown(HOLD, announced=replace(one))
    assert opens(announced, one, in_s=LEADS_S[kind]).now
    assert not opens(announced, one, in_s=LEADS_S[kind] + 0.5).now


def test_a_brake_back_to_a_speed_has_its_lead() -> None:
    found = opens(shown(HOLD, announced=SLOW), SLOW, mode=Lead.BACK_DOWN)
    assert found == Opening(True, LEADS_S[InstructionKind.BRAKE])


def test_what_is_not_safe_any_more_does_not_stand() -> None:
    assert opens(shown(UP, for_s=1.0), SLOW, is_safe=False).now
    assert opens(Memory(), UP).now, "nor does nothing"


def test_the_hold_of_the_speed_that_was_led_to_needs_no_notice() -> None:
    assert opens(shown(UP), hold(30.0)) == Opening(True, 0.0)
    assert opens(shown(UP, for_s=5.0), hold(30.0)) == Opening(False, 3.0)
    assert not opens(shown(UP), HOLD).now
    assert opens(shown(SLOW, for_s=2.0), hold(15.0), v_mps=15.2).now, "a brake is released at once"


def test_what_would_stand_less_than_8_s_is_not_shown_nor_announced() -> None:
    assert opens(shown(UP), hold(30.0), next_s=7.0) == Opening(False, math.inf)
    assert opens(shown(HOLD), ROLL, next_s=12.0) == Opening(False, math.inf), "it is due in 8 s, for 4 s"
    for one in (SLOW, UP):
        assert opens(shown(HOLD, announced=one), one, next_s=4.0).now, "a brake is, and an acceleration"


def test_more_braking_comes_at_once_and_less_when_the_effort_has_stood() -> None:
    for effort, lasts_s, comes in ((0.9, 1.0, True), (0.3, 1.0, False), (0.3, STANDS_S, True)):
        assert opens(shown(SLOW, for_s=lasts_s), brake(effort, 15.0)).now is comes
    assert opens(shown(SLOW, for_s=1.0), brake(0.6, 10.0)) == Opening(True, 0.0), "to a lower speed: no release between"
    assert not opens(shown(SLOW, for_s=1.0), brake(0.5, 20.0)).now


def test_a_brake_that_is_not_done_is_not_released_without_notice() -> None:
    assert opens(shown(SLOW), HOLD, v_mps=18.0) == Opening(False, STANDS_S)


@pytest.mark.parametrize(
    ("before", "one", "v_mps", "led"),
    [
        (SLOW, UP, 15.2, True), (SLOW, UP, 16.0, False), (SLOW, hold(15.0), 15.0, False), (SLOW, SLOW, 15.0, False),
        (ROLL, HOLD, 20.0, True), (ROLL, HOLD, 22.0, False), (ROLL, HOLD, 18.0, False),
        (ROLL, hold(20.0), 20.0, False), (ROLL, UP, 20.0, False),
    ],
)  # fmt: skip
def test_a_brake_or_coasting_has_led_to_its_speed(
    before: Instruction, one: Instruction, v_mps: float, led: bool
) -> None:
    assert has_led(shown(before), one, TrainState(ns(100.0), 1000.0, v_mps)) is led
