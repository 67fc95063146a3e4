"""The tuning of the advice: each default is a decision, so a change of one must be meant."""

from __future__ import annotations

import pytest

from das.advice.settings import DEFAULT
from das.domain.units import KMH


def test_defaults() -> None:
    modes, plan, display, stop = DEFAULT.modes, DEFAULT.plan, DEFAULT.display, DEFAULT.stop
    assert (modes.full_effort_ratio, modes.idle_effort_ratio, modes.cruise_acceleration_mps2) == (0.97, 0.02, 0.02)
    assert (modes.ripple_mps, modes.weak_brake_ratio, modes.hold_s) == (pytest.approx(2.0 * KMH), 0.6, 3.0)
    assert (plan.faster_band_mps, plan.slower_band_mps, plan.time_band_s, plan.longest_age_s) == (0.8, 1.4, 2.0, 60.0)
    assert (plan.tolerance_s, plan.unhurried_s, plan.braking_ahead_mps2) == (0.2, 0.5, 0.25)
    assert (plan.slower_than_planned_mps, plan.braked_early_s, plan.overspeed_eased_mps) == (1.0, 5.0, 1.0)
    assert (plan.longest_ratio, plan.passed_m, plan.same_point_m) == (2.5, 5.0, 0.01)
    assert (display.horizon_s, display.valid_for_s, display.overspeed_named_mps) == (30, 3.0, 0.5)
    assert (display.early_named_s, display.missed_named_s, display.least_for_buffer_s) == (5.0, 1.0, 10.0)
    assert (display.speed_step_mps, display.speed_band_ratio) == (pytest.approx(1.0 * KMH), 0.75)
    assert (stop.standstill_m, stop.at_stop_m, stop.lost_beyond_m, stop.back_m) == (1.0, 50.0, 500.0, 200.0)
    passing, reduced = DEFAULT.passing, DEFAULT.reduced
    assert (passing.slowing_mps2, passing.crawl_mps, passing.halvings, passing.prices_tried) == (0.4, 0.5, 24, 2)
    assert (reduced.easy_braking_mps2, reduced.judged_every_s, reduced.halvings) == (0.5, 30.0, 12)
    assert (reduced.slowest_mps, reduced.below_ratio) == (pytest.approx(20.0 * KMH), 0.999)
