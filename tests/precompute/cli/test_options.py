"""What the options of several commands change about a train."""

from __future__ import annotations

import pytest

from precompute.cli.options import LineOptions, TrainOnLine, TrainOptions, WorldOptions


def test_the_largest_figures_of_a_train_are_those_that_its_options_say() -> None:
    driven = TrainOptions(
        vehicle="re460-ic", max_power_kw=3000.0, max_force_kn=200.0, max_brake_force_kn=120.0, max_speed_kmh=90.0
    )
    train = TrainOnLine(where=LineOptions(route="flat-6km"), driven=driven, world=WorldOptions()).vehicle()
    assert train.max_speed_mps == pytest.approx(25.0)
    assert (train.traction.max_power_w, train.traction.max_force_n) == (3e6, 2e5)
    assert (train.electric_brake.max_power_w, train.electric_brake.max_force_n) == (3e6, 1.2e5)
