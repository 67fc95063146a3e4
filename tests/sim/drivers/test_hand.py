"""The hand on the controller: it waits to see what a small change does, and does not wait for what matters."""

from __future__ import annotations

import pytest

from sim.drivers.cab import Diary
from sim.drivers.handling import HAND, Hand
from sim.drivers.parameters import HumanParameters

LOOK_S = 0.2


class Moved:
    """A hand that is asked for settings, look by look."""

    def __init__(self) -> None:
        self.hand, self.now_s = Hand(HumanParameters(), Diary()), 0.0

    def ask(self, wanted: float, for_s: float, *, task: object = None, urgent: bool = False) -> float:
        for _ in range(round(for_s / LOOK_S)):
            self.now_s += LOOK_S
            self.hand.move(wanted, self.now_s, LOOK_S, task=task, urgent=urgent)
        return self.hand.setting


def test_a_small_change_waits_for_the_effect_of_the_one_before() -> None:
    moved = Moved()
    assert moved.ask(0.2, 1.0) == pytest.approx(0.2)
    assert moved.ask(0.1, HAND.waits_s - 1.0) == pytest.approx(0.2)
    assert moved.ask(0.1, 2.0) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("wanted", "task", "urgent"),
    [(0.55, None, False), (1.0, None, False), (0.1, "other advice", False), (0.1, None, True)],
)
def test_a_large_change_another_task_and_what_is_urgent_do_not_wait(wanted: float, task: object, urgent: bool) -> None:
    moved = Moved()
    moved.ask(0.2, 1.0)
    assert moved.ask(wanted, 3.0, task=task, urgent=urgent) == pytest.approx(wanted)


def test_effort_that_has_lasted_is_given_up_at_once() -> None:
    """A brake of two settings, 5 s in all: the second one has just been made."""
    moved = Moved()
    assert moved.ask(-0.1, 1.0) == pytest.approx(-0.1)
    moved.ask(-0.2, HAND.waits_s + 0.4)
    assert moved.hand.setting == pytest.approx(-0.2)
    assert moved.ask(0.0, 1.0) == pytest.approx(0.0)


def test_a_movement_that_has_begun_is_finished() -> None:
    """At 0.4 of the scale a second, 0.25 takes four looks, each of them a small change."""
    moved = Moved()
    assert moved.ask(0.25, 0.8) == pytest.approx(0.25)
