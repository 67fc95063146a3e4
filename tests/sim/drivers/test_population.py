"""Participants: drawn once from a population, as its file says, and the same on all days."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import sim
from das.domain.errors import DasError, InputError
from sim.drivers.kinds import DriverKind
from sim.drivers.parameters import (
    HumanParameters,
    Participant,
    Population,
    Shape,
    Spread,
    load_population,
    read_population,
)
from sim.world.scenario import read_scenario
from sim.world.service import Service, make_day
from tests.das.domain.files.refusing import refused
from tests.support.flat_days import FLAT, service_of
from tests.support.making import das_sim, refusal

HEAD = 'schema_version = 1\n[population]\nid = "few"\ntitle = "Few"\n'
HASTE = '[parameters.haste_ratio]\ndistribution = "logit-normal"\nmedian = 0.4\nlogit_sd = 1.0\nsource = "assumption"\n'
BRAKING = (
    '[parameters.braking_mps2]\ndistribution = "lognormal"\nmedian = 0.5\nlog_sd = 0.2\nlow = 0.3\nsource = "own"\n'
)
SPREAD = BRAKING.replace("low = 0.3\n", "")
TOGETHER = '[[correlations]]\nbetween = ["haste_ratio", "braking_mps2"]\nvalue = 0.6\nsource = "assumption"\n'
LATE = "[[disturbances]]\nkind = 'departure-delay'\nstop = 'A'\ndelay_s = {min = 0, max = 20}\n"
PEOPLE = 1000


DAYS = ("experiment", "run", "--scenario", "flat.toml")


@pytest.fixture(scope="module")
def default() -> Population:
    return load_population("default")


def population_of(folder: Path, text: str) -> Population:
    path = folder / "few.toml"
    path.write_text(HEAD + text)
    return read_population(path)


def straightened(spread: Spread, values: np.ndarray) -> np.ndarray:
    """The values as they are normally distributed: their logarithms or logits."""
    return {Shape.LOGNORMAL: np.log, Shape.LOGIT_NORMAL: lambda x: np.log(x / (1 - x))}[spread.shape](values)


def test_many_participants_have_the_spread_and_the_correlations_of_the_file(default: Population) -> None:
    """Medians within the error of a share of 1000, correlations within four standard errors, (1 − r²)/√n each."""
    people = [default.draw(number) for number in range(PEOPLE)]
    columns = {name: np.array([one[name] for one in people]) for name in people[0]}
    normal = {}
    for spread in default.spreads:
        values = columns[spread.name]
        assert spread.low <= values.min() <= values.max() <= spread.high
        if spread.name in ("glance_mean_s", "braking_mps2"):  # cut off at one end, where few are
            assert np.mean(values < spread.middle) == pytest.approx(0.5, abs=0.04)
        else:
            assert np.mean(values < spread.middle) == pytest.approx(0.5, abs=4 * 0.5 / math.sqrt(PEOPLE))
        normal[spread.name] = straightened(spread, values)
        assert normal[spread.name].std() == pytest.approx(spread.sd, rel=0.08)
    found = np.corrcoef(list(normal.values()))
    wanted = default.triangle @ default.triangle.T
    assert np.abs(found - wanted).max() < 5 / math.sqrt(PEOPLE)
    lapses = columns["lapses_per_h"]
    assert lapses.mean() > 1.2 * np.median(lapses)  # skewed: a few have most of them


def test_every_participant_of_the_default_population_can_be_made(default: Population) -> None:
    """And the median of each parameter is the default of the one driver that there is without a population."""
    for number in range(300):
        HumanParameters(**default.draw(number))  # type: ignore[arg-type]
    one = HumanParameters()
    for spread in default.spreads:
        if spread.name != "lapses_per_h":  # its mean is
            assert spread.middle == pytest.approx(getattr(one, spread.name), rel=0.02), spread.name
    assert all(spread.source for spread in default.spreads)
    assert all(pair.source for pair in default.correlations)


def test_a_number_is_one_person_whatever_else_is_drawn(tmp_path: Path) -> None:
    one = population_of(tmp_path, HASTE)
    more = population_of(tmp_path, HASTE + BRAKING + TOGETHER)
    for number in range(5):
        assert one.draw(number) == one.draw(number)
        assert more.draw(number)["haste_ratio"] == one.draw(number)["haste_ratio"]
    assert one.draw(1) != one.draw(2)


def test_a_fixed_value_and_a_normal_one_cut_off(tmp_path: Path) -> None:
    """The mean of a normal distribution cut off at its mean is √(2/π) standard deviations above it."""
    text = '[parameters.notches]\ndistribution = "fixed"\nvalue = 8\nsource = "a"\n'
    text += '[parameters.glance_mean_s]\ndistribution = "normal"\nmean = 5.0\nsd = 1.0\nlow = 5.0\nsource = "a"\n'
    found = population_of(tmp_path, text)
    people = [found.draw(number) for number in range(2000)]
    assert {one["notches"] for one in people} == {8}
    assert np.mean([one["glance_mean_s"] for one in people]) == pytest.approx(5.0 + math.sqrt(2 / math.pi), abs=0.06)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "parameters is missing: expected a table"),
        (HASTE.replace("haste_ratio", "haste"), "parameters.haste = "),
        (HASTE.replace("logit-normal", "uniform"), "distribution = 'uniform': expected one of fixed, normal"),
        (HASTE.replace("median = 0.4", "median = 1.4"), "parameters.haste_ratio.median = 1.4: expected 0 to 1"),
        (HASTE.replace("median = 0.4", "median = 1.0"), "expected a ratio between 0 and 1"),
        (HASTE.replace("logit_sd = 1.0", "logit_sd = -1.0"), "logit_sd = -1.0: expected 0 to 1000"),
        (HASTE.replace("logit_sd", "log_sd"), "parameters.haste_ratio.log_sd = 1.0"),
        (HASTE.replace('source = "assumption"', ""), "parameters.haste_ratio.source is missing: expected a string"),
        (BRAKING.replace("low = 0.3", "low = 0.01"), "parameters.braking_mps2.low = 0.01: expected 0.1 to 1.5"),
        (SPREAD.replace("braking_mps2", "glance_least_s").replace("= 0.5", "= 0.0"), "more than 0"),
        (SPREAD.replace("braking_mps2", "notches"), "expected fixed, with a whole number"),
        (HASTE + TOGETHER, "correlations[0].between = ['haste_ratio', 'braking_mps2']: expected two of the parameters"),
        (HASTE + BRAKING + TOGETHER + TOGETHER, "['haste_ratio', 'braking_mps2']: expected each pair once"),
        (HASTE + BRAKING + TOGETHER.replace("0.6", "1.6"), "correlations[0].value = 1.6: expected -1 to 1"),
        (HASTE + BRAKING + TOGETHER.replace("0.6", "1.0"), "they contradict each other (least eigenvalue"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_meant_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    refused(lambda _: population_of(tmp_path, text), tmp_path / "few.toml", f".*{re.escape(said)}")


@pytest.fixture(scope="module")
def service(flat: Callable[[str], Path]) -> Service:
    return service_of(flat("[human]\nnotches = 8\n" + LATE))


def test_a_participant_is_the_same_on_every_day_and_changes_no_day(service: Service, default: Population) -> None:
    who = Participant(population=default, number=4)
    days = [make_day(service, seed, who) for seed in (1, 2)]
    assert days[0].human == days[1].human != make_day(service, 1, Participant(population=default, number=5)).human
    assert days[0].human.notches == 8  # what the scenario says comes first
    assert days[0].drawn["human"]["participant"] == 4
    assert days[0].drawn["population"]["id"] == "default"
    for day in days:
        alone = make_day(service, day.seed)
        assert alone.disturbances == day.disturbances
        assert (alone.stream, day.stream) == (0, 5)
        assert "population" not in alone.drawn
    assert days[0].disturbances != days[1].disturbances


def test_a_range_in_the_scenario_is_refused_with_a_participant(
    flat: Callable[[str], Path], default: Population
) -> None:
    path = flat("[human]\nbraking_mps2 = {min = 0.4, max = 0.6}\n")
    human = read_scenario(path).human
    with pytest.raises(DasError, match=r"human\.braking_mps2 is a range: expected one value"):
        human.of(0, Participant(population=default, number=1), path)


def test_values_that_contradict_each_other_name_the_participant(flat: Callable[[str], Path], tmp_path: Path) -> None:
    text = '[parameters.glance_mean_s]\ndistribution = "fixed"\nvalue = 0.5\nsource = "a"\n'
    found, path = population_of(tmp_path, text), flat("")
    with pytest.raises(DasError, match=r"few.toml: participant 3: .*glance_mean_s = 0.5: expected at least"):
        read_scenario(path).human.of(0, Participant(population=found, number=3), path)


@pytest.mark.nightly
def test_runs_of_a_participant_are_paired(tmp_path: Path) -> None:
    (tmp_path / "flat.toml").write_text(FLAT)
    asked = ("run", "flat.toml", "--in-process", "--json", "--advice", "none")
    energies = {}
    for options in (("--participant", "1"), ("--participant", "1", "--seed", "1"), ("--participant", "2"), ()):
        done = das_sim(*asked, *options, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        found = json.loads(done.stdout)
        energies[options] = found["energy_kwh"]
        person = {name: x for name, x in found["drawn"]["human"].items() if name != "participant"}
        number = int(options[1]) if options else None
        assert person == ({} if number is None else load_population("default").draw(number))
    assert len(set(energies.values())) == 4
    day = sim.run_day(tmp_path / "flat.toml", participant=2, advice="none")
    assert day.outcome["energy_kwh"] == energies["--participant", "2"]
    with pytest.raises(InputError, match="participant = -1: expected a whole number >= 0"):
        sim.run_day(tmp_path / "flat.toml", participant=-1)
    again = json.loads(das_sim(*asked, "--participant", "1", cwd=tmp_path).stdout)
    assert again["energy_kwh"] == energies["--participant", "1"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("run", "flat.toml", "--participant", "1", "--driver", "perfect"), "needs --driver human"),
        (("run", "flat.toml", "--population", "default"), "--population default: needs --participant"),
        (("run", "flat.toml", "--participant", "1", "--population", "gone.toml"), "gone.toml: no such file"),
        (("run", "flat.toml", "--participant", "1", "--population", "gone"), "not a bundled population (default)"),
        ((*DAYS, "-o", "o", "--population", "default"), "needs --participants"),
        ((*DAYS, "-o", "o", "--participants", "x"), "--participants x: cannot read 'x'"),
        ((*DAYS, "-o", "o", "--participants", "1", "--driver", "top-speed"), "needs --driver human"),
    ],
)  # fmt: skip
def test_options_that_cannot_be_meant_are_refused_in_one_line(
    tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    (tmp_path / "flat.toml").write_text(FLAT)
    assert said in refusal(*options, cwd=tmp_path)


@pytest.mark.nightly
def test_every_participant_drives_every_day_and_a_perfect_driver_each_once(tmp_path: Path) -> None:
    (tmp_path / "flat.toml").write_text(FLAT)
    asked = (*DAYS, "--seeds", "1,2", "--driver", "human,perfect", "--advice", "none", "-o", "runs", "--workers", "1")
    done = das_sim(*asked, "--participants", "3-4", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["made"] == 6
    with (tmp_path / "runs" / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["participant"], row["driver"], row["seed"]) for row in rows} == {
        (who, driver, seed) for who in ("sub-01", "sub-02") for driver in ("human", "perfect") for seed in "12"
    }
    assert das_sim(*asked, "--participants", "3-5", "--json", cwd=tmp_path).stdout.count('"made": 2')


def test_a_driver_without_a_population_is_who_he_was(service: Service) -> None:
    """The default of a run: the parameters of the scenario alone, and the first streams of chance of the seed."""
    day = make_day(service, 3)
    assert day.human == HumanParameters(notches=8)
    assert day.driver(DriverKind.HUMAN) is not day.driver(DriverKind.HUMAN)
    assert day.stream == 0
