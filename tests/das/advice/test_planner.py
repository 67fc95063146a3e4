"""The speeds allowed for a train that may be further ahead than estimated, and the advice for one above its plan."""

from __future__ import annotations

import numpy as np
import pytest

from das.advice.display import Scene, braked_enough, kept_behind
from das.advice.goal import Goal, SpeedsAllowed, TrainState
from das.advice.planner import Planner
from das.advice.regimes import Regime
from das.advice.shown import OVERSPEED_MPS
from das.domain.braking import USUAL
from das.estimate.estimate import Estimate
from das.solver.section import SectionOptions, build_section
from das.solver.solve import solve_front
from das.solver.state import least_time_s
from tests.support.making import make_route
from tests.support.small_trips import TRAIN

END_M = 8000.0
OPTIONS = SectionOptions(braking=USUAL.of(TRAIN), point_mass=True)
PLANNER = Planner(build_section(make_route(END_M, [(0.0, 30.0), (4000.0, 15.0)]), TRAIN, options=OPTIONS))


def scene_of(state: TrainState, planner: Planner = PLANNER) -> Scene:
    """What the display sees of a train in a state."""
    place = SpeedsAllowed(planner.allowed_for(state), planner.limit_mps(state.s_m))
    return Scene(state, Estimate(time_ns=state.now_ns), planner, Goal(), place)


def test_the_end_of_the_section_is_a_stop() -> None:
    assert PLANNER.lowest_allowed_mps(7000.0, END_M) == 0.0
    assert PLANNER.lowest_allowed_mps(7000.0, END_M - 1.0) > 0.0


def test_a_train_that_may_be_further_ahead_is_allowed_what_holds_there() -> None:
    """On the braking curve the allowed speed is lower by what the curve falls over the extra distance."""
    s_m, ahead_m = 3900.0, 60.0
    here, there = (PLANNER.allowed_for(TrainState(0, s_m, 20.0, way_m)) for way_m in (0.0, ahead_m))
    planned_m = USUAL.of(TRAIN).deviation_m
    assert planned_m > 0.0
    assert there == pytest.approx(PLANNER.allowed_mps(s_m + ahead_m + planned_m))
    assert there < here - 0.5


def test_the_horizon_of_a_late_driver_stays_below_what_is_allowed_on_his_way() -> None:
    """The plan has already passed the low speeds before the limit; a slower driver still has them ahead."""
    state = TrainState(0, 3900.0, 22.0)
    planned_m = 3900.0 + 25.0 * np.arange(1, 11)
    kept = kept_behind(np.full(10, 30.0), 20.0, state, planned_m, PLANNER)
    at_m, before = state.s_m, 20.0
    for speed in kept.tolist():
        at_m += 0.5 * (before + speed)
        before = speed
        assert speed <= PLANNER.allowed_mps(at_m) + 0.05
    assert kept[-1] == pytest.approx(15.0)


@pytest.mark.parametrize(("over_mps", "brakes_fully"), [(0.2, False), (0.9, True)])
def test_a_train_too_fast_where_a_lower_limit_is_about_to_begin_needs_all_brakes(
    over_mps: float, brakes_fully: bool
) -> None:
    """At that place the planned braking curve has reached the lower limit and does not fall any further."""
    assert 0.2 < OVERSPEED_MPS < 0.9
    s_m, v_mps = 3996.0, 15.0 + over_mps
    state, ahead = TrainState(0, s_m, v_mps), PLANNER.ahead
    assert not ahead.is_due(s_m, v_mps)
    _, force_n = braked_enough(Regime.CRUISE, 0.0, scene_of(state), v_mps)
    most_n = ahead.force_n(ahead.largest(s_m, v_mps), s_m, v_mps)
    assert (force_n == pytest.approx(most_n, rel=0.01)) is brakes_fully


def test_a_train_near_its_limit_is_shown_no_more_traction_than_a_driver_can_cut_off_in_time() -> None:
    """The next advice comes in 1 s, and a driver follows it within 2 s: until then 0.5 m/s may be gained."""
    state, section = TrainState(0, 1000.0, 29.5), PLANNER.section
    mode, force_n = braked_enough(Regime.FULL_TRACTION, 50e3, scene_of(state), 29.5)
    gained_mps2 = (force_n - section.resistance_n(1000.0, 29.5)) / section.train.inertial_mass_kg
    assert (mode, 3.0 * gained_mps2) == (Regime.FULL_TRACTION, pytest.approx(0.5))


def test_a_train_that_rolls_above_its_limit_on_a_descent_is_braked_back_to_it() -> None:
    """It is 1 km/h above the limit, which is not yet too fast, and coasting would add to that."""
    descent = build_section(make_route(END_M, [(0.0, 30.0)], [(0.0, -0.02)]), TRAIN, options=OPTIONS)
    planner = Planner(descent)
    for v_mps, brakes in ((30.3, True), (29.9, False)):
        found = braked_enough(Regime.COAST, 0.0, scene_of(TrainState(0, 3000.0, v_mps), planner), v_mps)
        assert (found[0] is Regime.REDUCED_BRAKE, found[1] < 0.0) == (brakes, brakes)


def test_a_late_driver_who_brakes_as_planned_has_not_braked_early() -> None:
    """A plan that is too old is followed by one that arrives as soon as the train can, not 5 s later."""
    planner, late = Planner(PLANNER.section, solve_front(PLANNER.section)), Goal(due_ns=1)
    first = planner.plan_for(TrainState(0, 1500.0, 28.0), late)
    here = first.at(3850.0)
    assert first.speed_w[here.interval] > first.speed_w[here.interval + 1], "it brakes for 15 m/s"
    again = planner.plan_for(TrainState(round(here.time_s * 1e9), 3850.0, here.speed_mps), late)
    assert again is not first
    least_s = least_time_s(PLANNER.section, 3850.0, here.speed_mps)
    assert again.solution.time_s == pytest.approx(least_s, abs=0.5)
