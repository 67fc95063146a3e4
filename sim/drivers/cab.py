"""The view of a driver (the cab and its display), the interface of all drivers, and a driver's diary."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

from das.advice.reason import NO_REASON, Reason
from das.advice.regimes import KIND_OF, InstructionKind, Regime
from das.domain.restriction import Restriction
from sim.drivers.kinds import Presentation

if TYPE_CHECKING:
    from sim.plant.kernels import Command

AT_STOP_M = 10.0
"""Largest distance (m) from its stop at which a standing train counts as arrived, with all doors at the platform."""


@dataclass(frozen=True, kw_only=True)
class AdviceView:
    """Advice as displayed; values that are not shown are NaN or empty.

    Times are in s on the cab's clock, modes are driving regimes by their numbers on the bus. `speed_mps` is the advised
    speed: the top speed in TOP_SPEED, the speed to hold in FOUR_MODE, the speed to reach or to hold in GUIDE.
    `display_speed_mps` is the same speed in whole km/h, as written on the display. `lever_ratio` is the advised effort
    on the controller's scale (see `sim.plant.plant.lever`). Horizons have steps of 1 s; their first value is 1 s after
    `time_s`. `next_speed_mps` and `next_effort_ratio` are speed and share of the largest effort after the next change,
    `next_change_m` is the distance to it, and `second_…` is the change after it. In GUIDE, `due_s` is the time until
    the instruction is due, and `target_way_m` the distance to where its speed is reached. In DEVIATION, only
    `deviation_s` is shown: the lateness against the plan for the timetable (early < 0).

    Mode DEPART means to wait until the train is cleared; efforts and horizons are those of a standing train.
    The next change is then the departure, and `departure` is the advice for the cleared train.
    """

    time_s: float
    valid_until_s: float
    presentation: Presentation
    mode: int
    speed_mps: float = math.nan
    display_speed_mps: float = math.nan
    lever_ratio: float = math.nan
    force_n: float = math.nan
    horizon_speed_mps: tuple[float, ...] = ()
    horizon_force_n: tuple[float, ...] = ()
    next_mode: int = Regime.NONE
    next_change_s: float = math.nan
    next_speed_mps: float = math.nan
    next_effort_ratio: float = math.nan
    next_change_m: float = math.nan
    second_mode: int = Regime.NONE
    second_change_s: float = math.nan
    second_change_m: float = math.nan
    second_speed_mps: float = math.nan
    second_effort_ratio: float = math.nan
    due_s: float = 0.0
    target_way_m: float = math.nan
    reason: Reason = NO_REASON
    deviation_s: float = math.nan

    @property
    def shown_speed_mps(self) -> float:
        """The speed that the driver reads (m/s): that written on the display, or else the advised speed."""
        return self.speed_mps if math.isnan(self.display_speed_mps) else self.display_speed_mps

    @property
    def departure(self) -> AdviceView:
        """The advice to depart, as displayed once the train is cleared.

        Advice other than DEPART is returned unchanged, as is the advice of a display that does not show how to drive.
        """
        if self.mode != Regime.DEPART or self.next_mode == Regime.NONE:
            return self
        return replace(
            self,
            mode=self.next_mode,
            speed_mps=self.next_speed_mps,
            display_speed_mps=self.next_speed_mps,
            lever_ratio=self.next_effort_ratio,
            force_n=math.nan,
            horizon_speed_mps=(),
            horizon_force_n=(),
            next_mode=Regime.NONE,
            second_mode=Regime.NONE,
        )

    def foreseen_mps(self, now_s: float) -> float:
        """The speed (m/s) that the preview shows for a later moment; without a preview, the speed that is shown."""
        after = int(now_s - self.time_s)
        if not self.horizon_speed_mps or after < 1:
            return self.shown_speed_mps
        return self.horizon_speed_mps[min(after, len(self.horizon_speed_mps)) - 1]


class CabView(NamedTuple):
    """The information that a driver has at a moment (times in s on the cab's clock).

    `s_m` is the position according to the kilometre marks, `speed_mps` and `limit_mps` are as displayed. `stop_m` is
    the next timetabled stop, due at `arrival_s`. The train may leave from `departure_s` on if it `may_depart` (doors
    closed, signal clear). `signal_m` is the next signal at danger in sight (inf: none). `advice` is None if none is
    shown; `cause` is then the reason, by its number on the bus. `late_s` is the lateness against the plan,
    `gradient_ratio` the gradient at the train's head, and `force_…_n` the forces of motors and friction brake.
    """

    time_s: float
    s_m: float
    speed_mps: float
    limit_mps: float
    stop_m: float
    departure_s: float
    arrival_s: float
    may_depart: bool = True
    signal_m: float = math.inf
    restrictions: tuple[Restriction, ...] = ()
    advice: AdviceView | None = None
    cause: int = 0
    late_s: float = math.nan
    gradient_ratio: float = math.nan
    force_el_n: float = math.nan
    force_friction_n: float = math.nan

    @property
    def halt_m(self) -> float:
        """Position (m) at which the train must stand next."""
        return min(self.stop_m, self.signal_m)

    @property
    def shall_stand(self) -> bool:
        """Whether the train stands and must not move: it is at or beyond its halt, or may not leave yet."""
        if self.speed_mps > 0:
            return False
        waiting = not self.may_depart or self.time_s < self.departure_s
        return waiting or self.halt_m - self.s_m <= AT_STOP_M

    @property
    def shown(self) -> AdviceView | None:
        """The advice if it is still valid, else None."""
        view = self.advice
        return view if view is not None and self.time_s <= view.valid_until_s else None


class Driver(Protocol):
    """A driver: the run calls `command` at every look, a fraction of a second apart, in the order of time."""

    def command(self, cab: CabView) -> Command:
        """The controller's setting until the next look."""


def beginning_of(driver: object) -> Callable[[Any], None] | None:
    """The method `begin` of a driver in another process, called by a run with the link to that process; else None."""
    begin: Callable[[Any], None] | None = getattr(driver, "begin", None)
    return begin


KINDS: Final = (
    *("glance", "noticed", "reaction", "followed", "refused"),
    *("acted", "lapse", "lever", "changed", "expected"),
)
"""The kinds of events, in the order of `Decision.Kind` in das/bus/das.proto, which explains each kind."""


class DriverEvent(NamedTuple):
    """An action or observation of a driver: the time (s on the cab's clock), the kind (one of `KINDS`), and a number.

    The number is, for `glance`, `noticed`, `followed`, `refused` and `changed`: the mode of the advice (0: none); for
    `reaction` and `lapse`: the length as drawn (s); for `acted`: 1 if the advice is followed; for `lever`: the new
    setting of a controller that was at rest; for `expected`, which precedes `reaction`: the share of a reaction time
    that an announced change takes.
    """

    time_s: float
    what: str
    value: float


class Diary:
    """The events of one driver, in the order of their recording."""

    def __init__(self) -> None:
        self.events: list[DriverEvent] = []

    def note(self, time_s: float, what: str, value: float) -> None:
        """Add an event."""
        self.events.append(DriverEvent(time_s, what, value))


def kept_by(driver: object) -> Sequence[DriverEvent]:
    """The events recorded so far by a driver; empty for a driver without a diary."""
    return getattr(driver, "events", ())


class Asked(Enum):
    """The action that an instruction requires of the driver of a train at a certain speed.

    Only `ACCELERATE` and `HOLD` allow traction. Braking for limits, stops and signals is the driver's own decision.
    """

    ACCELERATE = "the effort shown"
    HOLD = "the effort that holds the speed shown"
    COAST = "neither traction nor brakes, at any speed"
    BRAKE = "the brake with the effort shown"
    BRAKE_BY_EYE = "the brake that the driver considers right for the stopping point"
    KEEP_BELOW = "no traction, and brakes only against exceeding the speed shown"


def asked(mode: int, to_mps: float, effort_ratio: float, speed_mps: float, *, reached: bool = False) -> Asked | None:
    """The action that an instruction requires at a speed; None if its mode does not show how to drive.

    `to_mps` is the speed to reach or to hold (NaN: none is shown), `effort_ratio` is NaN if no effort is shown.
    `reached`: the train has had the speed to reach since the instruction became due.
    """
    kind = KIND_OF.get(mode)
    if kind is InstructionKind.TRACTION:
        return Asked.HOLD if reached or speed_mps >= to_mps else Asked.ACCELERATE
    if kind is InstructionKind.HOLD:
        return Asked.HOLD
    if kind is InstructionKind.COAST:
        return Asked.COAST
    if kind is InstructionKind.BRAKE:
        if math.isnan(effort_ratio) and to_mps <= 0:
            return Asked.BRAKE_BY_EYE
        return Asked.KEEP_BELOW if reached or speed_mps <= to_mps else Asked.BRAKE
    return None
