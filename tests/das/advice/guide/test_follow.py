"""What is wanted of this train: the present step, or the way back to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.advice.goal import SpeedsAllowed
from das.advice.guide.follow import GAINS_S, advanced, is_vain, wanted
from das.advice.guide.guard import Proposal, Sight
from das.advice.guide.memory import Lead, Memory, alike, brake, coast, hold, traction
from das.advice.guide.timeline import REACHED_MPS
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.advice.shown import STOP_BY_EYE_M
from das.domain.units import KMH
from das.solver.guide.schedule import Schedule
from tests.support.bundled_sections import section_of
from tests.support.guide import FREE, flat, reference, scene

PLAIN = reference(("T", 0.8, 0.0, 100), ("H", 0.0, 1000.0, 100), ("C", 0.0, 3000.0, 90), ("B", 0.0, 4700.0, 0))
LOWER = reference(
    ("H", 0.0, 0.0, 100), ("B", 0.0, 2500.0, 60), ("B", 0.0, 5200.0, 0), section=flat((3000.0, 6000.0, 60)),
    at_kmh=100,
)  # fmt: skip
FOLLOWS = Memory(mode=Lead.FOLLOW)


def seen(s_m: float, kmh: float, schedule: Schedule = PLAIN, place: SpeedsAllowed = FREE) -> Sight:
    return scene(schedule, s_m, kmh, place)


def asked(s_m: float, kmh: float, memory: Memory = FOLLOWS, schedule: Schedule = PLAIN) -> tuple[Proposal, Memory]:
    """What is wanted at the step in force at a place."""
    here = seen(s_m, kmh, schedule)
    return wanted(here, advanced(here, memory))


def test_steps_are_taken_up_one_after_another_and_again_only_by_a_train_far_behind() -> None:
    numbers = [advanced(seen(s_m, 80), FOLLOWS).step for s_m in (100.0, 2900.0, 3100.0, 4800.0)]
    assert numbers == [0, 0, 1, 2]
    assert advanced(seen(2900.0, 80), replace(FOLLOWS, step=1)).step == 1
    assert advanced(seen(100.0, 80), replace(FOLLOWS, step=1)).step == 0


def test_another_step_begins_without_a_deviation() -> None:
    strayed = replace(FOLLOWS, mode=Lead.BACK_UP, back=traction(0.7, 27.0), reached=True)
    found = advanced(seen(3100.0, 80), strayed)
    assert (found.mode, found.back, found.reached) == (Lead.FOLLOW, None, False)
    assert advanced(seen(2000.0, 80), strayed) is strayed


def test_an_acceleration_ends_half_a_metre_per_second_below_its_speed_and_is_then_a_hold() -> None:
    found, memory = asked(800.0, 100 - (REACHED_MPS + 0.1) / KMH)
    assert (found.one, memory.reached) == (traction(0.8, 100 * KMH), False)
    found, memory = asked(800.0, 100 - (REACHED_MPS - 0.1) / KMH)
    assert (found.one, memory.reached) == (hold(100 * KMH), True)
    assert asked(900.0, 96.0, memory)[0].one == hold(100 * KMH), "a little slower, he is left alone"


@pytest.mark.parametrize(
    ("kmh", "mode"),
    [(94.5, Lead.BACK_UP), (95.5, Lead.FOLLOW), (104.5, Lead.FOLLOW), (105.5, Lead.BACK_DOWN)],
)
def test_a_train_more_than_5_km_h_off_the_speed_to_hold_goes_back(kmh: float, mode: Lead) -> None:
    reached = replace(FOLLOWS, reached=True)
    found, memory = asked(1300.0, kmh, reached)
    assert (found.mode, memory.mode) == (mode, mode)
    assert (memory.back is None) is (mode is Lead.FOLLOW)


def test_who_coasts_and_is_still_a_little_too_fast_for_a_hold_goes_on_coasting() -> None:
    reached = replace(FOLLOWS, reached=True)
    for shown, kmh, wants in ((coast, 103.0, coast), (coast, 100.5, hold), (hold, 103.0, hold)):
        memory = replace(reached, shown=shown(100 * KMH))
        assert asked(1300.0, kmh, memory)[0].one == wants(100 * KMH)


def test_coasting_back_leads_to_the_speed_at_which_a_brake_ends_it() -> None:
    """At 2500 m a brake to 60 km/h follows; each second the speed is told as it is then forecast."""
    reached = replace(FOLLOWS, reached=True)
    found, memory = asked(1500.0, 107.0, reached, LOWER)
    assert alike(found.one, coast(100 * KMH))
    assert alike(asked(1900.0, 107.0, memory, LOWER)[0].one, coast(105 * KMH))
    assert alike(asked(1900.0, 104.0, memory, LOWER)[0].one, coast(100 * KMH))


def test_a_way_back_goes_on_until_the_speed_is_reached() -> None:
    reached = replace(FOLLOWS, reached=True)
    _, slow = asked(1300.0, 94.5, reached)
    assert asked(1400.0, 98.0, slow)[0].one.mode in TRACTION
    assert asked(1400.0, 99.0, slow)[0].one == hold(100 * KMH)
    _, fast = asked(1300.0, 105.5, reached)
    assert asked(1400.0, 102.0, fast)[0].one == coast(100 * KMH)
    assert asked(1400.0, 100.5, fast)[0].one == hold(100 * KMH)


def test_nobody_is_told_to_accelerate_back_when_the_next_step_is_near() -> None:
    """It begins at 3000 m; at 90 km/h that is 40 s from 2000 m on."""
    assert asked(1800.0, 90.0, replace(FOLLOWS, reached=True))[0].mode is Lead.BACK_UP
    assert asked(2100.0, 90.0, replace(FOLLOWS, reached=True))[0].one == hold(100 * KMH)


def test_a_train_that_rolls_up_to_the_speed_to_hold_is_not_told_to_accelerate() -> None:
    """On this descent it gains 10 km/h within a minute, but not 40 km/h."""
    here = section_of(("zurich-luzern", 1))
    s_m = float(here.node_m[np.argmin(here.constant_n[200:-200]) + 200])
    schedule = reference(("T", 0.8, 0.0, 100), ("H", 0.0, s_m - 200.0, 100), section=here)
    for kmh, mode in ((90.0, Lead.FOLLOW), (60.0, Lead.BACK_UP)):
        memory = replace(FOLLOWS, step=1, reached=True)
        assert wanted(seen(s_m, kmh, schedule), memory)[0].mode is mode


def test_who_would_roll_for_more_than_a_minute_brakes_back_with_the_motors() -> None:
    found, memory = asked(1300.0, 112.0, replace(FOLLOWS, reached=True))
    assert (found.one.mode in BRAKES, found.one.speed_mps, memory.mode) == (True, 100 * KMH, Lead.BACK_DOWN)
    assert -1.0 <= found.one.effort_ratio < 0.0
    assert asked(1400.0, 106.0, memory)[0].one == found.one, "its effort stays"


def test_coasting_names_where_it_leads_and_keeps_that_within_4_km_h() -> None:
    first = asked(3100.0, 98.0)[0].one
    assert (first.mode, first.speed_mps % (5 * KMH)) == (Regime.COAST, pytest.approx(0.0, abs=1e-6))
    shown = replace(FOLLOWS, shown=first)
    assert asked(3200.0, 99.5, shown)[0].one == first
    assert asked(3200.0, 85.0, shown)[0].one.speed_mps < first.speed_mps


def test_coasting_says_where_it_ends() -> None:
    found = asked(3100.0, 98.0)[0]
    assert 3100.0 < found.at_m <= 4700.0 + 60.0


def test_a_reference_that_coasts_to_its_end_is_followed_there() -> None:
    """No step comes after it, as where a train runs up a hill to its stop."""
    schedule = reference(("H", 0.0, 0.0, 100), ("C", 0.0, 3000.0, 60), at_kmh=100)
    assert asked(4000.0, 90.0, schedule=schedule)[0].one.mode is Regime.COAST


def test_coasting_that_would_only_slow_a_slow_train_is_a_hold() -> None:
    schedule = reference(
        ("H", 0.0, 0.0, 95), ("C", 0.0, 2000.0, 90), ("H", 0.0, 3000.0, 90), ("B", 0.0, 4700.0, 0), at_kmh=95
    )
    assert asked(2100.0, 93.0, schedule=schedule)[0].one.mode is Regime.COAST
    assert asked(2100.0, 85.0, schedule=schedule)[0].one == hold(90 * KMH)


def test_a_train_that_holds_and_would_roll_up_to_its_limit_at_once_holds_that() -> None:
    here = section_of(("zurich-luzern", 2))
    downhill = int(np.argmin(here.constant_n[200:-200])) + 200
    s_m, limit_mps = float(here.node_m[downhill]), float(here.limit_mps[downhill])
    assert here.resistance_n(s_m, limit_mps) < 0.0
    schedule = reference(("T", 0.8, 0.0, 60), ("C", 0.0, s_m - 50.0, 60), ("H", 0.0, s_m + 500.0, 60), section=here)
    for shown, mode in ((hold(limit_mps), Regime.CRUISE), (coast(limit_mps), Regime.COAST)):
        memory = replace(FOLLOWS, step=1, shown=shown)
        assert wanted(seen(s_m, (limit_mps - 0.05) / KMH, schedule), memory)[0].one.mode is mode


def test_a_train_far_below_the_speed_that_coasting_leads_to_is_not_told_to_hold_it() -> None:
    """Over a brow, an obedient driver accelerated from 58 km/h in place of coasting up to 80."""
    schedule = reference(("T", 1.0, 0.0, 55), ("C", 0.0, 1000.0, 80), ("T", 0.6, 1200.0, 80), ("B", 0.0, 4700.0, 0))
    memory = replace(FOLLOWS, step=1, shown=coast(80 * KMH))
    assert asked(1100.0, 55.0, memory, schedule)[0].one.mode is Regime.COAST


def test_an_acceleration_that_a_brake_soon_follows_must_gain_time() -> None:
    """From 90 to 95 km/h for 300 m gains half a second; from 40 to 95 km/h for 2 km, half a minute."""
    short = reference(
        ("H", 0.0, 0.0, 90), ("T", 0.8, 2000.0, 95), ("B", 0.5, 2300.0, 60), ("B", 0.0, 5200.0, 0), at_kmh=90
    )
    assert is_vain(seen(1900.0, 90.0, short), 1)
    assert GAINS_S > 1.0, "the witness asks for 1 s, and drivers gain less than forecast"
    found = asked(2050.0, 90.0, replace(FOLLOWS, step=1), short)[0].one
    assert found.mode is Regime.CRUISE
    begun = replace(FOLLOWS, step=1, shown=traction(0.8, 95 * KMH))
    assert asked(2050.0, 90.0, begun, short)[0].one.mode in TRACTION, "one that has begun goes on"
    long = reference(
        ("H", 0.0, 0.0, 40), ("T", 0.8, 1000.0, 95), ("B", 0.5, 3000.0, 60), ("B", 0.0, 5200.0, 0), at_kmh=40
    )
    assert not is_vain(seen(900.0, 40.0, long), 1)


def test_a_slow_train_accelerates_no_further_than_the_next_step_needs() -> None:
    schedule = reference(
        ("T", 0.3, 0.0, 110), ("B", 0.0, 2500.0, 60), ("B", 0.0, 5200.0, 0), section=flat((3000.0, 6000.0, 60))
    )
    assert asked(2400.0, 40.0, schedule=schedule)[0].one.speed_mps == pytest.approx(60 * KMH)


def test_before_coasting_a_slow_train_accelerates_as_far_as_its_own_step_says() -> None:
    """What it lacks where it begins to coast, coasting does not make up."""
    schedule = reference(("T", 0.8, 0.0, 100), ("C", 0.0, 1500.0, 90), ("B", 0.0, 4700.0, 0))
    assert asked(1400.0, 40.0, schedule=schedule)[0].one.speed_mps == pytest.approx(100 * KMH)


def test_a_brake_ends_at_its_speed_and_is_not_taken_up_again() -> None:
    found, memory = asked(2700.0, 80.0, schedule=LOWER)
    assert (found.one.mode in BRAKES, round(found.one.speed_mps / KMH)) == (True, 60)
    found, memory = asked(2900.0, 60.5, memory, LOWER)
    assert (found.one, memory.reached) == (hold(60 * KMH), True)
    assert asked(3100.0, 62.0, memory, LOWER)[0].one == hold(60 * KMH)


def test_who_has_braked_too_much_for_a_lower_speed_coasts_to_it_if_that_is_enough() -> None:
    found, memory = asked(2600.0, 66.0, schedule=LOWER)
    assert found.one.mode in BRAKES or memory.mode is Lead.BACK_DOWN
    early = asked(2520.0, 66.0, schedule=LOWER)[0].one
    assert early.mode is not Regime.CRUISE


def test_who_has_braked_too_much_for_his_stop_creeps_until_he_must_brake_again() -> None:
    """600 m before the stop at 36 km/h a tenth of the planned braking is enough."""
    end_m = PLAIN.section.end_m
    braking = replace(FOLLOWS, step=2, shown=brake(0.5, 0.0))
    found, memory = asked(end_m - 800.0, 45.0, braking)
    assert (found.mode, found.one.mode) == (Lead.CREEP, Regime.CRUISE)
    assert found.one.speed_mps < 45 * KMH
    assert asked(end_m - 60.0, 40.0, memory)[0].one.mode in BRAKES


def test_near_his_stop_a_driver_brakes_by_eye() -> None:
    end_m = PLAIN.section.end_m
    braking = replace(FOLLOWS, step=2, shown=brake(0.5, 0.0))
    assert asked(end_m - STOP_BY_EYE_M + 50.0, 25.0, braking)[0].one.mode in BRAKES


def test_a_step_that_is_not_due_yet_says_when_it_is() -> None:
    here = seen(2900.0, 100.0)
    found = wanted(here, replace(FOLLOWS, step=1))[0]
    assert found.one.mode is Regime.COAST
    assert found.in_s == pytest.approx(here.due_s(1))
    assert found.in_s == pytest.approx(100.0 / (100 * KMH), rel=0.7)


def test_coasting_up_to_a_speed_is_over_once_the_train_has_it() -> None:
    rolls = reference(("T", 1.0, 0.0, 50), ("T", 0.0, 1000.0, 60), ("B", 0.0, 4700.0, 0))
    begun = replace(FOLLOWS, step=1)
    assert asked(2000.0, 55, begun, rolls)[0].one.mode is Regime.COAST
    assert alike(asked(2000.0, 60, begun, rolls)[0].one, hold(60 * KMH))
