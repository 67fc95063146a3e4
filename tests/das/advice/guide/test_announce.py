"""What is announced: the next two changes, or the brake of the guard where it comes first."""

from __future__ import annotations

from dataclasses import replace

import pytest

from das.advice.advice import Instruction
from das.advice.guide.guard import Proposal, Sight
from das.advice.guide.memory import Lead, Memory, brake, coast, hold, traction
from das.advice.guide.showing import _rest, following, said
from das.advice.regimes import BRAKES, KIND_OF, TRACTION, InstructionKind, Regime
from das.domain.units import KMH
from das.solver.guide.schedule import Schedule, on_section
from das.solver.kernels.guide_policy import STANDS_S
from tests.support.guide import flat, reference, scene
from tests.support.keeping import ns

PLAIN = reference(("T", 0.8, 0.0, 100), ("H", 0.0, 1000.0, 100), ("C", 0.0, 3000.0, 90), ("B", 0.0, 4700.0, 0))
BOARD = flat((3000.0, 6000.0, 60))
LOWER = reference(
    ("H", 0.0, 0.0, 100), ("B", 0.0, 2500.0, 60), ("B", 0.0, 5200.0, 0), section=BOARD, at_kmh=100
)  # fmt: skip
HOLD = hold(100 * KMH)
KINDS = [InstructionKind.COAST, InstructionKind.BRAKE]


def seen(s_m: float, kmh: float, schedule: Schedule = PLAIN) -> Sight:
    return scene(schedule, s_m, kmh)


def told(here: Sight, now: Instruction, put_off: Instruction | None = None, **more: object) -> tuple[Instruction, ...]:
    """What is announced to a driver who has been told an instruction for a minute."""
    memory = replace(Memory(mode=Lead.FOLLOW, shown=now, since_ns=ns(40.0), due_ns=ns(40.0)), **more)  # type: ignore[arg-type]
    return following(here, memory, now, put_off)


def test_the_next_two_changes_are_announced_with_their_places_and_times() -> None:
    here = seen(2000.0, 100.0)
    found = told(here, HOLD)
    assert [KIND_OF[one.mode] for one in found] == KINDS
    assert [one.way_m for one in found] == pytest.approx([1000.0, 2700.0], abs=60.0)
    assert found[0].in_s == pytest.approx(here.due_s(1))


def test_what_repeats_the_instruction_before_it_is_left_out() -> None:
    assert [KIND_OF[one.mode] for one in told(seen(2000.0, 100.0), coast(90 * KMH))] == [InstructionKind.BRAKE]


def test_the_brake_after_a_brake_is_due_when_one_who_brakes_as_shown_is_there() -> None:
    """The reference coasts to the brake; one who brakes to 98 km/h and then holds that is there sooner."""
    here = seen(1500.0, 100.0, reference(("C", 0.0, 0.0, 60), ("B", 0.0, 4700.0, 0), at_kmh=100))
    (stops,) = told(here, brake(1.0, 98 * KMH))
    assert stops.in_s == pytest.approx(stops.way_m / (98 * KMH), abs=0.5)
    assert stops.in_s < here.foreseen.passes_s(here.state.s_m + stops.way_m) - 3.0


def test_a_hold_of_the_speed_led_to_is_not_announced() -> None:
    schedule = reference(("T", 0.8, 0.0, 80), ("H", 0.0, 2000.0, 80), ("B", 0.0, 4700.0, 0))
    assert [KIND_OF[one.mode] for one in told(seen(1000.0, 70.0, schedule), traction(0.8, 80 * KMH))] == KINDS[1:]


def test_a_brake_that_a_slower_train_needs_not_is_left_out() -> None:
    assert said(seen(1000.0, 100.0, LOWER), 1) is not None
    slow = on_section(LOWER, BOARD)
    assert (
        said(scene(slow, 2400.0, 55.0), 1) is None or scene(slow, 2400.0, 55.0).foreseen.passes_mps(2500.0) > 60 * KMH
    )
    found = told(seen(2400.0, 58.0, LOWER), hold(60 * KMH))
    assert not any(one.mode in BRAKES and one.speed_mps > 0.0 for one in found)


def test_an_acceleration_in_vain_is_not_announced() -> None:
    schedule = reference(
        ("H", 0.0, 0.0, 90), ("T", 0.8, 2000.0, 95), ("B", 0.5, 2300.0, 60), ("B", 0.0, 5200.0, 0), at_kmh=90
    )  # fmt: skip
    assert not any(one.mode in TRACTION for one in told(seen(1500.0, 90.0, schedule), hold(90 * KMH)))


def test_a_brake_of_a_driver_who_is_too_fast_is_announced_where_he_meets_the_curve() -> None:
    on_time, fast = (told(seen(1500.0, kmh, LOWER), HOLD)[0] for kmh in (100.0, 115.0))
    assert (on_time.mode in BRAKES, fast.mode in BRAKES) == (True, True)
    assert fast.way_m < on_time.way_m - 50.0
    assert fast.in_s < on_time.in_s - 3.0


def test_a_limit_that_the_reference_does_not_know_is_announced_by_the_guard() -> None:
    line = flat((2500.0, 6000.0, 50))
    found = told(scene(on_section(PLAIN, line), 1200.0, 100.0), HOLD)
    assert (found[0].mode in BRAKES, round(found[0].speed_mps / KMH)) == (True, 50)


def test_coasting_that_a_brake_would_end_at_once_is_not_announced() -> None:
    schedule = reference(
        ("H", 0.0, 0.0, 100), ("C", 0.0, 2450.0, 98), ("B", 0.0, 2600.0, 60), ("B", 0.0, 5200.0, 0),
        section=BOARD, at_kmh=100,
    )  # fmt: skip
    first = told(seen(2100.0, 104.0, schedule), hold(100 * KMH))[0]
    assert KIND_OF[first.mode] is InstructionKind.BRAKE


def test_a_change_that_is_put_off_is_announced_in_its_turn() -> None:
    waits = replace(traction(0.7, 100 * KMH), in_s=8.0, way_m=200.0)
    found = told(seen(1300.0, 92.0), HOLD, waits)
    assert found[0] == waits
    assert found[1].mode is Regime.COAST


def test_the_next_change_is_due_no_sooner_than_what_is_shown_has_stood_but_a_brake_does_not_wait() -> None:
    young = {"since_ns": ns(98.0)}
    coasts = told(seen(2980.0, 100.0), HOLD, **young)[0]
    assert coasts.in_s == pytest.approx(STANDS_S - 2.0)
    assert coasts.way_m == pytest.approx(coasts.in_s * 100 * KMH)
    brakes = told(seen(4640.0, 90.0), coast(85 * KMH), **young, step=1)[0]
    assert (brakes.mode in BRAKES, brakes.in_s < 4.0) == (True, True)


def test_after_a_brake_the_next_change_is_due_when_it_has_reached_its_speed() -> None:
    schedule = reference(
        ("H", 0.0, 0.0, 100), ("B", 0.4, 1000.0, 70), ("C", 0.0, 1100.0, 60), ("B", 0.0, 5200.0, 0), at_kmh=100
    )  # fmt: skip
    now = brake(0.4, 70 * KMH)
    found = told(seen(1050.0, 98.0, schedule), now, step=1)
    assert found[0].mode is Regime.COAST
    assert found[0].in_s > 8.0, "from 98 to 70 km/h takes longer than 50 m"
    assert found[0].way_m == pytest.approx(found[0].in_s * 84 * KMH), "at the mean of both speeds"


def test_after_a_brake_no_brake_to_a_speed_as_high_is_announced() -> None:
    found = told(seen(2550.0, 98.0, LOWER), brake(0.9, 40 * KMH))
    assert not any(one.mode in BRAKES and one.speed_mps > 40 * KMH for one in found)


@pytest.mark.parametrize(("s_m", "lasts"), [(2000.0, True), (2300.0, False)])
def test_coasting_that_a_brake_interrupts_is_announced_again_only_if_it_lasts_8_s(s_m: float, *, lasts: bool) -> None:
    """The brake takes 8 s from 70 to 60 km/h; the step after coasting begins at 2500 m, 26 or 10 s from here."""
    schedule = reference(
        ("H", 0.0, 0.0, 70), ("C", 0.0, 1000.0, 50), ("B", 0.5, 2500.0, 30), ("B", 0.0, 5500.0, 0), at_kmh=70
    )  # fmt: skip
    brakes = Proposal(brake(0.5, 60 * KMH), guarded=True)
    again = _rest(seen(s_m, 70.0, schedule), Memory(step=1), Proposal(coast(50 * KMH)), brakes)
    assert (again is not None) is lasts


def test_no_speed_is_announced_above_the_limit_of_its_place() -> None:
    line = flat((2800.0, 4000.0, 80))
    for one in told(scene(on_section(PLAIN, line), 2000.0, 79.0), hold(79 * KMH)):
        assert one.speed_mps <= 80 * KMH + 1e-6
