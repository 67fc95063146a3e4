"""Schedules: phases long enough to be followed, near the optimum, and a forecast that is what following comes to."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from das.domain.restriction import Restriction
from das.domain.units import KMH
from das.solver.guide.from_run import scheduled_run
from das.solver.guide.in_time import in_time
from das.solver.guide.policies import GuideFront
from das.solver.guide.schedule import BRAKES, Phase, PhaseKind, Schedule, on_section, settled
from das.solver.kernels.forces import electric_limit
from das.solver.section import Section, build_section
from das.solver.solution import trajectory_on
from das.solver.state import State
from tests.support.bundled_sections import (
    BUFFERS,
    BUNDLED,
    Which,
    asked_s,
    excess_ratio,
    front_of,
    guide_of,
    lasts_s,
    scheduled,
    section_of,
)
from tests.support.making import make_route
from tests.support.small_trips import TRAIN

RUNS = [(which, buffer) for which in BUNDLED for buffer in BUFFERS]
LATE_S = 2.0
"""A change that gains less time than this may not be worth making."""
WORST_RATIO, MEAN_RATIO = 0.02, 0.008
"""Energy above what the table knows in the same time: of any schedule, and in the mean of all."""
STANDS_S, NODE_S = 8.0, 1.0
"""How long (s) a phase that is no brake stands; it may be shorter by `NODE_S`, because phases begin at nodes."""


@pytest.mark.parametrize(("which", "buffer_ratio"), RUNS)
def test_a_schedule_is_in_time_near_the_optimum_and_can_be_followed(which: Which, buffer_ratio: float) -> None:
    """Below the envelope, its phases ascend, and those that are no brakes stand for 8 s.

    A speed that is held after accelerating or braking to it belongs to the phase that led to it.
    """
    found, section = scheduled(which, buffer_ratio), section_of(which)
    assert found.forecast.time_s <= asked_s(which, buffer_ratio) + LATE_S
    assert -5e-4 <= excess_ratio(which, found.forecast.energy_j, found.forecast.time_s) <= WORST_RATIO
    assert (found.forecast.speeds_mps <= section.envelope_mps + 1e-9).all()
    begins = [one.begin for one in found.schedule.phases]
    assert begins[0] == 0
    assert all(a < b for a, b in pairwise([*begins, len(section.step_m)]))
    spans: list[list[float]] = []
    for one, span in zip(found.schedule.phases, lasts_s(found.schedule), strict=True):
        if spans and one.kind is PhaseKind.HOLD and one.target_mps == spans[-1][2]:
            spans[-1][1] += span
        else:
            spans.append([one.kind, span, one.target_mps])
    assert all(span >= STANDS_S - NODE_S for kind, span, _ in spans if kind not in BRAKES), spans


def test_schedules_are_near_the_optimum_in_the_mean() -> None:
    """The bundled sections and four buffers."""
    found = [(which, scheduled(which, buffer).forecast) for which, buffer in RUNS]
    assert np.mean([excess_ratio(which, one.energy_j, one.time_s) for which, one in found]) <= MEAN_RATIO


@pytest.mark.parametrize("which", BUNDLED)
def test_time_and_energy_of_a_forecast_are_those_of_its_trajectory(which: Which) -> None:
    """Second witness: times and energy balance of `trajectory_on`, with the loss model in Python."""
    section = section_of(which)
    for buffer in BUFFERS:
        forecast = scheduled(which, buffer).forecast
        trajectory = trajectory_on(section, section, forecast.speeds_mps)
        assert forecast.time_s == pytest.approx(trajectory.time_s, abs=1e-6)
        assert forecast.energy_j == pytest.approx(trajectory.balance(section.vehicle, section.loss).input, rel=1e-9)


@pytest.mark.parametrize("which", BUNDLED)
def test_forces_of_a_forecast_are_those_that_the_train_has(which: Which) -> None:
    """Traction and electric brake of the vehicle's own curves, at the higher speed of each interval."""
    section = section_of(which)
    vehicle = section.vehicle
    for buffer in BUFFERS:
        run = trajectory_on(section, section, scheduled(which, buffer).forecast.speeds_mps)
        faster = np.maximum(run.v_mps[:-1], run.v_mps[1:])
        assert (run.force_el_n <= vehicle.traction_effort_n(faster) + 1.0).all()
        assert (-run.force_el_n <= vehicle.electric_brake_effort_n(faster) + 1.0).all()
        rates = np.diff(run.v_mps**2) / (2.0 * section.step_m)
        assert rates.max() <= vehicle.max_acceleration_mps2 + 1e-6
        assert -rates.min() <= vehicle.max_deceleration_mps2 + 1e-6


@pytest.mark.parametrize("which", BUNDLED)
def test_a_train_on_the_run_has_the_run_before_it(which: Which) -> None:
    """At nodes and between them; time and speeds are the rest of the scheduled run's."""
    schedule, section = scheduled(which, 0.15).schedule, section_of(which)
    whole = scheduled(which, 0.15).forecast
    elapsed = section.elapsed_s(whole.speeds_mps)
    for i in range(3, len(section.step_m) - 60, 97):
        here = schedule.forecast(float(section.node_m[i]), float(whole.speeds_mps[i]))
        assert here.speeds_mps[i:] == pytest.approx(whole.speeds_mps[i:], abs=2e-3)
        assert here.time_s == pytest.approx(whole.time_s - elapsed[i], abs=0.02)
        assert np.isnan(here.speeds_mps[:i]).all()
        middle_m = float(section.node_m[i : i + 2].mean())
        between = schedule.forecast(middle_m, schedule.speed_at(middle_m))
        assert between.time_s == pytest.approx(whole.time_s - elapsed[i : i + 2].mean(), abs=0.15)


@pytest.mark.parametrize("which", BUNDLED)
def test_a_train_off_the_run_comes_back_to_it(which: Which) -> None:
    """Slower by 10 km/h at a fifth of the way: it is later, by no more than 40 s, and in the end on the run.

    A brake along the curve keeps the share of it that it begins with, so some metres before the stop 0.05 m/s are left.
    """
    schedule, section = scheduled(which, 0.15).schedule, section_of(which)
    i = len(section.step_m) // 5
    s_m, v_mps = float(section.node_m[i]), float(schedule.known.speed_mps[i])
    kept, slower = schedule.forecast(s_m, v_mps), schedule.forecast(s_m, v_mps - 10 * KMH)
    assert 0.0 < slower.time_s - kept.time_s <= 40.0
    assert slower.speeds_mps[-20:] == pytest.approx(kept.speeds_mps[-20:], abs=0.05)


def test_following_without_merging_is_the_same_as_with_it() -> None:
    """`met_mps` is a short cut: a train that never meets the known run arrives when one does that merges."""
    schedule, section = scheduled(BUNDLED[2], 0.15).schedule, section_of(BUNDLED[2])
    i = len(section.step_m) // 3
    s_m, v_mps = float(section.node_m[i]), float(schedule.known.speed_mps[i]) - 2.0
    merged, followed = schedule.forecast(s_m, v_mps), schedule.forecast(s_m, v_mps, met_mps=-1.0)
    assert merged.time_s == pytest.approx(followed.time_s, abs=0.05)
    assert merged.energy_j == pytest.approx(followed.energy_j, rel=1e-4)


def restricted(which: Which, restriction: Restriction) -> Section:
    section = section_of(which)
    route = section.route.with_restrictions((restriction,))
    return build_section(route, section.vehicle, start_m=section.start_m, end_m=section.end_m)


@pytest.mark.parametrize("which", BUNDLED)
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_on_a_section_with_a_restriction_it_keeps_below_the_new_envelope(which: Which, share: float) -> None:
    """Its run and its forecast from before the restriction; phases still ascend."""
    free = section_of(which)
    start_m = free.start_m + share * (free.end_m - free.start_m)
    section = restricted(which, Restriction(start_m=start_m, end_m=start_m + 600.0, limit_mps=12.0))
    moved = on_section(scheduled(which, 0.15).schedule, section)
    begins = [one.begin for one in moved.phases]
    assert all(a < b for a, b in pairwise(begins))
    assert (moved.known.speed_mps <= section.envelope_mps + 1e-9).all()
    forecast = moved.forecast(free.start_m + 50.0, 5.0)
    known = np.isfinite(forecast.speeds_mps)
    assert (forecast.speeds_mps[known] <= section.envelope_mps[known] + 1e-9).all()
    assert forecast.time_s > scheduled(which, 0.15).forecast.time_s - 60.0


def test_on_its_own_section_a_schedule_stays_as_it_is() -> None:
    schedule = scheduled(BUNDLED[1], 0.08).schedule
    again = on_section(schedule, section_of(BUNDLED[1]))
    assert again.phases == schedule.phases
    assert again.known.speed_mps == pytest.approx(schedule.known.speed_mps)


def test_the_phase_of_a_place_its_begin_and_its_end() -> None:
    schedule, section = scheduled(BUNDLED[1], 0.08).schedule, section_of(BUNDLED[1])
    for k, one in enumerate(schedule.phases):
        begin_m = schedule.begin_m(k)
        assert begin_m == section.node_m[one.begin]
        assert schedule.ends_m[one.begin] == pytest.approx(
            schedule.begin_m(k + 1) - section.node_m[one.begin + 1], abs=1e-9
        )
    assert schedule.begin_m(len(schedule.phases)) == section.end_m


def test_from_under_way_a_schedule_needs_the_time_that_is_left() -> None:
    """Random states of the bundled sections: in time where 10 % more than the least is left, never above the envelope.

    Measured: the latest is late by 1.9 s.
    """
    random = np.random.default_rng(5)
    for which in BUNDLED:
        section, front = section_of(which), guide_of(which)
        for _ in range(4):
            s_m = float(random.uniform(section.start_m, section.end_m - 2000.0))
            v_mps = float(np.interp(s_m, section.node_m, section.envelope_mps) * random.uniform(0.2, 0.95))
            left_s = 1.1 * front_of(which).least_time_s(s_m, v_mps) + 5.0
            found = scheduled_run(front, in_time(front, State.at(section, s_m, v_mps), left_s)[0])
            assert found.forecast.time_s <= left_s + 3.0
            known = np.isfinite(found.forecast.speeds_mps)
            assert (found.forecast.speeds_mps[known][1:] <= section.envelope_mps[known][1:] + 1e-9).all()


FLAT = BUNDLED[0]


def braked(share: float, target_mps: float, from_m: float, to_m: float) -> tuple[Schedule, np.ndarray]:
    """A schedule of the flat 6 km that holds 130 km/h, brakes and holds its speed, and the run that keeps to it."""
    section = section_of(FLAT)
    first, last = (int(np.searchsorted(section.node_m, at)) for at in (from_m, to_m))
    phases = [Phase(PhaseKind.TRACTION, 1.0, 0, 130 * KMH), Phase(PhaseKind.BRAKE, share, first, target_mps)]
    if to_m < section.end_m:
        phases.append(Phase(PhaseKind.HOLD, 0.0, last, target_mps))
    schedule, forecast = settled(section, tuple(phases), section.start_m, 0.0)
    return schedule, forecast.speeds_mps


def rates_mps2(section: Section, speeds: np.ndarray) -> np.ndarray:
    """The deceleration (m/s²) of a run in every interval."""
    return -np.diff(speeds**2) / (2.0 * section.step_m)


@pytest.mark.parametrize("early_m", [0.0, 100.0, 400.0])
def test_a_brake_to_a_stop_keeps_one_share_of_the_braking_curve(early_m: float) -> None:
    """A train that begins on the curve stays on it to the stop; one that begins earlier keeps its share."""
    section = section_of(FLAT)
    met_m = float(np.interp(-130 * KMH, -section.envelope_mps, section.node_m))
    schedule, speeds = braked(0.0, 0.0, met_m - early_m, section.end_m)
    braking = (section.node_m > met_m + 50.0) & (section.node_m < section.end_m - 1.0)
    shares = (speeds[braking] / section.envelope_mps[braking]) ** 2
    assert shares.max() <= 1.0 + 1e-9
    assert np.ptp(shares) < 0.01
    assert not schedule.brakes_by_effort(1)


def test_a_brake_before_no_limit_is_one_effort_and_then_the_speed_is_held() -> None:
    section = section_of(FLAT)
    schedule, speeds = braked(0.4, 80 * KMH, 2500.0, 4500.0)
    assert schedule.brakes_by_effort(1)
    node_m = section.node_m
    braking = np.flatnonzero((node_m[:-1] >= 2500.0) & (speeds[1:] > 80.5 * KMH))
    assert len(braking) > 10
    for i in braking:
        faster = float(speeds[i])  # The effort of an interval is that of its faster end.
        force_n = 0.4 * electric_limit(faster, section.train) + section.resistance_n(float(node_m[i]), faster)
        assert rates_mps2(section, speeds)[i] == pytest.approx(force_n / section.train.inertial_mass_kg, rel=0.01)
    held = (node_m > node_m[braking[-1]] + 100.0) & (node_m < 5000.0)
    assert speeds[held] == pytest.approx(80 * KMH, abs=0.01)


def test_a_brake_without_an_effort_to_a_lower_speed_is_one_deceleration() -> None:
    """From 130 to 80 km/h in 2 km, with no limit there: v² falls evenly, (36.1² − 22.2²)/(2 · 2000) = 0.203 m/s²."""
    section = section_of(FLAT)
    _, speeds = braked(0.0, 80 * KMH, 2500.0, 4500.0)
    first, last = np.searchsorted(section.node_m, (2500.0, 4500.0))
    assert rates_mps2(section, speeds)[first + 1 : last - 1] == pytest.approx(0.203, rel=0.02)
    assert speeds[last] == pytest.approx(80 * KMH, abs=0.1)


def test_an_acceleration_without_which_the_train_stalls_on_a_hill_is_left_in() -> None:
    """Without it the train would only coast to the hill."""
    hill = make_route(4000.0, [(0.0, 25.0)], [(0.0, 0.0), (3000.0, 0.014), (3400.0, 0.0)])
    section = build_section(hill, TRAIN)
    front, state = GuideFront(section), State.at(section, 2700.0, 11.0)
    late_s = 1.3 * state.fastest().time_s
    found = scheduled_run(front, in_time(front, state, late_s)[0])
    assert PhaseKind.TRACTION in [one.kind for one in found.schedule.phases]
    assert found.forecast.time_s == pytest.approx(late_s, abs=2.0)
