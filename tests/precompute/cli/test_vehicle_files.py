"""`das-precompute vehicle`: from a file of another program to a train that runs, pictures, warnings and exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from das.domain.files.load import load_vehicle
from tests.precompute.test_vehicle_import import CSV, stock
from tests.support.making import das_precompute, printed


@pytest.fixture
def train(tmp_path: Path) -> Path:
    """An imported train of two modes and a condition."""
    (tmp_path / "own.json").write_text(json.dumps(stock()))
    out = printed(tmp_path, "vehicle", "import", "own.json", "-o", "train.toml", "--losses", "0.85")
    assert "note: the file gives no losses and no electric brake" in out
    return tmp_path / "train.toml"


def test_an_imported_train_is_shown_drawn_and_checked(train: Path) -> None:
    done = das_precompute(train.parent, "show", "train.toml", "--plot", "train.png")
    assert done.returncode == 1
    assert "an effort curve of 3 points, at most 200 kN and 2250 kW" in done.stdout
    assert "25000V, thermal, 25000V-heating-22500V" in done.stdout
    assert (train.parent / "train.png").read_bytes().startswith(b"\x89PNG")
    assert "warning: train.toml: mode 25000V: traction.curve has no point between 0 and 72 km/h" in done.stderr


def test_a_mode_is_picked_on_the_command_line(train: Path) -> None:
    def least_s(*words: str) -> float:
        done = das_precompute(train.parent, "front", "flat-6km", "train.toml", "--buffers", "5", "--json", *words)
        assert done.returncode == 0, done.stderr
        return float(json.loads(done.stdout)["min_time_s"])

    shown = das_precompute(train.parent, "show", "train.toml", "--mode", "thermal", "--json")
    assert json.loads(shown.stdout)["max_force_n"] == 100e3
    assert least_s("--mode", "thermal") > least_s()
    refused = das_precompute(train.parent, "front", "flat-6km", "train.toml", "--mode", "3kV")
    assert refused.returncode == 2
    assert "no mode '3kV'; it has 25000V, thermal" in refused.stderr


def test_a_journey_names_a_mode_and_the_command_line_has_precedence(train: Path) -> None:
    (train.parent / "j.toml").write_text(
        'schema_version = 1\n[journey]\nid = "j"\nname = "J"\nmode = "thermal"\n'
        '[[stops]]\nstop = "A"\ndeparture_s = 0\n[[stops]]\nstop = "B"\narrival_s = 400\n'
    )

    def needs_kwh(*words: str) -> float:
        done = das_precompute(train.parent, "journey", "j.toml", "flat-6km", "train.toml", "--json", *words)
        assert done.returncode == 0, done.stderr
        return float(json.loads(done.stdout)["energy_kwh"])

    assert needs_kwh() != needs_kwh("--mode", "25000V")


def test_options_cut_an_effort_curve_but_do_not_raise_it(train: Path) -> None:
    words = ("solve", "flat-6km", "train.toml", "--buffer", "5", "--max-force-kn")
    assert das_precompute(train.parent, *words, "120").returncode == 0
    refused = das_precompute(train.parent, *words, "220")
    assert refused.returncode == 2
    assert "at most 200 kN and 2250 kW: options can lower it, not raise it" in refused.stderr


def test_a_table_becomes_a_train(tmp_path: Path) -> None:
    (tmp_path / "own.csv").write_text(CSV)
    davis = "20 N/t, 0.1 N/t/(km/h), 0.0035 N/t/(km/h)^2"
    words = ("--mass", "440 t", "--length", "200 m", "--max-speed", "160 km/h", "--davis", davis, "--name", "Own")
    done = das_precompute(tmp_path, "vehicle", "import", "own.csv", "-o", "own.toml", "--losses", "re460-ic", *words)
    assert done.returncode == 0, done.stderr
    assert load_vehicle(tmp_path / "own.toml").name == "Own"


def test_nothing_is_written_where_the_file_is_refused_or_another_is_there(train: Path) -> None:
    (train.parent / "bad.json").write_text(json.dumps(stock(mass=200)))
    words = ("vehicle", "import", "bad.json", "--losses", "0.85", "-o")
    done = das_precompute(train.parent, *words, "bad.toml")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert not (train.parent / "bad.toml").exists()
    before = train.read_bytes()
    there = das_precompute(train.parent, *words, "train.toml")
    assert (there.returncode, train.read_bytes()) == (2, before)
    assert "exists already" in there.stderr


@pytest.mark.parametrize("vehicle", ["re460-ic", "NL_Intercity_VIRM6", "CN_Beijing_Subway"])
def test_bundled_trains_are_shown_and_have_no_warnings_of_efforts(vehicle: str, tmp_path: Path) -> None:
    done = das_precompute(tmp_path, "show", vehicle, "--json")
    found = json.loads(done.stdout)
    assert len(found["cruising_j_per_m"]) == len(found["speed_mps"]) == 11
    assert (done.returncode, found["warnings"]) == (0, [])
