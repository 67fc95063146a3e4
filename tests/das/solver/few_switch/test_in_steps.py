"""Speeds in whole steps: every one a step or a limit, at hardly any cost, and never beyond what a window allows."""

from __future__ import annotations

import numpy as np
import pytest

from das.domain.units import KMH
from das.solver.few_switch.few_switch import NotchRegime
from das.solver.few_switch.in_steps import Choice, Rounding, in_steps, rounded_mps
from das.solver.few_switch.phases import Phase
from das.solver.few_switch.schedule import Schedule, Scheduled, known_run
from das.solver.few_switch.settings import PolishSettings
from das.solver.section import build_section
from tests.support.few_switch import BUFFERS, BUNDLED, Which, schedules, section_of
from tests.support.making import make_route
from tests.support.small_trips import TRAIN

STEP_MPS = 5.0 * KMH
KWH = 3.6e6


def told_mps(found: Scheduled) -> list[float]:
    """The speeds to reach and to hold of a schedule."""
    kinds = (NotchRegime.TRACTION, NotchRegime.HOLD)
    return [one.target_mps for one in found.schedule.phases if one.kind in kinds]


def is_step_or_limit(speed_mps: float, found: Scheduled) -> bool:
    near_step = abs(speed_mps - round(speed_mps / STEP_MPS) * STEP_MPS) < 1e-6
    return near_step or any(abs(found.schedule.section.limit_mps - speed_mps) < 1e-6)


def rounded(which: Which, buffer_ratio: float, choice: Choice) -> tuple[Scheduled, Scheduled, float]:
    """A polished schedule, the same in steps, and the time asked for (s)."""
    asked, start_m = schedules(which, buffer_ratio), section_of(which).start_m
    rounding = Rounding(STEP_MPS, choice, PolishSettings())
    return asked.polished, in_steps(asked.polished, asked.time_s, start_m, 0.0, rounding), asked.time_s


@pytest.mark.parametrize("which", BUNDLED)
@pytest.mark.parametrize("buffer_ratio", BUFFERS)
def test_every_speed_is_a_step_or_a_limit_and_costs_little_more(which: Which, buffer_ratio: float) -> None:
    before, after, time_s = rounded(which, buffer_ratio, Choice.CHEAPER)
    assert all(is_step_or_limit(speed, after) for speed in told_mps(after))
    assert after.says_its_brakes
    assert after.cost_j(time_s) <= before.cost_j(time_s) + max(1.0 * KWH, 0.01 * abs(before.forecast.energy_j))


@pytest.mark.parametrize("which", BUNDLED)
def test_the_lower_step_is_never_faster_and_the_higher_never_slower(which: Which) -> None:
    for choice, sign in ((Choice.LOWER, 1.0), (Choice.HIGHER, -1.0)):
        before, after, _ = rounded(which, 0.15, choice)
        assert sign * (after.forecast.time_s - before.forecast.time_s) >= -0.1


@pytest.mark.parametrize("which", BUNDLED)
def test_no_speed_to_hold_is_told_to_a_train_that_rolls_faster_all_the_way(which: Which) -> None:
    """Where it would, as down a slight descent, the higher step is taken: who holds the lower one would brake."""
    for buffer_ratio in (0.04, 0.06, 0.08, 0.1, 0.12):
        _, after, _ = rounded(which, buffer_ratio, Choice.CHEAPER)
        phases, speeds_mps = after.schedule.phases, after.forecast.speeds_mps
        ends = [*(one.begin for one in phases[1:]), len(speeds_mps) - 1]
        for one, end in zip(phases, ends, strict=True):
            if one.kind is NotchRegime.HOLD:
                assert speeds_mps[one.begin : end + 1].min() <= one.target_mps + 0.5 * STEP_MPS


def test_a_speed_at_the_end_of_a_phase_is_a_limit_or_a_step_that_is_allowed() -> None:
    for speed, limit, highest, told in (
        (98.0, 100.0, 100.0, 100.0), (97.0, 100.0, 100.0, 95.0), (36.5, 36.9, 36.9, 36.9), (35.2, 36.9, 36.9, 35.0),
        (91.19, 100.0, 91.19, 90.0), (98.6, 100.0, 98.6, 95.0), (36.9, 36.9, 30.0, 30.0),
    ):  # fmt: skip
        found = rounded_mps(speed * KMH, STEP_MPS, limit * KMH, highest * KMH)
        assert found == pytest.approx(told * KMH), (speed, limit, highest)


@pytest.mark.parametrize("before_stop_m", [60.0, 90.0])
def test_a_brake_that_is_added_in_the_end_names_the_board_before_the_stop(before_stop_m: float) -> None:
    """It was one brake to 0 past a board of 30 km/h that binds, as hardly any time lies between the two."""
    line = make_route(4000.0, [(0.0, 25.0), (4000.0 - before_stop_m, 30 * KMH)])
    section = build_section(line, TRAIN)
    phases = (Phase(NotchRegime.TRACTION, 1.0, 0, 25.0), Phase(NotchRegime.HOLD, 0.0, 60, 25.0))
    known = known_run(section, np.full(len(section.node_m), 25.0))
    raw = Schedule(section=section, phases=phases, known=known, back_share=0.7)
    silent = Scheduled(*raw.settled(0.0, 0.0), 1e6)
    assert not silent.says_its_brakes
    found = in_steps(silent, 200.0, 0.0, 0.0, Rounding(STEP_MPS, Choice.LOWER, PolishSettings()))
    brakes = [one.target_mps / KMH for one in found.schedule.phases if one.kind is NotchRegime.BRAKE]
    assert brakes == pytest.approx([30.0, 0.0])
