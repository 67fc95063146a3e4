"""The scripts of the coach's page: what they measure, on a short line."""

from __future__ import annotations

import math
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

import sim
from das.advice.advice import ReplanCause
from das.domain.errors import DasError
from das.domain.units import KMH
from docs.studies.coach import (
    DELAYS_S,
    DRIVERS,
    EFFORT_ERROR,
    GLANCES_S,
    PAGE,
    WITHOUT_DEAD_ZONE,
    LoopDriver,
    driver_table,
    keeping_table,
    measured,
)
from docs.studies.coach_days import draw_day, shown_seconds
from docs.studies.driving import KEEPING, WatchedRun, watched_run
from docs.studies.output import write_table
from sim.drivers.kinds import Presentation
from sim.experiment.factors import study_days
from sim.world.scenario import load_scenario
from sim.world.service import Service, prepare_service

SCENARIO = str(study_days()["flat-6km"])


@pytest.fixture(scope="module")
def service() -> Service:
    return prepare_service(load_scenario(SCENARIO))


@pytest.fixture(scope="module")
def coached(service: Service) -> WatchedRun:
    """A run of a driver who is led by the coach."""
    return watched_run(service, 1, Presentation.COACH, human=LoopDriver(2.0, 5.0).human)


def test_every_driver_of_the_grid_can_be() -> None:
    for delay_s, glance_s in product(DELAYS_S, GLANCES_S):
        human = LoopDriver(delay_s, glance_s).human
        assert (human.reaction_median_s, human.glance_mean_s) == (delay_s, glance_s)
        assert (human.force_error_ratio, human.lapses_per_h) == (EFFORT_ERROR, 0.0)


def test_a_run_keeps_what_was_said_and_the_driver_is_measured_against_the_reference(coached: WatchedRun) -> None:
    for state, (advice, _) in zip(coached.run.states, coached.watched, strict=False):
        if state.speed_mps > 5.0:
            assert advice.s_m == pytest.approx(state.s_m, abs=30.0)
    found = measured([coached])
    pairs = zip(coached.run.states, coached.watched, strict=False)
    errors = np.array([s.speed_mps - w.reference_mps for s, w in pairs if s.speed_mps > 0.5])
    errors = errors[np.isfinite(errors)]
    assert found.rms_mps == pytest.approx(math.sqrt(float((errors**2).mean())))
    assert found.rms_mps < 10.0 * KMH
    assert found.changes == coached.run.stability.changes
    assert ReplanCause.START not in coached.replans.values()
    assert sum(found.causes.values()) == found.replans == len(coached.replans)


@pytest.mark.more
def test_the_tables_have_a_row_a_driver(service: Service) -> None:
    services = [service]
    settings = {"a": KEEPING, "b": WITHOUT_DEAD_ZONE}
    for table in (driver_table(services, [1], DRIVERS[-2:]), keeping_table(services, [1], settings)):
        lines = list(table)
        assert len(lines) == 4
        assert len({line.count("|") for line in lines}) == 1


@pytest.mark.parametrize("presentation", [Presentation.VECTOR, Presentation.COACH])
def test_the_pictures_show_what_the_driver_saw(service: Service, presentation: Presentation) -> None:
    one = watched_run(service, 1, presentation)
    seconds = shown_seconds(one, presentation)
    assert len(seconds) == sum(state.speed_mps > 0 for state in one.run.states)
    assert [x.at_km for x in seconds] == sorted(x.at_km for x in seconds)
    assert max(x.driven_kmh for x in seconds) <= 165.0
    changes = sum(a.mode is not b.mode for a, b in pairwise(seconds))
    assert 0 < changes <= one.run.stability.changes + 2


@pytest.mark.more
@pytest.mark.slow
def test_a_picture_is_small(tmp_path: Path) -> None:
    path = tmp_path / "day.png"
    draw_day(path, SCENARIO)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size < 150_000


def test_import_sim_shows_the_coach() -> None:
    found = sim.run_day(SCENARIO, 1, driver="perfect", advice="coach").outcome
    assert found["advice_changes_per_min"] is not None
    assert 0.0 < found["advice_changes_per_min"] < 6.0


def test_a_table_is_put_between_its_marks_and_the_page_of_the_coach_has_a_place_for_each(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- one: begin -->\nold\n<!-- one: end -->\nb\n<!-- two: begin -->\n<!-- two: end -->\n")
    write_table(page, "one", ["| 1 |", "| \\2 |"])
    assert page.read_text() == (
        "a\n<!-- one: begin -->\n| 1 |\n| \\2 |\n<!-- one: end -->\nb\n<!-- two: begin -->\n<!-- two: end -->\n"
    )
    with pytest.raises(DasError, match="no marks <!-- three: begin -->"):
        write_table(page, "three", [])
    text = PAGE.read_text(encoding="utf-8")
    for name in ("price", "days", "drivers", "keeping"):
        assert text.count(f"<!-- {name}: begin -->\n|") == text.count(f"|\n<!-- {name}: end -->") == 1
