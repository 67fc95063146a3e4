"""The baseline strategies against closed forms, brute force with its own integrator, and the optimal solver."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from das.domain.errors import DasError, InfeasibleError
from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.losses import LOSSLESS, EfficiencyLoss, LossModel
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit
from das.solver.solve import solve_front
from precompute.baselines import Strategy
from precompute.baselines.strategies import (
    Baseline,
    BaselineRun,
    FourModeSearch,
    baseline,
    fastest,
    four_modes,
    reduced_maximum_speed,
)
from precompute.cli.report import solution_json
from tests.support.benchmark import track_path, train_path
from tests.support.crossing import crossed
from tests.support.making import csv_rows, make_route, make_train
from tests.support.raw_data import Line, Train
from tests.support.verifier import verify

pytestmark = pytest.mark.slow

MASS_KG, FORCE_N = 1e5, 1e5
TIMED = (Strategy.FASTEST, Strategy.TOP_SPEED, Strategy.FOUR_MODE)
SOLVER_RATIO = 2e-3
"""How far above the true optimum the optimal solver may be: docs/explanation/solver.md says to 0.3 %; here it is
nearer."""


def train(
    c0_n: float = 0.0, c2: float = 0.0, *, loss: LossModel = LOSSLESS, power_w: float = 1e12, friction_n: float = 0.0
) -> Vehicle:
    policy = BrakePolicy.BLENDED if friction_n else BrakePolicy.ELECTRIC
    made = make_train(resistance=(c0_n, 0.0, c2), power_w=power_w, loss=loss)
    return replace(made, friction_brake_force_n=friction_n, brake_policy=policy)


@pytest.fixture(scope="module")
def hilly() -> Section:
    """Limits, a climb the train cannot hold its speed on, a descent it has to brake on, losses, both brakes."""
    limits = [(0.0, 30.0), (3_000.0, 22.0), (4_500.0, 40.0), (9_000.0, 25.0)]
    grades = [(0.0, 0.0), (2_000.0, 0.030), (4_000.0, -0.025), (7_000.0, 0.0), (8_000.0, -0.004)]
    loss = EfficiencyLoss.from_efficiencies(0.88, 0.85, 2e4)
    return build_section(
        make_route(12_000.0, limits, grades),
        train(1500.0, 4.0, loss=loss, power_w=8e5, friction_n=5e4),
        level=Level.OWN,
    )


@pytest.fixture(scope="module")
def hilly_front(hilly: Section) -> Front:
    return solve_front(hilly)


def assert_possible(run: Baseline, section: Section) -> None:
    """Ends, limits, forces, powers, decelerations and the equation of motion of a run, from its arrays."""
    way, vehicle = run.trajectory, section.vehicle
    v, step = way.v_mps, np.diff(way.s_m)
    faster = np.maximum(v[:-1], v[1:])
    assert (v[0], v[-1]) == (section.start_speed_mps, pytest.approx(section.end_speed_mps, abs=1e-6))
    assert (faster <= way.limit_mps + 1e-6).all()
    assert np.allclose(np.diff(way.t_s), 2 * step / (v[:-1] + v[1:]), rtol=1e-9)
    for force, effort in ((way.force_el_n, vehicle.traction), (-way.force_el_n, vehicle.electric_brake)):
        most = np.minimum(effort.max_force_n, effort.max_power_w / faster)
        assert (force <= most * (1 + 1e-6) + 1e-3).all()
    friction = vehicle.friction_brake_force_n if section.brakes is not BrakePolicy.ELECTRIC else 0.0
    if section.brakes is BrakePolicy.FRICTION:  # within the force of both brakes, all of it dissipated
        friction = friction + np.minimum(
            vehicle.electric_brake.max_force_n, vehicle.electric_brake.max_power_w / faster
        )
    assert (way.force_friction_n <= 1e-3).all()
    assert (-way.force_friction_n <= friction * (1 + 1e-6) + 1e-3).all()
    rate = np.diff(v**2) / (2 * step)
    assert (-rate <= vehicle.max_deceleration_mps2 * (1 + 1e-6)).all()
    assert (rate <= vehicle.max_acceleration_mps2 * (1 + 1e-6)).all()
    assert run.balance.residual_ratio < 1e-6
    assert run.feasible


def assert_on_time(run: Baseline, time_s: float) -> None:
    assert run.fit is Fit.ON_TIME
    assert run.time_s == pytest.approx(time_s, abs=0.0201)


def both(section: Section, time_s: float) -> tuple[Baseline, Baseline]:
    """The four-mode and the top-speed run of a time, both on time and possible."""
    runs = four_modes(section, time_s), reduced_maximum_speed(section, time_s)
    for run in runs:
        assert_on_time(run, time_s)
        assert_possible(run, section)
    return runs


def test_no_other_cruising_speed_is_tried_where_the_first_is_as_good_as_the_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried, runs_on_time = list[float](), FourModeSearch._runs_on_time

    def counted(search: FourModeSearch, cruise_mps: float) -> list[BaselineRun]:
        tried.append(cruise_mps)
        return runs_on_time(search, cruise_mps)

    monkeypatch.setattr(FourModeSearch, "_runs_on_time", counted)
    four_modes(build_section(make_route(6_000.0, [(0.0, 40.0)]), train(1500.0, 4.0)), 260.0)
    assert len(tried) == 1


# --- closed forms -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("time_s", [210.0, 300.0, 900.0])
def test_top_speed_without_resistance(time_s: float) -> None:
    """a = F/m = 1 m/s² up and down: t = s/v + v/a, so v = (t − √(t² − 4·s/a))·a/2."""
    run = reduced_maximum_speed(build_section(make_route(6_000.0, [(0.0, 40.0)]), train()), time_s)
    assert_on_time(run, time_s)
    assert run.cruise_speed_mps == pytest.approx((time_s - math.sqrt(time_s**2 - 4 * 6_000.0)) / 2, rel=5e-3)
    assert run.coasting_m == ()


def test_top_speed_holds_its_speed_against_a_slope_and_the_air() -> None:
    """While cruising the force is m·g·i + c0 + c2·v², uphill and (braking) downhill."""
    route = make_route(20_000.0, [(0.0, 40.0)], [(0.0, 0.005), (10_000.0, -0.010)])
    run = reduced_maximum_speed(build_section(route, train(2_000.0, 5.0)), 800.0)
    assert_on_time(run, 800.0)
    v = run.cruise_speed_mps
    for place, grade in ((5_000.0, 0.005), (15_000.0, -0.010)):
        i = int(np.searchsorted(run.trajectory.s_m, place))
        assert run.trajectory.v_mps[i] == pytest.approx(v, rel=1e-12)
        assert run.trajectory.force_el_n[i] == pytest.approx(MASS_KG * 9.81 * grade + 2_000.0 + 5.0 * v * v, rel=1e-6)


def test_fastest_is_half_acceleration_half_braking() -> None:
    run = fastest(build_section(make_route(1_000.0, [(0.0, 60.0)]), train()))
    assert run.time_s == pytest.approx(2 * math.sqrt(1_000.0), rel=1e-3)
    assert (run.cruise_speed_mps, run.coasting_m, run.fit) == (None, (), Fit.ON_TIME)
    assert run.requested_s == run.least_time_s == run.time_s


def test_four_modes_with_dissipative_brakes_and_no_resistance() -> None:
    """Without resistance, energy only buys speed and no brake gives it back: least energy is the least top speed that
    makes the time, held to the brake point, which is the top-speed run; E = m·v²/2."""
    vehicle = replace(train(), brake_policy=BrakePolicy.FRICTION, friction_brake_force_n=0.0)
    section = build_section(make_route(6_000.0, [(0.0, 40.0)]), vehicle)
    run = four_modes(section, 300.0)
    assert_on_time(run, 300.0)
    v = (300.0 - math.sqrt(300.0**2 - 4 * 6_000.0)) / 2
    assert run.balance.input == pytest.approx(0.5 * MASS_KG * v * v, rel=1e-2)
    assert run.trajectory.v_mps.max() == pytest.approx(v, rel=5e-3)


def test_coasting_loses_kinetic_energy_to_resistance_alone() -> None:
    """R = c0: on the level a coasting train loses m·Δ(v²)/2 = c0·s; the longest arc is found so, and no force acts."""
    loss = EfficiencyLoss.from_efficiencies(0.8, 0.8)
    run = four_modes(build_section(make_route(6_000.0, [(0.0, 40.0)]), train(6_000.0, loss=loss)), 240.0)
    assert_on_time(run, 240.0)
    (start_m, end_m) = max(run.coasting_m, key=lambda pair: pair[1] - pair[0])
    assert end_m - start_m > 500.0
    first, last = np.searchsorted(run.trajectory.s_m, (start_m, end_m))
    v = run.trajectory.v_mps
    assert 0.5 * MASS_KG * (v[first] ** 2 - v[last] ** 2) == pytest.approx(6_000.0 * (end_m - start_m), rel=1e-9)
    assert np.abs(run.trajectory.force_el_n[first:last]).max() < 1e-3


# --- brute force ------------------------------------------------------------------------------------------------

LENGTH_M, C0_N, C2, ETA = 4_000.0, 3_000.0, 8.0, 0.85


def phase(v: float, end_mps: float, force_n: float, dt: float = 0.02) -> np.ndarray:
    """Rows (t, s, v) of a phase at constant force from v until the speed passes end_mps, midpoint rule in time."""
    rows, t, s = [(0.0, 0.0, v)], 0.0, 0.0
    rising = end_mps > v
    while (v < end_mps) == rising and v != end_mps and t < 2_000.0:
        mid = v + 0.5 * dt * (force_n - C0_N - C2 * v * v) / MASS_KG
        v += dt * (force_n - C0_N - C2 * mid * mid) / MASS_KG
        t, s = t + dt, s + mid * dt
        rows.append((t, s, v))
    return np.array(rows)


def driven(cruise_mps: float, coast_end_mps: float) -> tuple[float, float]:
    """Time and energy of full traction, cruising, coasting to a speed and full brake over LENGTH_M; inf if too long."""

    def until(rows: np.ndarray, v: float, rising: bool) -> tuple[float, float]:
        order = slice(None) if rising else slice(None, None, -1)
        return tuple(float(np.interp(v, rows[order, 2], rows[order, i])) for i in (0, 1))  # type: ignore[return-value]

    t1, s1 = until(RUN_UP, cruise_mps, True)
    t_a, s_a = until(COAST, cruise_mps, False)
    t_b, s_b = until(COAST, coast_end_mps, False)
    t_c, s_c = until(BRAKE, coast_end_mps, False)
    t_d, s_d = until(BRAKE, 0.0, False)
    cruising_m = LENGTH_M - s1 - (s_b - s_a) - (s_d - s_c)
    if cruising_m < 0:
        return math.inf, math.inf
    holding_n = C0_N + C2 * cruise_mps**2
    energy_j = (FORCE_N * s1 + holding_n * cruising_m) / ETA - FORCE_N * (s_d - s_c) * ETA
    return t1 + cruising_m / cruise_mps + (t_b - t_a) + (t_d - t_c), energy_j


RUN_UP = phase(0.0, 41.0, FORCE_N)
COAST = phase(41.0, 0.5, 0.0)
BRAKE = phase(41.0, 0.0, -FORCE_N)


@pytest.mark.parametrize("time_s", [150.0, 170.0, 220.0])
def test_best_cruising_speed_and_coasting_point_by_brute_force(time_s: float) -> None:
    """Every cruising speed in steps of 0.1 m/s; for each the coasting point that makes the time, by bisection."""
    best_j, best_mps = math.inf, 0.0
    for cruise_mps in np.arange(15.0, 40.0, 0.1):
        low, high = 0.6, float(cruise_mps)
        if driven(cruise_mps, high)[0] > time_s:
            continue
        for _ in range(20):
            middle = 0.5 * (low + high)
            taken_s = driven(cruise_mps, middle)[0]
            if taken_s > time_s:  # too slow, or the coasting does not fit in
                low = middle
            else:
                high = middle
        taken_s, energy_j = driven(cruise_mps, high)
        if abs(taken_s - time_s) < 0.01 and energy_j < best_j:
            best_j, best_mps = energy_j, float(cruise_mps)
    assert best_j < math.inf
    loss = EfficiencyLoss.from_efficiencies(ETA, ETA)
    run = four_modes(build_section(make_route(LENGTH_M, [(0.0, 40.0)]), train(C0_N, C2, loss=loss)), time_s)
    assert_on_time(run, time_s)
    assert run.balance.input == pytest.approx(best_j, rel=2e-4)
    assert run.trajectory.v_mps.max() == pytest.approx(best_mps, rel=0.01)


# --- against the optimal solver ---------------------------------------------------------------------------------


def test_four_modes_are_the_optimum_of_constant_efficiency() -> None:
    """The complete trip: at L1 the optimum is full traction, cruising, coasting, full brake; top-speed needs more."""
    section = build_section(load_route("flat-6km"), load_vehicle("re460-ic"), level=Level.L1)
    front = solve_front(section)
    time_s = 1.07 * front.fastest().time_s
    optimal_j = front.trajectory(time_s).balance.input
    run, reduced = both(section, time_s)
    assert run.balance.input == pytest.approx(optimal_j, rel=1e-3)
    assert reduced.balance.input > 1.02 * optimal_j
    assert len(run.coasting_m) == 1
    # The four modes, and not more than the three intervals in which one gives way to the next.
    way = run.trajectory
    faster = np.maximum(way.v_mps[:-1], way.v_mps[1:])
    full = np.minimum(section.train.traction_force_n, section.train.traction_power_w / faster)
    brake = np.minimum(section.train.electric_force_n, section.train.electric_power_w / faster)
    held = np.abs(np.diff(way.v_mps)) < 1e-9
    modes = [np.isclose(way.force_el_n, level, rtol=1e-3, atol=1.0) for level in (full, 0.0, -brake)]
    assert np.count_nonzero(~np.logical_or.reduce([*modes, held])) <= 3


@pytest.mark.parametrize("buffer_ratio", [0.03, pytest.param(0.1, marks=pytest.mark.nightly), 0.3])
def test_a_hilly_section(hilly: Section, hilly_front: Front, buffer_ratio: float) -> None:
    time_s = fastest(hilly).time_s * (1 + buffer_ratio)
    optimal_j = hilly_front.trajectory(time_s).balance.input
    run, reduced = both(hilly, time_s)
    assert optimal_j - SOLVER_RATIO * abs(optimal_j) < run.balance.input <= reduced.balance.input
    assert reduced.trajectory.v_mps.max() <= reduced.cruise_speed_mps + 1e-9


@pytest.mark.parametrize(("level", "reverse"), crossed(list(Level)[:5], (False, True)))
def test_the_bundled_route_at_every_level(level: Level, reverse: bool) -> None:
    """Its first 12 km, or the first 28 km of the way back."""
    route = load_route("zurich-luzern").reversed() if reverse else load_route("zurich-luzern")
    section = build_section(route, load_vehicle("re460-ic"), end_m=route.stops[1].position_m, level=level)
    time_s = fastest(section).time_s * 1.07
    run, reduced = both(section, time_s)
    optimal_j = solve_front(section).trajectory(time_s).balance.input
    assert optimal_j * (1 - SOLVER_RATIO) < run.balance.input < 1.03 * optimal_j
    assert run.balance.input <= reduced.balance.input


@pytest.mark.parametrize(("start_mps", "end_mps"), [(0.0, 160 / 3.6), (160 / 3.6, 0.0), (10.0, 20.0)])
def test_sections_that_begin_or_end_at_speed(start_mps: float, end_mps: float) -> None:
    options = SectionOptions(start_speed_mps=start_mps, end_speed_mps=end_mps)
    route, vehicle = load_route("flat-6km"), load_vehicle("re460-ic")
    section = build_section(route, vehicle, level=Level.L2, end_m=4_000.0, options=options)
    quickest = fastest(section)
    assert_possible(quickest, section)
    run, reduced = both(section, quickest.time_s * 1.1)
    optimal = solve_front(section).trajectory(quickest.time_s * 1.1)
    scale = max(abs(optimal.balance.input), optimal.balance.irreversible)
    assert optimal.balance.input - SOLVER_RATIO * scale < run.balance.input <= reduced.balance.input


def test_a_hill_that_needs_momentum() -> None:
    """120 ‰ at 100 kN and 100 t: 20 kN short over 300 m, so m·v²/2 must be 6 MJ + resistance: at least 10.9 m/s."""
    route = make_route(6_000.0, [(0.0, 30.0)], [(0.0, 0.0), (4_200.0, 0.12), (4_500.0, 0.0)])
    section = build_section(route, train(2_000.0, 10.0, loss=EfficiencyLoss.from_efficiencies(0.9, 0.9)))
    run, reduced = both(section, 900.0)
    for each in (run, reduced):
        assert each.trajectory.v_mps[int(np.searchsorted(each.trajectory.s_m, 4_200.0))] > 10.9
    assert run.balance.input <= reduced.balance.input


TRACKS = {"CH_Fribourg_Bern": "CH_Stadler_FLIRT_TPF", "SE_Vasteras_Kolback": "NL_Intercity_VIRM6"}


@pytest.mark.nightly
@pytest.mark.parametrize("track", TRACKS)
def test_public_tracks(track: str) -> None:
    """Limits, gradients and both brakes of real lines; the forces once more by the independent integrator."""
    line_path, own_path = track_path(track), train_path(TRACKS[track])
    section = build_section(
        load_route(str(line_path)),
        load_vehicle(str(own_path)),
        options=SectionOptions(point_mass=True, start_speed_mps=1.0, end_speed_mps=1.0),
    )
    train, line = replace(Train.read(own_path), length_m=0.0), Line.read(line_path)
    ends_m = (section.start_m, section.end_m)
    front = solve_front(section)
    for buffer_ratio in (0.05, 0.2):
        time_s = front.fastest().time_s * (1 + buffer_ratio)
        optimal_j = front.trajectory(time_s).balance.input
        runs = both(section, time_s)
        for run in runs:
            rows, claim = csv_rows(run.trajectory), solution_json(run, run.least_time_s, 0.0)
            findings = verify(
                rows, line, train, train.own_loss(), ends_m=ends_m, end_speeds_mps=(1.0, 1.0), claim=claim
            )
            assert findings == [], [str(finding) for finding in findings]
        assert optimal_j * (1 - SOLVER_RATIO) < runs[0].balance.input < runs[1].balance.input


# --- times ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", TIMED)
def test_a_time_below_the_least_gives_the_fastest_run(hilly: Section, strategy: Strategy) -> None:
    run = baseline(strategy, hilly, 10.0)
    assert (run.fit, run.strategy, run.requested_s) == (Fit.LATE, strategy, 10.0)
    assert np.array_equal(run.trajectory.v_mps, fastest(hilly).trajectory.v_mps)


def test_four_modes_do_not_waste_energy_on_being_late(hilly: Section) -> None:
    """With an idle loss there is a slowest sensible run; top-speed keeps the time whatever it costs, down to 1 m/s."""
    run, reduced = four_modes(hilly, 5_000.0), reduced_maximum_speed(hilly, 5_000.0)
    assert run.fit is Fit.EARLY
    assert_possible(run, hilly)
    assert_on_time(reduced, 5_000.0)
    assert run.balance.input < reduced.balance.input
    slowest = reduced_maximum_speed(hilly, 1e6)
    assert (slowest.fit, slowest.cruise_speed_mps) == (Fit.EARLY, 1.0)


def test_more_time_never_costs_more_and_braking_is_left_to_the_motors(hilly: Section) -> None:
    """Friction wastes what the motors would give back: with time in hand it only helps where they cannot hold."""
    least_s = fastest(hilly).time_s
    runs = [four_modes(hilly, least_s * (1 + buffer_ratio)) for buffer_ratio in (0.01, 0.03, 0.1, 0.3, 0.03)]
    energies = [run.balance.input for run in runs[:-1]]
    assert all(b <= a + 1e-3 * abs(a) for a, b in itertools.pairwise(energies))
    assert np.array_equal(runs[1].trajectory.v_mps, runs[-1].trajectory.v_mps), "the same, to the last bit"
    assert not (runs[2].trajectory.force_friction_n < -1.0).any()
    assert (fastest(hilly).trajectory.force_friction_n < -1e4).any()


# --- errors -----------------------------------------------------------------------------------------------------


def test_a_time_or_a_strategy_that_is_none_is_refused(hilly: Section) -> None:
    for strategy, time_s in itertools.product(TIMED, (0.0, -1.0, math.nan, math.inf)):
        with pytest.raises(DasError, match=r"trip time .* expected a finite time > 0 s"):
            baseline(strategy, hilly, time_s)
    with pytest.raises(DasError, match="strategy optimal with trip time 500"):
        baseline(Strategy.OPTIMAL, hilly, 500.0)
    with pytest.raises(DasError, match="strategy top-speed with trip time None s"):
        baseline(Strategy.TOP_SPEED, hilly, None)


def test_a_train_that_stalls_is_named(hilly: Section) -> None:
    """A hill that appears after the section was built: the run itself finds out."""
    steep = replace(hilly, constant_n=hilly.constant_n + 5e5)
    with pytest.raises(InfeasibleError, match="stalls"):
        fastest(steep)


@pytest.mark.nightly
def test_four_modes_on_a_metro_section_stay_near_the_optimum() -> None:
    # With hills a coasting arc grazes the base run: a little more speed must not end it there.
    route = load_route(str(track_path("CN_Songjiazhuang_Yizhuang")))
    vehicle = load_vehicle(str(train_path("CN_Beijing_Subway")))
    section = build_section(route, vehicle, end_m=route.stops[1].position_m)
    front = solve_front(section)
    least_s = fastest(section).time_s
    energies = []
    for buffer_ratio in (0.02, 0.03, 0.05, 0.07, 0.10, 0.15, 0.20):
        run = four_modes(section, least_s * (1 + buffer_ratio))
        best_j = front.trajectory(least_s * (1 + buffer_ratio)).balance.input
        assert -2e-3 * best_j < run.balance.input - best_j < 5e-3 * best_j
        energies.append(run.balance.input)
    assert energies == sorted(energies, reverse=True), "more time never costs more"


def test_a_section_too_short_to_move_is_refused() -> None:
    section = build_section(load_route("flat-6km"), load_vehicle("re460-ic"), end_m=3.0)
    for strategy, time_s in itertools.product(TIMED, (10.0, 60.0)):
        with pytest.raises(InfeasibleError, match="too short for it to move"):
            baseline(strategy, section, time_s)
