"""Compilation of every kernel, or its loading from the cache, before operation."""

from __future__ import annotations

import numpy as np

from das.domain.effort import EffortEnvelope
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.route import Route, Stop, Stretches
from das.domain.vehicle import BrakePolicy, Resistance, Vehicle
from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solve import solve_front
from das.solver.state import least_time_s


def warm_up() -> Front:
    """Front of a tiny section, solved with every entry point; the first call on a machine takes 10 to 15 s."""
    front = solve_front(build_section(tiny_route(), tiny_vehicle()), lambda_w=np.array([1e4, 1e5, 1e6]))
    shortest_s = front.fastest().time_s
    for buffer_ratio in (0.01, 0.1, 0.3):
        front.trajectory(shortest_s * (1 + buffer_ratio))
    least_time_s(front.section, 0.0, 0.0)
    return front


def tiny_vehicle() -> Vehicle:
    """A simple train for the warm-up."""
    effort = EffortEnvelope(max_force_n=1e5, max_power_w=1e6)
    return Vehicle(
        id="warm-up",
        name="warm-up",
        source="warm-up",
        mass_kg=1e5,
        rotating_mass_ratio=0.0,
        train_length_m=0.0,
        max_speed_mps=30.0,
        resistance=Resistance(c0_n=1e3, c1_n_per_mps=10.0, c2_n_per_mps2=5.0),
        traction=effort,
        electric_brake=effort,
        friction_brake_force_n=0.0,
        brake_policy=BrakePolicy.ELECTRIC,
        losses={Level.OWN: EfficiencyLoss(traction_ratio=0.1, brake_ratio=0.1)},
    )


def tiny_route() -> Route:
    """A level line of 400 m for the warm-up."""
    return Route(
        id="warm-up",
        name="warm-up",
        source="warm-up",
        illustrative=True,
        length_m=400.0,
        stops=(Stop(name="A", position_m=0.0), Stop(name="B", position_m=400.0)),
        limits_mps=Stretches.constant(20.0),
        gradients_ratio=Stretches.constant(0.0),
    )
