"""Trajectories: the energy balance of hand-built motions closes, and does not for wrong ones; resistance against
quadrature."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.domain.errors import DasError
from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.trajectory import Trajectory, mean_resistance_n
from das.domain.vehicle import BrakePolicy, Vehicle
from docs.studies.cases import consumed_j, evaluated_at

GAUSS_X, GAUSS_WEIGHT = np.polynomial.legendre.leggauss(60)


@cache
def train() -> Vehicle:
    return replace(load_vehicle("re460-ic"), rotating_mass_ratio=0.1, mass_kg=400e3)


def mean_over_way(vehicle: Vehicle, a: float, b: float, tunnel: float) -> float:
    """Resistance at constant acceleration averaged over the way, by quadrature over time: ∫R·v dt / ∫v dt."""
    v = a + (b - a) * 0.5 * (GAUSS_X + 1)
    r = vehicle.resistance
    force = r.c0_n + r.c1_n_per_mps * v + (r.c2_n_per_mps2 + tunnel) * v**2
    return float((force * v) @ GAUSS_WEIGHT / (v @ GAUSS_WEIGHT))


@given(st.floats(0, 60), st.floats(0.01, 60), st.floats(0, 10))
def test_mean_resistance_against_quadrature(a: float, b: float, tunnel: float) -> None:
    mean = mean_resistance_n(train().resistance, np.array([a, b]), np.array([tunnel]))
    assert float(mean[0]) == pytest.approx(mean_over_way(train(), a, b, tunnel), rel=1e-9)


@st.composite
def motions(draw: st.DrawFn) -> Trajectory:
    """Any speeds over any line; forces from Newton's law with the resistance by quadrature."""
    n = draw(st.integers(1, 6))
    several = st.lists(st.floats(0, 1), min_size=n, max_size=n)
    v = np.array([draw(st.floats(0, 50)), *(0.5 + 50 * np.array(draw(several)))])
    step = 1 + 200 * np.array(draw(several))
    grade, curve, tunnel = (scale * np.array(draw(several)) for scale in (0.04, 5e3, 9.0))
    grade = grade - 0.02
    constant = train().mass_kg * 9.81 * grade + curve
    running = [mean_over_way(train(), a, b, t) for a, b, t in zip(v[:-1], v[1:], tunnel, strict=True)]
    force = train().mass_kg * 1.1 * np.diff(v**2) / (2 * step) + running + constant
    friction = np.minimum(force, 0) * np.array(draw(several))
    return Trajectory(
        s_m=np.concatenate(([0], np.cumsum(step))),
        t_s=np.concatenate(([0], np.cumsum(2 * step / (v[:-1] + v[1:])))),
        v_mps=v,
        force_el_n=force - friction,
        force_friction_n=friction,
        grade_ratio=grade,
        grade_and_curve_n=constant,
        tunnel_n_per_mps2=tunnel,
        limit_mps=np.full(n, 60.0),
        supply=np.ones(n),
    )


@given(motions())
def test_the_energy_balance_closes(run: Trajectory) -> None:
    loss = EfficiencyLoss(traction_ratio=0.1, brake_ratio=0.2, idle_w=1e5)
    balance = run.balance(train(), loss)
    assert balance.residual_ratio < 1e-6
    assert balance.irreversible == pytest.approx(balance.input - balance.kinetic - balance.potential, rel=1e-6, abs=10)
    assert min(balance.resistance, balance.component_loss, balance.friction_brake + 1) > 0


def climb(force_el_n: float = 70e3, force_friction_n: float = -10e3) -> Trajectory:
    """1 km at 20 m/s up 10 ‰ against R(20) = 8200 + 776 + 3440 N, m·g·i = 39 240 N."""
    return Trajectory(
        s_m=np.array([0.0, 1000.0]),
        t_s=np.array([0.0, 50.0]),
        v_mps=np.array([20.0, 20.0]),
        force_el_n=np.array([force_el_n]),
        force_friction_n=np.array([force_friction_n]),
        grade_ratio=np.array([0.01]),
        grade_and_curve_n=np.array([0.01 * 400e3 * 9.81]),
        tunnel_n_per_mps2=np.array([0.0]),
        limit_mps=np.array([40.0]),
        supply=np.ones(1),
    )


def test_the_energy_balance_of_a_climb_by_hand() -> None:
    wheel_n = 12_416 + 39_240 + 10_000
    balance = climb(wheel_n).balance(train(), EfficiencyLoss(traction_ratio=0.1, brake_ratio=0.0, idle_w=1e5))
    assert balance.resistance == pytest.approx(12.416e6)
    assert balance.potential == pytest.approx(39.24e6)
    assert balance.friction_brake == pytest.approx(10e6)
    assert balance.kinetic == 0
    assert balance.component_loss == pytest.approx(0.1 * wheel_n * 1000 + 1e5 * 50)
    assert balance.input == pytest.approx(1.1 * wheel_n * 1000 + 5e6)
    assert balance.comfort == pytest.approx(250e3 * 50)
    assert balance.residual_ratio < 1e-12


def test_a_energy_balance_of_forces_that_do_not_fit_the_motion_does_not_close() -> None:
    assert climb(70e3).balance(train(), EfficiencyLoss.symmetric(0.9)).residual_ratio > 0.05


def there_and_back() -> Trajectory:
    """1 km at +80 kN and 20 m/s, then 1 km at -80 kN with 30 kN of it by friction: as a blended train would."""
    one = climb(80e3)
    return replace(
        one,
        s_m=np.array([0.0, 1000.0, 2000.0]),
        t_s=np.array([0.0, 50.0, 100.0]),
        v_mps=np.array([20.0, 20.0, 20.0]),
        force_el_n=np.array([80e3, -50e3]),
        force_friction_n=np.array([0.0, -30e3]),
        grade_ratio=np.zeros(2),
        grade_and_curve_n=np.zeros(2),
        tunnel_n_per_mps2=np.zeros(2),
        limit_mps=np.full(2, 40.0),
        supply=np.ones(2),
    )


def test_cross_evaluation_brakes_as_the_level_does() -> None:
    run, vehicle = there_and_back(), train()
    resistance = 2 * 12.416e6  # at a constant 20 m/s, whatever the forces
    work = 80e6
    assert consumed_j(run, vehicle, Level.L0_NOREG) == pytest.approx(work)  # eq. 8: positive wheel work
    assert consumed_j(run, vehicle, Level.L0_REG) == pytest.approx(resistance)
    l1 = vehicle.loss_model(Level.L1)
    assert isinstance(l1, EfficiencyLoss)
    assert consumed_j(run, vehicle, Level.L1) == pytest.approx(resistance + l1.traction_ratio * 2 * work)
    blended = replace(
        vehicle, brake_policy=BrakePolicy.BLENDED, electric_brake=replace(vehicle.electric_brake, max_force_n=50e3)
    )
    balance = evaluated_at(run, blended, Level.L0_REG)
    assert balance.friction_brake == pytest.approx(30e6)
    assert balance.input == pytest.approx(work - 50e6)


def test_cross_evaluation_needs_the_level() -> None:
    with pytest.raises(DasError, match="no data for level l3"):
        consumed_j(there_and_back(), replace(train(), losses={}, default_level=Level.L0_REG), Level.L3)
