"""Writing tables: the ladder that is kept, the same bytes again, and disks that are full."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from das.domain.errors import DasError
from das.domain.files import writing
from das.domain.files.load import load_route, load_vehicle
from das.solver.front import Front
from das.solver.section import Section, build_section
from das.solver.solve import solve_front
from das.table.reading import Table
from precompute.tables.writing import (
    LONGEST_BUFFER_RATIO,
    SHORTEST_BUFFER_RATIO,
    make_table,
    table_ladder,
    write_table,
)
from tests.support.benchmark import track_path, train_path
from tests.support.small_tables import SETTINGS, line, train


@pytest.fixture(scope="module")
def section() -> Section:
    return build_section(line(), train())


@pytest.fixture(scope="module")
def front(section: Section) -> Front:
    return solve_front(section)


@pytest.fixture(scope="module")
def folder(section: Section, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tables") / "table"
    write_table(path, make_table(section, SETTINGS))
    return path


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
    files = make_table(build_section(route, vehicle), threads=2)
    manifest = json.loads(files["manifest.json"])
    assert len(manifest["trajectories"]) == 42
    assert all(run["feasible"] for run in manifest["trajectories"])
    assert sum(map(len, files.values())) <= 15e6
