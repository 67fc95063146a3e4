"""The loss chain: each component by hand, power followed through the chain, limits, jumps, and the map made of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.domain.errors import InputError
from das.domain.files.load import locate_vehicle
from das.domain.files.reading import read_toml
from das.domain.files.vehicles import read_chain
from tests.support.making import CHAIN

COMPONENTS = {"auxiliaries", "transformer", "line converter", "motor inverter", "motor copper", "motor iron", "gear"}
force_n = st.floats(-90e3, 90e3)
speed_mps = st.floats(0.01, 40.0)


def by_hand(force: float, speed: float) -> dict[str, float]:
    """The chain's formulas as scalars, written anew: the second witness. Kloss's equation is solved for the slip."""
    power = force * speed
    gear = 0.03 * abs(power) + 2e3 * (speed / 40) ** 2
    shaft = (power + gear) / speed
    flux = 1.0 if speed < 20 else 20 / speed
    torque = shaft / 90e3 * (1.1 if shaft < 0 else 1.0)
    share = abs(torque) / (2.0 * flux**2)
    slip = np.roots([share, -2.0, share]).real.min() if share > 0 else 0.0  # T/T_p = 2/(s + 1/s), s = slip / slip_p
    torque_current = abs(torque) * 2.0 * slip if share == 0 else abs(torque) / flux * math.sqrt(2.0 * slip / share)
    current = math.sqrt(((0.25 * flux) ** 2 + torque_current**2) / (1 + 0.25**2))
    copper, iron = 20e3 * current**2, 6e3 * flux**2 * (speed / 20) ** 1.5
    clock = (200.0 if speed < 10 else 7 * 1.8 * speed if speed < 20 else 1.8 * speed) / 200.0
    inverter = 12e3 * current + (6e3 * current + 3e3) * clock
    link = power + gear + copper + iron + inverter
    line = 4e3 + (0.03 if link < 0 else 0.02) * abs(link)
    transformer = 5e3 + 40e3 * ((link + line + 10e3) / 2e6) ** 2
    heat = transformer + line + inverter + copper + iron
    return {
        "auxiliaries": 10e3 + 8e3 * (heat / 100e3) ** 3,
        "transformer": transformer,
        "line converter": line,
        "motor inverter": inverter,
        "motor copper": copper,
        "motor iron": iron,
        "gear": gear,
    }


@pytest.mark.parametrize(
    ("force", "speed"),
    [(50e3, 5.0), (60e3, 15.0), (40e3, 30.0), (-40e3, 30.0), (-80e3, 8.0), (20e3, 20.0), (0.0, 25.0)],
)
def test_every_component_is_its_formula(force: float, speed: float) -> None:
    losses = CHAIN.loss_by_component_w(force, speed)
    assert {name: float(loss) for name, loss in losses.items()} == pytest.approx(by_hand(force, speed), rel=1e-9)


def test_the_components_are_named_and_add_up() -> None:
    force, speed = np.array([[-50e3], [0.0], [70e3]]), np.array([[0.0, 3.0, 12.0, 33.0]])
    losses = CHAIN.loss_by_component_w(force, speed)
    assert set(losses) == COMPONENTS
    assert {loss.shape for loss in losses.values()} == {(3, 4)}
    assert CHAIN.loss_w(force, speed) == pytest.approx(sum(losses.values()))


def test_all_losses_vanish_at_standstill() -> None:
    assert not CHAIN.loss_w([-50e3, 0.0, 50e3], 0.0).any()
    assert all(not loss.any() for loss in CHAIN.loss_by_component_w([-50e3, 0.0, 50e3], 0.0).values())


@given(force=st.floats(1e3, 90e3), speed=speed_mps)
def test_braking_loses_less_than_driving_where_the_components_are_the_same(force: float, speed: float) -> None:
    """The components behind the gear carry less than the wheel gives, not more."""
    motors = replace(CHAIN.motors, brake_current_ratio=1.0)
    same = replace(CHAIN, motors=motors, converter=replace(CHAIN.converter, line_brake_ratio=0.02))
    # Where it brakes more weakly than the losses, the chain takes power from the line in both quadrants.
    losses = float(same.loss_w(force, speed))
    if force * speed > 2 * losses:
        assert float(same.loss_w(-force, speed)) < losses


@given(speed=speed_mps, small=st.floats(0, 89e3), more=st.floats(1.0, 1e3))
def test_more_force_loses_more(speed: float, small: float, more: float) -> None:
    assert float(CHAIN.loss_w(small + more, speed)) > float(CHAIN.loss_w(small, speed))


def test_small_torques_need_current_in_proportion_and_pull_out_the_square_root_of_two_more() -> None:
    """Kloss: i² ∝ T·s, and s = s_p·T/(2·T_p) for small torques, s_p at pull-out: twice as much per torque squared."""
    motors = replace(CHAIN.motors, magnetising_ratio=0.0)
    small, pull_out = 1e-4 * 90e3, 2.0 * 90e3
    assert float(motors.current_ratio(np.array(small), np.array(10.0))) == pytest.approx(1e-4, rel=1e-6)
    assert float(motors.current_ratio(np.array(pull_out), np.array(10.0))) == pytest.approx(2.0 * math.sqrt(2))
    weak = motors.current_ratio(np.array(small), np.array(40.0))
    assert float(weak) == pytest.approx(2e-4, rel=1e-5), "half the flux needs twice the current"


def test_the_clock_falls_at_each_change_and_never_exceeds_the_asynchronous_one_where_so_chosen() -> None:
    speeds = np.array([1.0, 9.999, 10.0, 19.999, 20.0, 40.0])
    expected = [200, 200, 7 * 18.0, 7 * 1.8 * 19.999, 36.0, 72.0]
    assert CHAIN.converter.switching_hz(speeds) == pytest.approx(expected)


@pytest.mark.parametrize("name", ["re460-ic", "re460-ic-igbt"])
def test_the_bundled_clocks_stay_below_their_asynchronous_frequency(name: str) -> None:
    converter = read_chain(read_toml(locate_vehicle(name)).table("losses").table("l3")).converter
    assert converter.switching_hz(np.linspace(0.1, 200 / 3.6, 5000)).max() <= converter.asynchronous_hz * 1.005


def test_the_map_is_the_chain_at_every_node_and_goes_down_to_standstill() -> None:
    made = CHAIN.to_map("m", 90e3, 85e3, 40.0)
    assert (made.speed_step_mps * 3.6, made.force_step_n) == pytest.approx((1.0, 1000.0))
    assert made.force_n[0] <= -85e3
    assert made.force_n[-1] >= 90e3
    assert made.speed_mps[-1] >= 40.0
    i, j = np.meshgrid(np.arange(1, 140, 23), np.arange(0, len(made.force_n), 19), indexing="ij")
    nodes = CHAIN.loss_w(made.force_n[j], made.speed_mps[i])
    assert made.loss_w_table[i, j] == pytest.approx(nodes, rel=1e-12)
    almost_still = CHAIN.loss_w(made.force_n, 1e-9)
    assert made.loss_w_table[0] == pytest.approx(almost_still, rel=1e-5)
    assert np.isfinite(made.loss_w_table).all()


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
@pytest.mark.parametrize(
    ("component", "key"), [("auxiliaries", "fan_w"), ("transformer", "copper_w"), ("gear", "mesh_ratio")]
)
def test_a_bad_parameter_is_refused(component: str, key: str, value: float) -> None:
    with pytest.raises(InputError, match=f"^{component}: {key} = {value}: expected a finite number >= 0$"):
        replace(getattr(CHAIN, component), **{key: value})


@pytest.mark.parametrize(
    ("component", "key"),
    [
        ("auxiliaries", "rated_heat_w"),
        ("transformer", "rated_power_w"),
        ("converter", "asynchronous_hz"),
        ("motors", "base_speed_mps"),
        ("motors", "pull_out_ratio"),
        ("gear", "churning_speed_mps"),
    ],
)
def test_what_is_divided_by_must_not_be_zero(component: str, key: str) -> None:
    with pytest.raises(InputError, match=f"^{component}: {key} = 0.0: expected a finite number > 0$"):
        replace(getattr(CHAIN, component), **{key: 0.0})


def test_a_map_of_impossible_size_is_refused() -> None:
    with pytest.raises(
        InputError,
        match=r"^huge: size of the loss map = '146 speeds × 1000000103 forces'",
    ):
        CHAIN.to_map("huge", 1e12, 1e5, 40.0)


def test_a_parameter_beyond_any_train_is_refused() -> None:
    with pytest.raises(InputError, match="churning_speed_mps"):
        replace(CHAIN.gear, churning_speed_mps=1e300)
