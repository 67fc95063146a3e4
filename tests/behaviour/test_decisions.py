"""What a driver did and decided can be read from the recording alone, and from the diary of a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from das.bus.das_pb2 import Decision
from das.domain.units import NS
from sim.drive.drive import Drive
from sim.drive.events import EventKind
from sim.drivers.cab import KINDS
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import DriverKind, Presentation
from sim.experiment.driving import drive
from sim.experiment.one_line import DaysAsked
from sim.experiment.trials import trials_of
from sim.world.driving import How, drive_kept
from sim.world.service import make_day
from tests.support.flat_days import service_of

LOOK_S = 0.2
"""A driver looks five times a second; what he notes at a look is exact to the clock of the run."""


def test_the_recording_has_every_decision_at_its_time(flat: Callable[[str], Path]) -> None:
    """In this process; that decisions go over the bus is part of `test_the_recording_is_whole` in `test_world.py`."""
    service = service_of(flat("[human]\nlapses_per_h = 20"))
    day = make_day(service, 3)
    driver = day.driver(DriverKind.HUMAN)
    assert isinstance(driver, HumanDriver)
    how = How(driver=DriverKind.HUMAN, advice=Presentation.SPEED_AND_EFFORT, train="T1", command="test")
    run, table = drive_kept(day, driver, how)
    kept = [one.message for one in table.recording.of("decision")]
    found = [(KINDS[one.kind - 1], one.value) for one in kept]
    last_s = run.states[-1].time_s
    made = [one for one in driver.events if one.time_s < last_s - 1.0]
    assert len(found) >= len(made) > 30
    assert found[: len(made)] == [(one.what, one.value) for one in made]
    times_s = [service.clock_s(one.time_ns) for one in kept[: len(made)]]
    assert times_s == pytest.approx([one.time_s for one in made], abs=10 * NS)
    kinds = {what for what, _ in found}
    assert kinds >= {"glance", "noticed", "reaction", "followed", "acted", "lever"}
    told = [one for one in Drive(recording=table.recording, given=table.given).events if one.kind is EventKind.DRIVER]
    decided = [what for what, _ in found if what in ("followed", "refused")]
    assert [one.facts["followed"] for one in told if "followed" in one.facts] == [
        what == "followed" for what in decided
    ]
    assert sum("away_s" in one.facts for one in told) == sum(what == "lapse" for what, _ in found)
    drawn = [value for what, value in found if what == "reaction"]
    assert {round(one.facts["reaction_s"], 9) for one in told if "reaction_s" in one.facts} <= {
        round(x, 9) for x in drawn
    }
    assert list(Decision.Kind.keys())[1:] == [f"KIND_{name.upper()}" for name in KINDS]


@pytest.mark.slow
def test_the_diaries_of_days_give_back_reactions_and_compliance(flat: Callable[[str], Path]) -> None:
    """A driver who acts at once on what he sees often enough for statistics: 6 days of the 6 km line."""
    path = flat("[human]\nglance_mean_s = 0.5\nglance_least_s = 0.2\nreaction_median_s = 1.0\nlapses_per_h = 0")
    asked = DaysAsked(
        scenarios=[str(path)], drivers=[DriverKind.HUMAN], advice=[Presentation.SPEED_AND_EFFORT], seeds=list(range(6))
    )  # fmt: skip
    diaries = [drive(trial, asked.population).run.decisions for trial in trials_of(asked.design())]
    what = np.array([one.what for diary in diaries for one in diary])
    value = np.array([one.value for diary in diaries for one in diary])
    at = np.flatnonzero(what == "reaction")
    # A reaction to what was announced is shorter, by the share that is noted just before it.
    reactions, times = value[at] / np.where(what[at - 1] == "expected", value[at - 1], 1.0), len(at)
    assert times > 30
    assert (what == "expected").sum() > 5
    # Standard error of a lognormal's median: 1.25 σ / √n of itself.
    assert np.median(reactions) == pytest.approx(1.0, rel=3 * 1.25 * 0.4 / times**0.5)
    followed, refused = (int((what == name).sum()) for name in ("followed", "refused"))
    ratio = followed / (followed + refused)
    assert ratio == pytest.approx(0.89, abs=3 * (0.89 * 0.11 / (followed + refused)) ** 0.5)
    for diary in diaries:
        kinds = [one.what for one in diary]
        decided = kinds.count("followed") + kinds.count("refused")
        assert kinds.count("acted") <= decided + kinds.count("noticed")
