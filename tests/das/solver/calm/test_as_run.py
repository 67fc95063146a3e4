"""What phases say is what the run does: brakes where limits brake it, the speeds that it holds, no idle brakes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from das.solver.calm.as_run import phases_as_run, speeds_as_held
from das.solver.calm.notches import NotchKind
from das.solver.calm.phases import Phase
from das.solver.calm.run_at_nodes import RunAtNodes

Floats = NDArray[np.float64]
HOLD, COAST, BRAKE, TRACTION = NotchKind.HOLD, NotchKind.COAST, NotchKind.BRAKE, NotchKind.TRACTION
ENVELOPE = np.array([30.0, 30, 30, 30, 26, 22, 20, 20, 20, 20, 20])
"""The highest speeds: a limit of 20 m/s is braked for between nodes 3 and 6."""
ON_IT = np.array([24.0, 24, 24, 24, 24, 22, 20, 20, 20, 20, 20])
"""A run that meets the braking curve between nodes 4 and 5 and holds the limit."""


WEAK = np.array([24.0, 24, 24, 24, 23, 22, 20, 20, 20, 20, 20])
EARLY = np.array([24.0, 24, 24, 24, 23.9, 22, 20, 20, 20, 20, 20])
"""Two runs whose brake is too weak to keep the limit: they meet the braking curve between nodes 4 and 5."""
STEP_M = np.full(10, 500.0)


def as_run(
    phases: list[Phase], speeds: Floats = ON_IT, curve: tuple[int, ...] = (), envelope: Floats = ENVELOPE
) -> list[Phase]:
    """The phases as a run has them; those numbered in `curve` brake along the braking curve."""
    kinds = np.array([NotchKind.CURVE if k in curve else one.kind for k, one in enumerate(phases)])
    return list(phases_as_run(tuple(phases), kinds, RunAtNodes.of(speeds, envelope, STEP_M), 0.6))


def test_where_a_limit_brakes_the_run_a_brake_is_put_in() -> None:
    found = as_run([Phase(HOLD, 0.0, 0, 24.0)])
    assert found == [Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.0, 4, 20.0), Phase(HOLD, 0.0, 6, 20.0)]


def test_a_brake_that_begins_too_late_begins_where_the_run_meets_the_curve() -> None:
    found = as_run([Phase(COAST, 0.0, 0, 24.0), Phase(BRAKE, 0.0, 5, 20.0), Phase(HOLD, 0.0, 6, 20.0)], curve=(1,))
    assert [one.begin for one in found] == [0, 4, 6]


def test_a_brake_of_too_little_effort_begins_earlier() -> None:
    """The run is braked by the limit where the effort is not enough."""
    found = as_run([Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.3, 3, 20.0), Phase(HOLD, 0.0, 6, 20.0)], WEAK)
    assert [(one.kind, one.share) for one in found] == [(HOLD, 0.0), (BRAKE, 0.3), (HOLD, 0.0)]
    assert 0 < found[1].begin < 3


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


def test_a_brake_of_too_little_effort_that_may_not_begin_earlier_goes_on_along_the_curve() -> None:
    """It would have to begin before the phase before it does."""
    found = as_run([Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.3, 3, 20.0), Phase(HOLD, 0.0, 6, 20.0)], EARLY)
    assert [(one.kind, one.begin) for one in found] == [(HOLD, 0), (BRAKE, 3), (BRAKE, 4), (HOLD, 6)]


def test_what_follows_a_limit_that_brakes_the_run_begins_behind_it() -> None:
    found = as_run([Phase(HOLD, 0.0, 0, 24.0), Phase(COAST, 0.0, 5, 18.0)])
    assert found == [Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.0, 4, 20.0), Phase(COAST, 0.0, 6, 18.0)]


def test_nothing_follows_a_limit_that_brakes_the_run_to_the_end() -> None:
    """No phase begins where the section ends."""
    falls, ends = np.append(ENVELOPE[:-1], 15.0), np.append(ON_IT[:-1], 15.0)
    found = as_run(
        [Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.0, 4, 20.0), Phase(HOLD, 0.0, 6, 20.0)], ends, (1,), falls
    )
    assert found[-1] == Phase(BRAKE, 0.0, 9, 15.0)


def test_a_brake_that_only_holds_a_speed_at_first_begins_later() -> None:
    found = as_run([Phase(HOLD, 0.0, 0, 24.0), Phase(BRAKE, 0.0, 2, 20.0), Phase(HOLD, 0.0, 6, 20.0)], curve=(1,))
    assert [one.begin for one in found] == [0, 4, 6]


RISES = np.array([20.0, 20, 20, 20, 20, 30, 30, 30, 30, 30, 30])
"""A limit of 20 m/s, left at node 4."""
LIMITED = np.array([15.0, 18, 20, 20, 20, 22, 24, 25, 25, 25, 25])
"""A run that this limit holds between nodes 2 and 4."""


def test_a_limit_that_holds_the_train_below_the_speed_to_go_to_is_held() -> None:
    found = as_run([Phase(TRACTION, 0.8, 0, 25.0), Phase(HOLD, 0.0, 7, 25.0)], LIMITED, envelope=RISES)
    assert found == [
        Phase(TRACTION, 0.8, 0, 20.0),
        Phase(HOLD, 0.0, 2, 20.0),
        Phase(TRACTION, 0.8, 4, 25.0),
        Phase(HOLD, 0.0, 7, 25.0),
    ]


def test_a_train_much_slower_than_the_speed_to_hold_accelerates_to_it() -> None:
    """With the share of traction with which it gets back to a speed."""
    speeds = np.array([15.0, 18, 20, 22, 24, 24, 24, 24, 24, 24, 24])
    free = np.full(11, 30.0)
    found = as_run([Phase(HOLD, 0.0, 0, 24.0)], speeds, envelope=free)
    assert found == [Phase(TRACTION, 0.6, 0, 24.0), Phase(HOLD, 0.0, 4, 24.0)]


def test_a_train_hardly_slower_than_the_speed_to_hold_is_told_to_hold_it() -> None:
    speeds = np.array([23.5, 23.8, 24, 24, 24, 24, 24, 24, 24, 24, 24])
    said = [Phase(TRACTION, 1.0, 0, 24.0), Phase(HOLD, 0.0, 2, 24.0)]
    assert as_run(said, speeds, envelope=np.full(11, 30.0)) == [Phase(HOLD, 0.0, 0, 24.0)]


def test_a_train_that_rolls_down_to_the_speed_to_hold_coasts() -> None:
    speeds = np.array([24.0, 23, 22, 21, 20, 20, 20, 20, 20, 20, 20])
    found = as_run([Phase(HOLD, 0.0, 0, 20.0)], speeds, envelope=np.full(11, 30.0))
    assert found == [Phase(COAST, 0.0, 0, 20.0), Phase(HOLD, 0.0, 4, 20.0)]
    longer = as_run([Phase(COAST, 0.0, 0, 22.0), Phase(HOLD, 0.0, 2, 20.0)], speeds, envelope=np.full(11, 30.0))
    assert longer == [Phase(COAST, 0.0, 0, 22.0), Phase(HOLD, 0.0, 4, 20.0)]


def test_an_acceleration_that_a_limit_ends_at_once_begins_where_the_limit_ends() -> None:
    speeds = np.array([20.0, 19.95, 19.9, 20, 22, 24, 25, 25, 25, 25, 25])
    envelope = np.array([20.0, 20, 20, 20, 30, 30, 30, 30, 30, 30, 30])
    short_m = np.array([500.0, 500, 100, *[500.0] * 7])
    said = (Phase(COAST, 0.0, 0, 19.9), Phase(TRACTION, 1.0, 2, 25.0), Phase(HOLD, 0.0, 6, 25.0))
    kinds = np.array([int(one.kind) for one in said])
    found = phases_as_run(said, kinds, RunAtNodes.of(speeds, envelope, short_m), 0.6)
    assert [one.begin for one in found] == [0, 3, 6]


def test_another_effort_waits_for_the_limit_of_its_speed() -> None:
    """One change where the limit rises, not one before it; where it rises too late, or at once, it stays as it is."""
    speeds = np.array([5.0, 10, 14, 17, 19, 20, 22, 24, 25, 25, 25])
    said = [Phase(TRACTION, 1.0, 0, 25.0), Phase(TRACTION, 0.6, 3, 25.0), Phase(HOLD, 0.0, 8, 25.0)]

    def begins(rises: int) -> list[int]:
        envelope = np.where(np.arange(11) < rises, 20.0, 30.0)
        run = RunAtNodes.of(np.minimum(speeds, envelope), envelope, np.full(10, 100.0))
        return [one.begin for one in speeds_as_held(said, run, 0.6)][:2]

    assert [begins(rises) for rises in (1, 3, 5)] == [[0, 3], [0, 3], [0, 5]]
    late = RunAtNodes.of(np.minimum(speeds, 20.0), np.full(11, 20.0), np.full(10, 100.0))
    assert speeds_as_held(said, late, 0.6)[1].begin == 3


@pytest.mark.parametrize(("step_m", "kept"), [(60.0, False), (500.0, True)])
def test_an_acceleration_before_a_brake_is_left_out_where_it_gains_no_second(step_m: float, *, kept: bool) -> None:
    speeds = np.array([20.0, 20, 20, 21, 22, 23, 20, 17, 14, 14, 14])
    said = [Phase(HOLD, 0.0, 0, 20.0), Phase(TRACTION, 1.0, 2, 23.0), Phase(BRAKE, 0.0, 5, 14.0)]
    run = RunAtNodes.of(speeds, np.full(11, 30.0), np.full(10, step_m))
    assert (TRACTION in [one.kind for one in speeds_as_held(said, run, 0.6)]) is kept


def test_speeds_that_no_driver_tells_apart_are_one() -> None:
    speeds = np.array([10.0, 15, 20, 23.9, 24, 24, 24, 24, 24, 24, 24])
    said = [Phase(TRACTION, 1.0, 0, 23.7), Phase(HOLD, 0.0, 3, 24.0), Phase(HOLD, 0.0, 6, 24.2)]
    assert as_run(said, speeds, envelope=np.full(11, 30.0)) == [
        Phase(TRACTION, 1.0, 0, 24.0),
        Phase(HOLD, 0.0, 3, 24.0),
    ]
