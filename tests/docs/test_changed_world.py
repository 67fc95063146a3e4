"""A plan in a changed world, against closed forms and integrators of this file's own; its table."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from das.domain.conditions import Conditions
from das.domain.effort import EffortEnvelope
from das.domain.errors import DasError
from das.domain.losses import EfficiencyLoss
from das.domain.route import Route
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from docs.studies import changed_world
from docs.studies.changed_world import (
    Parameter,
    Variation,
    VariationOutcome,
    World,
    assess,
    by_effect,
    follow,
    variations,
)
from tests.support.making import flat, make_route, make_train

AS_PLANNED = Conditions()
LENGTH_M = 8000.0
LOSSY = EfficiencyLoss(traction_ratio=0.15, brake_ratio=0.2, idle_w=20e3)


def world(route: Route, vehicle: Vehicle) -> World:
    return lambda conditions: build_section(conditions.line(route), conditions.train(vehicle))


def planned(section: Section, buffer_ratio: float) -> Solution:
    front = solve_front(section)
    return front.trajectory(front.fastest().time_s * (1 + buffer_ratio))


def varied(there: World, plan: Solution, parameter: str, value: float) -> VariationOutcome:
    """What becomes of a plan where one parameter of the world is another."""
    return assess(plan, Variation.of(AS_PLANNED, Parameter(parameter), value), there)


def gentle(vehicle: Vehicle) -> Vehicle:
    """The train with 60 of its 100 kN: what it plans, the train can follow with more mass, resistance and wind."""
    effort = EffortEnvelope(max_force_n=6e4, max_power_w=1e12)
    return replace(vehicle, traction=effort, electric_brake=effort)


def with_friction(train: Vehicle) -> Vehicle:
    """With 40 of 100 t on driven axles, and a friction brake on all of them."""
    blended = replace(train, friction_brake_force_n=1.5e5, brake_policy=BrakePolicy.BLENDED)
    return replace(blended, adhesive_mass_kg=4e4)


def real_train() -> Vehicle:
    """Losses, both brakes, length, adhesion: everything that a variation touches."""
    train = make_train(resistance=(2000.0, 30.0, 6.0), power_w=2e6, loss=LOSSY)
    return replace(with_friction(train), train_length_m=150.0, rotating_mass_ratio=0.08)


@pytest.fixture(scope="module")
def hilly() -> tuple[World, Solution]:
    """A world of hills and limits, and a plan in it."""
    limits = [(0.0, 40.0), (3000.0, 25.0), (4000.0, 45.0)]
    grades = [(0.0, 0.0), (1500.0, 0.012), (4500.0, -0.015), (7000.0, 0.0)]
    there = world(make_route(LENGTH_M, limits, grades), real_train())
    return there, planned(there(AS_PLANNED), 0.08)


@pytest.mark.parametrize(
    ("parameter", "value"),
    [("mass", 0.0), ("resistance", 0.0), ("wind", 0.0), ("receptivity", 1.0), ("adhesion", 1.0)],
)
def test_a_variation_of_nothing_is_the_plan_bit_for_bit(
    hilly: tuple[World, Solution], parameter: str, value: float
) -> None:
    there, plan = hilly
    outcome = varied(there, plan, parameter, value)
    for name in ("s_m", "t_s", "v_mps", "force_el_n", "force_friction_n"):
        assert np.array_equal(getattr(outcome.followed.trajectory, name), getattr(plan.trajectory, name)), name
    assert outcome.followed.balance == plan.balance
    assert (outcome.late_s, outcome.extra_ratio, outcome.followed.off_plan_ratio) == (0.0, 0.0, 0.0)
    assert (outcome.trouble, outcome.late_s_per_step) == (None, None)
    assert outcome.saved_ratio == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("mass_ratio", [0.8, 1.3])
def test_energy_of_the_same_speeds_goes_with_the_inertial_mass(mass_ratio: float) -> None:
    """Level, lossless, no resistance, nothing taken back: ½·m·v² of the highest speed, rotating parts as they are."""
    train = replace(make_train(), rotating_mass_ratio=0.1)
    nothing_back = Conditions(receptivity_ratio=0.0)
    plan = planned(world(flat(LENGTH_M), gentle(train))(nothing_back), 0.1)
    followed = follow(plan.trajectory, world(flat(LENGTH_M), train)(replace(nothing_back, mass_ratio=mass_ratio)))
    inertial_kg = mass_ratio * 1e5 + 0.1 * 1e5
    assert followed.balance.input == pytest.approx(plan.balance.input * inertial_kg / 1.1e5, rel=1e-12)
    assert followed.balance.input == pytest.approx(0.5 * inertial_kg * plan.trajectory.v_mps.max() ** 2, rel=1e-6)
    assert followed.time_s == pytest.approx(plan.time_s, rel=1e-12)
    assert followed.off_plan_ratio == 0.0


@pytest.mark.parametrize("percent", [-30.0, 25.0])
def test_resistance_adds_its_percentage_of_the_resistance_in_the_energy_balance(percent: float) -> None:
    train = make_train(resistance=(2000.0, 30.0, 6.0))
    plan = planned(world(flat(LENGTH_M), gentle(train))(AS_PLANNED), 0.1)
    outcome = varied(world(flat(LENGTH_M), train), plan, "resistance", percent)
    assert outcome.followed.balance.resistance == pytest.approx(
        (1 + percent / 100) * plan.balance.resistance, rel=1e-12
    )
    # Without losses all that is put in is resistance.
    slope = outcome.extra_ratio_per_step
    assert slope == pytest.approx(0.01 * plan.balance.resistance / plan.balance.input, rel=1e-9)
    assert outcome.late_s == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("receptivity", [0.0, 0.3, 1.0])
def test_receptivity_gives_back_its_share_of_the_braking(receptivity: float) -> None:
    """½·m·v²·(1/η_t − ρ·η_b): one acceleration, coasting without resistance, one braking."""
    train = make_train(loss=EfficiencyLoss.from_efficiencies(0.9, 0.8))
    plan = planned(world(flat(LENGTH_M), train)(AS_PLANNED), 0.1)
    followed = follow(plan.trajectory, world(flat(LENGTH_M), train)(Conditions(receptivity_ratio=receptivity)))
    kinetic_j = 0.5 * 1e5 * plan.trajectory.v_mps.max() ** 2
    assert followed.balance.input == pytest.approx(kinetic_j * (1 / 0.9 - receptivity * 0.8), rel=2e-3)
    fed_back_j = plan.balance.input - followed.balance.input
    assert -fed_back_j == pytest.approx((1 - receptivity) * kinetic_j * 0.8, rel=2e-3, abs=1e-6)
    assert np.array_equal(followed.trajectory.v_mps, plan.trajectory.v_mps)


@pytest.mark.parametrize("wind_kmh", [-20.0, 30.0])
def test_wind_costs_what_the_faster_air_takes(wind_kmh: float) -> None:
    """∫c2·((v + w)² − v²)ds by quadrature along the plan, v² linear between its nodes."""
    train = make_train(resistance=(2000.0, 30.0, 6.0))
    plan = planned(world(flat(LENGTH_M), gentle(train))(AS_PLANNED), 0.1)
    outcome = varied(world(flat(LENGTH_M), train), plan, "wind", wind_kmh)
    s = np.linspace(0.0, LENGTH_M, 800_001)
    v, w = np.sqrt(np.interp(s, plan.trajectory.s_m, plan.trajectory.v_mps**2)), wind_kmh / 3.6
    extra_j = np.trapezoid(6.0 * ((v + w) ** 2 - v**2), s)
    assert outcome.followed.balance.input - plan.balance.input == pytest.approx(extra_j, rel=1e-6)
    assert outcome.extra_ratio == pytest.approx(extra_j / plan.balance.input, rel=1e-6)
    assert outcome.followed.off_plan_ratio == 0.0


def adhesion(v_mps: np.ndarray | float) -> np.ndarray | float:
    """Curtius and Kniffler's dry rail."""
    return 0.161 + 7.5 / (3.6 * v_mps + 44.0)


@pytest.fixture(scope="module")
def slippery() -> tuple[World, Solution]:
    """A level line and a train that brakes with all axles."""
    there = world(flat(LENGTH_M, 35.0), with_friction(make_train(resistance=(2000.0, 0.0, 6.0))))
    return there, planned(there(AS_PLANNED), 0.05)


def test_on_a_slippery_rail_full_traction_is_what_the_rail_bears(slippery: tuple[World, Solution]) -> None:
    """Beside the solver's run: m·dv/dt = µ·m_driven·g·0.3 − R in steps of 5 ms until the planned speed is met."""
    there, plan = slippery
    followed = follow(plan.trajectory, there(Conditions(adhesion_ratio=0.3)))
    s_plan, w_plan = plan.trajectory.s_m, plan.trajectory.v_mps**2
    s, v, way, speed = 0.0, 0.0, [0.0], [0.0]
    while v == 0.0 or v * v < np.interp(s, s_plan, w_plan):
        mid = v
        for _ in range(2):
            a = (min(1e5, adhesion(mid) * 4e4 * 9.81 * 0.3) - 2000 - 6 * mid * mid) / 1e5
            mid = v + 0.5 * a * 0.005
        s, v = s + mid * 0.005, v + a * 0.005
        way.append(s)
        speed.append(v)
    assert 500 < s < 6000
    run = followed.trajectory
    behind = run.s_m < 0.98 * s
    assert run.v_mps[behind] == pytest.approx(np.interp(run.s_m[behind], way, speed), abs=0.05)
    # Then it is on the plan, until it has to brake earlier.
    after = (run.s_m > 1.02 * s) & (run.s_m < LENGTH_M - 1500)
    assert after.any()
    assert run.v_mps[after] == pytest.approx(np.sqrt(np.interp(run.s_m[after], s_plan, w_plan)), abs=1e-9)


def test_on_a_slippery_rail_the_train_brakes_earlier_and_stops_in_time(slippery: tuple[World, Solution]) -> None:
    """No speed above the curve m·dv/dt = −(µ·m·g·share + R), integrated backwards from the stop in steps of 5 ms."""
    there, plan = slippery
    lateness = []
    for share in (1.0, 0.6, 0.3, 0.1):
        followed = follow(plan.trajectory, there(Conditions(adhesion_ratio=share)))
        to_go, v, way, speed = 0.0, 0.0, [0.0], [0.0]
        while v < 40.0:
            electric = min(1e5, adhesion(v) * 4e4 * 9.81 * share)
            brake = min(electric + 1.5e5, adhesion(v) * 1e5 * 9.81 * share)
            a = (brake + 2000 + 6 * v * v) / 1e5
            to_go, v = to_go + (v + 0.5 * a * 0.005) * 0.005, v + a * 0.005
            way.append(to_go)
            speed.append(v)
        run = followed.trajectory
        assert (run.v_mps <= np.interp(LENGTH_M - run.s_m, way, speed) + 0.02).all()
        assert run.v_mps[-1] == 0.0
        faster = np.maximum(run.v_mps[:-1], run.v_mps[1:])
        assert (run.force_el_n <= adhesion(faster) * 4e4 * 9.81 * share + 1e-3).all()
        assert (-run.force_el_n - run.force_friction_n <= adhesion(faster) * 1e5 * 9.81 * share + 1e-3).all()
        lateness.append(followed.time_s - plan.time_s)
    assert lateness[0] == 0.0
    assert all(a < b for a, b in itertools.pairwise(lateness))


CLIMB = [(0.0, 0.0), (4000.0, 0.08), (5000.0, 0.0)]
"""80 ‰ for 1 km: 78 kN of 100 kN for 100 t, more than all for 130 t."""


def test_a_heavy_train_loses_speed_on_the_climb_and_comes_back_to_the_plan() -> None:
    """Without resistance full traction changes v² by 2·(F/m − g·i)·way; the plan holds 30 m/s all the way."""
    there = world(make_route(10_000.0, [(0.0, 30.0)], CLIMB), make_train())
    plan = planned(there(AS_PLANNED), 0.0)
    followed = follow(plan.trajectory, there(Conditions(mass_ratio=1.5)))
    run = followed.trajectory
    on_plan = np.abs(run.v_mps - np.sqrt(np.interp(run.s_m, plan.trajectory.s_m, plan.trajectory.v_mps**2))) < 1e-9
    foot, crest = (int(np.argmin(np.abs(run.s_m - at_m))) for at_m in (4000.0, 5000.0))
    assert on_plan[foot]
    assert not on_plan[crest]
    lost = 2 * (1e5 / 1.5e5 - 9.81 * 0.08) * 1000
    assert run.v_mps[crest] ** 2 == pytest.approx(run.v_mps[foot] ** 2 + lost, rel=1e-9)
    back = crest + int(np.argmax(on_plan[crest:]))
    assert back > crest
    assert run.force_el_n[crest : back - 1] == pytest.approx(1e5)
    assert run.s_m[back] < 6000
    assert on_plan[back:][run.s_m[back:] < 9300].all()  # the last 675 m it brakes
    assert 0 < followed.off_plan_ratio < 0.6
    assert followed.time_s > plan.time_s


def test_a_train_too_heavy_for_the_climb_says_where_it_stalls() -> None:
    """+60 % at 100 kN on 80 ‰ lose 0.16 m/s² × 1 km: v² = 320 m²/s². The plan comes slower, the fastest run faster."""
    train = make_train(resistance=(0.0, 0.0, 20.0), loss=EfficiencyLoss.from_efficiencies(0.9, 0.8))
    there = world(make_route(10_000.0, [(0.0, 35.0)], CLIMB), train)
    plan = planned(there(AS_PLANNED), 1.2)
    assert np.interp(4000.0, plan.trajectory.s_m, plan.trajectory.v_mps) ** 2 < 320
    stale = varied(there, plan, "mass", 60.0)
    assert stale.trouble.startswith("following the plan the train stalls at km 4.")
    assert (stale.followed, stale.late_s, stale.extra_ratio, stale.saved_ratio) == (None, None, None, None)
    assert stale.on_time.time_s == pytest.approx(plan.time_s, abs=0.02)

    slow = world(make_route(10_000.0, [(0.0, 15.0)], CLIMB), train)
    impossible = varied(slow, planned(slow(AS_PLANNED), 0.1), "mass", 60.0)
    assert impossible.trouble.startswith("no run at all: test: the train stalls at 4")
    assert (impossible.followed, impossible.on_time) == (None, None)
    assert by_effect([varied(there, plan, "mass", 5.0), stale])[0] == [stale]


def test_a_train_too_weak_for_the_end_speed_says_so() -> None:
    """The plan runs up to 30 m/s only at its end; with half again the mass that run-up begins too late."""
    train = make_train(loss=EfficiencyLoss.from_efficiencies(0.9, 0.8))

    def there(conditions: Conditions) -> Section:
        return build_section(flat(3000.0), conditions.train(train), options=SectionOptions(end_speed_mps=30.0))

    plan = planned(there(AS_PLANNED), 0.6)
    outcome = varied(there, plan, "mass", 50.0)
    assert outcome.trouble.startswith("following the plan the train ends at ")
    assert outcome.trouble.endswith(" km/h, not 108.0 km/h")


@pytest.mark.parametrize(
    ("parameter", "value"), [("mass", 10.0), ("mass", -10.0), ("wind", 40.0), ("receptivity", 0.0), ("adhesion", 0.5)]
)
def test_planning_anew_is_never_worse_than_the_stale_plan(
    hilly: tuple[World, Solution], parameter: str, value: float
) -> None:
    there, plan = hilly
    outcome = varied(there, plan, parameter, value)
    assert outcome.saved_ratio > -2e-3  # to the accuracy of the solver
    assert outcome.same_time.time_s <= outcome.followed.time_s + 0.02
    assert outcome.on_time.time_s == pytest.approx(max(plan.time_s, outcome.on_time.least_time_s), abs=0.02)


def test_a_variation_changes_the_plan_by_its_step() -> None:
    plan = Conditions(mass_ratio=1.2, head_wind_mps=5.0, receptivity_ratio=0.8)
    mass, wind, back = variations(plan, real_train(), ["mass=10", "wind=36", "receptivity=0.5"])
    assert mass.conditions == replace(plan, mass_ratio=1.2 * 1.1)
    assert wind.conditions == replace(plan, head_wind_mps=10.0)
    assert back.conditions == replace(plan, receptivity_ratio=0.5)
    assert [x.step for x in (mass, wind, back)] == pytest.approx([10.0, 18.0, -30.0])
    assert [x.unit for x in (mass, wind, back)] == ["%", "km/h", "%"]
    assert [x.label for x in (mass, wind, back)] == ["mass +10 %", "head wind 36 km/h", "receptivity 0.5"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mas=10", "--vary mas=10: expected PARAMETER=VALUE,… of mass, resistance, wind, receptivity, adhesion"),
        ("mass=10%", "--vary mass=10%: expected numbers separated by commas, like mass=-10,10"),
        ("mass=-100", "conditions: mass_ratio = 0.0: expected 0.01 to 10"),
        ("receptivity=-0.5", "conditions: receptivity_ratio = -0.5: expected 0 to 1"),
    ],
)
def test_variations_that_cannot_be_are_refused(text: str, expected: str) -> None:
    with pytest.raises(DasError) as refused:
        variations(AS_PLANNED, real_train(), [text])
    assert str(refused.value) == expected


def test_the_table_has_a_row_a_variation_and_leaves_adhesion_out_without_data(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert len(variations(AS_PLANNED, real_train())) == 16
    changed_world.main(["flat-6km", "re460-ic"])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum(line.startswith((" mass ", " resistance", " head", " tail", " receptivity")) for line in lines) == 14
