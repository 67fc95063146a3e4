"""A day driven in this process, of which more is kept: what a driver did, every advice, and the coach's reference."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from das.advice.advice import Advice
from das.advice.coach.coaching import ReplanCause
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
NORMAL_95: Final = 1.96


def human_of(day: Day, friction: FrictionPolicy = FrictionPolicy.AS_MEASURED) -> HumanDriver:
    """The human driver of a day."""
    human = day.driver(DriverKind.HUMAN, friction)
    assert isinstance(human, HumanDriver)
    return human


def driven(day: Day, driver: Driver, presentation: Presentation) -> Run:
    """A day driven by a driver who is shown a presentation."""
    return World(day, driver, presentation, InProcess(day.service, coach=presenter_of(presentation).needs_coach)).run()


def with_interval(differences: np.ndarray) -> str:
    """The mean of differences on the same days, with its 95 % interval."""
    half = NORMAL_95 * float(differences.std(ddof=1)) / len(differences) ** 0.5
    return f"{differences.mean():+.1f} ± {half:.1f}"


class Watched(NamedTuple):
    """An advice, and the speed of the coach's reference where the train is (m/s; NaN: none)."""

    advice: Advice
    reference_mps: float


class WatchedLink(InProcess):
    """The way to a cab in this process that keeps what was said; `keeping` is when the coach gives up a reference."""

    def __init__(self, service: Service, *, coach: bool, keeping: KeepingSettings = KEEPING) -> None:
        self._keeping = keeping
        self.watched: list[Watched] = []
        """What was said at every tick."""
        super().__init__(service, coach=coach)

    def restart(self) -> None:
        """Begin anew; legs that are made from now on keep references as this link is told."""
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
    """The coach's reference on the section that a cab is on; None where there is none."""
    leg = cab.legs.current
    coach = None if leg is None else leg._coach
    return None if coach is None else coach._keeper.reference


@dataclass(frozen=True, kw_only=True, eq=False)
class WatchedRun:
    """A finished run of a day, with what was said at each tick: `watched[i]` is what was said in `run.states[i]`."""

    day: Day
    run: Run
    watched: tuple[Watched, ...]

    @property
    def replans(self) -> dict[int, ReplanCause]:
        """Why references were made anew, by the moment (ns); not the first of a section or at a departure."""
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
    """Drive a day of a service with a human driver: the default one of the scenario, or one with other parameters."""
    day = make_day(service, seed)
    if human is not None:
        day = replace(day, human=human)
    link = WatchedLink(service, coach=presenter_of(presentation).needs_coach, keeping=keeping)
    run = World(day, human_of(day), presentation, link).run()
    return WatchedRun(day=day, run=run, watched=tuple(link.watched))
