"""The steps of a reference: what a driver is told, one after another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.advice.guide.timeline import SAME_MPS, GuideStep, timeline, told_mps
from das.advice.regimes import InstructionKind
from das.domain.units import KMH
from das.solver.guide.schedule import Schedule, on_section
from das.solver.kernels.schedule import BACK_SHARE
from tests.support.guide import flat, reference

TRACTION, HOLD, COAST, BRAKE = (
    InstructionKind.TRACTION, InstructionKind.HOLD, InstructionKind.COAST, InstructionKind.BRAKE,
)  # fmt: skip


def told(steps: tuple[GuideStep, ...]) -> list[tuple[InstructionKind, int]]:
    """Kind and speed (km/h) of steps."""
    return [(one.kind, round(one.speed_mps / KMH)) for one in steps]


def plain() -> Schedule:
    return reference(
        ("T", 0.8, 0.0, 100), ("H", 0.0, 1000.0, 100), ("C", 0.0, 3000.0, 90), ("B", 0.0, 4700.0, 0)
    )  # fmt: skip


def test_each_phase_is_a_step_and_the_hold_of_the_speed_reached_is_none() -> None:
    steps = timeline(plain())
    assert told(steps) == [(TRACTION, 100), (COAST, 90), (BRAKE, 0)]
    assert [one.number for one in steps] == [0, 2, 3]
    assert (steps[0].effort, steps[1].effort, steps[2].effort) == (0.8, 0.0, 0.0)


def test_steps_follow_one_another_without_a_gap_to_the_end() -> None:
    steps = timeline(plain())
    assert [one.to_m for one in steps[:-1]] == [one.from_m for one in steps[1:]]
    assert steps[0].from_m == 0.0
    assert steps[-1].to_m == flat().end_m
    assert all(one.from_m < one.by_m <= one.to_m for one in steps)


def test_each_limit_that_rises_inside_an_acceleration_begins_a_step() -> None:
    line = flat((0.0, 800.0, 40), (800.0, 1600.0, 70))
    steps = timeline(reference(("T", 0.8, 0.0, 100), ("H", 0.0, 2600.0, 100), ("B", 0.0, 4700.0, 0), section=line))
    assert told(steps) == [(TRACTION, 40), (TRACTION, 70), (TRACTION, 100), (BRAKE, 0)]
    boards = [line.node_m[np.argmax(line.limit_mps > kmh * KMH)] for kmh in (41, 71)]
    assert [one.from_m for one in steps[1:3]] == pytest.approx(boards, abs=60.0)


def test_a_hold_that_begins_at_a_lower_limit_is_a_hold_and_then_an_acceleration() -> None:
    line = flat((0.0, 1500.0, 60))
    steps = timeline(reference(("H", 0.0, 0.0, 90), ("B", 0.0, 4700.0, 0), section=line, at_kmh=60))
    assert told(steps) == [(HOLD, 60), (TRACTION, 90), (BRAKE, 0)]
    assert steps[1].effort == BACK_SHARE


def test_a_limit_that_rises_for_less_than_8_s_is_no_step() -> None:
    """60 m at 60 km/h are over in 4 s."""
    line = flat((0.0, 1500.0, 60), (1560.0, 5000.0, 60))
    steps = timeline(reference(("H", 0.0, 0.0, 90), ("B", 0.0, 4700.0, 0), section=line, at_kmh=60))
    assert told(steps) == [(HOLD, 60), (BRAKE, 0)]


def test_before_a_lower_limit_that_a_slow_run_meets_without_a_brake_its_speed_is_told() -> None:
    line = flat((300.0, 1500.0, 60))
    steps = timeline(reference(("T", 0.1, 0.0, 90), ("B", 0.0, 4700.0, 0), section=line))
    assert told(steps)[0] == (TRACTION, 60)


def test_a_limit_that_came_after_the_reference_holds_from_its_board_on() -> None:
    """The run was made without it: the guard brakes, and no speed before the board is lowered."""
    line = flat((2000.0, 2800.0, 50))
    steps = timeline(on_section(plain(), line))
    assert told(steps)[:3] == [(TRACTION, 100), (HOLD, 50), (COAST, 50)] or (HOLD, 50) in told(steps)
    assert told(steps)[0] == (TRACTION, 100)


def test_a_brake_to_a_lower_speed_reaches_it_where_the_run_does_and_holds_it_to_its_end() -> None:
    line = flat((3000.0, 4500.0, 60))
    schedule = reference(
        ("H", 0.0, 0.0, 100), ("B", 0.0, 2500.0, 60), ("C", 0.0, 4000.0, 55), ("B", 0.0, 5200.0, 0),
        section=line, at_kmh=100,
    )  # fmt: skip
    brake = timeline(schedule)[1]
    assert (brake.kind, round(brake.speed_mps / KMH)) == (BRAKE, 60)
    assert brake.by_m == pytest.approx(3000.0, abs=60.0)
    assert brake.to_m == pytest.approx(4000.0, abs=60.0)


@pytest.mark.parametrize(("brakes_m", "is_step"), [(3990.0, False), (3700.0, True)])
def test_a_brake_that_takes_hardly_anything_off_the_end_of_coasting_is_no_step(brakes_m: float, is_step: bool) -> None:
    """Coasting comes down to 60 km/h near the board: the brake begins hardly above it, or well above."""
    line = flat((4000.0, 6000.0, 60))
    at_kmh = 63.0 if not is_step else 75.0
    schedule = reference(
        ("H", 0.0, 0.0, at_kmh), ("C", 0.0, brakes_m - 800.0, 60), ("B", 0.0, brakes_m, 60), ("H", 0.0, 4000.0, 60),
        ("B", 0.0, 5400.0, 0), section=line, at_kmh=at_kmh,
    )  # fmt: skip
    assert (schedule.speed_at(brakes_m) > 60.0 * KMH + SAME_MPS) is is_step
    kinds = [one.kind for one in timeline(schedule)]
    assert kinds == [HOLD, COAST, *([BRAKE] if is_step else []), BRAKE]


def test_a_brake_that_no_limit_asks_for_has_its_effort() -> None:
    schedule = reference(("H", 0.0, 0.0, 100), ("B", 0.4, 2500.0, 60), ("B", 0.0, 5200.0, 0), at_kmh=100)
    assert [one.effort for one in timeline(schedule)] == [0.0, 0.4, 0.0]


def test_a_brake_that_a_new_reference_ends_sooner_names_the_speed_that_it_has_then() -> None:
    """The old one braked to 30 km/h; with that speed the driver would be told to brake fully, to reach it in time."""
    schedule = reference(
        ("H", 0.0, 0.0, 100), ("B", 0.4, 2500.0, 30), ("C", 0.0, 2700.0, 60), ("B", 0.0, 5200.0, 0), at_kmh=100
    )
    ends_kmh = schedule.speed_at(2700.0) / KMH
    assert ends_kmh > 60.0
    assert told(timeline(schedule))[1] == (BRAKE, 5 * round(ends_kmh / 5))


def test_coasting_names_no_speed_above_the_lowest_limit_on_its_way() -> None:
    line = flat((3500.0, 3800.0, 75))
    schedule = reference(("H", 0.0, 0.0, 80), ("C", 0.0, 1000.0, 85), ("B", 0.0, 4700.0, 0), section=line, at_kmh=70)
    assert told(timeline(schedule))[1] == (COAST, 75)


@pytest.mark.parametrize(
    ("kmh", "highest_kmh", "says_kmh"), [(82, 160, 80), (83, 160, 85), (83, 84, 80), (99.2, 160, 100)]
)
def test_a_speed_is_told_in_steps_of_5_km_h_that_are_allowed(kmh: float, highest_kmh: float, says_kmh: float) -> None:
    assert told_mps(kmh * KMH, flat(), highest_kmh * KMH) == pytest.approx(says_kmh * KMH)


def test_a_speed_near_a_limit_is_the_limit_exactly() -> None:
    line = flat((1000.0, 2000.0, 73))
    limit_mps = float(line.limit_mps.min())
    assert told_mps(limit_mps + 0.1, line, 50.0) == limit_mps
    assert told_mps(limit_mps + 0.1, line, limit_mps - 1.0) == pytest.approx(65 * KMH)


def test_the_same_schedule_has_the_same_steps_whoever_asks() -> None:
    schedule = plain()
    assert timeline(schedule) == timeline(replace(schedule))
