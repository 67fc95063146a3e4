"""Plans of journeys against closed forms, brute force over times and speeds, an independent integrator, and bounds."""

from __future__ import annotations

import itertools
import math
import random
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from das.domain.errors import DasError, InfeasibleError
from das.domain.files.load import load_journey, load_route, load_vehicle
from das.domain.journey import ANY_TIME, Window
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.route import Route, Stop
from das.domain.vehicle import Vehicle
from das.offline.asked_journey import Call, Held, Journey, Passing
from das.offline.chains import SectionFronts, Split
from das.offline.journey import JourneyPlan, JourneyPlanner, SectionPlan
from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.section import SectionOptions, build_section
from das.solver.solve import solve_front
from tests.support.benchmark import journey_path, track_path, train_path
from tests.support.making import csv_rows, flat, make_route, make_train
from tests.support.raw_data import Line, Loss, Train, constant_efficiencies
from tests.support.verifier import verify

KWH = 3.6e6
LOSSES = EfficiencyLoss.from_efficiencies(0.88, 0.85)
TRAIN = make_train(resistance=(1500.0, 20.0, 4.0), power_w=1.5e6, loss=LOSSES)
IDLING = replace(TRAIN, losses={Level.OWN: replace(LOSSES, idle_w=40e3)})
HILLY = make_route(
    9_000.0,
    [(0.0, 30.0), (2_500.0, 22.0), (4_000.0, 35.0), (7_500.0, 25.0)],
    [(0.0, 0.0), (1_000.0, 0.008), (3_000.0, -0.010), (5_000.0, 0.0), (6_000.0, 0.006)],
)


def journey(*points: Call | Passing) -> Journey:
    return Journey(id="test", name="test", source="test", points=points)


def start(latest_s: float = 0.0) -> Call:
    return Call(name="A", position_m=0.0, departure=Window(earliest_s=0.0, latest_s=latest_s))


def end(position_m: float, latest_s: float) -> Call:
    return Call(name="Z", position_m=position_m, arrival=Window(latest_s=latest_s))


def stop(position_m: float, dwell_s: float = 0.0, arrival: Window = ANY_TIME, departure: Window = ANY_TIME) -> Call:
    return Call(name=f"at {position_m:g}", position_m=position_m, arrival=arrival, departure=departure, dwell_s=dwell_s)


@cache
def solved() -> dict[object, SectionFronts]:
    """The fronts of the sections of HILLY, by the places of a journey and the speeds at them."""
    return {}


def planned(*points: Call | Passing, route: Route = HILLY, train: Vehicle = TRAIN) -> JourneyPlan:
    """The plan of a journey over these points; what it solves depends on no time, and is solved once for HILLY."""
    planner = JourneyPlanner(journey(*points), route, train)
    if route is HILLY and train is TRAIN:
        passed = [replace(one, window=ANY_TIME) if isinstance(one, Passing) else None for one in points]
        places = tuple((one.position_m, passing) for one, passing in zip(points, passed, strict=True))
        planner.chains.fronts = solved().setdefault(places, planner.chains.fronts)
    return planner.plan()


def least_s(route: Route, train: Vehicle, *position_m: float) -> list[float]:
    """Least times from stop to stop, each section on its own."""
    return [front(route, train, a, b).fastest().time_s for a, b in pairwise(position_m)]


def front(route: Route, train: Vehicle, start_m: float, end_m: float, end_mps: float = 0.0) -> Front:
    return solve_front(
        build_section(route, train, start_m=start_m, end_m=end_m, options=SectionOptions(end_speed_mps=end_mps))
    )


def events(plan: JourneyPlan) -> list[tuple[Window, float]]:
    """Every window of the plan with its time."""
    result = []
    for section in plan.sections:
        result.append((section.start.departure, section.departure.time_s))
        result += [(x.passing.window, x.timing.time_s) for x in section.passings]
        result.append((section.end.arrival, section.arrival.time_s))
    return result


def assert_kept(plan: JourneyPlan) -> None:
    """Windows, dwells, passing speeds and the energy balance of a plan, from its times and arrays alone."""
    for window, time_s in events(plan):
        assert window.earliest_s - 0.025 <= time_s <= window.latest_s + 0.025
    for before, after in pairwise(plan.sections):
        assert after.departure.time_s - before.arrival.time_s >= before.end.dwell_s - 0.005
    for section in plan.sections:
        run = section.trajectory
        assert section.feasible
        assert (run.s_m[0], run.s_m[-1]) == (section.start.position_m, section.end.position_m)
        assert (run.v_mps[0], run.v_mps[-1]) == (0.0, 0.0)
        assert (np.maximum(run.v_mps[:-1], run.v_mps[1:]) <= run.limit_mps + 1e-6).all()
        assert section.departure.time_s + run.time_s == pytest.approx(section.arrival.time_s, abs=1e-9)
        assert section.balance.residual_ratio < 1e-6
        for x in section.passings:
            assert x.speed_mps == pytest.approx(np.interp(x.passing.position_m, run.s_m, run.v_mps), abs=1e-6)
            lowest = x.passing.lowest_mps * (1 - tol.PASSING_BAND_RATIO)
            assert lowest - 1e-6 <= x.speed_mps <= x.passing.highest_mps + 1e-6
            when_s = section.departure.time_s + np.interp(x.passing.position_m, run.s_m, run.t_s)
            assert x.timing.time_s == pytest.approx(when_s, abs=1e-6)


# --- the split of the time --------------------------------------------------------------------------------------


def test_equal_sections_get_equal_times() -> None:
    route = flat(6_000.0, 30.0)
    plan = planned(start(), stop(3_000.0, 20.0), end(6_000.0, 320.0), route=route)
    assert_kept(plan)
    first, second = (section.trajectory.time_s for section in plan.sections)
    assert first == pytest.approx(150.0, abs=0.05)
    assert second == pytest.approx(150.0, abs=0.05)
    assert plan.sections[0].lambda_w == plan.sections[1].lambda_w


def test_the_split_without_resistance_is_that_of_the_closed_form() -> None:
    """Brakes dissipate, nothing resists: E = m·v²/2, T = s/v + v/a, so dE/dT = m·v/(1/a − s/v²) is to be equal."""
    lengths, mass, a, total_s = (2_000.0, 5_000.0), 1e5, 1.0, 400.0

    def cruise(length: float, time_s: float) -> float:
        return 0.5 * a * (time_s - math.sqrt(time_s**2 - 4 * length / a))

    def marginal(length: float, time_s: float) -> float:
        v = cruise(length, time_s)
        return mass * v / (1 / a - length / v**2)

    first_s = brentq(lambda t: marginal(lengths[0], t) - marginal(lengths[1], total_s - t), 95.0, 200.0)
    energy_j = sum(0.5 * mass * cruise(s, t) ** 2 for s, t in zip(lengths, (first_s, total_s - first_s), strict=True))
    points = (start(), stop(lengths[0], 30.0), end(sum(lengths), total_s + 30.0))
    plan = JourneyPlanner(journey(*points), flat(sum(lengths)), make_train(), level=Level.L0_NOREG).plan()
    assert_kept(plan)
    assert plan.sections[0].trajectory.time_s == pytest.approx(first_s, abs=1.0)
    assert plan.input_j == pytest.approx(energy_j, rel=3e-3)
    assert plan.sections[0].lambda_w[0] == pytest.approx(-marginal(lengths[0], first_s), rel=0.03)


STOPS_M = (0.0, 2_800.0, 5_200.0, 9_000.0)


@pytest.fixture(scope="module")
def tables() -> tuple[list[int], list[np.ndarray]]:
    """Least whole second and energies (J) of the next 70 s for every section of HILLY, each section on its own."""
    firsts, energies = [], []
    for a, b in pairwise(STOPS_M):
        own = front(HILLY, TRAIN, a, b)
        firsts.append(math.ceil(own.fastest().time_s))
        energies.append(np.array([own.trajectory(firsts[-1] + i).balance.input for i in range(70)]))
    return firsts, energies


def brute_force_j(
    tables: tuple[list[int], list[np.ndarray]], windows: Sequence[tuple[float, float]], dwell_s: int, latest_s: int
) -> float:
    """Least energy over all arrivals in whole seconds; `windows`: of the departures from the two stops between."""
    firsts, energies = tables
    best = {0: 0.0}  # energy by the departure time
    for i, (first, energy) in enumerate(zip(firsts, energies, strict=True)):
        arrived: dict[int, float] = {}
        for t, spent in best.items():
            for k, e in enumerate(energy):
                arrived[t + first + k] = min(arrived.get(t + first + k, math.inf), spent + e)
        if i == len(firsts) - 1:
            return min(e for t, e in arrived.items() if t <= latest_s)
        earliest, latest = windows[i]
        best = {}
        for t, e in arrived.items():
            leaves = max(t + dwell_s, math.ceil(max(earliest, 0.0)))
            if leaves <= latest:
                best[leaves] = min(best.get(leaves, math.inf), e)
    raise AssertionError("no sections")


@pytest.mark.parametrize(
    "offsets",
    [
        ((-math.inf, math.inf), (-math.inf, math.inf)),
        ((8, math.inf), (-math.inf, math.inf)),
        ((-math.inf, -6), (-math.inf, math.inf)),
        ((-math.inf, -5), (12, 30)),
        ((15, 20), (-math.inf, 5)),
        ((6, 9), (9, 12)),
    ],
)
def test_the_plan_is_that_of_brute_force_over_all_times(
    tables: tuple[list[int], list[np.ndarray]], offsets: Sequence[tuple[float, float]]
) -> None:
    """Departures from the stops between are bounded around those of a buffer of 15 % everywhere."""
    dwell_s, usual = 20, np.round(np.cumsum([1.15 * first + 20 for first in tables[0]]))
    windows = [(float(usual[i]) + low, float(usual[i]) + high) for i, (low, high) in enumerate(offsets)]
    latest_s = int(usual[-1]) - dwell_s
    calls = [
        stop(x, dwell_s, departure=Window(earliest_s=w[0], latest_s=w[1]))
        for x, w in zip(STOPS_M[1:-1], windows, strict=True)
    ]
    plan = planned(start(), *calls, end(STOPS_M[-1], latest_s))
    assert_kept(plan)
    found_j = brute_force_j(tables, windows, dwell_s, latest_s)
    assert plan.input_j == pytest.approx(found_j, rel=3e-4)
    assert plan.bound_j <= found_j
    assert plan.gap_reason == ""
    assert 0.0 <= plan.gap_ratio < 0.01
    # λ does not rise where a departure is held at its latest nor fall where it is at its earliest, and else it stays; a
    # window may hold a departure by less than the time tolerance, and then λ stays as well.
    for before, after in pairwise(plan.sections):
        step = after.lambda_w[0] / before.lambda_w[0] - 1
        signs = {Held.FREE: step == 0, Held.LATEST: step <= 0, Held.EARLIEST: step >= 0, Held.FIXED: True}
        assert signs[after.departure.held]


def test_a_window_that_is_not_tight_changes_nothing() -> None:
    free = planned(start(), stop(4_000.0, 20.0), end(9_000.0, 480.0))
    arrival_s = free.sections[0].arrival.time_s
    around = Window(earliest_s=arrival_s - 3.0, latest_s=arrival_s + 3.0)
    bound = planned(start(), stop(4_000.0, 20.0, around), end(9_000.0, 480.0))
    assert bound.input_j == free.input_j
    assert bound.sections[0].arrival == free.sections[0].arrival


def test_the_proportional_split_has_the_same_buffer_everywhere_and_costs_more() -> None:
    route = make_route(9_000.0, [(0.0, 15.0), (3_000.0, 35.0)])
    planner = JourneyPlanner(journey(start(), stop(3_000.0, 20.0), end(9_000.0, 510.0)), route, TRAIN)
    plan, same = planner.plan(), planner.plan(Split.PROPORTIONAL)
    assert_kept(same)
    assert same.sections[0].buffer_ratio == pytest.approx(same.sections[1].buffer_ratio, abs=2e-4)
    assert plan.time_s == pytest.approx(same.time_s, abs=0.01)
    assert plan.input_j < 0.99 * same.input_j
    assert planner.fastest_j() == pytest.approx(
        sum(front(route, TRAIN, a, b).fastest().balance.input for a, b in pairwise((0.0, 3_000.0, 9_000.0))), rel=1e-9
    )


def test_with_the_least_time_every_section_is_as_fast_as_it_can_be() -> None:
    times_s = least_s(HILLY, TRAIN, 0.0, 4_000.0, 9_000.0)
    planner = JourneyPlanner(journey(start(), stop(4_000.0, 20.0), end(9_000.0, sum(times_s) + 20.0)), HILLY, TRAIN)
    plan = planner.plan()
    assert_kept(plan)
    assert [section.trajectory.time_s for section in plan.sections] == pytest.approx(times_s, abs=0.01)
    assert [section.buffer_ratio for section in plan.sections] == pytest.approx([0.0, 0.0], abs=1e-3)
    assert plan.input_j == pytest.approx(planner.fastest_j(), rel=1e-3)
    assert [section.lambda_w for section in plan.sections] == [(math.inf,)] * 2
    assert plan.gap_reason.startswith("a part of the journey has no price of time")
    assert math.isnan(plan.gap_ratio)


def test_fronts_that_are_not_kept_give_the_same_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = journey(start(), stop(2_800.0, 20.0), Passing(name="P", position_m=4_000.0), end(9_000.0, 500.0))
    kept = JourneyPlanner(asked, HILLY, TRAIN).plan()
    monkeypatch.setattr(tol, "JOURNEY_FRONTS_BYTES", 0)
    assert JourneyPlanner(asked, HILLY, TRAIN).plan().input_j == kept.input_j


# --- passings ---------------------------------------------------------------------------------------------------


def brute_force_speed_j(position_m: float, first_s: float, second_s: float) -> float:
    """Least energy of HILLY in two parts of given times over their common speed, each part a section of its own."""
    ahead = front(HILLY, TRAIN, position_m, 9_000.0)
    best = math.inf
    for v in np.arange(16.0, 22.1, 0.5):
        before = front(HILLY, TRAIN, 0.0, position_m, v)
        if before.fastest().time_s <= first_s and ahead.least_time_s(position_m, v) <= second_s:
            parts = before.trajectory(first_s), ahead.trajectory(second_s, position_m, v)
            best = min(best, sum(part.balance.input for part in parts))
    return best


@pytest.mark.parametrize(
    ("shift_s", "held"), [(-12.0, Held.LATEST), pytest.param(15.0, Held.EARLIEST, marks=pytest.mark.slow)]
)
def test_a_tight_passing_is_that_of_brute_force_over_its_speed(shift_s: float, held: Held) -> None:
    position_m, total_s = 3_500.0, 440.0
    free = planned(start(), Passing(name="P", position_m=position_m), end(9_000.0, total_s))
    at_s = free.sections[0].passings[0].timing.time_s + shift_s
    window = Window(latest_s=at_s) if held is Held.LATEST else Window(earliest_s=at_s)
    passing = Passing(name="P", position_m=position_m, window=window)
    plan = planned(start(), passing, end(9_000.0, total_s))
    assert_kept(plan)
    (section,) = plan.sections
    assert section.passings[0].timing.held is held
    assert section.passings[0].timing.time_s == pytest.approx(at_s, abs=0.01)
    assert (section.lambda_w[0] > section.lambda_w[1]) == (held is Held.LATEST)
    assert plan.input_j > free.input_j
    found_j = brute_force_speed_j(position_m, at_s, total_s - at_s)
    assert plan.input_j == pytest.approx(found_j, rel=3e-4)
    assert plan.bound_j <= found_j
    assert 0.0 <= plan.gap_ratio < 0.01


def test_a_train_passes_fast_enough_to_arrive_in_the_time_that_is_left() -> None:
    """Behind the passing there is the least time from 20 m/s and 0.1 s more; slower trains there would be late."""
    position_m, at_s = 3_500.0, 200.0
    left_s = front(HILLY, TRAIN, position_m, 9_000.0).least_time_s(position_m, 20.0) + 0.1
    passing = Passing(name="P", position_m=position_m, window=Window(earliest_s=at_s, latest_s=at_s))
    plan = planned(start(), passing, end(9_000.0, at_s + left_s))
    assert_kept(plan)
    time_s, speed_mps = plan.sections[0].trajectory.passed(position_m)
    assert time_s == pytest.approx(at_s, abs=0.02)
    assert speed_mps > 19.9


def test_two_tight_passings_are_those_of_brute_force_over_both_speeds() -> None:
    places, times, speeds = (2_500.0, 6_000.0), (130.0, 330.0), ((15.5, 16.5, 17.5), (21.5, 22.5, 23.5))
    last = front(HILLY, TRAIN, places[1], 9_000.0)
    firsts = {v: front(HILLY, TRAIN, 0.0, places[0], v).trajectory(times[0]) for v in speeds[0]}
    lasts = {w: last.trajectory(480.0 - times[1], places[1], w) for w in speeds[1]}
    found_j = math.inf
    for w in speeds[1]:
        middle = front(HILLY, TRAIN, *places, w)
        for v in speeds[0]:
            parts = firsts[v], middle.trajectory(times[1] - times[0], places[0], v), lasts[w]
            if all(abs(part.time_s - part.requested_s) < 0.1 for part in parts):
                found_j = min(found_j, sum(part.balance.input for part in parts))
    passings = [
        Passing(name=f"{x:g}", position_m=x, window=Window(earliest_s=t, latest_s=t))
        for x, t in zip(places, times, strict=True)
    ]
    plan = planned(start(), *passings, end(9_000.0, 480.0))
    assert_kept(plan)
    assert [x.timing.held for x in plan.sections[0].passings] == [Held.FIXED, Held.FIXED]
    assert len(plan.sections[0].lambda_w) == 3
    assert plan.input_j == pytest.approx(found_j, rel=1e-3)
    assert plan.bound_j <= found_j


def test_a_train_that_may_wait_departs_later_and_is_not_slower_than_at_least_energy() -> None:
    passing = Passing(name="P", position_m=4_000.0, window=Window(earliest_s=900.0, latest_s=960.0))
    waiting = planned(start(math.inf), passing, end(9_000.0, 1_300.0), train=IDLING)
    assert_kept(waiting)
    assert waiting.sections[0].departure.time_s > 200.0
    assert waiting.sections[0].passings[0].timing.held is Held.EARLIEST
    assert min(waiting.sections[0].lambda_w) == 0.0
    # One that must leave has to be slower than that: a negative price of time, and more energy.
    leaving = planned(start(), passing, end(9_000.0, 1_300.0), train=IDLING)
    assert_kept(leaving)
    assert leaving.sections[0].lambda_w[0] < 0.0
    assert leaving.input_j > waiting.input_j * 1.05
    assert waiting.input_j < leaving.bound_j <= leaving.input_j


def test_speeds_at_a_passing_are_kept() -> None:
    for lowest, highest in ((0.0, 9.0), (20.5, math.inf), (14.0, 14.0)):
        passing = Passing(name="P", position_m=3_000.0, lowest_mps=lowest, highest_mps=highest)
        plan = planned(start(), passing, end(9_000.0, 520.0))
        assert_kept(plan)
        unbound = replace(passing, lowest_mps=0.0, highest_mps=math.inf)
        free = planned(start(), unbound, end(9_000.0, 520.0))
        assert not lowest <= free.sections[0].passings[0].speed_mps <= highest, "the bounds bind"
        assert plan.input_j > free.input_j


# --- what cannot be ---------------------------------------------------------------------------------------------


def refused(asked: Journey, train: Vehicle = TRAIN, route: Route = HILLY) -> str:
    with pytest.raises(InfeasibleError) as caught:
        JourneyPlanner(asked, route, train).plan()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_time_that_is_too_tight_is_named_with_its_seconds() -> None:
    first_s, second_s = least_s(HILLY, TRAIN, 0.0, 4_000.0, 9_000.0)
    late = refused(journey(start(), stop(4_000.0, 30.0), end(9_000.0, first_s + 30.0 + second_s - 12.3)))
    assert late.startswith("test: arrival at Z (latest 0:0")
    assert ") is 12.3 s too tight: after departure from A (fixed 0:00:00.0) the fastest run is there at 0:0" in late
    # The clock restarts where the train may not be earlier.
    waits = stop(4_000.0, 30.0, departure=Window(earliest_s=400.0))
    late = refused(journey(start(), waits, end(9_000.0, 400.0 + second_s - 7.5)))
    assert " is 7.5 s too tight: after departure from at 4000 (earliest 0:06:40.0) the fastest run" in late
    # And where it cannot leave in time.
    leaves = stop(4_000.0, 30.0, departure=Window(latest_s=first_s + 30.0 - 3.2))
    assert "departure from at 4000 (latest 0:0" in refused(journey(start(), leaves, end(9_000.0, 2_000.0)))
    assert " is 3.2 s too tight" in refused(journey(start(), leaves, end(9_000.0, 2_000.0)))


def test_a_passing_window_that_is_too_tight_is_named_with_its_seconds() -> None:
    own = front(HILLY, TRAIN, 0.0, 9_000.0).fastest().trajectory
    least = float(np.interp(4_000.0, own.s_m, own.t_s))
    passing = Passing(name="Junction", position_m=4_000.0, window=Window(latest_s=least - 4.0))
    assert "passing Junction (latest 0:0" in refused(journey(start(), passing, end(9_000.0, 2_000.0)))
    assert " is 4.0 s too tight" in refused(journey(start(), passing, end(9_000.0, 2_000.0)))
    late = Window(earliest_s=500.0, latest_s=520.0)
    message = refused(journey(start(), replace(passing, window=late), end(9_000.0, 500.0 + own.time_s - least - 6.0)))
    assert " is 6.0 s too tight: after passing Junction (earliest 0:08:20.0)" in message


def test_a_passing_that_even_the_slowest_run_is_too_early_for_is_named_with_its_seconds() -> None:
    """Slowest is a price of time of −0.99 of the idle loss: on the level (R/η)·s + 0.01·P_idle·s/v is least."""
    passing = Passing(name="P", position_m=10_000.0, window=Window(earliest_s=8_000.0, latest_s=8_060.0))
    message = refused(journey(start(), passing, end(20_000.0, 12_000.0)), IDLING, flat(20_000.0))
    found = re.search(r"passing P \(earliest 2:13:20\.0\) is ([\d.]+) s too late: after departure from A", message)
    assert found, message
    cruise = brentq(lambda v: (20.0 + 2 * 4.0 * v) / 0.88 - 0.01 * 40e3 / v**2, 0.5, 20.0)
    assert 8_000.0 - float(found[1]) == pytest.approx(10_000.0 / cruise, rel=0.02)


def test_a_speed_that_cannot_be_had_is_refused() -> None:
    fast = Passing(name="P", position_m=3_000.0, lowest_mps=25.0)
    assert "passing P at 90.0 … inf km/h: possible there are 0.0 … 79.2 km/h" in refused(
        journey(start(), fast, end(9_000.0, 900.0))
    )
    near = Passing(name="P", position_m=150.0, lowest_mps=25.0)
    assert re.search(r"passing P at 90\.0 … inf km/h: possible there are 0\.0 … [56]\d\.\d km/h", refused(
        journey(start(), near, end(9_000.0, 900.0))))  # fmt: skip


def test_a_point_that_is_not_on_the_route_is_refused() -> None:
    with pytest.raises(DasError, match=r"^test: position of Z = '9100 m': expected a position on test, 0 … 9000 m$"):
        JourneyPlanner(journey(start(), end(9_100.0, 900.0)), HILLY, TRAIN)


# --- properties -------------------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10_000))
@example(seed=6891)  # no multipliers are found that prove a bound, and the plan says so
def test_windows_are_kept_or_the_journey_is_refused(seed: int) -> None:
    """Random windows and speeds around a timetable of 5 to 40 % buffer."""
    rng = random.Random(seed)
    own = front(HILLY, TRAIN, 0.0, 4_500.0).fastest().trajectory
    factor = rng.uniform(1.05, 1.4)

    def around(time_s: float) -> Window:
        early = time_s * rng.uniform(0.95, 1.05)
        return Window(
            earliest_s=rng.choice([early, -math.inf]), latest_s=early + rng.choice([0.0, 10.0, 60.0, math.inf])
        )

    passings = [
        Passing(name=f"{x:.0f}", position_m=x, window=around(factor * float(np.interp(x, own.s_m, own.t_s))),
                lowest_mps=rng.choice([0.0, 5.0]), highest_mps=rng.choice([12.0, math.inf]))
        for x in (rng.uniform(400.0, 2_000.0), rng.uniform(2_100.0, 4_300.0))
    ]  # fmt: skip
    halfway_s = factor * own.time_s + 30.0
    call = stop(4_500.0, 20.0, departure=around(halfway_s))
    last = end(9_000.0, halfway_s + factor * least_s(HILLY, TRAIN, 4_500.0, 9_000.0)[0])
    try:
        planner = JourneyPlanner(journey(start(), *passings, call, last), HILLY, TRAIN)
        plan = planner.plan()
    except InfeasibleError as error:
        message = str(error)
        assert re.search(r"\d s too (tight|late): after", message)
        return
    assert_kept(plan)
    assert plan.gap_reason or plan.gap_ratio >= 0.0
    assert plan.input_j <= planner.plan(Split.PROPORTIONAL).input_j * (1 + 1e-3)


def test_more_time_never_costs_more() -> None:
    energies = [
        planned(start(), stop(4_000.0, 20.0), end(9_000.0, total_s)).input_j for total_s in (430.0, 450.0, 500.0, 600.0)
    ]
    assert energies == sorted(energies, reverse=True)


# --- the public benchmark ---------------------------------------------------------------------------------------


def st_gallen(train: str) -> tuple[Journey, Route, Vehicle]:
    route = load_route(str(track_path("CH_StGallen_Wil")))
    return load_journey(str(journey_path()), route), route, load_vehicle(str(train_path(train)))


@pytest.mark.parametrize("train", ["CH_Stadler_KISS_SBB", "CH_Stadler_FLIRT_TPF"])
def test_the_journey_of_the_benchmark_asks_for_more_than_the_limits_allow(train: str) -> None:
    """Earliest at 20 000 m: 1200 s, latest at the end: 1450 s. At the limits, without braking: 345.5 s."""
    with pytest.raises(InfeasibleError) as caught:
        JourneyPlanner(*st_gallen(train))
    found = re.search(
        r"arrival at 29556\.1 m \(latest 0:24:10\.0\) is ([\d.]+) s too tight: after passing 20000 m \(earliest 0:20",
        str(caught.value),
    )
    assert found, str(caught.value)
    limits = Line.read(track_path("CH_StGallen_Wil")).limits
    ends = [*limits.start_m[1:], 29_556.1]
    stretches = zip(limits.start_m, limits.value, ends, strict=True)
    at_limits_s = sum(max(b - max(a, 20_000.0), 0.0) / v for a, v, b in stretches)
    assert at_limits_s - 250.0 < float(found[1]) < at_limits_s - 250.0 + 15.0


@pytest.mark.slow
@pytest.mark.parametrize("train", ["CH_Stadler_KISS_SBB", "CH_Stadler_FLIRT_TPF"])
def test_the_journey_of_the_benchmark_with_a_later_end_is_planned(train: str) -> None:
    asked, route, vehicle = st_gallen(train)
    later = replace(asked.points[-1], arrival=Window(earliest_s=1400.0, latest_s=1600.0))
    plan = JourneyPlanner(replace(asked, points=(*asked.points[:-1], later)), route, vehicle, point_mass=True).plan()
    assert_kept(plan)
    held = [x.timing.held for section in plan.sections for x in section.passings]
    assert held == [Held.LATEST, Held.EARLIEST]
    assert 0.0 <= plan.gap_ratio < 0.02
    raw = Train.read(train_path(train))
    raw = replace(raw, length_m=0.0)  # planned as a point mass
    line = Line.read(track_path("CH_StGallen_Wil"))
    for section in plan.sections:
        assert_driven(section, line, raw, constant_efficiencies(0.9, 0.9))


def assert_driven(section: SectionPlan, line: Line, train: Train, loss: Loss) -> None:
    """Nothing the verifier finds wrong in a section: limits, forces, motion, energy balance."""
    run = section.trajectory
    found = verify(csv_rows(run), line, train, loss, ends_m=(float(run.s_m[0]), float(run.s_m[-1])))
    assert found == []


@pytest.mark.slow
def test_the_metro_of_the_benchmark_is_planned_over_its_13_sections() -> None:
    route = load_route(str(track_path("CN_Songjiazhuang_Yizhuang")))
    train = load_vehicle(str(train_path("CN_Beijing_Subway")))
    total_s = 1_451.0 + 12 * 30.0
    planner = JourneyPlanner(Journey.over_stops(route.stops, time_s=total_s, dwell_s=30.0), route, train)
    plan = planner.plan()
    assert_kept(plan)
    assert len(plan.sections) == 13
    assert plan.time_s == pytest.approx(total_s, abs=0.01)
    assert len({section.lambda_w for section in plan.sections}) == 1
    assert plan.input_j < 0.997 * planner.plan(Split.PROPORTIONAL).input_j
    # Two seconds moved between any neighbours cost energy.
    fronts = [front(route, train, section.start.position_m, section.end.position_m) for section in plan.sections[:5]]
    for (a, own), (b, other) in itertools.pairwise(zip(plan.sections[:5], fronts, strict=True)):
        for moved_s in (-2.0, 2.0):
            parts = own.trajectory(a.trajectory.time_s + moved_s), other.trajectory(b.trajectory.time_s - moved_s)
            assert sum(x.balance.input for x in parts) > a.balance.input + b.balance.input


def test_a_route_of_stops_may_be_driven_in_one_journey_trajectory() -> None:
    stops = [Stop(name=f"{x:g}", position_m=x) for x in (0.0, 4_000.0, 9_000.0)]
    plan = JourneyPlanner(Journey.over_stops(stops, time_s=500.0, dwell_s=25.0), HILLY, TRAIN).plan()
    run = plan.trajectory()
    assert len(run.s_m) == len(run.force_el_n) + 1 == len(run.limit_mps) + 1
    assert (np.diff(run.t_s) > 0).all()
    assert run.time_s == pytest.approx(500.0, abs=0.01)
    (standing,) = np.flatnonzero(np.diff(run.s_m) == 0)
    assert np.diff(run.t_s)[standing] == pytest.approx(25.0, abs=0.01)
    assert (run.v_mps[standing], run.v_mps[standing + 1], run.force_el_n[standing]) == (0.0, 0.0, 0.0)
    spent_j = float(run.force_el_n @ np.diff(run.s_m) + run.loss_j(LOSSES).sum())
    assert spent_j == pytest.approx(plan.input_j, rel=1e-9)


# --- wishes -----------------------------------------------------------------------------------------------------


def wish(time_s: float, tolerance_s: float = 5.0) -> Passing:
    return Passing(name="W", position_m=3_500.0, window=Window.at(time_s), wish=True, tolerance_s=tolerance_s)


def test_a_wish_changes_no_plan_and_is_reported_by_how_much_it_is_missed_beyond_its_tolerance() -> None:
    free = planned(start(), end(9_000.0, 440.0))
    found = planned(start(), wish(200.0), end(9_000.0, 440.0))
    assert found.input_j == free.input_j
    assert (found.trajectory().v_mps == free.trajectory().v_mps).all()
    (passed,) = found.sections[0].passings
    run = found.trajectory()
    assert passed.timing.time_s == pytest.approx(np.interp(3_500.0, run.s_m, run.t_s), abs=0.1)
    assert passed.speed_mps == pytest.approx(np.interp(3_500.0, run.s_m, run.v_mps), abs=0.05)
    assert passed.missed_s == pytest.approx(
        passed.timing.time_s - 205.0 if passed.timing.time_s > 205 else min(passed.timing.time_s - 195.0, 0.0)
    )
    kept = planned(start(), wish(passed.timing.time_s + 4.0), end(9_000.0, 440.0))
    assert kept.sections[0].passings[0].missed_s == 0.0


@pytest.mark.parametrize("shift_s", [-20.0, pytest.param(25.0, marks=pytest.mark.slow)])
def test_a_missed_wish_costs_what_the_plan_with_its_window_needs_more(shift_s: float) -> None:
    """The same as enforcing the tolerated window, if the times at the stops are fixed by the journey anyway."""
    free = planned(start(), end(9_000.0, 440.0))
    at_s = float(np.interp(3_500.0, free.trajectory().s_m, free.trajectory().t_s)) + shift_s
    asked = wish(at_s)
    planner = JourneyPlanner(journey(start(), asked, end(9_000.0, 440.0)), HILLY, TRAIN)
    plan = planner.plan()
    (passed,) = plan.sections[0].passings
    assert abs(passed.missed_s) == pytest.approx(abs(shift_s) - 5.0, abs=0.5)
    costs_j = planner.wish_costs_j(plan.sections[0], passed)
    window = Window(earliest_s=at_s - 5.0, latest_s=at_s + 5.0)
    tight = planned(start(), Passing(name="W", position_m=3_500.0, window=window), end(9_000.0, 440.0))
    assert costs_j == pytest.approx(tight.input_j - free.input_j, rel=0.02)
    assert costs_j > 0.0


def test_a_wish_that_no_run_keeps_has_no_price() -> None:
    planner = JourneyPlanner(journey(start(), wish(50.0), end(9_000.0, 440.0)), HILLY, TRAIN)
    plan = planner.plan()
    with pytest.raises(DasError):
        planner.wish_costs_j(plan.sections[0], plan.sections[0].passings[0])
