"""The measures of the coach's grammar, on advice made second by second."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from das.advice.advice import Advice, Cause, Coaching, Instruction, Replan
from das.advice.regimes import Regime
from das.domain.units import KMH, NS
from sim.drive.instructions import InstructionFigures, InstructionWatch, RelianceFigures

T, H, C, B = Regime.FULL_TRACTION, Regime.CRUISE, Regime.COAST, Regime.REDUCED_BRAKE
EFFORTS = {T: 1.0, H: math.nan, C: 0.0, B: -0.6}


def told(mode: Regime, kmh: float, in_s: float = 0.0) -> Instruction:
    return Instruction(mode=mode, speed_mps=kmh * KMH, effort_ratio=EFFORTS[mode], in_s=in_s)


def found(
    *spells: tuple[Instruction, int, float], announce: bool = True, replan_s: int = -1, force_n: float = 0.0
) -> InstructionFigures:
    """The figures of instructions that stand for a number of seconds at a speed (km/h); each announces the next."""
    watch, now_s, s_m = InstructionWatch(), 100, 0.0
    for k, (one, lasts_s, kmh) in enumerate(spells):
        for left_s in range(lasts_s, 0, -1):
            after = [replace(spells[k + 1][0], in_s=float(left_s))] if announce and k + 1 < len(spells) else []
            due = replace(one, in_s=max(one.in_s - (lasts_s - left_s), 0.0))
            coach = Coaching(now=due, following=tuple(after), replan=Replan(time_ns=round(replan_s / NS)))
            s_m += kmh * KMH
            advice = Advice(
                time_ns=round(now_s / NS),
                mode=one.mode,
                s_m=s_m,
                speed_mps=kmh * KMH,
                limit_mps=200.0 * KMH,
                coach=coach,
            )
            watch.look(advice, force_n)
            now_s += 1
    return watch.found


def test_a_change_announced_8_s_before_counts_and_another_does_not() -> None:
    calm = found((told(H, 100), 20, 100.0), (told(C, 80), 20, 90.0))
    assert (calm.instructions, calm.changes, calm.announced) == (2, 1, 1)
    late = found((told(H, 100), 20, 100.0), (told(C, 80), 20, 90.0), announce=False)
    assert (late.changes, late.announced) == (1, 0)
    short = found((told(H, 100), 7, 100.0), (told(C, 80), 20, 90.0))
    assert (short.announced, short.shortest_s) == (0, 7.0)
    # It is shown 5 s before it is due, and was first announced 12 s before.
    early = found((told(H, 100), 7, 100.0), (told(C, 80, in_s=5.0), 20, 90.0))
    assert early.announced == 1


def test_the_speed_that_an_instruction_leads_to_needs_no_announcement() -> None:
    own = found((told(T, 100), 20, 90.0), (told(H, 100), 20, 100.0), announce=False)
    assert (own.changes, own.announced) == (1, 1)
    other = found((told(T, 100), 20, 90.0), (told(H, 80), 20, 100.0), announce=False)
    assert (other.changes, other.announced) == (1, 0)


def test_a_brake_is_led_if_it_is_shown_2_s_before_it_is_due() -> None:
    led = found((told(H, 100), 20, 100.0), (told(B, 60, in_s=2.5), 20, 90.0))
    late = found((told(H, 100), 20, 100.0), (told(B, 60, in_s=1.0), 20, 90.0))
    assert (led.brakes, led.led, late.brakes, late.led) == (1, 1, 1, 0)
    assert led.as_dict()["brakes_led_ratio"] == 1.0


def test_coasting_must_end_near_its_speed_unless_its_reference_ended() -> None:
    spells = (told(C, 60), 20, 100.0), (told(H, 100), 20, 95.0)
    assert found(*spells).missed_coasts == 1
    assert found(*spells, replan_s=110).missed_coasts == 0
    assert found((told(C, 90), 20, 100.0), (told(H, 90), 20, 91.0)).missed_coasts == 0
    assert found(*spells, force_n=5e4).missed_coasts == 0, "its driver did not coast"
    assert found((told(C, 60), 20, 100.0), (told(B, 80), 20, 95.0)).missed_coasts == 0, "a limit interrupts it"


def test_an_acceleration_that_gains_nothing_before_a_brake_is_vain() -> None:
    vain = found((told(T, 100), 20, 90.0), (told(B, 60), 20, 90.0))
    assert vain.vain_accelerations == 1
    long = found((told(T, 100), 40, 90.0), (told(B, 60), 20, 90.0))
    assert long.vain_accelerations == 0


def test_speeds_are_steps_of_5_or_limits_and_a_standing_train_is_not_told_to_accelerate() -> None:
    assert found((told(H, 87), 9, 87.0)).odd_speeds == 1
    assert found((told(H, 85), 9, 87.0)).odd_speeds == 0
    assert found((told(H, 200), 9, 87.0)).odd_speeds == 0
    standing = found((told(T, 40), 9, 0.0))
    assert (standing.standing_s, standing.instructions) == (9, 0)
    assert standing.against_grammar == 9


def test_an_announced_change_that_comes_is_kept_and_another_is_not() -> None:
    kept = found((told(H, 100), 20, 100.0), (told(C, 80), 20, 90.0))
    assert (kept.reliance.promised, kept.reliance.kept) == (1, 1)
    # Coasting is announced for 20 s from now, and never comes.
    broken = found((told(H, 100), 20, 100.0), (told(C, 80), 0, 90.0), (told(H, 100), 40, 100.0))
    assert (broken.reliance.promised, broken.reliance.kept) == (1, 0)


@pytest.mark.parametrize(("force_n", "over_s"), [(0.0, 15), (5e4, 0)])
def test_a_train_above_the_limit_counts_only_if_its_driver_does_what_is_shown(force_n: float, over_s: int) -> None:
    assert found((told(C, 80), 20, 210.0), force_n=force_n).reliance.above_limit_s == over_s


def test_seconds_without_advice_are_silent_unless_the_driver_acts_on_what_it_cannot_know() -> None:
    watch = InstructionWatch()
    for second, cause in enumerate((Cause.NONE, Cause.NO_PLAN, Cause.DRIVER_BRAKES, Cause.NONE)):
        mode = Regime.NONE if cause else Regime.CRUISE
        late_s = 2 if second == 3 else 0  # Two messages are lost.
        advice = Advice(time_ns=round((second + late_s) / NS), mode=mode, cause=cause, replaced_parts=second)
        watch.look(advice, 0.0)
    assert watch.found.reliance == RelianceFigures(advised_s=2, silent_s=3, replaced=6)
    assert watch.found.as_dict()["availability_ratio"] == 0.4


def test_without_a_coach_there_is_nothing_to_measure() -> None:
    watch = InstructionWatch()
    watch.look(Advice(time_ns=0, speed_mps=20.0), 0.0)
    assert watch.found == InstructionFigures(reliance=RelianceFigures(silent_s=1))
    assert watch.found.rows() == []
    assert watch.found.as_dict()["announced_ratio"] is None
