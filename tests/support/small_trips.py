"""A journey on a small line with the messages of a cab, and a follower of its advice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from das.advice.advice import Advice, Timetable
from das.advice.plan import Plan
from das.advice.reason import ReasonCode
from das.cab.leg import Leg
from das.cab.legs import Legs
from das.cab.orders import Order
from das.cab.preparation import Fronts, Preparation
from das.cab.situation import Situation
from das.domain.braking import USUAL, SiteBraking
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.route import Route, Stop
from das.domain.vehicle import Vehicle
from das.estimate.estimate import PositionFix
from das.solver.section import Section, SectionOptions, build_section
from tests.support.fixes import believing, ns
from tests.support.followed import after_a_second_mps
from tests.support.making import make_route, make_train
from tests.support.one_section import advised

LOSS = EfficiencyLoss(traction_ratio=0.15, brake_ratio=0.15, idle_w=20e3)
LENGTH_M = 100.0


def planned_section(vehicle: Vehicle, end_m: float) -> Section:
    """The section of the small line from its start, planned with the usual service braking as on board."""
    return build_section(LINE, vehicle, end_m=end_m, options=SectionOptions(braking=USUAL.of(vehicle)))


def train(mass_kg: float = 1e5) -> Vehicle:
    return replace(make_train(resistance=(1e3, 0.0, 5.0), power_w=2e6, loss=LOSS), train_length_m=LENGTH_M).with_mass(
        mass_kg
    )


def line() -> Route:
    stops = tuple(Stop(name=name, position_m=x) for name, x in (("A", 0.0), ("B", 5000.0), ("C", 9000.0)))
    return replace(make_route(9000.0, [(0.0, 30.0), (3000.0, 25.0)]), stops=stops)


LINE, TRAIN = line(), train()
DUE = [Timetable(departure_ns=ns(0), arrival_ns=ns(300)), Timetable(departure_ns=ns(330), arrival_ns=ns(590))]
FRONTS = Fronts(threads=1, kept_bytes=200_000_000)


class SmallTrip:
    """The legs and the train's position: a cab without its guard and its reports."""

    def __init__(self, situation: Situation, fronts: Fronts, *, background: bool = False, guide: bool = False) -> None:
        self.preparation = Preparation(fronts, background=background, guide=guide)
        self.legs = Legs(situation, self.preparation)
        self.localisation = believing(situation.vehicle)
        self.set_restrictions, self.set_targets = self.legs.set_restrictions, self.legs.set_targets
        self.set_conditions, self.take_news, self.close = (
            self.legs.set_conditions, self.legs.take_news, self.preparation.close,
        )  # fmt: skip

    @property
    def leg(self) -> Leg:
        """The train's current leg."""
        assert self.legs.current is not None
        return self.legs.current

    @property
    def plan(self) -> Plan | None:
        return self.leg.planner.plan

    @property
    def searching(self) -> bool:
        return self.preparation.searching

    def begin(
        self,
        stops: Sequence[Stop],
        timetables: Sequence[Timetable],
        *,
        vehicle: Vehicle = TRAIN,
        level: Level | None = None,
    ) -> None:
        """Take over a journey, before any message of another train."""
        if vehicle is not self.legs.situation.vehicle:
            self.localisation = believing(vehicle)
        order = Order(stops=tuple(stops), timetables=tuple(timetables), vehicle=vehicle, level=level)
        self.legs.begin(order, self.localisation.moment)

    def set_position(self, fix: PositionFix) -> None:
        self.localisation.take(fix)
        self.legs.place(self.localisation.moment)

    def update(self, now_ns: int) -> Advice:
        """The advice at a time."""
        here = self.localisation.at(now_ns)
        self.leg.see(here)
        self.legs.prepare(now_ns)
        return advised(self.leg, here)


def trip(
    fronts: Fronts = FRONTS,
    *,
    background: bool = False,
    due: Sequence[Timetable] = DUE,
    guide: bool = False,
    braking: SiteBraking = USUAL,
) -> SmallTrip:
    situation = Situation(route=LINE, vehicle=TRAIN, braking=braking)
    made = SmallTrip(situation, fronts, background=background, guide=guide)
    made.begin(LINE.stops, due)
    return made


SPEED_SD_MPS = 0.2
"""The standard deviation (m/s) that the sender states for its speed; a speed without one may be late."""


def at(made: SmallTrip, second: float, s_m: float, v_mps: float) -> Advice:
    made.set_position(PositionFix(time_ns=ns(second), s_m=s_m, speed_mps=v_mps, speed_uncertainty_mps=SPEED_SD_MPS))
    return made.update(ns(second))


def follow(
    made: SmallTrip, *, start_s: int = 0, s_m: float = 0.0, v_mps: float = 0.0, tell: Any = None
) -> Iterator[Advice]:
    """A follower with exactly the advised speed after every second, to the last stop."""
    for second in range(start_s, start_s + 2000):
        if tell is not None:
            tell(second, s_m)
        advice = at(made, second, s_m, v_mps)
        yield advice
        if advice.reason.code is ReasonCode.ARRIVED and s_m > LINE.length_m - 60:
            return
        after = after_a_second_mps(advice)
        s_m, v_mps = s_m + 0.5 * (v_mps + after), after


def highest(advice: Advice) -> Iterator[tuple[float, float]]:
    """The positions of the train at the advised speeds, second by second, and these speeds."""
    s_m, before = advice.s_m, advice.advised_speed_mps
    yield s_m, before
    for after in advice.horizon_speed_mps:
        s_m, before = s_m + 0.5 * (before + after), after
        yield s_m, after


def broken(*_: Any, **__: Any) -> Any:
    """A function that fails with an unexpected exception."""
    raise IndexError("nobody foresaw this")
