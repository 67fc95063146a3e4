"""A day driven in this process has the table that its recording would give, and its cards can be printed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import sim
from sim.drive.drive import Drive
from sim.drivers.kinds import DriverKind, Presentation
from sim.world.driving import How, drive_day, drive_kept
from sim.world.service import make_day
from tests.support.flat_days import service_of
from tests.support.making import das_sim


@pytest.mark.slow
def test_the_table_in_memory_is_that_of_the_recording(flat: Callable[[str], Path], tmp_path: Path) -> None:
    service, out = service_of(flat("")), tmp_path / "run.mcap"
    how = How(driver=DriverKind.HUMAN, advice=Presentation.GUIDE, train="train-1", command="test")
    day = make_day(service, 3)
    run, kept = drive_kept(day, day.driver(DriverKind.HUMAN), how)
    day = make_day(service, 3)
    recorded = drive_day(day, day.driver(DriverKind.HUMAN), how, out).run
    assert run.states == recorded.states
    read = Drive.read(out).table
    rows = len(kept.time_ns)
    assert np.array_equal(kept.time_ns, read.time_ns[:rows])
    assert len(read.time_ns) <= rows + 1  # the node is told of the end and answers once more
    for name in ("truth_s_m", "truth_energy_input_j", "advice_mode", "advice_advised_speed_mps", "cab_lever_ratio"):
        assert np.array_equal(kept[name], read[name][:rows], equal_nan=True), name
    assert kept.said.decisions == read.said.decisions
    assert kept.said.saving is not None
    assert read.said.saving is not None
    assert kept.said.saving.driven_j == read.said.saving.driven_j


@pytest.mark.slow
def test_the_cards_of_a_run_are_printed_with_the_log_of_the_node(flat: Callable[[str], Path]) -> None:
    path = flat("")
    done = das_sim("run", str(path), "--in-process", "--cards", cwd=path.parent)
    assert done.returncode == 0, done.stderr
    assert re.search(r"^\d\d:\d\d:\d\d  accelerate \d+ km/h; effort advised \+", done.stdout, re.MULTILINE)
    assert re.search(r"^\d\d:\d\d:\d\d  brake .*; why stop at B; ", done.stdout, re.MULTILINE)
    assert re.search(r"^\d\d:\d\d:\d\d    das-node: ", done.stdout, re.MULTILINE)


@pytest.mark.slow
def test_a_simulated_day_of_the_library_has_its_table(flat: Callable[[str], Path]) -> None:
    day = sim.run_day(flat(""), driver="perfect", advice="speed-and-effort")
    assert day.table["truth_s_m"][-1] == day.columns()["s_m"][-1]
    assert Drive(recording=day.table.recording).figures.as_dict()["signals_passed"] == 0
