"""The tables of the exact front, on the first 1.5 km of the line, against the exact front itself."""

from __future__ import annotations

import numpy as np
import pytest

from das.domain.levels import Level
from docs.studies import exact_front
from docs.studies.exact_front import LENGTHS_KM, case, case_table, growth_table
from precompute.exact.front import solve_exact
from tests.support.kept_figures import not_on_page


@pytest.mark.slow
def test_the_tables_say_what_the_exact_front_is(monkeypatch: pytest.MonkeyPatch) -> None:
    short = case(Level.L1, 1.5)
    monkeypatch.setattr(exact_front, "case", lambda *_: short)
    exact = solve_exact(short, 0.02)
    cells = list(case_table((Level.L1,), (0.02,)))[-1].split(" | ")
    assert cells[0] == "| l1"
    assert int(cells[1]) == len(exact.time_s)
    assert cells[3].startswith(f"{100 * exact.gap_ratio.max():.3f} %")
    assert cells[4].endswith(f"{100 * np.mean(exact.swept_gap_ratio):.4f} %")
    assert float(cells[5].split(" ")[0]) < 0.0, "the solver is not bound to the grid and needs less"
    assert list(growth_table((1.5,), 0.02))[-1].startswith(f"| 1.5 km | {len(exact.time_s)} |")


@pytest.mark.slow
def test_the_page_has_what_is_found_of_the_shortest_line() -> None:
    """The probe of the results of 0.2."""
    *_, row = growth_table(LENGTHS_KM[:1])
    assert not_on_page(exact_front.PAGE.read_text(encoding="utf-8"), [row]) == []
