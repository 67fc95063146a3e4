"""What phases say is what the run does: brakes where limits brake it, the speeds that it holds, no idle brakes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from das.solver.calm.as_run import phases_as_run
from das.solver.calm.notches import NotchKind
from das.solver.calm.phases import Phase

Floats = NDArray[np.float64]
HOLD, COAST, BRAKE, TRACTION = NotchKind.HOLD, NotchKind.COAST, NotchKind.BRAKE, NotchKind.TRACTION
ENVELOPE = np.array([30.0, 30, 30, 30, 26, 22, 20, 20, 20, 20, 20])
"""The highest speeds: a limit of 20 m/s is braked for between nodes 3 and 6."""
ON_IT = np.array([24.0, 24, 24, 24, 24, 22, 20, 20, 20, 20, 20])
"""A run that meets the braking curve between nodes 4 and 5 and holds the limit."""


def as_run(phases: list[Phase], speeds: Floats = ON_IT, curve: tuple[int, ...] = ()) -> list[Phase]:
    """The phases as a run has them; those numbered in `curve` brake along the braking curve."""
    kinds = np.array([NotchKind.CURVE if k in curve else one.kind for k, one in enumerate(phases)])
    return list(phases_as_run(tuple(phases), kinds, ENVELOPE, speeds))


def test_where_a_limit_brakes_the_run_a_brake_is_put_in() -> None:
    found = as_run([Phase(HOLD, 0.0, 0, 24.0)])
    assert found == [Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.0, 4, 20.0), Phase(HOLD, 0.0, 6, 24.0)]


def test_a_brake_that_begins_too_late_begins_where_the_run_meets_the_curve() -> None:
    found = as_run([Phase(COAST, 0.0, 0, 24.0), Phase(BRAKE, 0.0, 5, 20.0), Phase(HOLD, 0.0, 6, 20.0)], curve=(1,))
    assert [one.begin for one in found] == [0, 4, 6]


def test_a_brake_of_too_little_effort_becomes_one_along_the_curve() -> None:
    """The run is braked by the limit where the effort is not enough."""
    found = as_run([Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.3, 3, 20.0), Phase(HOLD, 0.0, 6, 20.0)])
    assert found[1:3] == [Phase(BRAKE, 0.3, 3, 20.0), Phase(BRAKE, 0.0, 4, 20.0)]


def test_a_brake_that_brakes_nothing_is_left_out() -> None:
    slow = np.full(11, 15.0)
    found = as_run([Phase(COAST, 0.0, 0, 15.0), Phase(BRAKE, 0.2, 3, 15.0), Phase(COAST, 0.0, 4, 14.0)], slow)
    assert found == [Phase(COAST, 0.0, 0, 14.0)]


def test_without_an_idle_brake_the_speed_is_held_on() -> None:
    slow = np.full(11, 15.0)
    found = as_run([Phase(HOLD, 0.0, 0, 15.0), Phase(BRAKE, 1.0, 3, 15.0), Phase(HOLD, 0.0, 4, 15.0)], slow)
    assert found == [Phase(HOLD, 0.0, 0, 15.0)]


def test_a_speed_downhill_that_is_never_reached_is_the_one_held() -> None:
    fast = np.full(11, 19.0)
    assert as_run([Phase(TRACTION, 1.0, 0, 12.0), Phase(HOLD, 0.0, 5, 18.0)], fast) == [
        Phase(TRACTION, 1.0, 0, 19.0),
        Phase(HOLD, 0.0, 5, 19.0),
    ]


def test_phases_that_say_it_already_stay_as_they_are() -> None:
    said = [Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.0, 4, 20.0), Phase(HOLD, 0.0, 6, 20.0)]
    assert as_run(said, curve=(1,)) == said
    assert as_run(as_run(said, curve=(1,)), curve=(1,)) == said


@pytest.mark.parametrize("begin", range(1, 10))
def test_begins_rise_strictly_wherever_the_brake_is(begin: int) -> None:
    phases = [Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.0, begin, 20.0)]
    places = [one.begin for one in as_run(phases, curve=(1,))]
    assert places == sorted(set(places))
