"""Tables on board lead a departure if they are sound and made for the section; otherwise its reference is solved."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from das.advice.advice import Source, Timetable
from das.advice.guide.keeping import StandingReference
from das.advice.regimes import Regime
from das.cab.preparation import Fronts
from das.domain.braking import SiteBraking
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.solver.section import build_section
from das.table import METHOD, section_facts, table_name
from precompute.tables.writing import TableSettings, make_table
from tests.support.small_tables import quick_references, seal_anew
from tests.support.small_trips import LINE, TRAIN, SmallTrip, at, ns, planned_section, trip

DUE = [Timetable(departure_ns=ns(0), arrival_ns=ns(225)), Timetable(departure_ns=ns(330), arrival_ns=ns(590))]
SOLVED = "references are solved instead"


@pytest.fixture(scope="module")
def made_tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, section = tmp_path_factory.mktemp("tables"), planned_section(TRAIN, 5000.0)
    settings = TableSettings(buffers_percent=(0.0, 10.0), refined=False, proven=0)
    with quick_references():
        (folder / table_name(section_facts(section))).write_bytes(make_table(section, settings))
    return folder


@pytest.fixture
def tables(made_tables: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made_tables, tmp_path / "tables"))


@pytest.fixture
def table(tables: Path) -> Path:
    (path,) = tables.iterdir()
    return path


def led(tables: Path | None, **more: Any) -> SmallTrip:
    return trip(Fronts(tables, threads=1), guide=True, due=DUE, **more)


def reference(made: SmallTrip) -> StandingReference | None:
    """What the guide leads by."""
    assert made.leg.guide is not None
    return made.leg.guide.keeper.reference


def test_a_departure_is_led_by_its_table_and_the_rest_of_the_way_is_solved(tables: Path) -> None:
    made = led(tables)
    departing = at(made, 0, 0.0, 0.0)
    assert departing.source is Source.TABLE
    assert departing.guide is not None
    assert departing.guide.now.mode is Regime.DEPART
    guide = made.preparation._fronts.find_guide(made.leg.section).front
    assert guide.nbytes == 0  # no policy was needed
    solved = led(None)
    at(solved, 0, 0.0, 0.0)
    by_table, own = reference(made), reference(solved)
    assert by_table is not None
    assert own is not None
    assert (by_table.finished, own.finished) == (True, False)
    made.leg.set_timetable(Timetable(departure_ns=ns(0), arrival_ns=ns(260)))
    assert at(made, 60, 1500.0, 24.0).source is Source.SOLVED
    assert guide.nbytes > 0
    assert at(made, 400, 6000.0, 24.0).source is Source.SOLVED
    missing = f"{tables}: no table of {made.leg.section.name}; {SOLVED}"
    assert {news.text for news in made.take_news()} == {
        "A – B: solved", "A – B: references from a table", "B – C: solved", missing,
    }  # fmt: skip


def test_a_departure_does_not_wait_for_the_worker(tables: Path) -> None:
    """The thread that plans is busy: a table answers at once, and without one there is no reference yet."""
    for folder, source in ((tables, Source.TABLE), (None, Source.SOLVED)):
        made, go = led(folder, background=True), Event()
        at(made, -20, 0.0, 0.0)
        while made.searching:
            at(made, -10, 0.0, 0.0)
        busy = made.preparation.guide_worker.submit(go.wait)
        departing = at(made, 0, 0.0, 0.0)
        assert departing.source is source
        assert (reference(made) is not None) is (source is Source.TABLE)
        go.set()
        busy.result()
        made.close()


def test_a_restriction_or_another_braking_makes_another_section_of_it(tables: Path) -> None:
    made = led(tables)
    made.set_restrictions([Restriction(start_m=2000.0, end_m=2500.0, limit_mps=12.0)])
    assert at(made, 0, 0.0, 0.0).source is Source.SOLVED
    assert any(f"settings have changed; {SOLVED}" in news.text for news in made.take_news())
    made.set_restrictions([])
    assert at(made, 1, 0.0, 0.0).source is Source.TABLE
    made = led(tables, braking=SiteBraking(deceleration_mps2=0.3))
    assert at(made, 0, 0.0, 0.0).source is Source.SOLVED
    assert any(f"no table of {made.leg.section.name}; {SOLVED}" in news.text for news in made.take_news())


def test_a_folder_without_tables_or_with_old_ones_is_said(tmp_path: Path) -> None:
    assert Fronts(tmp_path).notes == [f"{tmp_path}: no table in this folder"]
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "manifest.json").write_text("{}")
    said = f"{tmp_path}: tables of an earlier release, no longer usable; build them again"
    assert Fronts(tmp_path).notes == [said]


def alter(path: Path) -> None:
    path.write_text(path.read_text().replace('"traction"', '"coast"', 1))


def other_method(path: Path) -> None:
    seal_anew(path, lambda body: body.update(method=0))


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("damage", "text"),
    [
        (pipe, "not a regular file"),
        (other_method, f"method = 0: expected {METHOD}; build the table again"),
        (lambda path: seal_anew(path, lambda body: body.update(key="x")), "settings have changed"),
        (lambda path: path.write_bytes(path.read_bytes()[:-8]), "not valid JSON"),
        (alter, "was altered since it was written"),
    ],
)
def test_a_table_that_cannot_be_trusted_is_refused_and_solved_instead(table: Path, damage: Any, text: str) -> None:
    damage(table)
    made = led(table.parent)
    assert at(made, 0, 0.0, 0.0).source is Source.SOLVED
    assert any(news.bad and text in news.text and news.text.endswith(SOLVED) for news in made.take_news())


def test_a_table_damaged_while_in_use_cannot_reach_the_advice(table: Path) -> None:
    made = led(table.parent)
    at(made, -20, 0.0, 0.0)
    os.truncate(table, 100)
    assert at(made, 0, 0.0, 0.0).source is Source.TABLE


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
    under_way = fronts.find(section, 3_500.0)
    assert under_way.sweep is not None
    known_from = under_way.sweep.known_from
    assert 2_300.0 < section.node_m[section.decision[known_from]] <= 2_600.0
    for s_m in (3_500.0, 2_600.0):
        found = fronts.find(build_section(LINE, TRAIN), s_m)
        assert found is under_way
        expected = whole.find(section).trajectory(400.0, s_m, 20.0)
        assert found.trajectory(400.0, s_m, 20.0).balance.input == expected.balance.input
    assert under_way.sweep.known_from == known_from
    # The leg is driven once more from its begin: the same front is solved to its begin.
    assert fronts.find(section, 0.0) is under_way
    assert under_way.sweep.known_from == 0
