"""Real trains and track: every effect against a second witness (closed form, brute force, independent integration)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from das.domain.conditions import Conditions
from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError, InfeasibleError, InputError
from das.domain.files.routes import read_route
from das.domain.files.vehicles import read_vehicle
from das.domain.formulary import adhesion_coefficient, curve_resistance_mps2
from das.domain.levels import Level
from das.domain.losses import EfficiencyLoss
from das.domain.route import NEUTRAL, NO_REGENERATION, Route, Stretches, Tunnel, Zone
from das.domain.trajectory import Trajectory
from das.domain.vehicle import BrakePolicy, Load, Resistance, Vehicle
from das.solver.front import Front
from das.solver.kernels import forces
from das.solver.kernels.tuples import train_params
from das.solver.section import build_section
from das.solver.solve import solve_front
from docs.studies.cases import evaluated_at
from precompute.baselines import strategies as baselines
from tests.support.making import REPOSITORY, flat, make_route, make_train

G = 9.81
CATALOGUE = REPOSITORY / "das" / "domain" / "catalogue"
POINTS = 400
"""A long train as so many equal masses."""


def solved(route: Route, train: Vehicle, **options: object) -> Front:
    return solve_front(build_section(route, train, **options))  # type: ignore[arg-type]


def reached_mps(
    run: Trajectory, train: Vehicle, line_n: Callable[[float, float], float], steps: int = 4000
) -> np.ndarray:
    """Speeds at the run's nodes when its forces are applied in time, step by step, against a line force of (s, v)."""
    speeds = [run.v_mps[0]]
    force = run.force_el_n + run.force_friction_n
    for i, (start, end) in enumerate(zip(run.s_m[:-1], run.s_m[1:], strict=True)):
        s, v = start, run.v_mps[i]
        dt = (run.t_s[i + 1] - run.t_s[i]) / max(steps // len(force), 10)
        while s < end - 1e-9:
            half = v + 0.5 * dt * (force[i] - resisting_n(train, v) - line_n(s, v)) / train.inertial_mass_kg
            if half <= 0:
                break
            step = min(dt, (end - s) / half)
            at = s + 0.5 * step * half
            v += step * (force[i] - resisting_n(train, half) - line_n(at, half)) / train.inertial_mass_kg
            s += half * step
        speeds.append(v)
    return np.array(speeds)


def resisting_n(train: Vehicle, v: float) -> float:
    r = train.resistance
    return r.c0_n + r.c1_n_per_mps * v + r.c2_n_per_mps2 * v * v


def sampled(train: Vehicle, s_m: float) -> np.ndarray:
    """Positions of a long train's masses, its head at s_m."""
    return s_m - train.train_length_m * (np.arange(POINTS) + 0.5) / POINTS


@pytest.mark.slow
def test_a_long_train_feels_the_gradient_under_each_of_its_masses() -> None:
    """Speeds against an integration of 260 m of equal masses; the work of the weight against the height they gain."""
    grades = [(0.0, 0.0), (900.0, 0.02), (1100.0, -0.015), (1900.0, 0.0)]
    route = make_route(3000.0, [(0.0, 40.0)], grades)
    train = replace(make_train(power_w=2e6), train_length_m=260.0)
    run = solved(route, train).trajectory(140.0).trajectory

    def line_n(s: float, v: float) -> float:
        starts, values = zip(*grades, strict=True)
        under = np.searchsorted(starts, np.maximum(sampled(train, s), 0.0), side="right") - 1
        return float(train.mass_kg * G * np.mean(np.array(values)[under]))

    assert np.abs(reached_mps(run, train, line_n) - run.v_mps).max() < 0.02
    weight = train.mass_kg * G * run.grade_ratio @ np.diff(run.s_m)
    ends_m = [route.altitude_m(np.maximum(sampled(train, head_m), 0.0)) for head_m in (0.0, 3000.0)]
    lifted = train.mass_kg * G * np.mean(ends_m[1] - ends_m[0])
    assert weight == pytest.approx(lifted, rel=2e-4)


def test_no_part_of_a_long_train_is_above_a_limit_and_it_hurries_once_the_tail_is_out() -> None:
    """Forty points of the train against the limit at each; the slow stretch ends one train length after the limit."""
    route = make_route(4000.0, [(0.0, 30.0), (1500.0, 12.0), (1600.0, 35.0), (2600.0, 20.0)])
    train = replace(make_train(), train_length_m=180.0)
    run = solved(route, train).fastest().trajectory
    at = np.arange(0.0, 4000.0, 0.25)
    speed = np.sqrt(np.interp(at, run.s_m, run.v_mps**2))
    for point in np.linspace(0.0, train.train_length_m, 40):
        here = np.maximum(at - point, 0.0)
        assert (speed <= route.limits_mps.at(here) + 1e-6).all()
    slow = at[(at > 1000) & (at < 2500) & (np.abs(speed - 12.0) < 1e-6)]
    assert slow[0] == pytest.approx(1500.0, abs=0.3)
    assert slow[-1] == pytest.approx(1600.0 + train.train_length_m, abs=0.3)


def test_a_tunnel_holds_back_the_part_of_the_train_in_it() -> None:
    """Speeds against an integration in which only the masses inside a tunnel feel its resistance."""
    tunnels = (
        Tunnel(start_m=800.0, length_m=300.0, area_m2=30.0),
        Tunnel(start_m=1500.0, length_m=900.0, area_m2=50.0),
    )
    route = replace(flat(3500.0), tunnels=tunnels)
    train = replace(
        make_train(resistance=(2e3, 0.0, 6.0), power_w=2e6),
        train_length_m=200.0,
        tunnel_area_m2=(20.0, 40.0),
        tunnel_resistance_n_per_mps2=(15.0, 5.0),
    )
    run = solved(route, train).trajectory(170.0).trajectory

    def line_n(s: float, v: float) -> float:
        at = sampled(train, s)
        shares = [np.mean((at >= t.start_m) & (at < t.start_m + t.length_m)) for t in tunnels]
        return float((10.0 * shares[0] + 5.0 * shares[1]) * v * v)  # 30 m² lies half-way, 50 m² beyond the table

    assert np.abs(reached_mps(run, train, line_n) - run.v_mps).max() < 0.02


CURVES = """
[curves]
columns = ["position_km", "radius_start_m", "radius_end_m"]
rows = [[0.0, inf, inf], [0.2, inf, 400], [0.4, 400, 400], [0.6, 400, -1000], [0.8, 250, 250], [1.0, inf, inf]]
"""


def test_a_clothoid_is_taken_at_its_mean_curvature(tmp_path: Path) -> None:
    """Curvatures and resistances by hand from the radii; the formula's mean along the clothoid is a second figure."""
    path = tmp_path / "route.toml"
    path.write_text((CATALOGUE / "routes" / "flat-6km.toml").read_text() + CURVES)
    route = read_route(path)
    kappa = np.array([0.0, 1 / 800, 1 / 400, (1 / 400 - 1 / 1000) / 2, 1 / 250, 0.0])
    assert route.curvature_per_m.value == pytest.approx(kappa)
    wide = G * 0.5 * kappa[:4] / (1 - 30 * kappa[:4])
    tight = G * 0.65 * kappa[4] / (1 - 55 * kappa[4])
    assert curve_resistance_mps2(kappa) == pytest.approx([*wide, tight, 0.0])
    # The mean of the formula along the clothoid differs little from the formula at the mean.
    along = np.linspace(0.0, 1 / 400, 1001)
    assert np.mean(curve_resistance_mps2(along)) == pytest.approx(float(wide[1]), rel=0.03)
    section = build_section(route, make_train())
    curve_n = section.constant_n @ section.step_m
    assert curve_n == pytest.approx(1e5 * 200 * (wide[1] + wide[2] + wide[3] + tight), rel=1e-9)


def test_adhesion_bounds_the_run_up() -> None:
    """Curtius and Kniffler by hand; the time to 25 m/s against an integration in time steps of 2 ms."""
    train = replace(make_train(power_w=1.5e6), adhesive_mass_kg=2e4)  # 65 kN on the rail of 100 kN of the motors
    speeds = np.array([0.0, 5.0, 10.0, 20.0, 40.0])
    mu = 0.161 + 7.5 / (3.6 * speeds + 44)
    assert adhesion_coefficient(speeds) == pytest.approx(mu)
    power = 1.5e6 / np.maximum(speeds, 1e-9)
    assert train.traction_effort_n(speeds) == pytest.approx(np.minimum(np.minimum(1e5, power), 2e4 * G * mu))
    run = solved(flat(5000.0), train).fastest().trajectory
    v, t, dt = 0.0, 0.0, 0.002
    while v < 25.0:  # adhesion alone, then power: independent integration in time
        force = min(1e5, 1.5e6 / max(v, 1e-9), 2e4 * G * (0.161 + 7.5 / (3.6 * v + 44)))
        v, t = v + dt * force / 1e5, t + dt
    top = int(run.v_mps.argmax())
    assert np.interp(25.0, run.v_mps[:top], run.t_s[:top]) == pytest.approx(t, abs=0.1)
    slow = run.v_mps[1:] < 20.0
    assert (run.force_el_n[slow] <= train.traction_effort_n(run.v_mps[:-1][slow]) * (1 + 1e-9)).all()


def test_on_a_slippery_rail_all_brakes_together_hold_less() -> None:
    """Deceleration against g times the coefficient of adhesion by hand: never above it, and near it while braking."""
    train = replace(make_train(), adhesive_mass_kg=4e4, friction_brake_force_n=3e5, brake_policy=BrakePolicy.BLENDED)
    slippery = Conditions(adhesion_ratio=0.3).train(train)
    run = solved(flat(3000.0, 30.0), slippery).fastest().trajectory
    rate = -np.diff(run.v_mps**2) / (2 * np.diff(run.s_m))
    braking = rate > 0.05
    most = 0.3 * G * (0.161 + 7.5 / (3.6 * run.v_mps[:-1] + 44))
    assert (rate[braking] <= most[braking] * (1 + 1e-6)).all()
    assert (rate[braking] >= 0.97 * most[braking])[1:-1].all()
    with pytest.raises(DasError, match="adhesion is missing"):
        Conditions(adhesion_ratio=0.5).train(make_train())


def test_accelerations_are_bounded() -> None:
    """Least time against the closed form of constant acceleration, cruise and constant deceleration."""
    train = replace(make_train(), max_acceleration_mps2=0.5, max_deceleration_mps2=0.8)
    fastest = solved(flat(4000.0, 25.0), train).fastest()
    run_up, run_down = 25.0**2 / (2 * 0.5), 25.0**2 / (2 * 0.8)
    assert fastest.time_s == pytest.approx(25 / 0.5 + 25 / 0.8 + (4000 - run_up - run_down) / 25, abs=0.02)


NEUTRAL_ZONES = (Zone(start_m=1000.0, length_m=150.0), Zone(start_m=2500.0, length_m=80.0))


def test_through_a_neutral_section_the_train_coasts() -> None:
    """No force of the motors inside; v² falls by 2·g·slope·length, the closed form without resistance."""
    grades = [(0.0, 0.0), (900.0, 0.01)]
    route = replace(make_route(4000.0, [(0.0, 30.0)], grades), neutral_sections=NEUTRAL_ZONES)
    for policy, friction_n in ((BrakePolicy.ELECTRIC, 0.0), (BrakePolicy.BLENDED, 1e5)):
        train = replace(make_train(power_w=2e6), brake_policy=policy, friction_brake_force_n=friction_n)
        front = solved(route, train)
        assert (front.section.supply == NEUTRAL).any()
        for run in (front.fastest().trajectory, front.trajectory(190.0).trajectory, front.trajectory(260.0).trajectory):
            for zone in NEUTRAL_ZONES:
                inside = (run.s_m[:-1] >= zone.start_m) & (run.s_m[:-1] < zone.start_m + zone.length_m - 1e-6)
                assert (run.force_el_n[inside] == 0).all()
                fallen = np.interp(zone.start_m, run.s_m, run.v_mps**2) - 2 * G * 0.01 * zone.length_m
                left = np.interp(zone.start_m + zone.length_m, run.s_m, run.v_mps**2)
                if not run.force_friction_n[inside].any():
                    assert left == pytest.approx(fallen, abs=1e-3)
            assert run.force_el_n.max() > 0


def test_a_neutral_section_on_a_climb_needs_a_run_up() -> None:
    """The least speed at its beginning against √(2·g·slope·length)."""
    zone = Zone(start_m=1500.0, length_m=400.0)
    route = replace(
        make_route(3000.0, [(0.0, 40.0)], [(0.0, 0.0), (1500.0, 0.03), (1900.0, 0.0)]), neutral_sections=(zone,)
    )
    section = build_section(route, make_train())
    needed = np.sqrt(2 * G * 0.03 * 400)
    assert section.floor_mps[np.searchsorted(section.node_m, 1500.0)] == pytest.approx(needed, rel=1e-3)
    slowest = solve_front(section).trajectory(400.0).trajectory
    assert np.interp(1500.0, slowest.s_m, slowest.v_mps) >= needed * 0.999
    inside = replace(route, neutral_sections=(Zone(start_m=0.0, length_m=50.0),))
    with pytest.raises(InfeasibleError, match="stalls at 0 m"):
        build_section(inside, make_train())


def test_without_regeneration_the_friction_brake_does_it_all() -> None:
    """The energy equals that of a train without an electric brake on a line without losses."""
    zone = (Zone(start_m=0.0, length_m=3000.0),)
    route = replace(flat(3000.0, 30.0), no_regeneration=zone)
    train = replace(make_train(), friction_brake_force_n=1e5, brake_policy=BrakePolicy.BLENDED)
    front = solved(route, train)
    solution = front.trajectory(150.0)
    run = solution.trajectory
    assert (run.force_el_n >= 0).all()
    assert (front.section.supply == NO_REGENERATION).all()
    # Without losses, what is driven without regeneration is level L0 NOREG with the friction brake alone.
    alone = replace(train, electric_brake=EffortEnvelope(max_force_n=0.0, max_power_w=0.0))
    noreg = solved(flat(3000.0, 30.0), alone, level=Level.L0_NOREG).trajectory(150.0)
    assert solution.balance.input == pytest.approx(noreg.balance.input, rel=1e-3)
    steep = replace(make_route(3000.0, [(0.0, 30.0)], [(0.0, -0.01)]), no_regeneration=zone)
    with pytest.raises(InfeasibleError, match="cannot brake on the descent"):
        build_section(steep, make_train())


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_line_takes_a_share_of_what_is_fed_back(share: float) -> None:
    """Input and unreturned energy against (1 − share) of the kinetic energy at the highest speed."""
    route = replace(flat(3000.0, 30.0), receptivity_ratio=Stretches.constant(share))
    train = make_train()
    front = solved(route, train)
    fastest = front.fastest()
    top = fastest.trajectory.v_mps.max()
    kinetic = 0.5 * 1e5 * top**2
    assert fastest.balance.input == pytest.approx((1 - share) * kinetic, rel=1e-6, abs=1.0)
    assert fastest.balance.unreturned == pytest.approx((1 - share) * kinetic, rel=1e-6, abs=1.0)
    solution = front.trajectory(150.0)
    assert solution.balance.residual_ratio < 1e-6
    if share == 0.0:
        noreg = solved(flat(3000.0, 30.0), train, level=Level.L0_NOREG).trajectory(150.0)
        assert solution.balance.input == pytest.approx(noreg.balance.input, rel=2e-3)
    if share == 1.0:
        assert solution.balance.unreturned == 0


def test_baselines_keep_to_the_supply_too() -> None:
    """No force in neutral sections, no forbidden regeneration, a closed energy balance, and never below the optimum."""
    route = replace(
        flat(4000.0, 30.0),
        neutral_sections=NEUTRAL_ZONES,
        no_regeneration=(Zone(start_m=3300.0, length_m=700.0),),
        receptivity_ratio=Stretches.constant(0.5),
    )
    train = replace(
        make_train(resistance=(1e3, 0.0, 5.0), power_w=2e6),
        friction_brake_force_n=1e5,
        brake_policy=BrakePolicy.BLENDED,
    )
    section = build_section(route, train)
    front = solve_front(section)
    time_s = 1.15 * front.fastest().time_s
    best = front.trajectory(time_s)
    for strategy in (baselines.Strategy.TOP_SPEED, baselines.Strategy.FOUR_MODE):
        run = baselines.baseline(strategy, section, time_s)
        assert (run.trajectory.force_el_n[section.supply == NEUTRAL] == 0).all()
        assert (run.trajectory.force_el_n[section.supply < 0] >= 0).all()
        assert run.balance.residual_ratio < 1e-9
        assert best.balance.input <= run.balance.input * 1.002
    other = evaluated_at(best.trajectory, train, Level.L0_REG)
    assert other.residual_ratio < 1e-9


def test_auxiliary_power_is_drawn_all_the_way_and_comfort_stays_beside() -> None:
    """The energy rises by exactly power times time; comfort power is stated beside it."""
    loss = EfficiencyLoss(traction_ratio=0.1, brake_ratio=0.1, idle_w=1e4)
    plain = make_train(resistance=(1e3, 0.0, 5.0), power_w=2e6, loss=loss)
    with_aux = replace(plain, auxiliary_power_w=5e4, comfort_power_w=3e4)
    a, b = solved(flat(5000.0), plain).trajectory(250.0), solved(flat(5000.0), with_aux).trajectory(250.0)
    # A constant power is a constant energy at a given time: the optimum stays, its energy rises by power × time.
    assert b.balance.input == pytest.approx(a.balance.input + 5e4 * 250.0, rel=2e-4)
    assert b.balance.comfort == pytest.approx(3e4 * b.time_s)
    chain = replace(
        plain,
        default_level=Level.L3,
        losses=MappingProxyType({Level.L3: plain.losses[Level.OWN]}),
        auxiliary_power_w=5e4,
    )
    assert chain.loss_model(Level.L3).loss_w(0.0, 10.0) == pytest.approx(6e4)
    assert chain.loss_model(Level.L0_REG).loss_w(0.0, 10.0) == 0


def test_a_load_changes_what_weighs_but_not_what_rotates() -> None:
    """Masses and resistances by hand: rotating parts keep theirs, rolling friction grows with the weight."""
    train = replace(make_train(resistance=(1e3, 10.0, 5.0)), rotating_mass_ratio=0.08)
    loads = MappingProxyType({"full": Load(mass_kg=1.3e5), "known": Load(mass_kg=9e4, c0_n=800.0)})
    train = replace(train, loads=loads)
    full, known = train.loaded("full"), train.loaded("known")
    assert full.mass_kg == 1.3e5
    assert full.inertial_mass_kg == pytest.approx(1.3e5 + 8e3)
    assert full.resistance == Resistance(c0_n=1.3e3, c1_n_per_mps=10.0, c2_n_per_mps2=5.0)
    assert known.resistance.c0_n == 800.0
    assert solved(flat(3000.0), full).fastest().time_s > solved(flat(3000.0), known).fastest().time_s
    with pytest.raises(DasError, match="no load 'empty'; it has full, known"):
        train.loaded("empty")


@pytest.mark.parametrize("wind_mps", [-6.0, 9.0])
def test_wind_meets_the_train_with_its_own_speed(wind_mps: float) -> None:
    """Speeds against an integration with c2·((v + w)² − v²) added to the resistance."""
    calm = make_train(resistance=(1e3, 20.0, 6.0), power_w=2e6)
    train = Conditions(head_wind_mps=wind_mps).train(calm)
    run = solved(flat(4000.0), train).trajectory(160.0).trajectory

    def wind_n(s: float, v: float) -> float:
        return 6.0 * ((v + wind_mps) ** 2 - v * v)

    assert np.abs(reached_mps(run, calm, wind_n) - run.v_mps).max() < 0.02


def test_conditions_out_of_range_are_refused() -> None:
    """One line with the name, the value and what was expected."""
    for options, message in (
        ({"mass_ratio": 0.0}, "mass_ratio = 0.0: expected 0.01 to 10"),
        ({"resistance_ratio": float("nan")}, "resistance_ratio = nan"),
        ({"receptivity_ratio": 1.2}, "receptivity_ratio = 1.2: expected 0 to 1"),
        ({"head_wind_mps": 80.0}, "head_wind_mps = 80.0: expected -50 to 50"),
    ):
        with pytest.raises(DasError, match=message):
            Conditions(**options)


def test_the_kernels_limits_are_the_vehicles() -> None:
    """Two codes for the same force limits, the compiled one and the vehicle's own, at five speeds."""
    train = replace(
        make_train(power_w=2e6),
        adhesive_mass_kg=3e4,
        adhesion_ratio=0.8,
        friction_brake_force_n=2e5,
        brake_policy=BrakePolicy.BLENDED,
    )
    p = train_params(train, BrakePolicy.BLENDED)
    for v in (0.0, 1.0, 8.0, 22.0, 45.0):
        assert forces.traction_limit(v, p) == pytest.approx(float(train.traction_effort_n(v)))
        assert forces.electric_limit(v, p) == pytest.approx(float(train.electric_brake_effort_n(v)))
        assert forces.brake_limit(v, p, p.friction_force_n) == pytest.approx(float(train.brake_effort_n(v)))


def test_zones_turn_round_with_the_line_and_overlapping_ones_are_refused() -> None:
    """The supply of the reversed line at mirrored places, and messages for zones that cannot be."""
    route = replace(
        flat(4000.0),
        neutral_sections=NEUTRAL_ZONES,
        receptivity_ratio=Stretches(start_m=np.array([0.0, 1000.0]), value=np.array([1.0, 0.5])),
    )
    back = route.reversed()
    at = np.array([50.0, 1100.0, 1400.0, 2510.0, 2600.0, 3900.0])
    assert back.supply().at(4000.0 - at).tolist() == route.supply().at(at).tolist()
    assert back.reversed().neutral_sections == route.neutral_sections
    with pytest.raises(InputError, match=r"neutral_sections\[1\] position = '1100 m': expected at least 1150 m"):
        replace(route, neutral_sections=(NEUTRAL_ZONES[0], Zone(start_m=1100.0, length_m=10.0)))
    with pytest.raises(InputError, match=r"receptivity\[0\] = 1.5: expected a ratio from 0 to 1"):
        replace(route, receptivity_ratio=Stretches.constant(1.5))


ZONES = """
[receptivity]
columns = ["position_km", "receptivity_ratio"]
rows = [[0.0, 1.0], [2.0, 0.6]]
[neutral_sections]
columns = ["position_km", "length_m"]
rows = [[1.0, 120]]
[no_regeneration]
columns = ["position_m", "length_km"]
rows = [[3000, 0.5]]
"""
TRAIN = """
[adhesion]
source = "two driven bogies"
adhesive_mass_t = 84
[loads.empty]
mass_t = 400
[loads.full]
source = "every seat taken"
mass_t = 480
c0_kn = 9.0
"""


def test_supply_adhesion_and_loads_are_read_from_files(tmp_path: Path) -> None:
    """What the file says in km, t and kN arrives in SI; a misspelt table and a negative mass are refused."""
    path = tmp_path / "route.toml"
    path.write_text((CATALOGUE / "routes" / "flat-6km.toml").read_text() + ZONES)
    route = read_route(path)
    assert route.supply().at([500.0, 1050.0, 2500.0, 3200.0]).tolist() == [1.0, NEUTRAL, 0.6, NO_REGENERATION]
    path.write_text(path.read_text().replace("neutral_sections", "neutral_section"))
    with pytest.raises(InputError, match="neutral_section"):
        read_route(path)
    path = tmp_path / "train.toml"
    text = (CATALOGUE / "vehicles" / "re460-ic.toml").read_text()
    text = text.replace("[vehicle]", "[vehicle]\nauxiliary_power_kw = 12")
    path.write_text(text + TRAIN)
    train = read_vehicle(path)
    assert (train.adhesive_mass_kg, train.auxiliary_power_w) == (84e3, 12e3)
    assert train.loads == {"empty": Load(mass_kg=4e5), "full": Load(mass_kg=4.8e5, c0_n=9e3)}
    path.write_text(text + TRAIN.replace("mass_t = 480", "mass_kg = -1"))
    with pytest.raises(InputError, match=r"train.toml: loads.full.mass_kg = -1.0: expected a finite number > 0"):
        read_vehicle(path)
