"""Braking ahead: the effort needed, checked by an independent integration, and when a brake is due."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.advice.braking import BACK_IN_S, SPEED_SLACK_MPS, STOP_SLACK_M, BrakingAhead, braking_mode
from das.advice.regimes import Regime
from das.domain.braking import USUAL
from das.domain.files.load import load_vehicle
from das.domain.route import Tunnel, Zone
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver.section import Section, SectionOptions, build_section
from tests.support.making import make_route

TRAIN = load_vehicle("re460-ic")
END_M = 8000.0


def line(vehicle: Vehicle = TRAIN, gradient: float = 0.0) -> Section:
    """A section with limits of 35 m/s, from km 4 on 25 m/s, from km 5 to 6 15 m/s, then 35 m/s again."""
    limits = [(0.0, 35.0), (4000.0, 25.0), (5000.0, 15.0), (6000.0, 35.0)]
    route = make_route(END_M, limits, grades=[(0.0, gradient)])
    return build_section(route, vehicle, options=SectionOptions(braking=USUAL.of(vehicle), point_mass=True))


def speed_after_mps(vehicle: Vehicle, effort: float, v_mps: float, way_m: float, gradient: float = 0.0) -> float:
    """The speed of a train after braking with an effort, in steps of 0.1 m: F = effort·min(F_max, P/v)."""
    brake, w = vehicle.electric_brake, v_mps**2
    for _ in range(round(way_m / 0.1)):
        if w <= 0:
            return 0.0
        v = w**0.5
        force_n = effort * min(brake.max_force_n, brake.max_power_w / v)
        held_n = float(vehicle.resistance.force_n(v)) + vehicle.mass_kg * 9.80665 * gradient
        w -= 0.2 * (force_n + held_n) / vehicle.inertial_mass_kg
    return max(w, 0.0) ** 0.5


@pytest.mark.parametrize("gradient", [-0.015, 0.0, 0.012])
@pytest.mark.parametrize(("s_m", "v_mps", "to_m", "target"), [(3400.0, 30.0, 4000.0, 25.0), (7000.0, 24.0, END_M, 0.0)])
def test_the_effort_leads_to_the_speed_at_the_place(
    gradient: float, s_m: float, v_mps: float, to_m: float, target: float
) -> None:
    ahead = BrakingAhead(line(gradient=gradient))
    effort = ahead.effort_to(s_m, v_mps, to_m, target)
    assert 0 < effort < 1
    way_m = to_m - s_m + (STOP_SLACK_M if target == 0 else 0.0)
    assert speed_after_mps(TRAIN, effort, v_mps, way_m, gradient) <= target + SPEED_SLACK_MPS + 0.15
    assert speed_after_mps(TRAIN, 0.97 * effort, v_mps, way_m, gradient) > target + SPEED_SLACK_MPS


def test_a_slower_train_needs_no_brake_and_a_far_too_fast_one_all_there_is() -> None:
    ahead = BrakingAhead(line())
    assert ahead.effort_to(3500.0, 20.0, 4000.0, 25.0) == 0.0
    assert ahead.effort_to(3990.0, 34.0, 4000.0, 25.0) == pytest.approx(ahead.largest(3990.0, 34.0))
    assert ahead.effort_to(4010.0, 34.0, 4000.0, 25.0) == ahead.largest(4010.0, 34.0), "the place is behind"


def test_what_is_needed_is_by_the_speed_that_asks_for_most() -> None:
    ahead = BrakingAhead(line())
    near = ahead.needed(3900.0, 27.0)
    assert (near.target_mps, near.at_m) == (pytest.approx(25.0), pytest.approx(4000.0, abs=10.0))
    both = ahead.needed(4400.0, 25.0)
    assert (both.target_mps, both.at_m) == (pytest.approx(15.0), pytest.approx(5000.0, abs=10.0))
    for s_m in range(2600, 3900, 50):  # If both need nearly the same, the nearer is named with the larger effort.
        found, efforts = (
            ahead.needed(s_m, 30.0),
            [ahead.effort_to(s_m, 30.0, to_m, v) for to_m, v in ((4000.0, 25.0), (5000.0, 15.0))],
        )
        assert found.effort >= max(efforts) * (1.0 - 1e-3)
    assert ahead.needed(1000.0, 10.0).effort == 0.0 or ahead.needed(1000.0, 10.0).effort < 0.05


def test_more_than_the_motors_is_friction_and_never_beyond_the_train() -> None:
    """The brake policy excludes the friction brake from plans; a train that is too fast uses it all the same."""
    ahead = BrakingAhead(line())
    effort = ahead.needed(7800.0, 25.0).effort
    assert effort > 1.0
    assert braking_mode(effort) is Regime.FRICTION_BRAKE
    most_n = min(300e3, 6.1e6 / 25.0) + 400e3
    assert ahead.force_n(100.0, 7800.0, 25.0) == pytest.approx(-most_n)
    assert ahead.force_n(0.5, 7800.0, 25.0) == pytest.approx(-0.5 * 6.1e6 / 25.0)
    assert (braking_mode(0.5), braking_mode(0.98), braking_mode(1.0)) == (
        Regime.REDUCED_BRAKE, Regime.FULL_BRAKE, Regime.FULL_BRAKE,
    )  # fmt: skip


def electric_line(stop_limit: tuple[float, float] | None = None) -> Section:
    """A section on which a train with an electric brake alone finds no use for it from km 3 to 3.8, before a limit."""
    limits = [(0.0, 35.0), (3900.0, 25.0), *([] if stop_limit is None else [stop_limit])]
    route = replace(make_route(END_M, limits), no_regeneration=(Zone(start_m=3000.0, length_m=800.0),))
    train = replace(TRAIN, brake_policy=BrakePolicy.ELECTRIC, friction_brake_force_n=0.0)
    return build_section(route, train, options=SectionOptions(braking=USUAL.of(train), point_mass=True))


def test_where_the_line_takes_no_power_a_train_without_friction_brake_has_no_effort() -> None:
    """The limit behind such a stretch is what the train brakes for before it, not the stop 4 km further on."""
    ahead = BrakingAhead(electric_line())
    assert [ahead.largest(s_m, 30.0) > 0.0 for s_m in (2990.0, 3010.0, 3790.0, 3810.0)] == [True, False, False, True]
    assert ahead.force_n(1.0, 3400.0, 30.0) == 0.0
    needed = ahead.needed(2900.0, 33.0)
    assert (needed.target_mps, needed.at_m) == (pytest.approx(25.0), pytest.approx(3900.0, abs=10.0))
    rolls_mps = ahead.rolls_to_brakes_mps(3400.0, 26.0)
    held_mps2 = float(TRAIN.resistance.force_n(26.0)) / TRAIN.inertial_mass_kg
    assert rolls_mps == pytest.approx((26.0**2 - 2.0 * held_mps2 * 400.0) ** 0.5, abs=0.05)


def test_the_stop_is_next_only_where_no_lower_limit_lies_before_it() -> None:
    ahead = BrakingAhead(electric_line((END_M - 120.0, 8.0)))
    assert not ahead.stop_is_next(END_M - 250.0, 20.0)
    assert ahead.stop_is_next(END_M - 250.0, 7.5)
    assert ahead.stop_is_next(END_M - 100.0, 8.0)


def test_a_train_without_motors_that_brake_counts_all_its_brakes() -> None:
    friction = replace(
        TRAIN, brake_policy=BrakePolicy.FRICTION, electric_brake=replace(TRAIN.electric_brake, max_force_n=0.0)
    )
    ahead = BrakingAhead(line(friction))
    assert ahead.largest(0.0, 20.0) == pytest.approx(1.0)
    assert ahead.force_n(0.5, 3000.0, 20.0) == pytest.approx(-200e3)


def test_a_brake_is_due_where_the_train_would_soon_be_above_the_falling_curve() -> None:
    section = line()
    ahead = BrakingAhead(section)
    begins = max(s for s, v in zip(section.node_m, section.envelope_mps, strict=True) if s < 4000 and v > 34.99)
    assert not ahead.is_due(begins - 200.0, 35.0, 2.0)
    assert ahead.is_due(begins - 40.0, 35.0, 2.0)
    assert ahead.is_due(begins + 40.0, 35.0)
    assert not ahead.is_due(begins + 40.0, 30.0, 1.0)
    assert not ahead.is_due(1000.0, 36.0, 2.0), "above a limit that does not fall there is nothing ahead to brake for"


def test_a_train_meets_the_curve_where_its_speed_is_that_of_the_curve() -> None:
    """A countdown to it falls evenly: the place does not jump from node to node as the train comes nearer."""
    section, v_mps = line(), 34.0
    ahead, nodes_m = BrakingAhead(section), section.node_m
    met_m = {
        round(ahead.curve_begins_m(s_m, np.full(int((nodes_m > s_m).sum()), v_mps)), 1)
        for s_m in np.arange(3000.0, 3300.0, 7.0)
    }
    assert len(met_m) == 1
    assert float(np.interp(met_m.pop(), nodes_m, section.envelope_mps)) == pytest.approx(v_mps, abs=0.03)


def test_a_train_above_its_limit_meets_no_curve_before_the_limit_falls() -> None:
    """It is taken to come back under its limit on the way."""
    ahead, count = BrakingAhead(line()), int((line().node_m > 1000.0).sum())
    above_m, at_limit_m = (ahead.curve_begins_m(1000.0, np.full(count, v_mps)) for v_mps in (37.0, 35.0))
    assert above_m == pytest.approx(at_limit_m, abs=1.0)


@pytest.mark.parametrize(("s_m", "braked_n"), [(10.0, 0.0), (3990.5, 6e4)])
def test_speeds_and_times_ahead_equal_those_of_whole_arrays(s_m: float, braked_n: float) -> None:
    """The kernels go from node to node; numpy computes all nodes at once, and the results agree to the last bit."""
    section, v_mps = line(gradient=-0.004), 25.0
    ahead, train, node_m = BrakingAhead(section), section.train, section.node_m
    at_m = np.append(s_m, node_m[node_m > s_m])
    constant_n, speeds_mps = section.constant_n[-len(at_m) + 1 :], np.full(len(at_m) - 1, v_mps)
    for _ in range(2):
        running_n = train.c0_n + train.c1_n_per_mps * speeds_mps + train.c2_n_per_mps2 * speeds_mps**2
        lost_j = np.cumsum((running_n + constant_n + braked_n) * np.diff(at_m))
        speeds_mps = np.sqrt(np.maximum(v_mps**2 - 2.0 * lost_j / train.inertial_mass_kg, 0.0))
    assert ahead.rolling_mps(s_m, v_mps, braked_n).tolist() == speeds_mps.tolist()
    nodes_mps = np.append(v_mps, speeds_mps)
    times_s = np.cumsum(np.append(0.0, 2.0 * np.diff(at_m) / np.maximum(nodes_mps[1:] + nodes_mps[:-1], 0.1)))
    for to_m in (s_m - 1.0, s_m, *at_m[3:6].tolist(), 0.5 * (at_m[7] + at_m[8]), at_m[-1], at_m[-1] + 1.0):
        assert ahead.ahead_s(s_m, v_mps, speeds_mps, to_m) == float(np.interp(to_m, at_m, times_s))


def test_a_train_above_a_limit_is_brought_back_in_time() -> None:
    ahead, v_mps = BrakingAhead(line(gradient=-0.01)), 27.0
    needed = ahead.back_under(4300.0, v_mps, 25.0)
    assert needed.target_mps == 25.0
    force_n = ahead.force_n(needed.effort, 4300.0, v_mps) - ahead.section.resistance_n(4300.0, v_mps)
    assert -force_n / ahead.section.train.inertial_mass_kg == pytest.approx(2.0 / BACK_IN_S, rel=1e-6)
    assert ahead.back_under(4300.0, 24.0, 25.0).effort == 0.0


def test_a_train_without_motor_brakes_brakes_with_friction_late_instead_of_coasting_from_far_away() -> None:
    """Plans coast there, for they use no friction brake; a train that is faster than planned has that brake."""
    limits = [(0.0, 35.0), (3900.0, 25.0)]
    route = replace(make_route(END_M, limits), no_regeneration=(Zone(start_m=2000.0, length_m=1900.0),))
    train = replace(TRAIN, brake_policy=BrakePolicy.ELECTRIC)
    section = build_section(route, train, options=SectionOptions(braking=USUAL.of(train), point_mass=True))
    ahead = BrakingAhead(section)
    planned_mps = float(np.interp(2900.0, section.node_m, section.envelope_mps))
    assert planned_mps < 28.0
    assert [ahead.is_due(s_m, planned_mps + 2.0, 5.0) for s_m in (1900.0, 2900.0, 3790.0)] == [False, False, True]
    # Friction brakes that plans exclude count up to the service deceleration.
    inertia_kg = train.inertial_mass_kg
    brake_n = min(train.friction_brake_force_n, 0.7 * inertia_kg)
    way_m = inertia_kg * (30.0**2 - 25.0**2) / (2.0 * (brake_n + float(train.resistance.force_n(27.5))))
    assert ahead.allowed_mps(3900.0 - 5.0 - way_m) == pytest.approx(30.0, abs=0.1)
    assert -ahead.force_n(ahead.full(3500.0, 27.5), 3500.0, 27.5) == pytest.approx(brake_n, rel=1e-3)


def test_the_curve_of_the_friction_brake_is_nowhere_above_full_braking() -> None:
    """Nor does a train without any brake in plans get a speed that plans would not have allowed."""
    route = make_route(END_M, [(0.0, 35.0), (3900.0, 25.0)], grades=[(0.0, -0.015)])
    route = replace(route, no_regeneration=(Zone(start_m=2000.0, length_m=1900.0),))
    train = replace(TRAIN, brake_policy=BrakePolicy.ELECTRIC)
    section = build_section(route, train, options=SectionOptions(braking=USUAL.of(train), point_mass=True))
    assert (section.guarded_mps <= section.allowed_mps).all()
    assert (section.guarded_mps >= section.envelope_mps).all()
    assert (section.guarded_mps > section.envelope_mps + 1.0).any()
    bare = replace(train, friction_brake_force_n=0.0)
    without = build_section(route, bare, options=SectionOptions(braking=USUAL.of(bare), point_mass=True))
    assert np.array_equal(without.guarded_mps, without.envelope_mps)


def test_no_motors_brake_where_the_line_takes_no_power() -> None:
    """In a neutral section only the friction brake works; efforts still count in shares of the motors' braking."""
    route = replace(make_route(END_M, [(0.0, 35.0)]), neutral_sections=(Zone(start_m=3000.0, length_m=300.0),))
    section = build_section(route, TRAIN, options=SectionOptions(braking=USUAL.of(TRAIN), point_mass=True))
    ahead = BrakingAhead(section)
    assert ahead.force_n(1.0, 2500.0, 25.0) == pytest.approx(-6.1e6 / 25.0)
    assert ahead.force_n(100.0, 2500.0, 25.0) == pytest.approx(-(6.1e6 / 25.0 + 400e3))
    assert ahead.force_n(100.0, 3150.0, 25.0) == pytest.approx(-400e3)


def test_a_train_that_coasts_through_a_tunnel_loses_speed_to_its_air() -> None:
    """Against an integration in steps of 1 m."""
    train = replace(TRAIN, tunnel_area_m2=(20.0, 60.0), tunnel_resistance_n_per_mps2=(15.0, 5.0))
    tunnel = Tunnel(start_m=2000.0, length_m=3000.0, area_m2=40.0)
    route = replace(make_route(END_M, [(0.0, 40.0)]), tunnels=(tunnel,))
    section = build_section(route, train, options=SectionOptions(braking=USUAL.of(train), point_mass=True))
    w = open_w = 35.0**2
    for s_m in range(1000, 6000):
        air_n = 10.0 * w * (2000 <= s_m < 5000)
        w -= 2.0 * (float(train.resistance.force_n(w**0.5)) + air_n) / train.inertial_mass_kg
        open_w -= 2.0 * float(train.resistance.force_n(open_w**0.5)) / train.inertial_mass_kg
    rolls_mps = BrakingAhead(section).rolling_mps(1000.0, 35.0)
    found_mps = float(np.interp(6000.0, section.node_m[-len(rolls_mps) :], rolls_mps))
    assert found_mps == pytest.approx(w**0.5, abs=0.3)
    assert found_mps < open_w**0.5 - 1.0
