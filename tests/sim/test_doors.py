"""A package of 40 lines brings a driver, a presentation, a measure and an importer; the commands use all four."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from sim.doors import MEASURES, installed
from sim.drive.figures import NAMES as FIGURES
from tests.support.making import REPOSITORY

MODULE = """
from dataclasses import replace

import numpy as np

from das.advice.regimes import Regime
from das.domain.vehicle import Resistance
from precompute.vehicle_import.train import ImportedTrain, Mode
from docs.examples.weak_drivers import Lazy
from sim.drivers.presentations.presenter import LaneState, Presenter, Shown


class Gentle(Lazy):
    pass


class Lamp(Presenter):
    number = 117
    phrase = "a lamp"
    meaning = "a lamp that is lit while the train may roll"
    lane = LaneState("a lamp", "#123456")

    def show(self, blank, advice, deviation_s):
        return replace(blank, mode=int(advice.mode))

    def read(self, view):
        return Shown(mode=Regime(view.mode))


LAMP = Lamp()


def stand_s(table):
    return float(np.count_nonzero(table["truth_speed_mps"] == 0.0))


def read_train(path):
    words = path.read_text().split()
    return ImportedTrain(
        id="brought", name=words[0], source="a test", mass_kg=float(words[1]), rotating_mass_ratio=0.05, length_m=100.0,
        max_speed_mps=40.0, deceleration_mps2=0.6,
        resistance=Resistance(c0_n=2e3, c1_n_per_mps=30.0, c2_n_per_mps2=5.0),
        modes={"": Mode(traction=((0.0, 2e5), (20.0, 2e5), (40.0, 1e5)))},
    )
"""
DOORS = """[das.drivers]
gentle = brought:Gentle
[das.presentations]
lamp = brought:LAMP
[das.measures]
stand_s = brought:stand_s
[das.importers]
own = brought:read_train
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder into which the wheel is installed; of a wheel of Python alone that is unpacking it."""
    folder = tmp_path_factory.mktemp("site")
    head = "Metadata-Version: 2.1\nName: brought\nVersion: 1.0\n"
    wheel = folder / "brought-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as packed:
        packed.writestr("brought.py", MODULE)
        packed.writestr("brought-1.0.dist-info/METADATA", head)
        packed.writestr("brought-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        packed.writestr("brought-1.0.dist-info/entry_points.txt", DOORS)
        packed.writestr("brought-1.0.dist-info/RECORD", "")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder / "lib")
    return folder / "lib"


def told(site: Path, program: str, *words: str, cwd: Path) -> str:
    paths = os.pathsep.join([str(REPOSITORY), str(site), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-m", program, *words], cwd=cwd, env={**os.environ, "PYTHONPATH": paths},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


DAY = REPOSITORY / "sim" / "experiment" / "studies" / "days" / "flat-6km.toml"


@pytest.mark.slow
def test_a_driver_and_a_presentation_of_another_package_are_named_by_their_words(site: Path, tmp_path: Path) -> None:
    words = ("run", str(DAY), "--in-process", "--driver", "gentle", "--advice", "lamp", "--json")
    found = json.loads(told(site, "sim.cli", *words, cwd=tmp_path))
    assert (found["driver"], found["advice"]) == ("brought:Gentle", "lamp")


@pytest.mark.slow
def test_a_study_that_is_driven_gets_a_measure_of_another_package(site: Path, tmp_path: Path) -> None:
    run = ("experiment", "run", "--scenario", str(DAY), "--seeds", "1", "--recordings", "--workers", "1", "-o", "days")
    told(site, "sim.cli", *run, cwd=tmp_path)
    told(site, "sim.cli", "experiment", "rescore", "days", "-o", "again", cwd=tmp_path)
    before, after = (list(csv.DictReader((tmp_path / name / "trials.csv").open())) for name in ("days", "again"))
    assert float(after[0].pop("stand_s")) > 10
    # What the recording gives as well is the same.
    assert before[0].keys() == after[0].keys()
    anew = [name for name in sorted(FIGURES & before[0].keys()) if before[0][name] or after[0][name]]
    assert [float(before[0][name]) for name in anew] == [float(after[0][name]) for name in anew]
    assert {name for name, x in before[0].items() if x != after[0][name]} <= set(anew)
    assert len(anew) > 15
    design = json.loads((tmp_path / "again" / "design.json").read_text())
    assert design["analysis"]["measures"][-1] == "stand_s"


def test_an_importer_of_another_package_reads_its_files(site: Path, tmp_path: Path) -> None:
    (tmp_path / "train.own").write_text("Brought 80000")
    words = ("vehicle", "import", "train.own", "-o", "train.toml", "--losses", "re460-ic")
    told(site, "precompute.cli", *words, cwd=tmp_path)
    assert 'name = "Brought"' in (tmp_path / "train.toml").read_text()


def test_nothing_is_imported_to_know_what_is_installed(site: Path) -> None:
    code = (
        "import sys; from sim.doors import *; print(installed(MEASURES)['stand_s'].package, sys.modules.get('brought'))"
    )
    paths = os.pathsep.join([str(REPOSITORY), str(site)])
    where = {**os.environ, "PYTHONPATH": paths}
    done = subprocess.run([sys.executable, "-c", code], env=where, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "brought 1.0 None"
    assert "stand_s" not in installed(MEASURES)
