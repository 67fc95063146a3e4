"""Drivers under the guide: what they see, what is new to them, and what they do about it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from das.advice.advice import Advice, Guidance, Instruction
from das.advice.reason import Reason, ReasonCode
from das.advice.regimes import Regime
from das.advice.shown import as_read
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import KMH
from sim.drivers.cab import AdviceView, CabView, Driver
from sim.drivers.drivers import PerfectDriver
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import Presentation
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.parameters import HumanParameters
from sim.drivers.presentations.presenter import Shown, SimplerLook, present, presenter_of
from sim.plant.kernels import electric_effort
from sim.plant.plant import COAST, Efforts

LINE = LineKnowledge(route=load_route("flat-6km"), vehicle=load_vehicle("re460-ic"))
QUICK = HumanParameters(
    reaction_median_s=0.2, reaction_log_sd=0.0, glance_mean_s=0.2, glance_least_s=0.0, force_error_ratio=0.0,
    speed_error_mps=0.0, lapses_per_h=0.0, lever_rate_per_s=10.0, comply_traction_ratio=1.0, comply_hold_ratio=1.0,
    comply_coast_ratio=1.0, comply_brake_ratio=1.0,
)  # fmt: skip
"""A human who sees everything at once, does it at once and does not err."""


def advice(now: Instruction | None, *, force_n: float = 0.0, **fields: Any) -> Advice:
    efforts = Efforts.at(20.0, LINE.train)
    largest_n = efforts.traction_n, efforts.brakes_n
    guide = None if now is None else Guidance(now=now, force_n=force_n, **fields)
    guide = guide if guide is None or now == Instruction() else as_read(guide, largest_n)
    return Advice(time_ns=0, speed_mps=20.0, mode=Regime.CRUISE, valid_until_ns=3 * 10**9, guide=guide)


def view(now: Instruction, **fields: Any) -> AdviceView:
    seen = present(advice(now, **fields), Presentation.GUIDE)
    assert seen is not None
    return seen


def cab(shown: AdviceView | None, **fields: Any) -> CabView:
    usual = {"time_s": 0.0, "s_m": 2000.0, "speed_mps": 20.0, "limit_mps": 160 * KMH, "stop_m": 6000.0}
    return CabView(**{**usual, "departure_s": -100.0, "arrival_s": 300.0, "advice": shown, **fields})


TRACTION = Instruction(mode=Regime.REDUCED_TRACTION, speed_mps=100.4 * KMH, effort_ratio=0.8)
DEPART = Instruction(mode=Regime.DEPART, speed_mps=100.4 * KMH, effort_ratio=0.8)
HOLD = Instruction(mode=Regime.CRUISE, speed_mps=20.0)
ROLL = Instruction(mode=Regime.COAST, speed_mps=10.0, effort_ratio=0.0)
LATE = Reason(code=ReasonCode.ARRIVAL, late_s=40.0)
BRAKE = Instruction(mode=Regime.REDUCED_BRAKE, speed_mps=10.0, effort_ratio=-0.4)


def test_a_display_of_the_guide_shows_mode_speed_effort_and_what_comes_next() -> None:
    following = (replace(ROLL, in_s=42.0, way_m=900.0),)
    seen = view(TRACTION, force_n=1e5, following=following, target_m=800.0, reason=LATE)
    assert (seen.mode, seen.next_mode, seen.next_change_s) == (Regime.REDUCED_TRACTION, Regime.COAST, 42.0)
    assert (seen.speed_mps, seen.display_speed_mps) == pytest.approx((100 * KMH, 100 * KMH))
    assert (seen.next_speed_mps, seen.next_effort_ratio) == (10.0, 0.0)
    assert (seen.target_way_m, seen.reason, seen.due_s) == (800.0, LATE, 0.0)
    assert seen.lever_ratio == TRACTION.effort_ratio, "an acceleration keeps its effort while its force eases off"
    braked = view(BRAKE, force_n=-1e5)
    assert braked.lever_ratio == pytest.approx(-1e5 / Efforts.at(20.0, LINE.train).brakes_n)
    assert seen.horizon_speed_mps == ()


def test_nobody_is_told_with_what_effort_to_hold_a_speed() -> None:
    seen = view(HOLD, force_n=3e4)
    assert math.isnan(seen.lever_ratio)
    assert Shown.of(seen) == Shown(mode=Regime.CRUISE, speed_kmh=72, effort=None)


def test_a_display_says_to_depart_with_no_effort_yet_and_how_to_depart_when_cleared() -> None:
    seen = view(DEPART)
    assert (seen.mode, seen.lever_ratio, seen.force_n) == (Regime.DEPART, 0.0, 0.0)
    assert seen.display_speed_mps == pytest.approx(100 * KMH)
    assert (seen.next_mode, seen.next_effort_ratio) == (Regime.REDUCED_TRACTION, 0.8)
    assert seen.next_speed_mps == pytest.approx(100 * KMH)
    assert math.isnan(seen.next_change_s)
    read = seen.departure
    assert Shown.of(read) == Shown(mode=Regime.REDUCED_TRACTION, speed_kmh=100, effort=4)
    assert read.departure is read
    held = view(replace(DEPART, effort_ratio=math.nan))
    assert held.departure.mode == Regime.CRUISE


def told_to_depart(presentation: Presentation) -> AdviceView:
    """What a display shows of advice to depart with 0.8 of the traction, to 20 m/s."""
    given = Advice(
        time_ns=0, speed_mps=0.0, mode=Regime.DEPART, next_mode=Regime.REDUCED_TRACTION,
        advised_speed_mps=0.0, display_speed_mps=0.0, advised_force_n=0.0,
        horizon_speed_mps=(0.0,) * 30, horizon_force_n=(0.0,) * 30, departure_speed_mps=20.0,
        departure_force_ratio=0.8, valid_until_ns=100 * 10**9,
        guide=Guidance(now=replace(DEPART, speed_mps=20.0)),
    )  # fmt: skip
    look = SimplerLook(
        time_ns=0, valid_until_ns=100 * 10**9, mode=Regime.DEPART, four_mode=Regime.DEPART,
        next_four_mode=Regime.CRUISE, departure_speed_mps=20.0, top_speed_mps=20.0,
    )  # fmt: skip
    seen = present(look if presenter_of(presentation).is_simpler else given, presentation)
    assert seen is not None
    return seen


@pytest.mark.parametrize("presentation", [Presentation.SPEED_AND_EFFORT, Presentation.FOUR_MODE, Presentation.GUIDE])
@pytest.mark.parametrize("driver", [HumanDriver(LINE, QUICK, seed=1), PerfectDriver(LINE)])
def test_a_driver_who_is_cleared_departs_and_one_who_is_not_stands(driver: Driver, presentation: Presentation) -> None:
    seen = told_to_depart(presentation)
    for look in range(20):
        command = driver.command(cab(seen, time_s=0.2 * look, speed_mps=0.0, may_depart=False))
        assert command == COAST
    for look in range(20, 40):
        command = driver.command(cab(seen, time_s=0.2 * look, speed_mps=0.0))
    assert command.value > 0.0
    if isinstance(driver, HumanDriver) and presentation is not Presentation.FOUR_MODE:
        assert command.value == pytest.approx(0.8, abs=0.03)
    if isinstance(driver, PerfectDriver) and presentation is not Presentation.FOUR_MODE:
        assert command.value == pytest.approx(20.0)
        assert command.high_n == pytest.approx(0.8 * Efforts.at(0.0, LINE.train).traction_n)


@pytest.mark.parametrize("presentation", [Presentation.SPEED_AND_EFFORT, Presentation.GUIDE])
def test_to_accelerate_is_not_new_to_a_human_who_departs(presentation: Presentation) -> None:
    """The train moves, and the display goes from the departure to its acceleration: he decided on that already."""
    driver, seen = HumanDriver(LINE, QUICK, seed=1), told_to_depart(presentation)
    gone = replace(seen.departure, time_s=2.0, force_n=1e5)
    for look in range(10):
        driver.command(cab(seen, time_s=0.2 * look, speed_mps=0.0))
    decisions = [event for event in driver.events if event.what in ("noticed", "followed", "refused")]
    assert decisions
    for look in range(10, 40):
        driver.command(cab(gone, time_s=0.2 * look, speed_mps=2.0))
    assert [event for event in driver.events if event.what in ("noticed", "followed", "refused")] == decisions


def test_a_top_speed_says_nothing_of_how_to_depart() -> None:
    seen = told_to_depart(Presentation.TOP_SPEED)
    assert (seen.mode, seen.speed_mps, seen.departure) == (Regime.DEPART, 20.0, seen)


@pytest.mark.parametrize("now", [None, Instruction()])
def test_where_there_is_no_reference_nothing_is_shown(now: Instruction | None) -> None:
    assert present(advice(now), Presentation.GUIDE) is None


def settled(now: Instruction, *, force_n: float = 0.0, **fields: Any) -> float:
    """The controller's setting of a quick human after two seconds of one instruction."""
    driver, seen = HumanDriver(LINE, QUICK, seed=1), view(now, force_n=force_n)
    command = COAST
    for look in range(20):
        command = driver.command(cab(replace(seen, valid_until_s=100.0), time_s=0.2 * look, **fields))
    return float(command.value)


def test_a_human_sets_the_effort_that_he_is_told() -> None:
    """Four fifths of traction; coasting: none; the brake with the share of all brakes that the force is."""
    efforts = Efforts.at(20.0, LINE.train)
    assert settled(TRACTION, force_n=0.8 * efforts.traction_n) == pytest.approx(0.8, abs=0.03)
    assert settled(ROLL) == pytest.approx(0.0, abs=1e-9)
    assert settled(BRAKE, force_n=-6e4) == pytest.approx(-6e4 / efforts.brakes_n, abs=0.03)


def test_a_human_holds_the_speed_that_he_has_reached() -> None:
    """At the target: no traction beyond what the resistance takes; with the brake: no braking any more."""
    force_n = 0.8 * Efforts.at(20.0, LINE.train).traction_n
    assert settled(replace(TRACTION, speed_mps=20.0), force_n=force_n) < 0.2
    assert settled(replace(BRAKE, speed_mps=20.5), force_n=-6e4) == pytest.approx(0.0, abs=0.1)


def test_a_human_does_not_begin_what_would_be_over_at_once() -> None:
    """Full traction from 20 to 20.4 m/s would last a second: he holds the speed; and a brake to 19.7 he leaves."""
    efforts = Efforts.at(20.0, LINE.train)
    full = replace(TRACTION, mode=Regime.FULL_TRACTION, effort_ratio=1.0)
    assert settled(replace(full, speed_mps=20.4), force_n=efforts.traction_n) < 0.3
    assert settled(replace(full, speed_mps=30.0), force_n=efforts.traction_n) == 1.0
    assert settled(replace(BRAKE, speed_mps=19.7), force_n=-0.3 * efforts.brakes_n) == pytest.approx(0.0, abs=1e-9)


def test_a_human_who_sees_the_mark_brakes_by_eye() -> None:
    """From 10 m/s the driver brakes with the effort shown 400 m before the mark, and not yet 200 m before it."""
    stop, force_n = replace(BRAKE, speed_mps=0.0), -0.4 * Efforts.at(10.0, LINE.train).brakes_n
    assert settled(stop, force_n=force_n, s_m=5600.0, speed_mps=10.0) < -0.3
    assert settled(stop, force_n=force_n, s_m=5800.0, speed_mps=10.0) > -0.05


def test_a_human_never_goes_above_the_limit_for_the_guide() -> None:
    force_n = Efforts.at(20.0, LINE.train).traction_n
    assert settled(replace(TRACTION, speed_mps=30.0), force_n=force_n, limit_mps=20.0) < 0.2


@pytest.mark.parametrize(
    ("after", "new"),
    [
        (replace(HOLD, speed_mps=20.05), False),
        (replace(HOLD, speed_mps=22.0), True),
        (replace(HOLD, mode=Regime.COAST, effort_ratio=0.0), True),
    ],
)
def test_only_another_mode_speed_or_effort_is_new_to_a_human(after: Instruction, new: bool) -> None:
    """He decides once on what he sees: his diary says how often."""
    driver = HumanDriver(LINE, QUICK, seed=1)
    for look in range(20):
        seen = view(HOLD if look < 10 else after)
        driver.command(cab(replace(seen, valid_until_s=100.0), time_s=0.2 * look))
    followed = [event for event in driver.events if event.what == "followed"]
    assert len(followed) == (2 if new else 1)


def test_a_perfect_driver_does_what_is_due_and_no_sooner() -> None:
    """Coasting that is due in 4 s: until then he holds what was due before."""
    driver = PerfectDriver(LINE)
    hold, roll = view(HOLD), view(replace(ROLL, in_s=4.0, way_m=80.0))
    held = driver.command(cab(hold))
    assert held.value == pytest.approx(20.0)
    assert driver.command(cab(replace(roll, time_s=1.0, valid_until_s=9.0), time_s=1.0)) == driver.command(
        cab(replace(hold, valid_until_s=9.0), time_s=1.0)
    )
    later = replace(roll, time_s=4.9, valid_until_s=9.0, due_s=0.1)
    assert driver.command(cab(later, time_s=4.9)) == COAST


@pytest.mark.parametrize("limit_mps", [22.0, 40.0])
def test_a_perfect_driver_accelerates_when_it_is_due_and_no_faster_than_the_limit(limit_mps: float) -> None:
    """It is announced for 5 s from now, and what is shown then does not change."""
    driver = PerfectDriver(LINE)
    seen = view(HOLD, following=(replace(TRACTION, in_s=5.0, way_m=100.0),))
    seen = replace(seen, valid_until_s=9.0)
    assert driver.command(cab(seen, time_s=4.0, limit_mps=limit_mps)).value == pytest.approx(20.0)
    command = driver.command(cab(seen, time_s=4.4, limit_mps=limit_mps))
    assert command.value == pytest.approx(min(100 * KMH, limit_mps))
    assert command.high_n == pytest.approx(0.8 * Efforts.at(20.0, LINE.train).traction_n)


@pytest.mark.parametrize(("over_mps", "coasts"), [(0.0, True), (0.2, True), (0.5, False)])
def test_a_perfect_driver_coasts_at_a_limit_and_brakes_to_it_only_from_clearly_above(
    over_mps: float, coasts: bool
) -> None:
    command = PerfectDriver(LINE).command(cab(view(ROLL), limit_mps=20.0 - over_mps))
    assert (command == COAST) is coasts
    assert coasts or command.value == pytest.approx(20.0 - over_mps)


@pytest.mark.parametrize(("more", "motors_alone"), [(1.05, True), (1.2, False)])
def test_a_perfect_driver_takes_no_friction_where_the_motors_nearly_suffice(more: float, motors_alone: bool) -> None:
    """A brake from 20 m/s to 10 m/s that needs so many times what the motors give."""
    motors_n = float(electric_effort(20.0, 1.0, LINE.train))
    resistance_n = float(LINE.vehicle.resistance.force_n(20.0))
    way_m = (20.0**2 - 10.0**2) * LINE.vehicle.inertial_mass_kg / (2.0 * (more * motors_n + resistance_n))
    seen = view(BRAKE, reference_force_n=-9e5, target_m=way_m)
    command = PerfectDriver(LINE).command(cab(seen))
    assert command.value == pytest.approx(-motors_n if motors_alone else -more * motors_n, rel=1e-3)


@pytest.mark.parametrize("told_n", [-3e5, -8e4, 0.0])
def test_a_perfect_driver_brakes_to_the_speed_at_its_place_and_no_harder_than_the_reference(told_n: float) -> None:
    """From 20 to 10 m/s in 500 m: 0.3 m/s², and the resistance helps; the braking curve may ask for more later on."""
    driver, seen = PerfectDriver(LINE), view(BRAKE, reference_force_n=told_n, target_m=500.0)
    command = driver.command(cab(seen))
    resistance_n = float(LINE.vehicle.resistance.force_n(20.0))
    expected = resistance_n - 0.3 * LINE.vehicle.inertial_mass_kg
    assert command.value == pytest.approx(max(expected, told_n), rel=1e-3)


@pytest.mark.parametrize(
    ("mode", "speed_mps", "low", "high"),
    [
        (Regime.FULL_TRACTION, 30.0, 0.9, 1.0),  # his own effort: all of it, far below the target
        (Regime.FULL_TRACTION, 20.0, 0.0, 0.2),  # reached: what the resistance takes
        (Regime.CRUISE, 20.0, 0.0, 0.2),
        (Regime.COAST, 10.0, 0.0, 0.0),
        (Regime.FULL_BRAKE, 10.0, -0.6, -0.2),  # the deceleration that he plans with, not all that the brakes can do
        (Regime.FULL_BRAKE, 20.5, -0.1, 0.0),  # reached
    ],
)
def test_a_target_speed_without_effort_is_reached_his_own_way(
    mode: Regime, speed_mps: float, low: float, high: float
) -> None:
    driver = HumanDriver(LINE, QUICK, seed=1)
    seen = AdviceView(
        time_s=0.0, valid_until_s=100.0, presentation=Presentation.SPEED_AND_EFFORT, mode=mode, speed_mps=speed_mps
    )
    values = [driver.command(cab(seen, time_s=0.2 * look)).value for look in range(20)]
    assert low - 1e-9 <= values[-1] <= high + 1e-9
