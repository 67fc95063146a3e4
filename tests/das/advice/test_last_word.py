"""The last word: it replaces what is unsafe in an advice, and leaves a safe advice as it is.

Most tests judge advices made by hand, for a train of 100 t with an electric brake of 60 kN and no other, on a level
line of 10 km with limits of 30, 20 and 30 m/s. The brake gives 0.6 m/s², so that every braking curve has the closed
form v² = u² + 2·0.6·d.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from das.advice.advice import Advice, Cause, Guidance, Instruction, Source
from das.advice.last_word import (
    LIMIT_TOLERANCE_MPS,
    STOP_TOLERANCE_M,
    Act,
    BrakingBasis,
    BrakingModel,
    LastWord,
    Part,
)
from das.advice.reason import Reason, ReasonCode
from das.advice.regimes import FULL_RATIO, Regime
from das.advice.wording import words
from das.cab.leg import Leg
from das.cab.situation import Situation
from das.domain.conditions import Conditions
from das.domain.effort import EffortCurve, EffortEnvelope
from das.domain.files.load import load_route, load_vehicle
from das.domain.restriction import Restriction
from das.domain.route import Zone
from das.domain.units import KMH
from das.domain.vehicle import BrakePolicy, ServiceBrake
from das.estimate.estimate import Estimate
from das.solver.section import build_section
from sim.drivers.kinds import DriverKind, Presentation
from sim.plant.plant import Plant, lever
from sim.world.in_process import InProcess
from sim.world.loop import Tick
from sim.world.loop import World as ClosedLoop
from sim.world.scenario import load_scenario
from sim.world.service import make_day
from tests.support.drawn_day import write_files
from tests.support.driven_node import DrivenNode, S
from tests.support.flat_days import service_for
from tests.support.making import make_route, make_train
from tests.support.raw_witness import RawLine, RawTrain

END_M, HIGH, LOW = 10_000.0, 30.0, 20.0
RATE = 0.6
FULL_N = 60e3
LINE = make_route(END_M, [(0.0, HIGH), (6_000.0, LOW), (7_000.0, HIGH)])
TRAIN = replace(
    make_train(), electric_brake=EffortEnvelope(max_force_n=FULL_N, max_power_w=1e12), friction_brake_force_n=0.0
)
RUBS = replace(TRAIN, friction_brake_force_n=FULL_N)
"""The train with a friction brake of 60 kN that its plans do not use."""
BASIS = BrakingBasis(LINE, TRAIN, BrakePolicy.ELECTRIC, (), Conditions(), 0.0, END_M)
MODEL = BrakingModel(BASIS)
FAST_M, SD_M = 2_000.0, 1.0
"""A place where the train runs at the limit with nothing to brake for, and the standard deviation of its position."""


def curve_mps(way_m: float, to_mps: float = 0.0) -> float:
    """The speed from which full braking reaches `to_mps` over a distance."""
    return math.sqrt(to_mps**2 + 2 * RATE * way_m)


def at(s_m: float, v_mps: float, sd_m: float = SD_M) -> Estimate:
    """A usable estimate of position and speed."""
    return Estimate(
        time_ns=S, fix_time_ns=S, s_m=s_m, speed_mps=v_mps, position_sd_m=sd_m, speed_sd_mps=0.1, problem=None
    )


def advice_of(s_m: float, v_mps: float, mode: Regime, force_n: float, rate_mps2: float = 0.0, **changes: Any) -> Advice:
    """An advice whose horizon slows down with a constant deceleration to a standstill."""
    horizon = tuple(max(v_mps - rate_mps2 * second, 0.0) for second in range(1, 31))
    common: dict[str, Any] = {
        "time_ns": S, "position_time_ns": S, "s_m": s_m, "speed_mps": v_mps, "mode": mode,
        "advised_speed_mps": v_mps, "advised_force_n": force_n, "advised_force_ratio": force_n / 1e5,
        "display_speed_mps": math.floor(v_mps / KMH) * KMH,
        "horizon_speed_mps": horizon, "horizon_force_n": tuple(force_n if v > 0 else 0.0 for v in horizon),
        "next_mode": Regime.STOP, "limit_mps": MODEL.limit_mps(s_m), "source": Source.SOLVED,
        "valid_until_ns": 4 * S, "position_sd_m": SD_M,
    }  # fmt: skip
    return Advice(**{**common, **changes})


BRAKE_M = 6_000.0 - 200.0
BRAKE_MPS = curve_mps(200.0, LOW)
"""A place on the braking curve before the lower limit, and the speed there."""
IN_S = (6_000.0 - (HIGH**2 - LOW**2) / (2 * RATE) - FAST_M) / HIGH
GUIDE_FAST = Guidance(
    now=Instruction(mode=Regime.CRUISE, speed_mps=HIGH),
    following=(
        Instruction(
            mode=Regime.FULL_BRAKE, speed_mps=LOW, effort_ratio=-1.0, way_m=(IN_S - 1.0) * HIGH, in_s=IN_S - 1.0
        ),
        Instruction(mode=Regime.CRUISE, speed_mps=LOW, way_m=4_000.0, in_s=200.0),
    ),
    target_m=IN_S * HIGH,
    target_s=IN_S,
)
GUIDE_BRAKES = Guidance(
    now=Instruction(mode=Regime.FULL_BRAKE, speed_mps=LOW, effort_ratio=-1.0),
    following=(Instruction(mode=Regime.CRUISE, speed_mps=LOW, way_m=200.0, in_s=8.0),),
    target_m=200.0,
    target_s=8.0,
    force_n=-FULL_N,
    reference_force_n=-FULL_N,
)
FAST = advice_of(FAST_M, HIGH, Regime.CRUISE, 0.0, guide=GUIDE_FAST)
"""The train holds the limit, and the guide announces the brake to the next one."""
BRAKES = advice_of(BRAKE_M, BRAKE_MPS, Regime.FULL_BRAKE, -FULL_N, guide=GUIDE_BRAKES)
BRAKES = replace(
    BRAKES,
    horizon_speed_mps=tuple(max(v - RATE * k, LOW) for k, v in enumerate((BRAKE_MPS,) * 31))[1:],
    horizon_force_n=tuple(-FULL_N if BRAKE_MPS - RATE * k > LOW else 0.0 for k in range(1, 31)),
)
"""The train is on the curve before the lower limit, and brakes fully."""


def judged(advice: Advice, here: Estimate | None = None, basis: BrakingBasis = BASIS) -> tuple[Advice, tuple[Act, ...]]:
    return LastWord().judge(advice, here or at(advice.s_m, advice.speed_mps), basis)


@pytest.mark.parametrize("advice", [FAST, BRAKES], ids=["at the limit", "on the curve"])
def test_a_sound_advice_passes_as_it_is(advice: Advice) -> None:
    said, acts = judged(advice)
    assert acts == ()
    assert said is advice


def test_full_traction_at_a_step_of_an_effort_curve_is_a_force_that_the_train_has() -> None:
    """The effort of a diesel train falls by a sixth within 1 km/h where it shifts up."""
    shifts = EffortCurve(speed_mps=(0.0, 51 * KMH, 52 * KMH, 60.0), force_n=(60e3, 60e3, 50e3, 20e3))
    train = replace(TRAIN, traction=EffortEnvelope.of_curve(shifts, 60.0))
    basis = BASIS._replace(vehicle=train)
    for v_mps in np.arange(50 * KMH, 53 * KMH, 0.013).tolist():
        force_n = float(train.traction_effort_n(np.array([v_mps]))[0])
        horizon = {"horizon_speed_mps": tuple(v_mps + 0.3 * k for k in range(1, 31))}
        advice = advice_of(FAST_M, v_mps, Regime.FULL_TRACTION, force_n, **horizon, horizon_force_n=(force_n,) * 30)
        assert judged(advice, basis=basis)[1] == ()
        more = replace(advice, advised_force_n=1.25 * force_n)
        assert [act.part for act in judged(more, basis=basis)[1]] == [Part.EFFORT]


def test_no_advice_is_not_judged() -> None:
    none = Advice(time_ns=S, cause=Cause.POSITION_STALE, reason=Reason.of_text("old"))
    assert judged(none, Estimate(time_ns=S)) == (none, ())


def guided(advice: Advice, **changes: Any) -> dict[str, Any]:
    assert advice.guide is not None
    return {"guide": replace(advice.guide, **changes)}


def followed(*changes: dict[str, Any]) -> dict[str, Any]:
    """`GUIDE_FAST` with its announced instructions changed."""
    known = zip(GUIDE_FAST.following, changes, strict=False)
    return guided(FAST, following=tuple(replace(one, **new) for one, new in known))


FASTER = tuple(HIGH + 2.0 for _ in range(30))
WRONG: dict[str, tuple[Advice, dict[str, Any], Part]] = {
    "traction to a speed above the limit": (
        FAST, {"mode": Regime.FULL_TRACTION, "advised_force_n": 1e5, "horizon_speed_mps": FASTER}, Part.EFFORT
    ),
    "coasting on the curve": (BRAKES, {"mode": Regime.COAST, "advised_force_n": 0.0}, Part.EFFORT),
    "a brake that is too weak": (BRAKES, {"advised_force_n": -10e3, "horizon_force_n": (-10e3,) * 30}, Part.EFFORT),
    "a force that the train does not have": (FAST, {"advised_force_n": -500e3}, Part.EFFORT),
    "traction that the train does not have": (FAST, {"advised_force_n": 150e3}, Part.EFFORT),
    "a force that is no number": (BRAKES, {"advised_force_n": math.nan}, Part.EFFORT),
    "an infinite force": (BRAKES, {"advised_force_n": -math.inf}, Part.EFFORT),
    "an advised speed that is no number": (FAST, {"advised_speed_mps": math.nan}, Part.EFFORT),
    "a horizon without a number": (FAST, {"horizon_speed_mps": (HIGH,) * 20 + (math.nan,) * 10}, Part.EFFORT),
    "no horizon": (FAST, {"horizon_speed_mps": (), "horizon_force_n": ()}, Part.EFFORT),
    "advised speed": (FAST, {"advised_speed_mps": HIGH + 1.0}, Part.ADVISED_SPEED),
    "displayed speed": (FAST, {"display_speed_mps": HIGH + 1.0}, Part.DISPLAY_SPEED),
    "limit": (FAST, {"limit_mps": HIGH + 1.0}, Part.LIMIT),
    "limit that is no number": (FAST, {"limit_mps": math.nan}, Part.LIMIT),
    "horizon": (FAST, {"horizon_speed_mps": (HIGH,) * 20 + (HIGH + 1.0,) * 10}, Part.HORIZON),
    "horizon below 0": (FAST, {"horizon_speed_mps": (HIGH,) * 29 + (-1.0,)}, Part.HORIZON),
    "guide: a speed to hold above the limit": (
        FAST, guided(FAST, now=Instruction(mode=Regime.CRUISE, speed_mps=HIGH + 1.0)), Part.GUIDE
    ),
    "guide: traction": (
        FAST,
        guided(FAST, now=Instruction(mode=Regime.FULL_TRACTION, speed_mps=HIGH + 2.0, effort_ratio=1.0), force_n=1e5),
        Part.GUIDE,
    ),
    "guide: coasting on the curve": (
        BRAKES,
        guided(BRAKES, now=Instruction(mode=Regime.COAST, speed_mps=LOW), force_n=0.0, reference_force_n=0.0),
        Part.GUIDE,
    ),
    "guide: a brake that is due too late": (
        BRAKES, guided(BRAKES, now=replace(GUIDE_BRAKES.now, way_m=66.0, in_s=2.6)), Part.GUIDE
    ),
    "guide: a brake that is too weak": (BRAKES, guided(BRAKES, force_n=-20e3), Part.GUIDE),
    "guide: a reference that brakes too weakly": (BRAKES, guided(BRAKES, reference_force_n=-20e3), Part.GUIDE),
    "guide: a force that the train does not have": (BRAKES, guided(BRAKES, force_n=-200e3), Part.GUIDE),
    "guide: a force that is no number": (BRAKES, guided(BRAKES, reference_force_n=math.nan), Part.GUIDE),
    "guide: a brake to a speed above the next limit": (
        BRAKES, guided(BRAKES, now=replace(GUIDE_BRAKES.now, speed_mps=LOW + 2.0)), Part.GUIDE_SPEED
    ),
    "guide: a speed announced above the limit there": (
        FAST, followed({}, {"speed_mps": LOW + 1.0}), Part.GUIDE_NEXT
    ),
    "guide: an announced time without a number": (FAST, followed({"in_s": math.nan}), Part.GUIDE_NEXT),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_caught_and_what_is_said_instead_is_sound(name: str) -> None:
    advice, changes, part = WRONG[name]
    wrong = replace(advice, **changes)
    said, acts = judged(wrong)
    assert part in {act.part for act in acts}
    assert said != wrong
    assert said.mode is not Regime.NONE
    assert judged(said) == (said, ())
    if part not in (Part.EFFORT, Part.ADVISED_SPEED):
        assert {act.part for act in acts} == {part}
        untouched = (said.mode, said.advised_speed_mps, said.advised_force_n, said.reason, said.source)
        assert untouched == (wrong.mode, wrong.advised_speed_mps, wrong.advised_force_n, wrong.reason, wrong.source)


def test_a_brake_is_as_strong_as_needed_and_the_words_say_for_what() -> None:
    said, (act,) = judged(replace(BRAKES, mode=Regime.COAST, advised_force_n=0.0), at(BRAKE_M, BRAKE_MPS, sd_m=0.0))
    needed_n = 1e5 * (BRAKE_MPS**2 - LOW**2) / (2 * 200.0)
    assert said.advised_force_n == act.instead_n == pytest.approx(-needed_n)
    assert (said.mode, said.source) == (Regime.FULL_BRAKE, Source.FALLBACK)
    assert words(said.reason) == "72 km/h from km 6.0"
    assert said.advised_force_ratio == pytest.approx(-needed_n / FULL_N)
    assert list(said.horizon_speed_mps) == sorted(said.horizon_speed_mps, reverse=True)
    assert said.horizon_speed_mps[-1] == pytest.approx(LOW)
    assert said.horizon_speed_mps[2] == pytest.approx(BRAKE_MPS - 3 * needed_n / 1e5, abs=0.05)


def test_the_words_of_a_brake_name_the_stop_or_say_by_how_much_the_train_is_too_fast() -> None:
    stops, (act, *_) = judged(advice_of(END_M - 300.0, curve_mps(300.0), Regime.COAST, 0.0))
    assert act.part is Part.EFFORT
    assert stops.reason == Reason(code=ReasonCode.STOP, stop=LINE.stop_name_at(END_M))
    fast, _ = judged(advice_of(FAST_M, HIGH + 5.0, Regime.COAST, 0.0))
    assert fast.reason == Reason(code=ReasonCode.TOO_FAST, speed_mps=5.0)


def test_friction_brakes_where_the_electric_brake_is_not_enough_even_if_plans_exclude_it() -> None:
    """100 m before the lower limit 0.9 m/s² are needed; the electric brake gives 0.6, both give 1.2."""
    v_mps = math.sqrt(LOW**2 + 2 * 0.9 * 100.0)
    wrong = advice_of(6_000.0 - 100.0, v_mps, Regime.COAST, 0.0)
    basis = BASIS._replace(vehicle=RUBS)
    said, acts = judged(wrong, at(wrong.s_m, v_mps, sd_m=0.0), basis=basis)
    assert {act.part for act in acts} >= {Part.EFFORT}
    assert said.mode is Regime.FRICTION_BRAKE
    assert said.advised_force_n == pytest.approx(-0.9e5)


@pytest.mark.parametrize(
    ("electric_n", "friction_n", "beyond_m"), [(FULL_N, FULL_N, STOP_TOLERANCE_M), (20e3, 55e3, 25.0)]
)
def test_friction_that_plans_exclude_counts_up_to_the_service_deceleration(
    electric_n: float, friction_n: float, beyond_m: float
) -> None:
    """It builds up in seconds: who brakes fully from the bound stops in time if both brakes together give 1.2 m/s²,
    and up to 25 m too far if they give 0.75, hardly more than the service deceleration of 0.7."""
    electric = EffortEnvelope(max_force_n=electric_n, max_power_w=1e12)
    train = replace(RUBS, electric_brake=electric, friction_brake_force_n=friction_n)
    train = replace(train, service_brake=ServiceBrake(deceleration_mps2=0.7))
    model = BrakingModel(BASIS._replace(vehicle=train))
    assert model.allowed_mps(END_M - 200.0) == pytest.approx(math.sqrt(2 * 0.7 * 200.0), abs=1e-3)
    for way_m in (50.0, 100.0, 200.0, 500.0):
        plant = Plant(make_route(END_M, [(0.0, HIGH)]), train)
        state = plant.at(END_M - way_m, model.bound_mps(END_M - way_m))
        while state.speed_mps > 0.0:
            state = plant.advance(state, lever(-1.0), plant.step_s)
        assert state.s_m < END_M + beyond_m


def test_a_full_brake_passes_where_the_train_is_too_fast_and_a_weaker_one_does_not() -> None:
    v_mps = BRAKE_MPS + 3.0
    shown = {"advised_speed_mps": BRAKE_MPS, "display_speed_mps": LOW, "guide": None}
    full = replace(BRAKES, speed_mps=v_mps, **shown)
    assert judged(full)[1] == ()
    weak_n = -0.9 * FULL_RATIO * FULL_N
    weak = replace(full, advised_force_n=weak_n, horizon_force_n=(weak_n,) * 30)
    assert [act.part for act in judged(weak)[1]] == [Part.EFFORT]


def test_a_train_hardly_above_the_limit_may_be_told_to_hold_it_and_one_far_above_must_brake() -> None:
    def parts(excess_mps: float) -> list[Part]:
        held = replace(FAST, speed_mps=HIGH + excess_mps, guide=None)
        return [act.part for act in judged(held)[1]]

    assert parts(0.9) == []
    assert parts(1.2) == [Part.EFFORT]


def test_the_train_may_be_two_deviations_ahead_but_sees_the_mark() -> None:
    way_m = 300.0
    advice = advice_of(END_M - way_m, curve_mps(way_m), Regime.FULL_BRAKE, -FULL_N, RATE)
    assert judged(advice)[1] == ()
    early, _ = judged(advice, at(advice.s_m, advice.speed_mps, sd_m=30.0))
    assert early.advised_speed_mps == pytest.approx(curve_mps(way_m - 60.0), abs=0.01)
    # In the last metres the driver finds the mark by eye, however uncertain the position is.
    near = advice_of(END_M - 8.0, curve_mps(8.0), Regime.FULL_BRAKE, -FULL_N, RATE)
    assert judged(near, at(near.s_m, near.speed_mps, sd_m=30.0))[1] == ()


def test_the_limit_shown_may_be_that_of_any_place_where_the_train_may_be() -> None:
    """A higher limit begins 7 m ahead of the estimated position, or has ended some metres behind it."""
    for s_m, sd_m, parts in (
        (6_993.0, 4.0, []), (6_993.0, 1.0, [Part.LIMIT]), (6_002.5, 1.0, []), (6_005.0, 1.0, [Part.LIMIT]),
    ):  # fmt: skip
        shown = advice_of(s_m, LOW, Regime.CRUISE, 0.0, limit_mps=HIGH)
        assert [act.part for act in judged(shown, at(s_m, LOW, sd_m=sd_m))[1]] == parts


def test_a_brake_announced_too_late_is_left_out_with_what_comes_after_it() -> None:
    s_m = 5_400.0  # The brake is due at 5 583 m.
    late = replace(GUIDE_FAST.following[0], way_m=270.0, in_s=9.0)
    in_time = replace(late, way_m=175.0, in_s=175.0 / HIGH)
    for one, kept in ((late, 0), (in_time, 2)):
        guide = replace(GUIDE_FAST, following=(one, replace(GUIDE_FAST.following[1], way_m=700.0)))
        horizon = tuple(HIGH if k < 6 else HIGH - RATE * (k - 5) for k in range(30))
        said, acts = judged(
            advice_of(s_m, HIGH, Regime.CRUISE, 0.0, guide=guide, horizon_speed_mps=horizon[:20] + (LOW,) * 10)
        )
        assert said.guide is not None
        assert [act.part for act in acts] == [Part.GUIDE_NEXT] * (kept == 0)
        assert len(said.guide.following) == kept


def test_a_driver_who_rolls_up_to_a_speed_is_expected_to_hold_it_until_the_announced_brake() -> None:
    """On -30 per mille he would be 1 m/s above the limit when the brake is due, if nobody told him to hold it."""
    basis, v_mps = BASIS._replace(route=make_route(END_M, [(0.0, HIGH), (6_000.0, LOW)], [(0.0, -0.03)])), HIGH - 1.0
    coasts = Instruction(mode=Regime.COAST, speed_mps=HIGH, effort_ratio=0.0)
    for way_m, in_s, kept in ((205.0, 7.0, True), (350.0, 12.0, False)):
        brake = replace(GUIDE_FAST.following[0], way_m=way_m, in_s=in_s)
        guide = replace(GUIDE_FAST, now=coasts, following=(brake,), target_m=way_m)
        advice = advice_of(
            4_960.0, v_mps, Regime.CRUISE, 0.0, guide=guide, horizon_speed_mps=(v_mps,) * 5 + (LOW,) * 25
        )
        said, acts = judged(advice, basis=basis)
        assert said.guide is not None
        assert bool(said.guide.following) is kept
        assert (Part.GUIDE_NEXT in {act.part for act in acts}) is not kept


def test_a_train_downhill_is_not_told_to_coast_above_the_limit() -> None:
    steep = make_route(END_M, [(0.0, HIGH)], [(0.0, -0.03)])
    basis = BASIS._replace(route=steep)
    coasts = advice_of(FAST_M, HIGH, Regime.COAST, 0.0)
    said, acts = judged(coasts, basis=basis)
    assert [act.part for act in acts] == [Part.EFFORT]
    # The brake at least balances the slope.
    assert said.mode is Regime.REDUCED_BRAKE
    assert said.advised_force_n <= -0.03 * 9.80665 * 1e5


STATION = BASIS._replace(route=make_route(END_M, [(0.0, HIGH), (END_M - 120.0, 8.0)]))
"""A line with a limit of 8 m/s from 120 m before its end."""


def test_a_driver_who_brakes_by_eye_to_the_mark_is_told_of_the_limit_before_it() -> None:
    """He brakes evenly to the mark, and would pass the board, 60 m ahead, at 9.4 m/s."""
    s_m, v_mps = END_M - 180.0, 11.5
    eye = Instruction(mode=Regime.REDUCED_BRAKE, speed_mps=0.0)
    guide = Guidance(now=eye, target_m=180.0, force_n=-FULL_N, reference_force_n=-FULL_N, lever_ratio=math.nan)
    wrong = advice_of(s_m, v_mps, Regime.FULL_BRAKE, -FULL_N, RATE, guide=guide)
    said, (act,) = judged(wrong, basis=STATION)
    assert act.part is Part.GUIDE
    assert said.guide is not None
    assert (said.guide.now.speed_mps, said.guide.target_m) == (pytest.approx(28 * KMH), pytest.approx(60.0, abs=0.01))
    assert said.guide.now.effort_ratio == pytest.approx(said.guide.force_n / FULL_N)
    assert said.guide.lever_ratio == pytest.approx(said.guide.force_n / FULL_N)
    assert judged(said, basis=STATION)[1] == ()
    behind = replace(wrong, guide=replace(guide, force_n=-40e3, reference_force_n=-40e3))
    assert judged(behind, at(s_m, 6.0), basis=STATION)[1] == (), "a slower train has nothing but the mark before it"


def test_only_what_is_announced_goes_where_the_present_instruction_is_safe() -> None:
    """Traction announced for now, 100 m before a lower limit, to a train that rightly holds its speed."""
    now = Instruction(mode=Regime.CRUISE, speed_mps=LOW)
    soon = Instruction(mode=Regime.FULL_TRACTION, speed_mps=HIGH, effort_ratio=1.0, way_m=10.0, in_s=0.5)
    guide = Guidance(now=now, following=(soon,), target_m=10.0)
    held, (act,) = judged(advice_of(5_950.0, LOW, Regime.CRUISE, 0.0, guide=guide))
    assert act.part is Part.GUIDE
    assert held.guide == replace(guide, following=())


def test_a_train_that_would_only_become_too_fast_is_told_to_hold_and_not_to_brake_for_a_far_stop() -> None:
    """At its limit, 8 km before the stop, down a hill: no coasting, but no brake to a standstill either."""
    downhill = BASIS._replace(route=make_route(END_M, [(0.0, HIGH)], grades=[(0.0, -0.03)]))
    coasts = Instruction(mode=Regime.COAST, speed_mps=HIGH, effort_ratio=0.0)
    advice = advice_of(FAST_M, HIGH + 0.3, Regime.CRUISE, 0.0, guide=Guidance(now=coasts, target_m=500.0))
    said, acts = judged(advice, basis=downhill)
    assert Part.GUIDE in {act.part for act in acts}
    assert said.guide is not None
    assert (said.guide.now.mode, said.guide.now.speed_mps) == (Regime.CRUISE, pytest.approx(HIGH))
    assert math.isnan(said.guide.lever_ratio)


def test_a_train_that_stands_is_left_in_peace() -> None:
    stands = advice_of(END_M - 3.0, 0.0, Regime.STOP, 0.0)
    assert judged(stands)[1] == ()
    assert judged(replace(stands, s_m=END_M + 20.0), at(END_M + 20.0, 0.0))[1] == ()


def test_nothing_is_safe_where_position_or_speed_are_no_numbers() -> None:
    for here in (at(math.nan, HIGH), at(FAST_M, math.nan), at(FAST_M, HIGH, sd_m=math.nan)):
        said, (act,) = judged(FAST, here)
        assert (said.mode, said.cause, act.part) == (Regime.NONE, Cause.POSITION_REJECTED, Part.STATE)
        assert said.reason


# --- the model ------------------------------------------------------------------------------------------------------


def test_the_curve_has_its_closed_form_and_its_tolerances() -> None:
    for way_m in (1.0, 20.0, 150.0, 400.0):
        assert MODEL.allowed_mps(END_M - way_m) == pytest.approx(curve_mps(way_m), abs=1e-3)
        assert MODEL.bound_mps(END_M - way_m) == pytest.approx(curve_mps(way_m + STOP_TOLERANCE_M), abs=1e-3)
        assert MODEL.allowed_mps(6_000.0 - way_m) == pytest.approx(min(curve_mps(way_m, LOW), HIGH), abs=1e-3)
        above = min(curve_mps(way_m, LOW + LIMIT_TOLERANCE_MPS), HIGH + LIMIT_TOLERANCE_MPS)
        assert MODEL.bound_mps(6_000.0 - way_m) == pytest.approx(above, abs=1e-3)
    assert MODEL.bound_mps(END_M + STOP_TOLERANCE_M) == 0.0
    assert (2 * STOP_TOLERANCE_M, 2 * LIMIT_TOLERANCE_MPS) == (10.0, 1.0), "half of what is promised"


def test_where_the_line_takes_no_electric_brake_only_friction_slows_the_train() -> None:
    zone = replace(LINE, no_regeneration=(Zone(start_m=5_700.0, length_m=200.0),))
    electric = BrakingModel(BASIS._replace(route=zone))
    assert electric.allowed_mps(5_700.0) == pytest.approx(curve_mps(100.0, LOW), abs=1e-3)
    blended = replace(RUBS, brake_policy=BrakePolicy.BLENDED)
    both = BrakingModel(BASIS._replace(route=zone, vehicle=blended, brakes=BrakePolicy.BLENDED))
    assert both.allowed_mps(5_700.0) == pytest.approx(math.sqrt(LOW**2 + 2 * (0.6 * 200.0 + 1.2 * 100.0)), abs=1e-3)


def test_a_train_found_light_is_not_trusted_to_brake_better() -> None:
    light = BrakingModel(BASIS._replace(conditions=Conditions(mass_ratio=0.8, resistance_ratio=1.5)))
    heavy = BrakingModel(BASIS._replace(conditions=Conditions(mass_ratio=1.2)))
    assert light.allowed_mps(BRAKE_M) == MODEL.allowed_mps(BRAKE_M)
    assert heavy.allowed_mps(BRAKE_M) == pytest.approx(math.sqrt(LOW**2 + 2 * RATE / 1.2 * 200.0), abs=1e-3)


def test_a_restriction_counts_at_once_and_until_the_tail_has_left_it() -> None:
    long = replace(TRAIN, train_length_m=150.0)
    one = Restriction(start_m=3_000.0, end_m=3_400.0, limit_mps=10.0)
    model = BrakingModel(BASIS._replace(vehicle=long, restrictions=(one,)))
    limits = [model.limit_mps(s_m) for s_m in (2_999.0, 3_001.0, 3_549.0, 3_551.0)]
    assert limits == [HIGH, 10.0, 10.0, HIGH]
    word = LastWord()
    assert word.judge(FAST, at(FAST_M, HIGH), BASIS)[1] == ()
    told = BASIS._replace(restrictions=(replace(one, start_m=2_050.0),))
    assert Part.EFFORT in {act.part for act in word.judge(FAST, at(FAST_M, HIGH), told)[1]}


@pytest.mark.parametrize("number", range(6))
def test_it_agrees_with_a_witness_that_reads_the_files(number: int, tmp_path: Path) -> None:
    """On random lines with gradients, limits and restrictions; the independent check computes in steps of 1 m."""
    route_file, vehicle_file = write_files(tmp_path, number, blended=number % 2 == 1)
    route, vehicle, random = load_route(str(route_file)), load_vehicle(str(vehicle_file)), np.random.default_rng(number)
    if vehicle.brake_policy is BrakePolicy.ELECTRIC:  # The witness does not count a friction brake that plans exclude.
        vehicle = replace(vehicle, friction_brake_force_n=0.0)
    raw = RawLine(route_file, RawTrain.read(vehicle_file))
    starts = random.uniform(0.0, route.length_m, 3)
    places = tuple((x, x + float(random.uniform(50, 900)), float(random.uniform(6, 30))) for x in starts.tolist())
    restrictions = tuple(Restriction(start_m=a, end_m=b, limit_mps=c) for a, b, c in places)
    for start, end in zip(route.stops, route.stops[1:], strict=False):
        brakes = vehicle.brakes_at(vehicle.default_level)
        basis = BrakingBasis(route, vehicle, brakes, restrictions, Conditions(), start.position_m, end.position_m)
        model, witness = BrakingModel(basis), raw.allowed(places, end.position_m)
        for s_m in random.uniform(start.position_m + 5.0, end.position_m - 5.0, 400).tolist():
            lowest = min(witness.curve(s_m + x, s_m + x) for x in (-2.0, -1.0, 0.0, 1.0, 2.0))
            assert lowest - 0.15 <= model.allowed_mps(s_m) <= witness.curve(s_m - 2.0, s_m + 2.0) + 0.15
            assert model.limit_mps(s_m) <= witness.limit(s_m - 2.0, s_m + 2.0) + 1e-9


def test_it_agrees_with_the_envelope_of_the_solver() -> None:
    route, vehicle = load_route("zurich-luzern"), replace(load_vehicle("re460-ic"), brake_policy=BrakePolicy.BLENDED)
    restrictions = (Restriction(start_m=8_000.0, end_m=9_000.0, limit_mps=15.0),)
    for start, end in zip(route.stops, route.stops[1:], strict=False):
        a, b = start.position_m, end.position_m
        section = Situation(route=route, vehicle=vehicle, restrictions=restrictions).section(a, b)
        model = BrakingModel(BrakingBasis(route, vehicle, section.brakes, restrictions, Conditions(), a, b))
        found = np.array([model.allowed_mps(s_m) for s_m in section.node_m.tolist()])
        rises = np.append(np.diff(section.limit_mps, prepend=section.limit_mps[0]) > 0, False)
        # Exactly where the limit rises, the solver's envelope has the lower limit, and this model the higher one.
        assert np.abs(found - section.allowed_mps)[~rises].max() < 0.03


def test_a_section_that_a_run_of_the_solver_drives_is_never_above_the_bound() -> None:
    section = build_section(LINE, TRAIN)
    for s_m, v_mps in zip(section.node_m.tolist(), section.fastest_run.speed_mps.tolist(), strict=True):
        assert v_mps <= MODEL.bound_mps(s_m) + 1e-6


# --- in the cab -----------------------------------------------------------------------------------------------------


def wrong_from_now_on(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
    """Change the advice of every leg from now on."""
    advise = Leg.advise
    monkeypatch.setattr(Leg, "advise", lambda leg, here: replace(advise(leg, here), **changes))


def test_the_cab_says_it_once_counts_it_every_time_and_sends_what_is_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    driven = DrivenNode()
    sound = driven.tick(50)
    assert sound.replaced_parts == 0
    wrong_from_now_on(monkeypatch, display_speed_mps=80.0)
    for second in range(51, 56):
        advice = driven.tick(second)
        assert advice.display_speed_mps <= advice.limit_mps
        assert advice.replaced_parts == 1
    assert sound.limit_mps == advice.limit_mps
    said = [line for line in driven.sink.events().splitlines() if line.startswith("last word: ")]
    assert said == [
        "last word: displayed speed: 288.0 km/h where 161.8 km/h is the most; 160.0 km/h is advised instead",
    ]


def test_a_failing_last_word_withdraws_the_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    driven = DrivenNode()
    assert driven.tick(50).cause == Cause.NONE

    def fails(*_: object) -> None:
        raise RuntimeError("no word")

    monkeypatch.setattr(LastWord, "judge", fails)
    withdrawn = driven.tick(51)
    assert (withdrawn.mode, withdrawn.cause) == (Regime.NONE, Cause.INTERNAL_ERROR)
    assert "no word" in withdrawn.reason.text
    monkeypatch.undo()
    assert driven.tick(52).cause == Cause.NONE

    def interrupted(*_: object) -> None:
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr(LastWord, "judge", interrupted)
    with pytest.raises(KeyboardInterrupt):  # Ctrl-C in compiled code is no failure.
        driven.tick(53)


def test_a_force_that_is_no_number_does_not_leave_the_cab(monkeypatch: pytest.MonkeyPatch) -> None:
    driven = DrivenNode()
    wrong_from_now_on(monkeypatch, advised_force_n=math.nan)
    replaced = driven.tick(50)
    assert math.isfinite(replaced.advised_force_n)
    assert replaced.mode != Regime.NONE


class Counted(InProcess):
    """A link that counts the parts of the advice that the last word replaced."""

    replaced = 0

    def exchange(self, tick: Tick) -> Advice:
        advice = super().exchange(tick)
        self.replaced += advice.replaced_parts
        return advice


@pytest.mark.slow
def test_the_full_advice_of_an_ordinary_day_passes_as_it_is() -> None:
    """The clear day with the perfect driver: nothing is replaced."""
    day = make_day(service_for(load_scenario("clear-day")), 0)
    link = Counted(day.service)
    ClosedLoop(day, day.driver(DriverKind.PERFECT), Presentation.SPEED_AND_EFFORT, link).run()
    assert link.replaced == 0
