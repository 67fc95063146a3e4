"""The solver against closed forms, an independent integrator, brute force and the public benchmark."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core import caching

from das.compiling import kernel
from das.domain.errors import DasError, InfeasibleError
from das.domain.files.load import load_route, load_vehicle
from das.domain.files.vehicles import read_loss_map
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap
from das.domain.route import Route
from das.domain.vehicle import BrakePolicy
from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from docs.studies.results import POINT, Instance, posed
from precompute.cli.report import solution_json
from tests.support import raw_data
from tests.support.benchmark import LEAST_TIMES_S, ReferenceResult, reference_results, track_path, train_path
from tests.support.crossing import crossed
from tests.support.making import csv_rows, flat, make_route, make_train
from tests.support.raw_data import Effort, Line, Loss, Train, constant_efficiencies
from tests.support.verifier import verify

KWH = 3.6e6


def assert_possible(solution: Solution, section: Section) -> None:
    """Limits, forces, powers and kinematics of a run, from its arrays alone."""
    run, train = solution.trajectory, section.train
    v, step = run.v_mps, np.diff(run.s_m)
    faster = np.maximum(v[:-1], v[1:])
    assert (faster <= run.limit_mps + 1e-6).all()
    assert (run.force_el_n <= np.minimum(train.traction_force_n, train.traction_power_w / faster) * (1 + 1e-6)).all()
    assert (-run.force_el_n <= np.minimum(train.electric_force_n, train.electric_power_w / faster) * (1 + 1e-6)).all()
    assert (run.force_friction_n <= 1e-6).all()
    friction = train.friction_force_n
    if section.brakes is BrakePolicy.FRICTION:  # everything is dissipated, within the force limit of both brakes
        friction = friction + np.minimum(train.electric_force_n, train.electric_power_w / faster)
    assert (-run.force_friction_n <= friction * (1 + 1e-6) + 1e-6).all()
    assert np.allclose(np.diff(run.t_s), 2 * step / (v[:-1] + v[1:]), rtol=1e-9)
    assert solution.balance.residual_ratio < 1e-6
    assert solution.feasible


# --- closed forms -----------------------------------------------------------------------------------------------


def test_run_up_to_an_end_speed_without_resistance_uses_the_whole_force_at_the_end() -> None:
    # From 0 to 20 m/s over 1 km at a = 1 m/s² at most, no losses: any run needs the kinetic energy, the fastest
    # sets off at once and holds the speed: t = v/a + (s − v²/2a)/v = 60 s; the slowest accelerates last.
    section = build_section(flat(1_000.0, 20.0), make_train(), options=SectionOptions(end_speed_mps=20.0))
    front = solve_front(section)
    assert front.fastest().time_s == pytest.approx(60.0, rel=1e-3)
    assert front.trajectory(90.0).balance.input == pytest.approx(0.5 * 1e5 * 20.0**2, rel=1e-6)
    dragging = build_section(
        flat(1_000.0, 20.0), make_train(resistance=(0.0, 0.0, 5.0)), options=SectionOptions(end_speed_mps=20.0)
    )
    slow = solve_front(dragging).trajectory(90.0)
    assert slow.feasible
    assert slow.fit is Fit.ON_TIME
    assert (slow.trajectory.v_mps >= dragging.floor_mps - 1e-9).all()
    # The slowest speeds that still reach the end: v² = v_end² − 2·a·(distance to go), 0 further back.
    expected = np.maximum(20.0**2 - 2.0 * (1_000.0 - section.node_m), 0.0)
    assert np.allclose(section.floor_mps**2, expected, atol=1e-9)


def test_an_end_speed_beyond_reach_is_refused() -> None:
    with pytest.raises(InfeasibleError, match=r"the train ends at .* km/h, expected 144\.0 km/h"):
        build_section(flat(500.0), make_train(), options=SectionOptions(end_speed_mps=40.0))
    with pytest.raises(InfeasibleError, match=r"an end at 144\.0 km/h is above the limit"):
        build_section(flat(500.0, 20.0), make_train(), options=SectionOptions(end_speed_mps=40.0))


def test_acceleration_at_constant_power_follows_the_closed_form() -> None:
    # v³ = v0³ + 3·P/m·s at constant power without resistance.
    train = replace(make_train(power_w=1e6), max_speed_mps=100.0)
    run = solve_front(build_section(flat(8_000.0, 100.0), train)).fastest().trajectory
    start, stop = np.searchsorted(run.v_mps, 15.0), np.searchsorted(run.s_m, 3_000.0)
    predicted = np.cbrt(run.v_mps[start] ** 3 + 3 * 10.0 * (run.s_m[stop] - run.s_m[start]))
    assert run.v_mps[stop] == pytest.approx(predicted, rel=3e-3)


@pytest.mark.parametrize("buffer_ratio", [0.05, 0.1, 0.3])
def test_lossless_train_without_resistance_needs_no_energy(buffer_ratio: float) -> None:
    front = solve_front(build_section(flat(3_000.0), make_train()))
    solution = front.trajectory(front.fastest().time_s * (1 + buffer_ratio))
    kinetic = 0.5 * 1e5 * solution.trajectory.v_mps.max() ** 2
    assert abs(solution.balance.input) < 1e-9 * kinetic


def test_energy_on_a_slope_is_potential_energy() -> None:
    route = make_route(3_000.0, [(0.0, 30.0)], [(0.0, 0.01)])
    solution = solve_front(build_section(route, make_train())).trajectory(200.0)
    assert solution.balance.input == pytest.approx(1e5 * 9.81 * 0.01 * 3_000.0, rel=1e-9)


def test_cruising_speed_obeys_the_price_of_time() -> None:
    """Lossless with R = c2·v² on a long level line: d(E + λt)/dv = 0 for a metre gives λ = v²·R'(v) = 2·c2·v³."""
    train = make_train(resistance=(0.0, 0.0, 20.0))
    front = solve_front(build_section(flat(60_000.0), train))
    solution = front.trajectory(2_400.0)
    run = solution.trajectory
    middle = run.v_mps[(run.s_m > 10_000) & (run.s_m < 50_000)]
    assert middle.std() < 0.15
    assert solution.lambda_w == pytest.approx(2 * 20.0 * middle.mean() ** 3, rel=0.03)


def test_a_train_takes_the_limit_with_its_tail() -> None:
    route = make_route(6_000.0, [(0.0, 15.0), (2_000.0, 30.0)], [(0.0, 0.0)])
    section = build_section(route, replace(make_train(), train_length_m=300.0))
    run = solve_front(section).fastest().trajectory
    inside = run.s_m[:-1] < 2_300.0 - 1e-6
    assert run.limit_mps[inside].max() == 15.0
    assert run.limit_mps[~inside].min() == 30.0


def test_gradient_is_averaged_over_the_train() -> None:
    route = make_route(4_000.0, [(0.0, 30.0)], [(0.0, 0.0), (2_000.0, 0.01)])
    section = build_section(route, replace(make_train(), train_length_m=400.0))
    middle = 0.5 * (section.node_m[:-1] + section.node_m[1:])
    expected = 0.01 * np.clip((middle - 2_000.0) / 400.0, 0, 1)
    assert np.allclose(section.grade_ratio, expected, atol=1e-12)


# --- brute force ------------------------------------------------------------------------------------------------


def test_supported_front_matches_brute_force_on_a_tiny_section() -> None:
    """Every speed profile of a small grid, exhaustively: none may beat the solver."""
    train = make_train(resistance=(2_000.0, 0.0, 30.0), loss=EfficiencyLoss.from_efficiencies(0.85, 0.8))
    length, nodes = 800.0, 5
    front = solve_front(build_section(flat(length), train))
    s = np.linspace(0.0, length, nodes)
    speeds = np.arange(4.0, 26.0, 1.0)
    step = length / (nodes - 1)
    best: list[tuple[float, float]] = []
    for inner in itertools.product(speeds, repeat=nodes - 2):
        v = np.array([0.0, *inner, 0.0])
        force = 1e5 * np.diff(v**2) / (2 * step) + 2_000.0 + 30.0 * 0.5 * (v[:-1] ** 2 + v[1:] ** 2)
        if np.abs(force).max() > 1e5:
            continue
        time_s = float((2 * step / (v[:-1] + v[1:])).sum())
        work = force * step
        best.append((time_s, float(np.where(work > 0, work / 0.85, work * 0.8).sum())))
    assert len(best) > 1_000
    assert len(s) == nodes
    for time_s, energy in sorted(best)[:: len(best) // 40]:
        assert front.trajectory(time_s).balance.input <= energy * 1.001 + 1.0


# --- properties -------------------------------------------------------------------------------------------------


def test_more_time_never_costs_more(hilly: Front) -> None:
    least = hilly.fastest().time_s
    energies = [hilly.trajectory(least * (1 + b)).balance.input for b in np.linspace(0, 0.6, 25)]
    assert all(b <= a * (1 + 5e-4) for a, b in itertools.pairwise(energies))


@settings(max_examples=60, deadline=None)
@given(place=st.floats(0.0, 0.999), speed=st.floats(0.0, 1.0), buffer_ratio=st.floats(0.0, 0.8))
def test_from_any_state_the_run_is_possible_and_on_time(
    hilly: Front, place: float, speed: float, buffer_ratio: float
) -> None:
    section = hilly.section
    s_m = place * section.end_m
    envelope = math.sqrt(float(np.interp(s_m, section.node_m, section.envelope_mps**2)))
    least = hilly.fastest(s_m, 0.999 * speed * envelope).time_s
    solution = hilly.trajectory(least * (1 + buffer_ratio), s_m, 0.999 * speed * envelope)
    assert_possible(solution, section)
    assert solution.least_time_s == pytest.approx(least, abs=1e-6)
    if solution.fit is Fit.ON_TIME:
        assert abs(solution.time_s - solution.requested_s) <= tol.TIME_TOLERANCE_S + 1e-9


def test_a_hill_that_needs_momentum_keeps_its_certificate_finite() -> None:
    """From too low a speed before the hill the train stalls: those states must not leak into their neighbours."""
    route = make_route(6_000.0, [(0.0, 30.0)], [(0.0, 0.0), (4_200.0, 0.12), (4_500.0, 0.0)])
    front = solve_front(build_section(route, make_train(resistance=(2_000.0, 0.0, 10.0))))
    for v_mps in (16.0, 20.0, 25.0):
        solution = front.trajectory(front.fastest(4_000.0, v_mps).time_s * 1.05, 4_000.0, v_mps)
        assert 0.0 <= solution.gap_ratio < 0.2


@pytest.mark.parametrize("before_m", [1.9, 1.0, 0.5, 0.05])
def test_from_standstill_just_before_the_stop(hilly: Front, before_m: float) -> None:
    """It moves on to the stop, or says that it cannot; never a time that is not a number."""
    try:
        solution = hilly.trajectory(100.0, 12_000.0 - before_m, 0.0)
    except InfeasibleError:
        assert before_m < 1.0
    else:
        assert 0 < solution.time_s < 100.0 + 1e-6


@pytest.mark.parametrize(
    ("start_m", "end_m"),
    [(-1.0, 500.0), (0.0, 1e10), (500.0, 400.0), (0.0, math.nan), (12_000.0 - 1e-6, 12_000.0)],
)
def test_a_section_off_the_route_or_without_length_is_refused(hilly: Front, start_m: float, end_m: float) -> None:
    with pytest.raises(DasError, match="expected one in the direction of the route"):
        build_section(hilly.section.route, hilly.section.vehicle, start_m=start_m, end_m=end_m)


def test_grid_refinement_changes_little(monkeypatch: pytest.MonkeyPatch, hilly: Front) -> None:
    time_s = hilly.fastest().time_s * 1.1
    coarse = hilly.trajectory(time_s).balance.input
    for name in ("SHORT_SPEED_STEPS", "SPEED_STEPS", "STEPS_OF_A_SECTION"):
        monkeypatch.setattr(tol, name, 2 * getattr(tol, name))
    refined = build_section(hilly.section.route, hilly.section.vehicle)
    assert len(refined.decision) > 1.2 * len(hilly.section.decision)
    fine = solve_front(refined).trajectory(time_s).balance.input
    assert coarse == pytest.approx(fine, rel=1e-3)


def test_same_inputs_same_answer_to_the_last_bit(hilly: Front) -> None:
    again = solve_front(build_section(hilly.section.route, hilly.section.vehicle), threads=1)
    a, b = hilly.trajectory(600.0), again.trajectory(600.0)
    assert np.array_equal(a.trajectory.v_mps, b.trajectory.v_mps)


def test_above_the_envelope_the_train_brakes_as_hard_as_it_can(hilly: Front) -> None:
    run = hilly.trajectory(400.0, 4_400.0, 35.0).trajectory
    assert run.v_mps[0] == 35.0
    power_force = min(1e5, 1.5e6 / 35.0)
    assert run.force_el_n[0] == pytest.approx(-power_force, rel=0.02)


# --- errors -----------------------------------------------------------------------------------------------------


def test_a_hill_too_steep_is_named() -> None:
    route = make_route(5_000.0, [(0.0, 30.0)], [(0.0, 0.0), (2_000.0, 0.2)])
    with pytest.raises(InfeasibleError, match=r"stalls at \d+ m \(200\.0 ‰\)"):
        build_section(route, make_train())


def test_a_descent_too_steep_is_named() -> None:
    route = make_route(5_000.0, [(0.0, 30.0)], [(0.0, -0.2)])
    with pytest.raises(InfeasibleError, match=r"cannot brake on the descent at \d+ m \(-200\.0 ‰\)"):
        build_section(route, make_train())


@pytest.mark.parametrize("time_s", [0.0, -1.0, math.nan, math.inf])
def test_a_time_that_is_none_is_refused(hilly: Front, time_s: float) -> None:
    with pytest.raises(DasError, match="trip time"):
        hilly.trajectory(time_s)


def test_a_map_that_does_not_cover_the_train_names_the_point() -> None:
    speed, force = np.arange(0.0, 20.1, 1.0), np.arange(-1e5, 1.01e5, 1e4)
    small = LossMap(name="small.csv", speed_mps=speed, force_n=force, loss_w_table=np.full((21, 21), 1e3))
    with pytest.raises(DasError, match=r"small\.csv: the state 100\.0 kN at \d+\.\d km/h .* outside the loss map"):
        build_section(flat(5_000.0), make_train().with_loss_map(small))


def test_bounds_of_every_kernel_of_a_front(hilly: Front) -> None:
    """Run alone with NUMBA_BOUNDSCHECK=1 by .ci/run: a read past an array's end raises there."""
    table = np.fromfunction(lambda i, j: 1e3 + 10.0 * i + abs(j - 10) * 1e3, (62, 21))
    loss_map = LossMap(name="map", speed_mps=np.arange(62.0), force_n=np.linspace(-1e5, 1e5, 21), loss_w_table=table)
    front = solve_front(build_section(hilly.section.route, make_train().with_loss_map(loss_map)))
    for level in (front, hilly):
        for s_m, v_mps in ((None, None), (11_999.0, 1.0), (2_999.9, 21.0), (4_499.0, 45.0)):
            level.fastest(s_m, v_mps)
            level.trajectory(700.0, s_m, v_mps)


# --- the bundled and the public ---------------------------------------------------------------------------------


def test_cruising_minimum_of_the_re460_at_l2() -> None:
    """Paper, fig. 4: least energy per km at about 63 km/h. Here: a long level run with ample time."""
    vehicle = replace(load_vehicle("re460-ic"), train_length_m=0.0)
    front = solve_front(build_section(make_route(80_000.0, [(0.0, 44.0)], [(0.0, 0.0)]), vehicle, level=Level.L2))
    run = front.trajectory(80_000.0).trajectory
    middle = run.v_mps[(run.s_m > 20_000) & (run.s_m < 60_000)]
    assert 3.6 * middle.mean() == pytest.approx(63.0, abs=1.0)


@pytest.mark.parametrize(
    ("route", "level"),
    crossed(
        [load_route("flat-6km"), load_route("zurich-luzern"), load_route("zurich-luzern").reversed()],
        [Level.L0_NOREG, Level.L0_REG, Level.L1, Level.L2, Level.L3],
    ),
)
def test_bundled_routes_at_every_level(route: Route, level: Level) -> None:
    section = build_section(route, load_vehicle("re460-ic"), level=level)
    front = solve_front(section)
    for buffer_ratio in (0.0, 0.07, 0.2):
        solution = front.trajectory(front.fastest().time_s * (1 + buffer_ratio))
        assert_possible(solution, section)
        if level is Level.L0_NOREG:
            assert (solution.trajectory.force_el_n >= 0).all()


def pose_reference(problem: Instance, map_path: Path | None) -> tuple[Section, Line, Train, Loss]:
    """A problem of the benchmark as the solver gets it, and as the verifier reads it."""
    track, own_path = track_path(problem.track), train_path(problem.train)
    train = replace(Train.read(own_path), length_m=0.0)
    if problem.brakes == "electric":
        train = replace(train, brakes="electric", friction_n=0.0)
    if map_path:
        loss = raw_data.read_loss_map(map_path)
    else:
        loss = constant_efficiencies(*map(float, problem.loss_model.removeprefix("constant ").split("/")))
    if map_path or problem.brakes == "electric":
        effort = Effort(213.9e3, 3129.278e3)
        train = replace(train, traction=effort, electric=effort, max_speed_mps=160 / 3.6)
    own_map = read_loss_map(map_path) if map_path else None
    section = posed(problem, load_route(str(track)), load_vehicle(str(own_path)), own_map)
    return section, Line.read(track), train, loss


def assert_no_worse(results: list[ReferenceResult], map_path: Path | None = None) -> None:
    """Energy at most 0.1 % above the best public optimiser at the same time, and nothing the verifier finds wrong."""
    fronts: dict[Instance, tuple[Front, Line, Train, Loss]] = {}
    for result in results:
        key = result.problem
        if key not in fronts:
            section, line, train, loss = pose_reference(key, map_path)
            fronts[key] = (solve_front(section), line, train, loss)
        front, line, train, loss = fronts[key]
        solution = front.trajectory(result.time_s)
        assert abs(solution.time_s - result.time_s) < 0.1
        assert_possible(solution, front.section)
        assert solution.balance.input / KWH <= result.energy_kwh * 1.001, (key, result.time_s)
        claim = solution_json(solution, solution.least_time_s, 0.0)
        ends_m, run = (front.section.start_m, front.section.end_m), csv_rows(solution.trajectory)
        assert verify(run, line, train, loss, ends_m=ends_m, end_speeds_mps=(1.0, 1.0), claim=claim) == [], key


def test_public_benchmark_with_constant_efficiencies() -> None:
    results = [result for result in reference_results() if not result.has_map]
    assert len(results) == 14
    assert_no_worse(results)


@pytest.mark.slow
def test_public_benchmark_with_the_loss_map_of_the_virm6(shared: Path) -> None:
    """The loss map is a third party's table of 11 569 points; it stays in ../shared."""
    results = [result for result in reference_results() if result.has_map]
    assert len(results) == 8
    assert_no_worse(results, shared / "loss_maps" / "NL_Intercity_VIRM6_chain.csv")


def test_least_times_of_the_public_benchmark() -> None:
    """Against an independent calculation in fine steps: within 0.05 %, never optimistic by more than 0.1 s."""
    for (track, train), expected in LEAST_TIMES_S.items():
        route, vehicle = load_route(str(track_path(track))), load_vehicle(str(train_path(train)))
        front = solve_front(build_section(route, vehicle, options=POINT), lambda_w=np.array([1e5]))
        assert expected - 0.1 < front.fastest().time_s < expected * 1.0005


def test_where_no_folder_can_hold_the_cache_kernels_are_compiled_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])  # as a read-only installation without a home
    assert kernel(lambda x: x + 1)(1) == 2
