"""The judge of the assessment finds every fault that is put into an advice, and none in a sound one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from das.advice.advice import Advice, Guidance, Instruction
from das.advice.regimes import Regime
from das.domain.files.load import load_route, load_vehicle
from sim.drivers.kinds import Presentation
from sim.drivers.knowledge import LineKnowledge
from sim.plant.kernels import PlantState
from sim.plant.plant import COAST
from tests.support.advice_judge import DayJudge, Judge
from tests.support.assessed_day import Seen, Stood
from tests.support.drawn_day import Drawn, Sensors, Style, Upset, draw, write_files
from tests.support.obedient_drivers import ObedientDriver, Scene

AT_M, STOP_M = 1500.0, 2000.0
SPEED_MPS = 10.0


@pytest.fixture(scope="module")
def judge(tmp_path_factory: pytest.TempPathFactory) -> Judge:
    return Judge(*write_files(tmp_path_factory.mktemp("files"), 0, blended=False))


def guided() -> Drawn:
    return replace(draw(0), presentation=Presentation.GUIDE, style=Style.FORCE, sensors=Sensors())


def sound() -> Seen:
    """A train at a moderate speed that is told to hold it, far enough from its stop."""
    hold = Instruction(mode=Regime.CRUISE, speed_mps=SPEED_MPS)
    brake = Instruction(mode=Regime.REDUCED_BRAKE, speed_mps=0.0, effort_ratio=-0.5, way_m=300.0, in_s=30.0)
    guide = Guidance(now=hold, following=(brake,), target_m=300.0, force_n=10e3, reference_force_n=10e3)
    advice = Advice(
        time_ns=1,
        s_m=AT_M,
        speed_mps=SPEED_MPS,
        mode=Regime.CRUISE,
        advised_speed_mps=SPEED_MPS,
        advised_force_n=10e3,
        horizon_speed_mps=(SPEED_MPS,) * 20,
        display_speed_mps=SPEED_MPS,
        limit_mps=SPEED_MPS,
        position_sd_m=1.0,
        guide=guide,
    )
    state = PlantState(0.0, AT_M, SPEED_MPS)
    return Seen(second=0, state=state, places=(), stop_m=STOP_M, advice=advice, obeyed=True)


def changed(**values: object) -> Callable[[Advice], Advice]:
    return lambda advice: replace(advice, **values)  # type: ignore[arg-type]


def guide_changed(**values: object) -> Callable[[Advice], Advice]:
    return lambda advice: replace(advice, guide=replace(advice.guide, **values))  # type: ignore[arg-type,type-var]


def kinds(judge: Judge, seen: Seen, drawn: Drawn | None = None) -> set[str]:
    return {one.kind for one in DayJudge(judge, drawn or guided()).problems(seen)}


def test_a_sound_advice_has_no_problem(judge: Judge) -> None:
    assert kinds(judge, sound()) == set()


FAULTS = {
    "advised": changed(advised_speed_mps=60.0),
    "displayed": changed(display_speed_mps=60.0),
    "limit": changed(limit_mps=60.0),
    "horizon": changed(horizon_speed_mps=(SPEED_MPS,) * 60),
    "force": changed(advised_force_n=-900e3),
    "guide-force": guide_changed(force_n=400e3),
    "guide-reference-force": guide_changed(reference_force_n=-900e3),
    "guide-held-force": guide_changed(reference_force_n=900e3),
    "guide-speed": guide_changed(now=Instruction(mode=Regime.CRUISE, speed_mps=60.0)),
    "guide-speed-limit": guide_changed(
        now=Instruction(mode=Regime.FULL_TRACTION, speed_mps=60.0, effort_ratio=1.0), target_m=300.0
    ),
    "guide-effort": guide_changed(now=Instruction(mode=Regime.REDUCED_BRAKE, speed_mps=5.0, effort_ratio=0.5)),
    "guide-announced": guide_changed(following=(Instruction(mode=Regime.CRUISE, speed_mps=60.0, way_m=200.0),)),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_in_one_part_of_an_advice_is_found(judge: Judge, kind: str) -> None:
    seen = sound()
    seen.advice = FAULTS[kind](seen.advice)
    if kind == "guide-held-force":
        seen.state = seen.state._replace(s_m=STOP_M - 100.0)
        seen.advice = replace(seen.advice, s_m=STOP_M - 100.0)
    assert kind in kinds(judge, seen)


def test_a_card_that_cannot_be_braked_away_is_found(judge: Judge) -> None:
    of_day, seen = DayJudge(judge, guided()), sound()
    assert list(of_day.problems(seen)) == []  # What is told in the first second may come too late, so it excuses.
    seen.state = seen.state._replace(s_m=STOP_M - 62.0)
    assert {"guide-held-card", "guide-held-force"} <= {one.kind for one in of_day.problems(seen)}


@pytest.mark.parametrize(("limit_mps", "found"), [(4.0, True), (7.0, False)])
def test_a_limit_that_a_stop_by_eye_hides_is_found(judge: Judge, limit_mps: float, found: bool) -> None:
    """Told to stop in 200 m at 10 m/s, without an effort: a steady brake has 7.1 m/s at a board 100 m on."""
    of_day, seen = DayJudge(judge, guided()), sound()
    seen.places = ((STOP_M - 100.0, STOP_M + 500.0, limit_mps),)
    assert list(of_day.problems(seen)) == []
    seen.state = seen.state._replace(s_m=STOP_M - 200.0)
    by_eye = Instruction(mode=Regime.REDUCED_BRAKE, speed_mps=0.0, effort_ratio=math.nan)
    seen.advice = guide_changed(now=by_eye, following=(), target_m=200.0)(replace(seen.advice, s_m=STOP_M - 200.0))
    assert ("guide-by-eye" in {one.kind for one in of_day.problems(seen)}) is found


@pytest.mark.parametrize("style", [Style.EFFORT, Style.SPEED])
@pytest.mark.parametrize("to_mps", [5.0, 20.0])
def test_an_obedient_driver_coasts_when_he_is_told_to(
    judge: Judge, tmp_path: Path, style: Style, to_mps: float
) -> None:
    route, vehicle = write_files(tmp_path, 0, blended=False)
    line = LineKnowledge(route=load_route(str(route)), vehicle=load_vehicle(str(vehicle)))
    driver, advice = ObedientDriver(line, judge.line, Presentation.GUIDE, style, 0.0), sound().advice
    advice = guide_changed(now=Instruction(mode=Regime.COAST, speed_mps=to_mps, effort_ratio=0.0))(advice)
    scene = Scene(PlantState(0.0, AT_M, SPEED_MPS), -60.0, STOP_M, lambda: pytest.fail("he looked out"), advice)
    assert driver.command(scene) == COAST


def test_a_train_that_is_too_fast_by_obeying_is_found_unless_it_was_told_too_late(judge: Judge) -> None:
    of_day, seen = DayJudge(judge, guided()), sound()
    assert list(of_day.problems(seen)) == []
    seen.state = seen.state._replace(s_m=STOP_M - 20.0)
    assert "too-fast-by-obeying" in {one.kind for one in of_day.problems(seen)}
    late = DayJudge(judge, guided())
    assert list(late.problems(sound())) == []
    seen.places = ((AT_M + 5.0, AT_M + 900.0, 2.0),)
    seen.state = seen.state._replace(s_m=AT_M + 1.0)  # Nobody brakes from 10 to 2 m/s within 4 m.
    seen.advice = replace(seen.advice, s_m=AT_M + 1.0)
    assert "too-fast-by-obeying" not in {one.kind for one in late.problems(seen)}
    seen.state = seen.state._replace(s_m=AT_M + 200.0)  # By now everybody has.
    seen.advice = replace(seen.advice, s_m=AT_M + 200.0)
    assert "too-fast-by-obeying" in {one.kind for one in late.problems(seen)}


def test_a_stop_that_is_missed_is_found_on_both_sides(judge: Judge) -> None:
    of_day = DayJudge(judge, guided())
    assert of_day.stood(Stood(second=1, s_m=STOP_M + 9.0, stop_m=STOP_M)) is None
    found = [of_day.stood(Stood(second=1, s_m=STOP_M + by_m, stop_m=STOP_M)) for by_m in (11.0, -11.0)]
    assert [one.kind for one in found if one is not None] == ["beyond-stop", "short-of-stop"]


def test_what_a_lying_sensor_makes_the_cab_believe_is_not_judged(judge: Judge) -> None:
    seen = sound()
    seen.advice = replace(seen.advice, s_m=AT_M - 300.0, advised_speed_mps=60.0)
    lying = Sensors(upset=Upset.JUMP, upset_s=(0.0, 10.0), upset_by=-300.0)
    assert kinds(judge, seen, replace(guided(), sensors=lying)) == set()
    short = replace(lying, upset_s=(0.0, 1.0))
    assert "advised" in kinds(judge, seen, replace(guided(), sensors=short))


def test_the_witness_brakes_no_train_faster_than_its_forces(judge: Judge, tmp_path: Path) -> None:
    """By hand: v² = 2·s·F/m on the level, with the running resistance at half the speed."""
    line, train = judge.line, judge.line.train
    fastest, stands_m = line.unavoidable(AT_M, SPEED_MPS, 0.0)
    rate = (train.brake_n + line.held_n(AT_M, 0.5 * SPEED_MPS)) / train.inertial_kg
    by_hand_m = AT_M + 3.0 * SPEED_MPS + SPEED_MPS**2 / (2.0 * rate) + 0.5 * 1.2 * SPEED_MPS
    assert stands_m == pytest.approx(by_hand_m, abs=3.0)
    assert fastest[int(AT_M) + 20] == pytest.approx(SPEED_MPS)
    assert fastest[int(stands_m) + 2] == 0.0
