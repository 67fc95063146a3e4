"""The moves of a tube against the trajectory that they are part of, which is calculated from its speeds alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.route import Zone
from das.offline.refinement import TubeSearch
from das.offline.tube_kernels import all_moves
from das.solver.section import build_section
from das.solver.solution import trajectory_on
from das.solver.state import State, fastest
from das.solver.tolerances import UNREACHABLE


@pytest.mark.parametrize("level", [Level.L1, Level.L3])
def test_moves_cost_what_their_trajectory_costs(level: Level) -> None:
    """Any path over the lines of a tube: energy and time between its knots; hills, limits and a neutral section."""
    route = replace(load_route("flat-6km"), neutral_sections=(Zone(start_m=2000.0, length_m=200.0),))
    section = build_section(route, load_vehicle("re460-ic"), level=level)
    state = State.at(section)
    run = fastest(section).trajectory
    search = TubeSearch(state, run.time_s)
    slower = np.concatenate(([0.0], 0.9 * run.v_mps[1:-1], [0.0]))
    tube = search.tube_around(slower, 0.5)
    moves = all_moves(tube, state.for_kernels, section.train, section.loss_params)

    line = np.random.default_rng(7).integers(0, 2 * tube.lines + 1, len(tube.knot)) - tube.lines
    line[[0, -1]] = 0
    knot = tube.knot
    at_knot = np.clip(tube.squared[knot] + line * tube.spacing, tube.low[knot], tube.high[knot]) - tube.squared[knot]
    behind = np.searchsorted(knot, np.arange(len(slower)))
    before = np.maximum(behind - 1, 0)
    beside = at_knot[before] + tube.share * (at_knot[behind] - at_knot[before])
    speeds = np.sqrt(np.clip(tube.squared + beside, tube.low, tube.high))
    path = trajectory_on(section, state, speeds)
    taken = np.arange(len(knot) - 1), line[:-1] + tube.lines, line[1:] + tube.lines
    possible = moves.energy_j[taken] < UNREACHABLE
    # A loss map does not cover what no train can do.
    path = replace(path, force_el_n=np.where(np.repeat(possible, np.diff(knot)), path.force_el_n, 0.0))
    energy_j = np.add.reduceat(path.input_j(path.loss_j(section.loss)), knot[:-1])
    time_s = np.diff(path.t_s[knot])

    assert 0.3 < possible.mean() < 1.0
    np.testing.assert_allclose(moves.energy_j[taken][possible], energy_j[possible], rtol=1e-8, atol=1.0)
    np.testing.assert_allclose(moves.time_s[taken][possible], time_s[possible], rtol=1e-10)
