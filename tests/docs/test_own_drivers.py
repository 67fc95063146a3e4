"""The study of the example drivers: what is paired, and how a run reaches the table."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from das.domain.errors import DasError
from docs.studies.own_drivers import DRIVERS, SHOWN, asked, driven_rows, own_drivers_table
from tests.support.flat_days import FLAT


def test_each_driver_is_compared_with_itself_on_the_same_days() -> None:
    rows = [
        {
            "driver": str(driver), "scenario": "day", "advice": str(shown), "seed": seed,
            "energy_kwh": 100.0 * (number + 1) + seed - 5.0 * (shown != "none"),
            "late_s": 2.0 if seed else -5.0, "over_limit_s": 0.5,
            "energy_optimum_kwh": 90.0 - 2.0 * (shown != "none"), "energy_blending_kwh": 1.0 * (shown != "none"),
            "advice_changes_per_min": None if shown == "none" else 1.25,
        }
        for (number, driver), shown, seed in product(enumerate(DRIVERS), SHOWN, (2, 0, 1))
    ]  # fmt: skip
    lines = list(own_drivers_table(rows))[2:]
    assert len(lines) == len(DRIVERS) * len(SHOWN)
    assert lines[0] == "| Lazy | day | none | 101.0 |  |  |  |  | +0 |  | 0.5 |"
    assert lines[4] == "| Doubting | day | coach | 196.0 | +5.0 ± 0.0 | +2.5 | +2.0 | -1.0 | +0 | 1.2 | 0.5 |"


@pytest.mark.more
@pytest.mark.processes
@pytest.mark.slow
def test_finished_runs_are_kept_and_a_failed_one_is_said(tmp_path: Path) -> None:
    (tmp_path / "flat.toml").write_text(FLAT)
    first = driven_rows(asked(tmp_path / "runs", [str(tmp_path / "flat.toml")], (0,)), 1)
    assert len(first) == len(DRIVERS) * len(SHOWN)
    kept = (tmp_path / "runs" / "finished.jsonl").stat().st_mtime_ns
    assert driven_rows(asked(tmp_path / "runs", [str(tmp_path / "flat.toml")], (0,)), 1) == first
    assert (tmp_path / "runs" / "finished.jsonl").stat().st_mtime_ns == kept
    stuck = "[[disturbances]]\nkind = 'signal-stop'\nat_km = 3\nseen_m = 1500\nclears_after_s = 86_400\n"
    (tmp_path / "stuck.toml").write_text(FLAT + stuck)
    with pytest.raises(DasError, match=r"flat, sim.drivers.examples:Lazy, seed 0: .*did not arrive"):
        driven_rows(asked(tmp_path / "stuck", [str(tmp_path / "stuck.toml")], (0,)), 1)
