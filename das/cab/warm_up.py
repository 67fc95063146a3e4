"""Compile, or load from the cache, all that lies between a position and an advice, before time matters."""

from __future__ import annotations

from das.advice.advice import Source, Timetable
from das.advice.coach.planning import solve_coach
from das.advice.coach.settings import CoachSettings
from das.advice.planner import PlanBasis
from das.advice.settings import AdviceSettings
from das.cab.leg import Leg
from das.domain.route import Stop
from das.domain.units import NS
from das.estimate.fix import PositionFix
from das.estimate.localisation import Localisation
from das.solver.warm_up import warm_up as solve_tiny


def warm_up() -> None:
    """Advise once on a tiny section."""
    front = solve_tiny()
    section = front.section
    start, end = Stop(name="A", position_m=section.start_m), Stop(name="B", position_m=section.end_m)
    settings = AdviceSettings(coach=CoachSettings(enabled=True))
    leg, localisation = Leg(start, end, section, settings), Localisation(section.vehicle)
    leg.use(PlanBasis(section=section, front=front, source=Source.SOLVED))
    leg.use_calm(solve_coach(section, settings.coach))
    leg.set_timetable(Timetable(departure_ns=0, arrival_ns=round(60.0 / NS)))
    for tick in range(2):
        localisation.take(PositionFix(time_ns=tick, s_m=10.0, speed_mps=1.0))
        leg.advise(localisation.at(tick))
