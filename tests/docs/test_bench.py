"""The table of the bench, from what `das-precompute bench --json` prints."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from docs.studies.bench import bench_table
from tests.support.making import printed


@pytest.mark.more
@pytest.mark.slow
def test_the_table_has_a_row_for_each_figure_and_the_machine(tmp_path: Path) -> None:
    result = json.loads(printed(tmp_path, "bench", "--quick", "--only", "trajectory", "--json"))
    *_, row, between, machine = bench_table(result)
    (figure,) = result["figures"]
    assert row.startswith(f"| trajectory | {figure['what']} | {figure['value']:.3g} (")
    assert between == ""
    assert machine.startswith(result["machine"]["cpu"])
