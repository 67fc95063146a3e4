"""States of a train, its fastest run from there without a front, and sections with a lower envelope."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from das.domain.errors import DasError, InfeasibleError
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section, capped
from das.solver.solution import Fit
from das.solver.state import fastest, least_time_s
from tests.support.making import flat, make_route, make_train


@pytest.fixture
def section(hilly: Front) -> Section:
    return hilly.section


def test_the_fastest_run_without_resistance_takes_twice_the_root_of_the_way() -> None:
    # a = F/m = 1 m/s², half of the way accelerating and half braking: t = 2·√(s/a), v_max = √(s·a).
    run = fastest(build_section(flat(1_000.0), make_train()))
    assert run.time_s == pytest.approx(2 * np.sqrt(1_000.0), rel=1e-3)
    assert run.trajectory.v_mps.max() == pytest.approx(np.sqrt(1_000.0), rel=2e-2)
    assert (run.fit, run.requested_s, run.least_time_s) == (Fit.ON_TIME, run.time_s, run.time_s)
    assert run.gap_ratio == 0.0
    assert run.feasible


def test_a_front_gives_the_same_fastest_run_and_times(hilly: Front, section: Section) -> None:
    for state in ((None, None), (3_100.0, 20.0), (8_765.4, 12.3), (4_400.0, 35.0)):
        own, other = fastest(section, *state), hilly.fastest(*state)
        assert np.array_equal(own.trajectory.v_mps, other.trajectory.v_mps)
        late = hilly.trajectory(1.0, *state)
        assert (late.time_s, late.fit) == (own.time_s, Fit.LATE)
    assert hilly.least_time_s(3_100.0, 20.0) == least_time_s(section, 3_100.0, 20.0)


@pytest.mark.parametrize("speed_ratio", [0.0, 0.4, 0.95, 1.0, 1.2])
def test_the_least_time_is_that_of_the_fastest_run(section: Section, speed_ratio: float) -> None:
    for s_m in (0.0, 1.0, 2_900.0, 4_499.0, 7_777.7, 11_900.0):
        v_mps = speed_ratio * float(np.interp(s_m, section.node_m, section.envelope_mps))
        assert least_time_s(section, s_m, v_mps) == pytest.approx(fastest(section, s_m, v_mps).time_s, abs=1e-9)


def test_the_least_time_is_that_of_the_whole_section_at_its_start() -> None:
    section = build_section(flat(3_000.0, 30.0), make_train(), options=SectionOptions(start_speed_mps=10.0))
    assert least_time_s(section, 0.0, 10.0) == pytest.approx(fastest(section).time_s, abs=1e-9)
    assert least_time_s(section, 0.0, 0.0) > least_time_s(section, 0.0, 10.0) + 1.0


def test_a_capped_section_is_driven_below_the_cap(section: Section) -> None:
    below = capped(section, 15.0)
    assert (below.envelope_mps == np.maximum(np.minimum(section.envelope_mps, 15.0), section.floor_mps)).all()
    run = fastest(below)
    assert run.trajectory.v_mps.max() <= 15.0
    assert run.time_s > fastest(section).time_s + 100.0
    falling = np.linspace(40.0, 5.0, len(section.node_m))
    assert (fastest(capped(section, falling)).trajectory.v_mps <= falling + 1e-9).all()
    assert np.array_equal(capped(section, 100.0).envelope_mps, section.envelope_mps)


def test_a_cap_below_the_floor_leaves_the_floor() -> None:
    """A hill of 120 permil needs a run-up: a cap of 5 m/s may not take it away."""
    route = make_route(6_000.0, [(0.0, 30.0)], [(0.0, 0.0), (4_200.0, 0.12), (4_500.0, 0.0)])
    section = build_section(route, make_train(resistance=(2_000.0, 0.0, 10.0)))
    below = capped(section, 5.0)
    assert section.floor_mps.max() > 10.0
    assert (below.envelope_mps >= section.floor_mps).all()
    assert below.envelope_mps.max() == section.floor_mps.max()


def test_a_changed_section_knows_its_own_fastest_run(section: Section) -> None:
    """The run that a section keeps may not go along into a section with another envelope."""
    before_s = least_time_s(section, 100.0, 10.0)
    slow = replace(section, envelope_mps=np.maximum(np.minimum(section.envelope_mps, 12.0), section.floor_mps))
    assert least_time_s(slow, 100.0, 10.0) == pytest.approx(fastest(slow, 100.0, 10.0).time_s, abs=1e-9)
    assert least_time_s(slow, 100.0, 10.0) > before_s + 100.0
    assert least_time_s(section, 100.0, 10.0) == before_s
    assert slow.fastest_run.time_to_go_s[0] == pytest.approx(fastest(slow).time_s)


@pytest.mark.parametrize(
    "state", [(-1.0, 5.0), (12_000.0, 5.0), (np.nan, 5.0), (100.0, -1.0), (100.0, 200.0), (100.0, np.nan)]
)
def test_a_state_that_no_train_has_on_the_section_is_refused(section: Section, state: tuple[float, float]) -> None:
    with pytest.raises(DasError, match="expected one"):
        fastest(section, *state)
    with pytest.raises(DasError, match="expected one"):
        least_time_s(section, *state)


def test_a_train_that_stalls_is_said_to() -> None:
    route = make_route(6_000.0, [(0.0, 30.0)], [(0.0, 0.0), (4_200.0, 0.12), (4_500.0, 0.0)])
    section = build_section(route, make_train(resistance=(2_000.0, 0.0, 10.0)))
    for call in (fastest, least_time_s):
        with pytest.raises(InfeasibleError, match=r"the train stalls after 4190\.0 m from 7\.2 km/h"):
            call(section, 4_190.0, 2.0)
