"""A run in this process of which more is kept: every advice, and the coach's reference where the train was."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from das.advice.advice import Advice
from das.advice.coach.coaching import ReplanCause
from das.advice.coach.keeping import StandingReference
from das.advice.coach.settings import CoachSettings, KeepingSettings
from das.advice.settings import AdviceSettings
from das.cab.cab import Cab
from sim.drivers.cab import Presentation
from sim.drivers.kinds import DriverKind
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import presenter_of
from sim.world.day import Day, make_day
from sim.world.in_process import InProcess
from sim.world.link import Tick
from sim.world.loop import Run, World
from sim.world.scenario import load_scenario
from sim.world.service import Service, prepare_service

KEEPING = KeepingSettings()


class Watched(NamedTuple):
    """An advice, the speed of the coach's reference where the train is (m/s; NaN: none), and how late it would be."""

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
        reference = standing_reference(self.cab)
        speed = math.nan if reference is None else reference.schedule.speed_at(advice.s_m)
        self.watched.append(Watched(advice, speed))
        return advice


def standing_reference(cab: Cab) -> StandingReference | None:
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
    def replans(self) -> list[ReplanCause]:
        """Why references were made anew, in the order of time; the first of a section and at a departure are none."""
        found: dict[int, ReplanCause] = {}
        for advice, _ in self.watched:
            if advice.coach is not None:
                found[advice.coach.replan.time_ns] = advice.coach.replan.cause
        return [cause for cause in found.values() if cause not in (ReplanCause.NONE, ReplanCause.START)]


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
    run = World(day, day.driver(DriverKind.HUMAN), presentation, link).run()
    return WatchedRun(day=day, run=run, watched=tuple(link.watched))


def service_of(scenario: str) -> Service:
    """The service of a bundled scenario or of a file."""
    return prepare_service(load_scenario(scenario))
