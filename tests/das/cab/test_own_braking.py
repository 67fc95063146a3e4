"""The braking of a site's drivers: all advice plans with it, and the safe speeds stay those of the train."""

from __future__ import annotations

import numpy as np
import pytest

from das.advice.advice import Source
from das.advice.reason import ReasonCode
from das.advice.regimes import Regime
from das.cab.heard import Target
from das.cab.preparation import Fronts
from das.cab.situation import Situation
from das.domain.braking import USUAL, SiteBraking
from das.domain.units import KMH
from tests.support.small_trips import LINE, TRAIN, SmallTrip, at, follow, ns, trip

GENTLE = SiteBraking(deceleration_mps2=0.3, below_limit_mps=3.0 * KMH)


def gentle_trip() -> SmallTrip:
    return trip(braking=GENTLE)


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
    assert advice.reason.code is not ReasonCode.TOO_FAST
    assert advice.mode in (Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE)
    assert advice.advised_force_n < -0.4 * made.leg.section.train.inertial_mass_kg, "harder than he brakes by himself"


def test_a_point_ahead_is_planned_for_with_the_drivers_braking() -> None:
    made = gentle_trip()
    target = Target(s_m=3500.0, earliest_ns=ns(200), latest_ns=None, reason="signal")
    made.set_targets([target])
    at(made, 60, 1500.0, 24.0)
    assert made.plan is not None
    own = made.leg.section
    run = made.plan.solution.trajectory
    assert np.all(run.v_mps**2 <= np.interp(run.s_m, own.node_m, own.envelope_mps**2) + 0.05)


def test_fronts_of_different_drivers_are_different_ones() -> None:
    fronts = Fronts(threads=1, kept_bytes=200_000_000)
    usual, gentle = (
        Situation(route=LINE, vehicle=TRAIN, braking=braking).section(0.0, 5000.0) for braking in (USUAL, GENTLE)
    )
    own = fronts.find(gentle)
    assert own is fronts.find(gentle)
    assert own is not fronts.find(usual)
    assert own.section.envelope_mps.max() < usual.envelope_mps.max()
    assert own.section.allowed_mps.max() == usual.allowed_mps.max()
