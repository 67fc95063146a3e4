"""The driver's hand on the controller: how fast, and in what steps, a setting is reached."""

from __future__ import annotations

import math

from sim.drivers.diary import Diary
from sim.drivers.human_settings import HAND
from sim.drivers.parameters import HumanParameters


class Hand:
    """The setting of the controller (−1 … 1), moved as fast as a hand moves it.

    A driver who has set the controller waits to see what comes of it: small changes are made again only after a while,
    unless they are urgent or he has something else to do (another `task`). Traction or brakes are given up without a
    wait if they have lasted that long.
    """

    def __init__(self, human: HumanParameters, diary: Diary) -> None:
        self._human, self._diary = human, diary
        self.setting = 0.0
        self._moving, self._notched_s, self._left_s, self._begun_s = False, -math.inf, -math.inf, -math.inf
        self._task: object = None

    @property
    def reach_s(self) -> float:
        """The time (s) it takes to get the controller back from traction."""
        human = self._human
        full_s = human.notches * human.notch_s if human.notches else 1.0 / human.lever_rate_per_s
        return max(self.setting, 0.0) * full_s

    def release(self) -> None:
        """Put the controller to 0 at once: the train stands."""
        self.setting, self._left_s, self._begun_s = 0.0, -math.inf, -math.inf

    def move(self, wanted: float, now_s: float, span_s: float, *, task: object = None, urgent: bool = False) -> None:
        """Move the controller towards a setting for a time (s)."""
        before = self.setting
        small = abs(wanted - before) < HAND.waits_ratio and abs(wanted) < 1.0 and not self._moving
        since_s = self._begun_s if wanted * before <= 0 else self._left_s
        if small and now_s < since_s + HAND.waits_s and task == self._task and not urgent:
            return
        self._task = task
        self.setting = self._by_notches(wanted, now_s) if self._human.notches else self._by_percent(wanted, span_s)
        moved = self.setting != before
        if moved and not self._moving:
            self._diary.note(now_s, "lever", wanted)
        self._moving = moved and self.setting != wanted
        self._left_s = now_s if moved else self._left_s
        self._begun_s = now_s if moved and before * self.setting <= 0 else self._begun_s

    def _by_notches(self, wanted: float, now_s: float) -> float:
        """One notch at a time; each takes its time."""
        human = self._human
        notch, aim = round(self.setting * human.notches), round(wanted * human.notches)
        if aim != notch and now_s - self._notched_s >= human.notch_s:
            self._notched_s = now_s
            notch += 1 if aim > notch else -1
        return notch / human.notches

    def _by_percent(self, wanted: float, span_s: float) -> float:
        """Any setting, at the hand's rate; small changes are left undone."""
        human, before = self._human, self.setting
        small = abs(wanted - before) < human.lever_least_ratio and abs(wanted) not in (0.0, 1.0)
        if small and not self._moving:
            return before
        step = min(abs(wanted - before), human.lever_rate_per_s * span_s)
        return wanted if step == abs(wanted - before) else before + math.copysign(step, wanted - before)
