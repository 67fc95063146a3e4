"""Looking a continuation up: it agrees with the roll-out, from memory and from a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError, InfeasibleError
from das.solver.front import Front
from das.solver.section import Section
from das.solver.solution import Fit
from das.table.reading import read_front
from precompute.tables.look_up import LookUp
from tests.support.small_tables import LENGTH_M, states


@pytest.fixture(scope="module")
def look_up(section: Section, folder: Path) -> LookUp:
    """Answers from a table."""
    return LookUp(read_front(folder, section))


@pytest.mark.slow
@pytest.mark.parametrize("from_table", [True, False], ids=["from a table", "from memory"])
def test_look_up_agrees_with_the_roll_out(look_up: LookUp, front: Front, from_table: bool) -> None:
    answer, scale_j = look_up if from_table else LookUp(front), abs(front.fastest().balance.input)
    for s_m, v_mps, time_s in states(front, 20):
        found, run = answer(s_m, v_mps, time_s), front.trajectory(time_s, s_m, v_mps)
        assert found.fit == run.fit
        assert found.energy_to_go_j == pytest.approx(run.balance.input, abs=2e-3 * scale_j)
        assert found.time_to_go_s == pytest.approx(run.time_s, abs=0.3)
        there = int(np.searchsorted(run.trajectory.s_m, found.next_m - 1e-6))
        assert found.speed_mps == pytest.approx(run.trajectory.v_mps[there], abs=0.6)
        # The mean force by the work–energy theorem over the way to the next node.
        way = slice(0, there)
        step_m = np.diff(run.trajectory.s_m)[way]
        force_n = (run.trajectory.force_el_n + run.trajectory.force_friction_n)[way] @ step_m / step_m.sum()
        mass_kg = front.section.train.inertial_mass_kg
        other_n = 0.5 * mass_kg * (found.speed_mps**2 - run.trajectory.v_mps[there] ** 2) / step_m.sum()
        assert found.force_n == pytest.approx(force_n + other_n, abs=0.05 * front.section.train.traction_force_n)


@pytest.mark.slow
def test_look_up_says_late_and_early(look_up: LookUp, front: Front) -> None:
    least_s = front.fastest().time_s
    start_m = front.section.start_m
    late, early = look_up(start_m, 0.0, 0.9 * least_s), look_up(start_m, 0.0, 1e6)
    assert (late.fit, early.fit) == (Fit.LATE, Fit.EARLY)
    assert late.time_to_go_s == pytest.approx(least_s, rel=5e-3)
    assert late.force_n == pytest.approx(front.section.train.traction_force_n)
    least = front.trajectory(1e9)
    assert early.time_to_go_s == pytest.approx(least.time_s, rel=0.05)
    assert early.energy_to_go_j < late.energy_to_go_j
    assert look_up(start_m, 0.0, -5.0) == late


def test_look_up_above_the_envelope_brakes_with_all_there_is(look_up: LookUp, section: Section) -> None:
    s_m = 3790.0
    found = look_up(s_m, 30.0, 100.0)
    assert found.force_n == pytest.approx(-section.train.electric_power_w / 30.0)
    assert found.speed_mps <= 20.0 + 1e-9


@pytest.mark.parametrize(
    ("s_m", "v_mps", "time_s", "error", "said"),
    [
        (-1.0, 10.0, 60.0, DasError, "position -1.0 m"),
        (LENGTH_M, 10.0, 60.0, DasError, "position 5000.0 m"),
        (100.0, -1.0, 60.0, DasError, "speed -1.0 m/s"),
        (100.0, 10.0, float("nan"), DasError, "time left nan s"),
        (LENGTH_M - 1.0, 0.0, 60.0, InfeasibleError, "no feasible continuation is known"),
    ],
)
def test_look_up_refuses(
    look_up: LookUp, s_m: float, v_mps: float, time_s: float, error: type[DasError], said: str
) -> None:
    with pytest.raises(error, match=said):
        look_up(s_m, v_mps, time_s)
