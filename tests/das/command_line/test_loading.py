"""What is said once about a train that is loaded."""

from __future__ import annotations

from dataclasses import replace

import pytest

from das.command_line.loading import warn_of_braking
from das.domain.files.load import load_vehicle
from das.domain.vehicle import BrakePolicy, Vehicle


def train(policy: BrakePolicy, name: str, **changes: float) -> Vehicle:
    return replace(load_vehicle("re460-ic"), brake_policy=policy, source=name, **changes)


def test_a_train_that_blends_and_states_no_deceleration_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    blended = train(BrakePolicy.BLENDED, "blended.toml", max_deceleration_mps2=float("inf"))
    warn_of_braking(blended)
    warn_of_braking(blended)
    told = capsys.readouterr().err
    assert told.count("blended.toml: max_deceleration is missing") == 1


@pytest.mark.parametrize(
    "vehicle",
    [
        train(BrakePolicy.BLENDED, "stated.toml", max_deceleration_mps2=0.6),
        train(BrakePolicy.ELECTRIC, "electric.toml", max_deceleration_mps2=float("inf")),
        train(BrakePolicy.BLENDED, "bare.toml", max_deceleration_mps2=float("inf"), friction_brake_force_n=0.0),
    ],
)
def test_others_are_not(vehicle: Vehicle, capsys: pytest.CaptureFixture[str]) -> None:
    warn_of_braking(vehicle)
    assert capsys.readouterr().err == ""
