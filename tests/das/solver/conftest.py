"""The section that most tests of the solver share."""

from __future__ import annotations

import pytest

from das.domain.losses import EfficiencyLoss
from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solve import solve_front
from tests.support.making import make_route, make_train


@pytest.fixture(scope="session")
def hilly() -> Front:
    """A section of 12 km with limits, hills, resistance, power limit and losses: everything at once."""
    route = make_route(
        12_000.0,
        [(0.0, 30.0), (3_000.0, 22.0), (4_500.0, 40.0), (9_000.0, 25.0)],
        [(0.0, 0.0), (2_000.0, 0.010), (5_000.0, -0.012), (7_000.0, 0.0), (8_000.0, -0.004)],
    )
    loss = EfficiencyLoss.from_efficiencies(0.88, 0.85, 2e4)
    return solve_front(build_section(route, make_train(resistance=(1500.0, 20.0, 4.0), power_w=1.5e6, loss=loss)))
