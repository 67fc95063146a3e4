"""The command loss-map: what it refuses, and a map written to CSV and described again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from das.domain.files.load import locate_vehicle
from tests.support.making import das_precompute, in_a_process


@pytest.mark.parametrize(
    ("args", "expected"),
    [
        (["loss-map", "nix"], "nix: not a bundled vehicle"),
        (["loss-map", "no.csv"], "no.csv: cannot be read"),
        (["loss-map", "re460-ic", "--plot", "no/where.png"], "no/where.png: no such folder"),
        (["loss-map", "l2.toml"], "l2.toml: no data for level l3"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_nonsense_is_refused_in_one_line(tmp_path: Path, args: list[str], expected: str) -> None:
    bundled = locate_vehicle("re460-ic").read_text(encoding="utf-8")
    head = bundled[: bundled.index("[losses]")]
    (tmp_path / "l2.toml").write_text(head + '[losses]\ndefault = "l2"\n[losses.l2]\nmean_efficiency_ratio = 0.9\n')
    done = das_precompute(tmp_path, *args)
    assert done.returncode == 2
    assert expected in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


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
