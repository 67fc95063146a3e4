"""A population is fitted to what people did: planted parameters are found in their intervals, or named as untold."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from das.advice.regimes import Regime
from das.domain.errors import DasError
from precompute.workers import Workers
from sim.drivers.cab import AdviceView
from sim.drivers.kinds import Presentation
from sim.drivers.parameters import HumanParameters, Shape, load_population, read_population
from sim.experiment.design import Design, freeze, read_design
from sim.experiment.driving import Driven, drive
from sim.experiment.people.fitting import (
    LEAST_DRIVERS,
    TRIED,
    FittedParameter,
    FittedPopulation,
    ParameterFigures,
    Person,
    drive_observed,
    fit,
    fitted,
    line_of,
    population_text,
    recorded,
)
from sim.experiment.people.observing import Seconds, _answers, notches_of, observed, statistics
from sim.experiment.trials import trials_of
from tests.support.flat_days import FLAT
from tests.support.making import das_sim_json, refusal

DESIGN = """
schema_version = 1
experiment = {name = "fitting", title = "Fitting", seed = 4}
participants = {count = 8, population = "planted.toml"}
procedure = {repetitions = 2, days = "common"}
fixed = {scenario = "flat-6km"}
factors = [{name = "presentation", levels = ["none", "guide"]}]
"""
PLANTED = {"reaction_median_s": 3.2, "braking_mps2": 0.38, "lever_least_ratio": 0.06, "dead_band_mps": 0.9}
REDUCED = Regime.REDUCED_BRAKE
USUAL = np.array([one.usual for one in TRIED])


def designed(folder: Path) -> Design:
    entries = [
        f'[parameters.{name}]\ndistribution = "lognormal"\nmedian = {value}\nlog_sd = 0.2\nsource = "planted"\n'
        for name, value in PLANTED.items()
    ]
    head = 'schema_version = 1\n[population]\nid = "planted"\ntitle = "Planted"\n'
    (folder / "planted.toml").write_text(head + "".join(entries))
    (folder / "design.toml").write_text(DESIGN)
    return read_design(folder / "design.toml")


def made_up(places: np.ndarray, rng: np.random.Generator, noise: float = 0.4) -> dict[str, float]:
    """The statistics of a made-up driver: each follows its parameter, three others too, and one none at all."""
    values = 3.0 * places
    values[2] += 1.5 * places[0]
    values[5] += places[10]
    values[11] -= 2.0 * places[10]
    values[3] = 0.0
    return {one.statistic: float(v) for one, v in zip(TRIED, values + noise * rng.normal(size=len(TRIED)), strict=True)}


def guessed(seed: int, people: int) -> Iterator[tuple[str, ParameterFigures | None, str, float]]:
    """The parameters fitted to made-up people: name, figures, the reason if there are none, and the true mean."""
    rng = np.random.default_rng(seed)
    places, true = rng.random((80, len(TRIED))), 0.2 + 0.6 * rng.random(len(TRIED))
    own = np.clip(true + 0.1 * rng.normal(size=(people, len(TRIED))), 0.0, 1.0)
    found = fitted([made_up(one, rng) for one in own], [made_up(one, rng) for one in places], places)
    for one, tried, at in zip(found, TRIED, true, strict=True):
        yield one.name, one.figures, one.why, tried.value(at)


@pytest.mark.parametrize("people", [6, 12])
def test_planted_parameters_are_within_their_intervals(people: int) -> None:
    """With 95 % intervals at most 8 % of 200 may be missed; what nothing depends on is never told."""
    of_all = [one for seed in range(25) for one in guessed(seed, people)]
    told = [(figures, true) for _, figures, _, true in of_all if figures is not None]
    assert len(told) > 0.4 * len(of_all)
    assert np.mean([one.low <= true <= one.high for one, true in told]) > 0.92
    nothing = {why for name, figures, why, _ in of_all if name == "comply_traction_ratio" and figures is None}
    assert nothing == {"no statistic of these trials follows it"}


def of_braking(people: int, seeds: int) -> list[ParameterFigures]:
    found = [one for seed in range(seeds) for one in guessed(seed, people)]
    return [figures for name, figures, _, _ in found if name == "braking_mps2" and figures is not None]


def test_more_people_give_narrower_intervals() -> None:
    widths = {}
    for people in (6, 48):
        widths[people] = np.mean([math.log(one.high / one.low) for one in of_braking(people, 10)])
    assert widths[48] < 0.6 * widths[6]


def test_the_spread_between_people_is_found() -> None:
    """A standard deviation of 0.1 of the range, of the logarithm of 0.25 to 0.9."""
    assert np.mean([one.sd for one in of_braking(40, 20)]) == pytest.approx(0.1 * math.log(0.9 / 0.25), rel=0.5)


def test_a_place_outside_the_range_tried_is_not_stated() -> None:
    rng = np.random.default_rng(1)
    places = rng.random((80, len(TRIED)))
    far = USUAL.copy()
    far[10] = 1.6
    people = [made_up(far, rng) for _ in range(12)]
    found = {one.name: one for one in fitted(people, [made_up(one, rng) for one in places], places)}
    assert found["braking_mps2"].why == "outside the range tried, 0.25 to 0.9"
    assert found["braking_mps2"].figures is None


def test_a_line_needs_enough_drivers_and_people_need_moments() -> None:
    rng = np.random.default_rng(2)
    places = rng.random((80, len(TRIED)))
    values = 3.0 * places[:, 0]
    values[LEAST_DRIVERS - 1 :] = np.nan
    assert line_of(0, values, places) == "the trials have too few such moments"
    drivers = [made_up(one, rng) for one in places]
    people = [{name: value for name, value in made_up(USUAL, rng).items() if name != "stop"} for _ in range(6)]
    found = {one.name: one.why for one in fitted(people, drivers, places)}
    assert found["stop_error_m"] == "too few people have such moments"
    assert found["braking_mps2"] == ""


@pytest.mark.parametrize("tried", TRIED, ids=lambda one: one.name)
def test_a_place_is_a_value_and_the_default_is_inside_the_range(tried: object) -> None:
    assert isinstance(tried, type(TRIED[0]))
    assert (tried.value(0.0), tried.value(1.0)) == pytest.approx((tried.low, tried.high))
    assert tried.value(tried.usual) == pytest.approx(getattr(HumanParameters(), tried.name))
    assert 0.0 < tried.usual < 1.0


def test_the_file_is_a_population_with_the_defaults_of_what_is_not_fitted(tmp_path: Path) -> None:
    fitted_ones = {
        "reaction_median_s": ParameterFigures(value=3.0, low=2.5, high=3.6, sd=0.3),
        "comply_coast_ratio": ParameterFigures(value=0.7, low=0.6, high=0.8, sd=1.0),
        "glance_mean_s": ParameterFigures(value=2.0, low=1.6, high=2.5, sd=0.8),
        "braking_mps2": ParameterFigures(value=0.4, low=0.3, high=0.5, sd=0.0),
    }
    parameters = tuple(
        FittedParameter(name=one.name, figures=(has := fitted_ones.get(one.name)), why="" if has else "nothing")
        for one in TRIED
    )
    found = FittedPopulation(study="s", people=8, drives=32, drivers=80, notches=10, parameters=parameters)
    path = tmp_path / "fitted.toml"
    path.write_text(population_text(found, "fitted"), encoding="utf-8")
    population = read_population(path)
    read = {one.name: one for one in population.spreads}
    usual = {one.name: one for one in load_population("default").spreads}
    assert (read["reaction_median_s"].middle, read["reaction_median_s"].sd) == (3.0, 0.3)
    assert "fitted to 8 people, 32 drives of s: 3, 95 % interval 2.5 to 3.6" in read["reaction_median_s"].source
    assert (read["braking_mps2"].middle, read["braking_mps2"].sd) == (0.4, usual["braking_mps2"].sd)
    assert read["braking_mps2"].source.endswith("a spread between people is not told, default")
    assert (read["notches"].middle, read["notches"].shape) == (10, Shape.FIXED)
    shares = [population.draw(number)["comply_coast_ratio"] for number in range(400)]
    assert np.mean(shares) == pytest.approx(0.7, abs=0.03)
    for number in range(200):
        HumanParameters(**population.draw(number))  # type: ignore[arg-type]
    for name in {*usual} - {*fitted_ones}:
        assert (read[name].middle, read[name].sd) == pytest.approx((usual[name].middle, usual[name].sd))
        assert (read[name].low, read[name].high) == (usual[name].low, usual[name].high)
        assert read[name].source.startswith("not fitted")
    assert read["reaction_log_sd"].middle == HumanParameters().reaction_log_sd


@cache
def guided() -> Driven:
    """A guided trial with its table."""
    with TemporaryDirectory() as place:
        trials = [one for one in trials_of(designed(Path(place))) if one.condition == "guide"]
    return drive(trials[0], "default", keep=True)


def test_a_drive_shows_the_reaction_and_the_stopping_error() -> None:
    """The recording alone gives what the driver drew and where the train stands."""
    driven = guided()
    assert driven.table is not None
    found = observed(driven.table)
    reaction_s = next(one.value for one in driven.run.decisions if one.what == "reaction")
    assert math.exp(found["departure"][0]) == pytest.approx(reaction_s, abs=0.25)
    assert found["stop"] == pytest.approx([driven.run.calls[-1].stopping_error_m], abs=0.05)
    assert 0.1 < math.exp(found["deceleration"][0]) < 1.0
    assert notches_of([found]) == 0


def seconds(mode: Regime, lever: list[float], **shown: float) -> Seconds:
    """A moving train at 20 m/s under one instruction."""
    view = AdviceView(time_s=0.0, valid_until_s=1e9, presentation=Presentation.FOUR_MODE, mode=int(mode), **shown)  # type: ignore[arg-type]
    count = len(lever)
    same = np.full(count, 20.0)
    return Seconds(
        s_m=20.0 * np.arange(count, dtype=np.float64), speed_mps=same, limit_mps=same + 20.0, lever=np.array(lever),
        cleared=np.ones(count, dtype=bool), shown=[view] * count,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("drive", "said"),
    [
        (seconds(Regime.COAST, [0.5] * 4 + [0.0] * 26), {"answer": [math.log(3.5)], "coast": [1.0]}),
        (seconds(Regime.COAST, [0.5] * 30), {"coast": [0.0]}),
        (seconds(Regime.COAST, [0.5] * 4 + [-0.3] * 26), {"coast": [1.0]}),  # brakes for a stop, but pulls no more
        (seconds(Regime.COAST, [0.0] * 8), {}),
        (seconds(Regime.CRUISE, [0.2] * 12), {}),
        (seconds(Regime.CRUISE, [0.2] * 16, speed_mps=19.0), {"hold": [1.0] * 6}),
        (seconds(REDUCED, [0.0] * 2 + [-0.4] * 18, lever_ratio=-0.35), {"answer": [math.log(1.5)], "brake": [1.0]}),
        (seconds(REDUCED, [0.0] * 2 + [-0.8] * 18, lever_ratio=-0.35), {"answer": [math.log(1.5)], "brake": [0.0]}),
    ],
)  # fmt: skip
def test_what_follows_on_advice(drive: Seconds, said: dict[str, list[float]]) -> None:
    found: dict[str, list[float]] = {}
    for name, value in _answers(drive):
        found.setdefault(name, []).append(value)
    assert found == {name: pytest.approx(values) for name, values in said.items()}


def test_statistics_pool_all_drives_of_a_driver() -> None:
    found = statistics([{"departure": [0.0], "stop": [3.0]}, {"departure": [1.0, 2.0], "stop": [4.0], "step": [1.0]}])
    assert found["departure"] == 1.0
    assert found["stop"] == pytest.approx(math.log(math.sqrt(12.5)))
    assert found["departure spread"] == 0.0
    assert "coast" not in found


def test_a_notched_controller_is_told_by_its_settings() -> None:
    rng = np.random.default_rng(3)
    assert notches_of([{"rest": (rng.integers(-10, 11, 60) / 10.0).tolist()}]) == 10
    assert notches_of([{"rest": rng.uniform(-1.0, 1.0, 60).tolist()}]) == 0
    assert notches_of([{}]) == 0


def test_a_study_without_recordings_and_unknown_people_are_refused(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    design = designed(tmp_path)
    freeze(design, tmp_path / "study")
    rows = [f"{one.number},{one.participant}\n" for one in trials_of(design)[:24]]
    (tmp_path / "study" / "trials.csv").write_text("trial,participant\n" + "".join(rows))
    own = tmp_path / "design.toml"
    with pytest.raises(DasError, match="only recorded people can be fitted"):
        recorded(tmp_path / "study", own, [])
    with pytest.raises(DasError, match="no finished trials of P08, expected at least one"):
        recorded(tmp_path / "study", own, ["P01", "P08"])
    with pytest.raises(DasError, match="finished trials of 1 people, expected those of at least 6"):
        recorded(tmp_path / "study", own, ["P01"])
    words = ["experiment", "fit", "study", "-o", "p.toml"]
    assert "; --design names the design's own file" in refusal(*words, cwd=tmp_path)
    assert "expected P1 to P99999, a pseudonym" in refusal(
        *words, "--design", "design.toml", "--participant", "7", cwd=tmp_path
    )
    (tmp_path / "study" / "trials.csv").write_text("trial\nx\n")
    assert "trials.csv: expected the number of a trial in each row" in refusal(
        *words, "--design", "design.toml", cwd=tmp_path
    )
    own.write_text(DESIGN.replace("seed = 4", "seed = 5"))
    assert "holds the frozen design" in refusal(*words, "--design", "design.toml", cwd=tmp_path)
    (tmp_path / "p.toml").write_text("mine")
    assert "exists already; --overwrite" in refusal(*words, cwd=tmp_path)
    assert (tmp_path / "p.toml").read_text() == "mine"


@pytest.mark.nightly
def test_planted_drivers_are_found_again(tmp_path: Path) -> None:
    """Eight simulated people who react late and brake gently."""
    design = designed(tmp_path)
    people = []
    for who in range(1, 9):
        mine = [one for one in trials_of(design) if one.who == who]
        driven = [observed(table) for one in mine if (table := drive(one, design.people.population, keep=True).table)]
        people.append(Person(mine, driven))
    found = {one.name: one for one in fit(people, "planted", 80, Workers.asked(1, None)).parameters}
    draws = [load_population(design.people.population).draw(design.people.first + who) for who in range(8)]
    told = {name: one.figures for name, one in found.items() if one.figures is not None}
    for name in ("reaction_median_s", "braking_mps2"):
        true = math.exp(np.mean([math.log(one[name]) for one in draws]))
        assert told[name].low < true < told[name].high
    usual = HumanParameters()
    missed = [name for name in {*told} - {*PLANTED} if not told[name].low < getattr(usual, name) < told[name].high]
    assert len(missed) <= 1


@pytest.mark.nightly
def test_a_recorded_study_is_fitted_and_driven_again(tmp_path: Path) -> None:
    """From recordings over the bus, which give samples as drives in this process do, to a participant of the fit."""
    text = DESIGN.replace("count = 8", "count = 6").replace("repetitions = 2", "repetitions = 1")
    (tmp_path / "d.toml").write_text(text.replace('"planted.toml"', '"default"'))
    das_sim_json("experiment", "run", "d.toml", "-o", "study", "--recordings", "--workers", "1", cwd=tmp_path)
    people = recorded(tmp_path / "study", None, [])
    assert [[trial.who for trial in one.trials] for one in people] == [[who, who] for who in range(1, 7)]
    assert [*people[1].drives] == [drive_observed(one) for one in people[1].trials]
    said = das_sim_json(
        "experiment", "fit", "study", "-o", "p.toml", "--drivers", "40", "--workers", "1", cwd=tmp_path
    )  # fmt: skip
    assert (said["people"], said["drives"]) == (6, 12)
    (tmp_path / "flat.toml").write_text(FLAT)
    run = ("run", "flat.toml", "--in-process", "--advice", "none", "--participant", "3", "--population", "p.toml")
    person = das_sim_json(*run, cwd=tmp_path)["drawn"]["human"]
    drawn = load_population(str(tmp_path / "p.toml")).draw(3)
    assert {name: person[name] for name in drawn} == pytest.approx(drawn)
