"""A day driven in this process, with what the driver did, the advice of every tick, and the coach's reference."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from das.advice.advice import Advice, ReplanCause
from das.advice.coach.keeping import StandingReference
from das.advice.coach.settings import CoachSettings, KeepingSettings
from das.advice.settings import AdviceSettings
from das.cab.cab import Cab
from sim.drivers.cab import Driver
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import presenter_of
from sim.world.loop import InProcess, Run, Tick, World
from sim.world.service import Day, Service, make_day

KEEPING: Final = KeepingSettings()
SETS_RATIO: Final = 0.02
"""A controller that is nearer to 0 than this share of its scale is at 0; beyond that it sets traction or brakes."""


def human_of(day: Day, friction: FrictionPolicy = FrictionPolicy.AS_MEASURED) -> HumanDriver:
    """The human driver of a day."""
    human = day.driver(DriverKind.HUMAN, friction)
    assert isinstance(human, HumanDriver)
    return human


def driven(day: Day, driver: Driver, presentation: Presentation) -> Run:
    """A day driven by a driver who is shown a presentation."""
    return World(day, driver, presentation, InProcess(day.service, coach=presenter_of(presentation).needs_coach)).run()


class Watched(NamedTuple):
    """Advice, and the speed of the coach's reference at the train's position (m/s; NaN: none)."""

    advice: Advice
    reference_mps: float


class WatchedLink(InProcess):
    """A link to an on-board system that keeps all advice; `keeping` says when the coach gives up a reference."""

    def __init__(self, service: Service, *, coach: bool, keeping: KeepingSettings = KEEPING) -> None:
        self._keeping = keeping
        self.watched: list[Watched] = []
        """The advice and the reference of every tick."""
        super().__init__(service, coach=coach)

    def restart(self) -> None:
        """Begin anew; legs that are made from now on keep references by the settings of this link."""
        super().restart()
        coach = CoachSettings(enabled=self._coach, keeping=self._keeping)
        self.cab.legs._settings = AdviceSettings(coach=coach)

    def exchange(self, tick: Tick) -> Advice:
        """The advice for a tick."""
        advice = super().exchange(tick)
        reference = _standing_reference(self.cab)
        speed = math.nan if reference is None else reference.schedule.speed_at(advice.s_m)
        self.watched.append(Watched(advice, speed))
        return advice


def _standing_reference(cab: Cab) -> StandingReference | None:
    """The coach's reference on the present section; None if there is none."""
    leg = cab.legs.current
    coach = None if leg is None else leg.coach
    return None if coach is None else coach._keeper.reference


@dataclass(frozen=True, kw_only=True, eq=False)
class WatchedRun:
    """A finished run of a day with the advice of each tick: `watched[i]` was given in `run.states[i]`."""

    day: Day
    run: Run
    watched: tuple[Watched, ...]

    @property
    def replans(self) -> dict[int, ReplanCause]:
        """Why each new reference was made, by its time (ns), without the first of a section or of a departure."""
        coached = (advice.coach.replan for advice, _ in self.watched if advice.coach is not None)
        none = (ReplanCause.NONE, ReplanCause.START)
        return {replan.time_ns: replan.cause for replan in coached if replan.cause not in none}


def watched_run(
    service: Service,
    seed: int,
    presentation: Presentation,
    *,
    human: HumanParameters | None = None,
    keeping: KeepingSettings = KEEPING,
) -> WatchedRun:
    """Drive a day of a service with the human driver of the scenario, or with one who has other parameters."""
    day = make_day(service, seed)
    if human is not None:
        day = replace(day, human=human)
    link = WatchedLink(service, coach=presenter_of(presentation).needs_coach, keeping=keeping)
    run = World(day, human_of(day), presentation, link).run()
    return WatchedRun(day=day, run=run, watched=tuple(link.watched))
