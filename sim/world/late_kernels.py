"""Compilation of the kernels that a simulated run needs last, on a tiny line.

A command that compiles the solver runs this module in parallel: the train model, the guide's plans and the last word
are needed only after the sections have been solved.
"""

from __future__ import annotations

from das.advice.advice import Timetable
from das.advice.last_word import BrakingBasis, LastWord
from das.cab.leg import Leg
from das.domain.conditions import Conditions
from das.domain.units import NS
from das.estimate.estimate import PositionFix
from das.estimate.localisation import Localisation
from das.solver.guide.from_run import scheduled_run
from das.solver.guide.in_time import in_time
from das.solver.guide.policies import GuideFront
from das.solver.section import Section, build_section
from das.solver.state import State
from das.solver.warm_up import tiny_route, tiny_vehicle
from sim.plant.kernels import demanded
from sim.plant.plant import COAST, Plant, lever_ratio, train_numbers


def main() -> None:
    """Drive, plan and brake once on a tiny section."""
    section = build_section(tiny_route(), tiny_vehicle())
    _drive(section)
    _plan(section)
    _brake(section)


def _drive(section: Section) -> None:
    plant, train = Plant(section.route, section.vehicle), train_numbers(section.vehicle)
    start = plant.at(section.start_m)
    plant.advance(start, COAST)
    plant.gradient_ratio(start.s_m)
    plant.weather(start)
    lever_ratio(demanded(COAST, 0.0, start.speed_mps, train), start.speed_mps, train)


def _plan(section: Section) -> None:
    front, state = GuideFront(section), State.at(section)
    run, _ = in_time(front, state, 1.1 * state.fastest().time_s)
    scheduled_run(front, run)


def _brake(section: Section) -> None:
    start, end = section.route.stops[0], section.route.stops[-1]
    leg = Leg(start, end, section, guide=True)
    leg.set_timetable(Timetable(departure_ns=0, arrival_ns=round(60.0 / NS)))
    basis = BrakingBasis(
        section.route, section.vehicle, section.brakes, (), Conditions(), section.start_m, section.end_m
    )
    localisation = Localisation(section.vehicle)
    localisation.take(PositionFix(time_ns=0, s_m=section.end_m, speed_mps=2.0))
    here = localisation.at(0)
    LastWord().judge(leg.advise(here), here, basis)
