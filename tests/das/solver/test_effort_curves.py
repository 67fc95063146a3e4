"""Trains with effort curves: closed forms, the short form in disguise, the exact front, proven bounds and the plant."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from das.domain.effort import EffortCurve, EffortEnvelope
from das.domain.files.load import load_route, load_vehicle
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.route import section_stops
from das.domain.vehicle import BrakePolicy, Vehicle
from das.offline.refinement import refined
from das.solver.kernels.forces import electric_limit, traction_limit
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from das.table import section_sha256
from docs.studies.tight_bound import tightened
from precompute.baselines import strategies
from precompute.exact.front import solve_exact
from precompute.exact.grid import Grid
from sim.plant.plant import Dynamics, Plant, lever
from tests.support.making import flat, make_route, make_train

SPEEDS, FORCES = (0.0, 5.0, 12.0, 20.0, 60.0), (8e4, 1e5, 9e4, 5e4, 3e4)
"""A curve that rises, falls gently, falls steeply, and falls gently again."""


def of_points(speeds: tuple[float, ...], forces: tuple[float, ...], top_mps: float = 60.0) -> EffortEnvelope:
    return EffortEnvelope.of_curve(EffortCurve(speed_mps=speeds, force_n=forces), top_mps)


def curved(**changes: object) -> Vehicle:
    """The train of the tests (100 t, no resistance) with the curve as its traction."""
    return replace(make_train(), traction=of_points(SPEEDS, FORCES), **changes)  # type: ignore[arg-type]


def way_and_time(v_mps: float, mass_kg: float = 1e5) -> tuple[float, float]:
    """Way (m) and time (s) from standstill to a speed at full traction without resistance, in closed form.

    On a piece with F = A + b·v: t = m/b·ln(F/F₀) and s = m·((v − v₀)/b − A/b²·ln(F/F₀)).
    """
    way_m = time_s = 0.0
    for v0, v1, f0, f1 in zip(SPEEDS[:-1], SPEEDS[1:], FORCES[:-1], FORCES[1:], strict=True):
        if v_mps <= v0:
            break
        b = (f1 - f0) / (v1 - v0)
        end = min(v1, v_mps)
        a, log = f0 - b * v0, math.log((f0 + b * (end - v0)) / f0)
        time_s += mass_kg / b * log
        way_m += mass_kg * ((end - v0) / b - a / b**2 * log)
    return way_m, time_s


def test_the_solver_accelerates_along_a_piecewise_linear_curve_as_the_closed_form_says() -> None:
    run = solve_front(build_section(flat(4_000.0), curved())).fastest().trajectory
    top = int(np.argmax(run.v_mps))
    for number in np.linspace(0.3 * top, 0.95 * top, 12).astype(int):
        way_m, time_s = way_and_time(run.v_mps[number])
        assert run.s_m[number] == pytest.approx(way_m, rel=6e-3)
        assert run.t_s[number] == pytest.approx(time_s, rel=6e-3)


def test_the_plant_accelerates_along_it_as_well() -> None:
    """The train model looks the points up by itself; its forces are there within a millisecond."""
    soon = {f"{name}_{way}_s": 1e-3 for name in ("traction", "electric", "friction") for way in ("rise", "fall")}
    at_once = Dynamics(traction_dead_s=0.0, electric_dead_s=0.0, friction_dead_s=0.0, jerk_mps3=120.0, **soon)
    plant = Plant(flat(4_000.0), curved(), dynamics=at_once)
    state = plant.at(0.0)
    for until in (8.0, 15.0, 30.0, 50.0):
        state = plant.advance(state, lever(1.0), until - state.time_s)
        way_m, time_s = way_and_time(state.speed_mps)
        assert state.s_m == pytest.approx(way_m, rel=3e-3)
        assert state.time_s == pytest.approx(time_s, rel=1e-3, abs=plant.step_s)


@pytest.mark.parametrize("speed_mps", [0.0, 3.3, 5.0, 11.1, 12.34, 20.0, 33.0, 60.0])
def test_kernels_and_vehicle_give_the_same_efforts(speed_mps: float) -> None:
    """The kernels' samples cut a bend off their grid by less than a thousandth of the force."""
    train = curved(electric_brake=of_points(SPEEDS, FORCES[::-1]))
    params = build_section(flat(4_000.0), train).train
    assert traction_limit(speed_mps, params) == pytest.approx(float(train.traction_effort_n(speed_mps)), rel=1e-3)
    assert electric_limit(speed_mps, params) == pytest.approx(float(train.electric_brake_effort_n(speed_mps)), rel=1e-3)


def sampled(effort: EffortEnvelope, top_mps: float) -> EffortEnvelope:
    """Force and power as a curve with a point every 0.5 km/h."""
    speeds = np.append(np.arange(0.0, top_mps, 0.5 / 3.6), top_mps)
    return of_points(tuple(speeds.tolist()), tuple(effort.force_n(speeds).tolist()), top_mps)


def pair(vehicle: str) -> tuple[Section, Section]:
    """A section of a bundled train, and the same with its forces and powers as curves."""
    route, short = load_route("zurich-luzern"), load_vehicle(vehicle)
    start, end = section_stops(route, "Thalwil", "Zug")
    efforts = {name: sampled(getattr(short, name), short.max_speed_mps) for name in ("traction", "electric_brake")}
    return tuple(  # type: ignore[return-value]
        build_section(route, train, start_m=start.position_m, end_m=end.position_m)
        for train in (short, replace(short, **efforts))
    )


def needs(solution: Solution) -> float:
    return solution.balance.input


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["CH_Stadler_FLIRT_TPF", pytest.param("re460-ic", marks=pytest.mark.nightly)])
def test_force_and_power_as_curves_give_the_same_answers(vehicle: str) -> None:
    """Fastest run, table, refined run, baseline and bound: two ways through the kernels, one train."""
    short, curves = (solve_front(section) for section in pair(vehicle))
    least_s = short.fastest().time_s
    assert curves.fastest().time_s == pytest.approx(least_s, rel=1e-5)
    one, other = (front.trajectory(1.07 * least_s) for front in (short, curves))
    assert needs(other) == pytest.approx(needs(one), rel=3e-4)
    one, other = refined(one), refined(other)
    assert needs(other) == pytest.approx(needs(one), rel=1e-4)
    assert other.gap_ratio == pytest.approx(one.gap_ratio, abs=3e-4)
    plain, same = (strategies.reduced_maximum_speed(front.section, 1.07 * least_s) for front in (short, curves))
    assert same.balance.input == pytest.approx(plain.balance.input, rel=3e-4)


def test_a_train_in_the_short_form_drives_as_before() -> None:
    """Figures of the solver before it knew effort curves, on nodes that are rounded to the micrometre."""
    section, _ = pair("CH_Stadler_FLIRT_TPF")
    front = solve_front(section)
    assert front.fastest().time_s == pytest.approx(573.1383703261599, rel=1e-12)
    solution = front.trajectory(1.07 * front.fastest().time_s)
    assert needs(solution) / 3.6e6 == pytest.approx(83.32170024337536, rel=1e-9)
    assert needs(refined(solution)) / 3.6e6 == pytest.approx(83.28906834888957, rel=1e-9)


LOSS = EfficiencyLoss.from_efficiencies(0.85, 0.8, 2e4)
TRAINS: dict[str, Callable[[], Vehicle]] = {
    "traction": lambda: curved(losses={Level.OWN: LOSS}),
    "fading electric brake": lambda: curved(
        losses={Level.OWN: LOSS},
        electric_brake=of_points((0.0, 2.0, 15.0, 60.0), (0.0, 6e4, 6e4, 2e4)),
        friction_brake_force_n=9e4,
        brake_policy=BrakePolicy.BLENDED,
        max_deceleration_mps2=0.9,
    ),
}


@pytest.mark.parametrize("name", TRAINS)
@pytest.mark.parametrize("buffer_ratio", [0.02, 0.15])
def test_no_run_needs_less_than_its_bound_and_none_exceeds_its_curve(name: str, buffer_ratio: float) -> None:
    """Of refined runs, whose gap is small: a force above the curve, or a bound above the energy, shows at once."""
    train = replace(TRAINS[name](), resistance=replace(make_train().resistance, c0_n=2e3, c2_n_per_mps2=6.0))
    section = build_section(make_route(6_000.0, [(0.0, 30.0)], [(0.0, 0.0), (2_500.0, 0.008)]), train)
    front = solve_front(section)
    run = refined(front.trajectory((1 + buffer_ratio) * front.fastest().time_s))
    faster = np.maximum(run.trajectory.v_mps[:-1], run.trajectory.v_mps[1:])
    assert (run.trajectory.force_el_n <= train.traction_effort_n(faster) * (1 + 1e-3)).all()
    assert (-run.trajectory.force_el_n <= train.electric_brake_effort_n(faster) * (1 + 1e-3) + 1.0).all()
    assert 0.0 <= run.gap_ratio < 0.015


@pytest.mark.nightly
def test_the_tight_bound_of_a_loss_map_knows_the_curve() -> None:
    """Without the curve its gap would stay that of the quick bound, about 1 %."""
    route, train = load_route("flat-6km"), load_vehicle("re460-ic")
    speeds = tuple(np.arange(0.0, 61.0, 5.0).tolist())
    forces = tuple((0.8 * 3e5 * np.interp(speeds, [0.0, 10.0, 20.0, 60.0], [1.0, 0.9, 0.6, 0.15])).tolist())
    front = solve_front(build_section(route, replace(train, traction=of_points(speeds, forces, train.max_speed_mps))))
    run = refined(front.trajectory(1.07 * front.fastest().time_s))
    assert 0.0 <= tightened(run, math.inf).gap_ratio < 0.3 * run.gap_ratio


@pytest.mark.slow
@pytest.mark.parametrize("name", TRAINS)
def test_the_exact_front_agrees_with_the_solver_on_its_grid(name: str) -> None:
    """The solver is not bound to the grid: it needs at most as much, and not far below it."""
    section = build_section(
        flat(3_000.0, 22.0), TRAINS[name](), options=SectionOptions(start_speed_mps=5.0, end_speed_mps=5.0)
    )
    exact = solve_exact(section, 0.12, grid=Grid(step_m=100.0, speed_kmh=0.5, coast_kmh=0.05))
    front = solve_front(section)
    for time_s, energy_j in list(zip(exact.time_s, exact.energy_j, strict=True))[:: max(len(exact.time_s) // 5, 1)][1:]:
        if time_s > 1.02 * front.fastest().time_s:
            assert needs(front.trajectory(float(time_s))) == pytest.approx(float(energy_j), rel=0.03, abs=3e5)


def test_tables_of_one_mode_do_not_serve_another() -> None:
    route, train = flat(4_000.0), curved()
    other = replace(train, traction=of_points(SPEEDS, (*FORCES[:-1], 2.9e4)))
    first, second = (section_sha256(build_section(route, one, level=Level.OWN)) for one in (train, other))
    assert first != second
    assert section_sha256(build_section(route, replace(train, mode="a", modes={}), level=Level.OWN)) == first
