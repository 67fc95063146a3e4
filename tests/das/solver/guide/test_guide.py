"""Plans over instructions: against the exact optimum, the schedules made from them, and what a driver is told."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from das.advice.shown import TARGET_STEP_MPS
from das.domain.braking import USUAL
from das.domain.effort import EffortEnvelope
from das.domain.errors import InfeasibleError
from das.domain.journey import Window
from das.domain.losses import EfficiencyLoss
from das.domain.route import Route, Zone
from das.domain.units import KMH
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver.front import Front
from das.solver.guide import policies
from das.solver.guide.from_run import said_of, scheduled_run
from das.solver.guide.in_time import _Search, in_time, lateness_s, through
from das.solver.guide.policies import GuideFront, GuideRun, PolicyFrom, PolicySettings
from das.solver.guide.schedule import Phase, PhaseKind
from das.solver.kernels.guide_policy import (
    CODE,
    HOLDS,
    KINDS,
    NO_INSTRUCTION,
    ON_CURVE,
    ROLLS_UP,
    guide_sweep,
)
from das.solver.section import Section, build_section, with_braking
from das.solver.solution import trajectory_on
from das.solver.solve import solve_front, usable_power_w
from das.solver.state import State, least_time_s
from tests.support.making import make_route, make_train

ROUTE = make_route(
    9_000.0,
    [(0.0, 100.0 * KMH), (2_500.0, 83.0 * KMH), (4_000.0, 140.0 * KMH), (7_000.0, 90.0 * KMH)],
    [(0.0, 0.0), (1_500.0, 0.008), (4_000.0, -0.010), (6_000.0, 0.0)],
)
"""Limits of which one is no step of 5 km/h, a hill and a descent."""
FALLING = make_route(8_000.0, [(0.0, 80.0 * KMH)], [(0.0, 0.0), (800.0, -0.028), (7_500.0, 0.0)])
"""A long descent on which a train without brakes would run away."""
STEEP = make_route(
    5_500.0,
    [(0.0, 60.0 * KMH), (1_700.0, 40.0 * KMH), (2_800.0, 55.0 * KMH)],
    [(0.0, 0.0), (300.0, -0.040), (5_200.0, 0.0)],
)
"""A descent on which a train that coasts gains speed almost as fast as with traction."""
LOSS = EfficiencyLoss.from_efficiencies(0.88, 0.85, 2e4)
LOCAL = make_train(resistance=(1500.0, 20.0, 4.0), power_w=1.5e6, loss=LOSS)
HEAVY = dataclasses.replace(LOCAL, mass_kg=4e5, friction_brake_force_n=2e5, brake_policy=BrakePolicy.BLENDED)
WITHOUT_MOTOR_BRAKE = dataclasses.replace(
    LOCAL, electric_brake=EffortEnvelope(max_force_n=0.0, max_power_w=0.0), friction_brake_force_n=1e5,
    brake_policy=BrakePolicy.FRICTION,
)  # fmt: skip
POINTS = [(ROUTE, LOCAL, 0.04), (ROUTE, LOCAL, 0.15), (ROUTE, HEAVY, 0.06), (FALLING, WITHOUT_MOTOR_BRAKE, 0.08),
          (STEEP, WITHOUT_MOTOR_BRAKE, 0.08)]  # fmt: skip
NAMES = ["local 4 %", "local 15 %", "heavy 6 %", "friction 8 %", "steep 8 %"]
LATE_S, MOST_RATIO = 2.0, 0.03
"""A change that gains less than `LATE_S` may not be worth making. Few changes on so short a line cost up to 3 %; with a
price of 0.08 s they cost up to 0.3 %, and twice as many are made."""
at_points = pytest.mark.parametrize(("route", "train", "buffer_ratio"), POINTS, ids=NAMES)


_SECTIONS: dict[tuple[int, int], tuple[Section, GuideFront, Front]] = {}


def solved(route: Route, train: Vehicle) -> tuple[Section, GuideFront, Front]:
    """The section of a train with service braking, its policies, and the exact front."""
    key = id(route), id(train)
    if key not in _SECTIONS:
        section = with_braking(build_section(route, train), USUAL.of(train))
        _SECTIONS[key] = section, GuideFront(section, threads=1), solve_front(section, threads=1)
    return _SECTIONS[key]


def asked(route: Route, train: Vehicle, buffer_ratio: float) -> tuple[GuideFront, GuideRun]:
    """The policies, and the run that takes this share longer than the fastest one."""
    section, front, _ = solved(route, train)
    time_s = least_time_s(section, section.start_m, 0.0) * (1.0 + buffer_ratio)
    return front, in_time(front, State.at(section), time_s)[0]


def told(run: GuideRun) -> Iterator[tuple[int, int, float]]:
    """Manner, number of the speed, and time (s) of each instruction; a speed that is reached is told already."""
    begins = [0, *(np.flatnonzero(np.diff(run.said)) + 1).tolist(), len(run.said)]
    for begin, end in pairwise(begins):
        x, manner = divmod(int(run.said[begin]), CODE)
        yield manner, x, float(run.elapsed_s[end] - run.elapsed_s[begin])


def changes(run: GuideRun) -> int:
    """How often a driver is told something new."""
    pairs = pairwise(told(run))
    return sum(not (now[0] == HOLDS and (before[0] == ON_CURVE or before[1] == now[1])) for before, now in pairs)


@at_points
def test_a_run_is_in_time_and_hardly_above_the_exact_optimum(route: Route, train: Vehicle, buffer_ratio: float) -> None:
    section, _, exact = solved(route, train)
    _, run = asked(route, train, buffer_ratio)
    optimum = exact.trajectory(run.time_s).trajectory
    optimum_j = float(optimum.input_j(optimum.loss_j(section.loss)).sum())
    time_s = least_time_s(section, section.start_m, 0.0) * (1.0 + buffer_ratio)
    assert -4.0 <= run.time_s - time_s <= LATE_S
    assert -0.0005 <= run.energy_j / optimum_j - 1.0 <= MOST_RATIO
    assert (run.speeds_mps <= section.envelope_mps + 1e-6).all()


@at_points
def test_with_a_low_price_of_changes_a_run_is_within_3_thousandths_of_the_optimum(
    monkeypatch: pytest.MonkeyPatch, route: Route, train: Vehicle, buffer_ratio: float
) -> None:
    section, _, exact = solved(route, train)
    monkeypatch.setattr(policies, "CHANGE_TIME_S", 0.0)
    front = GuideFront(section, PolicySettings(change_s=0.08, young_s=0.3), threads=1)
    time_s = least_time_s(section, section.start_m, 0.0) * (1.0 + buffer_ratio)
    run, _ = in_time(front, State.at(section), time_s)
    optimum = exact.trajectory(run.time_s).trajectory
    assert run.energy_j <= 1.003 * float(optimum.input_j(optimum.loss_j(section.loss)).sum())


@at_points
def test_a_train_that_can_only_be_late_tries_one_price(
    monkeypatch: pytest.MonkeyPatch, route: Route, train: Vehicle, buffer_ratio: float
) -> None:
    """Halving would try eight, each with a sweep, to end at the highest."""
    section, _, _ = solved(route, train)
    front, prices = GuideFront(section, threads=1), set()

    def counted(*args: Any) -> Any:
        prices.add(args[-2].time_w)
        return guide_sweep(*args)

    monkeypatch.setattr(policies, "guide_sweep", counted)
    in_time(front, State.at(section), least_time_s(section, section.start_m, 0.0) / (1.0 + buffer_ratio))
    assert prices == {front.lambda_w[-1]}


@at_points
def test_the_schedule_of_a_run_has_its_time_and_energy(route: Route, train: Vehicle, buffer_ratio: float) -> None:
    """Second witness: `follow`, which knows phases only, and the energy balance in Python."""
    front, run = asked(route, train, buffer_ratio)
    found = scheduled_run(front, run)
    balance = trajectory_on(front.section, front.section, found.forecast.speeds_mps)
    assert found.forecast.time_s == pytest.approx(run.time_s, rel=5e-4)
    assert found.forecast.energy_j == pytest.approx(run.energy_j, rel=5e-4)
    assert balance.balance(front.section.vehicle, front.section.loss).input == pytest.approx(run.energy_j, rel=5e-4)


def test_the_steps_of_speed_are_those_that_a_driver_is_shown() -> None:
    assert pytest.approx(TARGET_STEP_MPS) == policies.STEP_MPS


@at_points
def test_speeds_told_are_steps_of_five_or_limits(route: Route, train: Vehicle, buffer_ratio: float) -> None:
    front, run = asked(route, train, buffer_ratio)
    limits_kmh = np.unique(front.section.limit_mps) / KMH
    for manner, x, _ in told(run):
        if manner != ON_CURVE:
            kmh = front.speeds_mps[x] / KMH
            assert min(abs(kmh - 5.0 * round(kmh / 5.0)), np.abs(limits_kmh - kmh).min()) < 1e-6


def test_a_train_on_a_steep_descent_rolls_up_to_its_speeds_and_holds_them() -> None:
    front, run = asked(STEEP, WITHOUT_MOTOR_BRAKE, 0.08)
    phases = scheduled_run(front, run).schedule.phases
    after = phases[1:]
    rolled = [(one, then) for one, then in pairwise(phases) if one.rolls_up or one.kind is PhaseKind.COAST]
    assert not any(one.kind is PhaseKind.TRACTION and one.share > 0.0 for one in after)
    assert [(one.rolls_up, round(one.target_mps / KMH)) for one, _ in rolled] == [(False, 60), (True, 55)]
    assert all(run.speeds_mps[then.begin] == pytest.approx(one.target_mps) for one, then in rolled)


def test_where_the_motors_have_no_brake_a_train_coasts_even_down_a_descent() -> None:
    """Plans without friction brake: the braking curve is there that of a coasting train, and no speed can be held."""
    route = make_route(6_000.0, [(0.0, 120.0 * KMH), (4_000.0, 100.0 * KMH)], [(0.0, 0.0), (5_200.0, -0.008)])
    dead = Zone(start_m=2_500.0, length_m=1_500.0), Zone(start_m=5_600.0, length_m=250.0)
    route = dataclasses.replace(route, no_regeneration=dead[:1], neutral_sections=dead[1:])
    front, run = asked(route, LOCAL, 0.02)
    made = scheduled_run(front, run).schedule
    assert {made.phases[k].kind for k in made.at[front.section.supply < 0]} == {PhaseKind.COAST}
    least_j = solve_front(front.section).trajectory(run.time_s).balance.input
    assert run.energy_j < 1.015 * least_j


@pytest.mark.parametrize("buffer_ratio", [0.02, 0.04, 0.15])
def test_what_is_no_brake_stands_for_eight_seconds(buffer_ratio: float) -> None:
    """A speed that is held after it has been reached, or braked to, belongs to the instruction that led to it.

    A very heavy train may coast for a shorter time between two brakes: a change costs it little beside its motion. To
    be on time, a run may also change its price of time in the middle of an instruction, as here with a buffer of 8 %.
    """
    _, run = asked(ROUTE, LOCAL, buffer_ratio)
    lasts: list[tuple[int, int, float]] = []
    for manner, x, time_s in told(run):
        if lasts and manner == HOLDS and (lasts[-1][0] == ON_CURVE or lasts[-1][1] == x):
            lasts[-1] = *lasts[-1][:2], lasts[-1][2] + time_s
        else:
            lasts.append((manner, x, time_s))
    assert all(time_s >= 8.0 for manner, _, time_s in lasts[:-1] if KINDS[manner] not in (3, 4)), lasts


@cache
def front_at(change_s: float) -> GuideFront:
    """The policies of the local train with another price of a change."""
    return GuideFront(solved(ROUTE, LOCAL)[0], PolicySettings(change_s=change_s, young_s=change_s), threads=1)


def test_a_higher_price_of_a_change_gives_no_more_changes() -> None:
    """At three prices of time; with the highest price of a change there are fewer than with the lowest, somewhere."""
    fewer = 0
    for number in (120, 160, 200):
        runs = [
            front_at(price).run(State.at(front_at(price).section), (PolicyFrom(0, number),))
            for price in (0.01, 0.1, 1.0)
        ]
        counts = [changes(run) for run in runs]
        assert counts == sorted(counts, reverse=True)
        fewer += counts[0] > counts[-1]
    assert fewer


def test_a_change_costs_power_and_time_and_a_change_of_a_young_instruction_more() -> None:
    section, front, _ = solved(ROUTE, LOCAL)
    settings, power_w = front.settings, usable_power_w(section)
    for number in (0, len(front.lambda_w) - 1):
        price, late_j = front.prices(number), policies.CHANGE_TIME_S * float(front.lambda_w[number])
        assert price.change_j == pytest.approx(settings.change_s * power_w + late_j)
        assert price.young_j == pytest.approx(settings.young_s * power_w + late_j)


@pytest.mark.parametrize("train", [LOCAL, HEAVY], ids=["local", "heavy"])
def test_the_more_time_costs_the_sooner_a_run_arrives(train: Vehicle) -> None:
    """Weakly: a run is integrated more finely than the policies, and may be later by a tenth of a second."""
    section, front, _ = solved(ROUTE, train)
    times_s = [front.run(State.at(section), (PolicyFrom(0, number),)).time_s for number in range(40, 258, 28)]
    assert all(later - sooner <= 0.1 for sooner, later in pairwise(times_s))
    assert times_s[0] > times_s[-1] + 20.0


@at_points
def test_a_run_continues_from_its_middle_as_planned(route: Route, train: Vehicle, buffer_ratio: float) -> None:
    front, run = asked(route, train, buffer_ratio)
    section = front.section
    time_s = least_time_s(section, section.start_m, 0.0) * (1.0 + buffer_ratio)
    _, plan = in_time(front, State.at(section), time_s)
    node = int(section.decision[len(section.decision) // 2])
    state = State.at(section, float(section.node_m[node]), float(run.speeds_mps[node]))
    behind = max(number for number, one in enumerate(plan) if one.node <= state.first_node)
    rest = front.run(state, plan[behind:], int(run.said[node - 1]))
    assert rest.time_s == pytest.approx(run.time_s - run.elapsed_s[node], abs=0.2)
    np.testing.assert_allclose(rest.speeds_mps[1:], run.speeds_mps[node + 1 :], atol=0.05)


@pytest.mark.parametrize("later_s", [12.0, 40.0])
def test_a_place_is_passed_at_its_time_and_the_end_is_reached_in_time(later_s: float) -> None:
    """Later than by the run that does not mind the place."""
    section, front, _ = solved(ROUTE, LOCAL)
    state, place_m, time_s = State.at(section), 5_000.0, 1.25 * least_time_s(section, section.start_m, 0.0)
    free, _ = in_time(front, state, time_s)
    passes_s = float(np.interp(place_m, section.node_m, free.elapsed_s)) + later_s
    run = through(front, state, time_s, place_m, Window(earliest_s=passes_s), NO_INSTRUCTION)
    assert float(np.interp(place_m, section.node_m, run.elapsed_s)) == pytest.approx(passes_s, abs=2.0)
    assert -6.0 < run.time_s - time_s < 2.0, "a train that coasts to its stop may be early"


def test_a_run_inside_a_window_is_taken_before_a_nearer_one_outside_it() -> None:
    """A train that must not pass a place yet rather passes it 1 s later than 0.5 s too early."""
    section, front, _ = solved(ROUTE, LOCAL)
    search = _Search(front, State.at(section), 100.0, NO_INSTRUCTION, 5_000.0)
    early, late = (front.run(State.at(section), (PolicyFrom(0, number),)) for number in (200, 100))
    search.found = [(-0.5, early, ()), (1.0, late, ())]
    assert search.nearest(not_early=True) == (1.0, late)
    assert search.nearest(not_early=False) == (0.5, early)


def test_a_second_late_costs_more_than_a_second_early_is_worth() -> None:
    assert [lateness_s(late_s) for late_s in (-20.0, -2.0, -1.0, 0.0, 2.0)] == pytest.approx(
        [-1.4, -1.4, -0.7, 0.0, 6.0]
    )


def test_a_train_held_back_before_a_place_comes_to_it_with_the_speed_that_it_needs_behind_it() -> None:
    """The policies before the place know what a speed is worth behind it. One low price of time, which passes the place
    at about the same time, leads to it slower, and then needs more energy to arrive as early."""
    section, front, _ = solved(ROUTE, LOCAL)
    state, place_m, time_s = State.at(section), 3_000.0, 1.25 * least_time_s(section, section.start_m, 0.0)
    passes_s = in_time(front, state, time_s)[0].passes_s(place_m) + 40.0
    run = through(front, state, time_s, place_m, Window(earliest_s=passes_s), NO_INSTRUCTION)
    runs = {number: front.run(state, (PolicyFrom(0, number),)) for number in range(60, 255, 3)}
    held = min(runs, key=lambda number: abs(runs[number].passes_s(place_m) - passes_s))
    slow, node = runs[held], int(np.searchsorted(section.node_m, place_m))
    assert run.speeds_mps[node] > slow.speeds_mps[node] + 10.0 * KMH
    behind = State.at(section, float(section.node_m[node]), float(slow.speeds_mps[node]))
    rest, _ = in_time(front, behind, run.time_s - float(slow.elapsed_s[node]))
    blind_j = slow.energy_j - front.run(behind, (PolicyFrom(0, held),)).energy_j + rest.energy_j
    assert run.energy_j < blind_j


def test_a_train_that_stalls_is_refused() -> None:
    """Under way at 2 m/s before a hill that can be climbed only with a run-up."""
    hill = make_route(6_000.0, [(0.0, 30.0)], [(0.0, 0.0), (3_000.0, 0.13), (3_200.0, 0.0)])
    section = build_section(hill, LOCAL)
    front = GuideFront(section, threads=1)
    assert in_time(front, State.at(section), 1.1 * least_time_s(section, 0.0, 0.0))[0].time_s < 1_000.0
    with pytest.raises(InfeasibleError, match="stalls"):
        in_time(front, State.at(section, 2_950.0, 2.0), 400.0)


def test_a_train_above_the_envelope_and_one_that_creeps_get_to_the_end() -> None:
    section, front, _ = solved(ROUTE, LOCAL)
    highest = float(section.envelope_mps.max())
    states = [(5_000.0, highest + 2.0)]
    for s_m in (2_450.0, 8_700.0, 8_990.0):
        envelope = float(np.interp(s_m, section.node_m, section.envelope_mps))
        states += [(s_m, 0.3), (s_m, envelope + 0.8)]
    for s_m, speed_mps in states:
        run, _ = in_time(front, State.at(section, s_m, speed_mps), 60.0)
        assert run.speeds_mps[-1] == pytest.approx(0.0, abs=0.5)


def test_any_number_of_limits_is_accepted() -> None:
    """Eighty limits that are no steps of 5 km/h; each is told exactly."""
    limits = [(100.0 * i, (40.3 + 0.25 * ((37 * i) % 80)) * KMH) for i in range(80)]
    section = with_braking(build_section(make_route(8_000.0, limits), LOCAL), USUAL.of(LOCAL))
    front = GuideFront(section, threads=1)
    run, _ = in_time(front, State.at(section), 1.05 * least_time_s(section, section.start_m, 0.0))
    assert len(front.speeds_mps) > 64
    assert (run.speeds_mps <= section.envelope_mps + 1e-6).all()
    assert math.isfinite(scheduled_run(front, run).forecast.time_s)


@pytest.mark.parametrize("length_m", [2_000.0, 400.0, 12.0])
def test_a_section_whose_limit_no_train_reaches_has_a_guide(length_m: float) -> None:
    section = with_braking(build_section(make_route(length_m, [(0.0, 160.0 * KMH)]), LOCAL), USUAL.of(LOCAL))
    front = GuideFront(section, threads=1)
    run, _ = in_time(front, State.at(section), 1.1 * least_time_s(section, section.start_m, 0.0))
    assert (run.speeds_mps <= section.envelope_mps + 1e-6).all()
    assert math.isfinite(scheduled_run(front, run).forecast.time_s)


@pytest.mark.parametrize("from_m", [6_000.0, None])
def test_only_what_is_ahead_of_a_train_is_solved_and_the_run_is_the_same(from_m: float | None) -> None:
    section, front, _ = solved(ROUTE, LOCAL)
    ahead = GuideFront(section, s_m=from_m, threads=1)
    start, state, plan = State.at(section), State.at(section, 6_000.0, 20.0), (PolicyFrom(0, 150),)
    from_start, whole, part = front.run(start, plan), front.run(state, plan), ahead.run(state, plan)
    np.testing.assert_array_equal(whole.speeds_mps, part.speeds_mps)
    size, few = (sum(array.nbytes for array in one._kept[150]) for one in (front, ahead))
    assert few < 0.7 * size
    assert ahead.run(start, plan).time_s == from_start.time_s


def test_the_policies_kept_have_a_size() -> None:
    """What is kept is counted, and the policy that has not been used for longest is forgotten."""
    section, _, _ = solved(ROUTE, LOCAL)
    front, state = GuideFront(section, threads=1), State.at(section)
    assert front.nbytes == 0
    front.run(state, (PolicyFrom(0, 100),))
    one = sum(array.nbytes for array in front._kept[100])
    empty = front.nbytes - one
    front = GuideFront(section, PolicySettings(kept_bytes=2 * one), threads=1)
    for number in (100, 110, 100, 120):
        front.run(state, (PolicyFrom(0, number),))
    assert front.nbytes == empty + 2 * one
    assert list(front._kept) == [100, 120]


@pytest.mark.parametrize(
    ("phase", "manner", "kmh"),
    [
        (Phase(PhaseKind.TRACTION, 0.8, 0, 90.0 * KMH), 1, 90.0),
        (Phase(PhaseKind.TRACTION, 0.0, 0, 90.0 * KMH), ROLLS_UP, 90.0),
        (Phase(PhaseKind.HOLD, 0.0, 0, 83.0 * KMH), HOLDS, 83.0),
        (Phase(PhaseKind.COAST, 0.0, 0, 68.9 * KMH), 4, 65.0),
        (Phase(PhaseKind.BRAKE, 0.7, 0, 60.0 * KMH), 6, 60.0),
    ],
)
def test_an_instruction_of_a_phase(phase: Phase, manner: int, kmh: float) -> None:
    _, front, _ = solved(ROUTE, LOCAL)
    x, found = divmod(said_of(front, phase), CODE)
    assert (found, front.speeds_mps[x] / KMH) == (manner, pytest.approx(kmh))
    assert said_of(front, Phase(PhaseKind.BRAKE, 0.0, 0, 0.0)) == ON_CURVE
