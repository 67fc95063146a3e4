"""A human driver's attention: when he looks away and at the display, what he decides, and the chances behind it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from das.advice.regimes import Regime
from sim.drivers.cab import AdviceView, CabView, Diary
from sim.drivers.handling import HEEDING
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import presenter_of


class Chance:
    """The streams of random numbers of one driver.

    Every kind of chance has its own stream, so that changing one parameter does not reshuffle the others.
    """

    def __init__(self, seed: int, stream: int) -> None:
        streams = np.random.SeedSequence(seed, spawn_key=(stream,)).spawn(7)
        generators = [np.random.default_rng(one) for one in streams]
        self.reactions, self.choices, self.looks, self.lapses, self.marks, self.speed, self.force = generators


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


_KINDS: dict[int, str] = {
    Regime.FULL_TRACTION: "traction",
    Regime.REDUCED_TRACTION: "traction",
    Regime.CRUISE: "hold",
    Regime.COAST: "coast",
    Regime.REDUCED_BRAKE: "brake",
    Regime.FULL_BRAKE: "brake",
    Regime.FRICTION_BRAKE: "brake",
}
"""The kind of advice by its mode."""


def says_mode(view: AdviceView) -> bool:
    """Whether the advice says how to drive, and not at most a highest speed."""
    return presenter_of(view.presentation).says_mode


def advice_kind(view: AdviceView) -> str | None:
    """The kind of advice, to which a compliance belongs: traction, hold, coast or brake; None for no advice."""
    return _KINDS.get(_shown_mode(view))


def _shown_mode(view: AdviceView) -> int:
    """The mode that an advice asks for: without a mode (a highest speed, a deviation) it asks to hold another speed."""
    return view.mode if says_mode(view) else int(Regime.CRUISE)


class Lapses:
    """Times at which the driver's attention is away; lapses begin at random and the train's warning ends them."""

    def __init__(self, human: HumanParameters, chance: Chance, diary: Diary) -> None:
        self._human, self._random, self._diary = human, chance.lapses, diary
        self._next_s, self._awake_s = -math.inf, -math.inf

    def away(self, cab: CabView, allowed_mps: float) -> bool:
        """Whether attention is away now; `allowed_mps` is the highest speed he would drive at here."""
        human, now_s = self._human, cab.time_s
        if human.lapses_per_h <= 0:
            return False
        if not math.isfinite(self._next_s):
            self._next_s = now_s + self._until_next()
        if now_s >= self._next_s:
            length_s = human.lapse_mean_s * float(self._random.standard_exponential())
            self._diary.note(now_s, "lapse", length_s)
            self._awake_s = now_s + length_s
            self._next_s = self._awake_s + self._until_next()
        if cab.speed_mps > allowed_mps + human.below_limit_mps + HEEDING.warning_mps:
            self._awake_s = min(self._awake_s, now_s)
        return now_s < self._awake_s

    def _until_next(self) -> float:
        return 3600.0 / self._human.lapses_per_h * float(self._random.standard_exponential())


class Heeded(NamedTuple):
    """What the driver goes by: the advice that he saw last, and whether he follows it.

    `reached`: the train has come to the speed that it is advised to accelerate to.
    """

    view: AdviceView | None = None
    follows: bool = False
    reached: bool = False

    @property
    def task(self) -> int | None:
        """What he is at: the mode of the advice that he follows, None if he drives by himself."""
        return self.view.mode if self.by_effort and self.view is not None else None

    @property
    def by_effort(self) -> bool:
        """Whether he follows advice that says more than a highest speed."""
        return self.follows and self.view is not None and says_mode(self.view)


class Announced(NamedTuple):
    """The change that the display announced last: the mode, and when it is due (s on the cab's clock)."""

    mode: int = Regime.NONE
    due_s: float = math.inf


class DisplayReading:
    """Glances at the display, decides on new advice, and takes the decision up after a reaction."""

    def __init__(self, human: HumanParameters, chance: Chance, times: ReactionTimes, diary: Diary) -> None:
        self._human, self._chance, self._times, self._diary = human, chance, times, diary
        self._glance_s, self._act_s = -math.inf, math.inf
        self._seen: AdviceView | None = None
        self._judged: tuple[object, ...] | None = None
        self._pending: bool | None = None
        self._noticed = 0
        self._announced = Announced()
        self.heeded = Heeded()
        """What he goes by now."""

    def reach(self) -> None:
        """The speed that he is advised to accelerate to is reached; he holds it until something else is advised."""
        self.heeded = self.heeded._replace(reached=True)

    def depart(self, cab: CabView) -> None:
        """The train is set in motion: what was advised up to the stop is over, and he looks at the display anew.

        He has waited for the order to depart and has had his reaction time, so that he goes by what he sees at once.
        """
        self.heeded, self._judged, self._pending = Heeded(), None, None
        self._glance(cab)
        if self._pending is not None:
            self._act_s = cab.time_s
            self.look(cab)

    def look(self, cab: CabView) -> None:
        """Glance at the display if it is time to, and take up a decision if its reaction time is over."""
        if cab.time_s >= self._glance_s:
            self._glance(cab)
        if self._pending is not None and cab.time_s >= self._act_s:
            self._diary.note(self._act_s, "acted", float(self._pending))
            self.heeded = self.heeded._replace(view=self._seen, follows=self._pending)
            self._pending = None

    def _glance(self, cab: CabView) -> None:
        """Look at the display, and judge what is new on it."""
        human, now_s = self._human, cab.time_s
        beyond_s = max(human.glance_mean_s - human.glance_least_s, 0.0)
        self._glance_s = now_s + human.glance_least_s + beyond_s * float(self._chance.looks.standard_exponential())
        self._seen = view = cab.shown
        self._diary.note(now_s, "glance", 0 if view is None else view.mode)
        read = None if view is None else view.departure  # He drives, so that he is cleared.
        item = None if read is None else (read.presentation, *presenter_of(read.presentation).item(read))
        if item != self._judged:
            self._judged = item
            self.heeded = self.heeded._replace(reached=False)
            self._judge(read, now_s)
        self._expect(view, now_s)
        if self._pending is None:
            self.heeded = self.heeded._replace(view=view)

    def _expect(self, view: AdviceView | None, now_s: float) -> None:
        """Remember the next change that the display announces, and look again when it is due."""
        if view is None or view.next_mode == Regime.NONE or not math.isfinite(view.next_change_s):
            return
        self._announced = Announced(view.next_mode, view.time_s + view.next_change_s)
        if self._announced.due_s >= now_s + self._human.glance_least_s:
            self._glance_s = min(self._glance_s, self._announced.due_s)

    def _reaction_s(self, mode: int, now_s: float) -> float:
        """How long the reaction takes: shorter to a change that was announced."""
        expected = mode == self._announced.mode and abs(now_s - self._announced.due_s) <= HEEDING.expected_within_s
        return self._times.draw(now_s, of_itself=self._human.expected_ratio if expected else 1.0)

    def _judge(self, view: AdviceView | None, now_s: float) -> None:
        """Decide on new advice, and when to act on it; advice that has gone is given up after a reaction as well."""
        kind = None if view is None else advice_kind(view)
        if self._pending is not None:
            self._diary.note(now_s, "changed", self._noticed)
        self._noticed = 0 if view is None or kind is None else _shown_mode(view)
        self._diary.note(now_s, "noticed", self._noticed)
        if view is None or kind is None:
            self._pending = False
            self._act_s = now_s + self._reaction_s(Regime.NONE, now_s) if self.heeded.follows else now_s
            return
        follow = bool(self._chance.choices.random() < self._followed_ratio(view, kind))
        self._diary.note(now_s, "followed" if follow else "refused", self._noticed)
        self._pending, self._act_s = follow, now_s + self._reaction_s(self._noticed, now_s)

    def _followed_ratio(self, view: AdviceView, kind: str) -> float:
        """How likely he is to follow advice of a kind: with a reason beside it, he may refuse less of it."""
        human = self._human
        followed = float(getattr(human, f"comply_{kind}_ratio"))
        if not view.reason or human.reason_refusal_ratio == 1.0:
            return followed
        return 1.0 - human.reason_refusal_ratio * (1.0 - followed)
