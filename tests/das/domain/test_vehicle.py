"""Trains: resistance, efforts, losses by level, tunnels, bad values."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError, InputError
from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.losses import LOSSLESS, EfficiencyLoss, LossMap, fit_mean_efficiency
from das.domain.route import Stretches, Tunnel
from das.domain.vehicle import BrakePolicy, Resistance, Vehicle
from tests.support.making import flat


def a_map() -> LossMap:
    speed, force = np.linspace(0, 60, 31), np.linspace(-310e3, 310e3, 63)
    return LossMap(
        name="a map",
        speed_mps=speed,
        force_n=force,
        loss_w_table=50e3 + 0.2 * np.abs(force[np.newaxis, :] * speed[:, np.newaxis]),
    )


def own_train() -> Vehicle:
    """The bundled train with losses of its own only."""
    own = EfficiencyLoss(traction_ratio=0.1, brake_ratio=0.3, idle_w=5e3)
    return replace(load_vehicle("re460-ic"), losses={Level.OWN: own}, default_level=Level.OWN)


@pytest.mark.parametrize(("speed_mps", "force_n"), [(0, 8200), (10, 9448), (40, 23_512)])
def test_the_resistance_of_the_re460_train_is_eq_15(speed_mps: float, force_n: float) -> None:
    assert load_vehicle("re460-ic").resistance.force_n(speed_mps) == pytest.approx(force_n)


def test_each_level_of_the_re460_train() -> None:
    train = load_vehicle("re460-ic")
    assert train.default_level is Level.L3
    assert train.loss_model(Level.L0_NOREG) is train.loss_model(Level.L0_REG) is LOSSLESS
    l3 = train.losses[Level.L3]
    assert isinstance(l3, LossMap)
    for level, with_idle in ((Level.L1, False), (Level.L2, True)):
        assert train.loss_model(level) == fit_mean_efficiency(l3, 6100e3, with_idle=with_idle)
    assert train.loss_model(Level.L3) is train.losses[Level.L3]
    with pytest.raises(DasError, match=r"no data for level own .*l0-noreg, l0-reg, l3.*choose another level"):
        train.loss_model(Level.OWN)


def test_each_level_of_a_train_with_efficiencies_only() -> None:
    train = own_train()
    assert train.loss_model(Level.OWN) is train.losses[Level.OWN]
    assert train.loss_model(Level.L1) == EfficiencyLoss(traction_ratio=0.2, brake_ratio=0.2)
    for level in (Level.L2, Level.L3):
        with pytest.raises(DasError, match=rf"no data for level {level} .*own.*give a loss map with --loss-map"):
            train.loss_model(level)


def test_a_loss_map_changes_the_losses_and_nothing_else() -> None:
    train, loss_map = own_train(), a_map()
    changed = train.with_loss_map(loss_map)
    assert changed.default_level is Level.L3
    assert changed.loss_model(Level.L3) is loss_map
    for level, with_idle in ((Level.L1, False), (Level.L2, True)):
        assert changed.loss_model(level) == fit_mean_efficiency(loss_map, 6100e3, with_idle=with_idle)
    with pytest.raises(DasError, match="no data for level own"):
        changed.loss_model(Level.OWN)
    others = {f.name for f in fields(Vehicle)} - {"losses", "default_level"}
    assert {name: getattr(changed, name) for name in others} == {name: getattr(train, name) for name in others}
    assert train.default_level is Level.OWN


def test_l0_noreg_dissipates_and_the_other_levels_brake_as_the_train_does() -> None:
    train = replace(own_train(), brake_policy=BrakePolicy.BLENDED)
    assert {level: train.brakes_at(level) for level in Level} == {
        level: BrakePolicy.FRICTION if level is Level.L0_NOREG else BrakePolicy.BLENDED for level in Level
    }


@pytest.mark.parametrize(("area_m2", "coefficient"), [(24, 8.0), (28, 7.0), (40, 4.0), (10, 8.0), (99, 4.0)])
def test_tunnel_resistance_is_linear_between_cross_sections(area_m2: float, coefficient: float) -> None:
    train = replace(own_train(), tunnel_area_m2=(24.0, 40.0), tunnel_resistance_n_per_mps2=(8.0, 4.0))
    assert train.tunnel_coefficient_n_per_mps2(area_m2) == pytest.approx(coefficient)
    assert own_train().tunnel_coefficient_n_per_mps2(area_m2) == 0


def test_what_train_and_line_add_to_the_resistance_along_the_line() -> None:
    """Two tunnels that touch, and one alone; a curve as in the formulary."""
    tunnels = [Tunnel(start_m=a, length_m=b - a, area_m2=c) for a, b, c in ((0, 9, 24), (9, 20, 40), (50, 60, 24))]
    curves = Stretches(start_m=np.array([0.0, 30.0]), value=np.array([0.0, -1 / 530]))
    line = replace(flat(100.0), tunnels=tuple(tunnels), curvature_per_m=curves)
    train = replace(own_train(), tunnel_area_m2=(24.0, 40.0), tunnel_resistance_n_per_mps2=(8.0, 4.0))
    at_m = [0, 8.9, 9, 19.9, 20, 49.9, 50, 59.9, 60, 99]
    assert train.tunnel_n_per_mps2(line).at(at_m).tolist() == [8, 8, 4, 4, 0, 0, 8, 8, 0, 0]
    assert own_train().tunnel_n_per_mps2(line).at(at_m).tolist() == [0] * 10
    assert train.line_resistance_mps2(line).at([0, 29, 30, 99]) == pytest.approx([0, 0, 9.81e-3, 9.81e-3])


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"mass_kg": 0.0}, "mass_kg = 0.0: expected a finite number > 0"),
        ({"mass_kg": np.nan}, "mass_kg = nan"),
        ({"train_length_m": -1.0}, "train_length_m = -1.0: expected a finite number >= 0"),
        ({"max_speed_mps": np.inf}, "max_speed_mps = inf"),
        ({"resistance": Resistance(c0_n=1, c1_n_per_mps=-3, c2_n_per_mps2=1)}, r"resistance \(N\) at 5 km/h = -1.25"),
        ({"traction": EffortEnvelope(max_force_n=1, max_power_w=0)}, "traction.max_power_w = 0.0: .* > 0"),
        (
            {"electric_brake": EffortEnvelope(max_force_n=-1, max_power_w=0)},
            "electric_brake.max_force_n = -1.0: .*>= 0",
        ),
        ({"max_acceleration_mps2": 0.0}, "max_acceleration_mps2 = 0.0: expected a number > 0"),
        ({"max_deceleration_mps2": np.nan}, "max_deceleration_mps2 = nan"),
        ({"default_level": Level.L3}, "default_level = 'l3': expected a level of the vehicle"),
    ],
)
def test_a_bad_train_is_refused(changes: dict[str, object], expected: str) -> None:
    with pytest.raises(InputError, match=f"re460-ic.toml: {expected}"):
        replace(own_train(), **changes)
