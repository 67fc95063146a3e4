"""The script of the page of results: a row of the benchmark as the page has it, and the hard problems drawn."""

from __future__ import annotations

import numpy as np
import pytest

from docs.studies import peers
from tests.support.benchmark import reference_results, track_path
from tests.support.kept_figures import not_on_page


@pytest.mark.slow
def test_a_row_is_as_the_page_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    result = next(one for one in reference_results() if one.losses != "map" and track_path(one.route).is_file())
    monkeypatch.setattr(peers, "reference_results", lambda: [result])
    *_, row = peers.peers_table()
    assert not_on_page(peers.PAGE.read_text(encoding="utf-8"), [row]) == []


def test_hard_problems_are_of_ten_kinds() -> None:
    assert len({one.kind for one in peers.hard_problems(np.random.default_rng(0))}) == 10
