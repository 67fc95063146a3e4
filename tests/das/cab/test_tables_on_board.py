"""Tables on board are used if they are sound and made for the section; otherwise it is solved."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from das.advice.advice import Source
from das.cab.fronts import Fronts
from das.domain.braking import SiteBraking
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.solver.section import build_section
from das.table.reading import read_front
from precompute.tables.writing import TableSettings, make_table, write_table
from tests.support.small_tables import seal_anew
from tests.support.small_trips import LINE, TRAIN, at, planned_section, train, trip


@pytest.fixture(scope="module")
def made_tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    settings = TableSettings(buffers_percent=(0.0, 10.0), refine_s=0.0, proven=0)
    write_table(folder / "a-b", make_table(planned_section(TRAIN, 5000.0), settings))
    return folder


@pytest.fixture
def tables(made_tables: Path, tmp_path: Path) -> Path:
    shutil.copytree(made_tables, tmp_path / "tables")
    return tmp_path / "tables"


def test_a_table_answers_where_its_hash_matches(tables: Path) -> None:
    made = trip(Fronts(tables, threads=1))
    by_table, solved = at(made, 60, 1500.0, 24.0), at(trip(), 60, 1500.0, 24.0)
    assert by_table.source is Source.TABLE
    assert by_table.energy_to_go_j == pytest.approx(solved.energy_to_go_j, rel=5e-3)
    assert at(made, 400, 6000.0, 24.0).source is Source.SOLVED
    missing = f"{tables}: no table of {made.leg.section.name}; solved instead"
    assert {news.text for news in made.take_news()} == {"A – B: from a table", missing, "B – C: solved"}
    # A restriction makes another section of it; lifted, the table serves again.
    made = trip(Fronts(tables, threads=1))
    made.set_restrictions([Restriction(start_m=2000.0, end_m=2500.0, limit_mps=12.0)])
    assert at(made, 60, 1500.0, 24.0).source is Source.SOLVED
    assert any("other line; solved instead" in news.text for news in made.take_news())
    made.set_restrictions([])
    assert at(made, 61, 1524.0, 24.0).source is Source.TABLE
    # The service braking is part of what a table was made for.
    made = trip(Fronts(tables, threads=1), braking=SiteBraking(deceleration_mps2=0.3))
    assert at(made, 60, 1500.0, 24.0).source is Source.SOLVED
    assert any("other braking; solved instead" in news.text for news in made.take_news())


def test_a_folder_without_tables_is_said(tmp_path: Path) -> None:
    assert Fronts(tmp_path).notes == [f"{tmp_path}: no table in this folder"]


def test_of_tables_for_other_trains_too_only_the_nearest_is_named(tables: Path) -> None:
    settings = TableSettings(buffers_percent=(0.0,), refine_s=0.0, proven=0)
    heavy = replace(train(1.3e5), id="heavy")
    write_table(tables / "a-b-heavy", make_table(planned_section(heavy, 5000.0), settings))
    made = trip(Fronts(tables, threads=1))
    made.set_restrictions([Restriction(start_m=2000.0, end_m=2500.0, limit_mps=12.0)])
    at(made, 60, 1500.0, 24.0)
    (text,) = (news.text for news in made.take_news() if news.bad and "no table" not in news.text)
    assert text == f"{tables / 'a-b'}: not the table of {made.leg.section.name}: other line; solved instead"


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-8])


def alter(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-100] ^= 1
    path.write_bytes(bytes(content))


def other_schema(path: Path) -> None:
    path.write_text(path.read_text().replace('"schema_version": 3', '"schema_version": 99'))


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def entry(value: Any, *keys: str) -> Callable[[Path], None]:
    """Damage that gives an entry of a manifest another value, sealed with a right checksum."""

    def change(manifest: dict[str, Any]) -> None:
        for key in keys[:-1]:
            manifest = manifest[key]
        manifest[keys[-1]] = value

    return lambda path: seal_anew(path.parent, change)


SHAPE = ("arrays", "value_j", "shape")


@pytest.mark.parametrize(
    ("name", "damage", "text"),
    [
        (
            "manifest.json",
            entry([10**9] * 3, *SHAPE),
            f"value_j.shape = {[10**9] * 3}: expected [",
        ),
        (
            "manifest.json",
            entry(None, "section", "start_m"),
            "section.start_m = None: expected a finite number",
        ),
        ("manifest.json", pipe, "manifest.json: is not a regular file; not used"),
        ("value_j.npy", pipe, "value_j.npy: is not a regular file; not used"),
        ("manifest.json", entry("0" * 64, "inputs_sha256", "code"), "a-b: made by other solver code; solved instead"),
        ("value_j.npy", cut, "was it cut?; not used"),
        ("value_j.npy", alter, "was altered since it was written; solved instead"),
        ("grid.npy", alter, "grid.npy: was altered since it was written; solved instead"),
        ("manifest.json", alter, "altered since it was written; not used"),
        ("manifest.json", other_schema, "schema_version = 99: expected 3; not used"),
        ("run_s_m.npy", Path.unlink, "is missing; not used"),
    ],
)
def test_a_table_that_cannot_be_trusted_is_refused_and_solved_instead(
    tables: Path, name: str, damage: Any, text: str
) -> None:
    damage(tables / "a-b" / name)
    made = trip(Fronts(tables, threads=1))
    assert at(made, 60, 1500.0, 24.0).source is Source.SOLVED
    assert any(news.bad and text in news.text for news in made.take_news())


def test_a_table_damaged_while_in_use_cannot_reach_the_advice(tables: Path) -> None:
    front = read_front(tables / "a-b", planned_section(TRAIN, 5000.0))
    before = front.trajectory(300.0).balance.input
    for path in (tables / "a-b").glob("*.npy"):
        with path.open("r+b") as file:
            file.truncate(100)
    assert front.trajectory(300.0).balance.input == before


def test_fronts_are_kept_up_to_a_size_the_last_one_always() -> None:
    fronts = Fronts(threads=1, kept_bytes=1)
    sections = [build_section(LINE, TRAIN, end_m=end_m) for end_m in (5000.0, 4000.0)]
    first = fronts.find(sections[0])
    assert fronts.find(build_section(LINE, TRAIN, end_m=5000.0)) is first
    fronts.find(sections[1])
    assert fronts.find(sections[0]) is not first


def test_no_folder_of_tables_is_an_error() -> None:
    with pytest.raises(DasError, match="no such folder of tables"):
        Fronts(Path("/nowhere"))


def test_for_a_train_under_way_only_what_is_ahead_is_solved() -> None:
    section, whole = build_section(LINE, TRAIN), Fronts(threads=1)
    fronts = Fronts(threads=1)
    under_way = fronts.find(section, 3_500.0).front
    assert under_way.sweep is not None
    known_from = under_way.sweep.known_from
    assert 2_300.0 < section.node_m[section.decision[known_from]] <= 2_600.0
    for s_m in (3_500.0, 2_600.0):
        found = fronts.find(build_section(LINE, TRAIN), s_m).front
        assert found is under_way
        expected = whole.find(section).front.trajectory(400.0, s_m, 20.0)
        assert found.trajectory(400.0, s_m, 20.0).balance.input == expected.balance.input
    assert under_way.sweep.known_from == known_from
    # The leg is driven once more from its begin: the same front is solved to its begin.
    assert fronts.find(section, 0.0).front is under_way
    assert under_way.sweep.known_from == 0
