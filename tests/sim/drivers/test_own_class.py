"""A driver of the user's own as a class: the page's example drives, and what is wrong with one is said in one line."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from das.domain.errors import DasError
from sim.drivers.kinds import EXTERNAL, DriverKind, OwnClass, named_driver
from sim.plant.kernels import Command
from sim.plant.plant import checked, force, lever, speed
from tests.support.flat_days import FLAT
from tests.support.making import REPOSITORY, das_sim, das_sim_json, refusal

EXAMPLE = REPOSITORY / "docs" / "examples" / "my_driver.py"
WRONG = """
from sim.plant.plant import lever

class Raises:
    def command(self, cab):
        return lever(1 / 0)

class Leaves:
    def command(self, cab):
        raise SystemExit("enough")

class Says:
    def command(self, cab):
        return "go"

class CannotBeMade:
    def __init__(self, line):
        raise KeyError("nothing here")
    def command(self, cab):
        return lever(0.0)

class AsksForMuch:
    def __init__(self, line, seed, colour):
        pass
    def command(self, cab):
        return lever(0.0)

class Deaf:
    def command(self):
        return lever(0.0)

class Idle:
    pass

def function(cab):
    return lever(0.0)
"""
HUMAN = "sim.drivers.human:HumanDriver"


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    """Modules and folders that a test has made known to Python are forgotten after it."""
    modules, path = set(sys.modules), list(sys.path)
    yield
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        if name in ("my_driver", "wrong", "fails", "halves", "needs"):
            del sys.modules[name]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "flat.toml").write_text(FLAT)
    (tmp_path / "wrong.py").write_text(WRONG)
    (tmp_path / "fails.py").write_text("x = 1\ny = x.nothing\n")
    (tmp_path / "halves.py").write_text("x = (\n")
    (tmp_path / "needs.py").write_text("import nothing_of_this\n")
    (tmp_path / "my_driver.py").write_text(EXAMPLE.read_text(encoding="utf-8"))
    return tmp_path


def driven(folder: Path, driver: str, *more: str) -> dict[str, Any]:
    return das_sim_json("run", "flat.toml", "--driver", driver, "--in-process", *more, cwd=folder)


def test_the_driver_of_the_page_drives(folder: Path) -> None:
    assert len((folder / "my_driver.py").read_text().splitlines()) <= 30
    found = driven(folder, "my_driver:Gentle", "--advice", "four-mode")
    assert found["driver"] == "my_driver:Gentle"
    assert found["over_limit_s"] == 0
    assert abs(found["stops"][-1]["stopping_error_m"]) < 10
    assert abs(found["late_s"]) < 30


@pytest.mark.slow
def test_a_bundled_class_drives_the_same_whoever_names_it(folder: Path) -> None:
    changing = ("driver", "wall_s", "real_time_factor", "energy_own_braking_kwh")  # of the human by name alone
    found = [driven(folder, name, "--seed", "3") for name in (DriverKind.HUMAN, HUMAN)]
    same = [{key: value for key, value in one.items() if key not in changing} for one in found]
    assert same[0] == same[1]


@pytest.mark.parametrize(
    ("driver", "said"),
    [
        ("nobody", "expected one of perfect, literal, fast, top-speed, timetable, human, external, desk, or a class"),
        ("nowhere.at.all:Gentle", "no module nowhere among the installed packages or in {folder}"),
        ("wrong:Missing", "{folder}/wrong.py has no class Missing"),
        ("wrong:function", "function is a function; expected a class with a method command(self, cab)"),
        ("wrong:Idle", "Idle has no method command; expected a class with a method command(self, cab)"),
        ("wrong:Deaf", "command(self): expected a class with a method command(self, cab)"),
        ("wrong:AsksForMuch", "expected to make a AsksForMuch with (line, seed=…), (line), (seed=…) or nothing"),
        ("wrong:CannotBeMade", "{folder}/wrong.py, line 18, raised: KeyError: 'nothing here'"),
        ("wrong:Raises", "{folder}/wrong.py, line 6, raised at -10.0 s: ZeroDivisionError: division by zero"),
        ("wrong:Leaves", "{folder}/wrong.py, line 10, raised at -10.0 s: SystemExit: enough"),
        ("wrong:Says", "at -10.0 s it answered 'go': expected a Command"),
        ("fails:Gentle", "{folder}/fails.py, line 2, raised: AttributeError: 'int' object has no attribute 'nothing'"),
        ("halves:Gentle", "{folder}/halves.py, line 1: '(' was never closed"),
        ("needs:Gentle", "{folder}/needs.py, line 1, raised: ModuleNotFoundError: No module named 'nothing_of_this'"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_class_is_said_in_one_line(folder: Path, driver: str, said: str) -> None:
    done = das_sim("run", "flat.toml", "--driver", driver, "--in-process", cwd=folder)
    assert done.returncode == 2
    (line,) = [one for one in done.stderr.splitlines() if one.startswith("error")]
    assert said.replace("{folder}", str(folder)) in line


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--driver", "external", "--in-process"), "--driver external: a run --in-process has no bus"),
        (("--driver-at", "tcp/127.0.0.1:7450"), "--driver-at tcp/127.0.0.1:7450: needs --driver external"),
    ],
)
def test_options_of_an_external_driver_that_contradict_each_other_are_refused(
    folder: Path, options: tuple[str, ...], said: str
) -> None:
    assert said in refusal("run", "flat.toml", *options, cwd=folder)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (None, "None: expected a Command"),
        (Command(7, 0.0), "law 7: expected one made by lever, force or speed"),
        (force(float("inf")), "the wheel force = inf"),
        (force(0.0, friction_ratio=1.1), "friction_ratio = 1.1: expected 0 to 1"),
        (speed(-1.0), "the speed to hold = -1.0: expected 0 to 200 m/s"),
        (speed(10.0, rate_mps2=float("nan")), "rate_mps2 = nan: expected -10 to 10 m/s²"),
        (speed(10.0, gain_per_s=-1.0), "gain_per_s = -1.0: expected 0 to 100 1/s"),
        (speed(10.0, low_n=float("-inf")), "low_n = -inf"),
        (lever(float("nan")), "the lever's ratio = nan: expected -1 to 1"),
        (lever(1.5), "the lever's ratio = 1.5: expected -1 to 1"),
        (lever("1"), "the lever's ratio = '1'"),  # type: ignore[arg-type]
        (lever(True), "the lever's ratio = True"),
    ],
)
def test_an_answer_that_no_train_understands_is_refused(answer: Any, said: str) -> None:
    with pytest.raises(DasError, match="who: at 3") as raised:
        checked(answer, "who", 3.0)
    assert said in str(raised.value)


def test_names_of_drivers() -> None:
    assert named_driver("--driver", "human") is DriverKind.HUMAN
    assert named_driver("--driver", "external") is EXTERNAL
    assert named_driver("--driver", "a.b_c:D1") == OwnClass(module="a.b_c", name="D1")
    assert str(OwnClass(module="a.b", name="C")) == "a.b:C"
    for text in ("a:b:c", "my driver:C", ":C", "a:", "a.:C", "1a:C", ""):
        with pytest.raises(DasError, match="expected one of perfect"):
            named_driver("--driver", text)


@pytest.mark.nightly
def test_days_take_a_class_and_know_the_hash_of_its_file(folder: Path) -> None:
    asked = ("experiment", "run", "--scenario", "flat.toml", "--seeds", "1", "--advice", "none", "-o", "runs")
    asked = (*asked, "--workers", "1", "--json", "--driver")
    done = das_sim(*asked, "my_driver:Gentle,perfect", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert [group["driver"] for group in json.loads(done.stdout)["groups"]] == ["my_driver:Gentle", "perfect"]
    source = hashlib.sha256((folder / "my_driver.py").read_bytes()).hexdigest()
    files = json.loads((folder / "runs" / "design.json").read_text())["files"]
    assert files["my_driver:Gentle: driver_sha256"] == source
    with (folder / "my_driver.py").open("a") as file:
        file.write("\n# changed\n")
    assert json.loads(das_sim(*asked, "my_driver:Gentle,perfect", cwd=folder).stdout)["made"] == 1
    failed = das_sim(*asked, "wrong:Raises", cwd=folder)
    assert failed.returncode == 1
    (row,) = json.loads(failed.stdout)["failed"]
    assert row["error"].endswith("ZeroDivisionError: division by zero")


def test_days_refuse_a_class_that_is_not_there(folder: Path) -> None:
    days = ("experiment", "run", "--scenario", "flat.toml", "-o", "runs")
    assert "no module gone" in refusal(*days, "--driver", "gone:X", cwd=folder)
