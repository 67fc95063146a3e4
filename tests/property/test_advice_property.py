"""Random states, restrictions and delays: no advice above limit or brake curve, and following it arrives.

`DAS_PROPERTY_STATES=100000 pytest tests/property/test_advice_property.py` draws more of them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from das.advice.advice import Advice, Source, Timetable
from das.advice.goal import AT_STOP_M
from das.advice.reason import ReasonCode
from das.advice.regimes import Regime
from das.cab.preparation import onboard_ladder
from das.cab.situation import Situation
from das.domain.files.load import load_route, load_vehicle
from das.domain.restriction import Restriction
from das.domain.units import KMH, NS, STANDARD_GRAVITY_MPS2
from das.estimate.estimate import PositionFix
from das.solver.front import Front
from das.solver.section import Section
from das.solver.solve import solve_front
from das.solver.state import fastest, least_time_s
from sim.drivers.presentations.presenter import SimplerLook
from sim.world.simpler import SimplerDisplay
from tests.support.crossing import numbered
from tests.support.followed import after_a_second_mps
from tests.support.one_section import OneSection

Floats = NDArray[np.float64]

STATES = int(os.environ.get("DAS_PROPERTY_STATES", "2000"))
WORLDS = numbered("DAS_PROPERTY_STATES", STATES)
"""Numbers of states; every so many are of one world."""
STATES_OF_A_WORLD = 100
FOLLOWED_OF_WORLDS = 2
"""In one of so many worlds the advice is followed to the stop."""
END_M = 8_000.0
T0 = 1_800_000_000_000_000_000
ROUTE, TRAIN = load_route("zurich-luzern"), load_vehicle("re460-ic")
LEAST_BRAKING_MPS = 0.3
"""A train too fast loses at least this in a second."""
SLACK_MPS = 0.1
"""The brake curve of this test (steps of 1 m) and the solver's differ by less."""


def ns(seconds: float) -> int:
    return T0 + round(seconds / NS)


class Allowed:
    """Limits and brake curve on a grid of 1 m, by nothing of the solver's: the second witness."""

    def __init__(self, restrictions: tuple[Restriction, ...]) -> None:
        s_m = np.arange(0.0, END_M + 1.0)
        line = ROUTE.limits_mps.at(s_m)
        for one in restrictions:
            line = np.where((s_m >= one.start_m) & (s_m < one.end_m), np.minimum(line, one.limit_mps), line)
        length = round(TRAIN.train_length_m)
        padded = np.concatenate((np.full(length, np.inf), line))
        over_train = np.lib.stride_tricks.sliding_window_view(padded, length + 1).min(axis=1)
        grade = ROUTE.gradients_ratio.mean(s_m - TRAIN.train_length_m, s_m)
        self._mps: list[float] = self._braked(np.minimum(over_train, TRAIN.max_speed_mps), grade).tolist()

    @staticmethod
    def _braked(limit: Floats, grade: Floats) -> Floats:
        """Backwards from the stop with all brakes (those of re460-ic: electric only), resistance and gradient."""
        weight_n = TRAIN.mass_kg * STANDARD_GRAVITY_MPS2
        steps = np.arange(0.0, 60.0, 0.01)
        known_n = (TRAIN.brake_effort_n(steps) + TRAIN.resistance.force_n(steps)).tolist()
        curve, speed = np.zeros(len(limit)), 0.0
        for i in range(len(limit) - 2, -1, -1):
            rate = (known_n[round(speed * 100)] + weight_n * grade[i]) / TRAIN.inertial_mass_kg
            speed = min(math.sqrt(speed**2 + 2.0 * min(rate, TRAIN.max_deceleration_mps2)), float(limit[i]))
            curve[i] = speed
        return curve

    def highest(self, from_m: float, to_m: float) -> float:
        """The highest speed that is allowed anywhere between two positions, 2 m more each way."""
        last_m = len(self._mps) - 1
        first, last = (min(max(int(x), 0), last_m) for x in (from_m - 2.0, to_m + 3.0))
        return max(self._mps[first : last + 1])


@cache
def section_of(restrictions: tuple[Restriction, ...]) -> Section:
    return Situation(route=ROUTE, vehicle=TRAIN, restrictions=restrictions).section(0.0, END_M)


def front_of(section: Section) -> Front:
    return solve_front(section, threads=1, lambda_w=onboard_ladder(section))


def worlds(states: range) -> Iterator[tuple[int, np.random.Generator, tuple[Restriction, ...]]]:
    for number in range(states.start // STATES_OF_A_WORLD, math.ceil(states.stop / STATES_OF_A_WORLD)):
        random = np.random.default_rng([6, number])
        restrictions = []
        for _ in range(int(random.integers(0, 4))):
            start_m = float(random.uniform(-500.0, END_M))
            end_m = start_m + float(random.uniform(20.0, 3000.0))
            restrictions.append(Restriction(start_m=start_m, end_m=end_m, limit_mps=float(random.uniform(4.0, 45.0))))
        yield number, random, tuple(restrictions)


def check(advice: Advice, look: SimplerLook, allowed: Allowed, v_mps: float) -> None:
    """At every sample of the horizon; too fast a train is between where it is and where it should be."""
    now = advice.advised_speed_mps
    assert now <= allowed.highest(advice.s_m, advice.s_m) + SLACK_MPS
    assert now <= advice.limit_mps + 1e-9
    assert len(advice.horizon_speed_mps) == 30
    behind_m = ahead_m = advice.s_m
    slow, fast = now, max(v_mps, now)
    for second, after in enumerate(advice.horizon_speed_mps):
        quick = max(after, fast - LEAST_BRAKING_MPS)
        behind_m, ahead_m = behind_m + 0.5 * (slow + after), ahead_m + 0.5 * (fast + quick)
        slow, fast = after, max(after, quick) if v_mps > now + 1e-6 else after
        assert after >= 0
        reach_m = 0.1 * second
        assert after <= allowed.highest(behind_m - reach_m, ahead_m + reach_m) + SLACK_MPS, (second, behind_m, ahead_m)
    assert advice.display_speed_mps <= allowed.highest(advice.s_m, advice.s_m) + SLACK_MPS
    top_mps = look.top_speed_mps
    assert top_mps <= advice.limit_mps
    assert top_mps <= allowed.highest(advice.s_m, advice.s_m) + SLACK_MPS
    assert top_mps / KMH == pytest.approx(round(top_mps / KMH), abs=1e-6)
    assert -1 - 1e-3 <= advice.advised_force_ratio <= 1 + 1e-3


def look_at(section: Section, advice: Advice, left_s: float) -> SimplerLook:
    """What a display of one top speed shows of an advice."""
    return SimplerDisplay(section).look(advice, 0, ns(left_s))


def check_horizon(advice: Advice, allowed: Allowed) -> None:
    """Where a driver is who keeps to the samples, none of them is above limit or brake curve."""
    assert advice.horizon_speed_mps
    at_m, before = advice.s_m, advice.advised_speed_mps
    for after in advice.horizon_speed_mps:
        at_m, before = at_m + 0.5 * (before + after), after
        assert after <= allowed.highest(at_m, at_m) + SLACK_MPS


def asked(front: Front, s_m: float, v_mps: float, arrival_s: float, now_s: float = 0.0) -> OneSection:
    advisor = OneSection(front)
    advisor.set_timetable(Timetable(departure_ns=ns(-5000), arrival_ns=ns(arrival_s)))
    advisor.set_position(PositionFix(time_ns=ns(now_s), s_m=s_m, speed_mps=v_mps))
    return advisor


def drawn(random: np.random.Generator, section: Section) -> tuple[float, float, float]:
    """A state and the time left: mostly possible, sometimes too fast; from too late by much to far too early."""
    s_m = float(random.uniform(0.0, END_M - AT_STOP_M - 1.0))
    most = float(np.interp(s_m, section.node_m, section.envelope_mps))
    v_mps = most * float(random.choice([random.uniform(0.0, 1.0), 1.0, random.uniform(1.0, 1.2)], p=[0.8, 0.1, 0.1]))
    return s_m, min(v_mps, 50.0), float((END_M - s_m) / 25.0 * random.uniform(-0.5, 4.0))


@pytest.mark.parametrize("states", WORLDS)
def test_no_advice_is_above_limit_or_brake_curve(states: range) -> None:
    """Random states, restrictions and times: advised speeds against limits and a brake curve of this file's own."""
    free = front_of(section_of(()))
    given = 0
    for _, random, restrictions in worlds(states):
        section, allowed = section_of(restrictions), Allowed(restrictions)
        front = front_of(section)
        for _ in range(STATES_OF_A_WORLD):
            s_m, v_mps, left_s = drawn(random, section)
            advice = asked(front, s_m, v_mps, left_s).update(ns(0))
            assert advice.mode is not Regime.NONE, advice.reason
            check(advice, look_at(section, advice, left_s), allowed, v_mps)
            given += 1
            if restrictions and given % 5 == 0:
                # Told while the plan of the free line holds; the front is not there yet.
                advisor = asked(free, s_m, v_mps, left_s)
                advisor.update(ns(0))
                advisor.set_section(section)
                meanwhile = advisor.update(ns(0))
                assert meanwhile.source is Source.FALLBACK
                check(meanwhile, look_at(section, meanwhile, left_s), allowed, v_mps)
    assert given >= len(states)


@pytest.mark.parametrize("states", WORLDS)
def test_following_the_advice_arrives_and_never_above_what_is_allowed(states: range) -> None:
    """From a random state, told of the restrictions a little later; the front comes 3 s after that."""
    free = front_of(section_of(()))
    for number, random, restrictions in worlds(states):
        if number % FOLLOWED_OF_WORLDS:
            continue
        section, allowed = section_of(restrictions), Allowed(restrictions)
        s_m, v_mps, left_s = drawn(random, section)
        v_mps = min(v_mps, 0.999 * float(np.interp(s_m, section.node_m, section.envelope_mps)))
        advisor = asked(free, s_m, v_mps, left_s)
        for second in range(4000):
            if second == 1:
                advisor.set_section(section)
            if second == 4:
                advisor.set_front(front_of(section))
            advisor.set_position(PositionFix(time_ns=ns(second), s_m=s_m, speed_mps=v_mps))
            advice = advisor.update(ns(second))
            assert advice.mode is not Regime.NONE, advice.reason
            if advice.reason.code is ReasonCode.ARRIVED:
                break
            if second > 30:  # too fast for what it has just been told of at the most until then
                assert v_mps <= allowed.highest(s_m, s_m) + 2 * SLACK_MPS, (second, s_m)
            after = after_a_second_mps(advice)
            s_m, v_mps = s_m + 0.5 * (v_mps + after), after
        assert advice.reason.code is ReasonCode.ARRIVED, (restrictions, s_m, v_mps)
        assert abs(s_m - END_M) <= AT_STOP_M
        if advisor.plan is not None:
            assert advisor.plan.solution.feasible


@pytest.mark.nightly
@pytest.mark.parametrize("restrictions", [(), (Restriction(start_m=4000.0, end_m=5000.0, limit_mps=15.0),)])
def test_advice_is_continuous_in_what_is_heard(restrictions: tuple[Restriction, ...]) -> None:
    """A little further, faster or later changes the speeds of the next 30 s a little.

    Not always: where two ways of driving cost the same (mostly with far too much time), either is as good.
    """
    section = section_of(restrictions)
    front, random = front_of(section), np.random.default_rng(7)
    jumps = []
    for _ in range(min(STATES // 10, 2000)):
        s_m, v_mps, left_s = drawn(random, section)
        v_mps = min(v_mps, 0.99 * float(np.interp(s_m, section.node_m, section.envelope_mps)))
        here = asked(front, s_m, v_mps, left_s).update(ns(0))
        there = asked(front, s_m + 0.2, v_mps + 0.005, left_s - 0.02).update(ns(0))
        assert abs(here.advised_speed_mps - there.advised_speed_mps) <= 0.05
        jumps.append(max(abs(a - b) for a, b in zip(here.horizon_speed_mps, there.horizon_speed_mps, strict=True)))
    assert np.percentile(jumps, 98) <= 0.1
    assert max(jumps) <= 2.0


def test_the_fastest_run_needs_no_front() -> None:
    """The fastest run and its time are the same without a front as with the solved one."""
    section = section_of(())
    whole = front_of(section)
    assert fastest(section, 3000.0, 20.0).time_s == whole.fastest(3000.0, 20.0).time_s
    assert least_time_s(section, 3000.0, 20.0) == whole.least_time_s(3000.0, 20.0)


@pytest.mark.parametrize("number", [pytest.param(i, marks=pytest.mark.nightly if i > 6 else ()) for i in range(20)])
def test_a_train_that_is_too_fast_has_no_horizon_above_a_limit_ahead(number: int) -> None:
    random = np.random.default_rng([25, number])
    start_m = float(random.uniform(1500.0, 6000.0))
    first = Restriction(start_m=start_m, end_m=start_m + 600.0, limit_mps=float(random.uniform(12.0, 25.0)))
    second = Restriction(start_m=start_m + 150.0, end_m=start_m + 500.0, limit_mps=float(random.uniform(4.0, 10.0)))
    section = section_of((first, second))
    allowed, front = Allowed((first, second)), front_of(section)
    for _ in range(20):
        s_m = start_m + float(random.uniform(-600.0, 140.0))
        v_mps = float(np.interp(s_m, section.node_m, section.allowed_mps)) + float(random.uniform(1.0, 12.0))
        advice = asked(front, s_m, v_mps, 400.0).update(ns(0))
        assert advice.reason.code is ReasonCode.TOO_FAST
        check_horizon(advice, allowed)


@pytest.mark.parametrize("beyond_m", [-0.9, -0.3, 0.0, 3.0, 20.0])
def test_at_the_stop_the_horizon_is_to_stand(beyond_m: float) -> None:
    section = section_of(())
    for v_mps in (0.4, 1.0, 3.0, 8.0):
        advice = asked(front_of(section), END_M + beyond_m, v_mps, 400.0).update(ns(0))
        assert advice.reason.code is ReasonCode.STOP
        assert max(advice.horizon_speed_mps[1:]) == pytest.approx(0.0, abs=1e-9 if beyond_m >= 0 else 0.1)
        check_horizon(advice, Allowed(()))
