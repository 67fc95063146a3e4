"""The pictures of the coach's page: they show what the driver saw, on a short line."""

from __future__ import annotations

from itertools import pairwise

import pytest

from docs.studies.coach_days import shown_seconds, watched_run
from sim.drivers.kinds import Presentation
from sim.experiment.factors import study_days
from sim.world.scenario import load_scenario
from sim.world.service import Service
from tests.support.flat_days import service_for


@pytest.fixture(scope="module")
def service() -> Service:
    return service_for(load_scenario(str(study_days()["flat-6km"])))


@pytest.mark.parametrize("presentation", [Presentation.VECTOR, Presentation.COACH])
def test_the_pictures_show_what_the_driver_saw(service: Service, presentation: Presentation) -> None:
    one = watched_run(service, 1, presentation)
    for state, advice in zip(one.run.states, one.watched, strict=False):
        if state.speed_mps > 5.0:
            assert advice.s_m == pytest.approx(state.s_m, abs=30.0)
    seconds = shown_seconds(one, presentation)
    assert len(seconds) == sum(state.speed_mps > 0 for state in one.run.states)
    assert [x.at_km for x in seconds] == sorted(x.at_km for x in seconds)
    changes = sum(a.mode is not b.mode for a, b in pairwise(seconds))
    assert 0 < changes <= one.run.stability.changes + 2
