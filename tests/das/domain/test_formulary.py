"""Every equation of the literature against numbers worked out by hand, or against another way to compute it."""

from __future__ import annotations

import numpy as np
import pytest

from das.domain.effort import EffortEnvelope
from das.domain.formulary import adhesion_coefficient, curve_resistance_mps2, line_force_n
from das.domain.losses import EfficiencyLoss
from das.domain.trajectory import mean_resistance_n
from das.domain.vehicle import Resistance
from das.solver.kernels import forces

SOME = Resistance(c0_n=1500.0, c1_n_per_mps=20.0, c2_n_per_mps2=4.0)


def test_davis_resistance_of_the_papers_train() -> None:
    # c1 = 8.2 kN, c2 = 0.0388 kN/(m/s), c3 = 0.0086 kN/(m/s)²: at 40 m/s 8200 + 1552 + 13760 N.
    resistance = Resistance(c0_n=8200.0, c1_n_per_mps=38.8, c2_n_per_mps2=8.6)
    assert resistance.force_n([0.0, 40.0]) == pytest.approx([8200.0, 23_512.0])


@pytest.mark.parametrize(("v0", "v1"), [(0.0, 10.0), (12.0, 12.0), (30.0, 5.0), (0.0, 0.0)])
def test_the_mean_resistance_is_that_of_many_small_parts_of_the_way(v0: float, v1: float) -> None:
    share = (np.arange(100_000) + 0.5) / 100_000
    speeds = np.sqrt(v0**2 + (v1**2 - v0**2) * share)  # v² is linear in the way
    expected = SOME.force_n(speeds).mean()
    assert mean_resistance_n(SOME, np.array([v0, v1]), np.zeros(1)) == pytest.approx([expected], rel=1e-6)


@pytest.mark.parametrize("wind_mps", [-6.0, 0.0, 9.0])
def test_a_head_wind_adds_to_the_speed_of_the_air(wind_mps: float) -> None:
    resistance = SOME.in_head_wind(wind_mps)
    for v in (6.0, 20.0, 40.0):
        expected = 1500.0 + 20.0 * v + 4.0 * (v + wind_mps) ** 2
        assert float(resistance.force_n(v)) == pytest.approx(expected)


def test_curve_resistance_has_its_step_at_300_m() -> None:
    # R = 600 m: 0.5/(600 − 30) of the weight; R = 200 m: 0.65/(200 − 55).
    assert curve_resistance_mps2(np.array([0.0, 1 / 600, -1 / 600, 1 / 200])) == pytest.approx(
        [0.0, 9.81 * 0.5 / 570, 9.81 * 0.5 / 570, 9.81 * 0.65 / 145]
    )
    assert float(curve_resistance_mps2(1 / 530)) == pytest.approx(9.81e-3)
    assert float(curve_resistance_mps2(1 / 300)) == pytest.approx(9.81 * 0.5 / 270)
    assert float(curve_resistance_mps2(1 / 299.9)) == pytest.approx(9.81 * 0.65 / 244.9)


def test_line_force_of_a_gradient_and_a_curve() -> None:
    assert line_force_n(4e5, np.array([0.010, -0.010]), np.array([0.0, 0.005])) == pytest.approx([39_240.0, -37_240.0])


def test_adhesion_falls_with_the_speed() -> None:
    # V = 0, 36 and 160 km/h: 0.161 + 7.5/44, 7.5/80, 7.5/204.
    mu = adhesion_coefficient(np.array([0.0, 10.0, 160 / 3.6]))
    assert mu == pytest.approx([0.161 + 7.5 / 44, 0.161 + 7.5 / 80, 0.161 + 7.5 / 204])
    assert forces.adhesion_coefficient(10.0) == pytest.approx(mu[1], rel=1e-15)


def test_effort_is_the_smaller_of_force_and_power() -> None:
    effort = EffortEnvelope(max_force_n=1e5, max_power_w=1e6)
    assert effort.force_n([0.0, 5.0, 10.0, 40.0]) == pytest.approx([1e5, 1e5, 1e5, 25e3])


def test_loss_of_a_constant_efficiency() -> None:
    # η = 0.8: 1 MW at the wheel takes 1.25 MW in.
    loss = EfficiencyLoss.from_efficiencies(0.8, 0.9, 5e3)
    assert loss.traction_ratio == pytest.approx(0.25)
    assert loss.loss_w([1e5, 0.0, -1e5], 10.0) == pytest.approx([255e3, 5e3, 105e3])
