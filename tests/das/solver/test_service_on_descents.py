"""Service braking on long descents: a share of the brakes' force stays in reserve, or the train is refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.domain.braking import SERVICE_SHARE, USUAL
from das.domain.effort import EffortEnvelope
from das.domain.errors import InfeasibleError
from das.domain.route import Route
from das.domain.units import KMH
from das.domain.vehicle import BrakePolicy, Resistance, ServiceBrake, Vehicle
from das.solver.kernels.forces import brake_limit, mean_resistance
from das.solver.section import Section, SectionOptions, build_section
from tests.support.making import make_route, make_train

LIMITS_MPS = [(0.0, 90.0 * KMH), (7_000.0, 60.0 * KMH)]
STEEP, GENTLE = -0.03, -0.026
LONG_M = 30_000.0
TOLERANCE_N = 50.0


def freight(friction_n: float = 320e3, brakes: BrakePolicy = BrakePolicy.BLENDED) -> Vehicle:
    """The 1600 t freight train of which a descent of 30 ‰ took every brake: 470 kN in all."""
    return replace(
        make_train(),
        mass_kg=1.6e6,
        rotating_mass_ratio=0.05,
        train_length_m=520.0,
        max_speed_mps=100.0 * KMH,
        resistance=Resistance(c0_n=22e3, c1_n_per_mps=150.0, c2_n_per_mps2=55.0),
        traction=EffortEnvelope(max_force_n=300e3, max_power_w=5.6e6),
        electric_brake=EffortEnvelope(max_force_n=150e3, max_power_w=2.6e6),
        friction_brake_force_n=friction_n,
        brake_policy=brakes,
        service_brake=ServiceBrake(deceleration_mps2=0.15, build_up_s=6.0),
    )


def descent(grade: float, length_m: float = 12_500.0) -> Route:
    bottom_m = 500.0 + length_m
    return make_route(bottom_m + 1_000.0, LIMITS_MPS, grades=[(0.0, 0.0), (500.0, grade), (bottom_m, 0.0)])


def downhill(train: Vehicle, route: Route) -> Section:
    return build_section(route, train, options=SectionOptions(braking=USUAL.of(train)))


def needed_n(section: Section, speeds_mps: np.ndarray) -> list[tuple[float, float]]:
    """In each step on the falling or level envelope: the braking force that it needs, and that of all brakes (N)."""
    train, found = section.train, []
    for i in range(len(section.step_m)):
        v0, v1 = float(speeds_mps[i]), float(speeds_mps[i + 1])
        resisting_n = mean_resistance(v0, v1, section.tunnel_n_per_mps2[i], train) + section.constant_n[i]
        slowed_n = train.inertial_mass_kg * (v0**2 - v1**2) / (2.0 * section.step_m[i])
        all_n = brake_limit(max(v0, v1), train, section.vehicle.friction_brake_force_n)
        if v1 <= v0:
            found.append((slowed_n - resisting_n, all_n))
    return found


def test_a_descent_leaves_a_share_of_the_brakes_in_reserve() -> None:
    """The full brakes' curve needs all brakes for kilometres; the planned one never more than their share."""
    section = downhill(freight(), descent(GENTLE))
    shares = [needed / most for needed, most in needed_n(section, section.envelope_mps)]
    assert max(needed - SERVICE_SHARE * most for needed, most in needed_n(section, section.envelope_mps)) < TOLERANCE_N
    assert max(shares) > 0.99 * SERVICE_SHARE, "the share is used"
    assert max(needed / most for needed, most in needed_n(section, section.allowed_mps)) > 0.99


def test_a_train_that_its_service_brake_hardly_holds_goes_down_slower() -> None:
    strong, weak = (downhill(freight(friction_n), descent(GENTLE)) for friction_n in (600e3, 320e3))
    places = np.array([4_000.0, 5_000.0, 6_000.0])
    of_strong, of_weak = (np.interp(places, one.node_m, one.envelope_mps) for one in (strong, weak))
    assert (of_weak < of_strong - 1.0 * KMH).all()


def test_a_train_that_its_service_brake_does_not_hold_is_refused_with_the_key_to_change() -> None:
    told = r"cannot brake on the descent at \d+ m \(-30\.0 ‰\) with 90 % of its brakes: .*: "
    with pytest.raises(InfeasibleError, match=told + r"friction_brake\.max_force_kn = 320: expected at least 3\d\d$"):
        downhill(freight(), descent(STEEP, LONG_M))
    assert downhill(freight(400e3), descent(STEEP, LONG_M)).envelope_mps[0] > 0


def test_full_brakes_hold_what_service_brakes_do_not() -> None:
    """The solver itself, the study of the paper and the benchmarks use full brakes, and are not refused."""
    assert build_section(descent(STEEP, LONG_M), freight()).allowed_mps.max() == pytest.approx(90.0 * KMH)


def test_a_policy_without_the_friction_brake_is_named() -> None:
    with pytest.raises(InfeasibleError, match=r"\(-26\.0 ‰\): .*: brakes\.policy = 'electric': expected 'blended'$"):
        downhill(freight(400e3, BrakePolicy.ELECTRIC), descent(GENTLE))


def test_a_train_without_a_friction_brake_is_told_to_have_one() -> None:
    told = r"\(-26\.0 ‰\): [^:]*: friction_brake\.max_force_kn = 0: expected at least \d+$"
    with pytest.raises(InfeasibleError, match=told):
        downhill(freight(0.0), descent(GENTLE))


def test_a_friction_brake_that_plans_do_not_use_is_a_reserve_all_the_same() -> None:
    """A plan may use all of the electric brake where the friction brake is at least a ninth of it."""
    level = [(0.0, 0.0)]
    made = replace(make_train(), brake_policy=BrakePolicy.ELECTRIC, service_brake=ServiceBrake(deceleration_mps2=5.0))
    braking = replace(USUAL.of(made), reaction_s=0.0, build_up_s=0.0)
    route = make_route(6_000.0, [(0.0, 30.0)], grades=level)
    backed, alone = (
        build_section(route, replace(made, friction_brake_force_n=friction_n), options=SectionOptions(braking=braking))
        for friction_n in (1e5, 0.0)
    )
    for section, share in ((backed, 1.0), (alone, SERVICE_SHARE)):
        found = [needed / most for needed, most in needed_n(section, section.envelope_mps) if needed > 0.0]
        electric = backed.vehicle.electric_brake.max_force_n
        assert max(found) * (electric + section.vehicle.friction_brake_force_n) == pytest.approx(
            share * electric, rel=2e-2
        )
