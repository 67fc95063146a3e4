"""A scenario that is written for a line of the user's own can be driven as it stands."""

from __future__ import annotations

import shlex
import shutil
import tomllib
from pathlib import Path

import pytest

from das.domain.errors import DasError
from sim.cli.example import OwnScenario, example
from sim.world.disturbances import DepartureDelay
from sim.world.scenario import load_scenario
from sim.world.service import lay_out
from tests.support.making import REPOSITORY, das_sim

FILES = REPOSITORY / "sim" / "bundled" / "example_files"


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with a line, a train and a journey, beside which the scenario is written."""
    for name in ("route", "vehicle", "journey"):
        shutil.copy(FILES / f"{name}.toml", tmp_path)
    return tmp_path


def made(folder: Path, *args: str) -> Path:
    out = folder / "days" / "my day.toml"
    out.parent.mkdir()
    done = das_sim("example", str(out), *args, cwd=folder)
    assert done.returncode == 0
    assert done.stdout.endswith(f"das-sim run {shlex.quote(str(out))}\n")
    return out


@pytest.mark.parametrize("journey", [[], ["--journey", "journey.toml"]])
def test_it_names_its_files_from_its_own_folder(own: Path, journey: list[str]) -> None:
    out = made(own, "--route", "route.toml", "--vehicle", "vehicle.toml", *journey)
    scenario = load_scenario(str(out))
    assert scenario.id == "my-day"
    route, _, stops = lay_out(scenario)
    assert (stops[0], stops[-1]) == (route.stops[0], route.stops[-1])
    assert (scenario.journey is None) is (not journey)


def test_bundled_names_stay_and_the_direction_is_kept(own: Path) -> None:
    scenario = load_scenario(str(made(own, "--route", "zurich-luzern", "--vehicle", "re460-ic", "--reverse")))
    assert (scenario.route, scenario.vehicle, scenario.reverse) == ("zurich-luzern", "re460-ic", True)
    assert lay_out(scenario)[2][0].name == "Luzern"


def test_what_it_proposes_may_happen_can_happen(own: Path) -> None:
    out = made(own, "--route", "route.toml", "--vehicle", "vehicle.toml")
    text, proposed = out.read_text().split("# What may happen, a table for each:\n")
    out.write_text(text + proposed.replace("# ", ""))
    assert tomllib.loads(out.read_text())["disturbances"]
    (late,) = load_scenario(str(out)).day(1)
    assert isinstance(late, DepartureDelay)
    assert 20.0 <= late.delay_s <= 60.0


def test_files_that_do_not_fit_write_nothing(own: Path) -> None:
    (own / "journey.toml").write_text((own / "journey.toml").read_text().replace("Bedorf", "Nowhere"))
    args = ("--route", "route.toml", "--vehicle", "vehicle.toml", "--journey", "journey.toml")
    done = das_sim("example", "day.toml", *args, cwd=own)
    assert done.returncode == 2
    assert "Nowhere" in done.stderr
    assert not (own / "day.toml").exists()


@pytest.mark.parametrize(
    ("out", "said"),
    [
        ("day.txt", "day.txt: expected a file name that ends in .toml"),
        ("day", "day: expected a file name that ends in .toml"),
        *(
            (f"{name}.toml", f"{name}.toml: the output file is also an input")
            for name in ("route", "vehicle", "journey")
        ),
    ],
)
def test_it_writes_a_toml_file_and_never_over_what_it_reads(
    own: Path, out: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without this check --overwrite would put the scenario in the place of the line."""
    monkeypatch.chdir(own)
    before = {path.name: path.read_bytes() for path in own.iterdir()}
    with pytest.raises(DasError) as refused:
        example(Path(out), OwnScenario(route="route.toml", vehicle="vehicle.toml", journey="journey.toml"), True)
    assert str(refused.value) == said
    assert {path.name: path.read_bytes() for path in own.iterdir()} == before


def test_the_timetable_is_the_one_asked_for(own: Path) -> None:
    ends = ("--from", "Bedorf", "--to", "Cedorf", "--buffer", "12.5", "--dwell", "30")
    out = made(own, "--route", "route.toml", "--vehicle", "vehicle.toml", *ends, "--departure", "2027-01-02T03:04:00Z")
    scenario = load_scenario(str(out))
    assert (scenario.from_stop, scenario.to_stop) == ("Bedorf", "Cedorf")
    assert (scenario.buffer_ratio, scenario.dwell_s) == (0.125, 30.0)
    assert "2027-01-02T03:04:00Z" in out.read_text()


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["--route", "route.toml"], "a scenario needs --route and --vehicle"),
        (["--buffer", "5"], "--buffer 5.0: needs --route and --vehicle"),
        (
            ["--route", "route.toml", "--vehicle", "vehicle.toml", "--journey", "journey.toml", "--dwell", "5"],
            "--dwell 5",
        ),
        (["--route", "route.toml", "--vehicle", "vehicle.toml", "--departure", "soon"], "departure = 'soon'"),
    ],
)
def test_options_that_do_not_go_together_write_nothing(own: Path, args: list[str], said: str) -> None:
    done = das_sim("example", "day.toml", *args, cwd=own)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr
    assert not (own / "day.toml").exists()
