"""The measures of the guide's grammar, on advice made second by second."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from das.advice.advice import Advice, Cause, Guidance, Instruction, Replan
from das.advice.regimes import Regime
from das.domain.units import KMH, NS
from sim.drive.figures import AdviceStability, DriveFigures
from sim.drive.instructions import InstructionFigures, InstructionWatch, RelianceFigures
from sim.drive.limits import Violations

T, H, C, B = Regime.FULL_TRACTION, Regime.CRUISE, Regime.COAST, Regime.REDUCED_BRAKE
EFFORTS = {T: 1.0, H: math.nan, C: 0.0, B: -0.6}
BOARD = 30.0 * KMH
"""A limit that begins 120 m before the stop."""


def told(mode: Regime, kmh: float, in_s: float = 0.0) -> Instruction:
    return Instruction(mode=mode, speed_mps=kmh * KMH, effort_ratio=EFFORTS[mode], in_s=in_s)


def found(
    *spells: tuple[Instruction, int, float],
    announce: bool = True,
    replan_s: int = -1,
    force_n: float = 0.0,
    limits_kmh: Sequence[float] = (200.0,),
) -> InstructionFigures:
    """The figures of instructions that stand for a number of seconds at a speed (km/h); each announces the next."""
    watch, now_s, s_m = InstructionWatch(), 100, 0.0
    for k, (one, lasts_s, kmh) in enumerate(spells):
        for left_s in range(lasts_s, 0, -1):
            after = [replace(spells[k + 1][0], in_s=float(left_s))] if announce and k + 1 < len(spells) else []
            due = replace(one, in_s=max(one.in_s - (lasts_s - left_s), 0.0))
            guide = Guidance(now=due, following=tuple(after), replan=Replan(time_ns=round(replan_s / NS)))
            s_m += kmh * KMH
            limit_mps = limits_kmh[(now_s - 100) % len(limits_kmh)] * KMH
            advice = Advice(
                time_ns=round(now_s / NS),
                mode=one.mode,
                s_m=s_m,
                speed_mps=kmh * KMH,
                limit_mps=limit_mps,
                guide=guide,
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


def test_a_brake_to_one_speed_does_not_announce_a_brake_to_another() -> None:
    """Brake to 60 is announced for 20 s, and a brake to 0 is shown."""
    coming = replace(told(B, 60), in_s=20.0)
    same, other = (seen_to_change(coming, told(B, kmh)) for kmh in (60, 0))
    assert (same.changes, same.announced, same.reliance.kept) == (1, 1, 1)
    assert (other.changes, other.announced, other.reliance.promised, other.reliance.kept) == (1, 0, 1, 0)


def seen_to_change(announced: Instruction, after: Instruction) -> InstructionFigures:
    """The figures of holding 100 km/h while one instruction is announced for 20 s, and of another one in its place."""
    watch = InstructionWatch()
    for second in range(45):
        following = (replace(announced, in_s=20.0 - second),) if second < 20 else ()
        guide = Guidance(now=told(H, 100) if second < 20 else after, following=following)
        watch.look(
            Advice(time_ns=second * 10**9, speed_mps=100.0 * KMH, limit_mps=200.0 * KMH, guide=guide), force_n=0.0
        )
    return watch.found


@pytest.mark.parametrize(
    ("effort_ratio", "speed_kmh", "hidden", "above_s"),
    [(math.nan, 70.0, 1, 5), (math.nan, 45.0, 0, 0), (-0.6, 70.0, 0, 0)],
)
def test_a_board_that_a_stop_by_eye_hides_is_found_and_so_is_the_train_that_passes_it_too_fast(
    effort_ratio: float, speed_kmh: float, hidden: int, above_s: int
) -> None:
    """Told to brake to 0 from 300 m on; a steady brake to the stop is at 44 km/h where 30 km/h begin.

    From 45 km/h it passes the board at 28. The driver brakes with a third of the guide's force: who is shown no effort
    obeys by that, and who is shown one does not.
    """
    watch, at_m = InstructionWatch(), 0.0
    brake = Instruction(mode=B, speed_mps=0.0, effort_ratio=effort_ratio)
    for second in range(40):
        speed_mps = speed_kmh * KMH * math.sqrt(max(300.0 - at_m, 0.0) / 300.0)
        advice = Advice(
            time_ns=second * 10**9, s_m=at_m, speed_mps=speed_mps, limit_mps=BOARD if at_m >= 180.0 else 120.0 * KMH,
            guide=Guidance(now=brake, target_m=300.0 - at_m, force_n=-3e5, lever_ratio=effort_ratio),
        )  # fmt: skip
        watch.look(advice, force_n=-1e5)
        at_m += speed_mps
    found = watch.found
    assert (found.reliance.hidden_limits, found.reliance.above_limit_s) == (hidden, above_s)


def test_the_speed_that_an_instruction_leads_to_needs_no_announcement() -> None:
    own = found((told(T, 100), 20, 90.0), (told(H, 100), 20, 100.0), announce=False)
    assert (own.changes, own.announced) == (1, 1)
    other = found((told(T, 100), 20, 90.0), (told(H, 80), 20, 100.0), announce=False)
    assert (other.changes, other.announced) == (1, 0)


def test_coasting_ends_at_the_speed_that_it_named_last() -> None:
    """Coasting to 90 km/h, and from some second on to 95, is one instruction; 95 is then held."""
    for held_kmh, announced in ((95, 1), (90, 0)):
        spells = (told(C, 90), 20, 100.0), (told(C, 95), 20, 96.0), (told(H, held_kmh), 20, 95.0)
        figures = found(*spells, announce=False)
        assert (figures.instructions, figures.changes, figures.announced) == (2, 1, announced)


def test_coasting_misses_the_speed_that_stood_at_its_end_or_when_another_was_announced() -> None:
    def missed(reached_kmh: float, lasts_s: int = 20, *, announce: bool = True) -> int:
        down, begins = (told(C, 100), 20, 105.0), (told(C, 120), 1, reached_kmh)
        goes_on = (told(C, 120), lasts_s, 119.0), (told(H, 120), 9, 119.0)
        return found(down, begins, *goes_on, announce=announce).missed_coasts

    assert (missed(101.0), missed(108.0)) == (0, 1)
    assert (missed(108.0, announce=False), missed(108.0, 5, announce=False)) == (0, 1)


def test_a_coasting_speed_that_changes_by_a_rounding_error_still_stands() -> None:
    spells = (told(C, 100), 20, 108.0), (told(C, 110), 20, 110.0), (told(C, 110 + 1e-12), 5, 110.0)
    assert found(*spells, (told(H, 110), 9, 110.0), announce=False).missed_coasts == 0


def figures_of(guide: InstructionFigures) -> DriveFigures:
    """The figures of a drive with these instructions, which showed nothing else and violated nothing."""
    return DriveFigures(violations=Violations(), stability=AdviceStability(), instructions=guide)


def test_a_brake_is_led_if_it_is_shown_2_s_before_it_is_due() -> None:
    led = found((told(H, 100), 20, 100.0), (told(B, 60, in_s=2.5), 20, 90.0))
    late = found((told(H, 100), 20, 100.0), (told(B, 60, in_s=1.0), 20, 90.0))
    assert (led.brakes, led.led, late.brakes, late.led) == (1, 1, 1, 0)
    assert figures_of(led).as_dict()["brakes_led_ratio"] == 1.0


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
    assert found((told(H, 87), 9, 87.0), limits_kmh=(200.0, 87.0)).odd_speeds == 0, "it is the limit further on"
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
    assert figures_of(watch.found).as_dict()["availability_ratio"] == 0.4


def test_without_a_guide_there_is_nothing_to_measure() -> None:
    watch = InstructionWatch()
    watch.look(Advice(time_ns=0, speed_mps=20.0), 0.0)
    assert watch.found == InstructionFigures(reliance=RelianceFigures(silent_s=1))
    assert figures_of(watch.found).rows() == []
    assert figures_of(watch.found).as_dict()["announced_ratio"] is None
