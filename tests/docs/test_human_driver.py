"""The tables of the default human driver: what is compared with what, and that the columns are those of a batch."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.studies import human_driver
from docs.studies.human_driver import DAYS, presentations_table, runs, worth_table
from sim.drivers.kinds import FrictionPolicy, Presentation
from tests.support.flat_days import FLAT

NONE, COACH = Presentation.NONE, Presentation.COACH


def row(energy_kwh: float, optimum_kwh: float) -> dict[str, float]:
    return {
        "energy_kwh": energy_kwh, "energy_optimum_kwh": optimum_kwh, "energy_blending_kwh": 0.4 * energy_kwh,
        "energy_profile_kwh": 7.0, "friction_brake_ratio": 0.141, "late_s": 3.0, "advice_changes_per_min": 1.9,
    }  # fmt: skip


ALONE = {0: row(200.0, 120.0), 1: row(200.0, 120.0)}
ADVISED = {1: row(190.0, 116.0), 0: row(180.0, 116.0)}
"""On two days the coach takes 20 and 10 kWh less; the later arrival is worth 4 of them."""


def test_a_presentation_is_compared_on_the_same_days() -> None:
    none, coach = list(presentations_table({NONE: ALONE, COACH: ADVISED}))[2:]
    assert none == "| none | +3 | 200.0 |  |  |  |  | 80.0 | 7.0 | 14.1 % |  |"
    assert coach == "| coach | +3 | 185.0 | +15.0 | 4.0 | 11.0 | 6.0 | 74.0 | 7.0 | 14.1 % | 1.9 |"


def test_what_the_coach_is_worth_is_said_in_four_ways() -> None:
    both = {NONE: ALONE, COACH: ADVISED}
    lines = list(worth_table({(day, friction): both for day in DAYS for friction in human_driver.BRAKES}))[2:]
    assert lines[0] == "| brake as measured drivers do | +7.5 | +7.5 |"
    assert lines[3] == "| brake with the motors first, at equal arrival | +5.5 | +5.5 |"


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_a_batch_has_every_column(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    day = tmp_path / "flat.toml"
    day.write_text(FLAT, encoding="utf-8")
    monkeypatch.setattr(human_driver, "FOLDER", tmp_path / "runs")
    found = runs(str(day), (NONE, COACH), (0, 1), FrictionPolicy.ELECTRIC_FIRST)
    assert len(list(presentations_table(found))) == 4
