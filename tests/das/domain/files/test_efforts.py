"""Effort curves and modes in vehicle files: what a good one gives, and a table of bad ones with their messages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from das.domain.effort import EffortCurve
from das.domain.errors import DasError
from das.domain.files.vehicles import read_vehicle
from das.domain.units import KMH
from das.domain.vehicle import BrakePolicy

HEAD = """schema_version = 1
[vehicle]
id = "t"
name = "T"
mass_t = 100.0
length_m = 0.0
max_speed_kmh = 120.0
{more}
[resistance]
c0_kn = 2.0
c1_kn_per_kmh = 0.01
c2_n_per_mps2 = 5.0
[losses]
"""
INLINE = """[traction.curve]
columns = ["speed_kmh", "force_kn"]
rows = [[0, 100], [36, 100], [72, 60], [120, 30]]
"""
BESIDE = '[traction]\ncurve = "effort.csv"\n'
EFFORT = "speed_kmh,force_kn\n0,100\n36,100\n72,60\n120,30\n"
CURVE = EffortCurve(speed_mps=(0.0, 10.0, 20.0, 120 * KMH), force_n=(1e5, 1e5, 6e4, 3e4))
MODES = """[traction]
max_force_kn = 100.0
max_power_kw = 2000.0
[electric_brake]
max_force_kn = 80.0
max_power_kw = 2000.0
[modes.15kv]
voltage_kv = 15
[modes.15kv.traction]
curve = "effort.csv"
[modes.leaves]
weather = "leaves on the rail"
[modes.leaves.electric_brake]
max_force_kn = 10.0
max_power_kw = 2000.0
[loads.empty]
mass_t = 80.0
"""


def written(folder: Path, tables: str, *, more: str = "", effort: str = EFFORT) -> Path:
    (folder / "effort.csv").write_text(effort)
    path = folder / "train.toml"
    path.write_text(HEAD.format(more=more) + tables)
    return path


@pytest.mark.parametrize("tables", [INLINE, BESIDE])
def test_a_curve_stands_in_the_file_or_beside_it(tables: str, tmp_path: Path) -> None:
    train = read_vehicle(written(tmp_path, tables))
    assert train.traction.curve is not None
    assert train.traction.curve.speed_mps == pytest.approx(CURVE.speed_mps)
    assert train.traction.curve.force_n == CURVE.force_n
    assert train.traction.max_force_n == 1e5
    # The largest power lies inside a piece: 20 m/s · 60 kN at its end, but 17.5 m/s · 70 kN before it.
    assert train.traction.max_power_w == pytest.approx(17.5 * 7e4)
    assert train.brake_policy is BrakePolicy.ELECTRIC


def test_a_mode_has_the_efforts_of_the_file_where_it_gives_none_of_its_own(tmp_path: Path) -> None:
    train = read_vehicle(written(tmp_path, MODES))
    assert (train.mode, list(train.modes)) == ("", ["15kv", "leaves"])
    assert train.modes["15kv"].voltage_v == 15_000.0
    assert train.modes["leaves"].weather == "leaves on the rail"
    volts, leaves = train.in_mode("15kv"), train.in_mode("leaves")
    assert volts.traction_effort_n(20.0) == pytest.approx(6e4)
    assert volts.electric_brake == train.electric_brake
    assert leaves.traction == train.traction
    assert leaves.electric_brake.max_force_n == 1e4
    with pytest.raises(DasError, match="no mode '25kv'; it has 15kv, leaves"):
        train.in_mode("25kv")


def test_the_default_mode_is_the_one_of_the_train(tmp_path: Path) -> None:
    only = '[modes.15kv.traction]\ncurve = "effort.csv"\n[modes.3kv.traction]\nmax_force_kn = 90\nmax_power_kw = 1000\n'
    train = read_vehicle(written(tmp_path, only, more='default_mode = "15kv"'))
    assert (train.mode, train.traction.max_force_n) == ("15kv", 1e5)
    assert train.in_mode("3kv").traction.max_force_n == 9e4


@pytest.mark.parametrize("name", ["15kv", "empty+15kv", "15kv+empty"])
def test_a_load_state_and_a_mode_are_picked_by_one_name(name: str, tmp_path: Path) -> None:
    """Scenarios, the node and plans of tables pick a mode as they pick a load."""
    train = read_vehicle(written(tmp_path, MODES)).loaded(name)
    assert train.id == f"t/{name}"
    assert train.mode == "15kv"
    assert train.mass_kg == (8e4 if "empty" in name else 1e5)


@pytest.mark.parametrize("name", ["15kv+leaves", "empty+empty", "leaves+empty+leaves"])
def test_two_modes_or_two_load_states_are_refused(name: str, tmp_path: Path) -> None:
    """The last one would silently replace the others."""
    with pytest.raises(DasError, match=r"load '.*': expected at most one load state and one mode"):
        read_vehicle(written(tmp_path, MODES)).loaded(name)


BAD = {
    "falls back": (
        INLINE.replace("[72, 60]", "[30, 60]"),
        EFFORT,
        r"traction\.curve\.rows\[2\] = '30 km/h': expected rising",
    ),
    "begins late": (
        INLINE.replace("[0, 100]", "[5, 100]"),
        EFFORT,
        r"rows\[0\] = '5 km/h': expected 0 km/h as the first speed",
    ),
    "ends early": (
        INLINE.replace("[120, 30]", "[110, 30]"),
        EFFORT,
        "= '110 km/h': expected at least 2 points, up to the top",
    ),
    "negative": (INLINE.replace("60]", "-60]"), EFFORT, r"rows\[2\] = '-60 kN': expected a force from 0"),
    "no force": (
        INLINE.replace("100]", "0]").replace("60]", "0]").replace("30]", "0]"),
        EFFORT,
        "= 'all 0': expected a force",
    ),
    "stands": (
        INLINE.replace("[0, 100]", "[0, 0]"),
        EFFORT,
        "'0 kN at 0 km/h': expected a force > 0; otherwise the train",
    ),
    "unit": (INLINE.replace("force_kn", "force_lbf"), EFFORT, r"columns = 'force_lbf': expected force_N or force_n"),
    "both": (
        "[traction]\nmax_force_kn = 1\n" + INLINE,
        EFFORT,
        r"traction\.max_force_kn = 1: expected one of the keys curve",
    ),
    "a number": (
        "[traction]\ncurve = 3\n",
        EFFORT,
        r"traction\.curve = 3: expected the name of a CSV file, or a table",
    ),
    "no file": ('[traction]\ncurve = "other.csv"\n', EFFORT, r"other\.csv: cannot be read"),
    "no unit in the file": (BESIDE, EFFORT.replace("speed_kmh", "v"), "column 1 = 'v': expected speed"),
    "three columns": (BESIDE, EFFORT.replace("kn\n", "kn,x\n", 1), "column 3 = 'x': expected only"),
    "a text": (BESIDE, EFFORT.replace("72,60", "72,fast"), "line 4 = '72,fast': expected 2 numbers"),
    "line": (BESIDE, EFFORT.replace("72,60", "30,60"), "line 4 = '30 km/h': expected rising speeds"),
    "no traction": (
        "[modes.a.electric_brake]\nmax_force_kn = 1\nmax_power_kw = 1\n",
        EFFORT,
        "traction is missing: expected a table",
    ),
    "mode's key": (MODES.replace("voltage_kv", "volts"), EFFORT, r"modes\.15kv\.volts = 15: expected one of the keys"),
    "brake fades out": (
        INLINE + "[electric_brake.curve]\n" + INLINE.partition("\n")[2].replace("[0, 100]", "[0, 0]"),
        EFFORT,
        r"electric_brake\.curve = '0 kN at 0 km/h': expected a force > 0, or a \[friction_brake\]",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_curve_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    tables, effort, message = BAD[name]
    with pytest.raises(DasError, match=message) as caught:
        read_vehicle(written(tmp_path, tables, effort=effort))
    assert "\n" not in str(caught.value)


def test_an_unknown_default_mode_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DasError, match=r"vehicle\.default_mode = '25kv': expected one of the modes 15kv, leaves"):
        read_vehicle(written(tmp_path, MODES, more='default_mode = "25kv"'))


def test_a_higher_top_speed_than_that_of_the_curve_is_refused(tmp_path: Path) -> None:
    train = read_vehicle(written(tmp_path, INLINE))
    with pytest.raises(DasError, match=r"last speed of traction\.curve = '120 km/h': expected at least .* 130 km/h"):
        replace(train, max_speed_mps=130 * KMH)
