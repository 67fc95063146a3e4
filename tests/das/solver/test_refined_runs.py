"""Runs of one section refined together, against each refined by itself."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from das.domain.files.load import load_vehicle
from das.domain.losses import Level
from das.solver.front import Front
from das.solver.refinement import TABLE, TubeSearch, refined, refined_runs
from das.solver.section import build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from tests.support.making import make_route

BUFFERS_PERCENT = (12.0, 0.0, 11.0, 10.0, 11.0, 10.5)
"""In no order, one twice; those between 10 and 12 are near enough to their neighbours to begin with them."""


@cache
def front() -> Front:
    route = make_route(800.0, [(0.0, 25.0)], [(0.0, 0.004), (400.0, -0.006)])
    return solve_front(build_section(route, load_vehicle("re460-ic"), level=Level.L2))


@cache
def given() -> list[Solution]:
    least_s = front().fastest().time_s
    return [front().trajectory(least_s * (1 + buffer / 100)) for buffer in BUFFERS_PERCENT]


def test_runs_refined_together_are_as_good_as_each_alone() -> None:
    told: list[int] = []
    found = refined_runs(given(), TABLE, watch=told.append)
    assert sorted(told) == list(range(len(given())))
    for before, after in zip(given(), found, strict=True):
        assert after.feasible
        assert after.time_s <= before.time_s
        assert after.ledger.input <= before.ledger.input
        assert after.ledger.input <= refined(before).ledger.input * (1 + 2e-4)
        assert after.gap_ratio < 1e-3
    again = refined_runs(given(), TABLE)
    for one, other in zip(found, again, strict=True):
        np.testing.assert_array_equal(one.trajectory.v_mps, other.trajectory.v_mps)


def test_neighbours_spare_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside finished neighbours a run is found in the three passes of a narrow tube."""
    counted = []
    pass_of = TubeSearch._one_pass

    def one_pass(self: TubeSearch, run: object, width: float) -> object:
        counted.append(self.settings)
        return pass_of(self, run, width)

    monkeypatch.setattr(TubeSearch, "_one_pass", one_pass)
    refined_runs(given(), TABLE)
    assert counted.count(TABLE.between) >= TABLE.between.passes
    assert counted.count(TABLE.alone) >= TABLE.alone.passes


def test_a_budget_that_is_over_leaves_the_runs_that_were_given() -> None:
    found = refined_runs(given(), is_over=lambda: True)
    assert all(one is other for one, other in zip(found, given(), strict=True))
    assert refined_runs([]) == []
