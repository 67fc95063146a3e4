"""The options of a section."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.domain.vehicle import BrakePolicy
from das.solver.section import SectionOptions, build_section
from das.solver.solve import solve_front
from das.table import section_sha256
from tests.support.making import flat, make_route, make_train


def test_decision_steps_are_as_short_as_asked_and_never_longer_than_usual() -> None:
    usual = build_section(flat(9_000.0), make_train())
    options = {step_m: SectionOptions(longest_step_m=step_m) for step_m in (25.0, 60.0, 150.0)}
    sections = {step_m: build_section(flat(9_000.0), make_train(), options=one) for step_m, one in options.items()}
    steps_m = {step_m: np.diff(one.node_m[one.decision]) for step_m, one in sections.items()}
    assert steps_m[25.0].max() <= 25.0 + 1e-6
    assert 25.0 < steps_m[60.0].max() <= 60.0 + 1e-6
    assert np.array_equal(sections[150.0].node_m, usual.node_m)
    # Fronts that are kept by what determines them are kept apart for these grids.
    hashes = [section_sha256(one) for one in (usual, *sections.values())]
    assert hashes[3] == hashes[0]
    assert len(set(hashes)) == 3


def test_shorter_decision_steps_need_less_energy_where_the_limit_changes_often() -> None:
    rng = np.random.default_rng(5)
    limits = [(at, float(rng.uniform(12.0, 40.0))) for at in np.arange(0.0, 4_000.0, 100.0)]
    route, train = make_route(4_000.0, limits), make_train(resistance=(1500.0, 20.0, 4.0), power_w=2e6)
    usual = solve_front(build_section(route, train))
    time_s = 1.05 * usual.fastest().time_s
    fine = solve_front(build_section(route, train, options=SectionOptions(longest_step_m=12.5)))
    assert fine.trajectory(time_s).balance.input < usual.trajectory(time_s).balance.input


def test_the_options_of_a_section() -> None:
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
