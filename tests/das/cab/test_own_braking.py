"""A site that says how its drivers brake: all advice plans with that, and what is safe stays what the train can do."""

from __future__ import annotations

import numpy as np
import pytest

from das.advice.advice import Source
from das.advice.coach.settings import CoachSettings, DriverSettings
from das.advice.modes import Mode
from das.advice.own_braking import AS_THE_TRAIN, as_driven
from das.advice.settings import AdviceSettings
from das.cab.fronts import Fronts
from das.cab.heard import Target
from das.domain.units import KMH
from das.solver.section import build_section
from tests.support.small_trips import FRONTS, LINE, TRAIN, SmallTrip, at, follow, ns, trip

GENTLE = DriverSettings(planning_brake_mps2=0.3, below_limit_mps=3.0 * KMH)


def gentle_trip() -> SmallTrip:
    return trip(settings=AdviceSettings(coach=CoachSettings(driver=GENTLE)))


def test_a_site_that_says_nothing_changes_nothing() -> None:
    section = build_section(LINE, TRAIN, end_m=5000.0)
    assert as_driven(section, AS_THE_TRAIN) is section
    assert FRONTS.find(section, driver=AS_THE_TRAIN) is FRONTS.find(section)


def test_plans_brake_and_keep_below_limits_as_the_drivers_do() -> None:
    made, highest_mps, hardest_mps2 = gentle_trip(), 0.0, 0.0
    for _ in follow(made):
        assert made.plan is not None or made.leg.here is not None
        if made.plan is not None:
            run = made.plan.solution.trajectory
            highest_mps = max(highest_mps, float(run.v_mps.max()))
            rates = -np.diff(run.v_mps**2) / (2.0 * np.diff(run.s_m))
            hardest_mps2 = max(hardest_mps2, float(rates.max()))
    assert highest_mps <= 30.0 - GENTLE.below_limit_mps + 1e-6
    assert hardest_mps2 <= 0.3 + 0.01


def test_a_train_above_the_drivers_curve_but_below_its_own_is_still_planned_for() -> None:
    """4 m/s above what his braking leads to: the plan brakes, and nobody says that the train is too fast."""
    made, strict = gentle_trip(), trip()
    at_m = 5000.0 - 25.0**2 / (2 * 0.3) + 300.0
    allowed = made.leg.planner.allowed_mps(at_m)
    assert allowed == pytest.approx(strict.leg.planner.allowed_mps(at_m))
    advice = at(made, 200, at_m, 24.0)
    assert allowed > 24.0
    assert advice.source is Source.SOLVED
    assert "fast" not in advice.reason.replace("fastest", "")
    assert advice.mode in (Mode.REDUCED_BRAKE, Mode.FULL_BRAKE, Mode.FRICTION_BRAKE)
    assert advice.advised_speed_mps < 24.0 - 2.0


def test_a_point_ahead_is_planned_for_with_the_drivers_braking() -> None:
    made = gentle_trip()
    target = Target(s_m=3500.0, earliest_ns=ns(200), latest_ns=None, reason="signal")
    made.set_targets([target])
    at(made, 60, 1500.0, 24.0)
    assert made.plan is not None
    own = FRONTS.find(made.leg.section, driver=GENTLE).front.section
    run = made.plan.solution.trajectory
    assert np.all(run.v_mps**2 <= np.interp(run.s_m, own.node_m, own.envelope_mps**2) + 0.05)


def test_fronts_of_different_drivers_are_different_ones() -> None:
    section, fronts = build_section(LINE, TRAIN, end_m=5000.0), Fronts(threads=1, kept_bytes=200_000_000)
    own = fronts.find(section, driver=GENTLE)
    assert own is fronts.find(section, driver=GENTLE)
    assert own is not fronts.find(section)
    assert own.front.section.envelope_mps.max() < section.envelope_mps.max()
