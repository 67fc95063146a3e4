"""What the friction brake takes that the motors could have given: against a second run that brakes with the motors."""

from __future__ import annotations

from dataclasses import replace

import pytest

from das.domain.losses import EfficiencyLoss
from sim.plant.kernels import PlantState
from sim.plant.plant import Plant, force
from tests.support.making import flat, make_train

BRAKING_N = -60e3
LOSSES = EfficiencyLoss(traction_ratio=0.1, brake_ratio=0.2, idle_w=0.0)


def braked(friction_ratio: float) -> tuple[PlantState, PlantState]:
    """A train that brakes from 40 to 20 m/s with a force that its motors have at these speeds."""
    plant = Plant(flat(20_000.0), replace(make_train(loss=LOSSES), friction_brake_force_n=8e4))
    before = state = plant.at(1000.0, 40.0)
    while state.speed_mps > 20.0:
        assert state.time_s < 600.0, "the train does not brake"
        state = plant.advance(state, force(BRAKING_N, friction_ratio=friction_ratio), 0.2)
    return before, state


def test_braking_with_the_motors_leaves_nothing_to_blend() -> None:
    _, after = braked(0.0)
    assert after.friction_brake_j == 0.0
    assert after.blending_j == 0.0


@pytest.mark.parametrize("friction_ratio", [0.2, 0.5, 1.0])
def test_the_energy_lost_by_friction_is_what_braking_with_the_motors_would_have_fed_back(friction_ratio: float) -> None:
    """Two runs of nearly the same motion: the friction brake builds up later, which costs some metres."""
    _, by_motors = braked(0.0)
    _, rubbed = braked(friction_ratio)
    assert rubbed.friction_brake_j > 0.0
    way = (rubbed.s_m - 1000.0) / (by_motors.s_m - 1000.0)
    assert way == pytest.approx(1.0, abs=0.06)
    assert rubbed.input_j - rubbed.blending_j == pytest.approx(by_motors.input_j, rel=0.06)
    # Closed form: these motors feed 80 % of what they take back to the line.
    assert rubbed.blending_j == pytest.approx(0.8 * rubbed.friction_brake_j, rel=1e-9)
