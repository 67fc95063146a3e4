"""A factor is admitted only if it changes what the simulated driver does at the controller."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from sim.experiment.checking import DAYS_TRIED, Sensed, SensingTest, check_design
from sim.experiment.design import Design
from sim.experiment.factors import study_days

Designed = Callable[[str], Design]
TWO = "[participants]\ncount = 2\n"


def sensed(designed: Designed, fixed: str, *factors: str, scenario: str = "flat-6km") -> list[Sensed]:
    tables = "".join(f"[[factors]]\n{one}\n" for one in factors)
    day = f"scenario = '{scenario}'\n" if scenario else ""
    design = designed(f"{TWO}[fixed]\n{day}{fixed}\n{tables}")
    test = SensingTest(design=design, said=lambda _: None, clock=lambda: 0.0)
    return [test.of(factor) for factor in design.factors]


@pytest.mark.slow
def test_what_a_human_driver_goes_by_is_admitted(designed: Designed) -> None:
    found = sensed(
        designed,
        "",
        "name = 'presentation'\nlevels = ['none', 'speed-and-effort']",
        "name = 'update_interval_s'\nlevels = [1, 20]",
        "name = 'hold_s'\nlevels = [0, 20]",
        "name = 'friction'\nlevels = ['as-measured', 'electric-first']",
    )
    assert [one.refusal for one in found] == [None] * 4
    assert all(one.days <= DAYS_TRIED for one in found)


@pytest.mark.slow
def test_a_reason_is_sensed_by_drivers_whom_it_makes_refuse_less(designed: Designed, tmp_path: Path) -> None:
    day = study_days()["flat-6km"].read_text() + "\n[human]\nreason_refusal_ratio = 0\ncomply_coast_ratio = 0.2\n"
    (tmp_path / "day.toml").write_text(day)
    (found,) = sensed(
        designed, "presentation = 'guide'", "name = 'reason'\nlevels = [true, false]", scenario="day.toml"
    )
    assert found.refusal is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "fixed"),
    [
        pytest.param("name = 'reason'\nlevels = [true, false]", "presentation = 'guide'", marks=pytest.mark.nightly),
        ("name = 'hold_s'\nlevels = [0, 20]", "presentation = 'none'"),
        pytest.param(
            "name = 'friction'\nlevels = ['as-measured', 'electric-first']",
            "driver = 'perfect'",
            marks=pytest.mark.nightly,
        ),
    ],
)
def test_what_no_driver_senses_is_refused(designed: Designed, factor: str, fixed: str) -> None:
    (found,) = sensed(designed, fixed, factor)
    name = factor.split("'")[1]
    assert found.refusal is not None
    assert found.refusal.startswith(f"factor {name}: levels ")
    assert "give the same lever trace on 5 of 5 days" in found.refusal


def test_a_check_counts_trials_and_says_how_long_they_take(designed: Designed) -> None:
    factor = "[[factors]]\nname = 'presentation'\nlevels = ['none', 'speed-and-effort']\n"
    procedure = "[procedure]\npractice_trials = 1\nbreak_after = 2\nbreak_s = 100\n"
    design = designed(f"{TWO}[fixed]\nscenario = 'flat-6km'\n{procedure}{factor}")
    ticks = iter(range(100))
    found = check_design(design, clock=lambda: 2.0 * next(ticks))
    assert (found.trials, found.practice, found.conditions, found.participants) == (6, 2, 2, 2)
    assert found.work_s == pytest.approx(6 * 2.0)
    timetable_s = 234.0  # by the timetable of this day, and 10 s before and after
    assert found.person_s == pytest.approx(3 * (timetable_s + 20.0) + 100.0)
    assert found.all_s == pytest.approx(2 * found.person_s)
    assert found.refusals == []
    assert [note[:23] for note in found.notes] == ["the order has no effect"]


@pytest.mark.parametrize("driver", ["human", "perfect"])
def test_a_driver_senses_the_preview(designed: Designed, driver: str) -> None:
    (found,) = sensed(
        designed, f"driver = '{driver}'\npresentation = 'speed-and-effort'", "name = 'preview_s'\nlevels = [0, 'all']"
    )
    assert found == Sensed(factor="preview_s", days=1, alike=())


@pytest.mark.nightly
def test_a_level_that_cannot_be_driven_is_said(designed: Designed, tmp_path: Path) -> None:
    (tmp_path / "stuck.toml").write_text(
        "schema_version = 1\n[scenario]\nid = 'stuck'\ntitle = 'T'\nroute = 'flat-6km'\nvehicle = 're460-ic'\n"
        "[[disturbances]]\nkind = 'signal-stop'\nat_km = 3\nseen_m = 1500\nclears_after_s = 86_400\n"
    )
    (found,) = sensed(designed, "", "name = 'scenario'\nlevels = ['flat-6km', 'stuck.toml']", scenario="")
    assert found.refusal is not None
    assert "levels flat-6km and stuck cannot be compared: the simulated train did not arrive" in found.refusal
