"""The simulated train against second witnesses: closed forms, quadrature, a brute-force train of many masses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from das.domain.conditions import Conditions
from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError, InputError
from das.domain.files.load import load_route, load_vehicle
from das.domain.formulary import adhesion_coefficient, curve_resistance_mps2
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss, LossMap
from das.domain.route import Route, Stretches, Tunnel, Zone
from das.domain.vehicle import BrakePolicy, ServiceBrake, Vehicle
from sim.plant.kernels import Command, PlantState
from sim.plant.plant import COAST, Dynamics, Patch, Plant, force, lever, speed
from tests.support.making import flat, make_route, make_train

G = 9.81
SOON = 1e-3
INSTANT = Dynamics(
    traction_dead_s=0.0,
    traction_rise_s=SOON,
    traction_fall_s=SOON,
    electric_dead_s=0.0,
    electric_rise_s=SOON,
    electric_fall_s=SOON,
    friction_dead_s=0.0,
    friction_rise_s=SOON,
    friction_fall_s=SOON,
    jerk_mps3=120.0,
)
"""Forces that are there within a step."""


def states_of(plant: Plant, state: PlantState, command: Command, seconds: float) -> list[PlantState]:
    """The state and those after each step."""
    states = [state]
    for _ in range(round(seconds / plant.step_s)):
        states.append(plant.advance(states[-1], command, plant.step_s))
    return states


def blended(**changes: object) -> Vehicle:
    """100 t with 100 kN electric and 80 kN friction brake, both up to any speed."""
    return replace(make_train(), friction_brake_force_n=8e4, **changes)  # type: ignore[arg-type]


# --- motion ------------------------------------------------------------------------------------------------------


def test_a_force_is_there_after_its_dead_time_and_build_up() -> None:
    """v(t) and s(t) of a ramp that begins after the dead time and then a constant force, in closed form."""
    dynamics = Dynamics(traction_dead_s=0.33, traction_rise_s=2.0, jerk_mps3=10.0)
    plant = Plant(flat(5000.0), make_train(), dynamics=dynamics)
    wanted, full, mass = 6e4, 1e5, 1e5
    ramp_s, rate = 2.0 * wanted / full, wanted / mass
    for state in states_of(plant, plant.at(0.0), force(wanted), 20.0):
        t = max(state.time_s - 0.33, 0.0)
        on_ramp = min(t, ramp_s)
        v = 0.5 * rate / ramp_s * on_ramp**2 + rate * max(t - ramp_s, 0.0)
        s = rate / ramp_s * on_ramp**3 / 6 + max(t - ramp_s, 0.0) * 0.5 * rate * ramp_s
        s += 0.5 * rate * max(t - ramp_s, 0.0) ** 2
        assert state.speed_mps == pytest.approx(v, abs=2e-3)
        assert state.s_m == pytest.approx(s, abs=0.01)
        assert state.force_el_n == 0 or state.time_s > 0.33


def test_a_friction_brake_alone_acts_fully_after_the_time_in_the_trains_file() -> None:
    """3 s after the command it gives its whole 50 kN, and it is released in 15/4 of the 2.5 s in which it rose."""
    electric = make_train()
    brake_n = 5e4
    rubs = replace(
        electric,
        electric_brake=EffortEnvelope(max_force_n=0.0, max_power_w=0.0),
        friction_brake_force_n=brake_n,
        brake_policy=BrakePolicy.FRICTION,
        service_brake=ServiceBrake(build_up_s=3.0),
    )
    plant = Plant(flat(5000.0), rubs)
    braked = states_of(plant, plant.at(0.0, 40.0), lever(-1.0), 4.0)
    reached_s = next(one.time_s for one in braked if one.force_friction_n <= -brake_n + 1.0)
    assert reached_s == pytest.approx(3.0, abs=2 * plant.step_s)
    released = states_of(plant, braked[-1], COAST, 12.0)
    gone_s = next(one.time_s for one in released if one.force_friction_n >= -1.0) - braked[-1].time_s
    assert gone_s == pytest.approx(2.5 * 15.0 / 4.0, abs=0.6)
    blended = replace(electric, friction_brake_force_n=brake_n, service_brake=ServiceBrake(build_up_s=3.0))
    assert Dynamics.of(blended) == Dynamics()


def test_coasting_with_quadratic_drag_to_a_standstill() -> None:
    """m·dv/dt = −c0 − c2·v²: way m/(2c2)·ln(1 + c2·v²/c0), time m/√(c0·c2)·atan(v·√(c2/c0))."""
    c0, c2, v0, mass = 2e3, 6.0, 30.0, 1e5
    plant = Plant(flat(60_000.0), make_train(resistance=(c0, 0.0, c2)))
    state = plant.at(0.0, v0)
    while state.speed_mps > 0:
        state = plant.advance(state, COAST, plant.step_s)
    assert state.s_m == pytest.approx(mass / (2 * c2) * math.log1p(c2 * v0**2 / c0), rel=1e-6)
    whole_s = mass / math.sqrt(c0 * c2) * math.atan(v0 * math.sqrt(c2 / c0))
    assert state.time_s - plant.step_s < whole_s <= state.time_s + 1e-9
    assert plant.advance(state, COAST, plant.step_s).s_m == state.s_m


def test_a_train_stops_within_a_step_where_its_kinetic_energy_is_spent() -> None:
    train = make_train(loss=EfficiencyLoss(traction_ratio=0.0, brake_ratio=0.0, idle_w=1e5))
    plant = Plant(flat(100.0), train)
    start = plant.at(0.0, 0.03)._replace(force_el_n=-1e5)
    stopped = plant.advance(start, force(-1e5), plant.step_s)
    assert stopped.speed_mps == 0
    assert stopped.s_m == pytest.approx(0.03**2 / 2.0, rel=1e-9)
    assert stopped.component_loss_j == pytest.approx(1e5 * 0.03, rel=1e-9)
    assert plant.balance(start, stopped).residual_ratio < 1e-9


def test_full_traction_on_the_power_hyperbola_takes_the_time_of_a_quadrature() -> None:
    vehicle = load_vehicle("re460-ic")
    plant = Plant(load_route("flat-6km"), vehicle, dynamics=INSTANT)
    state = plant.at(0.0, 5.0)
    while state.speed_mps < 40.0:
        before, state = state, plant.advance(state, lever(1.0), plant.step_s)
    v = np.linspace(5.0, 40.0, 200_001)
    pull = vehicle.traction_effort_n(v) - vehicle.resistance.force_n(v)
    time_s = np.trapezoid(vehicle.inertial_mass_kg / pull, v)
    way_m = np.trapezoid(vehicle.inertial_mass_kg * v / pull, v)
    part = (40.0 - before.speed_mps) / (state.speed_mps - before.speed_mps)
    assert before.time_s + part * plant.step_s == pytest.approx(time_s, abs=0.03)  # a step until the force is there
    assert before.s_m + part * (state.s_m - before.s_m) == pytest.approx(way_m, abs=0.3)


def hilly() -> Route:
    grades = [(0.0, 0.0), (900.0, 0.02), (1100.0, -0.015), (1900.0, 0.004), (3300.0, -0.01)]
    tunnels = (
        Tunnel(start_m=800.0, length_m=130.0, area_m2=30.0),
        Tunnel(start_m=1500.0, length_m=900.0, area_m2=50.0),
    )
    curves = Stretches(start_m=np.array([0.0, 700.0, 760.0, 2000.0]), value=np.array([0.0, 1 / 250, 0.0, 1 / 700]))
    route = make_route(6000.0, [(0.0, 60.0)], grades)
    return replace(
        route,
        tunnels=tunnels,
        curvature_per_m=curves,
        receptivity_ratio=Stretches(start_m=np.array([0.0, 2000.0]), value=np.array([1.0, 0.6])),
        neutral_sections=(Zone(start_m=1300.0, length_m=150.0),),
        no_regeneration=(Zone(start_m=2600.0, length_m=400.0),),
    )


def long_train(**changes: object) -> Vehicle:
    train = blended(
        train_length_m=260.0, tunnel_area_m2=(20.0, 40.0), tunnel_resistance_n_per_mps2=(15.0, 5.0), comfort_power_w=5e4
    )
    return replace(
        train,
        resistance=replace(train.resistance, c0_n=2e3, c1_n_per_mps=30.0, c2_n_per_mps2=5.0),
        rotating_mass_ratio=0.07,
        losses=MappingProxyType({Level.OWN: EfficiencyLoss(traction_ratio=0.15, brake_ratio=0.1, idle_w=2e4)}),
        auxiliary_power_w=3e4,
        **changes,
    )


def test_gradient_curves_and_tunnels_are_felt_by_every_part_of_the_train() -> None:
    """Against a train of 400 masses, each on its own gradient, in its own curve and tunnel, in small Euler steps."""
    route, train = hilly(), long_train()
    plant = Plant(route, train, dynamics=INSTANT)
    offsets = -train.train_length_m * (np.arange(400) + 0.5) / 400

    def resisting_n(s: float, v: float) -> float:
        at = s + offsets
        share = [np.mean((at >= t.start_m) & (at < t.start_m + t.length_m)) for t in route.tunnels]
        q = 10.0 * share[0] + 5.0 * share[1]  # 30 m² lies half-way, 50 m² beyond the table
        line = np.mean(G * route.gradients_ratio.at(at) + curve_resistance_mps2(route.curvature_per_m.at(at)))
        return 2e3 + 30.0 * v + (5.0 + q) * v * v + train.mass_kg * float(line)

    state, s, v, dt = plant.at(0.0, 15.0), 0.0, 15.0, 0.025
    worst = 0.0
    for _ in range(110):
        state = plant.advance(state, force(2.5e4), 1.0)
        for _ in range(40):
            pull = 0.0 if 1300.0 <= s < 1450.0 else 2.5e4
            half = v + 0.5 * dt * (pull - resisting_n(s, v)) / train.inertial_mass_kg
            v += dt * (pull - resisting_n(s + 0.5 * dt * half, half)) / train.inertial_mass_kg
            s += dt * half
        worst = max(worst, abs(state.speed_mps - v))
    assert state.s_m > 2500.0  # it went through both tunnels
    assert worst < 0.02


def test_halving_the_step_changes_the_energy_of_a_run_by_less_than_half_a_per_mille() -> None:
    route, vehicle = load_route("zurich-luzern"), load_vehicle("re460-ic")
    course = ((lever(0.9), 60), (speed(16.0), 120), (lever(1.0), 60), (COAST, 60), (lever(-0.3), 30))
    energies = []
    for step_s in (0.1, 0.05, 0.025):
        plant = Plant(route, vehicle, dynamics=Dynamics(step_s=step_s))
        state = plant.at(0.0)
        for command, seconds in course:
            state = plant.advance(state, command, seconds)
        energies.append(state.input_j)
    assert energies[0] == pytest.approx(energies[1], rel=1e-3)
    assert energies[1] == pytest.approx(energies[2], rel=5e-4)


def test_the_error_falls_with_the_square_of_the_step() -> None:
    vehicle = load_vehicle("re460-ic")
    ends = []
    for step_s in (0.1, 0.05, 0.025):
        plant = Plant(flat(60_000.0), vehicle, dynamics=Dynamics(step_s=step_s))
        start = plant.at(0.0, 25.0)._replace(force_el_n=float(vehicle.traction_effort_n(25.0)))
        ends.append(plant.advance(start, lever(1.0), 60.0))
    for name in ("s_m", "speed_mps", "input_j"):
        coarse, middle, fine = (getattr(end, name) for end in ends)
        assert abs(coarse - middle) > 3.5 * abs(middle - fine), name


# --- energy ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "length_m"), [(0, 0.0), (1, 260.0), (2, 0.0), (3, 260.0), (4, 260.0)])
def test_the_energy_balance_closes_whatever_the_driver_does(seed: int, length_m: float) -> None:
    random = np.random.default_rng(seed)
    patches = (Patch(from_m=500.0, to_m=1500.0, adhesion_ratio=0.5), Patch(from_s=30.0, to_s=90.0, head_wind_mps=-9.0))
    train = long_train(adhesive_mass_kg=5e4)
    plant = Plant(hilly(), replace(train, train_length_m=length_m), patches=patches)
    start = state = plant.at(0.0, 10.0)
    for _ in range(90):
        command = lever(random.uniform(-0.4, 1.0), friction_ratio=random.uniform(0, 1))
        state = plant.advance(state, command, 2.0)
        balance = plant.balance(start, state)
        assert balance.residual_ratio < 1e-6
    assert min(balance.friction_brake, balance.unreturned, balance.component_loss) > 0
    assert balance.comfort == pytest.approx(5e4 * 180.0)
    assert state.s_m > 1500.0


def test_holding_a_speed_costs_resistance_and_the_loss_of_the_map() -> None:
    vehicle = load_vehicle("re460-ic")
    plant = Plant(flat(60_000.0), vehicle)
    settled = plant.advance(plant.at(0.0, 30.0), speed(30.0, force_n=float(vehicle.resistance.force_n(30.0))), 30.0)
    after = plant.advance(settled, speed(30.0, force_n=float(vehicle.resistance.force_n(30.0))), 100.0)
    force_n = float(vehicle.resistance.force_n(30.0))
    power_w = force_n * 30.0 + float(vehicle.loss_model(Level.L3).loss_w(force_n, 30.0))
    assert after.input_j - settled.input_j == pytest.approx(100.0 * power_w, rel=1e-6)


@pytest.mark.parametrize("level", [Level.OWN, Level.L1, Level.L0_REG])
def test_auxiliaries_count_where_the_plan_counts_them_and_draw_at_a_standstill(level: Level) -> None:
    train = long_train()
    plant = Plant(flat(5000.0), train, level=level)
    stood = plant.advance(plant.at(0.0), COAST, 60.0)
    drawn_w = 3e4 if level is Level.OWN else 0.0
    assert stood.input_j == stood.auxiliary_j == pytest.approx(60.0 * drawn_w)
    assert stood.comfort_j == pytest.approx(60.0 * 5e4)
    moved = plant.advance(plant.at(0.0, 20.0), COAST, 10.0)
    loss_w = float(train.loss_model(level).loss_w(0.0, 20.0))
    assert moved.input_j == pytest.approx(10.0 * loss_w)


def test_what_the_line_does_not_take_is_lost_in_resistors() -> None:
    train = make_train(loss=EfficiencyLoss(traction_ratio=0.1, brake_ratio=0.2))
    runs = {}
    for ratio in (1.0, 0.4, 0.0):
        plant = Plant(flat(9000.0), train, conditions=Conditions(receptivity_ratio=ratio))
        start = plant.at(0.0, 40.0)
        end = plant.advance(start, lever(-0.5), 60.0)
        runs[ratio] = end
        wheel_j = 0.5 * 1e5 * (40.0**2 - end.speed_mps**2)
        assert end.input_j == pytest.approx(-ratio * 0.8 * wheel_j, rel=1e-9)
        assert end.unreturned_j == pytest.approx((1 - ratio) * 0.8 * wheel_j, rel=1e-9, abs=1.0)
        assert end.component_loss_j == pytest.approx(0.2 * wheel_j, rel=1e-9)
    assert runs[1.0].s_m == runs[0.0].s_m


# --- forces ------------------------------------------------------------------------------------------------------


def test_no_force_changes_faster_than_its_rate_or_the_jerk_limit() -> None:
    dynamics = Dynamics(traction_rise_s=0.1, traction_fall_s=0.1, electric_rise_s=0.1, jerk_mps3=0.7)
    train = blended()
    plant = Plant(flat(9000.0), train, dynamics=dynamics)
    state, random = plant.at(0.0, 25.0), np.random.default_rng(3)
    for _ in range(300):
        command = lever(random.uniform(-1.0, 1.0))
        for _ in range(random.integers(1, 20)):
            before, state = state, plant.advance(state, command, plant.step_s)
            el, fr = state.force_el_n - before.force_el_n, state.force_friction_n - before.force_friction_n
            assert abs(el) <= 0.7 * 1e5 * plant.step_s * 1.0001 or state.speed_mps == 0
            assert -8e4 / 4.0 * plant.step_s * 1.0001 <= fr <= 8e4 / 15.0 * plant.step_s * 1.0001
        if state.speed_mps < 5:
            state = plant.at(0.0, 25.0)


def test_motors_brake_first_and_friction_fills_what_they_cannot() -> None:
    train = blended(electric_brake=EffortEnvelope(max_force_n=1e5, max_power_w=1.2e6))
    plant = Plant(flat(60_000.0), train)
    gentle = plant.advance(plant.at(0.0, 10.0), force(-6e4), 8.0)
    assert (gentle.force_el_n, gentle.force_friction_n) == (pytest.approx(-6e4), 0.0)
    fast = plant.advance(plant.at(0.0, 40.0), force(-6e4), 8.0)
    assert fast.force_el_n == pytest.approx(-1.2e6 / fast.speed_mps, rel=1e-3)
    assert fast.force_el_n + fast.force_friction_n == pytest.approx(-6e4, rel=1e-3)
    by_air = plant.advance(plant.at(0.0, 10.0), force(-6e4, friction_ratio=0.5), 8.0)
    assert (by_air.force_el_n, by_air.force_friction_n) == (pytest.approx(-3e4), pytest.approx(-3e4))
    states = states_of(plant, plant.at(0.0, 40.0), lever(-1.0), 4.0)
    assert all(s.force_friction_n == 0 for s in states if s.time_s < 0.5)  # its dead time


@pytest.mark.parametrize(("friction_n", "motors_n"), [(0.0, 6e4), (1e4, 5e4), (2.4e4, 3.6e4), (8e4, 3.6e4)])
def test_motors_give_what_is_asked_of_a_friction_brake_that_cannot(friction_n: float, motors_n: float) -> None:
    """A driver who asks 40 % of the friction brake brakes as hard as he asks with a train that has none, too."""
    plant = Plant(flat(60_000.0), replace(make_train(), friction_brake_force_n=friction_n))
    after = plant.advance(plant.at(0.0, 25.0), force(-6e4, friction_ratio=0.4), 8.0)
    assert after.force_el_n == pytest.approx(-motors_n)
    assert after.force_friction_n == pytest.approx(motors_n - 6e4)


def test_a_neutral_section_has_no_force_and_a_no_regeneration_zone_no_electric_brake() -> None:
    route = replace(
        flat(9000.0),
        neutral_sections=(Zone(start_m=1000.0, length_m=200.0),),
        no_regeneration=(Zone(start_m=3000.0, length_m=500.0),),
    )
    plant = Plant(route, blended())
    seen = 0
    for state in states_of(plant, plant.at(800.0, 30.0), lever(0.5), 20.0):
        if 1000.0 <= state.s_m < 1200.0:
            assert state.force_el_n == 0
            seen += 1
    assert seen > 50
    assert state.force_el_n > 0  # and on again
    for state in states_of(plant, plant.at(2900.0, 30.0), lever(-0.3), 14.0):
        if 3000.0 <= state.s_m < 3400.0:
            assert state.force_el_n == 0
            seen += 1
    assert state.force_friction_n < 0
    assert state.input_j < 0  # what it gave back before


def test_on_a_slippery_rail_only_adhesion_is_transmitted_and_the_run_up_is_longer() -> None:
    train = blended(adhesive_mass_kg=4e4)
    dry = Plant(flat(20_000.0), train, dynamics=INSTANT)
    slippery = Plant(flat(20_000.0), train, dynamics=INSTANT, patches=(Patch(to_m=300.0, adhesion_ratio=0.4),))

    def run_up(plant: Plant) -> list[PlantState]:
        states = [plant.at(0.0)]
        while states[-1].speed_mps < 20.0:
            states.append(plant.advance(states[-1], lever(1.0), plant.step_s))
        return states

    for plant, ratio in ((dry, 1.0), (slippery, 0.4)):
        for state in run_up(plant)[3:]:
            if state.s_m < 299.0:
                most = ratio * 4e4 * G * float(adhesion_coefficient(state.speed_mps))
                assert state.force_el_n == pytest.approx(min(1e5, most), rel=1e-3)
    assert run_up(slippery)[-1].s_m > run_up(dry)[-1].s_m + 50.0
    braked_m = []
    for ratio in (1.0, 0.3):
        plant = Plant(flat(20_000.0), train, dynamics=INSTANT, conditions=Conditions(adhesion_ratio=ratio))
        state = plant.at(0.0, 25.0)
        while state.speed_mps > 0:
            assert -(state.force_el_n + state.force_friction_n) <= ratio * 1e5 * G * 0.34
            state = plant.advance(state, lever(-1.0), plant.step_s)
        braked_m.append(state.s_m)
    v = np.linspace(0.0, 25.0, 100_001)
    most = np.minimum(
        0.3 * 1e5 * G * adhesion_coefficient(v), np.minimum(1e5, 0.3 * 4e4 * G * adhesion_coefficient(v)) + 8e4
    )
    assert braked_m[1] == pytest.approx(np.trapezoid(1e5 * v / most, v), rel=5e-3)
    assert braked_m[1] > 1.5 * braked_m[0]


def test_patches_hold_for_the_share_of_the_train_on_them_and_for_their_time() -> None:
    train = replace(blended(adhesive_mass_kg=2e4), train_length_m=200.0)
    patch = Patch(from_m=1000.0, to_m=5000.0, from_s=20.0, adhesion_ratio=0.5)
    plant = Plant(flat(9000.0), train, patches=(patch,), dynamics=INSTANT)

    def pulls(s_m: float, time_s: float) -> float:
        state = plant.at(s_m, 10.0, time_s)
        for _ in range(3):
            state = plant.advance(state, lever(1.0), plant.step_s)
        return state.force_el_n / (2e4 * G * float(adhesion_coefficient(state.speed_mps)))

    assert pulls(1100.0, 0.0) == pytest.approx(1.0, abs=1e-3)
    assert pulls(1100.0, 25.0) == pytest.approx(0.75, abs=0.005)
    assert pulls(2000.0, 25.0) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("wind_mps", [8.0, -6.0, -30.0])
def test_wind_changes_the_resistance_of_the_air(wind_mps: float) -> None:
    train = make_train(resistance=(9e3, 0.0, 6.0))
    steady = speed(20.0, force_n=9e3 + 6.0 * (20.0 + wind_mps) * abs(20.0 + wind_mps))
    for plant in (
        Plant(flat(20_000.0), train, conditions=Conditions(head_wind_mps=wind_mps)),
        Plant(flat(20_000.0), train, patches=(Patch(head_wind_mps=wind_mps),)),
    ):
        state = plant.advance(plant.at(0.0, 20.0), steady, 200.0)
        assert state.speed_mps == pytest.approx(20.0, abs=1e-3)
        assert state.resistance_j == pytest.approx(state.s_m * steady.force_n, rel=2e-3)


def test_a_standing_train_neither_rolls_back_nor_off_by_itself() -> None:
    uphill, downhill = (make_route(5000.0, [(0.0, 30.0)], [(0.0, g)]) for g in (0.03, -0.03))
    holds_n = 1e5 * G * 0.03
    for route in (uphill, downhill):
        plant = Plant(route, blended())
        for command in (COAST, lever(-0.5), force(0.9 * holds_n) if route is uphill else COAST):
            state = plant.advance(plant.at(100.0), command, 20.0)
            assert (state.s_m, state.speed_mps) == (100.0, 0.0)
    plant = Plant(uphill, blended())
    assert plant.advance(plant.at(100.0), force(1.1 * holds_n), 20.0).speed_mps > 0.1


def test_a_train_keeps_its_greatest_accelerations() -> None:
    train = blended(max_acceleration_mps2=0.4, max_deceleration_mps2=0.5)
    plant = Plant(make_route(9000.0, [(0.0, 60.0)], [(0.0, -0.01), (400.0, -0.005)]), train)
    up = states_of(plant, plant.at(0.0), lever(1.0), 40.0)
    down = states_of(plant, plant.at(500.0, 30.0), lever(-1.0), 30.0)
    assert max(s.acceleration_mps2 for s in up) == pytest.approx(0.4, rel=0.02)
    assert min(s.acceleration_mps2 for s in down) == pytest.approx(-0.5, rel=0.04)


def test_at_level_l0_noreg_nothing_comes_back() -> None:
    plant = Plant(flat(9000.0), blended(), level=Level.L0_NOREG)
    start = plant.at(0.0, 30.0)
    end = plant.advance(start, lever(-0.5), 20.0)
    assert end.force_el_n == end.input_j == 0.0
    assert plant.balance(start, end).friction_brake == pytest.approx(-plant.balance(start, end).kinetic)


def test_the_true_train_may_be_heavier_and_stiffer_than_the_plans() -> None:
    train = make_train(resistance=(2e3, 0.0, 6.0))
    plant = Plant(flat(9000.0), train, conditions=Conditions(mass_ratio=1.2, resistance_ratio=1.5), dynamics=INSTANT)
    state = plant.advance(plant.at(0.0, 20.0), force(6e4), 2 * plant.step_s)
    resisting = 1.5 * (1.2 * 2e3 + 6.0 * 400.0)
    assert state.acceleration_mps2 == pytest.approx((6e4 - resisting) / 1.2e5, rel=2e-3)


def test_a_lever_is_a_share_of_what_the_train_can_do_on_a_dry_rail() -> None:
    train = blended(traction=EffortEnvelope(max_force_n=1e5, max_power_w=1e6))
    plant = Plant(flat(60_000.0), train, dynamics=INSTANT)
    for ratio, full in ((0.5, 1e6 / 25.0), (1.0, 1e6 / 25.0), (-0.5, 1.8e5)):
        state = plant.advance(plant.at(0.0, 25.0), lever(ratio), 2 * plant.step_s)
        total = state.force_el_n + state.force_friction_n
        assert total == pytest.approx(ratio * full, rel=5e-3)


# --- blending: what the friction brake takes that the motors could have given ---------------------------------------


BRAKING_N = -60e3
LOSSES = EfficiencyLoss(traction_ratio=0.1, brake_ratio=0.2, idle_w=0.0)


def braked(friction_ratio: float) -> tuple[PlantState, PlantState]:
    """A train that brakes from 40 to 20 m/s with a force that its motors have at these speeds."""
    plant = Plant(flat(20_000.0), replace(make_train(loss=LOSSES), friction_brake_force_n=8e4))
    before = state = plant.at(1000.0, 40.0)
    while state.speed_mps > 20.0:
        assert state.time_s < 600.0, "the train does not brake"
        state = plant.advance(state, force(BRAKING_N, friction_ratio=friction_ratio), 0.2)
    return before, state


def test_braking_with_the_motors_leaves_nothing_to_blend() -> None:
    _, after = braked(0.0)
    assert after.friction_brake_j == 0.0
    assert after.blending_j == 0.0


@pytest.mark.parametrize("friction_ratio", [0.2, 0.5, 1.0])
def test_the_energy_lost_by_friction_is_what_braking_with_the_motors_would_have_fed_back(friction_ratio: float) -> None:
    """Two runs of nearly the same motion: the friction brake builds up later, which costs some metres."""
    _, by_motors = braked(0.0)
    _, rubbed = braked(friction_ratio)
    assert rubbed.friction_brake_j > 0.0
    way = (rubbed.s_m - 1000.0) / (by_motors.s_m - 1000.0)
    assert way == pytest.approx(1.0, abs=0.06)
    assert rubbed.input_j - rubbed.blending_j == pytest.approx(by_motors.input_j, rel=0.06)
    # Closed form: these motors feed 80 % of what they take back to the line.
    assert rubbed.blending_j == pytest.approx(0.8 * rubbed.friction_brake_j, rel=1e-9)


# --- refusals ----------------------------------------------------------------------------------------------------


def small_map() -> LossMap:
    speeds, forces = np.array([0.0, 10.0, 20.0]), np.linspace(-1e5, 1e5, 5)
    return LossMap(name="small.csv", speed_mps=speeds, force_n=forces, loss_w_table=np.full((3, 5), 1e4))


BAD: list[tuple[Callable[[], object], str]] = [
    (lambda: Plant(flat(100.0), make_train()).advance(PlantState(0.0, 0.0, 0.0), COAST, 0.07), "not a whole number"),
    (lambda: Plant(flat(100.0), make_train(), conditions=Conditions(adhesion_ratio=0.5)), "adhesion is missing"),
    (lambda: Plant(flat(100.0), make_train(), patches=(Patch(adhesion_ratio=0.5),)), "adhesion is missing"),
    (
        lambda: Plant(flat(100.0), make_train().with_loss_map(small_map())),
        "small.csv: the state .* outside the loss map",
    ),
    (lambda: Patch(from_m=200.0, to_m=100.0), "patch.*to_m = 100.*more than from_m = 200"),
    (lambda: Patch(adhesion_ratio=0.0), "adhesion_ratio = 0.0: expected 0.01 to 10"),
    (lambda: Patch(head_wind_mps=math.nan), "head_wind_mps = nan"),
]


@pytest.mark.parametrize(("make", "message"), BAD, ids=[message for _, message in BAD])
def test_what_cannot_be_simulated_is_refused_with_the_reason(make: Callable[[], object], message: str) -> None:
    with pytest.raises(DasError, match=message):
        make()


def test_refusals_of_values_are_input_errors() -> None:
    with pytest.raises(InputError):
        Patch(from_m=200.0, to_m=100.0)
