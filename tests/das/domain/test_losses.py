"""Losses: closed forms, exactness and coverage of maps, fits, bad map files, the real VIRM6 map, the Re 460's chain."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.domain.errors import DasError, InputError
from das.domain.files.load import load_vehicle
from das.domain.files.vehicles import read_loss_map
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap, fit_mean_efficiency, operating_points
from precompute.loss_maps import fit_error
from tests.das.domain.files.refusing import refused

FORCES = np.linspace(-200e3, 200e3, 41)
SPEEDS = np.linspace(0.0, 50.0, 26)
POWER_W = 3e6
force_n = st.floats(-200e3, 200e3)
speed_mps = st.floats(0.01, 50.0)
efficiency = st.floats(0.3, 1.0)


def linear_in_each(force: np.ndarray | float, speed: np.ndarray | float) -> np.ndarray:
    """A loss that bilinear interpolation reproduces exactly."""
    return np.asarray(60e3 + 0.2 * force + 500.0 * speed + 0.01 * force * speed)


def map_of_losses(table: np.ndarray, name: str = "m") -> LossMap:
    return LossMap(name=name, speed_mps=SPEEDS.copy(), force_n=FORCES.copy(), loss_w_table=table)


def loss_map(*, power_w: float = np.inf, name: str = "map") -> LossMap:
    """`linear_in_each` as a map, cut at a power hyperbola."""
    speed, force = np.meshgrid(SPEEDS, FORCES, indexing="ij")
    table = np.where(np.abs(force * speed) <= power_w, linear_in_each(force, speed) + 150e3, np.nan)
    return map_of_losses(table, name)


def written(folder: Path, text: str) -> Path:
    path = folder / "bad.csv"
    path.write_text(text)
    return path


@given(force=force_n, speed=speed_mps, traction=efficiency, brake=efficiency)
def test_power_at_the_collector_is_over_eta_when_driving_and_times_eta_when_braking(
    force: float, speed: float, traction: float, brake: float
) -> None:
    loss = EfficiencyLoss.from_efficiencies(traction, brake).loss_w(force, speed)
    expected = force * speed / traction if force > 0 else force * speed * brake
    assert force * speed + float(loss) == pytest.approx(expected, rel=1e-9, abs=1e-6)


@given(force=force_n, speed=speed_mps, mean=efficiency, idle_w=st.floats(0, 2e5))
def test_l1_and_l2_are_symmetric_in_power(force: float, speed: float, mean: float, idle_w: float) -> None:
    loss = EfficiencyLoss.symmetric(mean, idle_w).loss_w([force, -force], speed)
    assert loss == pytest.approx([(1 / mean - 1) * abs(force * speed) + idle_w] * 2, rel=1e-9, abs=1e-6)


def test_there_is_no_loss_at_standstill() -> None:
    assert EfficiencyLoss.symmetric(0.9, 1e5).loss_w([-1e5, 0, 1e5], 0.0).tolist() == [0, 0, 0]
    assert loss_map().loss_w([-1e5, 0, 1e5], 0.0).tolist() == [0, 0, 0]


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
@pytest.mark.parametrize("name", ["traction_ratio", "brake_ratio", "idle_w"])
def test_a_bad_efficiency_loss_is_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"efficiency loss: {name} = {value}"):
        EfficiencyLoss(**{"traction_ratio": 0.1, "brake_ratio": 0.1, "idle_w": 0.0, name: value})


@given(force=force_n, speed=speed_mps)
def test_a_map_reproduces_a_bilinear_loss(force: float, speed: float) -> None:
    assert float(loss_map().loss_w(force, speed)) == pytest.approx(linear_in_each(force, speed) + 150e3, rel=1e-9)


@given(speed=speed_mps, share=st.floats(-1, 1))
def test_a_map_cut_by_a_hyperbola_is_exact_up_to_it(speed: float, share: float) -> None:
    force = share * min(200e3, POWER_W / speed)
    loss = loss_map(power_w=POWER_W).loss_w(force, speed)
    assert float(loss) == pytest.approx(linear_in_each(force, speed) + 150e3, rel=1e-9)


@given(speed=st.floats(20, 50), beyond=st.floats(0, 1), sign=st.sampled_from([-1, 1]))
def test_a_map_does_not_cover_what_lies_a_cell_beyond_its_edge(speed: float, beyond: float, sign: int) -> None:
    outermost = POWER_W / (2 * np.floor(speed / 2)) + 10e3
    assert not loss_map(power_w=POWER_W).covers(sign * (outermost + 1 + beyond * 1e5), speed)


@pytest.mark.parametrize(
    ("force", "speed", "shown"),
    [
        (200e3, 30.0, "the state 200.0 kN at 108.0 km/h (6000 kW at the wheel) is outside"),
        (-211e3, 10.0, "the state -211.0 kN at 36.0 km/h (-2110 kW at the wheel) is outside"),
        (0.0, 50.1, "the state 0.0 kN at 180.4 km/h (0 kW at the wheel) is outside"),
        (np.nan, 1.0, "the state nan kN at 3.6 km/h"),
    ],
)
def test_a_state_outside_the_map_is_named(force: float, speed: float, shown: str) -> None:
    with pytest.raises(DasError, match=re.escape(f"virm: {shown}")):
        loss_map(power_w=POWER_W, name="virm").loss_w([0.0, force], [10.0, speed])


def test_losses_go_on_linearly_past_the_edge_but_not_below_zero() -> None:
    row = [np.nan, np.nan, 50.0, 20.0, 60.0, np.nan, np.nan]
    falling = [np.nan, np.nan, np.nan, 50.0, 20.0, np.nan, np.nan]
    table = np.array([row, falling])
    built = LossMap(name="m", speed_mps=np.array([0.0, 1.0]), force_n=np.arange(-3.0, 4.0), loss_w_table=table)
    assert built.filled_w[0].tolist() == [110, 80, 50, 20, 60, 100, 140]
    assert built.filled_w[1].tolist() == [140, 110, 80, 50, 20, 0, 0]
    assert float(built.loss_w(1.5, 0.5)) == pytest.approx((80 + 10) / 2)
    assert built.force_low_n.tolist() == [-1, 0]
    assert built.force_high_n.tolist() == [1, 1]


@pytest.mark.parametrize("axis", ["speed_mps", "force_n"])
@pytest.mark.parametrize("order", [[1, 0, 2], [2, 1, 0], [0, 0, 2]], ids=["unsorted", "falling", "repeated"])
def test_an_axis_that_does_not_rise_evenly_is_refused(axis: str, order: list[int]) -> None:
    axes = {"speed_mps": np.array([0.0, 1.0, 2.0]), "force_n": np.array([-1.0, 0.0, 1.0])}
    axes[axis] = axes[axis][order]
    with pytest.raises(
        InputError, match=rf"^m: {axis.removesuffix('_mps').removesuffix('_n')} step after .* expected an even grid"
    ):
        LossMap(name="m", **axes, loss_w_table=np.ones((3, 3)))


MAP_HEADER = "speed_kmh,force_n,loss_w\n"


def map_of(speeds: Sequence[int] = (0, 36, 72), forces: Sequence[int] = (-5000, 0, 5000)) -> str:
    return MAP_HEADER + "".join(f"{v},{f},{1000 + abs(f) + v}\n" for v in speeds for f in forces)


MAP = map_of()
BAD_MAPS = {
    "empty": ("", r"column 1 = '': expected speed_mps or speed_kmh"),
    "header only": (MAP_HEADER, r"empty loss map, expected rows of speed_kmh, force_n"),
    "unknown unit": (MAP.replace("_kmh", "_knots"), r"column 1 = 'speed_knots': expected speed_mps or speed_kmh"),
    "wrong order": (MAP.replace("force_n,loss_w", "loss_w,force_n"), r"column 2 = 'loss_w': expected force_n or force"),
    "text": (MAP.replace("36,0,1036", "36,zero,1036"), r"line 6 = '36,zero,1036': expected 3 numbers"),
    "NaN": (MAP.replace("36,0,1036", "36,0,nan"), r"line 6 = '36,0,nan': expected finite numbers; omit"),
    "negative loss": (MAP.replace("36,0,1036", "36,0,-7"), r"loss at 36 km/h, 0 N = -7.0: expected a finite loss >= 0"),
    "duplicate": (MAP + "36,0,9\n", r"line 11 = .*: expected each speed and force only once"),
    "duplicate after a blank line": (MAP + "\n\n36,0,9\n", r"line 13 = .*: expected each speed and force only once"),
    "gap": (MAP.replace("36,0,1036\n", ""), r"forces at 36 km/h = '2 points': expected one unbroken range of at least"),
    "uneven speeds": (MAP.replace("72,", "73,"), r"speed step after .*: expected an even grid"),
    "no standstill": (
        map_of(speeds=(18, 36, 54)),
        r"first speed \(km/h\) = 18.0: expected a map that begins at 0 km/h",
    ),
    "no zero force": (map_of(forces=(-5000, 500, 6000)), r"force = .*: expected 0 N among the points of the grid"),
    "only traction": (map_of(forces=(5000, 10000, 15000)), r"forces \(N\) = .*: expected a range that contains 0 N"),
    "one speed": (MAP_HEADER + "0,0,1\n0,1,1\n", r"speed = 1: expected at least two different values"),
    "endless quote": (MAP + '"' + "9" * 200_000, r"line 11"),
}


@pytest.mark.parametrize(("text", "expected"), BAD_MAPS.values(), ids=BAD_MAPS)
def test_a_bad_map_is_refused_in_one_line(tmp_path: Path, text: str, expected: str) -> None:
    refused(read_loss_map, written(tmp_path, text), expected)


def test_the_rows_of_a_map_may_come_in_any_order_and_unit(tmp_path: Path) -> None:
    one = read_loss_map(written(tmp_path, MAP))
    rows = [[float(x) for x in row.split(",")] for row in reversed(MAP.splitlines()[1:])]
    other_units = "".join(f"{v / 3.6:.6f},{f / 1e3},{w / 1e3}\n" for v, f, w in rows)
    other = read_loss_map(written(tmp_path, "speed_mps,force_kn,loss_kw\n\n" + other_units))
    assert other.speed_mps == pytest.approx(one.speed_mps, rel=1e-6)
    assert other.force_n.tolist() == one.force_n.tolist() == [-5000, 0, 5000]
    assert other.loss_w_table == pytest.approx(one.loss_w_table)


def efficiency_table(mean: float, idle_w: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    speed, force = np.meshgrid(SPEEDS, FORCES, indexing="ij")
    return speed, force, (1 / mean - 1) * np.abs(force * speed) + idle_w


@pytest.mark.parametrize(("mean", "idle_w"), [(17 / 32, 0.0), (0.9, 0.0), (1.0, 1.0), (1.0, 0.0)])
def test_l2_fits_a_map_without_idle_loss_or_without_proportional_loss(mean: float, idle_w: float) -> None:
    _, _, table = efficiency_table(mean, idle_w)
    made = map_of_losses(table)
    fit = fit_mean_efficiency(made, POWER_W, with_idle=True)
    assert (fit.traction_ratio, fit.idle_w) == pytest.approx((1 / mean - 1, idle_w), abs=1e-3)


def test_l2_fits_a_map_whose_loss_grows_with_the_square_of_power() -> None:
    """The straight line through a parabola has a negative constant; the best one allowed is 0."""
    speed, force = np.meshgrid(SPEEDS, FORCES, indexing="ij")
    table = 1e-7 * (force * speed) ** 2
    made = map_of_losses(table)
    assert fit_mean_efficiency(made, POWER_W, with_idle=True).idle_w == 0


@given(mean=st.floats(0.3, 0.99), idle_w=st.floats(1, 2e5))
def test_a_fit_recovers_the_efficiency_and_idle_loss_a_map_was_made_of(mean: float, idle_w: float) -> None:
    speed, force, table = efficiency_table(mean, idle_w)
    table[np.abs(force * speed) > POWER_W] *= 7.0  # not within the power: the fit must not look there
    made = map_of_losses(table)
    fit = fit_mean_efficiency(made, POWER_W, with_idle=True)
    assert 1 / (1 + fit.traction_ratio) == pytest.approx(mean, rel=1e-9)
    assert fit.idle_w == pytest.approx(idle_w, rel=1e-6, abs=1e-3)
    power = np.abs(force * speed)[1:]
    use = power <= POWER_W
    slope = (power[use] @ table[1:][use]) / (power[use] @ power[use])
    without = fit_mean_efficiency(made, POWER_W, with_idle=False)
    assert without.brake_ratio == pytest.approx(slope, rel=1e-9, abs=1e-12)
    assert without.idle_w == 0


def test_operating_points_are_those_within_power_and_force() -> None:
    points = operating_points(loss_map(), POWER_W, 100e3)
    assert (points.speed_mps > 0).all()
    assert np.abs(points.force_n).max() == 100e3
    assert points.power_w == pytest.approx(np.abs(points.force_n * points.speed_mps))
    assert points.power_w.max() <= POWER_W
    within = sum(abs(f * v) <= POWER_W and abs(f) <= 100e3 for f in FORCES for v in SPEEDS if v > 0)
    assert len(points.loss_w) == len(points.force_n) == within
    driving = points.force_n >= 0
    out = np.where(driving, points.power_w, points.power_w - points.loss_w)
    into = np.where(driving, points.power_w + points.loss_w, points.power_w)
    assert points.input_w() == pytest.approx(into)
    recovering = out > 0
    assert points.efficiency_ratio()[recovering] == pytest.approx((out / np.maximum(into, 1))[recovering])
    assert points.efficiency_ratio()[~recovering] == pytest.approx(0.0, abs=1e-12)


def test_the_error_of_a_fit_is_counted_over_its_operating_points() -> None:
    """A map 10 kW above and 10 kW below its fit in turn, and far off where the train has not the power."""
    speed, force, table = efficiency_table(0.8, 50e3)
    sign = np.where((np.arange(len(SPEEDS))[:, None] + np.arange(len(FORCES))) % 2, 1.0, -1.0)
    table = np.where(np.abs(force * speed) > POWER_W, 9e6, table + 10e3 * sign)
    made = map_of_losses(table)
    fit = EfficiencyLoss.symmetric(0.8, 50e3)
    error = fit_error(made, fit, POWER_W)
    use = (np.abs(force * speed) <= POWER_W) & (speed > 0)
    into = np.abs(force * speed) + np.where(force < 0, 0.0, table)
    assert error["error_largest_kw"] == pytest.approx(10.0)
    assert error["error_mean_to_input_ratio"] == pytest.approx(10e3 / into[use].mean())
    assert error["error_mean_to_largest_ratio"] == pytest.approx(10e3 / table[use].max())
    assert error["error_rms_to_largest_ratio"] == pytest.approx(10e3 / table[use].max())
    exact = map_of_losses(efficiency_table(0.8, 50e3)[2])
    assert fit_error(exact, fit, POWER_W)["error_rms_to_largest_ratio"] == pytest.approx(0.0, abs=1e-12)


def test_the_virm6_map_gives_the_values_of_its_file(shared: Path) -> None:
    path = shared / "loss_maps" / "NL_Intercity_VIRM6_chain.csv"
    virm = read_loss_map(path)
    with path.open() as file:
        rows = np.array([[float(x) for x in row] for row in list(csv.reader(file))[1:]])
    moving = rows[rows[:, 0] > 0]
    assert len(moving) > 10_000
    assert virm.loss_w(moving[:, 1], moving[:, 0] / 3.6) == pytest.approx(moving[:, 2], rel=1e-6)
    speed = np.linspace(0.1, 160, 700) / 3.6
    effort = np.minimum(213.9e3, 3129.278e3 / speed)
    assert virm.covers(effort, speed).all()
    assert virm.covers(-effort, speed).all()
    assert not virm.covers(1.15 * effort, speed).any()


def test_the_re460_map_is_what_the_paper_prints() -> None:
    train = load_vehicle("re460-ic")
    chain = train.losses[Level.L3]
    assert isinstance(chain, LossMap)
    fit = fit_mean_efficiency(chain, train.traction.max_power_w, with_idle=True)
    assert 1 / (1 + fit.traction_ratio) == pytest.approx(0.89, abs=0.005)
    assert fit.idle_w == pytest.approx(115e3, abs=5e3)
    speed = np.arange(75.0, 200.0) / 3.6
    at_full_power = chain.loss_w(6100e3 / speed, speed)
    assert at_full_power.mean() == pytest.approx(1000e3, rel=0.06)
