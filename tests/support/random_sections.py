"""Random trains, lines and sections for property tests, from ordinary ones to the most extreme possible."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from das.domain.effort import EffortEnvelope
from das.domain.errors import InfeasibleError
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap, LossModel
from das.domain.route import Route, Stretches, Zone
from das.domain.vehicle import BrakePolicy, Resistance, Vehicle
from das.solver.section import Section, SectionOptions, build_section
from tests.support.making import make_route

TOP_MPS = 50.0
LEVELS = (Level.L0_NOREG, Level.L0_REG, Level.L1, Level.OWN, Level.OWN, Level.L3)


@dataclass(frozen=True, repr=False)
class Posed:
    """A section and the buffers (ratios of the least time) at which it is solved."""

    section: Section
    buffer_ratios: tuple[float, ...]

    def __repr__(self) -> str:
        return f"{self.section.name}, {self.section.train}, buffers {self.buffer_ratios}"


@st.composite
def trains(draw: st.DrawFn) -> Vehicle:
    """A train of 60 to 2000 t with any brakes, with or without limits of adhesion and acceleration."""
    mass_kg = draw(st.floats(6e4, 2e6))
    force_n = mass_kg * draw(st.floats(0.15, 1.2))
    power_w = force_n * draw(st.floats(5.0, 40.0))
    electric = draw(st.sampled_from((0.0, 0.3, 1.0)))
    friction_n = mass_kg * draw(st.floats(0.5, 1.2)) if electric < 1.0 or draw(st.booleans()) else 0.0
    return Vehicle(
        id="random",
        name="random",
        source="random",
        mass_kg=mass_kg,
        rotating_mass_ratio=draw(st.floats(0.0, 0.2)),
        train_length_m=draw(st.sampled_from((0.0, 150.0, 400.0))),
        max_speed_mps=draw(st.floats(15.0, TOP_MPS)),
        resistance=Resistance(
            c0_n=mass_kg * draw(st.floats(0.005, 0.03)),
            c1_n_per_mps=mass_kg * draw(st.floats(-5e-5, 5e-4)),
            c2_n_per_mps2=mass_kg * draw(st.floats(5e-6, 5e-5)),
        ),
        traction=EffortEnvelope(max_force_n=force_n, max_power_w=power_w),
        electric_brake=EffortEnvelope(max_force_n=electric * force_n, max_power_w=electric * power_w),
        friction_brake_force_n=friction_n,
        brake_policy=BrakePolicy.BLENDED if friction_n else BrakePolicy.ELECTRIC,
        max_acceleration_mps2=draw(st.sampled_from((np.inf, 0.6))),
        adhesive_mass_kg=draw(st.sampled_from((np.inf, 0.5 * mass_kg))),
        losses={Level.OWN: draw(efficiencies()), Level.L3: draw(maps(force_n))},
    )


def efficiencies() -> st.SearchStrategy[EfficiencyLoss]:
    """Constant efficiencies with or without an idle loss."""
    return st.builds(
        EfficiencyLoss,
        traction_ratio=st.floats(0.0, 0.5),
        brake_ratio=st.floats(0.0, 0.6),
        idle_w=st.sampled_from((0.0, 3e4)),
    )


@st.composite
def maps(draw: st.DrawFn, force_n: float) -> LossModel:
    """A non-convex loss map with jumps and dents in speed and force."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    speed_mps, steps = np.arange(0.0, TOP_MPS + 2.1, 2.0), np.arange(-12, 13)
    forces_n = np.asarray(steps * force_n / 10.0, dtype=np.float64)
    copper = rng.uniform(0.05, 0.5) * force_n * (forces_n / force_n) ** 2 * 10.0
    iron = rng.uniform(0.0, 0.1) * force_n * np.abs(forces_n[None, :] / force_n) * speed_mps[:, None]
    dents = rng.uniform(0.6, 1.4, (len(speed_mps), len(steps)))
    loss_w = (0.3 * force_n + copper[None, :] + iron) * dents
    return LossMap(name="random", speed_mps=speed_mps, force_n=forces_n, loss_w_table=loss_w)


@st.composite
def routes(draw: st.DrawFn) -> Route:
    """A line of 0.3 to 4 km with limits, gradients to 35 ‰ and every kind of supply."""
    length_m = draw(st.floats(300.0, 4000.0))
    places = [0.0, *(k / 20 for k in sorted(draw(st.lists(st.integers(1, 19), max_size=5, unique=True))))]
    limits = [(place * length_m, draw(st.floats(8.0, TOP_MPS))) for place in places]
    grades = [(place * length_m, draw(st.floats(-0.035, 0.035))) for place in places]
    route = make_route(length_m, limits, grades)
    receptivity = Stretches(
        start_m=np.array([0.0, 0.5 * length_m]),
        value=np.array([draw(st.sampled_from((0.0, 0.5, 1.0))), draw(st.sampled_from((0.3, 1.0)))]),
    )
    zones = [Zone(start_m=place * length_m, length_m=0.05 * length_m) for place in (0.4, 0.7)]
    return replace(
        route,
        receptivity_ratio=receptivity,
        neutral_sections=tuple(zones[:1]) if draw(st.booleans()) else (),
        no_regeneration=tuple(zones[1:]) if draw(st.booleans()) else (),
    )


@st.composite
def posed_sections(draw: st.DrawFn, levels: tuple[Level, ...] = LEVELS) -> Posed:
    """A feasible section, with some buffers from almost none to more than in any timetable."""
    route, train = draw(routes()), draw(trains())
    level = draw(st.sampled_from(levels))
    ends = st.sampled_from((0.0, 0.0, 1.0, 5.0))
    options = SectionOptions(start_speed_mps=draw(ends), end_speed_mps=draw(ends), point_mass=draw(st.booleans()))
    try:
        section = build_section(route, train, level=level, options=options)
    except InfeasibleError:
        assume(False)
    buffers = draw(st.lists(st.sampled_from((0.001, 0.01, 0.05, 0.15, 0.5, 3.0)), min_size=2, max_size=2, unique=True))
    return Posed(section, tuple(sorted(buffers)))
