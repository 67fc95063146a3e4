"""Certificates of runs: what is proven, how near it is, and why there is none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.route import Route, Stretches, Zone
from das.domain.units import STANDARD_GRAVITY_MPS2
from das.domain.vehicle import BrakePolicy, EffortEnvelope, Resistance, Vehicle
from das.offline.bound import behind_fastest, certificate, fastest_is_ahead, task_of
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit
from das.solver.solve import solve_front
from tests.support.making import make_route, make_train

GRADES = [(0.0, 0.0), (1_500.0, 0.012), (3_000.0, -0.02), (4_200.0, 0.0)]


def hilly(route: Route | None = None, train: Vehicle | None = None) -> Front:
    route = route or make_route(6_000.0, [(0.0, 30.0), (2_000.0, 22.0), (3_500.0, 33.0)], GRADES)
    train = train or make_train(resistance=(2_000.0, 50.0, 8.0), power_w=1.5e6, loss=lossy())
    return solve_front(build_section(route, train, options=SectionOptions(point_mass=True)))


def lossy(idle_w: float = 2e4) -> EfficiencyLoss:
    return EfficiencyLoss(traction_ratio=0.2, brake_ratio=0.25, idle_w=idle_w)


@pytest.fixture(scope="module")
def front() -> Front:
    return hilly()


@pytest.mark.parametrize("buffer_ratio", [0.001, 0.01, 0.05, 0.2, 0.6])
def test_the_bound_is_near_the_energy(front: Front, buffer_ratio: float) -> None:
    run = front.trajectory(front.fastest().time_s * (1 + buffer_ratio))
    assert run.gap_reason == ""
    assert 0.0 <= run.gap_ratio < 0.01
    assert run.bound_j == run.certificate.bound_j <= run.balance.input


def test_a_level_run_at_one_speed_has_next_to_no_gap() -> None:
    """From 20 m/s to 20 m/s on the level without losses, the optimum is to hold 20 m/s: energy = resistance × way."""
    train = make_train(resistance=(1_000.0, 20.0, 5.0))
    section = build_section(
        make_route(3_000.0, [(0.0, 40.0)]), train, options=SectionOptions(start_speed_mps=20.0, end_speed_mps=20.0)
    )
    run = solve_front(section).trajectory(150.0)
    exact_j = (1_000.0 + 20.0 * 20.0 + 5.0 * 400.0) * 3_000.0
    assert run.time_s == pytest.approx(150.0, abs=0.03)
    assert run.bound_j <= exact_j * (1 + 2e-4), "the time may be missed by 0.02 s"
    assert run.bound_j == pytest.approx(exact_j, rel=1e-3)


def test_a_shorter_time_has_a_higher_bound(front: Front) -> None:
    least_s = front.fastest().time_s
    bounds_j = [front.trajectory(least_s * (1 + buffer)).bound_j for buffer in (0.02, 0.05, 0.1, 0.2)]
    assert (np.diff(bounds_j) < 0).all()


def test_the_run_of_least_energy_is_bounded_in_the_time_asked_for(front: Front) -> None:
    run = front.trajectory(5_000.0)
    assert run.fit is Fit.EARLY
    assert run.time_s < 2_000.0
    found = certificate(run)
    assert (found.allowed_s, found.reason) == (5_000.0, "")
    assert 0.0 <= run.gap_ratio < 0.02


def test_a_run_from_within_the_section_is_bounded(front: Front) -> None:
    run = front.trajectory(front.least_time_s(2_333.0, 15.0) * 1.1, 2_333.0, 15.0)
    assert run.gap_reason == ""
    assert 0.0 <= run.gap_ratio < 0.01


def test_a_run_from_above_the_envelope_has_no_bound(front: Front) -> None:
    run = front.trajectory(1.0, 2_100.0, 26.0)
    assert run.gap_reason == "the run begins above the braking envelope"
    assert math.isnan(run.bound_j)
    assert math.isnan(run.gap_ratio)


def test_a_run_that_breaks_a_limit_has_no_bound(front: Front) -> None:
    run = replace(front.trajectory(front.fastest().time_s * 1.1), feasible=False)
    assert run.gap_reason == "the run does not keep the limits or the speed at the end"


def test_the_fastest_run_is_its_own_bound_where_it_is_alone(front: Front) -> None:
    run = front.fastest()
    assert fastest_is_ahead(task_of(run, run.time_s))
    assert run.gap_ratio == 0.0
    slippery = replace(front.section.vehicle, adhesive_mass_kg=3e4)
    slipping = hilly(train=slippery).fastest()
    assert not fastest_is_ahead(task_of(slipping, slipping.time_s))
    assert slipping.gap_reason == ""
    assert 0.0 < slipping.gap_ratio < 0.05


@pytest.mark.parametrize(("downhill_n", "alone"), [(27_000.0, True), (32_000.0, False)])
def test_a_descent_that_carries_the_train_beyond_its_largest_acceleration_takes_that_proof_away(
    downhill_n: float, *, alone: bool
) -> None:
    """With a tail wind, at 30 m/s and without the air, nothing but 2 kN − 3 kN resists; the brakes hold 20 kN.

    Of 27 kN downhill 8 kN are left: less than 0.1 m/s² for 100 t, which is 10 kN. Of 32 kN 13 kN are left.
    """
    weak = EffortEnvelope(max_force_n=2e4, max_power_w=1e12)
    train = make_train(resistance=(2_000.0, -100.0, 8.0), loss=lossy())
    train = replace(train, max_acceleration_mps2=0.1, electric_brake=weak)
    grades = [(0.0, 0.0), (3_000.0, -downhill_n / (1e5 * STANDARD_GRAVITY_MPS2)), (3_100.0, 0.0)]
    run = hilly(make_route(6_000.0, [(0.0, 30.0)], grades), train).fastest()
    assert fastest_is_ahead(task_of(run, run.time_s)) is alone


def other_supply() -> Route:
    route = make_route(6_000.0, [(0.0, 30.0)], GRADES)
    return replace(
        route,
        receptivity_ratio=Stretches(start_m=np.array([0.0, 3_000.0]), value=np.array([0.0, 0.4])),
        neutral_sections=(Zone(start_m=1_000.0, length_m=150.0),),
        no_regeneration=(Zone(start_m=3_200.0, length_m=600.0),),
    )


def friction_train() -> Vehicle:
    train = make_train(resistance=(2_000.0, 50.0, 8.0), power_w=1.5e6, loss=lossy())
    return replace(train, friction_brake_force_n=1e5, brake_policy=BrakePolicy.BLENDED)


@pytest.mark.parametrize("level", [Level.L0_NOREG, Level.L0_REG, Level.OWN])
def test_supply_and_brakes_belong_to_the_bound(level: Level) -> None:
    section = build_section(other_supply(), friction_train(), level=level)
    solved = solve_front(section)
    run = solved.trajectory(solved.fastest().time_s * 1.1)
    assert run.gap_reason == ""
    assert 0.0 <= run.gap_ratio < 0.03


def test_a_tail_wind_is_no_obstacle() -> None:
    train = replace(
        make_train(power_w=1.5e6, loss=lossy()),
        resistance=Resistance(c0_n=4_000.0, c1_n_per_mps=-80.0, c2_n_per_mps2=8.0),
    )
    solved = hilly(train=train)
    run = solved.trajectory(solved.fastest().time_s * 1.08)
    assert run.gap_reason == ""
    assert 0.0 <= run.gap_ratio < 0.01


def test_what_more_supply_saves_the_bound_sees(front: Front) -> None:
    """The bound knows receptivity: without it, it is higher by what braking would have given back."""
    nothing = Stretches(start_m=np.array([0.0]), value=np.array([0.0]))
    section: Section = front.section
    other = solve_front(
        build_section(
            replace(section.route, receptivity_ratio=nothing),
            section.vehicle,
            options=SectionOptions(point_mass=True),
        )
    )
    time_s = front.fastest().time_s * 1.05
    assert other.trajectory(time_s).bound_j > 1.02 * front.trajectory(time_s).balance.input


def test_no_run_is_ahead_of_the_fastest(front: Front) -> None:
    """The fastest run bounds the speed of every other, and so the bound from below gains by it."""
    run = front.trajectory(front.fastest().time_s * 1.05)
    task = task_of(run, run.time_s)
    narrower = behind_fastest(task)
    assert (narrower.envelope_mps <= task.envelope_mps).all()
    assert (narrower.envelope_mps < 0.9 * task.envelope_mps).any()
    assert (run.trajectory.v_mps <= narrower.envelope_mps + 1e-6).all()
