"""What a driver reads: rounding, steadiness, and the effort on the controller's scale."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.advice.advice import Guidance, Instruction
from das.advice.regimes import Regime
from das.advice.shown import as_read, lever_ratio, steady_step, step_below
from das.domain.units import KMH

LARGEST_N = 300e3, 600e3


@given(st.floats(0.0, 120.0))
def test_a_speed_is_rounded_down_to_whole_kmh(speed_mps: float) -> None:
    shown_mps = step_below(speed_mps)
    assert shown_mps <= speed_mps + 1e-6 < shown_mps + KMH + 2e-6
    assert shown_mps / KMH == pytest.approx(round(shown_mps / KMH), abs=1e-9)


def test_limits_in_whole_kmh_are_shown_as_they_are() -> None:
    assert [round(step_below(kmh * KMH) / KMH) for kmh in range(200)] == list(range(200))


@given(st.lists(st.floats(0.0, 60.0), min_size=1, max_size=20))
def test_a_speed_that_changes_all_the_time_is_shown_steadily_and_near(speeds_mps: list[float]) -> None:
    shown_mps = math.nan
    for speed_mps in speeds_mps:
        shown_mps = steady_step(speed_mps, shown_mps)
        assert -0.25 * KMH - 1e-9 <= speed_mps - shown_mps <= 1.25 * KMH + 1e-9


def test_the_effort_is_the_instructions_own_or_that_of_its_force() -> None:
    assert [lever_ratio(n, LARGEST_N) for n in (150e3, -150e3, 9e9, -9e9)] == [0.5, -0.25, 1.0, -1.0]
    assert lever_ratio(0.0, (0.0, 0.0)) == 0.0
    pulls = Instruction(mode=Regime.REDUCED_TRACTION, speed_mps=100.4 * KMH, effort_ratio=0.8)
    brakes = Instruction(mode=Regime.REDUCED_BRAKE, speed_mps=36.9 * KMH, effort_ratio=-0.5)
    holds = Instruction(mode=Regime.CRUISE, speed_mps=20.0)
    assert as_read(Guidance(now=pulls, force_n=1e3), LARGEST_N).lever_ratio == 0.8
    read = as_read(Guidance(now=brakes, following=(pulls,), force_n=-150e3), LARGEST_N)
    assert read.lever_ratio == -0.25
    assert (read.now.speed_mps / KMH, read.following[0].speed_mps / KMH) == pytest.approx((36.0, 100.0))
    assert math.isnan(as_read(Guidance(now=holds, force_n=1e3), LARGEST_N).lever_ratio)


@pytest.mark.parametrize(("to_mps", "sees_mark", "shown"), [(0.0, False, True), (0.0, True, False), (5.0, True, True)])
def test_a_stop_is_braked_for_by_eye_in_the_end(to_mps: float, *, sees_mark: bool, shown: bool) -> None:
    brakes = Instruction(mode=Regime.FULL_BRAKE, speed_mps=to_mps, effort_ratio=-1.0)
    read = as_read(Guidance(now=brakes, force_n=-300e3), LARGEST_N, sees_mark=sees_mark)
    assert math.isfinite(read.lever_ratio) is shown
    assert (read.now.mode is Regime.FULL_BRAKE) is shown
