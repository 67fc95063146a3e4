"""Localisation: the consequence of every fault of a sensor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from das.advice import wording
from das.domain.files.load import load_vehicle
from das.domain.units import NS
from das.estimate.estimate import OVERSPEED_RATIO, STALE_AFTER_S, Estimate, PositionFix, Problem, Quality, deviations
from das.estimate.localisation import (
    LARGEST_POSITION_SD_M,
    LARGEST_SPEED_SD_MPS,
    Localisation,
)
from das.estimate.plausibility import AGREEING_FIXES, SILENCE_S, SLOW_SDS, STANDS_AFTER_S
from das.estimate.track_filter import WANDER_S
from tests.support.fixes import SD_M, T0, TRAIN, at, believing, fixes, heard, ns, truth


def taken(localisation: Localisation, fix: PositionFix) -> Estimate:
    """The estimate at the time of a fix that it takes first."""
    localisation.take(fix)
    return localisation.at(fix.time_ns)


def words(problem: Problem | None) -> str:
    """A problem in words; empty where there is none."""
    return wording.problem(problem) if problem is not None else ""


# --- dropouts, old and repeated fixes ----------------------------------------------------------------------------


def test_the_uncertainty_grows_in_a_dropout_until_the_estimate_is_too_old() -> None:
    localisation = heard(80.0)
    before = localisation.at(ns(80.0))
    carried = [localisation.at(ns(80.0 + x)) for x in (1.0, 2.0, 3.0)]
    assert all(x.usable for x in carried)
    assert np.all(np.diff([x.position_sd_m for x in (before, *carried)]) > 0)
    assert np.all(np.diff([x.speed_sd_mps for x in (before, *carried)]) > 0)
    assert abs(carried[-1].s_m - truth(83.0)[0]) < 4 * carried[-1].position_sd_m
    lost = localisation.at(ns(84.2))
    assert (lost.usable, words(lost.problem)) == (False, "the position is 4.2 s old")
    for fix in fixes(95.0, from_s=95.0):
        localisation.take(fix)
    back = localisation.at(ns(95.0))
    assert back.usable
    assert back.restarts == back.rejected == 0
    assert back.position_sd_m > before.position_sd_m


def test_after_a_long_dropout_the_state_is_that_of_the_next_fix() -> None:
    localisation = heard(80.0)
    time_s = 80.0 + SILENCE_S + 1.0
    found = taken(localisation, at(time_s, 2_000.0, 7.0))
    assert (found.s_m, found.speed_mps, found.position_sd_m) == (2_000.0, 7.0, SD_M)


def test_repeated_late_and_disordered_fixes_change_nothing() -> None:
    plain, odd = Localisation(TRAIN), Localisation(TRAIN)
    stream = list(fixes(90.0, hz=2.0))
    for i, fix in enumerate(stream):
        plain.take(fix)
        odd.take(fix)
        odd.take(fix)
        odd.take(replace(fix, s_m=fix.s_m + 1_000.0))
        odd.take(stream[i // 2])
    assert plain.at(ns(90.3)) == odd.at(ns(90.3))


def test_a_source_too_slow_is_not_used_and_let_go_by_turns() -> None:
    """With a fix every 5 s, the first gap is a dropout; after that, advice does not come and go with each fix."""
    localisation, usable = believing(TRAIN), []
    for second in range(60):
        if second % 5 == 0:
            localisation.take(at(second, 20.0 * second, 20.0))
        usable.append(localisation.at(ns(second)).usable)
    assert usable == [True] * 4 + [False] + [True] * 4 + [False] * 51
    localisation.take(at(60.0, 1_200.0, 20.0))
    assert words(localisation.at(ns(60.0)).problem) == "positions come only every 5.0 s"
    assert taken(localisation, at(61.0, 1_220.0, 20.0)).usable


# --- impossible fixes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"s_m": 400.0}, "the position jumped by "),
        ({"s_m": -400.0}, "the position jumped back by "),
        ({"speed_mps": 12.0}, "the speed jumped by "),
        ({"speed_mps": -12.0}, "the speed jumped by -"),
        ({"speed_mps": 1e3}, "a speed of 3708 km/h is impossible"),
        ({"speed_mps": -40.0}, "a speed of -3"),
        ({"s_m": 1e300}, "a position of 1e+300 m is impossible"),
        ({"s_m": math.inf}, "the position is not a number"),
        ({"uncertainty_m": -9.0}, "an uncertainty of -6 is impossible"),
        ({"quality": Quality.INVALID}, "the position is marked unusable"),
    ],
)
def test_one_impossible_fix_is_rejected_and_the_estimate_goes_on(
    change: dict[str, float | Quality], reason: str
) -> None:
    localisation, plain = heard(80.0), heard(80.0)
    (fix,) = fixes(81.0, from_s=81.0)
    wrong = {key: value if key == "quality" else getattr(fix, key) + value for key, value in change.items()}
    localisation.take(replace(fix, **wrong))
    found = localisation.at(ns(81.0))
    assert found.usable
    assert words(found.rejection).startswith(reason)
    assert replace(found, rejected=0, rejection=None) == plain.at(ns(81.0))
    assert found.rejected == 1
    later = localisation.at(ns(83.5))
    assert (later.usable, words(later.problem)) == (False, words(found.rejection))
    assert taken(localisation, *fixes(84.0, from_s=84.0)).usable


def test_an_emergency_brake_is_no_jump() -> None:
    localisation = heard(80.0)
    s_m, speed_mps = truth(80.0)
    for second in range(1, 21):
        v = max(speed_mps - 1.5 * second, 0.0)
        way_m = (speed_mps**2 - v**2) / 3.0
        found = taken(localisation, at(80.0 + second, s_m + way_m, v))
        assert abs(found.speed_mps - v) < 0.3
    assert found.rejected == 0
    assert found.speed_mps == pytest.approx(0.0, abs=1e-3)


def test_where_rejected_fixes_agree_the_state_begins_anew_there() -> None:
    """The first fix was 3 km too far."""
    localisation = believing(TRAIN)
    localisation.take(at(70.0, truth(70.0)[0] + 3_000.0, 30.0))
    for i in range(AGREEING_FIXES):
        assert localisation.at(ns(70.0 + i)).restarts == 0
        (fix,) = fixes(71.0 + i, from_s=71.0 + i)
        localisation.take(fix)
    found = localisation.at(ns(70.0 + AGREEING_FIXES))
    assert (found.restarts, found.rejected) == (1, AGREEING_FIXES)
    assert found.s_m == pytest.approx(truth(70.0 + AGREEING_FIXES)[0], abs=4 * SD_M)
    (fix,) = fixes(75.0, from_s=75.0)
    assert taken(localisation, fix).usable  # The way has told the scale of the speeds well enough.


@pytest.mark.parametrize("hz", [1.0, 20.0])
def test_a_jump_that_lasts_withdraws_or_restarts_and_one_that_ends_does_neither(hz: float) -> None:
    localisation = heard(80.0, hz=hz)
    for fix in fixes(80.0 + 1.9, from_s=80.0 + 1 / hz, hz=hz):
        localisation.take(replace(fix, s_m=fix.s_m + 400.0))
    assert localisation.at(ns(82.0)).usable
    assert localisation.at(ns(82.0)).s_m == pytest.approx(truth(82.0)[0], abs=4 * SD_M)
    for fix in fixes(90.0, from_s=82.0, hz=hz):
        localisation.take(fix)
    assert localisation.at(ns(90.0)).restarts == 0


def test_rejected_fixes_that_disagree_never_move_the_state() -> None:
    localisation = heard(80.0)
    for second in range(81, 100):
        found = taken(localisation, at(second, truth(second)[0] + (2_000.0 if second % 2 else -2_000.0), 30.0))
    assert (found.usable, found.restarts) == (False, 0)
    assert words(found.problem).startswith("the position jumped")


def test_doubts_do_not_outlast_a_dropout() -> None:
    localisation = heard(80.0)
    localisation.take(at(81.0, 9_000.0, 30.0))
    time_s = 82.0 + SILENCE_S
    found = taken(localisation, at(time_s, *truth(time_s)))
    assert (found.usable, found.restarts, found.rejected) == (True, 0, 1)


def test_a_train_that_rolls_back_is_not_advised() -> None:
    """Its speed is positive while its positions go back, which no train can do."""
    localisation = heard(80.0)
    for second in range(1, 60):
        found = taken(localisation, at(80.0 + second, truth(80.0)[0] - 20.0 * second, 20.0))
        assert found.usable == (second <= STALE_AFTER_S)
    assert found.restarts == 0


@pytest.mark.parametrize("sd_m", [SD_M, 20.0])
def test_a_frozen_sensor_is_noticed(sd_m: float) -> None:
    """However coarse it is: speeds that do not change either are no coarse measurement."""
    (last,) = (replace(one, uncertainty_m=sd_m) for one in fixes(80.0, from_s=80.0))
    localisation = heard(79.0)
    localisation.take(last)
    for second in range(81, 140):
        found = taken(localisation, replace(last, time_ns=ns(second)))
        assert found.usable == (second <= 83)
        assert words(found.rejection) == f"the position is frozen at {last.s_m:.0f} m"
    assert words(found.problem) == words(found.rejection)


@pytest.mark.parametrize("frozen_s", [15.0, 25.0, 80.0])
@pytest.mark.parametrize("sd_m", [math.nan, SD_M])
def test_a_receiver_that_freezes_beside_an_odometer_that_lives_is_noticed(frozen_s: float, sd_m: float) -> None:
    """The speeds go on and vary, but the position stays."""
    localisation = heard(frozen_s)
    place_m = truth(frozen_s)[0] + 1.0
    for second in range(int(frozen_s) + 1, int(frozen_s) + 30):
        off_mps = 0.05 if second % 2 else -0.05
        found = taken(localisation, at(second, place_m, truth(second)[1] + off_mps, uncertainty_m=sd_m))
        way_m = truth(second)[0] - place_m
        assert found.restarts == 0
        assert not found.usable or way_m < 60.0 or second - frozen_s <= 2 * STALE_AFTER_S
    assert not found.usable
    assert words(found.problem).startswith("the position")


def test_fixes_that_stay_while_the_train_runs_do_not_agree() -> None:
    """Each agrees with the one before within its noise, but not all of them with the first."""
    localisation = heard(80.0, noise_m=10.0)
    for second in range(81, 100):
        assert taken(localisation, at(second, 500.0, truth(second)[1], uncertainty_m=10.0)).restarts == 0
    assert not localisation.at(ns(99)).usable


def test_a_coarse_receiver_is_not_frozen() -> None:
    """It measures in steps of 10 m, while a train stands for long and creeps off."""
    localisation = Localisation(TRAIN)
    for second in range(400):
        speed_mps = 0.0 if second < 300 else min(0.1 * (second - 300), 1.5)
        place_m = 0.0 if second < 300 else 0.05 * min(second - 300, 15) ** 2 + 1.5 * max(second - 315, 0)
        measured_mps = abs(speed_mps + (0.04 if second % 2 else -0.04))
        found = taken(localisation, at(second, 10.0 * round(place_m / 10.0), measured_mps, uncertainty_m=5.0))
        assert found.usable
        assert abs(found.s_m - place_m) < 12.0


def test_the_same_place_after_a_silence_is_not_frozen() -> None:
    localisation = believing(TRAIN)
    for second in (0, 1_000):
        assert taken(localisation, at(second, 1_000.0, 20.0)).usable


def test_a_sensor_slower_than_its_messages_is_not_frozen() -> None:
    """It measures at 1 Hz and sends at 20 Hz with new time stamps: the repetitions are left out."""
    localisation = heard(30.0)
    for i in range(31 * 20, 100 * 20):
        second = i / 20
        s_m, speed_mps = truth(math.floor(second))
        found = taken(localisation, at(second, s_m, speed_mps))
        assert found.usable
        assert abs(found.s_m - truth(second)[0]) < 20.0


# --- a part is missing -------------------------------------------------------------------------------------------


def test_without_speeds_they_follow_from_the_positions() -> None:
    localisation, first_s = Localisation(TRAIN), None
    for fix in fixes(118.0, from_s=62.0, hz=2.0):
        found = taken(localisation, replace(fix, speed_mps=math.nan))
        if found.usable and first_s is None:
            first_s = (fix.time_ns - T0) * NS
        if found.usable:
            assert abs(found.speed_mps - 30.0) < 4 * found.speed_sd_mps
        else:
            assert words(found.problem).startswith("the speed is uncertain by ")
    assert first_s is not None
    assert 2.0 <= first_s - 62.0 <= 12.0
    assert found.speed_mps == pytest.approx(30.0, abs=1.0)


def test_without_positions_the_way_is_reckoned_and_ever_less_certain() -> None:
    localisation, usable = heard(62.0), []
    for second in range(63, 400):
        localisation.take(at(second, math.nan, 30.3))  # an odometer 1 % off
        found = localisation.at(ns(second))
        true_m = truth(62.0)[0] + 30.0 * (second - 62)
        assert abs(found.s_m - true_m) < 3 * found.position_sd_m
        usable.append(found.usable)
    assert words(found.problem).startswith("the position is uncertain by ")
    assert 150 < sum(usable) < 180
    assert usable == sorted(usable, reverse=True)
    # It has to be well below the limit before it is used again.
    sds, used = [], []
    for second in range(400, 440):
        found = taken(localisation, at(second, true_m + 30.0 * (second - 399), 30.0, uncertainty_m=45.0))
        sds.append(found.position_sd_m)
        used.append(found.usable)
    assert LARGEST_POSITION_SD_M > sds[0] > 0.7 * LARGEST_POSITION_SD_M
    assert not used[0]
    assert used == sorted(used)


def test_nothing_but_speeds_is_no_position() -> None:
    localisation = Localisation(TRAIN)
    assert words(localisation.at(ns(0)).problem) == "no position yet"
    localisation.take(at(0, math.nan, 20.0))
    assert words(localisation.at(ns(0)).problem) == "the position is not a number"


# --- standstill --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed_noise_mps", [0.0, 0.3])
def test_a_standing_train_stays_where_it_is_while_fixes_wander(speed_noise_mps: float) -> None:
    random, localisation, off_m = np.random.default_rng(3), Localisation(TRAIN), 0.0
    more = {"uncertainty_m": 8.0, "speed_uncertainty_mps": max(speed_noise_mps, 0.02)}
    places, speeds = [], []
    for second in range(600):
        off_m = math.exp(-1 / WANDER_S) * off_m + 2.0 * random.standard_normal()
        measured_mps = abs(speed_noise_mps * random.standard_normal())
        found = taken(localisation, at(second, 1_000.0 + off_m, measured_mps, **more))
        assert found.usable
        if second > 5:
            places.append(found.s_m)
            speeds.append(found.speed_mps)
    # The fixes wander over 30 m and more; a speed that looks like setting off lets one fix count.
    assert np.ptp(places) < (8.0 if speed_noise_mps else 1e-9)
    assert np.mean(np.array(speeds) < 0.3) > 0.98


@pytest.mark.parametrize(
    ("s_m", "seconds"),
    [(1_000.0, [10.0 + SILENCE_S]), (9_000.0, [10.0, 11.0, 12.0, 13.0])],
    ids=["after a silence", "where rejected fixes agree"],
)
def test_an_estimate_that_begins_anew_knows_of_no_standstill(s_m: float, seconds: list[float]) -> None:
    """Nothing is left of the train that stood: the first slow fix alone may be noise."""
    localisation = Localisation(TRAIN)
    for second in range(10):
        localisation.take(at(second, 1_000.0, 0.0))
    assert localisation.moment == (1_000.0, True)
    for second in seconds:
        localisation.take(at(second, s_m, 0.0))
    assert localisation.moment == (s_m, False)
    localisation.take(at(seconds[-1] + STANDS_AFTER_S, s_m, 0.0))
    assert localisation.moment == (s_m, True)


@pytest.mark.parametrize(("sd_mps", "within_s"), [(0.05, 1.0), (0.2, 1.0), (0.3, 2.0)])
def test_setting_off_is_noticed_at_once(sd_mps: float, within_s: float) -> None:
    localisation = Localisation(TRAIN)
    for second in range(60):
        localisation.take(at(second, 1_000.0, 0.0, speed_uncertainty_mps=sd_mps))
    assert localisation.at(ns(59.9)).speed_mps == 0.0
    moving_s = None
    for tenth in range(1, 40):
        time_s = 59.0 + 0.5 * tenth
        localisation.take(
            at(time_s, 1_000.0 + 0.25 * (0.5 * tenth) ** 2, 0.5 * 0.5 * tenth, speed_uncertainty_mps=sd_mps)
        )
        if moving_s is None and localisation.at(ns(time_s)).speed_mps > 0:
            moving_s = 0.5 * tenth
    assert moving_s is not None
    assert moving_s <= within_s + 0.5
    found = localisation.at(ns(time_s))
    assert found.speed_mps == pytest.approx(0.25 * 39, abs=3 * found.speed_sd_mps)
    assert found.rejected == 0


def test_a_standing_train_whose_speed_fails_is_still_followed() -> None:
    localisation = Localisation(TRAIN)
    for second in range(60):
        localisation.take(at(second, 1_000.0, 0.0))
    for second in range(60, 100):
        s_m = 1_000.0 + 0.25 * (second - 59) ** 2
        localisation.take(at(second, s_m, math.nan))
    found = localisation.at(ns(99))
    assert found.usable
    assert found.s_m == pytest.approx(s_m, abs=4 * found.position_sd_m)
    assert found.speed_mps == pytest.approx(20.0, abs=1.5)


# --- clocks ------------------------------------------------------------------------------------------------------


def test_a_state_from_the_future_is_reported_and_forgotten() -> None:
    localisation = heard(80.0)
    localisation.take(at(500.0, 2_000.0, 20.0))
    found = localisation.at(ns(81.0))
    assert (found.usable, words(found.problem)) == (False, "the position is 419.0 s ahead of the clock")
    assert taken(localisation, *fixes(82.0, from_s=82.0)).usable


@pytest.mark.parametrize("jump_s", [-1e6, -10.0, 10.0, 1e6])
def test_a_clock_that_jumps_is_bridged(jump_s: float) -> None:
    """Clock and time stamps jump together: advice is back by the second fix."""
    localisation = heard(80.0)
    localisation.at(ns(80.0))
    for second in (81, 82):
        s_m, speed_mps = truth(second)
        found = taken(localisation, at(second + jump_s, s_m, speed_mps))
    if jump_s == 10.0:  # as a dropout in which the train hardly moved: a jump of the position
        for second in (83, 84, 85):
            localisation.take(at(second + jump_s, *truth(second)))
        found = localisation.at(ns(85 + jump_s))
        second = 85
    assert found.usable
    assert found.s_m == pytest.approx(truth(second)[0], abs=4 * SD_M)


def test_a_small_skew_is_not_extrapolated_backwards() -> None:
    localisation = heard(80.0)
    assert replace(localisation.at(ns(78.0)), time_ns=0) == replace(localisation.at(ns(80.0)), time_ns=0)


@pytest.mark.parametrize(("off_s", "slowed"), [(0.2, True), (2.5, False)])
def test_a_train_that_slows_down_has_its_last_speed_still_where_the_clocks_differ(
    off_s: float, *, slowed: bool
) -> None:
    """Positions come late, or their clock is behind: the train may or may not have slowed down since."""
    localisation = Localisation(TRAIN)
    for fix in fixes(140.0, from_s=100.0):
        localisation.take(fix)
        found = localisation.at(fix.time_ns + round(off_s / NS))
    fixed_mps = truth(140.0)[1]
    expected_mps = fixed_mps - 0.75 * off_s if slowed else fixed_mps
    assert found.speed_mps == pytest.approx(expected_mps, abs=0.15)


# --- garbage -----------------------------------------------------------------------------------------------------

NUMBERS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.floats(-100.0, 100.0),
    st.floats(0.0, 80.0),
    st.sampled_from([0.0, math.nan, math.inf, 1e-300, 1e300, 1_000.0]),
)
TIMES = st.one_of(st.integers(-(2**63), 2**63 - 1), st.integers(T0 - 10**10, T0 + 10**11), st.just(T0))
GARBAGE = st.builds(
    PositionFix,
    time_ns=TIMES,
    s_m=NUMBERS,
    speed_mps=NUMBERS,
    uncertainty_m=NUMBERS,
    speed_uncertainty_mps=NUMBERS,
    quality=st.sampled_from(Quality),
)
PLAUSIBLE = st.builds(
    lambda second, s_m, v, quality: at(second, s_m, v, quality=quality),
    st.floats(0.0, 60.0),
    st.floats(900.0, 1_100.0),
    st.one_of(st.floats(0.0, 60.0), st.just(math.nan)),
    st.sampled_from(Quality),
)


def check(found: Estimate) -> None:
    if not found.usable:
        assert found.problem is not None
        return
    assert found.problem is None
    assert math.isfinite(found.s_m)
    assert 0.0 <= found.speed_mps <= OVERSPEED_RATIO * TRAIN.max_speed_mps
    assert 0.0 <= found.position_sd_m <= LARGEST_POSITION_SD_M
    assert 0.0 <= found.speed_sd_mps <= LARGEST_SPEED_SD_MPS
    assert abs(found.time_ns - found.fix_time_ns) * NS <= STALE_AFTER_S


@settings(max_examples=300, deadline=None)
@given(stream=st.lists(st.tuples(st.one_of(GARBAGE, PLAUSIBLE), TIMES), max_size=30))
def test_garbage_is_never_a_state(stream: list[tuple[PositionFix, int]]) -> None:
    localisation = Localisation(TRAIN)
    for fix, now_ns in stream:
        localisation.take(fix)
        check(localisation.at(now_ns))
        check(localisation.at(fix.time_ns))


@settings(max_examples=60, deadline=None)
@given(
    wrong=st.dictionaries(st.integers(0, 59), st.one_of(GARBAGE, PLAUSIBLE), max_size=20),
    hz=st.sampled_from([1.0, 4.0]),
)
def test_garbage_in_between_never_moves_a_train_further_than_it_can(wrong: dict[int, PositionFix], hz: float) -> None:
    """Two estimates without a restart between them are no further apart than a train and the gates allow.

    Each fix between them may move the train within its own gate: that is as wide as estimate and fix are uncertain.
    """
    localisation, before, most_m = Localisation(TRAIN), None, LARGEST_POSITION_SD_M
    for i in range(60):
        if i in wrong:
            localisation.take(replace(wrong[i], time_ns=ns(60.0 + (i - 0.5) / hz)))
        (fix,) = fixes(60.0 + i / hz, from_s=60.0 + i / hz)
        found = taken(localisation, fix)
        check(found)
        if before is not None and before.usable and found.usable and before.restarts == found.restarts:
            way_m, span_s = found.s_m - before.s_m, (found.time_ns - before.time_ns) * NS
            heeded = [one for one in (wrong.get(i), fix) if one is not None and one.quality is not Quality.INVALID]
            sds_m = [min(deviations(one).position_m, most_m) for one in heeded]
            gates_m = sum(math.hypot(before.position_sd_m, sd_m) for sd_m in sds_m)
            slack_m = 5 * (gates_m + found.position_sd_m) + 10.0
            assert -slack_m <= way_m <= OVERSPEED_RATIO * TRAIN.max_speed_mps * span_s + slack_m
        before = found


def test_the_same_fixes_give_the_same_estimate() -> None:
    assert heard(100.0, hz=3.0).at(ns(100.1)) == heard(100.0, hz=3.0).at(ns(100.1))


@pytest.mark.parametrize("quality", [Quality.GOOD, Quality.UNKNOWN, Quality.DEGRADED])
def test_a_train_that_creeps_out_of_a_stop_is_noticed(quality: Quality) -> None:
    """One fix alone is too slow to be told from a standstill; a driver who creeps must get advice all the same."""
    usual = deviations(PositionFix(time_ns=0, s_m=0.0, speed_mps=0.0, quality=quality))
    creeping_mps = 0.95 * SLOW_SDS * usual.speed_mps
    localisation, s_m = Localisation(load_vehicle("re460-ic")), 100.0
    for second in range(30):
        speed_mps = 0.0 if second < 10 else creeping_mps
        s_m += speed_mps
        localisation.take(PositionFix(time_ns=second * 10**9, s_m=s_m, speed_mps=speed_mps, quality=quality))
        here = localisation.at(second * 10**9)
        assert second >= 10 or here.speed_mps == 0.0
    assert here.speed_mps == pytest.approx(speed_mps, rel=0.3)
    assert here.s_m == pytest.approx(s_m, abs=12.0)


def test_a_fix_marked_unusable_has_no_deviations() -> None:
    with pytest.raises(ValueError, match="a fix marked as unusable has no deviations"):
        deviations(at(0.0, 0.0, 0.0, quality=Quality.INVALID))
