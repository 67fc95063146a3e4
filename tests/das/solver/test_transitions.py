"""The transitions of all speeds of a node at once, against the landings and costs of one speed after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.domain.conditions import Conditions
from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.route import Zone
from das.domain.vehicle import BrakePolicy
from das.solver.kernels.tuples import Moves
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import DecisionGrid, empty_moves
from tests.support.closeness import assert_close
from tests.support.making import make_route
from tests.support.plain_solver import plain_transitions
from tests.support.transitions import all_moves

TRAIN = load_vehicle("re460-ic")
HILLY = make_route(3000.0, [(0.0, 30.0), (900.0, 20.0)], [(0.0, 0.0), (700.0, 0.02), (1500.0, -0.025), (2300.0, 0.0)])
FREE_END = SectionOptions(start_speed_mps=5.0, end_speed_mps=12.0)

SECTIONS = {
    "a loss map": build_section(HILLY, TRAIN, level=Level.L3),
    "constant efficiencies": build_section(HILLY, TRAIN, level=Level.L1),
    "brakes that dissipate": build_section(HILLY, TRAIN, level=Level.L0_NOREG),
    "no friction brake": build_section(HILLY, replace(TRAIN, brake_policy=BrakePolicy.ELECTRIC), level=Level.L3),
    "passed at speed": build_section(HILLY, TRAIN, level=Level.L3, options=FREE_END),
    "brake resistors": build_section(Conditions(receptivity_ratio=0.0).line(HILLY), TRAIN, level=Level.L3),
    "neutral": build_section(
        replace(HILLY, neutral_sections=(Zone(start_m=1200.0, length_m=200.0),)), TRAIN, level=Level.L2
    ),
    "no regeneration": build_section(
        replace(HILLY, no_regeneration=(Zone(start_m=1600.0, length_m=500.0),)), TRAIN, level=Level.L3
    ),
    "adhesion": build_section(HILLY, replace(TRAIN, adhesive_mass_kg=60e3), level=Level.L3),
    "a gentle train": build_section(
        HILLY, replace(TRAIN, max_acceleration_mps2=0.3, max_deceleration_mps2=0.4), level=Level.L1
    ),
}


def one_speed_after_the_other(section: Section) -> Moves:
    grid = DecisionGrid.of(section)
    nodes = len(grid.node_m) - 1
    moves = empty_moves(nodes, section.speed_steps + 1)
    plain_transitions(0, nodes, grid.line, grid.bounds, section.speed_steps, section.train, section.loss_params, moves)
    return moves


@pytest.mark.parametrize("case", SECTIONS)
def test_moves_are_those_of_one_speed_after_the_other(case: str) -> None:
    """Another order of sums moves a cost by 1e-12 of it; a landing on the very end of the grid may be in or out."""
    found, expected = all_moves(SECTIONS[case]), one_speed_after_the_other(SECTIONS[case])
    same = found.filled == expected.filled
    assert same.mean() > 0.99
    assert (np.abs(found.filled - expected.filled) <= 1).all()
    landing = np.arange(found.time_s.shape[2])
    used = same[..., np.newaxis] & (landing < found.filled[..., np.newaxis])
    assert_close(found.energy_j[used], expected.energy_j[used], rel=1e-9, absolute=1e-3)
    assert_close(found.time_s[used], expected.time_s[used], rel=1e-6, absolute=1e-12)
    assert_close(
        found.target[used] + found.weight[used],
        expected.target[used] + expected.weight[used],
        absolute=1e-4,
    )


def test_the_same_section_has_the_same_bytes_however_it_is_cut_into_parts() -> None:
    section = SECTIONS["a loss map"]
    grid, whole = DecisionGrid.of(section), all_moves(section)
    nodes, states = whole.filled.shape
    parts = empty_moves(nodes, states)
    for first, last in ((0, 3), (3, nodes - 4), (nodes - 4, nodes)):
        grid.fill(first, last, 0, parts)
    filled = np.arange(whole.time_s.shape[2]) < whole.filled[..., np.newaxis]
    for name in ("time_s", "energy_j", "target", "weight"):
        assert (getattr(whole, name)[filled] == getattr(parts, name)[filled]).all()
    assert (whole.filled == parts.filled).all()
