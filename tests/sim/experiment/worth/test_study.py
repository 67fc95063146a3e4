"""Worth designs: what is read, what is refused with which words, and which cases are driven."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sim.experiment.design import Design
from sim.experiment.trials import trials_of
from sim.experiment.worth.study import BUFFER, INPUTS, bundled_designs, ends_of, load_worth
from tests.das.domain.files.refusing import refused_with
from tests.sim.experiment.worth.support import DESIGN
from tests.support.making import refusal


def settings(design: Design) -> dict[str, dict[str, str]]:
    """The texts of each case's settings."""
    (factor,) = design.factors
    return {one.text: {name: level.text for name, level in one.settings.items()} for one in factor.levels}


def test_every_bundled_design_is_read_and_each_input_has_a_source_and_a_range() -> None:
    assert set(bundled_designs()) == {"intercity", "suburban", "freight"}
    for name in bundled_designs():
        worth = load_worth(name)
        assert worth.study.name == name
        assert set(worth.inputs) == set(INPUTS)
        for one in worth.inputs.values():
            assert one.low <= one.value <= one.high
            assert one.low < one.high
            assert len(one.source) > 9


def test_cases_differ_in_one_input_and_only_driven_inputs_have_any(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(DESIGN)
    worth = load_worth(str(tmp_path / "short.toml"))
    assert ends_of(worth.inputs) == {
        "receptivity_ratio": {},
        "haste_ratio": {},
        "electric_brake_ratio": {"electric_brake_ratio-high": 1.0},
    }
    found = settings(worth.study)
    assert list(found) == [
        *("all-out", "obedient", "today", "today-guided", "in-time", "in-time-guided"),
        *("electric_brake_ratio-high", "electric_brake_ratio-high-guided"),
    ]
    today = {
        "driver": "human",
        "presentation": "none",
        "human_haste_ratio": "0.5",
        "human_friction_ratio": "0.4",
        "receptivity_ratio": "1",
    }
    assert found["today"] == today
    assert found["today-guided"] == today | {"presentation": "guide"}
    assert found["in-time"] == today | {"human_haste_ratio": "0", "human_friction_ratio": "0"}
    assert found["electric_brake_ratio-high"] == today | {"human_friction_ratio": "0"}
    assert (found["all-out"]["driver"], found["obedient"]["driver"]) == ("fast", "perfect")


def test_all_cases_of_a_driver_have_one_run_and_one_stream_of_chances(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(DESIGN)
    trials = trials_of(load_worth(str(tmp_path / "short.toml")).study)
    assert len(trials) == 4 * 8
    assert len({(one.person, one.seed, one.stream) for one in trials}) == len({one.person for one in trials}) == 4


def test_a_buffer_is_driven_from_low_to_high_unless_the_scenario_states_its_times(tmp_path: Path) -> None:
    found = settings(load_worth("freight").study)
    assert {case: found[case][BUFFER] for case in ("today", "buffer_percent-low", "buffer_percent-high-guided")} == {
        "today": "12",
        "buffer_percent-low": "8",
        "buffer_percent-high-guided": "20",
    }
    (tmp_path / "short.toml").write_text(DESIGN)
    timed = load_worth(str(tmp_path / "short.toml"))
    assert BUFFER not in timed.inputs
    assert BUFFER not in settings(timed.study)["today"]


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        (
            "value = 10, low = 10, high = 12",
            "low = 10, high = 12",
            "inputs.trains_per_day.value is missing",
        ),
        ("value = 10,", "value = 0,", "inputs.trains_per_day.value = 0.0: expected a number from 0.001 to 100000"),
        ("low = 10, high", "high", "inputs.trains_per_day.low is missing: expected a number"),
        ('high = 12, source = "made up"', "high = 12", "inputs.trains_per_day.source is missing"),
        (
            "low = 0.1, high = 0.3",
            "low = 0.3, high = 0.3",
            "inputs.price_eur_per_kwh.low = 0.3: expected a number from 0.001 to 0.2 EUR/kWh",
        ),
        (
            "low = 0.5, high = 1.0",
            "low = 0.5, high = 80",
            "followers_ratio.high = 80.0: expected a number from 0.8 to 1",
        ),
        ("days_per_year", "days_a_year", "inputs.days_a_year = {'value': 300"),
        ("price_eur_per_kwh", "price_eur_per_mwh", "inputs.price_eur_per_mwh"),
        ("haste_ratio", "buffer_percent", "states its times"),
        ('name = "short"', 'name = "Our fleet"', "worth.name = 'Our fleet': expected 1 to 64 small letters"),
        ("drivers = 4", "drivers = 2", "worth.drivers = 2: expected a whole number from 3 to 10000"),
        ('scenario = "flat-6km"', "", "worth.scenario is missing"),
        ('scenario = "flat-6km"', 'scenario = "no.toml"', "worth.scenario: "),
        ("drivers = 4", "currency = 'CHF'", "worth.currency = 'CHF': expected one of the keys"),
        ("[inputs]", "[input]", "input = {"),
        ("value = 100,", "value = '100',", "inputs.co2_g_per_kwh.value = '100': expected a number"),
    ],
)
def test_what_is_wrong_in_a_design_is_one_line(tmp_path: Path, was: str, now: str, said: str) -> None:
    change = (was, now, f".*{re.escape(said)}")
    refused_with(lambda path: load_worth(str(path)), tmp_path / "short.toml", DESIGN, change)


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (("intercyti",), "intercyti: not a bundled worth design (freight, intercity, suburban) and not a .toml file"),
        (("intercity", "--workers", "2", "--scheduler", "tcp://a:1"), "give either --workers or --scheduler"),
    ],
)
def test_what_is_wrong_on_the_command_line_is_one_line(tmp_path: Path, args: tuple[str, ...], said: str) -> None:
    assert said in refusal("worth", *args, cwd=tmp_path)
    assert not list(tmp_path.iterdir())
