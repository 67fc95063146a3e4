"""The staircase of the top speed shown: never above limit or braking curve, steady, no higher than is worthwhile."""

from __future__ import annotations

import math

import numpy as np
import pytest

from das.advice.shown import SPEED_STEP_MPS
from das.domain.units import KMH
from das.solver.section import Section, build_section
from sim.world.simpler import EASY_BRAKING_MPS2, SLOWEST_MPS, ReducedSpeed, Staircase
from tests.support.making import make_route, make_train

EASY = EASY_BRAKING_MPS2
LOWEST = SLOWEST_MPS


def section_of(length_m: float, limits_kmh: list[tuple[float, float]]) -> Section:
    """A level section under limits (km/h) from positions (m)."""
    return build_section(make_route(length_m, [(at, kmh * KMH) for at, kmh in limits_kmh]), make_train())


def staircase_of(section: Section) -> Staircase:
    """The staircase of a section, as the reduced maximum speed uses it."""
    return ReducedSpeed(section)._staircase


def curve_mps(s_m: float, feet: list[tuple[float, float]]) -> float:
    """An independent check: the highest speed from which gentle braking keeps lower speeds (m/s) at places (m)."""
    return min(math.sqrt(v * v + 2 * EASY * (at - s_m)) if at > s_m else math.inf for at, v in feet)


def full_curve_mps(section: Section, s_m: float) -> float:
    """An independent check: the highest speed from which full braking keeps the stop, where its force is constant."""
    train = section.vehicle
    most_n = float(train.brake_effort_n(LOWEST)) + train.resistance.c0_n
    rate = min(most_n / train.inertial_mass_kg, train.max_deceleration_mps2)
    return math.sqrt(2 * rate * max(section.end_m - s_m, 0.0))


def shown_kmh(staircase: Staircase, drive: list[tuple[float, float, float]]) -> list[float]:
    """The speeds shown (km/h) to a train in successive states: position (m), speed and reduced top speed (m/s)."""
    return [round(staircase.at(*one) / KMH, 9) for one in drive]


def test_it_says_the_limit_the_lower_limit_from_where_braking_begins_and_slow_speeds_before_the_stop() -> None:
    section = section_of(12_000.0, [(0.0, 80.0), (1_000.0, 140.0), (6_000.0, 60.0)])
    staircase, judged = staircase_of(section), 120.4 * KMH
    feet = [(6_000.0, 60 * KMH), (12_000.0, 0.0)]
    assert staircase_of(section).at(0.0, 0.0, judged) == pytest.approx(80.0 * KMH)  # The train may stand.
    shown = {}
    for s_m in np.arange(0.0, 12_000.0, 5.0):
        here = float(section.limit_mps[np.searchsorted(section.node_m, s_m, side="right") - 1])
        v = min(here, judged, curve_mps(s_m, feet))
        shown[s_m] = staircase.at(s_m, v, judged) / KMH
    steps = [s_m for s_m in list(shown)[1:] if shown[s_m] != shown[s_m - 5.0]]
    assert [round(shown[s_m], 9) for s_m in (0.0, *steps)] == [80.0, 120.0, 60.0, 20.0, 10.0]
    # In closed form, braking from 120 to 60 km/h takes (v² − u²)/2b, from 60 km/h to the stop v²/2b.
    way_m = [(a**2 - b**2) * KMH**2 / (2 * EASY) for a, b in ((120, 60), (60, 0))]
    assert steps[0] == pytest.approx(1_000.0 + section.vehicle.train_length_m, abs=10.0)
    # The curve is computed at the ends of intervals, so braking begins at most one interval early.
    for step_m, foot_m, one_m in zip(steps[1:3], (6_000.0, 12_000.0), way_m, strict=True):
        assert -float(section.step_m.max()) < step_m - (foot_m - one_m) < 10.0


def test_it_is_never_above_limit_or_curve_whatever_the_train_does() -> None:
    """With random speeds and top speeds. In the last metres before the stop the curve is that of full braking."""
    limits = [(0.0, 70.5), (2_000.0, 141.3), (5_000.0, 15.0), (5_400.0, 90.0), (6_000.0, 140.0)]
    section = section_of(9_000.0, limits)
    random = np.random.default_rng(7)
    feet = [(5_000.0, 15.0 * KMH), (9_000.0, 0.0)]
    last_m = 9_000.0 - LOWEST**2 / (2 * EASY) - 1.0
    assert full_curve_mps(section, last_m) > LOWEST
    for _ in range(20):
        staircase, s_m, v, judged = staircase_of(section), 0.0, 0.0, 100 * KMH
        while s_m < 9_000.0:
            if random.random() < 0.03:
                judged = random.uniform(20.0, 150.0) * KMH
            v = min(max(v + random.uniform(-1.0, 0.8), 0.0), 40.0)
            shown = staircase.at(s_m, v, judged)
            assert shown <= float(section.limit_mps[np.searchsorted(section.node_m, s_m, side="right") - 1])
            assert shown <= (curve_mps(s_m, feet) + 0.02 if s_m < last_m else full_curve_mps(section, s_m) + 0.02)
            assert shown <= judged + SPEED_STEP_MPS
            assert shown / KMH == pytest.approx(round(shown / KMH), abs=1e-6)
            s_m += max(v, 3.0)


def test_a_judgement_that_hardly_differs_does_not_change_what_is_shown() -> None:
    staircase = staircase_of(section_of(9_000.0, [(0.0, 140.0)]))
    judged = [100.4, 99.8, 101.2, 100.0, 101.3, 100.9, 99.0]
    drive = [(1_000.0 + i, 27.0, kmh * KMH) for i, kmh in enumerate(judged)]
    assert shown_kmh(staircase, drive) == [100.0, 100.0, 100.0, 100.0, 101.0, 101.0, 99.0]


def test_who_brakes_early_is_not_told_to_speed_up_but_who_is_far_too_slow_is() -> None:
    section = section_of(9_000.0, [(0.0, 140.0)])
    judged, at_m = 120 * KMH, 9_000.0 - 1_000.0
    assert staircase_of(section).at(at_m, 25.0, judged) == LOWEST  # the curve is at 31.6 m/s here
    slow = staircase_of(section)
    first = slow.at(at_m, 5.0, judged)
    assert 15.0 < first < curve_mps(at_m, [(9_000.0, 0.0)])
    # The speed shown stays while the train speeds up, until the curve falls to it.
    places = np.arange(at_m, 8_990.0, 10.0)
    speeds = [min(5.0 + 0.06 * (s_m - at_m), first, curve_mps(s_m, [(9_000.0, 0.0)])) for s_m in places]
    shown = [slow.at(s_m, v, judged) for s_m, v in zip(places, speeds, strict=True)]
    assert set(shown) == {first, LOWEST}
    ends_m = next(s_m for s_m, one in zip(places, shown, strict=True) if one == LOWEST)
    assert ends_m == pytest.approx(9_000.0 - first**2 / (2 * EASY), abs=15.0)


def test_a_train_that_stands_short_of_its_stop_may_move_up() -> None:
    """It is shown 20 km/h, in the last metres half of that and half again, and 0 only at the very end."""
    section = section_of(9_000.0, [(0.0, 140.0)])
    staircase, places = staircase_of(section), np.arange(8_950.0, 9_000.0, 0.05)
    shown = shown_kmh(staircase, [(s_m, 0.0, 30.0) for s_m in places])
    assert set(shown) >= {20.0, 10.0, 5.0, 2.0, 1.0}
    slow = [(s_m, kmh) for s_m, kmh in zip(places, shown, strict=True) if kmh <= 20.0]
    assert all(kmh * KMH <= full_curve_mps(section, s_m) + 0.02 for s_m, kmh in slow)
    assert staircase.at(8_000.0, 0.0, 30.0) > 15.0
    assert staircase.at(9_000.0, 0.0, 30.0) == 0.0


def test_a_train_that_slows_down_is_not_told_a_higher_speed_that_it_has_yet_to_come_down_to() -> None:
    staircase, at_m = staircase_of(section_of(9_000.0, [(0.0, 140.0)])), 8_500.0
    assert shown_kmh(staircase, [(at_m, 22.0, 100 * KMH)]) == [20.0]
    assert shown_kmh(staircase, [(at_m + 1, 22.0, 40 * KMH)]) == [20.0]  # easy braking from 40 km/h begins later
    assert shown_kmh(staircase, [(at_m + 2, 10.0, 40 * KMH)]) == [40.0]
