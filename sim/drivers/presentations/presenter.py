"""The definition of a presentation of the advice, and the lookup of presentations by name or number.

A new presentation needs a line in `sim.drivers.kinds.Presentation`, and a module of the same name in this package
(with `_` for `-`) that defines a `Presenter` called `PRESENTER`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from enum import Enum
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple, Protocol

from das.advice import wording
from das.advice.reason import NO_REASON, Reason
from das.advice.regimes import Regime
from das.advice.wording import Language
from das.bus.topics import CAB
from das.domain.units import KMH, NS, kmh
from sim.doors import PRESENTATIONS, installed
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.kinds import Presentation

if TYPE_CHECKING:
    from sim.drivers.handling import Handling
    from sim.drivers.knowledge import Outlook
    from sim.plant.kernels import Command

EFFORT_STEP_RATIO: Final = 0.2
"""Step of the displayed effort, as a share of the controller's scale; drivers neither read nor set finer steps."""
END_STOP_RATIO: Final = 0.99
"""Share of the controller's scale above which an effort counts as the end of the scale, a mechanical stop."""


FOUR_MODES: Final = {
    Regime.REDUCED_TRACTION: Regime.CRUISE,
    Regime.REDUCED_BRAKE: Regime.FULL_BRAKE,
    Regime.FRICTION_BRAKE: Regime.FULL_BRAKE,
}
"""For each driving regime that is not one of the four modes, the mode that is shown for it."""


class SpeedIs(Enum):
    """The meaning of the speed on a display: a speed to have now, not to exceed, or to reach."""

    TO_HAVE = "to have now"
    HIGHEST = "not to be exceeded"
    TO_REACH = "to be reached"


class LaneState(NamedTuple):
    """The entry in the lane "shown" of pictures for a display without modes: a text, and its colour "#rrggbb".

    `standing`: this text is also used while the train stands; if false, the lane then shows the mode (stop or depart).
    """

    text: str
    color: str
    standing: bool = False


class ShownRegime(NamedTuple):
    """The mode, the speed (m/s) and the reason that a display shows for recorded advice."""

    mode: Regime
    speed_mps: float
    reason: Reason = NO_REASON


class SimplerLook(NamedTuple):
    """The values for a display of one top speed or of four modes; its other values are taken from the advice."""

    time_ns: int
    valid_until_ns: int
    mode: int
    top_speed_mps: float = math.nan
    """The top speed to show: with it the train arrives on time, and keeps the limits and stops ahead."""
    four_mode: int = Regime.NONE
    next_four_mode: int = Regime.NONE
    next_four_change_s: float = math.nan
    advised_speed_mps: float = math.nan
    display_speed_mps: float = math.nan
    departure_speed_mps: float = 0.0


class Shown(NamedTuple):
    """The values that a driver reads from a display; None for those not shown. `effort` is in steps, braking < 0."""

    mode: Regime | None = None
    speed_kmh: int | None = None
    effort: int | None = None
    deviation_s: int | None = None

    @classmethod
    def of(cls, view: AdviceView) -> Shown:
        """The values that a driver reads from presented advice."""
        return presenter_of(view.presentation).read(view)


class Hands(Protocol):
    """The actions with which a human driver follows advice; each returns a setting of the controller (−1 … 1)."""

    @property
    def handling(self) -> Handling:
        """The driver's way of holding a speed and braking."""

    def set_effort(self, lever_ratio: float) -> float:
        """An effort (−1 … 1) as set by the driver: with an error, but exact at the ends of the scale."""

    def to_speed(self, cab: CabView, outlook: Outlook, view: AdviceView, allowed_mps: float) -> float:
        """Accelerate, brake or roll to the shown speed with the shown effort, then hold that speed."""


class Follower(Protocol):
    """A driver who follows a presentation exactly, from one departure to the next."""

    def command(self, cab: CabView, view: AdviceView, outlook: Outlook) -> Command | None:
        """The command for a moving train; None if the driver should drive as without advice."""


class Presenter(ABC):
    """One presentation: its contents, how drivers read and follow it, and its number, texts and lane.

    The defaults suit a display that shows a mode, a speed to have now, and an effort.
    """

    number: ClassVar[int]
    """The unique value of `Cab.Presentation` on the bus; das/bus/das.proto may have a name for it."""
    phrase: ClassVar[str]
    """Name of the presentation in the sentences of a report."""
    meaning: ClassVar[str]
    """Contents of the display, for readers of a study."""
    is_simpler: ClassVar[bool] = False
    """Whether the display gets a `SimplerLook`, computed in the simulated cab, instead of the advice itself."""
    needs_guide: ClassVar[bool] = False
    """Whether the on-board system must have its guide enabled."""
    says_mode: ClassVar[bool] = True
    """Whether the display shows a driving regime; a display without one shows at most a top speed."""
    lane: ClassVar[LaneState | None] = None
    """The lane of a display that shows no mode; None if the lane shows the modes."""

    @abstractmethod
    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        """The content of the display for advice (`Advice`, or its message); None for a blank display. `blank` has only
        the times and the mode of the advice. `deviation_s` is the lateness of the train.
        """

    def shown_mode(self, advice: Any) -> ShownRegime:
        """The mode that the display shows for a message Advice; for a display without modes, that of the profile."""
        return ShownRegime(known_mode(advice.mode), float(advice.advised_speed_mps))

    def speed_is(self, mode: int) -> SpeedIs:
        """The meaning of the displayed speed for a mode."""
        return SpeedIs.TO_HAVE

    def read(self, view: AdviceView) -> Shown:
        """The values that a driver reads from the display; the speed is in whole km/h."""
        effort = whole(view.lever_ratio / EFFORT_STEP_RATIO)
        return Shown(mode=Regime(view.mode), speed_kmh=whole(view.shown_speed_mps / KMH), effort=effort)

    def item(self, view: AdviceView) -> tuple[int, ...]:
        """The values by which a human driver recognises advice: equal values count as the same advice."""
        return (view.mode, *(() if math.isnan(view.speed_mps) else (round(view.speed_mps),)))

    def set_by(self, hands: Hands, cab: CabView, outlook: Outlook, view: AdviceView, allowed_mps: float) -> float:
        """The setting of the controller (−1 … 1) of a human driver who follows the advice on how to drive.

        After a departure, `view` is the advice to depart until the driver's next glance. `allowed_mps` is the highest
        speed that the driver accepts here.
        """
        return hands.to_speed(cab, outlook, view.departure, allowed_mps)

    def follower(self) -> Follower | None:
        """The driver that follows the display exactly; None if there is none for this display."""
        return None

    def mode_words(self, number: int, language: Language = Language.EN) -> str:
        """The text for a mode, given by its number on the bus; empty for an unknown number."""
        return mode_words(number, language)

    def words_before_speed(self, number: int, language: Language = Language.EN) -> str:
        """The text for a mode (number on the bus) if a speed follows it."""
        return self.mode_words(number, language)

    def instruction(self, number: int, speed: str, language: Language = Language.EN) -> str:
        """The words for a mode (number on the bus) and a speed (an empty text: no speed)."""
        return ", ".join(filter(None, (self.mode_words(number, language), speed)))

    def headline(self, view: AdviceView, language: Language = Language.EN) -> str:
        """The main text of the display: mode and speed, or what the display shows instead."""
        speed = "" if view.mode in (Regime.STOP, Regime.DEPART) else speed_words(view.shown_speed_mps)
        return self.instruction(view.mode, speed, language)


class NoAdvice(Presenter):
    """The presentation without advice: the display is blank."""

    number = 0
    phrase = meaning = "no advice"
    says_mode = False

    def show(self, blank: AdviceView, advice: Any, deviation_s: float) -> AdviceView | None:
        return None


@cache
def presenter_of(presentation: Presentation) -> Presenter:
    """The presenter of a presentation, from the module of that name, or from the package that adds it."""
    if presentation is Presentation.NONE:
        return NoAdvice()
    if (door := installed(PRESENTATIONS).get(presentation)) is not None:
        brought: Presenter = door.load()
        return brought
    module = import_module(f"sim.drivers.presentations.{presentation.replace('-', '_')}")
    presenter: Presenter = module.PRESENTER
    return presenter


@cache
def shown_presentation(number: int) -> Presentation | None:
    """The presentation with this number in the message Cab; None if it stands for no advice or is unknown."""
    named: Any = CAB.message  # numbers named there need no import of the presentations
    known = {value: Presentation[name.removeprefix("PRESENTATION_")] for name, value in named.Presentation.items()}
    if number in known:
        return known[number] if number else None
    return next((one for one in Presentation if presenter_of(one).number == number), None)


def present(
    advice: Any,
    presentation: Presentation,
    *,
    clock_zero_ns: int = 0,
    deviation_s: float = math.nan,
) -> AdviceView | None:
    """The content of the display for advice; None if it is blank. `advice` is a `das.advice.advice.Advice` or the
    message of the bus. `clock_zero_ns` is the moment (ns since 1970) at which the cab's clock shows 0. `deviation_s` is
    the lateness of the train, for a display of lateness alone.
    """
    if int(advice.mode) == Regime.NONE:
        return None
    blank = AdviceView(
        time_s=(advice.time_ns - clock_zero_ns) * NS,
        valid_until_s=(advice.valid_until_ns - clock_zero_ns) * NS,
        presentation=presentation,
        mode=int(advice.mode),
    )
    return presenter_of(presentation).show(blank, advice, deviation_s)


def known_mode(number: int) -> Regime:
    """The mode with this number on the bus; NONE for an unknown number."""
    return Regime(number) if number in set(Regime) else Regime.NONE


def mode_words(number: int, language: Language = Language.EN) -> str:
    """The words for a mode (number on the bus); empty for an unknown number."""
    return wording.mode_words(Regime(number), language) if number in set(Regime) else ""


def speed_words(speed_mps: float) -> str:
    """A speed in whole km/h, as text; empty for NaN."""
    return f"{kmh(speed_mps):.0f} km/h" if math.isfinite(speed_mps) else ""


def whole(value: float) -> int | None:
    """The nearest whole number; None for NaN, which stands for a figure that is not shown."""
    return None if math.isnan(value) else round(value)
