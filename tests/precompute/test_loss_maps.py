"""A loss map shown: that of a vehicle, and the same from a CSV file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.making import in_a_process, printed, write_loss_map


@pytest.mark.slow
def test_a_map_from_csv_has_the_figures_of_the_vehicle_that_it_was_written_from(tmp_path: Path) -> None:
    train = "re460-ic-igbt"
    words = ("show", train, "--losses", "--plot", "m.png", "--json")
    first = in_a_process("precompute.cli", *words, cwd=tmp_path)
    assert (first.returncode, first.stderr) == (0, "")
    write_loss_map(tmp_path / "m.csv", train)
    words = ("show", "m.csv", "--vehicle", train)
    one, other = json.loads(first.stdout), json.loads(printed(tmp_path, *words, "--json"))
    assert other["fits"]["l2"] == pytest.approx(one["fits"]["l2"], rel=1e-6)
    assert other["best"]["driving"] == pytest.approx(one["best"]["driving"], rel=1e-6)
    assert (tmp_path / "m.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert f"{one['best']['driving']['efficiency_ratio']:.1%}" in printed(tmp_path, *words)
