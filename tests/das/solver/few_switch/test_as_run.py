"""What phases say is what the run does: brakes where limits brake it, the speeds that it holds, no idle brakes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from das.solver.few_switch.as_run import phases_as_run, speeds_as_held, with_all_brakes, with_boards
from das.solver.few_switch.few_switch import NotchRegime
from das.solver.few_switch.phases import Phase, RunAtNodes

Floats = NDArray[np.float64]
HOLD, COAST, BRAKE, TRACTION = NotchRegime.HOLD, NotchRegime.COAST, NotchRegime.BRAKE, NotchRegime.TRACTION
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
    kinds = np.array([NotchRegime.CURVE if k in curve else one.kind for k, one in enumerate(phases)])
    return list(phases_as_run(tuple(phases), kinds, RunAtNodes.of(speeds, envelope, STEP_M), 0.6))


SLOW, FAST, FREE = np.full(11, 15.0), np.full(11, 19.0), np.full(11, 30.0)
RISES = np.array([20.0, 20, 20, 20, 20, 30, 30, 30, 30, 30, 30])
"""A limit of 20 m/s, left at node 4."""
LIMITED = np.array([15.0, 18, 20, 20, 20, 22, 24, 25, 25, 25, 25])
"""A run that this limit holds between nodes 2 and 4."""
LATE = np.array([15.0, 18, 20, 22, 24, 24, 24, 24, 24, 24, 24])
NEARLY = np.array([23.5, 23.8, 24, 24, 24, 24, 24, 24, 24, 24, 24])
DOWN = np.array([24.0, 23, 22, 21, 20, 20, 20, 20, 20, 20, 20])
UP = np.array([10.0, 15, 20, 23.9, 24, 24, 24, 24, 24, 24, 24])


def hold(begin: int, target_mps: float) -> Phase:
    return Phase(HOLD, 0.0, begin, target_mps)


def coast(begin: int, target_mps: float) -> Phase:
    return Phase(COAST, 0.0, begin, target_mps)


def brake(begin: int, target_mps: float, share: float = 0.0) -> Phase:
    return Phase(BRAKE, share, begin, target_mps)


def drive(begin: int, target_mps: float, share: float = 1.0) -> Phase:
    return Phase(TRACTION, share, begin, target_mps)


CASES: dict[str, tuple[Floats, Floats, list[Phase], list[Phase]]] = {
    "where a limit brakes the run a brake is put in": (
        ON_IT, ENVELOPE, [hold(0, 24.0)], [hold(0, 24.0), brake(4, 20.0), hold(6, 20.0)]
    ),
    "a brake that brakes nothing is left out": (
        SLOW, ENVELOPE, [coast(0, 15.0), brake(3, 15.0, 0.2), coast(4, 14.0)], [coast(0, 14.0)]
    ),
    "without an idle brake the speed is held on": (
        SLOW, ENVELOPE, [hold(0, 15.0), brake(3, 15.0, 1.0), hold(4, 15.0)], [hold(0, 15.0)]
    ),
    "a speed downhill that is never reached is the one held": (
        FAST, ENVELOPE, [drive(0, 12.0), hold(5, 18.0)], [drive(0, 19.0), hold(5, 19.0)]
    ),
    "what follows a limit that brakes the run begins behind it": (
        ON_IT, ENVELOPE, [hold(0, 24.0), coast(5, 18.0)], [hold(0, 24.0), brake(4, 20.0), coast(6, 18.0)]
    ),
    "a limit that holds the train below the speed to go to is held": (
        LIMITED, RISES, [drive(0, 25.0, 0.8), hold(7, 25.0)],
        [drive(0, 20.0, 0.8), hold(2, 20.0), drive(4, 25.0, 0.8), hold(7, 25.0)],
    ),
    "a train much slower than the speed to hold accelerates with the share that gets back to a speed": (
        LATE, FREE, [hold(0, 24.0)], [drive(0, 24.0, 0.6), hold(4, 24.0)]
    ),
    "a train hardly slower than the speed to hold holds it": (
        NEARLY, FREE, [drive(0, 24.0), hold(2, 24.0)], [hold(0, 24.0)]
    ),
    "a train that rolls down to the speed to hold coasts": (
        DOWN, FREE, [hold(0, 20.0)], [coast(0, 20.0), hold(4, 20.0)]
    ),
    "a train that coasts goes on coasting to the speed to hold": (
        DOWN, FREE, [coast(0, 22.0), hold(2, 20.0)], [coast(0, 22.0), hold(4, 20.0)]
    ),
    "speeds that no driver tells apart are one": (
        UP, FREE, [drive(0, 23.7), hold(3, 24.0), hold(6, 24.2)], [drive(0, 24.0), hold(3, 24.0)]
    ),
}  # fmt: skip


@pytest.mark.parametrize(("speeds", "envelope", "said", "found"), CASES.values(), ids=CASES)
def test_phases_say_what_the_run_does(speeds: Floats, envelope: Floats, said: list[Phase], found: list[Phase]) -> None:
    assert as_run(said, speeds, envelope=envelope) == found


@pytest.mark.parametrize(("first", "begin"), [(coast(0, 24.0), 5), (hold(0, 24.0), 2)])
def test_a_brake_begins_where_the_run_meets_the_curve(first: Phase, begin: int) -> None:
    """One that begins too late begins earlier, and one that only holds a speed at first begins later."""
    found = as_run([first, brake(begin, 20.0), hold(6, 20.0)], curve=(1,))
    assert [one.begin for one in found] == [0, 4, 6]


def test_a_brake_of_too_little_effort_begins_earlier() -> None:
    """The run is braked by the limit where the effort is not enough."""
    found = as_run([hold(0, 24.0), brake(3, 20.0, 0.3), hold(6, 20.0)], WEAK)
    assert [(one.kind, one.share) for one in found] == [(HOLD, 0.0), (BRAKE, 0.3), (HOLD, 0.0)]
    assert 0 < found[1].begin < 3


def test_phases_that_say_it_already_stay_as_they_are() -> None:
    said = [hold(0, 24.0), brake(4, 20.0), hold(6, 20.0)]
    assert as_run(said, curve=(1,)) == said
    assert as_run(as_run(said, curve=(1,)), curve=(1,)) == said


@pytest.mark.parametrize("begin", range(1, 10))
def test_begins_rise_strictly_wherever_the_brake_is(begin: int) -> None:
    phases = [hold(0, 24.0), brake(begin, 20.0)]
    places = [one.begin for one in as_run(phases, curve=(1,))]
    assert places == sorted(set(places))


def test_a_brake_of_too_little_effort_that_may_not_begin_earlier_goes_on_along_the_curve() -> None:
    """It would have to begin before the phase before it does."""
    found = as_run([hold(0, 24.0), brake(3, 20.0, 0.3), hold(6, 20.0)], EARLY)
    assert [(one.kind, one.begin) for one in found] == [(HOLD, 0), (BRAKE, 3), (BRAKE, 4), (HOLD, 6)]


def test_nothing_follows_a_limit_that_brakes_the_run_to_the_end() -> None:
    """No phase begins where the section ends."""
    falls, ends = np.append(ENVELOPE[:-1], 15.0), np.append(ON_IT[:-1], 15.0)
    found = as_run([hold(0, 24.0), brake(4, 20.0), hold(6, 20.0)], ends, (1,), falls)
    assert found[-1] == brake(9, 15.0)


def test_an_acceleration_that_a_limit_ends_at_once_begins_where_the_limit_ends() -> None:
    speeds = np.array([20.0, 19.95, 19.9, 20, 22, 24, 25, 25, 25, 25, 25])
    envelope = np.array([20.0, 20, 20, 20, 30, 30, 30, 30, 30, 30, 30])
    short_m = np.array([500.0, 500, 100, *[500.0] * 7])
    said = (coast(0, 19.9), drive(2, 25.0), hold(6, 25.0))
    kinds = np.array([int(one.kind) for one in said])
    found = phases_as_run(said, kinds, RunAtNodes.of(speeds, envelope, short_m), 0.6)
    assert [one.begin for one in found] == [0, 3, 6]


def test_a_limit_that_begins_where_an_acceleration_would_is_held_instead() -> None:
    """Behind a brake the phase would begin a few metres before the limit that holds the train for long."""
    speeds = np.array([24.0, 20, 20, 20, 20, 20, 20, 22, 24, 25, 25])
    envelope = np.array([30.0, 21, 20, 20, 20, 20, 20, 30, 30, 30, 30])
    run = RunAtNodes.of(speeds, envelope, np.array([500.0, 10, *[500.0] * 8]))
    found = speeds_as_held([brake(0, 20.0), drive(1, 25.0), hold(9, 25.0)], run, 0.6)
    assert found[:3] == [brake(0, 20.0), hold(1, 20.0), drive(6, 25.0)]


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


def test_a_brake_for_a_limit_that_was_told_too_late_lasts_until_the_train_is_as_slow() -> None:
    """The brake was said to end where the limit begins, and the speed before to be held from there."""
    envelope = np.array([25.0, 25, 21, 16, 11, 11, 11, 11, 11, 11, 11])
    speeds = np.array([20.0, 20, 19, 18, 17, 15, 13, 11, 11, 11, 11])
    late = RunAtNodes.of(speeds, envelope, np.array([50.0] * 7 + [500.0] * 3))
    assert with_all_brakes((hold(0, 20.0),), late) == (hold(0, 20.0), brake(2, 11.0), hold(7, 20.0))


def test_a_brake_past_a_limit_that_binds_names_it() -> None:
    """Braked from node 3 on, to 20 m/s at node 6, where the limit lasts to node 8, and then to a standstill."""
    envelope = np.array([30.0, 30, 30, 30, 26, 22, 20, 20, 20, 12, 0])
    on_curve = RunAtNodes.of(np.minimum(envelope, 29.0), envelope, STEP_M)
    merged = (hold(0, 29.0), brake(3, 0.0))
    named = (hold(0, 29.0), brake(3, 20.0), brake(6, 0.0))
    assert with_boards(merged, on_curve) == named
    beside_curve = RunAtNodes.of(np.maximum(np.minimum(envelope, 29.0) - 0.3, 0.0), envelope, STEP_M)
    assert with_boards(merged, beside_curve) == named, "foreign/01: braked 1 km/h below the curve, past a board of 30"
    below = RunAtNodes.of(np.array([24.0, 24, 24, 22, 20, 18, 16, 14, 12, 8, 0]), envelope, STEP_M)
    assert with_boards(merged, below) == merged, "a limit passed well below it is not named"
    assert with_boards((hold(0, 29.0), brake(3, 0.0, 0.5)), on_curve)[1:] == (brake(3, 0.0, 0.5),), "one effort"
