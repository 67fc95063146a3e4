"""The command loss-map: a map written to CSV and described again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.making import das_precompute, in_a_process


@pytest.mark.processes
@pytest.mark.slow
def test_a_map_goes_to_csv_and_back_with_the_same_figures(tmp_path: Path) -> None:
    files = ("--out", "m.csv", "--plot", "m.png")
    first = in_a_process("precompute.cli", "loss-map", "re460-ic-igbt", *files, "--json", cwd=tmp_path)
    assert (first.returncode, first.stderr) == (0, "")
    again = das_precompute(tmp_path, "loss-map", "m.csv", "--vehicle", "re460-ic-igbt", "--json")
    assert (again.returncode, again.stderr) == (0, "")
    one, other = json.loads(first.stdout), json.loads(again.stdout)
    assert other["fits"]["l2"] == pytest.approx(one["fits"]["l2"], rel=1e-6)
    assert other["best"]["driving"] == pytest.approx(one["best"]["driving"], rel=1e-6)
    assert (tmp_path / "m.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    table = das_precompute(tmp_path, "loss-map", "m.csv", "--vehicle", "re460-ic-igbt")
    assert table.returncode == 0
    assert f"{one['best']['driving']['efficiency_ratio']:.1%}" in table.stdout
