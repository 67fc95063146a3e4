"""Four drivers with one weakness each, as examples of own drivers: `das-sim run … --driver sim.drivers.examples:Lazy`.

They share no code with the bundled human driver. `Attentive` has no weakness; the others change what he knows of the
display (`heeded`) or what his hand makes of it (`set`). How much advice is worth to
them: docs/explanation/guide-figures.md.
"""

from __future__ import annotations

import math
from random import Random

from sim.drivers.cab import AdviceView, CabView
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.presentations.presenter import presenter_of
from sim.drivers.skills import Late, NotchedLever, Skills
from sim.plant.kernels import Command
from sim.plant.plant import lever

BY_EYE_M = 100.0
"""Distance (m) before a stop from which they drive by eye."""
LATE_S = 3.0
"""Lateness (s) of one of them."""


class Attentive:
    """Does what the display says at once, within the limits and stops that he sees himself.

    Where the display does not say how to drive, he holds the top speed that keeps time, and rolls down to a lower one.
    """

    def __init__(self, line: LineKnowledge) -> None:
        self.skills = Skills(line)

    def command(self, cab: CabView) -> Command:
        """The controller's setting for the next 0.2 s."""
        skills, view = self.skills.see(cab), self.heeded(cab)
        if skills.cab.shall_stand:
            return lever(self.set(0.0, 0.0))
        wanted = None if view is None or skills.halt_in_m < BY_EYE_M else skills.advised(view)
        if wanted is None:  # He never brakes for a top speed of his own.
            wanted = max(skills.hold(skills.timely_mps()), 0.0)
        return lever(self.set(wanted, skills.most()))

    def heeded(self, cab: CabView) -> AdviceView | None:
        """The advice that he follows now; None if he drives as without advice."""
        return cab.shown and cab.shown.departure

    def set(self, wanted: float, most: float) -> float:
        """What he sets the controller to (−1 … 1) if he wants one setting, and limits and stops allow another."""
        return min(wanted, most)


class Lazy(Attentive):
    """Has five notches each way, moves by no less than a whole one, and looks at the display every 20 s.

    He stands for a driver who does not play along. He remembers what he has read, and looks all the time at a stand.
    """

    def __init__(self, line: LineKnowledge) -> None:
        super().__init__(line)
        self.view: AdviceView | None = None
        self.looks_s, self.notches = -math.inf, NotchedLever(5)

    def heeded(self, cab: CabView) -> AdviceView | None:
        """What the display said when he last looked."""
        if cab.time_s >= self.looks_s or cab.speed_mps <= 0:
            self.view, self.looks_s = super().heeded(cab), cab.time_s + 20.0
        return self.view

    def set(self, wanted: float, most: float) -> float:
        """The notch nearest to what he wants; for limits and stops the next lower one."""
        return self.notches.set(wanted, most)


class Doubting(Attentive):
    """Ignores a third of the advice: each time that it changes, he decides whether to follow it until it changes again.

    He stands for a driver who knows better. What he ignores is drawn by the day's seed.
    """

    def __init__(self, line: LineKnowledge, seed: int = 0) -> None:
        super().__init__(line)
        self.random, self.ignores = Random(seed), False
        self.item: tuple[int, ...] | None = None

    def heeded(self, cab: CabView) -> AdviceView | None:
        """The advice, unless he has decided to ignore it."""
        view = super().heeded(cab)
        item = None if view is None else presenter_of(view.presentation).item(view)
        if item != self.item:
            self.item, self.ignores = item, self.random.random() < 1.0 / 3.0
        return None if self.ignores else view


class WeakBraking(Attentive):
    """Brakes 20 % more weakly than he is asked to, and than he means to for limits and stops.

    He stands for a driver who spares the brakes, and for a train whose brakes are weaker than the plan says.
    """

    def set(self, wanted: float, most: float) -> float:
        """Four fifths of any braking effort."""
        setting = super().set(wanted, most)
        return setting if setting > 0 else 0.8 * setting


class Belated(Attentive):
    """Does what the display said 3 s ago, and for 3 s moves the controller a quarter too far.

    He stands for a driver who reacts slowly and then hurries. Limits, stops and his speedometer he sees in time.
    """

    def __init__(self, line: LineKnowledge) -> None:
        super().__init__(line)
        self.views: Late[AdviceView | None] = Late(LATE_S, None)
        self.wanted = Late(LATE_S, 0.0)

    def heeded(self, cab: CabView) -> AdviceView | None:
        """What the display said 3 s ago."""
        return self.views.seen(super().heeded(cab))

    def set(self, wanted: float, most: float) -> float:
        """What he wants, and a quarter of how it differs from what he wanted 3 s ago."""
        return min(max(wanted + 0.25 * (wanted - self.wanted.seen(wanted)), -1.0), most)
