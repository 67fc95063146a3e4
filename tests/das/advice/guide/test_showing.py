"""What the guide says second by second: calm, announced, never above a limit, and one memory from second to second."""

from __future__ import annotations

import math

import numpy as np
import pytest

from das.advice.advice import Guidance, Replan, ReplanCause
from das.advice.goal import SpeedsAllowed, TrainState
from das.advice.guide.memory import brake, coast
from das.advice.guide.showing import FORGOTTEN_S, LEADS_S, Showing
from das.advice.regimes import BRAKES, TRACTION, InstructionKind, Regime
from das.domain.units import KMH
from das.solver.guide.schedule import Schedule
from das.solver.kernels.forces import traction_limit
from das.solver.kernels.guide_policy import STANDS_S
from tests.support.guide import FREE, flat, kept, reference
from tests.support.keeping import Keeping, ns

TOP_MPS = 100 * KMH
PLACES_M = (0.0, 1000.0, 3000.0, 4700.0)
PLAIN = reference(("T", 0.8, 0.0, 100), ("H", 0.0, 1000.0, 100), ("C", 0.0, 3000.0, 90), ("B", 0.0, 4700.0, 0))
HELD_M = 1500.0


class Led:
    """A driver led along a reference."""

    def __init__(self, schedule: Schedule = PLAIN, guide: Showing | None = None) -> None:
        self.guide, self._schedule = guide or Showing(), schedule

    def at(
        self, second: float, s_m: float, v_mps: float, place: SpeedsAllowed = FREE, replan: Replan | None = None
    ) -> Guidance:
        """What a train in this state at this second is told."""
        state = TrainState(ns(second), s_m, v_mps)
        return self.guide.show(kept(self._schedule, state, replan), state, place)

    def modes(self, begin_s: float, states: list[tuple[float, float]], s_m: float = HELD_M) -> list[Regime]:
        """The modes told at seconds to a train that is this much off 100 km/h (km/h) at one place."""
        return [self.at(begin_s + second, s_m, TOP_MPS + by * KMH).now.mode for second, by in states]


def test_a_train_on_the_reference_is_told_each_step_once_with_its_lead() -> None:
    led, train, found = Led(), Keeping(PLAIN.forecast(0.0, 0.0), 0.0), []
    for second in range(1, int(train.end_s) - 1):
        state = train.at(second)
        shown = led.at(second, state.s_m, state.v_mps)
        if not found or found[-1][0] is not shown.now.mode:
            found.append((shown.now.mode, state.s_m))
    assert [mode for mode, _ in found[:3]] == [Regime.REDUCED_TRACTION, Regime.CRUISE, Regime.COAST]
    assert {mode for mode, _ in found[3:]} <= set(BRAKES)
    leads_m = [begin - at for begin, (_, at) in zip(PLACES_M[2:], found[2:4], strict=True)]
    assert all(0.0 < lead <= (LEADS_S[InstructionKind.COAST] + 1.0) * TOP_MPS for lead in leads_m)


@pytest.mark.parametrize("v_kmh", [60, 95, 104, 130])
@pytest.mark.parametrize("s_m", [500.0, 2000.0, 3500.0, 5000.0])
@pytest.mark.parametrize("limit_kmh", [30, 80, 99, 160])
def test_no_speed_is_told_above_the_limit(s_m: float, v_kmh: float, limit_kmh: float) -> None:
    """Whatever the reference says, and whatever was shown before."""
    led = Led()
    led.at(0.0, max(s_m - 200.0, 0.0), v_kmh * KMH)
    place = SpeedsAllowed(limit_kmh * KMH, limit_kmh * KMH)
    assert led.at(1.0, s_m, v_kmh * KMH, place).now.speed_mps <= limit_kmh * KMH + 0.3


def test_a_speed_that_cannot_be_reached_any_more_does_not_stand() -> None:
    led = Led()
    assert led.at(0.0, 500.0, 10.0).now.mode in TRACTION
    highest_mps = float(np.interp(5900.0, flat().node_m, flat().envelope_mps))
    assert led.at(1.0, 5900.0, 0.3 * highest_mps).now.speed_mps <= highest_mps + 0.3


def test_holding_does_not_flutter_within_5_km_h() -> None:
    wanders = [(10.0 * i, by) for i, by in enumerate((0.0, 3.5, -3.5, 4.9, -4.9, 0.0, -4.9, 4.9))]
    assert set(Led().modes(0.0, wanders)) == {Regime.CRUISE}


@pytest.mark.parametrize(
    ("by_kmh", "back", "kind"),
    [
        (-5.5, Regime.REDUCED_TRACTION, InstructionKind.TRACTION),
        (5.5, Regime.COAST, InstructionKind.COAST),
        (12.0, Regime.REDUCED_BRAKE, InstructionKind.BRAKE),
    ],
)
def test_a_change_that_the_reference_does_not_have_is_announced_for_8_s(
    by_kmh: float, back: Regime, kind: InstructionKind
) -> None:
    """It is shown its lead before it is due, with the time to it, and then stands."""
    led, v_mps = Led(), TOP_MPS + by_kmh * KMH
    led.at(0.0, HELD_M, TOP_MPS)
    for second in range(10, 22):
        found, left_s = led.at(float(second), HELD_M, v_mps), 18.0 - second
        shown = left_s <= LEADS_S[kind]
        assert found.now.mode is (back if shown else Regime.CRUISE)
        change = found.now if shown else found.following[0]
        assert (change.mode, change.speed_mps) == (back, TOP_MPS)
        assert change.in_s == pytest.approx(max(left_s, 0.0), abs=1e-6)


def test_who_comes_back_by_himself_is_told_nothing_of_it_any_more() -> None:
    led = Led()
    led.at(0.0, HELD_M, TOP_MPS)
    assert led.at(10.0, HELD_M, TOP_MPS - 5.5 * KMH).following[0].mode is Regime.REDUCED_TRACTION
    for second in range(11, 30):
        found = led.at(float(second), HELD_M, TOP_MPS)
        assert [found.now.mode, found.following[0].mode] == [Regime.CRUISE, Regime.COAST]
    again = led.at(30.0, HELD_M, TOP_MPS - 5.5 * KMH)
    assert again.following[0].in_s == pytest.approx(STANDS_S), "it is announced anew"


def test_a_brake_that_the_last_word_has_shown_goes_on_to_its_speed_and_no_other_act_does() -> None:
    led = Led()
    assert led.at(0.0, HELD_M, TOP_MPS).now.mode is Regime.CRUISE
    led.guide.has_shown(brake(0.4, 95 * KMH), ns(9.0))
    assert led.at(10.0, HELD_M + 250.0, 98 * KMH).now.mode in BRAKES
    assert led.guide.shown_effort == pytest.approx(0.4)
    released = led.at(11.0, HELD_M + 275.0, 95 * KMH).now
    assert (released.mode, released.speed_mps) == (Regime.CRUISE, 95 * KMH)
    led.guide.has_shown(coast(80 * KMH), ns(11.0))
    assert led.at(12.0, HELD_M + 300.0, 95 * KMH).now.mode is Regime.CRUISE


def test_after_silence_a_driver_is_told_what_applies_now() -> None:
    rises = reference(("H", 0.0, 0.0, 54), ("T", 0.8, 2000.0, 90), ("B", 0.0, 4700.0, 0), at_kmh=54)
    for gap_s, mode in ((5.0, Regime.CRUISE), (FORGOTTEN_S + 1.0, Regime.REDUCED_TRACTION)):
        led = Led(rises)
        assert led.at(0.0, 1850.0, 15.0).now.mode is Regime.CRUISE
        assert led.at(gap_s, 2200.0, 15.0).now.mode is mode


def test_a_speed_reached_before_silence_is_still_held_after_it() -> None:
    """A driver who braked for a signal is not told to accelerate when the next step is near."""
    led = Led()
    assert led.at(0.0, 2000.0, TOP_MPS).now.mode is Regime.CRUISE
    led.guide.forget()
    assert led.at(20.0, 2300.0, TOP_MPS - 10 * KMH).now.mode is Regime.CRUISE


def test_a_clock_that_is_put_back_holds_nothing_up() -> None:
    led = Led()
    assert led.at(100.0, 900.0, TOP_MPS - 20 * KMH).now.mode is Regime.REDUCED_TRACTION
    found = led.at(50.0, 900.0, TOP_MPS).now
    assert (found.mode, found.in_s) == (Regime.CRUISE, 0.0)


def test_news_that_want_a_slower_train_end_an_acceleration_without_notice() -> None:
    """A train ahead is reported while the driver accelerates; because he is late, nobody would hurry so."""
    slower = reference(("H", 0.0, 0.0, 54), ("B", 0.0, 4700.0, 0), at_kmh=54)
    for cause, ends in ((ReplanCause.LINE, True), (ReplanCause.LATE, False)):
        led = Led()
        assert led.at(0.0, 600.0, 17.0).now.mode in TRACTION
        after = Led(slower, led.guide)
        now = after.at(9.0, 760.0, 18.0, replan=Replan(cause=cause, time_ns=ns(9.0))).now
        assert (now.mode not in TRACTION) is ends


def test_the_stop_behind_the_mark_is_braked_for_whatever_the_reference_is() -> None:
    guide = Showing()
    assert guide.braking(0.6) == brake(0.6, 0.0)
    assert guide.shown_effort == pytest.approx(0.6)
    guide.forget()
    assert guide.shown_effort == 0.0


def test_a_train_too_slow_for_any_reference_creeps_to_its_stop_and_brakes_there() -> None:
    line, guide = flat(), Showing()
    found = guide.creeping(line, TrainState(ns(0), line.end_m - 60.0, 1.5), FREE)
    assert (found.now.mode, found.now.speed_mps) == (Regime.CRUISE, 10 * KMH)
    assert found.force_n > 0.0
    assert [one.mode in BRAKES for one in found.following] == [True]
    near = guide.creeping(line, TrainState(ns(1), line.end_m - 5.0, 2.5), FREE)
    assert near.now.mode in BRAKES
    slow = SpeedsAllowed(1.0, 10.0)
    assert guide.creeping(line, TrainState(ns(2), line.end_m - 30.0, 0.5), slow).now.mode in BRAKES


def test_the_force_of_an_instruction_is_one_that_the_train_has_and_does_not_overshoot() -> None:
    train = flat().train
    pulls = Led().at(0.0, 300.0, 10.0)
    assert pulls.force_n == pytest.approx(0.8 * traction_limit(10.0, train))
    near = Led().at(0.0, 900.0, TOP_MPS - 0.6)
    assert 0.0 < near.force_n < 0.8 * traction_limit(TOP_MPS, train)
    assert Led().at(0.0, 3500.0, 26.0).force_n == 0.0
    brakes = Led().at(0.0, 5000.0, 22.0)
    assert brakes.force_n < brakes.reference_force_n < 0.0, "the effort shown is rounded up"


def test_the_goal_of_an_instruction_is_where_it_has_led_to_its_speed() -> None:
    brakes = Led().at(0.0, 5000.0, 22.0)
    assert brakes.target_m == pytest.approx(flat().end_m - 5000.0, abs=1.0)
    holds = Led().at(0.0, 2000.0, TOP_MPS)
    assert holds.target_m == pytest.approx(1000.0, abs=60.0)
    assert math.isclose(holds.target_s, holds.target_m / TOP_MPS, rel_tol=0.05)


def test_the_keeper_learns_when_the_last_change_was_and_when_the_next_is() -> None:
    led = Led()
    led.at(0.0, HELD_M, TOP_MPS)
    assert led.guide.changes.last_ns == ns(0.0)
    shown = led.at(5.0, HELD_M + 140.0, TOP_MPS)
    assert led.guide.changes.last_ns == ns(0.0)
    assert led.guide.changes.next_ns == ns(5.0) + round(shown.following[0].in_s * 1e9)


def test_an_acceleration_does_not_stand_to_a_speed_that_a_nearer_board_forbids() -> None:
    """foreign/04: "accelerate to 155" stood 83 m before a board of 150, until the last word lowered it."""
    line = flat((3000.0, 6000.0, 70))
    led = Led(reference(("T", 0.3, 0.0, 100), ("B", 0.0, 5200.0, 0), section=line))
    told = [led.at(float(k), s_m, 17.0).now.speed_mps for k, s_m in enumerate((2000.0, 2960.0))]
    assert told[1] <= 70 * KMH + 1e-6
