"""What a train can do and needs at a speed: figures by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.domain.losses import EfficiencyLoss
from precompute.cli.vehicle_report import performance_of
from tests.support.making import make_train


def test_performance_is_worked_out_by_hand_and_nothing_cruises_faster_than_its_traction_holds() -> None:
    """100 t, 2000 kW, R = 20 kN + 50 N/(m/s)²·v², η = 0.8: at 20 m/s 40 kN, at 40 m/s 100 kN against 50 kN."""
    loss = EfficiencyLoss.from_efficiencies(0.8, 0.8, 1e4)
    train = replace(make_train(resistance=(2e4, 0.0, 50.0), power_w=2e6, loss=loss), max_acceleration_mps2=0.5)
    found = performance_of(train, np.array([20.0, 40.0]))
    assert found.traction_n == pytest.approx([1e5, 5e4])
    assert found.resistance_n == pytest.approx([4e4, 1e5])
    assert found.acceleration_mps2 == pytest.approx([0.5, -0.5])
    assert found.full_traction_loss_w == pytest.approx([0.25 * 2e6 + 1e4] * 2)
    assert found.idle_loss_w == pytest.approx([1e4, 1e4])
    assert found.cruising_loss_w[0] == pytest.approx(0.25 * 8e5 + 1e4)
    assert found.cruising_j_per_m[0] == pytest.approx((8e5 / 0.8 + 1e4) / 20.0)
    assert np.isnan(found.cruising_loss_w[1])
    assert np.isnan(found.cruising_j_per_m[1])
