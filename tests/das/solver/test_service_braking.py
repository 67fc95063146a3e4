"""Sections planned with a service braking: the envelope by closed forms, and drivers who brake late."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from das.domain.braking import USUAL, ServiceBraking, SiteBraking
from das.domain.files.load import load_route, load_vehicle
from das.domain.vehicle import BrakePolicy, Resistance, ServiceBrake, Vehicle
from das.solver.kernels.driving import SLOW_MPS
from das.solver.section import Section, SectionOptions, build_section, with_braking
from tests.support.making import make_route, make_train

RATE_MPS2 = 0.6
BRAKING = ServiceBraking(deceleration_mps2=RATE_MPS2, build_up_s=2.0, reaction_s=1.5, deviation_m=8.0)
LENGTH_M = 150.0


def strong_train() -> Vehicle:
    """A train without resistance whose brakes give more than the service deceleration at every speed."""
    made = make_train(resistance=(1.0, 0.0, 0.0), power_w=2e7)
    return replace(made, brake_policy=BrakePolicy.BLENDED, friction_brake_force_n=1e6, train_length_m=LENGTH_M)


def planned(limits: list[tuple[float, float]], braking: ServiceBraking | None = BRAKING) -> Section:
    return build_section(make_route(6000.0, limits), strong_train(), options=SectionOptions(braking=braking))


def distance_m(section: Section, v_mps: float) -> float:
    """How far before the end the envelope comes down to a speed."""
    rising = section.envelope_mps[::-1]
    return section.end_m - float(np.interp(v_mps**2, rising**2, section.node_m[::-1]))


@pytest.mark.parametrize("v_mps", [2.0, 5.0, 12.0, 25.0, 38.0])
def test_the_way_to_a_stop_is_that_of_a_late_brake(v_mps: float) -> None:
    """D(v) = v²/2a + t·v − t·v₀/2 from v₀ on, and v²/2·(1/a + t/v₀) below."""
    section, delay_s = planned([(0.0, 40.0)]), 1.5 + 0.5 * 2.0
    if v_mps >= SLOW_MPS:
        expected_m = v_mps**2 / (2 * RATE_MPS2) + delay_s * (v_mps - 0.5 * SLOW_MPS)
    else:
        expected_m = 0.5 * v_mps**2 * (1 / RATE_MPS2 + delay_s / SLOW_MPS)
    assert distance_m(section, v_mps) == pytest.approx(expected_m, rel=2e-3, abs=0.3)


@pytest.mark.parametrize("v_mps", [8.0, 20.0, 39.0])
def test_a_driver_who_brakes_as_late_as_planned_stops_within_metres(v_mps: float) -> None:
    """He runs on for reaction and half of the build-up, then brakes as in service: at most t·v₀/2 beyond the mark."""
    section = planned([(0.0, 40.0)])
    needs_m = v_mps * BRAKING.delay_s + v_mps**2 / (2 * RATE_MPS2)
    assert needs_m - distance_m(section, v_mps) <= 0.5 * SLOW_MPS * BRAKING.delay_s + 0.3


@pytest.mark.parametrize("v_mps", [20.0, 39.0])
def test_on_a_descent_the_train_gains_speed_before_its_brakes_act(v_mps: float) -> None:
    """It runs on for the delay, gains b·t, and brakes from there as in service."""
    route = make_route(6000.0, [(0.0, 40.0)], [(0.0, -0.012)])
    section = build_section(route, strong_train(), options=SectionOptions(braking=BRAKING))
    delay_s, gain_mps2 = BRAKING.delay_s, 0.012 * 9.80665
    needs_m = v_mps * delay_s + 0.5 * gain_mps2 * delay_s**2 + (v_mps + gain_mps2 * delay_s) ** 2 / (2 * RATE_MPS2)
    late_m = needs_m - distance_m(section, v_mps)
    assert -0.3 <= late_m <= 0.5 * SLOW_MPS * delay_s * (1.0 + gain_mps2 / RATE_MPS2) + 1.0


def test_a_lower_limit_holds_before_its_place_and_longer_than_the_train() -> None:
    """The deviation of the position: 8 m before it, and 8 m behind its end."""
    section = planned([(0.0, 30.0), (2000.0, 20.0), (3000.0, 30.0)])
    node_m, envelope = section.node_m, section.envelope_mps
    slow = node_m[envelope <= 20.0 + 1e-6]
    inner = slow[(slow > 1000.0) & (slow < 4000.0)]
    assert inner.min() == pytest.approx(2000.0 - 8.0, abs=0.01)
    assert inner.max() == pytest.approx(3000.0 + LENGTH_M + 8.0, abs=0.01)
    assert section.limit_mps[np.searchsorted(node_m, 1996.0) - 1] == 30.0, "the limit itself is the line's"


def test_margins_below_limits_leave_a_speed_to_go() -> None:
    section = planned([(0.0, 30.0), (2000.0, 1.5), (3000.0, 30.0)], replace(BRAKING, below_limit_mps=5.0))
    assert section.envelope_mps.max() == pytest.approx(25.0)
    assert section.envelope_mps[np.searchsorted(section.node_m, 2500.0)] == pytest.approx(1.5)


def test_full_brakes_are_the_same_with_and_without_a_service_braking() -> None:
    route, train = load_route("zurich-luzern"), load_vehicle("re460-ic")
    full = build_section(route, train)
    section = with_braking(full, USUAL.of(train))
    assert np.array_equal(full.envelope_mps, full.allowed_mps)
    _, of_full, of_both = np.intersect1d(full.node_m.round(3), section.node_m.round(3), return_indices=True)
    assert len(of_full) > 100
    assert section.allowed_mps[of_both] == pytest.approx(full.allowed_mps[of_full], abs=0.1)
    assert (section.envelope_mps <= section.allowed_mps + 1e-9).all()
    assert (section.envelope_mps >= section.floor_mps - 1e-9).all()
    assert with_braking(section, None).envelope_mps == pytest.approx(full.envelope_mps)


def test_hills_come_before_the_reserve_of_the_brakes() -> None:
    """A summit that is climbed only at speed: the reserve for the limit behind it does not let the train stall."""
    hill = [(0.0, 0.0), (2500.0, 0.03), (3000.0, 0.0)]
    route = make_route(6000.0, [(0.0, 30.0), (3100.0, 12.0)], grades=hill)
    weak = replace(strong_train(), traction=replace(strong_train().traction, max_force_n=2.5e4))
    section = build_section(route, weak, options=SectionOptions(braking=BRAKING))
    assert (section.envelope_mps >= section.floor_mps - 1e-9).all()
    assert section.fastest_run.time_to_go_s[0] > 0


def test_a_site_changes_what_the_file_of_the_train_says() -> None:
    train = replace(strong_train(), service_brake=ServiceBrake(deceleration_mps2=0.45, build_up_s=6.0))
    assert USUAL.of(train).deceleration_mps2 == 0.45
    assert USUAL.of(train).delay_s == pytest.approx(USUAL.reaction_s + 3.0)
    site = SiteBraking(deceleration_mps2=0.3, reaction_s=2.5, below_limit_mps=1.0).of(train)
    assert (site.deceleration_mps2, site.build_up_s, site.reaction_s, site.below_limit_mps) == (0.3, 6.0, 2.5, 1.0)
    assert math.isclose(site.delay_s, 5.5)


def test_resistance_helps_no_more_than_the_service_deceleration() -> None:
    held = replace(strong_train(), resistance=Resistance(c0_n=5e4, c1_n_per_mps=0.0, c2_n_per_mps2=0.0))
    section = build_section(make_route(6000.0, [(0.0, 30.0)]), held, options=SectionOptions(braking=BRAKING))
    falls = -np.diff(section.envelope_mps**2) / (2 * section.step_m)
    assert falls.max() <= RATE_MPS2 + 1e-6
