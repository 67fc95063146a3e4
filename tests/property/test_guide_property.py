"""Random states, restrictions, times and windows: nothing that the guide says is above what is allowed.

`DAS_PROPERTY_STATES=100000 pytest tests/property/test_guide_property.py` draws more of them.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from das.advice.advice import Advice, Guidance, ReplanCause, Timetable
from das.advice.goal import AT_END_M, PassingTarget
from das.advice.guide.guard import BRAKED_MPS
from das.advice.guide.guide import Guide
from das.advice.planner import Planner
from das.advice.regimes import BRAKES, TRACTION, Regime, departure_regime
from das.advice.shown import OVERSPEED_MPS
from das.cab.leg import Leg
from das.cab.preparation import onboard_ladder
from das.cab.situation import Situation
from das.domain.files.load import load_route, load_vehicle
from das.domain.restriction import Restriction
from das.domain.units import NS
from das.estimate.estimate import Estimate
from das.solver.guide.policies import LEAST_MPS, GuideFront
from das.solver.solve import solve_front
from tests.support.crossing import numbered

STATES_OF_A_LEG, LEGS_OF_A_WORLD = 25, 5
T0 = 1_800_000_000_000_000_000
TRAIN = load_vehicle("re460-ic")
SECTIONS = (("flat-6km", 0), ("zurich-luzern", 0), ("zurich-luzern", 1), ("zurich-luzern", 2))
SHOWN_MPS = 0.3
"""What was shown before may stand above the limit by so much: the display shows the same."""
SLOWING = {Regime.COAST, Regime.STOP, *BRAKES}


def ns(seconds: float) -> int:
    return T0 + round(seconds / NS)


class World:
    """A bundled section with restrictions, its fronts, and random states of it."""

    def __init__(self, number: int) -> None:
        self.random = random = np.random.default_rng([17, number])
        name, index = SECTIONS[number % len(SECTIONS)]
        route = load_route(name)
        self.start, self.end = list(pairwise(route.stops))[index]
        self.start_m, self.end_m = self.start.position_m, self.end.position_m
        restrictions = []
        for _ in range(int(random.integers(0, 3))):
            from_m = float(random.uniform(self.start_m - 300.0, self.end_m))
            to_m = from_m + float(random.uniform(50.0, 2000.0))
            restrictions.append(Restriction(start_m=from_m, end_m=to_m, limit_mps=float(random.uniform(5.0, 40.0))))
        self.limits = route.with_restrictions(restrictions).limits_mps
        situation = Situation(route=route, vehicle=TRAIN, restrictions=tuple(restrictions))
        self.section = situation.section(self.start_m, self.end_m)
        self.front = solve_front(self.section, threads=1, lambda_w=onboard_ladder(self.section))
        self.guide = GuideFront(self.section)

    def leg(self) -> Leg:
        """A leg with a guide, with a random time left, and in every third case with a window at a point."""
        leg = Leg(self.start, self.end, self.section, Guide(self.section, None))
        leg.use(Planner(self.section, self.front))
        leg.use_guide(self.guide)
        arrival_s = float((self.end_m - self.start_m) / 25.0 * self.random.uniform(0.2, 3.0))
        leg.set_timetable(Timetable(departure_ns=ns(-5000), arrival_ns=ns(arrival_s)))
        if self.random.random() < 0.33:
            earliest_s = float(self.random.uniform(0.0, arrival_s))
            at_m = float(self.random.uniform(self.start_m + 500.0, self.end_m - 500.0))
            point = PassingTarget(s_m=at_m, earliest_ns=ns(earliest_s), latest_ns=ns(earliest_s + 60.0))
            leg.points = [point]
        return leg

    def state(self, second: float) -> Estimate:
        """A state of the section: mostly possible, sometimes too fast, sometimes at a stand."""
        random = self.random
        s_m = float(random.uniform(self.start_m, self.end_m - AT_END_M - 1.0))
        most = float(np.interp(s_m, self.section.node_m, self.section.allowed_mps))
        share = float(
            random.choice([random.uniform(0.0, 1.0), 1.0, random.uniform(1.0, 1.3), 0.0], p=[0.7, 0.1, 0.15, 0.05])
        )
        return Estimate(
            time_ns=ns(second), fix_time_ns=ns(second), s_m=s_m, speed_mps=min(share * most, 55.0), position_sd_m=1.0,
            speed_sd_mps=0.1, problem=None,
        )  # fmt: skip

    def limit_mps(self, s_m: float) -> float:
        """The limit over the train, of the route's list alone: the second witness."""
        places = np.array([s_m - TRAIN.train_length_m]), np.array([s_m + 1e-6])
        return min(float(self.limits.minimum(*places)[0]), TRAIN.max_speed_mps)

    def highest_mps(self, from_m: float, to_m: float) -> float:
        """The highest speed from which limits and stop ahead can be kept, anywhere between two positions."""
        section = self.section
        inside = section.allowed_mps[(section.node_m > from_m) & (section.node_m < to_m)]
        ends = np.interp([from_m, to_m], section.node_m, section.allowed_mps)
        return float(max(inside.max(initial=0.0), ends.max()))


def check(advice: Advice, guide: Guidance, world: World, here: Estimate) -> None:
    now, s_m, v_mps = guide.now, here.s_m, here.speed_mps
    allowed = world.highest_mps(s_m, s_m)
    assert math.isfinite(now.speed_mps)
    assert now.speed_mps <= world.limit_mps(s_m) + SHOWN_MPS + 1e-9
    if now.mode in TRACTION or now.mode is Regime.CRUISE:
        assert now.speed_mps <= world.highest_mps(s_m, s_m + guide.target_m) + SHOWN_MPS, "cannot be reached safely"
    if v_mps > allowed + OVERSPEED_MPS + 0.05:
        # Where coasting would not slow the train down, it is told to hold what is allowed.
        held = now.mode is Regime.CRUISE and now.speed_mps <= allowed + SHOWN_MPS
        assert held or now.mode in SLOWING, (v_mps, allowed)
    if v_mps > allowed + BRAKED_MPS + 0.05:
        assert now.mode in BRAKES or now.mode is Regime.STOP
    if now.mode in TRACTION:
        assert guide.force_n >= 0.0
        assert 0.0 < now.effort_ratio <= 1.0
    if now.mode in BRAKES:
        assert guide.force_n <= 0.0
    assert guide.target_m >= 0.0
    assert all(math.isfinite(one.speed_mps) and one.way_m > -1.0 for one in guide.following)
    assert all(a.in_s <= b.in_s for a, b in pairwise(guide.following))
    creeps = now.mode is Regime.CRUISE and now.speed_mps <= LEAST_MPS
    assert guide.replan.cause is not ReplanCause.NONE or now.mode in (Regime.STOP, *BRAKES) or creeps
    assert advice.mode is not Regime.NONE
    check_one_message(advice, guide)


def check_one_message(advice: Advice, guide: Guidance) -> None:
    """The guide and the rest of its message say one thing: what is to be done now, or what comes next."""
    now = guide.now
    if now.mode is Regime.DEPART:
        said = advice.next_mode, advice.departure_speed_mps
        wanted = departure_regime(now.effort_ratio), now.speed_mps
        assert said == wanted or math.isnan(now.effort_ratio)
    elif now.in_s > 0.0:
        assert advice.next_mode is now.mode
    elif guide.replan.cause is not ReplanCause.NONE:  # Else the train brakes without a plan.
        if now.mode in BRAKES:
            assert advice.mode in BRAKES
            assert advice.advised_force_n <= guide.reference_force_n
        else:
            assert (advice.mode, advice.advised_force_n) == (now.mode, guide.reference_force_n)


@pytest.mark.parametrize("numbers", numbered("DAS_PROPERTY_STATES", 600))
def test_nothing_that_the_guide_says_is_above_what_is_allowed(numbers: range) -> None:
    """Random states a second apart on every bundled section, with and without restrictions and windows."""
    given, silent, legs = 0, 0, numbers[::STATES_OF_A_LEG]
    for number, _ in enumerate(legs, numbers.start // STATES_OF_A_LEG):
        if number % LEGS_OF_A_WORLD == 0 or not given:
            world = World(number // LEGS_OF_A_WORLD)
        leg = world.leg()
        for second in range(STATES_OF_A_LEG):
            here = world.state(float(second))
            leg.see(here)
            leg.refresh_goal()
            advice = leg.advise(here)
            if advice.guide is None:
                silent += 1
                continue
            check(advice, advice.guide, world, here)
            given += 1
    assert given >= 0.97 * len(numbers), silent
