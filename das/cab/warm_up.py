"""Compiles all kernels that turn a position into advice, or loads them from the cache, before time matters."""

from __future__ import annotations

import numpy as np

from das.advice.advice import Source, Timetable
from das.advice.braking_model import BrakingBasis
from das.advice.coach.settings import CoachSettings
from das.advice.last_word import LastWord
from das.advice.planner import PlanBasis
from das.advice.settings import AdviceSettings
from das.cab.leg import Leg
from das.domain.conditions import Conditions
from das.domain.route import Stop
from das.domain.units import NS
from das.estimate.fix import PositionFix
from das.estimate.localisation import Localisation
from das.solver.guide.policies import GuideFront
from das.solver.section import build_section
from das.solver.solve import solve_front
from das.solver.warm_up import tiny_route, tiny_vehicle
from das.solver.warm_up import warm_up as solve_tiny
from das.table.format import ARRAYS, packed, unpacked


def warm_up() -> None:
    """Run planner, coach and last word on a tiny section, under way and braking for the stop."""
    front = solve_tiny()
    section = front.section
    start, end = Stop(name="A", position_m=section.start_m), Stop(name="B", position_m=section.end_m)
    settings = AdviceSettings(coach=CoachSettings(enabled=True))
    leg = Leg(start, end, section, settings)
    leg.use(PlanBasis(section=section, front=front, source=Source.SOLVED))
    leg.use_guide(GuideFront(section, settings.coach.guide))
    leg.set_timetable(Timetable(departure_ns=0, arrival_ns=round(60.0 / NS)))
    vehicle = section.vehicle
    basis = BrakingBasis(section.route, vehicle, section.brakes, (), Conditions(), section.start_m, section.end_m)
    for tick, (s_m, speed_mps) in enumerate(((100.0, 10.0), (110.0, 10.0), (385.0, 5.0))):
        localisation = Localisation(vehicle)
        localisation.take(PositionFix(time_ns=tick, s_m=s_m, speed_mps=speed_mps))
        here = localisation.at(tick)
        LastWord().judge(leg.advise(here), here, basis)


def warm_up_tables() -> None:
    """Compile, or load from the cache, the kernels that read the arrays of a table; some 6 s the first time."""
    section = build_section(tiny_route(), tiny_vehicle())
    front = solve_front(section, lambda_w=np.array([0.0, 1e4, 1e5, 1e6]))
    read = {  # read-only, as the arrays of a file are
        name: np.frombuffer(array.tobytes(), ARRAYS[name].kind).reshape(array.shape)
        for name, array in packed(front).items()
    }
    stored, least_time_s = unpacked(section, front.lambda_w, read), front.fastest().time_s
    for buffer_ratio in (0.01, 0.1, 0.3):
        stored.trajectory(least_time_s * (1 + buffer_ratio))
