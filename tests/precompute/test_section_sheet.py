"""The driver's sheet: few lines, with which a train is on time, within limits, and near the least energy."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from das.advice.regimes import InstructionKind
from das.domain.braking import USUAL
from das.domain.files.load import load_route, load_vehicle
from das.domain.journey import Window
from das.solver.section import build_section, with_braking
from das.solver.solve import solve_front
from precompute.sheet import SectionSheet, section_sheet

ROUTE, TRAIN = load_route("zurich-luzern"), load_vehicle("re460-ic")


def sheet(start: str, end: str, ratio: float) -> tuple[SectionSheet, float, float]:
    """The sheet of a section with a buffer; its time (s), and the least energy for this time under the braking (J)."""
    ends = (ROUTE.stop(start).position_m, ROUTE.stop(end).position_m)
    section = with_braking(build_section(ROUTE, TRAIN, start_m=ends[0], end_m=ends[1]), USUAL.of(TRAIN))
    front = solve_front(section)
    time_s = front.fastest().time_s * ratio
    return section_sheet(section, time_s), time_s, front.trajectory(time_s).balance.input


@pytest.mark.parametrize(("start", "end", "most"), [("Zürich HB", "Thalwil", 9), ("Thalwil", "Zug", 9)])
def test_a_train_that_follows_the_sheet_is_on_time_and_needs_little_more_than_the_least(
    start: str, end: str, most: int
) -> None:
    found, time_s, least_j = sheet(start, end, 1.08)
    assert found.t_s[-1] == pytest.approx(time_s, abs=4.0)
    assert least_j < found.energy_j < 1.02 * least_j
    assert 3 <= len(found.lines) <= most
    limit = found.section.limit_mps
    assert (np.maximum(found.v_mps[:-1], found.v_mps[1:]) <= limit + 1e-6).all()


def test_its_lines_are_in_order_and_each_says_something_new() -> None:
    found, _, _ = sheet("Thalwil", "Zug", 1.08)
    lines = found.lines
    assert lines[0].kind is InstructionKind.TRACTION
    assert lines[-1].kind is InstructionKind.BRAKE
    assert lines[-1].speed_mps == pytest.approx(0.0, abs=0.01)
    for before, after in pairwise(lines):
        assert before.s_m < after.s_m
        assert before.after_s < after.after_s
        same = before.kind is after.kind and abs(before.speed_mps - after.speed_mps) < 0.5
        assert not same
    for line in lines:
        assert line.after_s == pytest.approx(np.interp(line.s_m, found.s_m, found.t_s), abs=1e-6)


def test_the_window_of_a_point_on_the_way_is_kept() -> None:
    found, time_s, _ = sheet("Thalwil", "Zug", 1.08)
    point_m = 20_210.0
    later_s = float(np.interp(point_m, found.s_m, found.t_s)) + 5.0
    kept = section_sheet(found.section, time_s, point_m, Window(earliest_s=later_s))
    assert float(np.interp(point_m, kept.s_m, kept.t_s)) >= later_s - 2.0
    assert kept.t_s[-1] == pytest.approx(time_s, abs=12.0), "a window costs time that few changes do not win back"
