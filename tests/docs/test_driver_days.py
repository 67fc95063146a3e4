"""Driver days and persons of the release: tables are made of their rows, and the program still drives as they say."""

from __future__ import annotations

import numpy as np
import pytest

from docs.studies.driver_days import (
    PERSON_COLUMNS,
    PERSON_NUMBERS,
    PERSONS,
    SEEDS,
    driven_row,
    jobs,
    parts,
    person_jobs,
)
from docs.studies.driver_tables import AT_EQUAL_ARRIVAL, Row, groups, less, presentations, read, tables
from docs.studies.output import csv_lines, plain
from sim.drivers.kinds import Presentation
from sim.experiment.one_line import row_of
from sim.experiment.trials import make_trial

ROWS, PERSON_ROWS = read(), read(PERSONS)
NONE, GUIDE = Presentation.NONE, Presentation.GUIDE
TOLERANCES = {
    "late_s": 3.0, "energy_kwh": 2.0, "energy_optimum_kwh": 1.0, "friction_brake_ratio": 0.005,
    "advice_changes_per_min": 0.1, "instructions": 2.0, "announced_ratio": 0.05, "brakes_led_ratio": 0.1,
    "over_limit_s": 2.0, "last_word_acts": 0.0, "signals_passed": 0.0,
}  # fmt: skip
"""By how much a drive may differ from its row; two seeds differ by more, and two persons."""


def test_every_table_is_what_the_rows_give() -> None:
    for page, name, lines in tables(ROWS, PERSON_ROWS):
        if page.suffix == ".csv":
            assert csv_lines(page) == [line for line in lines if not line.startswith("|---")]
        else:
            assert f"<!-- {name}: begin -->\n" + "\n".join(lines) + f"\n<!-- {name}: end -->" in page.read_text("utf-8")


def test_presentations_are_compared_on_the_days_that_all_have() -> None:
    """On two days the guide takes 20 and 10 kWh less; the later arrival is worth 4 of them. A third day lacks pairs."""

    def row(advice: Presentation, seed: float, energy_kwh: float, optimum_kwh: float) -> Row:
        return {
            "scenario": "day", "driver": "human", "friction_policy": "as-measured", "advice": str(advice), "seed": seed,
            "energy_kwh": energy_kwh, "energy_optimum_kwh": optimum_kwh, "energy_blending_kwh": 0.4 * energy_kwh,
            "friction_brake_ratio": 0.141, "over_limit_s": 0.5, "advice_changes_per_min": 1.9, "late_s": 3.0,
        }  # fmt: skip

    rows = [row(shown, seed, 200.0, 120.0) for shown in Presentation for seed in (0.0, 1.0) if shown is not GUIDE]
    rows += [row(GUIDE, 1.0, 190.0, 116.0), row(GUIDE, 0.0, 180.0, 116.0), row(GUIDE, 2.0, 0.0, 0.0)]
    alone, guide = groups(rows, (NONE, GUIDE), "day")
    assert list(guide) == [0, 1]
    assert less(guide, alone, *AT_EQUAL_ARRIVAL) == pytest.approx([16.0, 6.0])
    lines = {line.split(" | ")[0]: line for line in presentations(rows, "day")}
    assert lines["| none"] == "| none | +3 | 200.0 |  |  |  | 14.1 % |  | 0.5 |"
    assert lines["| guide"] == "| guide | +3 | 185.0 | +15.0 | +11.0 | +6.0 | 14.1 % | 1.9 | 0.5 |"


@pytest.mark.slow
def test_the_program_still_drives_as_the_rows_say() -> None:
    """The probe: one drive with the guide. If it fails, make the data set again and read the sentences around it."""
    some = jobs(next(parts(SEEDS[:1])))
    (job,) = (job for job in some if (row_of(job)["scenario"], row_of(job)["advice"]) == ("clear-day", GUIDE))
    made = plain(driven_row(job, make_trial(job)["measures"]))
    (kept,) = groups(ROWS, (GUIDE,))
    off = {name: float(np.abs(made[name] - kept[SEEDS[0]][name])) for name in TOLERANCES}
    assert {name: by for name, by in off.items() if by > TOLERANCES[name]} == {}


def test_every_person_of_the_release_has_a_row() -> None:
    assert [int(row["participant"]) for row in PERSON_ROWS] == list(PERSON_NUMBERS)
    assert tuple(PERSON_ROWS[0]) == PERSON_COLUMNS


@pytest.mark.slow
def test_the_program_still_drives_the_first_person_as_its_row_says() -> None:
    """The probe. If it fails, make populations.csv again and read the sentences around its tables."""
    for job, kept in zip(person_jobs(PERSON_NUMBERS[:1]), PERSON_ROWS, strict=False):
        made = plain(driven_row(job, make_trial(job)["measures"]))
        off = {name: abs(made[name] - kept[name]) for name in PERSON_COLUMNS[1:]}
        assert {name: by for name, by in off.items() if by > TOLERANCES[name]} == {}
