"""Compiles all kernels that turn a position into advice, or loads them from the cache, before time matters."""

from __future__ import annotations

from das.advice.advice import Source, Timetable
from das.advice.last_word import BrakingBasis, LastWord
from das.advice.planner import PlanBasis
from das.cab.leg import Leg
from das.domain.conditions import Conditions
from das.domain.route import Stop
from das.domain.units import NS
from das.estimate.fix import PositionFix
from das.estimate.localisation import Localisation
from das.solver.guide.policies import GuideFront
from das.solver.warm_up import warm_up as solve_tiny


def warm_up() -> None:
    """Run planner, guide and last word on a tiny section, under way and braking for the stop."""
    front = solve_tiny()
    section = front.section
    start, end = Stop(name="A", position_m=section.start_m), Stop(name="B", position_m=section.end_m)
    leg = Leg(start, end, section, guide=True)
    leg.use(PlanBasis(section=section, front=front, source=Source.SOLVED))
    leg.use_guide(GuideFront(section))
    leg.set_timetable(Timetable(departure_ns=0, arrival_ns=round(60.0 / NS)))
    vehicle = section.vehicle
    basis = BrakingBasis(section.route, vehicle, section.brakes, (), Conditions(), section.start_m, section.end_m)
    for tick, (s_m, speed_mps) in enumerate(((100.0, 10.0), (110.0, 10.0), (385.0, 5.0))):
        localisation = Localisation(vehicle)
        localisation.take(PositionFix(time_ns=tick, s_m=s_m, speed_mps=speed_mps))
        here = localisation.at(tick)
        LastWord().judge(leg.advise(here), here, basis)
