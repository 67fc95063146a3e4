"""Finished references: a departure from a table is the schedule that was planned, in time and hardly dearer."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from das.advice.guide.planning import Wanted, departing, planned
from das.domain.journey import Window
from das.solver.guide.policies import DEFAULT, GuideFront
from das.solver.guide.references import Finished, References, lateness_s
from das.solver.guide.schedule import Phase, PhaseKind, Scheduled
from das.solver.section import Section
from das.solver.state import least_time_s
from das.table import METHOD, Table, table_content
from precompute.tables.writing import LONGEST_RATIO

EXPECTED = (
    4,
    235.8,
    13.12,
    [
        ("TRACTION", 1.0, 25.0),
        ("HOLD", 0.0, 25.0),
        ("TRACTION", 1.0, 27.8),
        ("COAST", 0.0, 24.7),
        ("BRAKE", 0.0, 20.0),
        ("HOLD", 0.0, 20.0),
        ("COAST", 0.0, 18.7),
        ("BRAKE", 0.0, 0.0),
    ],
)


def wanted(section: Section, buffer: float, s_m: float = 0.0) -> Wanted:
    """A departure with this much more than the least time."""
    return Wanted(s_m=s_m, v_mps=0.0, left_s=float(section.fastest_run.time_to_go_s[0]) * (1.0 + buffer))


def served(whole: Path, section: Section) -> GuideFront:
    """The policies of a section, with the references of its table."""
    return GuideFront(section, threads=1, references=Table.read(whole).references_for(section, DEFAULT))


def priced_j(scheduled: Scheduled, asked: Wanted, price_w: float) -> float:
    """The energy of a schedule, and how far it is off the wanted time at the price of time, as `in_time` counts it."""
    return scheduled.forecast.energy_j + price_w * lateness_s(scheduled.forecast.time_s - asked.left_s)


def test_a_schedule_comes_back_from_a_table_bit_for_bit(made: Path, section: Section, tmp_path: Path) -> None:
    """The same phases, speeds and forecast as the cab's own plan, which was written into a table."""
    asked = wanted(section, 0.08)
    own = planned(GuideFront(section, threads=1), asked)
    kept = Finished(own.forecast.time_s, own.forecast.energy_j, own.lambda_w, own.schedule.phases)
    table = Table.read(made)
    found = {"settings": table.settings, "least_time_s": table.least_time_s, "front": table.front}
    path = tmp_path / "table.json"
    path.write_bytes(table_content(section, found, References([kept])))
    again = departing(served(path, section), asked)
    assert again is not None
    assert again.finished
    assert not own.finished
    assert (again.schedule.phases, again.lambda_w) == (own.schedule.phases, own.lambda_w)
    np.testing.assert_array_equal(again.schedule.known.speed_mps, own.schedule.known.speed_mps)
    np.testing.assert_array_equal(again.forecast.speeds_mps, own.forecast.speeds_mps)
    assert (again.forecast.time_s, again.forecast.energy_j) == (own.forecast.time_s, own.forecast.energy_j)


@pytest.mark.slow
def test_departures_on_time_and_late_are_served_and_cost_no_more_than_solved_ones(
    whole: Path, section: Section
) -> None:
    """By the cab's own count: energy, and time off the wanted one at the price of time. No policy is solved for it."""
    front, solved = served(whole, section), GuideFront(section, threads=1)
    gained_j = []
    for buffer in (0.0, 0.03, 0.06, 0.1, 0.15, 0.2):
        asked = wanted(section, buffer)
        found, own = departing(front, asked), planned(solved, asked)
        assert found is not None
        assert -2.0 <= found.forecast.time_s - asked.left_s <= 1.5 or buffer == 0.0
        gained_j.append(priced_j(own, asked, found.lambda_w) - priced_j(found, asked, found.lambda_w))
        assert gained_j[-1] >= -1e-3 * own.forecast.energy_j
    assert sum(gained_j) >= 0.0
    assert front.nbytes == 0


def test_a_late_train_gets_the_quickest_and_a_waiting_one_a_plan_of_its_own(made: Path, section: Section) -> None:
    front = served(made, section)
    assert front.references is not None
    finished = front.references.finished
    late = departing(front, wanted(section, -0.5))
    assert late is not None
    assert late.schedule.phases == finished[0].phases
    assert departing(front, wanted(section, LONGEST_RATIO)) is None
    assert finished[-1].time_s == pytest.approx(LONGEST_RATIO * section.fastest_run.time_to_go_s[0], abs=3.0)
    for before, after in pairwise(finished):
        assert before.time_s < after.time_s
        assert before.energy_j > after.energy_j


def test_only_a_train_that_departs_is_served(made: Path, section: Section) -> None:
    front, asked = served(made, section), wanted(section, 0.08)
    found = departing(front, asked)
    assert found is not None
    assert departing(GuideFront(section, threads=1), asked) is None
    assert departing(front, replace(asked, v_mps=5.0)) is None
    assert departing(front, replace(asked, s_m=60.0)) is None
    assert departing(front, replace(asked, kept=(found.schedule, found.forecast))) is None
    stalls = References([Finished(300.0, 1e6, 1e4, (Phase(PhaseKind.COAST, 0.0, 0, 9.0),))])
    assert departing(GuideFront(section, threads=1, references=stalls), asked) is None
    # A train that has begun to move, or stands a little beyond its mark, is ahead by some seconds.
    least_s = float(section.fastest_run.time_to_go_s[0])
    for s_m, v_mps in ((20.0, 0.0), (0.5, 1.0)):
        ahead_s = least_s - least_time_s(section, s_m, v_mps)
        assert 0.5 < ahead_s < 5.0
        begun = departing(front, replace(asked, s_m=s_m, v_mps=v_mps, left_s=asked.left_s - ahead_s))
        assert begun is not None
        assert begun.schedule.phases == found.schedule.phases
        assert begun.forecast.time_s == pytest.approx(found.forecast.time_s - ahead_s, abs=0.2)


def test_a_point_with_a_window_is_served_if_the_reference_keeps_it(made: Path, section: Section) -> None:
    front, asked = served(made, section), wanted(section, 0.08)
    found = departing(front, asked)
    assert found is not None
    at_s = found.forecast.passes_s(2500.0)
    kept = replace(asked, point_m=2500.0, window=Window(earliest_s=at_s - 1.0, latest_s=at_s + 1.0))
    again = departing(front, kept)
    assert again is not None
    assert again.schedule.phases == found.schedule.phases
    assert departing(front, replace(kept, window=Window(latest_s=at_s - 1.0))) is None
    assert departing(front, replace(kept, window=Window(earliest_s=at_s + 1.0))) is None


@pytest.mark.slow
def test_the_method_is_another_one_if_references_change(whole: Path, section: Section) -> None:
    """If this fails because planning was changed on purpose, raise `METHOD` and put the new figures here.

    Old tables are then refused and built again, instead of leading trains by plans that nobody would make today.
    """
    found = departing(served(whole, section), wanted(section, 0.08))
    assert found is not None
    told = [(one.kind.name, one.share, round(one.target_mps, 1)) for one in found.schedule.phases]
    assert (METHOD, round(found.forecast.time_s, 1), round(found.forecast.energy_j / 3.6e6, 2), told) == EXPECTED
