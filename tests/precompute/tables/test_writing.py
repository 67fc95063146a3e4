"""Writing tables: the ladder that is kept, the same bytes again, and disks that are full."""

from __future__ import annotations

import itertools
import json
import math
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.files import writing
from das.domain.files.load import load_route, load_vehicle
from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solve import solve_front
from das.table.format import TableError
from das.table.hashes import differing_parts, hashes_of, with_code
from das.table.reading import Table
from precompute.tables.writing import (
    LONGEST_BUFFER_RATIO,
    NOT_PROVEN,
    SHORTEST_BUFFER_RATIO,
    TableSettings,
    make_table,
    table_ladder,
    write_table,
)
from tests.support.benchmark import track_path, train_path
from tests.support.small_tables import BUFFERS, SETTINGS, line, seal_anew, train


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / "table"))


def test_ladder_spans_the_buffers(front: Front) -> None:
    ladder = table_ladder(front, 28)
    assert (len(ladder), ladder[0], ladder[-1]) == (28, 0.0, front.lambda_w[-1])
    assert (np.diff(ladder) > 0).all()
    times_s = solve_front(front.section, lambda_w=ladder).ladder_times_s()
    buffers = times_s / times_s[-1] - 1
    assert (np.diff(times_s) <= 1e-6).all()
    assert buffers[2] == pytest.approx(LONGEST_BUFFER_RATIO, rel=0.1)
    assert buffers[-2] == pytest.approx(SHORTEST_BUFFER_RATIO, rel=0.5)


def test_the_same_section_gives_the_same_bytes(folder: Path, section: Section) -> None:
    again = make_table(section, SETTINGS, threads=2)
    assert {name: (folder / name).read_bytes() for name in again} == again


def test_trajectories_are_refined_and_some_are_proven(section: Section, front: Front) -> None:
    """Less energy than the runs of the front, in no more time; the bound is below; a budget of 0 s refines none."""
    settings = replace(SETTINGS, with_max=False, refine_s=math.inf, proven=2)
    manifest = json.loads(make_table(section, settings)["manifest.json"])
    runs = manifest["trajectories"]
    assert manifest["refine"] == "on"
    assert "refinement" in manifest["inputs_sha256"]
    fastest, *others = [front.trajectory(front.fastest().time_s * (1 + buffer / 100)) for buffer in BUFFERS]
    assert (runs[0]["refinement_saved_j"], runs[0]["energy_input_j"]) == (0.0, fastest.balance.input)
    for run, before in zip(runs[1:], others, strict=True):
        assert run["time_s"] <= before.time_s
        assert run["energy_input_j"] < before.balance.input
        assert run["refinement_saved_j"] == pytest.approx(before.balance.input - run["energy_input_j"])
    proven = [run for run in runs if run["gap_ratio"] is not None]
    assert [run["buffer_percent"] for run in proven] == [BUFFERS[1], BUFFERS[-1]]
    assert all(0 <= run["gap_ratio"] < 1e-3 and run["gap_reason"] == "" for run in proven)
    assert {run["gap_reason"] for run in runs if run["gap_ratio"] is None} == {NOT_PROVEN}

    ticks = itertools.count(step=10.0)
    halted = make_table(section, replace(settings, refine_s=5.0, proven=0), stopwatch=lambda: next(ticks))
    manifest = json.loads(halted["manifest.json"])
    assert manifest["refine"] == "5"
    assert {run["refinement_saved_j"] for run in manifest["trajectories"]} == {0.0}


def test_a_table_refined_by_other_code_is_built_again(copied: Path) -> None:
    """A node does not mind: it uses the policies."""
    seal_anew(copied, lambda manifest: manifest["inputs_sha256"].update(refinement="0" * 64))
    with pytest.raises(TableError, match="refined by other code; build it again"):
        Table.open(copied).verify()
    assert not differing_parts(
        Table.open(copied).manifest["inputs_sha256"], with_code(hashes_of(build_section(line(), train())))
    )


def test_writing_that_fails_leaves_what_was_there(
    folder: Path, copied: Path, section: Section, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def full_disk(handle: int) -> None:
        calls.append(handle)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(writing.os, "fsync", full_disk)
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(DasError, match=r"cannot be written .No space left"):
        write_table(copied, files)
    assert [path.name for path in copied.parent.iterdir()] == ["table"]
    Table.open(copied).verify()


def test_writing_replaces_a_table(copied: Path, folder: Path) -> None:
    os.truncate(copied / "value_j.npy", 1000)
    write_table(copied, {path.name: path.read_bytes() for path in folder.iterdir()})
    Table.open(copied).verify()
    assert [path.name for path in copied.parent.iterdir()] == ["table"]


@pytest.mark.slow
def test_a_31_km_section_fits_into_15_mb() -> None:
    """With the 41 trajectories and the least-energy run that a table holds by default."""
    route = load_route(str(track_path("CH_Fribourg_Bern")))
    vehicle = load_vehicle(str(train_path("CH_Stadler_FLIRT_TPF")))
    files = make_table(build_section(route, vehicle), TableSettings(refine_s=0.0, proven=0), threads=2)
    manifest = json.loads(files["manifest.json"])
    assert len(manifest["trajectories"]) == 42
    assert all(run["feasible"] for run in manifest["trajectories"])
    assert sum(map(len, files.values())) <= 15e6
