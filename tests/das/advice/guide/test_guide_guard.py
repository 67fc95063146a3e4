"""The only rule for safety: what limits, the curve and the stop ahead ask for."""

from __future__ import annotations

import numpy as np
import pytest

from das.advice.goal import SpeedsAllowed
from das.advice.guide.guard import Proposal, Sight, begins_s, foreseen_brake, guarded, lasts_s, stands_at_mark
from das.advice.guide.memory import Lead, Memory, brake, coast, hold, traction
from das.advice.regimes import BRAKES, Regime
from das.domain.units import KMH
from das.solver.section import build_section
from tests.support.guide import FREE, flat, reference, scene
from tests.support.making import make_route

LINE = flat((3000.0, 5000.0, 60))
SCHEDULE = reference(
    ("H", 0.0, 0.0, 100), ("B", 0.0, 2700.0, 60), ("B", 0.0, 5200.0, 0), section=LINE, at_kmh=100
)  # fmt: skip
QUIET = Memory(mode=Lead.FOLLOW)


def seen(s_m: float, kmh: float, place: SpeedsAllowed = FREE) -> Sight:
    return scene(SCHEDULE, s_m, kmh, place)


def curve_m(kmh: float) -> float:
    """Where the braking curve to the board falls below a speed."""
    below = (LINE.node_m > 1000.0) & (LINE.envelope_mps < kmh * KMH)
    return float(LINE.node_m[np.argmax(below)])


@pytest.mark.parametrize("one", [hold(100 * KMH), coast(80 * KMH), traction(0.8, 110 * KMH)])
def test_far_from_the_curve_the_guard_says_nothing(one: object) -> None:
    wanted = Proposal(one)  # type: ignore[arg-type]
    assert guarded(seen(1000.0, 100), QUIET, wanted) is wanted


def test_near_the_curve_it_asks_for_the_brake_that_the_board_needs_some_seconds_before() -> None:
    begins_m = curve_m(100)
    for lead_s, brakes in ((2.5, True), (6.0, False)):
        found = guarded(seen(begins_m - lead_s * 100 * KMH, 100), QUIET, Proposal(hold(100 * KMH)))
        assert found.guarded is brakes
        if brakes:
            assert (found.one.mode in BRAKES, round(found.one.speed_mps / KMH)) == (True, 60)
            assert 1.0 < found.in_s < 2.5
            assert found.at_m == pytest.approx(3000.0, abs=60.0)


def test_a_driver_who_accelerates_is_told_a_second_sooner() -> None:
    s_m = curve_m(100) - 4.3 * 100 * KMH
    assert not guarded(seen(s_m, 100), QUIET, Proposal(hold(100 * KMH))).guarded
    assert guarded(seen(s_m, 100), QUIET, Proposal(traction(0.8, 110 * KMH))).guarded


def test_a_brake_that_is_enough_stands_and_one_that_is_not_is_made_stronger() -> None:
    s_m = curve_m(100)
    strong, weak = Proposal(brake(1.0, 60 * KMH)), Proposal(brake(0.1, 60 * KMH), exact=0.1)
    assert guarded(seen(s_m, 100), QUIET, strong).one == strong.one
    found = guarded(seen(s_m, 100), QUIET, weak).one
    assert found.mode in BRAKES
    assert found.effort_ratio < -0.1


def test_a_brake_to_a_lower_speed_on_whose_way_a_limit_lies_keeps_its_speed() -> None:
    found = guarded(seen(curve_m(100), 100), QUIET, Proposal(brake(0.1, 50 * KMH), exact=0.1)).one
    assert round(found.speed_mps / KMH) == 50
    assert found.effort_ratio < -0.1


def test_a_slow_train_is_not_told_to_accelerate_above_a_near_board() -> None:
    found = guarded(seen(2950.0, 50), QUIET, Proposal(traction(0.8, 100 * KMH)))
    assert found.one.mode not in BRAKES
    assert found.one.speed_mps <= 60 * KMH + 1e-6
    assert guarded(seen(1500.0, 50), QUIET, Proposal(traction(0.8, 100 * KMH))).one.speed_mps == 100 * KMH


def test_a_train_that_coasts_along_the_curve_is_not_told_to_hold_its_speed() -> None:
    """Where motors may not brake, the curve is that of a coasting train: its speed is over as soon as it is read."""
    wanted = Proposal(coast(60 * KMH))
    for over_mps in (0.05, 0.2, 0.29):
        place = SpeedsAllowed(100 * KMH - over_mps, 120 * KMH)
        assert guarded(seen(1000.0, 100, place), QUIET, wanted) is wanted
    beyond = SpeedsAllowed(100 * KMH - 0.4, 120 * KMH)
    assert guarded(seen(1000.0, 100, beyond), QUIET, wanted).brakes


@pytest.mark.parametrize(
    ("over_mps", "mode"), [(0.2, Regime.CRUISE), (0.7, Regime.CRUISE), (1.2, Regime.REDUCED_BRAKE)]
)
def test_a_train_above_its_limit_is_told_to_hold_it_or_to_brake(over_mps: float, mode: Regime) -> None:
    limit_mps = 70 * KMH
    place = SpeedsAllowed(limit_mps, limit_mps)
    found = guarded(seen(1000.0, 70 + over_mps / KMH, place), QUIET, Proposal(hold(100 * KMH))).one
    assert (found.mode, found.speed_mps) == (mode, pytest.approx(limit_mps))


def test_a_train_above_the_curve_of_all_brakes_is_told_to_brake_fully() -> None:
    place = SpeedsAllowed(80 * KMH, 100 * KMH)
    found = guarded(seen(2700.0, 95, place), QUIET, Proposal(hold(100 * KMH)))
    assert found.one.mode is Regime.FRICTION_BRAKE


def test_a_driver_hardly_above_his_limit_who_coasts_is_left_alone() -> None:
    place = SpeedsAllowed(70 * KMH, 70 * KMH)
    for to_kmh, kmh in ((60, 70.3), (70, 65.0)):
        wanted = Proposal(coast(to_kmh * KMH))
        assert guarded(seen(1000.0, kmh, place), QUIET, wanted).one == wanted.one


def test_a_driver_who_coasts_down_a_descent_is_told_to_hold_the_limit_before_the_train_is_far_above_it() -> None:
    """On 20 per mille it gains half a metre per second in 3 s."""
    descent = build_section(make_route(6_000.0, [(0.0, 44.0)], [(0.0, -0.02)]), LINE.vehicle)
    schedule = reference(("H", 0.0, 0.0, 70), ("B", 0.0, 4700.0, 0), section=descent, at_kmh=70)
    place = SpeedsAllowed(70 * KMH, 70 * KMH)
    found = guarded(scene(schedule, 1000.0, 70.3, place), QUIET, Proposal(coast(60 * KMH)))
    assert (found.one, found.guarded) == (hold(70 * KMH), True)


def test_the_foreseen_brake_is_where_a_driver_who_goes_on_as_told_meets_the_curve() -> None:
    found = foreseen_brake(seen(1000.0, 100), hold(100 * KMH), 0.0)
    assert found is not None
    assert 1000.0 + found.one.way_m == pytest.approx(curve_m(100), abs=30.0)
    assert found.in_s == pytest.approx(found.one.way_m / (100 * KMH), rel=0.01)
    rolls = foreseen_brake(seen(1000.0, 100), coast(80 * KMH), 0.0)
    assert rolls is not None
    assert rolls.one.way_m > found.one.way_m, "who coasts is slower there"
    here = seen(1000.0, 100)
    further = foreseen_brake(here._replace(state=here.state._replace(ahead_m=50.0)), hold(100 * KMH), 0.0)
    assert further is not None
    assert further.one.way_m == pytest.approx(found.one.way_m - 50.0, abs=1.0), "he may be 50 m further ahead"


def test_a_driver_hardly_above_the_speed_to_hold_is_foreseen_to_hold_it() -> None:
    held = [foreseen_brake(seen(1000.0, 80 + over), hold(80 * KMH), 0.0) for over in (0.0, 1.0, 5.0)]
    ways = [found.one.way_m for found in held if found is not None]
    assert ways[0] == pytest.approx(ways[1])
    assert ways[2] < ways[1] - 10.0


def test_no_brake_is_foreseen_to_a_speed_that_is_held_already() -> None:
    found = foreseen_brake(seen(1000.0, 60), hold(60 * KMH), 0.0)
    assert found is None or found.one.speed_mps < 60 * KMH - 1.0


def test_a_brake_begins_a_moment_before_the_curve() -> None:
    s_m = curve_m(100) - 10.0 * 100 * KMH
    assert begins_s(seen(s_m, 100), 100 * KMH) == pytest.approx(10.0 - 0.7, abs=0.6)
    assert begins_s(seen(curve_m(100), 100), 100 * KMH) == 0.0


def test_near_its_mark_a_brake_stands_that_ends_there() -> None:
    ahead, end_m = seen(1000.0, 60).ahead, LINE.end_m
    found = [
        stands_at_mark(ahead, brake(effort, 0.0), seen(end_m - 8.0, 9.0).state) for effort in (0.2, 0.4, 2.0)
    ]  # fmt: skip
    assert found.count(True) == 1
    assert not stands_at_mark(ahead, brake(0.4, 0.0), seen(end_m - 40.0, 9.0).state)
    assert not stands_at_mark(ahead, hold(3.0), seen(end_m - 8.0, 9.0).state)


def test_a_brake_lasts_until_its_speed() -> None:
    here = seen(1000.0, 100)
    assert lasts_s(here, brake(1.0, 100 * KMH)) == 0.0
    assert lasts_s(here, brake(0.5, 60 * KMH)) > lasts_s(here, brake(1.0, 60 * KMH)) > 5.0
