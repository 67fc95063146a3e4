"""Four drivers with one weakness each: `das-sim run … --driver docs.examples.weak_drivers:Lazy`.

They share no code with the bundled human driver. `Attentive` has no weakness; the others change the advice that is
perceived (`heeded`) or the setting that results (`set`). Their savings by advice: docs/explanation/guide-figures.md.
"""

from __future__ import annotations

import math
from collections import deque
from random import Random
from typing import Generic, TypeVar

from sim.drivers.cab import AdviceView, CabView
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.presentations.presenter import presenter_of
from sim.drivers.skills import NotchedLever, Skills
from sim.plant.kernels import Command
from sim.plant.plant import lever

BY_EYE_M = 100.0
"""Distance (m) before a stop from which the drivers here drive by eye."""
LATE_S = 3.0
"""Delay (s) of `Belated`."""
LOOK_S = 0.2
"""Interval (s) between two settings of a driver."""
_Seen = TypeVar("_Seen")


class Late(Generic[_Seen]):
    """A delay line: `seen` receives the view at each look, and returns the delayed one."""

    def __init__(self, late_s: float, before: _Seen) -> None:
        looks = round(late_s / LOOK_S)
        self._seen: deque[_Seen] = deque([before] * looks, looks + 1)

    def seen(self, now: _Seen) -> _Seen:
        """The view of that time ago."""
        self._seen.append(now)
        return self._seen[0]


class Attentive:
    """Follows the display immediately, within the limits and stops that the driver sees. If the display does not show
    how to drive, this driver holds the top speed that keeps time, and rolls down to a lower one.
    """

    def __init__(self, line: LineKnowledge) -> None:
        self.skills = Skills(line)

    def command(self, cab: CabView) -> Command:
        """The controller's setting for the next 0.2 s."""
        skills, view = self.skills.see(cab), self.heeded(cab)
        if skills.cab.shall_stand:
            return lever(self.set(0.0, 0.0))
        wanted = None if view is None or skills.halt_in_m < BY_EYE_M else skills.advised(view)
        if wanted is None:  # No braking for an estimated top speed.
            wanted = max(skills.hold(skills.timely_mps()), 0.0)
        return lever(self.set(wanted, skills.most()))

    def heeded(self, cab: CabView) -> AdviceView | None:
        """The advice followed now; None to drive as without advice."""
        return cab.shown and cab.shown.departure

    def set(self, wanted: float, most: float) -> float:
        """The controller setting (−1 … 1) from the wanted one and the highest one that limits and stops allow."""
        return min(wanted, most)


class Lazy(Attentive):
    """Has five notches in each direction, and looks at the display every 20 s. Represents a driver who cooperates
    little. The driver remembers the last display, and watches it continuously at a standstill.
    """

    def __init__(self, line: LineKnowledge) -> None:
        super().__init__(line)
        self.view: AdviceView | None = None
        self.looks_s, self.notches = -math.inf, NotchedLever(5)

    def heeded(self, cab: CabView) -> AdviceView | None:
        """The display at the last look."""
        if cab.time_s >= self.looks_s or cab.speed_mps <= 0:
            self.view, self.looks_s = super().heeded(cab), cab.time_s + 20.0
        return self.view

    def set(self, wanted: float, most: float) -> float:
        """The notch nearest to the wanted setting; for limits and stops the next lower one."""
        return self.notches.set(wanted, most)


class Doubting(Attentive):
    """Ignores a third of the advice: at each change the driver decides whether to follow it until the next change.
    Represents a driver who knows better. The decisions are drawn with the seed of the run.
    """

    def __init__(self, line: LineKnowledge, seed: int = 0) -> None:
        super().__init__(line)
        self.random, self.ignores = Random(seed), False
        self.item: tuple[int, ...] | None = None

    def heeded(self, cab: CabView) -> AdviceView | None:
        """The advice, unless it is ignored."""
        view = super().heeded(cab)
        item = None if view is None else presenter_of(view.presentation).item(view)
        if item != self.item:
            self.item, self.ignores = item, self.random.random() < 1.0 / 3.0
        return None if self.ignores else view


class WeakBraking(Attentive):
    """Brakes 20 % less than advised, and less than intended for limits and stops. Represents a driver who spares the
    brakes, and a train whose brakes are weaker than planned.
    """

    def set(self, wanted: float, most: float) -> float:
        """Four fifths of any braking effort."""
        setting = super().set(wanted, most)
        return setting if setting > 0 else 0.8 * setting


class Belated(Attentive):
    """Follows the display of 3 s ago, and for 3 s moves the controller a quarter too far. Represents a driver who
    reacts slowly and then overcorrects. Limits, stops and the speedometer are seen without delay.
    """

    def __init__(self, line: LineKnowledge) -> None:
        super().__init__(line)
        self.views: Late[AdviceView | None] = Late(LATE_S, None)
        self.wanted = Late(LATE_S, 0.0)

    def heeded(self, cab: CabView) -> AdviceView | None:
        """The display of 3 s ago."""
        return self.views.seen(super().heeded(cab))

    def set(self, wanted: float, most: float) -> float:
        """The wanted setting, plus a quarter of its difference from the one wanted 3 s ago."""
        return min(max(wanted + 0.25 * (wanted - self.wanted.seen(wanted)), -1.0), most)
