"""Settings of the solver: their defaults, and the constants that the kernels read."""

from __future__ import annotations

from dataclasses import asdict, fields, replace

import pytest

from das.domain.vehicle import BrakePolicy
from das.solver import tolerances as tol
from das.solver.kernels.landings import LANDINGS
from das.solver.section import SectionOptions, build_section
from das.solver.tolerances import GridSettings, JourneySettings, LadderSettings, SolverSettings, Tolerances
from tests.support.making import flat, make_train


def test_defaults() -> None:
    assert asdict(GridSettings()) == {
        "max_step_m": 100.0,
        "shortest_max_step_m": 25.0,
        "steps_of_a_section": 80,
        "stop_offsets_m": (2.0, 5.0, 10.0, 20.0, 40.0, 70.0, 110.0, 160.0, 220.0, 300.0),
        "speed_steps": 160,
        "short_speed_steps": 320,
        "few_nodes": 200,
        "landings_effort": 17,
        "landings_brake": 6,
        "substep_speed_ratio": 0.005,
        "substep_drift_mps": 0.01,
        "max_substeps": 80,
    }
    assert asdict(LadderSettings()) == {
        "size": 64,
        "lowest_ratios": (0.0, 0.0005, 0.002),
        "low_ratio": 0.005,
        "high_ratio": 10.0,
        "highest_ratios": (20.0, 45.0, 100.0),
        "idle_ratios": (0.99, 0.95, 0.8, 0.5, 0.2),
    }
    assert asdict(JourneySettings()) == {
        "fronts_bytes": 400_000_000,
        "time_tolerance_s": 0.002,
        "passing_speed_step_mps": 1e-6,
        "passing_band_ratio": 1e-3,
    }
    assert asdict(Tolerances()) == {
        "min_step_m": 1e-3,
        "speed_mps": 1e-6,
        "time_s": 0.02,
        "unreachable_j": 1e16,
        "infeasible_j": 1e30,
        "smallest_share": 1e-9,
        "crest_mps": 0.05,
        "creep_mps": 0.1,
    }


def test_every_setting_is_a_constant_of_the_kernels() -> None:
    """Numba compiles constants: none of the settings may be missing among them, or differ."""
    groups = [getattr(SolverSettings(), field.name) for field in fields(SolverSettings)]
    values = sorted(str(value) for group in groups for value in asdict(group).values())
    constants = sorted(str(value) for name, value in vars(tol).items() if name.isupper())
    assert constants == values


def test_the_landings_of_the_kernels_follow_the_settings() -> None:
    assert LANDINGS == tol.LANDINGS_EFFORT + tol.LANDINGS_BRAKE + 2


def test_the_options_of_a_section() -> None:
    assert SectionOptions() == SectionOptions(start_speed_mps=0.0, end_speed_mps=0.0, point_mass=False, brakes=None)
    section = build_section(flat(1_000.0), make_train())
    assert (section.start_speed_mps, section.end_speed_mps, section.brakes) == (0.0, 0.0, BrakePolicy.ELECTRIC)
    options = SectionOptions(start_speed_mps=3.0, end_speed_mps=4.0, brakes=BrakePolicy.FRICTION)
    other = build_section(flat(1_000.0), make_train(), start_m=100.0, end_m=900.0, options=options)
    assert (other.start_speed_mps, other.end_speed_mps, other.brakes) == (3.0, 4.0, BrakePolicy.FRICTION)
    assert (other.start_m, other.end_m) == (100.0, 900.0)
    assert other.train.brakes_dissipate
    with pytest.raises(TypeError):
        SectionOptions(3.0)  # type: ignore[misc]


@pytest.mark.parametrize(("point_mass", "expected_m"), [(False, 260.0), (True, 0.0)])
def test_a_point_mass_has_no_length(point_mass: bool, expected_m: float) -> None:
    train = replace(make_train(), train_length_m=260.0)
    section = build_section(flat(1_000.0), train, options=SectionOptions(point_mass=point_mass))
    assert section.train_length_m == expected_m
