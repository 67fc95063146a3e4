"""Polishing: what is driven and held in the same order, at no higher cost, from any state, and every brake said."""

from __future__ import annotations

from itertools import groupby, pairwise

import numpy as np
import pytest

from das.solver.few_switch.few_switch import NotchRegime
from das.solver.few_switch.phases import BRAKES, Phase
from das.solver.few_switch.schedule import Scheduled
from das.solver.few_switch.scheduling import polished, polished_thoroughly, scheduled
from das.solver.few_switch.settings import PolishSettings
from tests.support.few_switch import BUFFERS, BUNDLED, Which, few_switch_of, front_of, schedules, section_of

pytestmark = pytest.mark.slow


def stretches(phases: tuple[Phase, ...]) -> list[str]:
    """In which order the train is driven and coasts; limits may bring brakes and other speeds in between."""
    kinds = ["coasts" if one.kind is NotchRegime.COAST else "driven" for one in phases if one.kind not in BRAKES]
    return [kind for kind, _ in groupby(kinds)]


def check(before: Scheduled, after: Scheduled, time_s: float, s_m: float, v_mps: float) -> None:
    """What polishing may do, and what not: it costs no more than with all brakes said and nothing else changed."""
    said = before.as_run(s_m, v_mps)
    assert after.cost_j(time_s) <= said.cost_j(time_s)
    assert after.lambda_w == before.lambda_w
    assert stretches(after.schedule.phases) == stretches(said.schedule.phases)
    assert all(0.2 <= one.share <= 1.0 for one in after.schedule.phases if one.share > 0.0)
    begins = [one.begin for one in after.schedule.phases]
    assert all(a < b for a, b in pairwise(begins))
    assert begins[-1] < len(after.schedule.section.step_m)
    assert after.forecast.unsaid_s <= 1.5


@pytest.mark.parametrize("which", BUNDLED)
@pytest.mark.parametrize("buffer_ratio", BUFFERS)
def test_polishing_never_costs_more_and_keeps_what_is_driven(which: Which, buffer_ratio: float) -> None:
    asked = schedules(which, buffer_ratio)
    check(asked.scheduled, asked.polished, asked.time_s, section_of(which).start_m, 0.0)


def test_polishing_is_of_use() -> None:
    """Somewhere it saves something; else it could be left out."""
    saved = [
        1.0 - asked.polished.cost_j(asked.time_s) / asked.scheduled.cost_j(asked.time_s)
        for asked in (schedules(which, buffer) for which in BUNDLED for buffer in BUFFERS)
    ]
    assert max(saved) > 1e-3


@pytest.mark.parametrize("which", BUNDLED)
def test_from_under_way_what_lies_behind_stays_where_it_is(which: Which) -> None:
    """Random states and times, from too little to far too much."""
    front, section, random = few_switch_of(which), section_of(which), np.random.default_rng(11)
    for _ in range(6):
        s_m = float(random.uniform(section.start_m + 500.0, section.end_m - 2000.0))
        v_mps = float(np.interp(s_m, section.node_m, section.envelope_mps) * random.uniform(0.2, 0.95))
        left_s = float(random.uniform(0.9, 1.4)) * front_of(which).least_time_s(s_m, v_mps)
        before = scheduled(front, left_s, s_m, v_mps)
        after = polished(before, left_s, s_m, v_mps)
        check(before, after, left_s, s_m, v_mps)
        assert after.schedule.phases[0].begin == before.schedule.phases[0].begin


def test_without_steps_nothing_is_moved() -> None:
    asked = schedules(BUNDLED[0], 0.15)
    found = asked.scheduled
    still = polished(found, asked.time_s, 0.0, 0.0, PolishSettings(steps_m=(), steps_mps=(), steps_share=()))
    assert still.schedule.phases == found.schedule.phases


def test_polishing_thoroughly_is_never_worse_and_somewhere_better() -> None:
    gains = []
    for which in BUNDLED[1:3]:
        asked, start_m = schedules(which, 0.08), section_of(which).start_m
        found = polished_thoroughly(asked.scheduled, asked.time_s, start_m, 0.0)
        gains.append(1.0 - found.cost_j(asked.time_s) / asked.polished.cost_j(asked.time_s))
    assert min(gains) >= 0.0
    assert max(gains) > 2e-4


def test_polishing_twice_gives_little_more() -> None:
    """A second round saves less than a hundredth."""
    asked = schedules(BUNDLED[2], 0.08)
    again = polished(asked.polished, asked.time_s, section_of(BUNDLED[2]).start_m, 0.0)
    assert 0.99 <= again.cost_j(asked.time_s) / asked.polished.cost_j(asked.time_s) <= 1.0
