"""Any train on any line: whole days of the matrix, judged by the product's own figures and a witness of the raw files.

`DAS_MATRIX_CELLS=1000 pytest tests/property/test_matrix.py` drives more cells; `DAS_MATRIX_FIRST=500` begins with
another one, and `DAS_MATRIX_ADVICE` names another advice than the default one. `python -m docs.studies.matrix` prints
the same judgement as tables.

Each bound of today stands in `BOUNDS` of `tests/support/matrix.py` beside the one that the goal of the guide asks. Some
are those of means: they are judged where a driver has at least 20 cells, as at night.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.domain.errors import DasError
from sim.drivers.cab import CabView
from sim.plant.kernels import Command
from sim.plant.plant import lever
from tests.support import benchmark, matrix, matrix_lines
from tests.support.matrix import BOUNDS, Watched, Witness, breaches, judged
from tests.support.matrix_lines import PAIRS, REFUSED, Cell, Who, cell_of, cells, service_of
from tests.support.raw_data import Effort, Line, Steps, Train

FIRST = int(os.environ.get("DAS_MATRIX_FIRST", "0"))
QUICK = [Cell("platform30", "re460-ic", Who.OBEDIENT, 0), Cell("short900", "CH_Stadler_FLIRT_TPF", Who.OBEDIENT, 0),
         Cell("brow", "no-electric", Who.OBEDIENT, 0), Cell("brow", "no-electric", Who.HUMAN, 0)]  # fmt: skip
"""The cells of the default run: a limit just before a stop, short sections, a brow."""
NIGHT = 3 * len(PAIRS)


def tiers() -> list[Any]:
    """The cells of each tier, as parameters; all that the environment asks for if it says how many."""
    if "DAS_MATRIX_CELLS" in os.environ:
        return [pytest.param(cells(int(os.environ["DAS_MATRIX_CELLS"]), FIRST), id="all")]
    return [
        pytest.param(QUICK, id="quick"),
        pytest.param(cells(NIGHT), id="night", marks=pytest.mark.nightly),
    ]


@pytest.mark.parametrize("some", tiers())
def test_any_train_on_any_line_is_driven_within_the_bounds_of_today(some: list[Cell], tmp_path: Path) -> None:
    rows = [judged(cell, tmp_path) for cell in some]
    assert breaches(rows) == [], "\n".join(map(str, rows))


@pytest.mark.parametrize("cell", REFUSED, ids=str)
def test_a_train_that_stalls_on_its_line_is_refused_in_one_line(cell: Cell, tmp_path: Path) -> None:
    with pytest.raises(DasError, match=r"stalls at \d+ m") as refused:
        service_of(cell, tmp_path)
    assert "\n" not in str(refused.value)


def test_three_rounds_have_every_line_and_train_with_every_driver() -> None:
    drawn = [cell_of(number) for number in range(3 * len(PAIRS))]
    assert {(cell.line, cell.train, cell.who) for cell in drawn} == {(*pair, who) for pair in PAIRS for who in Who}
    assert {cell.seed for cell in drawn} == {0}
    assert cell_of(3 * len(PAIRS)) == drawn[0]._replace(seed=1)


def test_cells_of_the_data_of_others_are_left_out_without_them_but_not_in_ci(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(benchmark, "SHARED", tmp_path)
    monkeypatch.setattr(matrix_lines, "IMPORTED", dict.fromkeys(matrix_lines.IMPORTED, (tmp_path / "none.yaml", "0.3")))
    monkeypatch.delenv("CI", raising=False)
    assert 20 < len(cells(len(PAIRS))) < len(PAIRS)
    monkeypatch.setenv("CI", "true")
    assert len(cells(len(PAIRS))) == len(PAIRS)


def test_the_goal_asks_at_least_what_holds_today() -> None:
    assert [one.what for one in BOUNDS if one.today != one.asked and not one.breaks(one.today, one.asked)] == []


def test_the_witness_knows_limits_over_the_train_and_the_curve_before_limit_and_stop() -> None:
    """100 t that brake with 100 kN on the flat lose 1 m/s each second: v² = v0² + 2·d, by hand."""
    flat = Steps(np.array([0.0]), np.array([0.0]))
    limits = Steps(np.array([0.0, 1000.0, 1500.0]), np.array([20.0, 10.0, 20.0]))
    line = Line(gradients=flat, curves=flat, limits=limits, tunnels=(), stops_m=(0.0, 2000.0), receptivity=flat)
    train = Train(
        mass_kg=1e5, rotating_kg=0.0, length_m=100.0, max_speed_mps=18.0, max_acceleration_mps2=1.0,
        max_deceleration_mps2=5.0, r0_n=0.0, r1_n_per_mps=0.0, r2_n_per_mps2=0.0, traction=Effort(1e5, 1e6),
        electric=Effort(0.0, 0.0), friction_n=1e5, brakes="friction", tunnel_rows=(),
    )  # fmt: skip
    witness = Witness(line, train)
    found = [witness.above(at_m, 10.0, 2000.0) for at_m in (500.0, 950.0, 1596.0, 1603.0, 1992.0)]
    curve = [18.0, math.sqrt(100.0 + 2.0 * 51.0), 10.0, 18.0, math.sqrt(2.0 * 9.0)]
    assert [above for above, _ in found] == pytest.approx([-8.0, -8.0, 0.0, -8.0, -8.0])
    assert [above for _, above in found] == pytest.approx([10.0 - v for v in curve], abs=0.01)


class Heedless:
    """A driver who sets full traction and never brakes."""

    def command(self, cab: CabView) -> Command:
        return lever(1.0)


def test_who_heeds_nothing_is_seen_above_the_limit_and_beyond_his_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(matrix, "driver_of", lambda day, cell, witness: Watched(Heedless(), witness))
    row = judged(QUICK[0], tmp_path)
    assert "drove past its stop" in row.said
    assert row.above_limit_mps > 10.0
    found = "\n".join(breaches([row]))
    assert all(f"obedient: {what}" in found for what in ("stops missed", "above a limit", "above a braking curve"))
