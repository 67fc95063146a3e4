"""Compilation of the kernels that a simulated run needs last, on a tiny line.

A command that compiles the solver runs this module in parallel: the train model, the guide's plans and the last word
are needed only after the sections have been solved.
"""

from __future__ import annotations

from das.cab.cab import warm_up_advice
from das.solver.section import build_section
from das.solver.warm_up import tiny_route, tiny_vehicle
from sim.plant.kernels import demanded
from sim.plant.plant import COAST, Plant, lever_ratio, train_numbers


def main() -> None:
    """Drive, plan and brake once on a tiny section."""
    section = build_section(tiny_route(), tiny_vehicle())
    plant, train = Plant(section.route, section.vehicle), train_numbers(section.vehicle)
    start = plant.at(section.start_m)
    plant.advance(start, COAST)
    plant.gradient_ratio(start.s_m)
    plant.weather(start)
    lever_ratio(demanded(COAST, 0.0, start.speed_mps, train), start.speed_mps, train)
    warm_up_advice(section)
