"""Which restrictions a section is planned with: those that some part of the train meets."""

from __future__ import annotations

import pytest

from das.cab.situation import Situation
from das.domain.restriction import Restriction
from tests.support.small_trips import LENGTH_M, LINE, TRAIN


@pytest.mark.parametrize(
    ("start_m", "point_mass", "met"),
    [
        (1_000.0, False, True),
        (1_000.0 + 0.5 * LENGTH_M, False, True),  # The head has left it, the tail has not.
        (1_000.0 + LENGTH_M - 1.0, False, True),
        (1_000.0 + LENGTH_M + 1.0, False, False),
        (1_000.0 + 0.5 * LENGTH_M, True, False),
    ],
)
def test_a_restriction_counts_until_the_tail_of_a_train_that_departs_has_left_it(
    start_m: float, point_mass: bool, met: bool
) -> None:
    restriction = Restriction(start_m=800.0, end_m=1_000.0, limit_mps=10.0)
    ahead = Restriction(start_m=4_000.0, end_m=4_500.0, limit_mps=20.0)
    beyond = Restriction(start_m=6_000.0, end_m=7_000.0, limit_mps=20.0)
    known = Situation(route=LINE, vehicle=TRAIN, point_mass=point_mass, restrictions=(beyond, ahead, restriction))
    assert known.between(start_m, 5_000.0).restrictions == ((restriction, ahead) if met else (ahead,))


def test_a_section_from_a_stop_keeps_the_speed_under_its_tail() -> None:
    restriction = Restriction(start_m=4_800.0, end_m=5_000.0, limit_mps=10.0)
    section = (
        Situation(route=LINE, vehicle=TRAIN, restrictions=(restriction,))
        .between(5_000.0, 9_000.0)
        .section(5_000.0, 9_000.0)
    )
    under = section.node_m < 5_000.0 + LENGTH_M
    assert under.any()
    assert section.allowed_mps[under].max() <= 10.0 + 1e-9
    assert section.allowed_mps[~under].max() > 20.0
