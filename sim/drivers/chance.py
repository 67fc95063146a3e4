"""What is random about a human driver: one stream of random numbers for each kind of chance, and slow errors."""

from __future__ import annotations

import math

import numpy as np

from sim.drivers.diary import Diary
from sim.drivers.parameters import HumanParameters


class Chance:
    """The streams of random numbers of one driver.

    Every kind of chance has its own stream, so that changing one parameter does not reshuffle the others.
    """

    def __init__(self, seed: int, stream: int) -> None:
        streams = np.random.SeedSequence(seed, spawn_key=(stream,)).spawn(7)
        generators = [np.random.default_rng(one) for one in streams]
        self.reactions, self.choices, self.looks, self.lapses, self.marks, self.speed, self.force = generators


class Wander:
    """An Ornstein–Uhlenbeck process with standard deviation 1 and a correlation time (s)."""

    def __init__(self, correlation_s: float, random: np.random.Generator) -> None:
        self._correlation_s, self._random = correlation_s, random
        self.value = float(random.standard_normal())

    def over(self, span_s: float) -> None:
        """Let a time pass; the step is exact for any length."""
        keep = math.exp(-span_s / self._correlation_s)
        self.value = keep * self.value + math.sqrt(1.0 - keep * keep) * float(self._random.standard_normal())


class Errors:
    """How far a driver's speed and effort are off what he means, wandering slowly."""

    def __init__(self, human: HumanParameters, chance: Chance) -> None:
        self._human = human
        self._speed, self._force = Wander(human.speed_error_s, chance.speed), Wander(human.force_error_s, chance.force)

    def over(self, span_s: float) -> None:
        """Let a time pass."""
        self._speed.over(span_s)
        self._force.over(span_s)

    @property
    def speed_mps(self) -> float:
        """By how much the speed that he drives at is above the one that he means."""
        return self._human.speed_error_mps * self._speed.value

    @property
    def force_ratio(self) -> float:
        """What an effort that he sets is of the one that he means (1: exactly it; never below 0)."""
        return max(1.0 + self._human.force_error_ratio * self._force.value, 0.0)


class ReactionTimes:
    """A driver's reaction times, drawn from a lognormal distribution and noted in his diary."""

    def __init__(self, human: HumanParameters, chance: Chance, diary: Diary) -> None:
        self._human, self._random, self._diary = human, chance.reactions, diary

    def draw(self, now_s: float, *, of_itself: float = 1.0) -> float:
        """How long (s) the next reaction takes; to something that was announced it is a share `of_itself`."""
        human = self._human
        normal = float(self._random.standard_normal())
        reaction_s = human.reaction_median_s * math.exp(human.reaction_log_sd * normal)
        if of_itself < 1.0:
            self._diary.note(now_s, "expected", of_itself)
            reaction_s *= of_itself
        self._diary.note(now_s, "reaction", reaction_s)
        return reaction_s
