"""Online calibration against the simulated train, whose true mass, resistance and wind are known."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import cycle, pairwise, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from das.domain.conditions import Conditions
from das.domain.files.load import load_route, load_vehicle
from das.domain.route import Route, Tunnel, Zone
from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate.calibration import (
    CHANGE_SD,
    LEAST,
    MODEL_SD,
    MOST,
    PRIOR_SD,
    REPLAN_EVERY_S,
    STEP,
    WINDOW_SAMPLES,
    Belief,
    Calibrator,
    Estimates,
    LineIntegral,
    Recalibration,
)
from das.estimate.estimate import Effort
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind
from sim.drivers.knowledge import LineKnowledge
from sim.plant.kernels import PlantState
from sim.plant.plant import COAST, Patch, Plant, force
from tests.support.crossing import few
from tests.support.making import flat, make_train
from tests.support.ride import Leg, ride

States = tuple[PlantState, ...]
START_NS = 10**18
ROUTE, VEHICLE = load_route("zurich-luzern"), load_vehicle("re460-ic")
THALWIL, ZUG = (0.0, 12e3, 640.0), (12e3, 29e3, 760.0)
LEGS = (THALWIL, ZUG)
SPEED_NOISE_MPS, FORCE_NOISE_RATIO, POSITION_NOISE_M, WANDER_S = 0.05, 0.02, 3.0, 30.0
SEEDS = range(8)
WITHIN_RATIO = 0.97
"""Least share of errors within three stated standard deviations."""
FLAT, POINT_MASS = flat(20e3), make_train(resistance=(1e3, 20.0, 4.0))
"""A level line of 20 km, and the benchmark's point mass of 100 t."""
TRUTHS = [(0.9, 0.8), (0.9, 1.5), (1.0, 1.0), (1.1, 1.25), (1.3, 0.8), (1.3, 1.5)]
"""Mass and resistance ratio."""
CASES = list(zip(TRUTHS, cycle(LEGS)))
"""The truths and legs of the default run: each truth on one of the legs."""


def drive(
    truth: Conditions,
    leg: tuple[float, float, float],
    route: Route = ROUTE,
    vehicle: Vehicle = VEHICLE,
    patches: Sequence[Patch] = (),
) -> States:
    """A human who knows the plan's train drives the true one from a place to another (m) in a time (s)."""
    line = LineKnowledge(route=route, vehicle=vehicle)
    return ride(
        Plant(route, vehicle, conditions=truth, patches=patches),
        make_driver(DriverKind.HUMAN, line, seed=1),
        line,
        Leg(start_m=leg[0], stop_m=leg[1], departure_s=0.0, arrival_s=leg[2]),
    ).states


@cache
def driven(
    mass: float = 1.0, resistance: float = 1.0, wind_mps: float = 0.0, leg: tuple[float, float, float] = THALWIL
) -> States:
    return drive(Conditions(mass_ratio=mass, resistance_ratio=resistance, head_wind_mps=wind_mps), leg)


def ns(time_s: float) -> int:
    return START_NS + round(time_s / NS)


def feed(calibrator: Calibrator, states: States, seed: int | None = 0, off_m: float = 0.0) -> Iterator[PlantState]:
    """Feed it a drive with sensor noise (`seed` None: without), second by second."""
    random = np.random.default_rng(seed)
    size, keep, wander_m = float(seed is not None), math.exp(-1.0 / WANDER_S), 0.0
    for state in states:
        noise = size * random.standard_normal(4)
        wander_m = keep * wander_m + math.sqrt(1 - keep**2) * POSITION_NOISE_M * noise[0]
        at_ns, moves = ns(state.time_s), state.speed_mps > 0
        measured_mps = max(state.speed_mps + SPEED_NOISE_MPS * noise[1], 0.0) if moves else 0.0
        calibrator.set_position(at_ns, max(state.s_m + wander_m + off_m, 0.0), measured_mps)
        electric_n, friction_n = (1.0 + FORCE_NOISE_RATIO * noise[2:]) * (state.force_el_n, state.force_friction_n)
        calibrator.set_effort(Effort(time_ns=at_ns, force_el_n=electric_n, force_friction_n=friction_n))
        yield state


@cache
def _blank() -> Calibrator:
    return Calibrator(ROUTE, VEHICLE)


def fresh() -> Calibrator:
    """A calibrator of the planned train that has measured nothing; the line is integrated once."""
    return copy.deepcopy(_blank(), {id(VEHICLE): VEHICLE})  # its tables of losses cannot be copied, and never change


def estimated_by(calibrator: Calibrator, states: States) -> Estimates:
    """Its estimates after a drive without noise."""
    for _ in feed(calibrator, states, None):
        pass
    return calibrator.estimates


def estimated(states: States, seed: int | None = 0, off_m: float = 0.0) -> tuple[Estimates, Estimates]:
    """The estimates 5 km after the start, and at the end."""
    calibrator, early = fresh(), None
    for state in feed(calibrator, states, seed, off_m):
        if early is None and state.s_m >= states[0].s_m + 5e3:
            early = calibrator.estimates
    assert early is not None
    return early, calibrator.estimates


@cache
def errors(truth: tuple[float, float], leg: tuple[float, float, float]) -> NDArray[np.float64]:
    """Errors (seeds, early or end, mass or resistance, error or sd)."""
    found = [estimated(driven(*truth, leg=leg), seed) for seed in SEEDS]
    return np.array(
        [
            [
                [(e.mass_ratio - truth[0], e.mass_sd), (e.resistance_ratio - truth[1], e.resistance_sd)]
                for e in both
            ]
            for both in found
        ]
    )  # fmt: skip


def all_errors() -> NDArray[np.float64]:
    """Relative errors (truth and leg, seeds, early or end, mass or resistance)."""
    return np.array([errors(truth, leg)[..., 0] / truth for truth in TRUTHS for leg in LEGS])


# --- the recursion ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 4])
def test_without_forgetting_the_recursion_is_the_batch_least_squares(n: int) -> None:
    random = np.random.default_rng(n)
    rows, truth = random.standard_normal((300, n)) * 10 ** random.uniform(-2, 2, (300, 1)), random.standard_normal(n)
    sd = 10 ** random.uniform(-1, 1, 300)
    seen = rows @ truth + sd * random.standard_normal(300)
    prior_sd = np.full(n, 3.0)
    belief = Belief(np.ones(n), np.diag(prior_sd**2))
    for row, y, own_sd in zip(rows, seen, sd, strict=True):
        belief = belief.updated(row, y - row @ belief.theta, own_sd**2)
    # The prior is n more observations: of each parameter, 1 within its standard deviation.
    whole = np.vstack([rows / sd[:, None], np.diag(1 / prior_sd)])
    theta, *_ = np.linalg.lstsq(whole, np.concatenate([seen / sd, np.ones(n) / prior_sd]), rcond=None)
    assert belief.theta == pytest.approx(theta, rel=1e-9, abs=1e-9)
    assert belief.covariance == pytest.approx(np.linalg.inv(whole.T @ whole), rel=1e-8, abs=1e-12)


def test_what_is_not_observed_and_does_not_drift_is_not_forgotten() -> None:
    """However long the resistance is seen, the mass keeps its variance; that of the resistance stands still at last."""
    belief, noise, drift = Belief(np.zeros(2), np.diag([0.04, 9.0])), 0.5, 0.1
    for _ in range(5000):
        belief = belief.drifted((0.0, drift), (3.0, 3.0)).updated(np.array([0.0, 2.0]), 0.1, noise)
    assert belief.covariance[0, 0] == 0.04
    assert belief.covariance[0, 1] == 0.0
    before = belief.covariance[1, 1] + drift**2
    assert belief.covariance[1, 1] == pytest.approx(before - (2 * before) ** 2 / (4 * before + noise), rel=1e-9)


def test_what_drifts_is_followed_and_never_less_certain_than_before_anything_was_measured() -> None:
    """A step is found as fast as the steady gain of the filter says: 1 − (1 − K)ⁿ of it after n observations."""
    row, belief, drift = np.array([1.0]), Belief(np.zeros(1), np.eye(1)), (0.02,)
    for _ in range(2000):
        belief = belief.drifted(drift, (1.0,)).updated(row, 0.0 - belief.theta[0], 1.0)
    before = belief.covariance[0, 0] + drift[0] ** 2
    for _ in range(50):
        belief = belief.drifted(drift, (1.0,)).updated(row, 1.0 - belief.theta[0], 1.0)
    assert belief.theta[0] == pytest.approx(1 - (1 / (1 + before)) ** 50, rel=1e-6)
    assert belief.drifted((9.0,), (1.0,)).covariance[0, 0] == 1.0


# --- against the train model ------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", few(product(TRUTHS, LEGS), CASES))
def test_mass_and_resistance_are_found(case: tuple[tuple[float, float], tuple[float, float, float]]) -> None:
    """Over the seeds, after 5 km and at the end: the largest error, and the root of the mean square."""
    truth, leg = case
    off = errors(truth, leg)[..., 0] / truth
    assert (np.abs(off).max(axis=0) <= [(0.045, 0.14), (0.03, 0.1)]).all(), np.abs(off).max(axis=0)
    assert (np.sqrt(np.mean(off**2, axis=0)) <= [(0.025, 0.08), (0.015, 0.045)]).all(), off.std(axis=0)


def test_the_stated_confidence_is_true() -> None:
    """Within 3 sd in at least 97 % of the runs, and the sd is no empty promise: below 2 % and 6 %."""
    every = np.concatenate([errors(truth, leg) for truth, leg in CASES])
    within = np.abs(every[..., 0]) <= 3 * every[..., 1]
    assert within.mean(axis=(0, 1)).min() >= WITHIN_RATIO
    assert (every[:, 1, :, 1].max(axis=0) < (0.02, 0.06)).all()
    assert (every[..., 0] / every[..., 1]).std() > 0.3


@pytest.mark.parametrize("wind_mps", [-8.0, 10.0])
def test_wind_is_found_as_resistance(wind_mps: float) -> None:
    states = driven(wind_mps=wind_mps)
    speed_mps = np.array([s.speed_mps for s in states if s.speed_mps > 20])
    blown = VEHICLE.resistance.in_head_wind(wind_mps).force_n(speed_mps).mean()
    expected = blown / VEHICLE.resistance.force_n(speed_mps).mean()
    assert abs(expected - 1) > 0.15
    found = [estimated(states, seed)[1] for seed in SEEDS]
    assert np.mean([e.resistance_ratio for e in found]) == pytest.approx(expected, rel=0.05)
    assert [e.resistance_ratio for e in found] == pytest.approx([expected] * len(found), rel=0.08)
    assert [e.mass_ratio for e in found] == pytest.approx([1.0] * len(found), rel=0.03)
    assert all(e.differs(Conditions()) for e in found)


@pytest.mark.parametrize("off_m", [-5.0, 5.0])
def test_a_position_that_is_wrong_by_metres_does_not_bias(off_m: float) -> None:
    truth = (1.1, 1.25)
    there = errors(truth, ZUG)[:, 1, :, 0].mean(axis=0)
    ends = [estimated(driven(*truth, leg=ZUG), seed, off_m)[1] for seed in SEEDS]
    shifted = np.mean([(e.mass_ratio, e.resistance_ratio) for e in ends], axis=0) - truth
    assert shifted[0] == pytest.approx(there[0], abs=3e-3)
    assert shifted[1] == pytest.approx(there[1], abs=0.015)


def test_rotating_masses_and_tunnels_are_taken_as_known() -> None:
    route = replace(flat(12e3), tunnels=(Tunnel(start_m=5e3, length_m=4e3, area_m2=40.0),))
    vehicle = replace(
        VEHICLE,
        rotating_mass_ratio=0.08,
        tunnel_area_m2=(40.0,),
        tunnel_resistance_n_per_mps2=(8.0,),
        train_length_m=200.0,
    )
    states = drive(Conditions(mass_ratio=1.2, resistance_ratio=1.2), (0.0, 12e3, 420.0), route, vehicle)
    found = estimated_by(Calibrator(route, vehicle), states)
    assert found.mass_ratio == pytest.approx(1.2, rel=0.01)
    assert found.resistance_ratio == pytest.approx(1.2, rel=0.02)
    blind = estimated_by(Calibrator(route, replace(vehicle, tunnel_area_m2=())), states)
    assert blind.resistance_ratio > 1.26


def test_a_window_is_as_uncertain_as_its_speeds_scatter() -> None:
    """The slope of speeds with the standard deviation σ has the variance σ²/Σ(t − t̄)²."""
    sd_mps, t = 0.3, np.arange(400.0)
    v = 20.0 + np.random.default_rng(1).normal(0.0, sd_mps, len(t))
    s = np.append(0.0, np.cumsum(0.5 * (v[1:] + v[:-1])))
    found = LineIntegral(FLAT, POINT_MASS, 0.0).window(t, s, v, np.zeros_like(t), np.zeros_like(t))
    assert found is not None
    assert found.acceleration_variance * np.sum((t - t.mean()) ** 2) == pytest.approx(sd_mps**2, rel=0.15)


def test_positions_and_efforts_may_come_at_moments_of_their_own() -> None:
    """Efforts at 1 Hz, positions at 5 Hz between them and sent after the next effort: the estimates stay."""
    states = driven(1.1, 1.25)
    plain, between = estimated_by(fresh(), states), fresh()
    for before, state in pairwise(states):
        effort = Effort(time_ns=ns(state.time_s), force_el_n=state.force_el_n, force_friction_n=state.force_friction_n)
        between.set_effort(effort)
        for share in (0.1, 0.3, 0.5, 0.7, 0.9):
            at = [x + share * (y - x) for x, y in zip(before[:3], state[:3], strict=True)]
            between.set_position(ns(at[0]), at[1], at[2])
    assert between.estimates.samples >= 0.9 * plain.samples
    assert between.estimates.mass_ratio == pytest.approx(plain.mass_ratio, rel=0.01)
    assert between.estimates.resistance_ratio == pytest.approx(plain.resistance_ratio, rel=0.03)


def test_a_wind_that_rises_on_the_way_is_learned() -> None:
    patch = Patch(from_s=200.0, head_wind_mps=20.0)
    calibrator, calm, rose = fresh(), None, []
    for state in feed(calibrator, drive(Conditions(), ZUG, patches=(patch,))):
        if state.time_s <= 200.0:
            calm = calibrator.estimates
        else:
            rose.append(calibrator.estimates)
    assert calm is not None
    assert calm.resistance_ratio == pytest.approx(1.0, abs=0.1)
    assert rose[-1].resistance_ratio == pytest.approx(1.8, abs=0.15)
    assert rose[-1].mass_ratio == pytest.approx(1.0, abs=0.03)
    # In between it states that it is uncertain.
    assert max(e.resistance_sd for e in rose) > 3 * calm.resistance_sd


# --- what does not count ------------------------------------------------------------------------------------------


def on_the_flat(seconds: int, force_n: float = 40e3, speed_mps: float = 20.0) -> States:
    """The point mass on the level line, under one force."""
    plant = Plant(FLAT, POINT_MASS)
    states = [plant.at(1e3, speed_mps)]
    for _ in range(seconds):
        states.append(plant.advance(states[-1], force(force_n) if force_n else COAST))
    return tuple(states)


def calibrated(states: States, route: Route | None = None, **train: float) -> Estimates:
    return estimated_by(Calibrator(route or FLAT, replace(POINT_MASS, **train)), states)


UNTOUCHED = Estimates(
    mass_ratio=1.0,
    mass_sd=math.hypot(PRIOR_SD.mass, MODEL_SD.mass),
    resistance_ratio=1.0,
    resistance_sd=math.hypot(PRIOR_SD.resistance, MODEL_SD.resistance),
    samples=0,
    usable=False,
)


def test_a_run_up_counts() -> None:
    assert calibrated(on_the_flat(45)).samples == 2
    assert calibrated(on_the_flat(45)).mass_sd < UNTOUCHED.mass_sd


def test_slow_and_standing_trains_do_not_count() -> None:
    assert calibrated(on_the_flat(30, force_n=10e3, speed_mps=1.0)) == UNTOUCHED
    standing = on_the_flat(0, speed_mps=0.0) * 200
    assert calibrated(tuple(s._replace(time_s=float(i)) for i, s in enumerate(standing))) == UNTOUCHED


NEUTRAL = replace(FLAT, neutral_sections=(Zone(start_m=1.3e3, length_m=100.0),))


@pytest.mark.parametrize(
    ("route", "adhesive_mass_kg", "samples"),
    # µ(72 km/h) = 0.226: 44 kN on 20 t of driven axles.
    [(NEUTRAL, None, 0), (FLAT, None, 1), (FLAT, 20e3, 0), (FLAT, 30e3, 1)],
)
def test_neutral_sections_and_forces_near_what_the_rail_carries_do_not_count(
    route: Route, adhesive_mass_kg: float | None, samples: int
) -> None:
    train = {} if adhesive_mass_kg is None else {"adhesive_mass_kg": adhesive_mass_kg}
    found = calibrated(on_the_flat(WINDOW_SAMPLES), route, **train)
    assert found.samples == samples
    assert samples or found == UNTOUCHED


def test_brakes_of_uncertain_force_do_not_count_on_an_even_run() -> None:
    """Held downhill by the friction brake, whose force is known no better than the resistance."""
    run = on_the_flat(WINDOW_SAMPLES, force_n=0.0)
    rubbing = tuple(s._replace(force_el_n=150e3, force_friction_n=-150e3) for s in run)
    assert calibrated(rubbing, friction_brake_force_n=2e5).samples == 0
    assert calibrated(run, friction_brake_force_n=2e5).samples == 1


@pytest.mark.parametrize("fault", ["frozen", "jump", "unusable", "gap", "back", "no number", "too fast"])
def test_faults_of_the_sensors_break_the_window_off(fault: str) -> None:
    states = on_the_flat(WINDOW_SAMPLES)
    calibrator = Calibrator(FLAT, POINT_MASS)
    for i, s in enumerate(states[:WINDOW_SAMPLES]):
        late, s_m, speed_mps = i >= 12, s.s_m, s.speed_mps
        if fault == "frozen" and late:
            s_m = states[11].s_m
        if fault == "jump" and late:
            s_m += 200.0
        if fault == "no number" and i == 12:
            speed_mps = math.nan
        if fault == "too fast" and i == 12:
            speed_mps = 200.0
        shift_s = {"gap": 5.0, "back": -30.0}.get(fault, 0.0) * late
        at_ns = ns(s.time_s + shift_s)
        calibrator.set_position(at_ns, s_m, speed_mps, usable=not (fault == "unusable" and i == 12))
        calibrator.set_effort(Effort(time_ns=at_ns, force_el_n=s.force_el_n, force_friction_n=0.0))
    assert calibrator.estimates == UNTOUCHED


def test_one_window_of_wrong_forces_is_left_out() -> None:
    states = driven(1.1, 1.25)
    slipping = tuple(s._replace(force_el_n=s.force_el_n + 80e3 * (400 <= i < 420)) for i, s in enumerate(states))
    clean, faulty = (estimated(one, 3)[1] for one in (states, slipping))
    assert clean.samples - 2 <= faulty.samples < clean.samples
    assert faulty.mass_ratio == pytest.approx(clean.mass_ratio, abs=0.005)
    assert faulty.resistance_ratio == pytest.approx(clean.resistance_ratio, abs=0.02)


def test_after_a_stop_the_mass_may_be_another_one() -> None:
    calibrator, last = fresh(), driven()[-1]
    before = estimated_by(calibrator, driven())
    for i in range(1, 120):
        at_ns = ns(last.time_s + i)
        calibrator.set_position(at_ns, last.s_m, 0.0)
        calibrator.set_effort(Effort(time_ns=at_ns, force_el_n=0.0, force_friction_n=0.0))
    after = calibrator.estimates
    assert after.mass_sd == pytest.approx(math.hypot(before.mass_sd, CHANGE_SD.mass))
    assert (after.mass_ratio, after.resistance_sd) == (before.mass_ratio, before.resistance_sd)
    assert before.usable
    assert not after.usable


numbers = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-400e3, 400e3) | st.floats(0, 60)
measured = st.tuples(
    st.integers(0, 3000) | st.integers(-(2**63), 2**63 - 1), numbers, numbers, numbers, numbers, st.integers(1, 30)
)


@settings(max_examples=30)
@given(st.lists(measured, max_size=20))
def test_garbage_stays_bounded(stream: list[tuple[int, float, float, float, float, int]]) -> None:
    calibrator = Calibrator(FLAT, POINT_MASS)
    for time, s_m, speed_mps, electric_n, friction_n, times in stream:
        for i in range(times):
            at_ns = time * 10**9 + i * 10**9
            calibrator.set_position(at_ns, s_m + i * speed_mps, speed_mps)
            calibrator.set_effort(Effort(time_ns=at_ns, force_el_n=electric_n, force_friction_n=friction_n))
        found = calibrator.estimates
        assert LEAST.mass <= found.mass_ratio <= MOST.mass
        assert LEAST.resistance <= found.resistance_ratio <= MOST.resistance
        assert MODEL_SD.mass < found.mass_sd <= UNTOUCHED.mass_sd
        assert MODEL_SD.resistance < found.resistance_sd <= UNTOUCHED.resistance_sd


@pytest.mark.parametrize("electric_n", [-60e3, 90e3])
def test_forces_that_do_not_belong_to_the_motion_end_at_the_bounds_or_unusable(electric_n: float) -> None:
    states = tuple(s._replace(force_el_n=electric_n) for s in on_the_flat(400, force_n=6.8e3, speed_mps=30.0))
    found = calibrated(states)
    assert found.samples > 5
    assert not found.usable
    assert not found.differs(Conditions())


# --- the use of the estimates -------------------------------------------------------------------------------------


def estimates(mass: float, resistance: float, mass_sd: float = 0.008, resistance_sd: float = 0.03) -> Estimates:
    return Estimates(
        mass_ratio=mass,
        mass_sd=mass_sd,
        resistance_ratio=resistance,
        resistance_sd=resistance_sd,
        samples=20,
        usable=True,
    )


@pytest.mark.parametrize(
    ("found", "differs"),
    [
        (estimates(1.0, 1.0), False),
        (estimates(1.029, 1.0), False),
        (estimates(1.031, 1.0), True),
        (estimates(0.96, 1.0), False),  # The brakes of a lighter train would be better than those of the file.
        (estimates(0.96, 1.1), True),
        (estimates(1.04, 1.0, mass_sd=0.015), False),
        (estimates(1.0, 1.08), False),
        (estimates(1.0, 1.10), True),
        (estimates(1.0, 1.06, resistance_sd=0.015), True),
        (estimates(1.0, 1.04, resistance_sd=0.01), False),
        (replace(estimates(1.2, 1.5), usable=False), False),
    ],
)
def test_differs_is_certain_and_matters(found: Estimates, differs: bool) -> None:
    assert found.differs(Conditions()) is differs


def test_the_plan_is_made_anew_when_it_would_change_and_not_too_often() -> None:
    kept = Conditions(receptivity_ratio=0.5)
    recalibration, now = Recalibration(kept), START_NS
    assert recalibration.due(estimates(1.0, 1.0), now) is None
    first = recalibration.due(estimates(1.1, 1.2), now)
    assert first == Conditions(mass_ratio=1.1, resistance_ratio=1.2, receptivity_ratio=0.5)
    assert first.train(VEHICLE).mass_kg == pytest.approx(1.1 * VEHICLE.mass_kg)
    assert recalibration.due(estimates(1.1 + 0.9 * STEP.mass, 1.22), now + 10**12) is None
    soon, later = now + round(0.9 * REPLAN_EVERY_S / NS), now + round(1.1 * REPLAN_EVERY_S / NS)
    assert recalibration.due(estimates(1.2, 1.2), soon) is None
    assert recalibration.due(estimates(1.2, 1.2), later) == replace(first, mass_ratio=1.2)
    assert recalibration.conditions.mass_ratio == 1.2


@pytest.mark.parametrize("leg", few([THALWIL, ZUG], (THALWIL,), pytest.mark.slow))
def test_a_train_as_planned_is_left_as_it_is_and_its_sensor_trusted(
    leg: tuple[float, float, float],
) -> None:
    for seed in SEEDS:
        calibrator = fresh()
        for _ in feed(calibrator, driven(leg=leg), seed):
            found = calibrator.estimates
            assert found.doubt is None
            assert not found.differs(Conditions())
