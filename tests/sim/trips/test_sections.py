"""A trip with stops on the way is compared section by section; what the sections took above it is that of the trip."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from das.bus import das_pb2
from das.domain.route import Stop
from das.domain.units import KMH
from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solve import solve_front
from sim.drive.above_optimum import AboveOptimum, EnergyBand, SectionEnergy, likely_band, range_above
from sim.trips.estimate import estimate_run
from sim.trips.profile import to_profile
from sim.trips.trip import DrivenSection, Trip, driven_sections
from tests.support.dirt import Point, on_route
from tests.support.making import flat, make_train

LENGTH_M, MIDDLE_M, DWELL_S = 8000.0, 3000.0, 45
FIRST_S, SECOND_S = 170.0, 260.0


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trip, Front, list[float]]:
    """The optimum of both sections with a stand between them, as a record once a second; and its energies (J)."""
    ends = flat(LENGTH_M, 120 * KMH)
    first, last = ends.stops
    route = replace(ends, stops=(first, Stop(name="M", position_m=MIDDLE_M), last))
    train = make_train(resistance=(3000.0, 0.0, 12.0))
    points: list[Point] = []
    energies: list[float] = []
    t0 = 0.0
    for start_m, end_m, trip_s in ((0.0, MIDDLE_M, FIRST_S), (MIDDLE_M, LENGTH_M, SECOND_S)):
        best = solve_front(build_section(route, train, start_m=start_m, end_m=end_m)).trajectory(trip_s)
        run, t = best.trajectory, np.arange(0.0, trip_s + 1.0)
        rows = zip(t, np.interp(t, run.t_s, run.s_m), np.interp(t, run.t_s, run.v_mps), strict=True)
        points += [Point(t0 + float(a), float(b), float(c)) for a, b, c in rows]
        points += [Point(t0 + trip_s + i, end_m, 0.0) for i in range(1, DWELL_S)]
        energies.append(best.ledger.input)
        t0 += trip_s + DWELL_S
    trip = on_route(tmp_path_factory.mktemp("trip"), points, route, positions=True)
    return trip, solve_front(build_section(route, train)), energies


def test_who_drove_both_sections_as_well_as_possible_is_not_above_the_optimum(
    driven: tuple[Trip, Front, list[float]],
) -> None:
    trip, front, energies = driven
    sections = driven_sections(trip, front)
    assert [(one.start, one.end) for one in sections] == [(trip.start.name, "M"), ("M", trip.end.name)]
    assert [one.trip_s for one in sections] == pytest.approx([FIRST_S, SECOND_S], abs=2.0)
    above = range_above(sections)
    likely = likely_band(above.estimate_j, above.unknowns)
    assert abs(above.estimate_j) < 0.015 * sum(energies)
    assert above.low_j <= likely.low_j <= above.estimate_j <= likely.high_j <= above.high_j
    through = front.trajectory(float(trip.run.time_s[-1])).ledger.input
    assert through < 0.9 * sum(energies)  # the optimum that does not stop would have claimed a saving that nobody had


def test_what_is_recorded_above_the_optimum_is_the_sum_of_its_sections(driven: tuple[Trip, Front, list[float]]) -> None:
    trip, front, _ = driven
    sections = driven_sections(trip, front)

    def driven_j(one: DrivenSection) -> float:
        run = to_profile(one.matched)
        return estimate_run(one.front.section, run.time_s, run.s_m, run.speed_mps).ledger.input

    spread = range_above(sections)
    found = AboveOptimum(
        sections=tuple(
            SectionEnergy.of(one.start, one.end, one.trip_s, driven_j(one), one.front.trajectory(one.trip_s))
            for one in sections
        ),
        measured=False,
        likely=likely_band(spread.estimate_j, spread.unknowns),
        worst=EnergyBand(spread.low_j, spread.high_j),
    )
    message = das_pb2.Saving.FromString(found.message(7).SerializeToString())
    assert (message.time_ns, message.measured, message.comparable) == (7, False, True)
    assert message.driven_j == pytest.approx(math.fsum(one.driven_j for one in message.sections))
    assert message.optimum_j == pytest.approx(math.fsum(one.optimum_j for one in message.sections))
    assert message.driven_j - message.optimum_j == pytest.approx(spread.estimate_j, abs=1.0)
    assert message.worst_low_j <= message.likely_low_j <= message.likely_high_j <= message.worst_high_j
    untold = replace(found, why_not="why", likely=None, worst=None).message(7)
    assert not untold.comparable
    assert math.isnan(untold.likely_low_j)


def test_a_trip_without_stops_on_the_way_is_one_section(driven: tuple[Trip, Front, list[float]]) -> None:
    trip, front, _ = driven
    other = replace(trip.route, stops=(trip.route.stops[0], trip.route.stops[-1]))
    (only,) = driven_sections(replace(trip, route=other), front)
    assert only.front is front
    assert only.matched is trip.matched
