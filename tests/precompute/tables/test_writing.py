"""Writing tables: the same bytes again, a front that is refined and proven, and a size that fits a cab."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from das.domain.files.load import load_route, load_vehicle
from das.solver.front import Front
from das.solver.section import Section, build_section
from precompute.tables.writing import NOT_PROVEN, TableSettings, front_facts, make_table
from tests.support.benchmark import track_path, train_path
from tests.support.small_tables import BUFFERS, SETTINGS, quick_references


def test_the_same_section_gives_the_same_bytes(made: Path, section: Section) -> None:
    with quick_references():
        assert made.read_bytes() == make_table(section, SETTINGS, threads=2)


def test_the_front_is_refined_and_some_of_it_is_proven(section: Section, front: Front) -> None:
    """Less energy than the runs of the front, in no more time; the bound is below."""
    settings = replace(SETTINGS, with_max=False, refined=True, proven=2)
    table = front_facts(section, settings)
    runs = table["front"]
    assert table["settings"]["refine"] == "on"
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


@pytest.mark.nightly
def test_a_31_km_section_fits_into_half_a_megabyte() -> None:
    """With the 41 buffers and the least energy that a table holds by default."""
    route = load_route(str(track_path("CH_Fribourg_Bern")))
    vehicle = load_vehicle(str(train_path("CH_Stadler_FLIRT_TPF")))
    content = make_table(build_section(route, vehicle), TableSettings(refined=False, proven=0), threads=2)
    table = json.loads(content)
    assert len(table["front"]) == 42
    assert len(table["references"]) > 100
    assert len(content) <= 500_000
