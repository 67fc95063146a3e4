"""Which drives can be compared with their optima."""

from __future__ import annotations

import pytest

from sim.drive.above_optimum import AboveOptimum, SectionEnergy, why_not_comparable


@pytest.mark.parametrize(("beyond_s", "comparable"), [(0.0, True), (20.0, True), (104.0, False)])
def test_a_trip_that_needs_more_force_than_its_train_has_gets_no_figure(beyond_s: float, comparable: bool) -> None:
    each = [
        SectionEnergy(start="A", end="B", trip_s=200.0, driven_j=9e8, optimum_j=7e8, beyond_s=beyond_s),
        SectionEnergy(start="B", end="C", trip_s=200.0, driven_j=9e8, optimum_j=7e8),
    ]
    why_not = "" if comparable else "in 26 % of the time the trip needs more force than this train has"
    assert why_not_comparable(each) == why_not
    above = AboveOptimum.of(each, measured=False)
    assert (above.above_j is not None) is comparable
    assert (above.as_dict()["above_optimum_kwh"] is not None) is comparable


def test_nothing_driven_is_no_impossible_train() -> None:
    assert why_not_comparable([]) == ""
