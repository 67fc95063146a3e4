"""Four drivers with one weakness each, as examples of own drivers: `das-sim run … --driver sim.drivers.examples:Lazy`.

They share no code with the bundled human driver. `Attentive` has no weakness; the others change what he knows of the
display (`heeded`) or what his hand makes of it (`set`). How much advice is worth to them: docs/explanation/coach.md.
"""

from __future__ import annotations

import math
from collections import deque
from random import Random
from typing import Final

from das.advice.regimes import BRAKES, TRACTION, Regime
from das.domain.units import KMH
from sim.drivers.cab import AdviceView, CabView, Efforts
from sim.drivers.knowledge import Foresight, Habit, LineKnowledge, Outlook
from sim.drivers.presentations.presenter import SpeedIs, presenter_of
from sim.drivers.tracking import RULE, TimeRule, hold, stop_at, under_ceiling
from sim.plant.kernels import Command, demanded
from sim.plant.plant import lever

BRAKING_MPS2: Final = 0.5
"""All of them brake with this deceleration (m/s²) for limits and stops."""
HABIT: Final = Habit(braking_mps2=BRAKING_MPS2, below_mps=2.0 * KMH)
BEFORE_SIGNAL_M: Final = 15.0
"""They stop this far (m) before a signal at danger."""
BY_EYE_M: Final = 100.0
"""They drive the last metres before a stop by eye."""
CALM_PER_S: Final = 0.1
"""They correct this share of a speed error per second."""
LATE_LOOKS: Final = 15
"""Looks (0.2 s each) by which one of them is late."""
DRIVING: Final = TRACTION | BRAKES | {Regime.CRUISE, Regime.COAST}


class Attentive:
    """Does what the display says at once, within the limits and stops that he sees himself.

    Where the display does not say how to drive, he holds the top speed that keeps time, and rolls down to a lower one.
    """

    def __init__(self, line: LineKnowledge) -> None:
        self.foresight, self.rule = Foresight(line, HABIT), TimeRule(RULE.judged_every_s)

    def command(self, cab: CabView) -> Command:
        """The controller's setting for the next 0.2 s."""
        cab = cab._replace(signal_m=cab.signal_m - BEFORE_SIGNAL_M)
        outlook, view = self.foresight.outlook(cab), self.heeded(cab)
        if cab.shall_stand:
            return lever(self.set(0.0, 0.0))
        wanted = None if view is None or cab.halt_m - cab.s_m < BY_EYE_M else _advised(cab, outlook, view)
        if wanted is None:  # He never brakes for a top speed of his own.
            wanted = max(_held(cab, outlook, self.rule.cap_mps(cab, outlook)), 0.0)
        most = under_ceiling(cab, outlook, RULE.anticipation_s)
        most = stop_at(cab, outlook, cab.halt_m, BRAKING_MPS2) or most
        return lever(self.set(wanted, _ratio(most, cab, outlook)))

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
        self.looks_s, self.notch = -math.inf, 0

    def heeded(self, cab: CabView) -> AdviceView | None:
        """What the display said when he last looked."""
        if cab.time_s >= self.looks_s or cab.speed_mps <= 0:
            self.view, self.looks_s = super().heeded(cab), cab.time_s + 20.0
        return self.view

    def set(self, wanted: float, most: float) -> float:
        """The notch nearest to what he wants; for limits and stops the next lower one."""
        if abs(5.0 * wanted - self.notch) >= 1.0:
            self.notch = round(5.0 * wanted)
        self.notch = min(self.notch, math.floor(5.0 * most))
        return self.notch / 5.0


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
        self.views: deque[AdviceView | None] = deque([None] * LATE_LOOKS, LATE_LOOKS)
        self.wanted = deque([0.0] * LATE_LOOKS, LATE_LOOKS)

    def heeded(self, cab: CabView) -> AdviceView | None:
        """What the display said 3 s ago."""
        late = self.views[0]
        self.views.append(super().heeded(cab))
        return late

    def set(self, wanted: float, most: float) -> float:
        """What he wants, and a quarter of how it differs from what he wanted 3 s ago."""
        before = self.wanted[0]
        self.wanted.append(wanted)
        return min(max(wanted + 0.25 * (wanted - before), -1.0), most)


def _advised(cab: CabView, outlook: Outlook, view: AdviceView) -> float | None:
    """The setting that the display asks for: its effort, and to hold its speed once that is reached.

    None if it does not say how to drive.
    """
    presenter = presenter_of(view.presentation)
    if not presenter.says_mode or view.mode not in DRIVING:
        return None
    over_mps = cab.speed_mps - view.shown_speed_mps
    reached = over_mps >= 0 if view.mode in TRACTION else over_mps <= 0
    to_reach = presenter.speed_is(view.mode) is SpeedIs.TO_REACH
    if view.mode == Regime.CRUISE or (to_reach and reached):
        return _held(cab, outlook, view.shown_speed_mps)
    if view.mode == Regime.COAST:
        return 0.0
    usual = 1.0 if view.mode in TRACTION else -0.5  # where the display shows no effort
    return usual if math.isnan(view.lever_ratio) else view.lever_ratio


def _held(cab: CabView, outlook: Outlook, speed_mps: float) -> float:
    """The setting that holds a speed."""
    return _ratio(hold(cab, outlook, speed_mps)._replace(gain_per_s=CALM_PER_S), cab, outlook)


def _ratio(command: Command, cab: CabView, outlook: Outlook) -> float:
    """The controller's setting (−1 … 1) for a command."""
    force_n = demanded(command, 0.0, cab.speed_mps, outlook.train)
    return Efforts.at(cab.speed_mps, outlook.train).lever_ratio(force_n)
