"""The command loss-map: a map written to CSV and described again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.making import in_a_process, printed


@pytest.mark.slow
def test_a_map_goes_to_csv_and_back_with_the_same_figures(tmp_path: Path) -> None:
    files = ("--out", "m.csv", "--plot", "m.png")
    first = in_a_process("precompute.cli", "loss-map", "re460-ic-igbt", *files, "--json", cwd=tmp_path)
    assert (first.returncode, first.stderr) == (0, "")
    words = ("loss-map", "m.csv", "--vehicle", "re460-ic-igbt")
    one, other = json.loads(first.stdout), json.loads(printed(tmp_path, *words, "--json"))
    assert other["fits"]["l2"] == pytest.approx(one["fits"]["l2"], rel=1e-6)
    assert other["best"]["driving"] == pytest.approx(one["best"]["driving"], rel=1e-6)
    assert (tmp_path / "m.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert f"{one['best']['driving']['efficiency_ratio']:.1%}" in printed(tmp_path, *words)
