"""Vehicle files: what a good one gives, a table of bad ones with their messages, and the loss map beside one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.files.load import load_vehicle
from das.domain.files.reading import read_toml
from das.domain.files.vehicles import read_chain, read_vehicle
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap
from das.domain.vehicle import BrakePolicy
from tests.das.domain.files.refusing import named, refused_with
from tests.support.making import CHAIN

VEHICLE = """schema_version = 1
[vehicle]
id = "t"
name = "T"
mass_t = 100.0
rotating_mass_ratio = 0.08
length_m = 0.0
max_speed_kmh = 144.0
max_deceleration_mps2 = 0.9
[resistance]
c0_kn = 2.0
c1_kn_per_kmh = 0.01
c2_n_per_mps2 = 5.0
[traction]
max_force_kn = 100.0
max_power_kw = 2000.0
[electric_brake]
max_force_n = 90000
max_power_kw = 1500.0
[friction_brake]
max_force_kn = 50.0
[brakes]
policy = "blended"
[losses]
default = "l2"
[losses.own]
traction_efficiency_ratio = 0.9
brake_efficiency_ratio = 0.8
[losses.l2]
mean_efficiency_ratio = 0.85
idle_kw = 20.0
[losses.l3]
kind = "components"
auxiliaries = {base_kw = 10.0, fan_kw = 8.0, rated_heat_w = 100e3}
transformer = {no_load_kw = 5.0, copper_kw = 40.0, rated_power_kw = 2000.0}
gear = {mesh_ratio = 0.03, churning_kw = 2.0, churning_speed_kmh = 144.0}
motors.base_speed_kmh = 72.0
motors.rated_force_kn = 90.0
motors.magnetising_ratio = 0.25
motors.pull_out_ratio = 2.0
motors.brake_current_ratio = 1.1
motors.copper_kw = 20.0
motors.iron_kw = 6.0
[losses.l3.converter]
fixed_kw = 4.0
line_ratio = 0.02
line_brake_percent = 3.0
conduction_kw = 12.0
switching_kw = 6.0
snubber_kw = 3.0
asynchronous_hz = 200.0
stator_hz_per_mps = 1.8
clock_speeds_kmh = [36.0, 72.0]
clock_pulses = [7, 1]
"""


def test_a_good_vehicle(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_text(VEHICLE)
    train = load_vehicle(str(path))
    assert (train.mass_kg, train.inertial_mass_kg) == pytest.approx((100e3, 108e3))
    assert (train.max_speed_mps, train.max_deceleration_mps2, train.max_acceleration_mps2) == (40, 0.9, np.inf)
    assert float(train.resistance.force_n(10)) == pytest.approx(2000 + 360 + 500)
    assert (train.traction.max_force_n, train.traction.max_power_w) == (100e3, 2e6)
    assert (train.electric_brake.max_force_n, train.electric_brake.max_power_w) == (90e3, 1.5e6)
    assert (train.friction_brake_force_n, train.brake_policy) == (50e3, BrakePolicy.BLENDED)
    assert train.default_level is Level.L2
    assert train.losses[Level.OWN] == EfficiencyLoss.from_efficiencies(0.9, 0.8)
    assert train.losses[Level.L2] == EfficiencyLoss.symmetric(0.85, 20e3)
    assert read_chain(read_toml(path).table("losses").table("l3")) == CHAIN
    loss_map = train.losses[Level.L3]
    assert isinstance(loss_map, LossMap)
    assert loss_map.speed_mps[-1] >= train.max_speed_mps
    force, speed = np.array([50e3, -40e3, 0.0]), np.array([20.0, 30.0, 35.0])
    assert loss_map.loss_w(force, speed) == pytest.approx(CHAIN.loss_w(force, speed), rel=1e-9)


ELECTRIC = "[electric_brake]\nmax_force_n = 90000\nmax_power_kw = 1500.0\n"
AIR_ONLY = VEHICLE.replace(ELECTRIC, "").replace('"blended"', '"friction"')
SLOWER = "[service_brake]\nbuild_up_s = 6.0\n"


@pytest.mark.parametrize(("text", "build_up_s"), [(VEHICLE, 1.5), (AIR_ONLY, 4.5), (AIR_ONLY + SLOWER, 6.0)])
def test_brakes_build_up_as_the_file_says_or_as_usual_for_their_kind(
    text: str, build_up_s: float, tmp_path: Path
) -> None:
    path = tmp_path / "t.toml"
    path.write_text(text)
    assert read_vehicle(path).service_brake.build_up_s == build_up_s


BAD_VEHICLES = [
    ("schema_version = 1", "schema_version = 2", r"schema_version = 2: expected 1"),
    ("schema_version = 1\n", "", r"schema_version is missing: expected 1"),
    ("schema_version = 1", "schema_version = true", r"schema_version = True: expected 1"),
    ("schema_version = 1", "schema_version = 1\n[paint]", r"paint = \{\}: expected one of the keys .*losses"),
    ("mass_t = 100.0", "mass_lb = 100.0", r"vehicle\.mass_lb = 100\.0: expected one of the keys .*mass_kg.*mass_t"),
    (
        "mass_t = 100.0",
        "mass_t = 100.0\nmass_kg = 1e5",
        r"vehicle\.mass_t = 100\.0: expected only one of mass_kg and mass_t",
    ),
    ("mass_t = 100.0", "", r"vehicle\.mass is missing: expected mass_kg or mass_t"),
    ("mass_t = 100.0", 'mass_t = "heavy"', r"vehicle\.mass_t = 'heavy': expected a number"),
    ("mass_t = 100.0", "mass_t = nan", r"vehicle\.mass_t = nan: expected a number"),
    ("mass_t = 100.0", f"mass_t = 1{'0' * 400}", r"vehicle\.mass_t = '100000000000… \(401 digits\)': expe"),
    ("mass_t = 100.0", "mass_t = 1e200", r"vehicle\.mass_t = 1e\+200: expected a number of at most 1e\+09"),
    ("max_speed_kmh = 144.0", "max_speed_kmh = -1e300", r"vehicle\.max_speed_kmh = -1e\+300"),
    ("length_m = 0.0", "length_m = 1e-300", r"vehicle\.length = 1e-300: expected 0 m \(a point\), or at least 0\.1 m"),
    ('id = "t"', "id = 5", r"vehicle\.id = 5: expected a string"),
    ("[resistance]", "[resistence]", r"resistence = .*: expected one of the keys .*resistance"),
    ("[traction]\nmax_force_kn = 100.0\nmax_power_kw = 2000.0\n", "", r"traction is missing: expected a table"),
    ("max_power_kw = 2000.0", "max_power_hp = 2000.0", r"traction\.max_power_hp = 2000\.0: expected one of the keys"),
    ('policy = "blended"', 'policy = "magnetic"', r"brakes\.policy = 'magnetic': expected one of electric, blended, f"),
    ('policy = "blended"', "", r"brakes\.policy is missing: expected a string"),
    ('default = "l2"', 'default = "l9"', r"losses\.default = 'l9': expected one of l0-noreg, l0-reg, l1, l2, l3, own"),
    ('default = "l2"', 'default = "l1"', r"default.* = 'l1': expected a level of the vehicle"),
    ("mean_efficiency_ratio = 0.85", "mean_efficiency_ratio = 85", r"losses\.l2\.mean_efficiency_ratio = 85\.0: expec"),
    ("brake_efficiency_ratio = 0.8", "brake_efficiency_ratio = 0", r"losses\.own\.brake_efficiency_ratio = 0\.0: expe"),
    ('kind = "components"', 'kind = "magic"', r"losses\.l3\.kind = 'magic': expected components or csv"),
    ("line_ratio = 0.02\n", "", r"losses\.l3\.converter\.line is missing: expected line_ratio or line_percent"),
    ("gear = {", "gears = {", r"losses\.l3\.gears = .*: expected one of the keys auxiliaries, .*gear"),
    ("iron_kw = 6.0", "iron_kw = -6.0", r"losses\.l3\.motors\.iron_w = -6000\.0: expected a finite number >= 0"),
    ("base_speed_kmh = 72.0", "base_speed_kmh = 0", r"losses\.l3\.motors\.base_speed_mps = 0\.0: expected .* > 0"),
    ("fan_kw = 8.0", "fan_kw = inf", r"losses\.l3\.auxiliaries\.fan_kw = inf: expected a finite number"),
    (
        "clock_speeds_kmh = [36.0, 72.0]",
        "clock_speeds_kmh = 30",
        r"losses\.l3\.converter\.clock_speeds_kmh = 30: expec",
    ),
    ("[36.0, 72.0]", "[36.0, true]", r"losses\.l3\.converter\.clock_speeds_kmh\[1\] = True: expected a number"),
    ("[36.0, 72.0]", "[72.0, 36.0]", r"losses\.l3\.converter\.clock_speeds_mps = .*: expected increasing speeds"),
    (
        "clock_pulses = [7, 1]",
        "clock_pulses = [7]",
        r"losses\.l3\.converter\.clock_pulses = .*: expected one number for",
    ),
    ("mass_t = 100.0", "mass_t = = 100", r"not valid TOML \("),
    ("mass_t = 100.0", f"mass_t = {'[' * 100_000}", r"not valid TOML \("),
    ("mass_t = 100.0", f"mass_t = {'1' * 5000}", r"not valid TOML \("),
]


@pytest.mark.parametrize("change", BAD_VEHICLES, ids=named(BAD_VEHICLES))
def test_a_bad_vehicle_is_refused_in_one_line(tmp_path: Path, change: tuple[str, str, str]) -> None:
    refused_with(read_vehicle, tmp_path / "bad.toml", VEHICLE, change)


def test_a_loss_map_is_found_beside_the_vehicle(tmp_path: Path) -> None:
    start = VEHICLE.index("[losses.l3]")
    path = tmp_path / "t.toml"
    path.write_text(VEHICLE[:start] + '[losses.l3]\nkind = "csv"\npath = "map.csv"\n')
    with pytest.raises(DasError, match=r"map\.csv: cannot be read \(No such file"):
        read_vehicle(path)
    (tmp_path / "map.csv").write_text("speed_kmh,force_n,loss_w\n0,0,1\n0,9,2\n9,0,3\n9,9,4\n")
    assert isinstance(read_vehicle(path).losses[Level.L3], LossMap)
