"""What the coach shows: never above the limit, no flickering between instructions, and the instructions that follow."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from das.advice.advice import Instruction, Replan, ReplanCause
from das.advice.braking import NeededBrake
from das.advice.coach.announcing import Announcing, Foreseen, allowed, in_time
from das.advice.coach.keeping import Kept, StandingReference
from das.advice.coach.settings import DEFAULT, ShowingSettings
from das.advice.coach.showing import Showing, ShownNow
from das.advice.coach.shown_brakes import ShownBrakes, SpeedsAllowed, brake_of
from das.advice.goal import TrainState
from das.advice.regimes import BRAKES, TRACTION, Regime
from das.advice.shown import SAME_READING_MPS, TARGET_STEP_MPS
from das.domain.restriction import Restriction
from das.domain.units import KMH
from das.solver.guide.phases import Phase, PhaseKind
from das.solver.guide.schedule import Schedule, known_run
from das.solver.kernels.forces import electric_limit, traction_limit
from das.solver.section import Section, build_section
from tests.support.bundled_sections import BUNDLED, section_of
from tests.support.coach import Keeping, ns

FREE = SpeedsAllowed(math.inf, math.inf)
TOP_MPS = 100 * KMH
"""The speed that the schedule of this file accelerates to and holds."""
PLACES_M = (0.0, 1000.0, 3000.0, 4700.0)
"""Where traction, holding, coasting and braking of that schedule begin on the flat 6 km."""
HELD_M = 1500.0
"""A place where that schedule holds its speed, more than 40 s before it coasts."""
SETTINGS = ShowingSettings()


class Shown(NamedTuple):
    """A schedule, and the object that chooses what is shown of it."""

    showing: Showing
    schedule: Schedule

    def at(self, second: float, s_m: float, v_mps: float, place: SpeedsAllowed = FREE) -> ShownNow:
        """What is shown of the schedule to a train in this state at this second."""
        reference = StandingReference(
            schedule=self.schedule, lambda_w=1e6, arrival_ns=ns(400), point=None, replan=Replan()
        )
        kept = Kept(reference, self.schedule.forecast(s_m, v_mps), 0.0)
        return self.showing.show(kept, TrainState(ns(second), s_m, v_mps), place)

    def modes(self, speeds: list[float], s_m: float, *, every_s: float = 10.0) -> list[Regime]:
        """The modes shown one after the other to a train that has these speeds at one place."""
        return [self.at(every_s * i, s_m, v).now.mode for i, v in enumerate(speeds)]


def section() -> Section:
    return section_of(BUNDLED[0])


@pytest.fixture
def display() -> Shown:
    """A schedule to show: accelerate to 100 km/h, hold it, coast, brake to the stop."""
    node_m = section().node_m
    begins = [int(np.searchsorted(node_m, place)) for place in PLACES_M]
    speeds = (TOP_MPS, TOP_MPS, 90 * KMH, 0.0)
    kinds = (PhaseKind.TRACTION, PhaseKind.HOLD, PhaseKind.COAST, PhaseKind.BRAKE)
    phases = tuple(
        Phase(kind, 0.8 if kind is PhaseKind.TRACTION else 0.0, begin, speed)
        for kind, begin, speed in zip(kinds, begins, speeds, strict=True)
    )
    raw = Schedule(
        section=section(), phases=phases, known=known_run(section(), np.full(len(node_m), TOP_MPS)), back_share=0.7
    )
    return Shown(Showing(SETTINGS), raw.settled(0.0, 0.0)[0])


def test_a_train_on_the_run_is_shown_each_phase_once(display: Shown) -> None:
    """In order: coasting and braking some seconds before they are due, holding once the speed is reached."""
    schedule = display.schedule
    forecast = schedule.forecast(0.0, 0.0)
    train, found = Keeping(schedule, forecast, 0.0, 0.0), []
    for second in range(1, int(train.end_s) - 1):
        state = train.at(second)
        shown = display.at(second, state.s_m, state.v_mps)
        if not found or found[-1][0] is not shown.now.mode:
            found.append((shown.now.mode, state.s_m))
    assert [mode for mode, _ in found[:3]] == [Regime.REDUCED_TRACTION, Regime.CRUISE, Regime.COAST]
    assert {mode for mode, _ in found[3:]} <= set(BRAKES)
    lead_m = [begin - at for begin, (_, at) in zip(PLACES_M[2:], found[2:4], strict=True)]
    assert all(0.0 < lead <= (SETTINGS.lead.coasting_s + 1.0) * TOP_MPS for lead in lead_m)


@pytest.mark.parametrize("v_kmh", [60, 95, 99, 104, 130])
@pytest.mark.parametrize("s_m", [500.0, 2000.0, 3500.0, 5000.0])
@pytest.mark.parametrize("limit_kmh", [30, 80, 99, 160])
def test_no_speed_is_shown_above_the_limit(display: Shown, s_m: float, v_kmh: float, limit_kmh: float) -> None:
    """Whatever the reference says, and whatever was shown before."""
    display.at(0.0, max(s_m - 200.0, 0.0), v_kmh * KMH)
    place = SpeedsAllowed(limit_kmh * KMH, limit_kmh * KMH)
    assert display.at(1.0, s_m, v_kmh * KMH, place).now.speed_mps <= limit_kmh * KMH + 0.3


@pytest.mark.parametrize(
    ("limit_mps", "shown"),
    [
        (70 * KMH, [Regime.CRUISE, Regime.REDUCED_BRAKE, Regime.REDUCED_BRAKE, Regime.FRICTION_BRAKE]),
        (25.0, [Regime.FULL_BRAKE, Regime.FULL_BRAKE, Regime.FULL_BRAKE, Regime.FRICTION_BRAKE]),
    ],
)
def test_too_fast_a_train_is_told_to_hold_what_is_allowed_or_to_brake(
    display: Shown, limit_mps: float, shown: list[Regime]
) -> None:
    """Slightly above a limit the train is told to hold the limit; above a braking curve, to brake fully."""
    found = []
    for second, over in enumerate((0.2, 0.7, 1.0, 1.4, 5.0)):
        now = display.at(second, 2000.0, 70 * KMH + over, SpeedsAllowed(70 * KMH, limit_mps)).now
        found.append(now.mode)
        assert now.mode not in BRAKES or now.speed_mps == pytest.approx(70 * KMH)
    assert found[1:] == shown


def test_holding_does_not_flutter_within_the_band(display: Shown) -> None:
    """The speed varies by 4 km/h either way again and again: the instruction to hold it stays."""
    speeds = [TOP_MPS + by * KMH for by in (0.0, 3.5, -3.5, 3.9, -3.9, 0.0, -3.9, 3.9)]
    assert set(display.modes([TOP_MPS, *speeds], 2000.0)) == {Regime.CRUISE}


def test_a_train_out_of_the_band_goes_back_until_the_speed_is_reached(display: Shown) -> None:
    """Below it: traction up to 0.5 m/s under the speed. Above: coasting down to the speed, not only into the band.

    The driver learns 8 s before that he is to go back. Where the next instruction is near, he is not to accelerate.
    """

    def modes(begin_s: float, states: list[tuple[float, float]], s_m: float = HELD_M) -> list[Regime]:
        display.showing.forget()
        return [display.at(begin_s + second, s_m, TOP_MPS + by * KMH).now.mode for second, by in states]

    hold, traction, coast = Regime.CRUISE, Regime.REDUCED_TRACTION, Regime.COAST
    slow = [
        (0.0, 0.0),
        (10.0, -5.5),
        (17.0, -5.5),
        (18.0, -5.5),
        (30.0, -3.0),
        (40.0, -1.9),
        (50.0, -1.7),
        (60.0, -3.0),
    ]
    assert modes(0.0, slow) == [*[hold] * 3, *[traction] * 3, hold, hold]
    assert modes(100.0, slow, 2000.0) == [hold] * 8
    fast = [(0.0, 0.0), (10.0, 5.5), (17.0, 5.5), (18.0, 5.5), (30.0, 3.0), (40.0, 1.2)]
    assert modes(200.0, fast) == [*[hold] * 3, *[coast] * 3]
    reached = display.at(241.0, HELD_M, TOP_MPS + 1.0 * KMH)
    assert hold in (reached.now.mode, reached.following[0].mode), "it is held, or that is announced"
    assert [display.at(second, HELD_M, TOP_MPS + 3.0 * KMH).now.mode for second in (249.0, 260.0)] == [hold] * 2


@pytest.mark.parametrize(
    ("by_kmh", "back"), [(-5.5, Regime.REDUCED_TRACTION), (5.5, Regime.COAST), (12.0, Regime.REDUCED_BRAKE)]
)
def test_a_change_that_the_schedule_does_not_have_is_announced_8_s_before(
    display: Shown, by_kmh: float, back: Regime
) -> None:
    """Accelerating, coasting or braking back; the brake is shown from 3 s before it is due. A driver who comes back
    within these 8 s is told nothing of it any more."""
    display.at(0.0, HELD_M, TOP_MPS)
    v_mps, brakes = TOP_MPS + by_kmh * KMH, back in BRAKES
    for second in range(10, 18):
        found = display.at(float(second), HELD_M, v_mps)
        shown = brakes and second >= 18 - SETTINGS.lead.braking_s
        assert found.now.mode is (back if shown else Regime.CRUISE)
        change = found.now if shown else found.following[0]
        assert (change.mode, change.speed_mps) == (back, TOP_MPS)
        assert (change.in_s, change.way_m) == pytest.approx((18.0 - second, (18.0 - second) * v_mps), abs=1e-6)
    due = display.at(18.0, HELD_M, v_mps).now
    assert (due.mode, due.in_s, due.way_m) == (back, 0.0, 0.0)
    display.showing.forget()
    display.at(100.0, HELD_M, TOP_MPS)
    assert [display.at(second, HELD_M, v_mps).following[0].mode for second in (110.0, 112.0, 114.0)] == [back] * 3
    for second in range(115, 130):
        found = display.at(float(second), HELD_M, TOP_MPS)
        assert [found.now.mode, *[one.mode for one in found.following]] == [
            Regime.CRUISE, Regime.COAST, Regime.REDUCED_BRAKE,
        ]  # fmt: skip
        assert found.following[0].speed_mps == pytest.approx(90 * KMH)


@pytest.mark.parametrize("every_s", [0.5, 0.95])
@pytest.mark.parametrize(("by_kmh", "back"), [(-5.5, Regime.REDUCED_TRACTION), (5.5, Regime.COAST)])
def test_an_announced_change_is_shown_when_it_is_due_however_often_advice_is_made(
    display: Shown, by_kmh: float, back: Regime, every_s: float
) -> None:
    """Also where the schedule has a change of the same kind later, as the coasting of this one."""
    display.at(0.0, HELD_M, TOP_MPS)
    seconds = np.arange(10.0, 20.0, every_s).tolist()
    found = [display.at(second, HELD_M, TOP_MPS + by_kmh * KMH).now.mode for second in seconds]
    assert found == [Regime.CRUISE if second < 18.0 else back for second in seconds]


def test_a_change_that_was_announced_and_dropped_is_announced_anew(display: Shown) -> None:
    """The driver came back to the speed, and 6 s after the change would have been due he is too slow again."""
    display.at(0.0, HELD_M, TOP_MPS)
    slow_mps = TOP_MPS - 5.5 * KMH
    assert display.at(10.0, HELD_M, slow_mps).following[0].mode is Regime.REDUCED_TRACTION
    assert {display.at(float(second), HELD_M, TOP_MPS).following[0].mode for second in range(11, 24)} == {Regime.COAST}
    again = display.at(24.0, HELD_M, slow_mps)
    assert (again.now.mode, again.following[0].mode) == (Regime.CRUISE, Regime.REDUCED_TRACTION)
    assert again.following[0].in_s == pytest.approx(SETTINGS.announced_s)


def test_a_train_that_would_not_roll_down_to_the_speed_to_hold_brakes_to_it(display: Shown) -> None:
    """12 km/h too fast on the level, coasting would take minutes. The brake is announced, shown 3 s before it is due
    with the time to it, and then shown until the speed is reached; its effort is the same throughout."""
    display.at(0.0, HELD_M, TOP_MPS)
    states = [(10.0 + i, 12.0) for i in range(9)] + [(19.0, 7.0), (20.0, 3.0), (21.0, 1.2), (22.0, 0.5)]
    found = [display.at(second, HELD_M, TOP_MPS + by * KMH) for second, by in states]
    assert [one.now.mode for one in found] == [
        *[Regime.CRUISE] * 5, *[Regime.REDUCED_BRAKE] * 7, Regime.CRUISE,
    ]  # fmt: skip
    brakes = [one.following[0] for one in found[:5]] + [one.now for one in found[5:12]]
    assert [one.in_s for one in brakes] == pytest.approx([8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0, *[0.0] * 4], abs=1e-6)
    assert {(one.mode, one.speed_mps, one.effort_ratio) for one in brakes} == {
        (Regime.REDUCED_BRAKE, TOP_MPS, brakes[0].effort_ratio)
    }
    here, v_mps = section(), TOP_MPS + 12.0 * KMH
    braked_n = -brakes[0].effort_ratio * float(electric_limit(v_mps, here.train)) + here.resistance_n(HELD_M, v_mps)
    slowed_mps2 = 12.0 * KMH / SETTINGS.limit.brakes_back_in_s
    assert braked_n == pytest.approx(here.train.inertial_mass_kg * slowed_mps2, rel=0.1)
    display.showing.forget()
    assert display.at(100.0, HELD_M, TOP_MPS + 25.0 * KMH).now == brake_of(1.0, TOP_MPS), "no friction"


def test_a_brake_that_has_begun_too_soon_is_not_announced_again(display: Shown) -> None:
    """A train faster than its schedule is already braking to the speed to which the schedule brakes later."""
    node_m = section().node_m
    first, end = (int(np.searchsorted(node_m, at)) for at in (3300.0, 3700.0))
    phases = (
        Phase(PhaseKind.HOLD, 0.0, 0, TOP_MPS),
        Phase(PhaseKind.BRAKE, 0.4, first, 70 * KMH),
        Phase(PhaseKind.COAST, 0.0, end, 70 * KMH),
    )
    raw = Schedule(
        section=section(), phases=phases, known=known_run(section(), np.full(len(node_m), TOP_MPS)), back_share=0.7
    )
    schedule = raw.settled(0.0, 0.0)[0]
    brakes, state = ShownBrakes(schedule.section, SETTINGS), TrainState(0, 3200.0, 30.0)
    foreseen = Foreseen(np.array([0.0, 100.0]), np.array([3200.0, 6000.0]), np.array([28.0, 28.0]), as_shown=True)
    announced = Announcing(SETTINGS.ahead).following(schedule, 0, state.s_m, foreseen)
    assert [one.mode for one in announced] == [Regime.REDUCED_BRAKE, Regime.COAST]
    dues_s = [(schedule.begin_m(number) - state.s_m) / 28.0 for number in (1, 2)]
    assert [one.in_s for one in announced] == pytest.approx(dues_s)
    for speed_mps, modes in ((70 * KMH, [Regime.COAST]), (25.0, [Regime.REDUCED_BRAKE, Regime.COAST])):
        following = in_time(announced, brake_of(1.0, speed_mps), brakes, state, foreseen)
        assert [one.mode for one in following] == modes


def test_what_follows_a_brake_that_no_limit_asks_for_waits_for_its_speed_as_well() -> None:
    """A train far too fast is not told to coast where the schedule does, but once it has braked to its speed."""
    here, state = section(), TrainState(0, 3200.0, 30.0)
    brakes = ShownBrakes(here, SETTINGS)
    now = brakes.back_to(20.0, 1.0)
    announced = (Instruction(mode=Regime.COAST, speed_mps=20.0, effort_ratio=0.0, way_m=2.0, in_s=0.1),)
    foreseen = Foreseen(np.array([0.0, 100.0]), np.array([3200.0, 6000.0]), np.array([28.0, 28.0]), as_shown=True)
    lasts_s, lasts_m = brakes.lasts(now, state)
    for freely in (False, True):
        (first,) = in_time(announced, now, brakes, state, foreseen, freely=freely)
        assert (first.mode, first.in_s, first.way_m) == (Regime.COAST, lasts_s, lasts_m)


def test_a_speed_that_was_reached_is_held_while_the_schedule_still_accelerates(display: Shown) -> None:
    """The phase accelerates up to 1000 m; the train reaches its speed at 900 m, and then falls a little below it."""
    by_kmh = (-20.0, -1.0, -2.5, -4.5, -2.5, -4.5, -5.5)
    speeds = [TOP_MPS + by * KMH for by in by_kmh]
    held = [Regime.CRUISE] * 5
    assert display.modes(speeds, 900.0) == [Regime.REDUCED_TRACTION, *held, Regime.CRUISE]
    later = [display.at(second, HELD_M, TOP_MPS - 5.5 * KMH) for second in (20.0, 27.9, 28.0)]
    assert later[0].following[0].mode is Regime.REDUCED_TRACTION
    assert [one.now.mode for one in later] == [Regime.CRUISE, Regime.CRUISE, Regime.REDUCED_TRACTION]


def test_what_asks_for_more_waits_until_the_last_stood_a_while(display: Shown) -> None:
    """Holding changes to traction once it stood 8 s and traction was announced for 8 s more.

    Coasting waits as well, where it could not be foreseen because the position was corrected.
    """
    slow_mps = TOP_MPS - 5.5 * KMH
    assert display.at(0.0, HELD_M, TOP_MPS).now.mode is Regime.CRUISE
    for begin_s, s_m, stands, wanted in (
        (0.0, HELD_M, Regime.CRUISE, Regime.REDUCED_TRACTION),
        (16.1, 3100.0, Regime.REDUCED_TRACTION, Regime.COAST),
    ):
        for second in (0.1, 4.0, 7.9):
            found = display.at(begin_s + second, s_m, slow_mps)
            assert (found.now.mode, wanted in TRACTION and found.following[0].mode in TRACTION) == (stands, False)
        for second in (8.1, 12.0, 15.0):
            found = display.at(begin_s + second, s_m, slow_mps)
            assert (found.now.mode, found.following[0].mode) == (stands, wanted)
            assert found.following[0].in_s == pytest.approx(16.1 - second)
        assert display.at(begin_s + 16.0, s_m, slow_mps).now.mode is stands
        assert display.at(begin_s + 16.1, s_m, slow_mps).now.mode is wanted


def test_a_standing_clock_that_is_put_back_holds_nothing_up(display: Shown) -> None:
    """If the time is before the last one, the wanted instruction is shown at once, or announced at once for 8 s."""
    slow_mps = TOP_MPS - 5.5 * KMH
    assert display.at(100.0, 900.0, TOP_MPS - 20 * KMH).now.mode is Regime.REDUCED_TRACTION
    assert display.at(50.0, 900.0, TOP_MPS).now.mode is Regime.CRUISE
    for second in (30.0, 20.0):  # Put back, and again while the change is announced.
        soon = display.at(second, HELD_M, slow_mps)
        assert (soon.now.mode, soon.following[0].mode) == (Regime.CRUISE, Regime.REDUCED_TRACTION)
        assert soon.following[0].in_s == pytest.approx(SETTINGS.announced_s)
    assert [display.at(second, HELD_M, slow_mps).now.mode for second in (27.9, 28.0)] == [
        Regime.CRUISE, Regime.REDUCED_TRACTION,
    ]  # fmt: skip


def test_the_effort_of_a_brake_stands_within_the_band(display: Shown) -> None:
    """Less effort is shown only if 40 % less is needed. More is shown at once, enough for late reactions, and stays."""
    rate = display.schedule.braking_mps2(3)

    def effort(second: float, share: float) -> float:
        way_m = 600.0
        v_mps = math.sqrt(2.0 * share * rate * way_m)
        now = display.at(second, section().end_m - way_m, v_mps).now
        assert now.mode in BRAKES
        return now.effort_ratio

    first = effort(0.0, 1.0)
    assert -1.0 < first < 0.0
    assert [effort(20.0 * i, share) for i, share in enumerate((0.9, 0.95, 0.85), 1)] == [first] * 3
    more = effort(80.0, 1.1)
    assert more < first
    assert effort(80.5, 1.2) == more, "what it grew to is enough for a driver who answers late"
    assert effort(81.0, 1.7) < more, "more does not wait"
    assert effort(100.0, 1.4) == effort(120.0, 1.7)
    assert effort(140.0, 0.8) > more
    assert (first / SETTINGS.effort.step_ratio) == pytest.approx(round(first / SETTINGS.effort.step_ratio))


def test_a_brake_is_enough_for_its_board_though_its_phase_ends_behind_it() -> None:
    """A brake to 60 km/h for a board at 3000 m, in a phase that still holds 60 at 3150 m: the driver reads 3000 m.

    By hand from v² = 2·a·s: 100 to 60 km/h from 2200 m are 0.309 m/s² to the board.
    """
    line = section().route
    board = Restriction(start_m=3000.0, end_m=line.length_m, limit_mps=60 * KMH)
    limited = build_section(line.with_restrictions((board,)), section().vehicle)
    node_m = limited.node_m
    kinds = (PhaseKind.HOLD, PhaseKind.BRAKE, PhaseKind.COAST, PhaseKind.BRAKE)
    phases = tuple(
        Phase(kind, 0.0, int(np.searchsorted(node_m, at_m)), speed_kmh * KMH)
        for kind, at_m, speed_kmh in zip(kinds, (0.0, 2200.0, 3150.0, 5600.0), (100.0, 60.0, 55.0, 0.0), strict=True)
    )
    raw = Schedule(
        section=limited, phases=phases, known=known_run(limited, np.full(len(node_m), 60 * KMH)), back_share=1
    )
    schedule = raw.settled(0.0, TOP_MPS)[0]
    reached_m = schedule.reached_m(1, 2200.0)
    assert reached_m == pytest.approx(3000.0, abs=5.0)
    assert schedule.reached_m(1, reached_m) == schedule.begin_m(2)
    assert schedule.braking_mps2(1) == pytest.approx(0.309, rel=0.02)
    showing = Shown(Showing(SETTINGS), schedule)
    shown = showing.at(0.0, schedule.begin_m(1), TOP_MPS)
    assert shown.target_m == pytest.approx(reached_m - schedule.begin_m(1))
    share = shown.reference_force_n / electric_limit(TOP_MPS, limited.train)
    assert shown.now.effort_ratio <= share < 0.0
    s_m, v_mps, mass_kg, step_s = schedule.begin_m(1), TOP_MPS, limited.train.inertial_mass_kg, 0.1
    while s_m < 3000.0:  # Driven with that share of the motors, in small steps of time.
        forces_n = share * electric_limit(v_mps, limited.train) - limited.resistance_n(s_m, v_mps)
        v_mps, s_m = v_mps + step_s * forces_n / mass_kg, s_m + step_s * v_mps
    assert v_mps == pytest.approx(60 * KMH, abs=1.0 * KMH)


def test_an_acceleration_names_the_speed_of_the_next_if_it_gets_no_further() -> None:
    """To 110 km/h for 150 m, then to 100: who is at 45 km/h is told 100 at once, not 110, 105 and 100 in turn."""
    node_m = section().node_m
    phases = tuple(
        Phase(kind, share, int(np.searchsorted(node_m, at_m)), speed_kmh * KMH)
        for kind, share, at_m, speed_kmh in (
            (PhaseKind.TRACTION, 1.0, 0.0, 110.0), (PhaseKind.TRACTION, 0.5, 400.0, 100.0),
            (PhaseKind.HOLD, 0.0, 2500.0, 100.0), (PhaseKind.BRAKE, 0.0, 4800.0, 0.0),
        )
    )  # fmt: skip
    raw = Schedule(
        section=section(), phases=phases, known=known_run(section(), np.full(len(node_m), 5.0)), back_share=1
    )
    shown = Shown(Showing(SETTINGS), raw.settled(0.0, 10.0)[0]).at(0.0, 250.0, 45 * KMH).now
    assert (shown.mode, shown.speed_mps) == (Regime.FULL_TRACTION, pytest.approx(100 * KMH))


def test_a_brake_that_was_shown_instead_goes_on_until_its_speed_is_reached(display: Shown) -> None:
    """The last word has braked a train that was told to hold 100 km/h: the coach does not take the brake back."""
    assert display.at(0.0, HELD_M, TOP_MPS).now.mode is Regime.CRUISE
    display.showing.has_shown(brake_of(0.4, 95 * KMH), ns(9.0))
    assert display.at(10.0, HELD_M + 250.0, 98 * KMH).now == brake_of(0.4, 95 * KMH)
    assert display.at(11.0, HELD_M + 275.0, 95 * KMH).now.mode not in BRAKES
    display.showing.has_shown(Instruction(mode=Regime.COAST, speed_mps=80 * KMH, effort_ratio=0.0), ns(11.0))
    assert display.at(12.0, HELD_M + 300.0, 95 * KMH).now.mode is not Regime.COAST, "other acts are of one moment"


def test_who_has_braked_early_lets_it_roll_until_the_brake_is_due_again() -> None:
    """Towards a lower limit, and only where coasting is enough for it and the train is 8 km/h or more above it."""
    node_m = section().node_m
    kinds = (PhaseKind.TRACTION, PhaseKind.BRAKE, PhaseKind.HOLD, PhaseKind.BRAKE)
    phases = tuple(
        Phase(kind, share, int(np.searchsorted(node_m, at_m)), speed_kmh * KMH)
        for kind, share, at_m, speed_kmh in zip(
            kinds, (0.8, 0.0, 0.0, 0.0), (0.0, 2000.0, 4000.0, 5600.0), (100.0, 60.0, 60.0, 0.0), strict=True
        )
    )
    raw = Schedule(
        section=section(), phases=phases, known=known_run(section(), np.full(len(node_m), TOP_MPS)), back_share=0.7
    )
    schedule = raw.settled(0.0, 0.0)[0]
    end_m, ahead = schedule.begin_m(2), ShownBrakes(section(), SETTINGS).ahead

    def needed(way_m: float, v_kmh: float) -> tuple[float, bool]:
        """The share of the planned braking that is enough, and whether coasting is."""
        slowed_mps2 = ((v_kmh * KMH) ** 2 - (60 * KMH) ** 2) / (2.0 * way_m)
        return slowed_mps2 / schedule.braking_mps2(1), slowed_mps2 <= -ahead.rolls_mps2(end_m - way_m, v_kmh * KMH)

    for way_m, v_kmh, rolls, coasts in (
        (1900.0, 69.0, True, True),
        (1100.0, 72.0, False, False),
        (1900.0, 67.0, True, False),
    ):
        share, enough = needed(way_m, v_kmh)
        assert (share < SETTINGS.brake.early_ratio, enough) == (True, rolls)
        display = Shown(Showing(SETTINGS), schedule)
        assert display.at(0.0, schedule.begin_m(1) + 10.0, TOP_MPS).now.mode in BRAKES
        now = display.at(10.0, end_m - way_m, v_kmh * KMH).now
        assert now.speed_mps == pytest.approx(60 * KMH)
        assert now.mode is Regime.COAST if coasts else now.mode in BRAKES
    display = Shown(Showing(SETTINGS), schedule)
    display.at(0.0, schedule.begin_m(1) + 10.0, TOP_MPS)
    ways = (1900.0, 1200.0, 550.0, 370.0)
    assert [needed(way_m, 69.0)[0] > SETTINGS.brake.again_ratio for way_m in ways] == [False, False, False, True]
    modes = [display.at(10.0 * i, end_m - way_m, 69.0 * KMH).now.mode for i, way_m in enumerate(ways, 1)]
    assert modes[:3] == [Regime.COAST] * 3
    assert modes[3] in BRAKES


def test_who_has_braked_so_early_that_he_would_stand_short_of_the_stop_is_told_to_hold_a_low_speed(
    display: Shown,
) -> None:
    """Announced 8 s before, with the brake still shown; he holds it until he must brake again, and never coasts."""
    end_m, rate = section().end_m, display.schedule.braking_mps2(3)
    assert display.at(0.0, end_m - 600.0, math.sqrt(2.0 * rate * 600.0)).now.mode in BRAKES
    v_mps = math.sqrt(2.0 * 0.45 * rate * 590.0)
    assert 40 * KMH < v_mps < 45 * KMH
    for second in range(10, 18):
        found = display.at(float(second), end_m - 590.0, v_mps)
        assert found.now.mode in BRAKES
        assert found.following[0].mode is Regime.CRUISE
        assert found.following[0].speed_mps == pytest.approx(40 * KMH)
        assert found.following[0].in_s == pytest.approx(18.0 - second)
    held_mps = 40 * KMH
    holds = [display.at(18.0 + i, end_m - 580.0 + i * held_mps, held_mps) for i in range(45)]
    again = next(i for i, one in enumerate(holds) if one.now.mode in BRAKES)
    assert {(one.now.mode, round(one.now.speed_mps / KMH)) for one in holds[:again]} == {(Regime.CRUISE, 40)}
    assert all(one.following[0].mode in BRAKES for one in holds[:again])
    assert all(one.now.mode in BRAKES for one in holds[again:])
    ways = [580.0 - i * held_mps for i in (again - 1, again)]
    shares = [held_mps**2 / (2.0 * way_m * rate) for way_m in ways]
    assert shares[0] <= SETTINGS.brake.again_ratio < shares[1], "95 % of the planned braking"


def test_who_brakes_too_much_near_the_stop_goes_on_by_eye(display: Shown) -> None:
    """At 4 m/s 70 m before the stop the brake stays shown; one who would stand 8 m short of it is told to creep."""
    end_m = section().end_m
    display.at(0.0, end_m - 100.0, 10.0)
    soon = [display.at(10.0 + i, end_m - 70.0, 4.0) for i in range(20)]
    assert all(one.now.mode in BRAKES and not one.following for one in soon)
    creeps = [display.at(second, end_m - 40.0, 0.8).now for second in (40.0, 50.0)]
    assert {(one.mode, one.speed_mps) for one in creeps} == {(Regime.CRUISE, SETTINGS.brake.creep_mps)}
    assert display.at(60.0, end_m - 4.0, 3.0).now.mode in BRAKES


def test_no_low_speed_is_announced_for_where_the_driver_brakes_by_eye(display: Shown) -> None:
    """At 40 km/h, 380 m before the stop, he would be told so in 8 s; by then he is less than 300 m before it."""
    end_m, rate = section().end_m, display.schedule.braking_mps2(3)
    for left_m, announced in ((380.0, False), (480.0, True)):
        v_mps = math.sqrt(2.0 * 0.6 * rate * left_m)
        display.showing.forget()
        display.at(0.0, end_m - left_m - 60.0, math.sqrt(2.0 * rate * (left_m + 60.0)))
        found = display.at(10.0, end_m - left_m, v_mps)
        assert found.now.mode in BRAKES
        assert bool(found.following) is announced, left_m


def test_a_low_speed_to_hold_before_a_stop_is_one_speed(display: Shown) -> None:
    """A driver who keeps it within half a km/h is not told to hold a lower one."""
    end_m, rate = section().end_m, display.schedule.braking_mps2(3)
    display.at(0.0, end_m - 600.0, math.sqrt(2.0 * rate * 600.0))
    for second in range(10, 19):
        told = display.at(float(second), end_m - 590.0, math.sqrt(2.0 * 0.45 * rate * 590.0)).now
    assert told.mode is Regime.CRUISE
    assert told.speed_mps == pytest.approx(40 * KMH)
    held_mps = 40 * KMH - 0.1
    found = {display.at(19.0 + i, end_m - 580.0 + i * held_mps, held_mps).now.speed_mps for i in range(20)}
    assert found == {told.speed_mps}


def test_the_next_two_changes_are_named_in_their_order(display: Shown) -> None:
    """During acceleration these are coasting and braking (holding the speed reached does not count as a change)."""
    for second, (s_m, v_kmh) in enumerate([(10.0, 10), (500.0, 60), (900.0, 90)]):
        following = display.at(10.0 * second, s_m, v_kmh * KMH).following
        assert [one.mode for one in following[:1]] == [Regime.COAST]
        assert len(following) == 2
        assert following[1].mode in BRAKES
        assert [one.way_m for one in following] == pytest.approx([place - s_m for place in PLACES_M[2:]], abs=100.0)
        assert all(a.in_s < b.in_s for a, b in pairwise(following))
        assert following[0].in_s > 0.0
    assert display.at(100.0, 5500.0, 50 * KMH).following == ()


def test_the_time_to_a_change_is_that_of_the_forecast(display: Shown) -> None:
    """At 100 km/h the 1000 m to the start of coasting take 36 s."""
    shown = display.at(0.0, 2000.0, TOP_MPS)
    begin_m = display.schedule.begin_m(2)
    assert shown.following[0].in_s == pytest.approx((begin_m - 2000.0) / TOP_MPS, abs=0.1)
    assert (shown.target_m, shown.target_s) == pytest.approx((begin_m - 2000.0, shown.following[0].in_s), abs=0.1)


def test_a_phase_is_not_taken_up_again(display: Shown) -> None:
    """A train whose position is corrected back to before the start of coasting is still told to coast."""
    assert display.at(0.0, 3005.0, TOP_MPS).now.mode is Regime.COAST
    assert display.at(20.0, 2700.0, TOP_MPS).now.mode is Regime.COAST


def test_forces_of_instructions_are_those_that_the_train_has(display: Shown) -> None:
    """A share of the largest force at this speed; near the speed to reach, a force that does not overshoot it."""
    here, v_mps = section(), 20.0
    state, brakes = TrainState(0, 300.0, v_mps), ShownBrakes(section(), SETTINGS)
    traction = replace(display.at(0.0, 300.0, v_mps).now, speed_mps=27.0)
    assert traction.mode in TRACTION
    assert brakes.force_n(traction, state) == pytest.approx(0.8 * float(traction_limit(v_mps, here.train)))
    coast = replace(traction, mode=Regime.COAST, effort_ratio=0.0)
    assert brakes.force_n(coast, state) == 0.0
    brake = replace(traction, mode=Regime.REDUCED_BRAKE, effort_ratio=-0.5)
    assert brakes.force_n(brake, state) == pytest.approx(-0.5 * float(electric_limit(v_mps, here.train)))
    hold = replace(traction, mode=Regime.CRUISE, effort_ratio=math.nan, speed_mps=v_mps)
    resistance = float(here.vehicle.resistance.force_n(np.array([v_mps]))[0])
    assert brakes.force_n(hold, state) == pytest.approx(resistance, rel=1e-6)
    closing_n = here.train.inertial_mass_kg * 0.2 / SETTINGS.limit.closes_in_s
    assert brakes.force_n(replace(hold, speed_mps=v_mps - 0.2), state) == pytest.approx(resistance - closing_n)
    assert brakes.force_n(replace(traction, speed_mps=v_mps + 0.2), state) == pytest.approx(resistance + closing_n)


def test_a_speed_that_cannot_be_reached_any_more_is_not_shown_on(display: Shown) -> None:
    """The position was corrected; otherwise the instruction would stay for 8 s."""
    assert display.at(0.0, 500.0, 10.0).now.mode in TRACTION
    highest_mps = float(np.interp(5900.0, section().node_m, section().envelope_mps))
    assert highest_mps < 0.6 * TOP_MPS
    assert display.at(1.0, 5900.0, 0.3 * highest_mps).now.speed_mps <= highest_mps + 0.3


def test_the_speed_of_a_brake_does_not_stand_above_a_limit_between_two_brakes() -> None:
    """The position was corrected to beyond the first of two successive brakes, where the limit is lower."""
    node_m = section().node_m
    first, second = (int(np.searchsorted(node_m, at)) for at in (3000.0, 3300.0))
    phases = (
        Phase(PhaseKind.TRACTION, 0.8, 0, TOP_MPS),
        Phase(PhaseKind.BRAKE, 0.4, first, 25.0),
        Phase(PhaseKind.BRAKE, 0.4, second, 15.0),
        Phase(PhaseKind.HOLD, 0.0, int(np.searchsorted(node_m, 4000.0)), 15.0),
    )
    raw = Schedule(
        section=section(), phases=phases, known=known_run(section(), np.full(len(node_m), TOP_MPS)), back_share=0.7
    )
    display = Shown(Showing(SETTINGS), raw.settled(0.0, 0.0)[0])
    assert display.at(0.0, 3050.0, 27.0).now.mode in BRAKES
    place = SpeedsAllowed(20.0, 20.0)
    assert display.at(1.0, 3299.0, 18.0, place).now.speed_mps <= 20.0 + 0.3


def test_the_force_of_the_reference_brakes_along_the_curve_and_is_else_that_of_what_is_shown(display: Shown) -> None:
    """At 100 km/h the motors cannot brake as hard as a constant deceleration to the stop would need."""
    schedule = display.schedule
    known = display.at(0.0, 4800.0, schedule.speed_at(4800.0))
    force = known.reference_force_n
    assert known.now.mode in BRAKES
    assert known.force_n <= force
    assert -float(electric_limit(schedule.speed_at(4800.0), section().train)) <= force < 0.0
    held = display.at(60.0, 2000.0, TOP_MPS)
    assert held.number == known.number, "no phase is taken up again"
    fresh = Shown(Showing(SETTINGS), schedule)
    held = fresh.at(0.0, 2000.0, TOP_MPS)
    assert held.reference_force_n == held.force_n


def test_the_settings_are_those_that_this_file_counts_with() -> None:
    assert (SETTINGS.least_shown_s, SETTINGS.above_mps, SETTINGS.below_mps) == (8.0, 5 * KMH, 5 * KMH)
    assert DEFAULT.showing == SETTINGS


def test_a_short_brake_before_coasting_is_shown_to_its_end(display: Shown) -> None:
    """Coasting after a brake is not shown early: it would hide a brake that is shorter than that."""
    node_m = section().node_m
    first = int(np.searchsorted(node_m, 3000.0))
    last, begin_m = first + 1, float(node_m[first])
    coast, brake = (PhaseKind.COAST, 0.0), (PhaseKind.BRAKE, 0.0)
    short = (
        *display.schedule.phases[:2],
        Phase(*brake, first, 95 * KMH),
        Phase(*coast, last, 85 * KMH),
        display.schedule.phases[3],
    )
    shown = Shown(Showing(SETTINGS), replace(display.schedule, phases=short).settled(0.0, 0.0)[0])
    found = [shown.at(second, begin_m - 40.0 + 20.0 * second, 100 * KMH).now.mode for second in range(3)]
    assert {*found} <= {*BRAKES}
    assert shown.at(4.0, float(node_m[last]) + 10.0, 95 * KMH).now.mode is Regime.COAST


def test_the_force_of_a_brake_not_due_yet_is_that_with_which_it_begins(display: Shown) -> None:
    """So a driver who sees it up to a second early does not lose that second."""
    begin_m = display.schedule.begin_m(3)
    speed = display.schedule.speed_at(begin_m)
    soon = display.at(0.0, begin_m - 20.0, speed)
    assert soon.now.mode in BRAKES
    assert soon.reference_force_n < 0.0
    due = Shown(Showing(SETTINGS), display.schedule).at(0.0, begin_m, speed)
    assert soon.reference_force_n == pytest.approx(due.reference_force_n, rel=0.02)


def test_a_train_far_too_fast_is_told_to_brake_fully_whatever_the_schedule_brakes_with(display: Shown) -> None:
    """The schedule may brake too weakly for a limit that was not known when it was made."""
    place = SpeedsAllowed(15.0, 15.0)
    found = [display.at(i, 5000.0, 15.0 + over, place).now for i, over in enumerate((0.6, 1.6, 5.0))]
    assert all(one.mode in BRAKES for one in found[1:])
    assert found[2].effort_ratio <= -1.0
    assert found[2].effort_ratio < found[1].effort_ratio


def two_steps(kind: PhaseKind, share: float, second_mps: float) -> Shown:
    """A schedule to show: accelerate, brake to 70 km/h (km 3.0 to 3.2), and go on to another speed."""
    node_m = section().node_m
    begins = [int(np.searchsorted(node_m, at)) for at in (0.0, 3000.0, 3200.0, 4500.0)]
    phases = (
        Phase(PhaseKind.TRACTION, 0.8, begins[0], 25.0),
        Phase(PhaseKind.BRAKE, 0.0, begins[1], 70 * KMH),
        Phase(kind, share, begins[2], second_mps),
        Phase(PhaseKind.BRAKE, 0.0, begins[3], 0.0),
    )
    raw = Schedule(
        section=section(), phases=phases, known=known_run(section(), np.full(len(node_m), 20.0)), back_share=0.7
    )
    return Shown(Showing(SETTINGS), raw.settled(0.0, 0.0)[0])


def test_a_brake_to_a_lower_speed_behind_a_brake_does_not_wait() -> None:
    """The second brake is due as soon as it is shown, although the first was shown for only a second.

    Without a brake before it, it is shown some 3 s before it is due, with way and time to it.
    """
    display, v_mps = two_steps(PhaseKind.BRAKE, 0.0, 35 * KMH), 74 * KMH
    end_m = display.schedule.begin_m(2)
    first = display.at(0.0, end_m - 78.0, v_mps)
    assert first.now.mode in BRAKES
    assert first.now.speed_mps == pytest.approx(70 * KMH)
    assert first.following[0].mode in BRAKES
    assert first.following[0].speed_mps == pytest.approx(35 * KMH)
    shown = display.at(1.0, end_m - 57.0, v_mps).now
    assert shown.mode in BRAKES
    assert shown.speed_mps == pytest.approx(35 * KMH)
    assert (shown.in_s, shown.way_m) == (0.0, 0.0)  # The driver keeps the brake applied.
    fresh = Shown(Showing(SETTINGS), display.schedule).at(1.0, end_m - 57.0, v_mps).now
    assert (fresh.mode in BRAKES, fresh.speed_mps) == (True, shown.speed_mps)
    assert (fresh.in_s, fresh.way_m) == pytest.approx((57.0 / v_mps, 57.0), rel=0.1)


@pytest.mark.parametrize(("limit_mps", "shown"), [(40.0, True), (20.5, False)])
def test_an_acceleration_is_shown_before_it_is_due_where_the_limit_allows_its_speed(
    limit_mps: float, shown: bool
) -> None:
    schedule = two_steps(PhaseKind.TRACTION, 0.6, 30.0).schedule
    held = replace(
        schedule, phases=(schedule.phases[0], schedule.phases[1]._replace(kind=PhaseKind.HOLD), *schedule.phases[2:])
    )
    display = Shown(Showing(SETTINGS), held)
    place = SpeedsAllowed(limit_mps, limit_mps)
    assert display.at(0.0, 3100.0, 20.0, place).now.mode is Regime.CRUISE
    soon = display.at(10.0, held.begin_m(2) - 30.0, 20.0, place)
    assert (soon.now.mode in TRACTION) is shown
    assert soon.now.speed_mps <= limit_mps


@pytest.mark.parametrize(("way_m", "creeps"), [(40.0, True), (8.0, False), (0.6, False)])
def test_a_train_that_would_stand_short_of_its_stop_is_told_to_creep(
    display: Shown, way_m: float, creeps: bool
) -> None:
    """At 0.5 m/s the train would stop within a metre if it braked."""
    shown = display.at(0.0, section().end_m - way_m, 0.5).now
    assert (shown.mode is Regime.CRUISE) is creeps
    assert shown.mode is Regime.CRUISE or shown.mode in BRAKES


def test_a_creeping_train_is_told_no_speed_that_the_stop_does_not_allow(display: Shown) -> None:
    """The train was told to creep 40 m before its stop; then its position is corrected to 2.5 m before it."""
    assert display.at(0.0, section().end_m - 40.0, 0.5).now.mode is Regime.CRUISE
    allowed_mps = float(np.interp(section().end_m - 2.5, section().node_m, section().envelope_mps))
    assert allowed_mps < 0.8 * SETTINGS.brake.creep_mps
    assert display.at(20.0, section().end_m - 2.5, 0.8).now.speed_mps <= allowed_mps + 0.3


def shown_of(*phases: tuple[PhaseKind, float, float], showing: Showing | None = None) -> Shown:
    """A schedule to show, made of exactly these phases (kind, place in m, target speed in m/s)."""
    node_m = section().node_m
    shares = {PhaseKind.TRACTION: 0.7}
    made = tuple(
        Phase(kind, shares.get(kind, 0.0), int(np.searchsorted(node_m, at_m)), target) for kind, at_m, target in phases
    )
    known = known_run(section(), np.full(len(node_m), 20.0))
    return Shown(showing or Showing(SETTINGS), Schedule(section=section(), phases=made, known=known, back_share=0.7))


@pytest.mark.parametrize("kind", [PhaseKind.HOLD, PhaseKind.COAST, PhaseKind.TRACTION])
def test_no_speed_is_shown_above_what_the_line_allows_on_the_way_of_a_phase(kind: PhaseKind) -> None:
    """A schedule may have a higher one if a limit came too late, or slows the train without a phase to brake for it."""
    allowed = section().envelope_mps
    display = shown_of((kind, 0.0, 90.0), (PhaseKind.BRAKE, 4700.0, 0.0))
    for second, s_m in enumerate((2000.0, 4000.0)):
        assert display.at(20.0 * second, s_m, 20.0).now.speed_mps <= allowed.max() + 1e-9
    announced = shown_of((PhaseKind.HOLD, 0.0, 20.0), (kind, 2500.0, 90.0), (PhaseKind.BRAKE, 4700.0, 0.0))
    assert announced.at(0.0, 2000.0, 20.0).following[0].speed_mps <= allowed.max() + 1e-9


def test_coasting_does_not_stand_to_a_speed_that_the_end_of_its_phase_does_not_allow() -> None:
    """The phase of a new reference ends nearer to the stop; otherwise the instruction would stay for 8 s."""
    coasts = shown_of((PhaseKind.COAST, 0.0, 25.0), (PhaseKind.BRAKE, 4700.0, 0.0))
    assert coasts.at(0.0, 4500.0, 25.0).now.speed_mps == pytest.approx(25.0)
    end_m = section().end_m - 120.0
    allowed = float(np.interp(end_m, section().node_m, section().envelope_mps))
    assert allowed < 20.0
    holds = shown_of((PhaseKind.HOLD, 0.0, 15.0), (PhaseKind.BRAKE, end_m, 0.0), showing=coasts.showing)
    assert holds.at(1.0, 4530.0, 15.0).now.mode is Regime.CRUISE


def test_coasting_does_not_stand_to_a_speed_above_the_limit_of_its_place() -> None:
    """However short a time it has been shown."""
    coasts = shown_of((PhaseKind.COAST, 0.0, 25.0), (PhaseKind.BRAKE, 4700.0, 0.0))
    assert coasts.at(0.0, 4500.0, 25.0).now.speed_mps == pytest.approx(25.0)
    now = coasts.at(1.0, 4520.0, 15.0, SpeedsAllowed(18.0, 18.0)).now
    assert now.speed_mps <= 18.0 + SAME_READING_MPS


def test_coasting_that_leads_to_another_speed_says_that_speed() -> None:
    """A train that begins to coast 30 km/h below its schedule is not told the speed to which the schedule coasts."""
    coasts = shown_of((PhaseKind.COAST, 0.0, 25.0), (PhaseKind.BRAKE, 4700.0, 0.0))
    assert coasts.at(0.0, 4300.0, 25.0).now.speed_mps == pytest.approx(25.0)
    slow = [coasts.at(10.0 + i, 4310.0 + 17.0 * i, 17.0 - 0.02 * i).now for i in range(20)]
    assert {one.mode for one in slow} == {Regime.COAST}
    assert {round(one.speed_mps / KMH) for one in slow} <= {55, 60}
    assert coasts.at(40.0, 4620.0, 15.6).now.speed_mps == slow[-1].speed_mps, "at its end the speed stays"
    assert coasts.at(41.0, 4630.0, 14.5).now.speed_mps < slow[-1].speed_mps, "but not if it would be missed by 5 km/h"


def test_coasting_back_that_a_limit_ends_says_the_speed_where_it_brakes() -> None:
    """From 102 back to 95 km/h would take a minute; the brake for a board comes after 22 s, at 99.8 km/h."""
    board = Restriction(start_m=2400.0, end_m=section().end_m, limit_mps=60 * KMH)
    limited = build_section(section().route.with_restrictions((board,)), section().vehicle)
    node_m = limited.node_m
    phases = (Phase(PhaseKind.HOLD, 0.0, 0, 95 * KMH), Phase(PhaseKind.BRAKE, 0.0, len(node_m) - 300, 0.0))
    raw = Schedule(section=limited, phases=phases, known=known_run(limited, np.full(len(node_m), 16.0)), back_share=0.7)
    shown = Shown(Showing(SETTINGS), raw.settled(0.0, 95 * KMH)[0])
    shown.at(-20.0, 1000.0, 95 * KMH)
    told = [shown.at(i, 1300.0 + 28.0 * i, (102 - 0.1 * i) * KMH).now for i in range(30)]
    coasts = [round(one.speed_mps / KMH) for one in told if one.mode is Regime.COAST]
    assert sorted(set(coasts)) == [95, 100]
    assert (coasts[0], coasts[-1]) == (95, 100)
    assert told[len(coasts)].mode in BRAKES


def test_coasting_back_beyond_the_speed_told_says_the_speed_that_is_then_held() -> None:
    coasts = shown_of((PhaseKind.COAST, 0.0, 95 * KMH), (PhaseKind.BRAKE, 2050.0, 80 * KMH))
    assert coasts.at(0.0, 1300.0, 98 * KMH).now.speed_mps == pytest.approx(95 * KMH)
    holds = shown_of((PhaseKind.HOLD, 0.0, 90 * KMH), (PhaseKind.BRAKE, 4700.0, 0.0), showing=coasts.showing)
    told = [holds.at(10.0 + i, 1550.0 + 26.0 * i, (97 - 0.25 * i) * KMH).now for i in range(40)]
    said = [(one.mode, round(one.speed_mps / KMH)) for one in told]
    assert set(said[:24]) == {(Regime.COAST, 90)}
    assert said[-1] == (Regime.CRUISE, 90)


def at_rising_limit(*phases: tuple[PhaseKind, float, float]) -> Shown:
    """A schedule of these phases (kind, place in m, km/h) where the limit rises from 80 to 100 km/h, at km 29.92."""
    here = section_of(("zurich-luzern", 2))
    made = tuple(Phase(kind, 1.0, int(np.searchsorted(here.node_m, at_m)), v * KMH) for kind, at_m, v in phases)
    known = known_run(here, np.full(len(here.node_m), 80 * KMH))
    return Shown(Showing(SETTINGS), Schedule(section=here, phases=made, known=known, back_share=0.7))


RISES_M = 29920.0
BELOW_RISE = SpeedsAllowed(80 * KMH, 80 * KMH)


def test_an_acceleration_that_its_limit_does_not_allow_yet_is_announced_where_the_limit_rises() -> None:
    """A train at its limit is not told to accelerate to that limit; a slower one is, and to both speeds in turn."""
    rises = at_rising_limit((PhaseKind.HOLD, 29000.0, 80), (PhaseKind.TRACTION, RISES_M - 200.0, 100))
    for v_kmh, told in ((79, [(100, 400.0)]), (70, [(80, 200.0), (100, 400.0)])):
        times_s = np.array([0.0, 1000.0 / (v_kmh * KMH)])
        at_m = RISES_M - 400.0 + np.array([0.0, 1000.0])
        foreseen = Foreseen(times_s, at_m, np.full(2, v_kmh * KMH), as_shown=True)
        following = Announcing(2).following(rises.schedule, 0, RISES_M - 400.0, foreseen)
        assert len(following) == len(told)
        for one, (told_kmh, ahead_m) in zip(following, told, strict=True):
            assert one.mode in TRACTION
            assert one.speed_mps == pytest.approx(told_kmh * KMH)
            assert one.way_m == pytest.approx(ahead_m, abs=60.0)
            assert one.in_s == pytest.approx(one.way_m / (v_kmh * KMH))


def test_a_speed_that_is_held_past_a_board_that_allows_more_is_no_acceleration() -> None:
    held = at_rising_limit((PhaseKind.HOLD, 29000.0, 80), (PhaseKind.COAST, RISES_M + 1500.0, 0))
    at_m = RISES_M - 400.0 + np.array([0.0, 3000.0])
    foreseen = Foreseen(np.array([0.0, 136.0]), at_m, np.full(2, 79 * KMH), as_shown=True)
    following = Announcing(2).following(held.schedule, 0, RISES_M - 400.0, foreseen)
    assert [one.mode for one in following] == [Regime.COAST]


def test_an_acceleration_stays_announced_though_the_schedule_holds_its_speed_soon_after_the_board() -> None:
    """The schedule accelerates before the board and holds 100 km/h 60 m behind it; this train is still at 79 km/h."""
    rises = at_rising_limit(
        (PhaseKind.HOLD, 29000.0, 80),
        (PhaseKind.TRACTION, RISES_M - 200.0, 100),
        (PhaseKind.HOLD, RISES_M + 60.0, 100),
    )
    at_m = RISES_M - 150.0 + np.array([0.0, 2000.0])
    foreseen = Foreseen(np.array([0.0, 90.0]), at_m, np.full(2, 79 * KMH), as_shown=True)
    (first,) = Announcing(2).following(rises.schedule, 1, RISES_M - 150.0, foreseen)
    assert first.mode in TRACTION
    assert first.speed_mps == pytest.approx(100 * KMH)
    assert first.way_m == pytest.approx(150.0, abs=60.0)


def test_an_acceleration_goes_on_where_the_next_one_follows_within_8_s() -> None:
    """Otherwise its speed would have to be held for 8 s, and the train would accelerate too late behind the board."""
    for left_s, mode in ((4.0, Regime.FULL_TRACTION), (20.0, Regime.CRUISE)):
        rises = at_rising_limit((PhaseKind.TRACTION, 28800.0, 100))
        begins_m = RISES_M - (left_s + 12.0) * 78.4 * KMH
        for i in range(13):
            now = rises.at(float(i), begins_m + 78.4 * KMH * i, (70 + 0.7 * i) * KMH, BELOW_RISE).now
        assert now.speed_mps == pytest.approx(80 * KMH)
        assert now.mode is mode


def test_an_announced_change_that_waits_for_what_is_shown_to_have_stood_stays_announced() -> None:
    begins_m = 2000.0
    rises = shown_of(
        (PhaseKind.COAST, 0.0, 20.0),
        (PhaseKind.HOLD, begins_m - 120.0, 20.0),
        (PhaseKind.TRACTION, begins_m, 25.0),
    )
    shown = [rises.at(float(i), begins_m - 300.0 + 20.0 * i, 20.0) for i in range(25)]
    held = next(i for i, one in enumerate(shown) if one.now.mode is Regime.CRUISE)
    begun = next(i for i, one in enumerate(shown) if one.now.mode in TRACTION)
    assert begun - held == round(SETTINGS.least_shown_s)
    assert all(one.following[0].mode in TRACTION for one in shown[held:begun])
    assert shown[begun - 2].following[0].in_s == pytest.approx(2.0, abs=0.5)


def test_coasting_that_a_brake_ends_says_the_speed_at_which_the_brake_begins() -> None:
    """The schedule coasts to 15 m/s, but this train is faster and comes to the braking curve before."""
    end_m = float(np.interp(-16.0, -section().envelope_mps[-200:], section().node_m[-200:]))
    coasts = shown_of((PhaseKind.COAST, 0.0, 15.0), (PhaseKind.BRAKE, end_m, 0.0))
    shown = coasts.at(0.0, 4300.0, 28.0)
    meets_m = 4300.0 + shown.target_m
    assert shown.now.mode is Regime.COAST
    assert meets_m < end_m
    allowed_mps = float(np.interp(meets_m, section().node_m, section().envelope_mps))
    assert abs(allowed_mps - shown.now.speed_mps) < TARGET_STEP_MPS
    assert shown.following[0].mode in BRAKES


def test_a_train_at_the_limit_that_gets_slower_coasts_on_and_one_that_rolls_up_to_it_holds_it() -> None:
    coasts = shown_of((PhaseKind.COAST, 0.0, 20.0), (PhaseKind.BRAKE, 4700.0, 0.0))
    for v_mps, mode in ((25.0 + 0.3 * KMH, Regime.COAST), (25.0 + 3.0 * KMH, Regime.CRUISE)):
        assert coasts.at(0.0, 2000.0, v_mps, SpeedsAllowed(25.0, 25.0)).now.mode is mode


def test_coasting_to_the_speed_held_next_is_not_shown_to_a_train_that_is_slower() -> None:
    """It would only become slower still, and would have to accelerate again."""
    for held_mps, mode in ((25.0, Regime.CRUISE), (20.0, Regime.COAST)):
        coasts = shown_of((PhaseKind.COAST, 0.0, 25.0), (PhaseKind.HOLD, 3000.0, held_mps))
        assert coasts.at(0.0, 2000.0, 26.0).now.mode is Regime.COAST
        assert coasts.at(10.0, 2200.0, 24.0).now.mode is mode


@pytest.mark.parametrize("s_m", [29462.0, 29705.0, 29895.0])
def test_on_a_slight_descent_that_does_not_reach_the_speed_held_next_it_is_held_at_once(s_m: float) -> None:
    """The train gains some 0.01 m/s² at first, and would end slower than it must go on."""
    here = section_of(("zurich-luzern", 2))
    begin, end = np.searchsorted(here.node_m, [s_m - 100.0, s_m + 2000.0]).tolist()
    phases = (Phase(PhaseKind.COAST, 0.0, begin, 20.0), Phase(PhaseKind.HOLD, 0.0, end, 20.0))
    known = known_run(here, np.full(len(here.node_m), 20.0))
    schedule = Schedule(section=here, phases=phases, known=known, back_share=0.7)
    shown = Shown(Showing(SETTINGS), schedule).at(0.0, s_m, 18.0, SpeedsAllowed(30.0, 30.0)).now
    assert shown.mode is Regime.CRUISE
    assert shown.speed_mps == pytest.approx(70 * KMH)


def test_a_driver_to_whom_nothing_was_shown_for_long_is_told_anew() -> None:
    """After an interruption the last instruction does not stand for a while longer; after a short gap it does."""
    for gap_s, mode in ((5.0, Regime.CRUISE), (20.0, Regime.REDUCED_TRACTION)):
        rises = shown_of((PhaseKind.HOLD, 0.0, 15.0), (PhaseKind.TRACTION, 2000.0, 25.0), (PhaseKind.HOLD, 4e3, 25.0))
        assert rises.at(0.0, 1900.0, 15.0).now.mode is Regime.CRUISE
        assert rises.at(gap_s, 2200.0, 15.0).now.mode is mode


def test_a_driver_who_rolls_up_to_the_speed_to_hold_is_not_told_to_hold_it_yet() -> None:
    coasts = shown_of((PhaseKind.COAST, 0.0, 25.0), (PhaseKind.HOLD, 3000.0, 25.0))
    assert coasts.at(0.0, 2900.0, 25.6).now.mode is Regime.COAST
    assert coasts.at(20.0, 3200.0, 24.0).now.mode is Regime.CRUISE, "on the level it would never get there"


def test_a_brake_is_announced_where_a_train_faster_than_its_schedule_comes_to_the_curve(display: Shown) -> None:
    """It is announced before the place where the schedule brakes, but not before the train can be at the curve."""
    curve_mps, node_m, from_m = section().envelope_mps, section().node_m, 3200.0
    begin_m = display.schedule.begin_m(3)
    fast_mps = float(np.interp(begin_m - 400.0, node_m, curve_mps))
    held_m = float(node_m[np.argmax((curve_mps < fast_mps) & (node_m > from_m))])
    announced = display.at(0.0, from_m, fast_mps, SpeedsAllowed(fast_mps, fast_mps)).following[0]
    assert announced.mode in BRAKES
    assert held_m - 20.0 <= from_m + announced.way_m <= begin_m - 100.0


def efforts_to_70_kmh(states: list[tuple[float, float, float]]) -> list[tuple[float, float]]:
    """For each state (second, distance to go in m, km/h), the effort shown to brake to 70 km/h and the one needed.

    Both are shares of the first effort shown.
    """
    display, found = Shown(Showing(SETTINGS), brake_to_70_kmh().schedule), []
    end_m = display.schedule.begin_m(2)
    ahead = ShownBrakes(section(), SETTINGS).ahead
    for second, way_m, v_kmh in states:
        now = display.at(second, end_m - way_m, v_kmh * KMH).now
        assert now.mode in BRAKES
        assert now.speed_mps == pytest.approx(70 * KMH)
        found.append((-now.effort_ratio, ahead.effort_to(end_m - way_m, v_kmh * KMH, end_m, 70 * KMH)))
    first = found[0][0]
    assert first <= 1.0
    return [(shown / first, needed / first) for shown, needed in found]


def brake_to_70_kmh() -> Shown:
    """A schedule to show: hold 90 km/h, brake to 70 km/h (km 3.0 to 3.6), hold that, brake to the stop."""
    return shown_of(
        (PhaseKind.HOLD, 0.0, 90 * KMH), (PhaseKind.BRAKE, 3000.0, 70 * KMH),
        (PhaseKind.HOLD, 3600.0, 70 * KMH), (PhaseKind.BRAKE, 5000.0, 0.0),
    )  # fmt: skip


def test_a_train_nearly_at_the_speed_of_a_brake_brakes_on_to_it() -> None:
    """It is shown less effort only where 40 % less is needed and the last stood 8 s.

    Never in the last 6 s before the speed, nor in the last 2 km/h above it.
    """
    found = efforts_to_70_kmh([(0.0, 400.0, 90.0), *[(second, 400.0, 86.5) for second in (1.0, 4.0, 7.9, 8.1)]])
    assert all(0.5 < needed < 0.6 for _, needed in found[1:])
    assert [shown for shown, _ in found[:4]] == [1.0] * 4
    assert 0.5 <= found[4][0] < 0.7
    for near in ([(9.0, 120.0, 75.0), (18.0, 100.0, 73.0)], [(9.0, 200.0, 71.7), (18.0, 150.0, 71.3)]):
        found = efforts_to_70_kmh([(0.0, 300.0, 90.0), *near])
        assert all(needed < 0.4 for _, needed in found[1:])
        assert [shown for shown, _ in found] == [1.0] * 3


def test_a_brake_weaker_than_needed_is_replaced_and_a_stronger_one_stays() -> None:
    here, brakes = section(), ShownBrakes(section(), SETTINGS)
    s_m = here.end_m - 400.0
    v_mps = float(np.interp(s_m, here.node_m, here.envelope_mps))
    state = TrainState(0, s_m, v_mps)
    needed = brakes.ahead.needed(s_m, v_mps).effort
    weak = brake_of(0.5 * needed, 0.0)
    assert -brakes.safe(weak, state, v_mps).effort_ratio >= needed
    strong = brake_of(1.2 * needed, 0.0)
    assert brakes.safe(strong, state, v_mps) is strong


def test_the_effort_stands_in_the_last_metres_while_the_train_stands_near_the_mark(display: Shown) -> None:
    """In the last 10 m the effort stays if the train will stop near the mark; else it grows by 20 % or is released."""
    end_m, rate = section().end_m, display.schedule.braking_mps2(3)

    def effort(second: float, left_m: float, share: float) -> float:
        return display.at(second, end_m - left_m, math.sqrt(2.0 * share * rate * left_m)).now.effort_ratio

    far = effort(-20.0, 60.0, 1.0)
    state = TrainState(0, end_m - 60.0, math.sqrt(2.0 * rate * 60.0))
    beyond = 62.5 / ShownBrakes(section(), SETTINGS).lasts(brake_of(-far, 0.0), state)[1]
    assert effort(-19.0, 60.0, beyond) < far, "2.5 m beyond the mark, seen from 60 m before it"
    display.showing.forget()
    first = effort(0.0, 30.0, 1.0)
    assert [effort(3.0, 9.0, share) for share in (0.9, 1.1, 1.2)] == [first] * 3, "the driver sees the mark"
    more = effort(4.0, 9.0, 1.45)
    assert more == pytest.approx(first - 0.2), "it stands more than 3 m beyond"
    assert effort(5.0, 6.0, 1.9) == more
    assert effort(6.0, 9.0, 0.2) > first, "it stands more than 2 m before"


def test_a_brake_that_must_grow_asks_for_friction_only_where_the_motors_are_not_enough_soon(display: Shown) -> None:
    """A driver who reacts in 4 s needs more effort than one who brakes now, but is shown at most 1.6 times as much."""
    end_m, rate = section().end_m, display.schedule.braking_mps2(3)

    def effort(second: float, left_m: float, share: float) -> float:
        return -display.at(second, end_m - left_m, math.sqrt(2.0 * share * rate * left_m)).now.effort_ratio

    first = effort(0.0, 600.0, 1.0)
    needed = ShownBrakes(section(), SETTINGS).ahead.effort_to(
        end_m - 600.0, math.sqrt(2.0 * 1.1 * rate * 600.0), end_m, 0.0
    )
    more = effort(1.0, 600.0, 1.1)
    assert 1.05 * needed < more <= 1.6 * needed + SETTINGS.effort.step_ratio
    assert first < more <= 1.0
    assert effort(2.0, 600.0, 3.5) in (1.5, 2.0, 2.5, 3.0), "friction is shown in halves"


def test_a_brake_that_must_be_stronger_for_a_limit_on_its_way_names_that_limit() -> None:
    """The card names what is next, so that a driver who brakes by eye does not look past it, to the stop."""
    here = section_of(BUNDLED[1])
    brakes = ShownBrakes(here, SETTINGS)
    falls = np.flatnonzero(np.diff(here.envelope_mps) < -0.05)
    state = next(
        TrainState(ns(0), float(here.node_m[k]), float(here.envelope_mps[k]))
        for k in falls
        if 1.0 < brakes.ahead.needed(float(here.node_m[k]), float(here.envelope_mps[k])).target_mps < math.inf
    )
    needed = brakes.ahead.needed(state.s_m, state.v_mps)
    found = brakes.safe(brake_of(0.05, 0.0), state, state.v_mps)
    assert (found.speed_mps, -found.effort_ratio >= needed.effort) == (needed.target_mps, True)
    assert brakes.safe(brake_of(0.05, 40.0), state, state.v_mps).speed_mps == needed.target_mps


def test_a_brake_that_has_not_begun_needs_more_by_the_build_up(display: Shown) -> None:
    """The train runs unbraked for half of the build-up time; a brake already shown has built up."""
    schedule, begin_m = display.schedule, display.schedule.begin_m(3)
    braking, state = schedule.section.braking, TrainState(ns(0), begin_m, schedule.speed_at(begin_m))
    assert braking is not None
    brakes = ShownBrakes(schedule.section, SETTINGS)
    new = brakes.needed(schedule, 3, state, 0.0, begun=False)
    later_m = begin_m + 0.5 * braking.build_up_s * state.v_mps
    assert new.effort == brakes.ahead.effort_to(later_m, state.v_mps, section().end_m, 0.0)
    brakes.shown(new, state)
    assert brakes.needed(schedule, 3, state, 0.0, begun=True).effort < new.effort


def test_a_brake_to_a_lower_speed_begins_as_strong_as_a_late_answer_needs() -> None:
    """It is enough for a driver who reacts after 4 s; a brake to a stop, which is long, begins with what is needed."""
    brakes, end_m, v_mps = ShownBrakes(section(), SETTINGS), section().end_m, 75 * KMH
    state = TrainState(ns(0), end_m - 3300.0, v_mps)
    found = []
    for at_m, target_mps in ((end_m - 3000.0, 60 * KMH), (end_m - 2500.0, 0.0)):
        needed, answered = (
            brakes.ahead.effort_to(state.s_m + late_s * v_mps, v_mps, at_m, target_mps)
            for late_s in (0.0, SETTINGS.effort.answered_in_s)
        )
        assert needed < answered < SETTINGS.effort.grown_ratio * needed
        first = -brakes.shown(NeededBrake(needed, target_mps, at_m), state).effort_ratio
        found.append((first >= needed, first >= answered))
    assert found == [(True, True), (True, False)]


def test_before_a_brake_begins_its_effort_does_not_fall_and_it_allows_for_a_driver_who_is_2_s_late() -> None:
    """It is shown 5 s before it begins; then the train becomes slower, so that less than 60 % of it would be enough."""
    brakes, at_m, v_mps = ShownBrakes(section(), SETTINGS), section().end_m - 3000.0, 90 * KMH
    begin_m = at_m - 450.0
    state = TrainState(ns(0), begin_m - 5.0 * v_mps, v_mps)
    needed, late = (brakes.ahead.effort_to(begin_m + s * v_mps, v_mps, at_m, 60 * KMH) for s in (0.0, 2.0))
    first = brakes.shown(NeededBrake(needed, 60 * KMH, at_m), state, begin_m).effort_ratio
    assert late <= -first < late + SETTINGS.effort.step_ratio
    less = NeededBrake(0.55 * -first, 60 * KMH, at_m)
    slower = state._replace(now_ns=ns(2), v_mps=80 * KMH)
    assert brakes.shown(less, slower, begin_m).effort_ratio == first
    assert brakes.shown(less, slower._replace(s_m=begin_m + 1.0), begin_m).effort_ratio > first


def test_a_brake_for_the_stop_keeps_its_effort_while_hardly_any_is_lacking() -> None:
    """Up to 5 %; not in the last 300 m, where the train would pass its mark."""
    brakes, end_m = ShownBrakes(section(), SETTINGS), section().end_m
    for way_m, same in ((900.0, True), (250.0, False)):
        state = TrainState(ns(0), end_m - way_m, 75 * KMH)
        first = brakes.shown(NeededBrake(0.6, 0.0, end_m), state).effort_ratio
        more = brakes.shown(NeededBrake(0.62, 0.0, end_m), state).effort_ratio
        assert (more == first) is same


def test_a_brake_of_the_schedule_that_begins_in_time_is_not_replaced_by_a_later_and_harder_one() -> None:
    """It is enough from where it begins, 2 s from now; the curve of full braking would be met only after that."""
    here = section()
    brakes, v_mps = ShownBrakes(here, SETTINGS), 75 * KMH
    curve_m = brakes.ahead.curve_begins_m(2000.0, np.full(int((here.node_m > 2000.0).sum()), v_mps))
    state = TrainState(0, curve_m - 4.0 * v_mps, v_mps)
    enough = brake_of(1.01 * brakes.ahead.needed(state.braked_m + 2.0 * v_mps, v_mps).effort, 0.0)
    assert brakes.safe(enough, state, v_mps, begun=False, begins_s=2.0) is enough
    weak = brake_of(0.9 * -enough.effort_ratio, 0.0)
    assert brakes.safe(weak, state, v_mps, begun=False, begins_s=2.0).effort_ratio < enough.effort_ratio


def test_a_limit_that_only_a_faster_train_would_brake_for_is_held_and_no_far_brake_is_shown() -> None:
    """At 124.5 km/h and accelerating, 100 m before 125 km/h: it once said "brake 100" for a board 68 s away."""
    here = section_of(("zurich-luzern", 2))
    brakes, state = ShownBrakes(here, SETTINGS), TrainState(0, 47496.0, 124.5 * KMH)
    accelerates = Instruction(mode=Regime.REDUCED_TRACTION, speed_mps=140 * KMH, effort_ratio=0.4)
    shown = brakes.safe(accelerates, state, state.v_mps, begun=False)
    assert (shown.mode, round(shown.speed_mps / KMH)) == (Regime.CRUISE, 125)
    slower = brakes.safe(accelerates, state._replace(v_mps=122.5 * KMH), state.v_mps, begun=False)
    assert slower.mode not in BRAKES


def test_a_slow_train_that_accelerates_passes_a_lower_limit_without_a_brake() -> None:
    """At 40 km/h, 50 m before a limit of 125 km/h, it was told to accelerate to 135 and to brake to 125 at once."""
    here = section_of(("zurich-luzern", 2))
    begins = [int(np.searchsorted(here.node_m, at)) for at in (46900.0, 56000.0)]
    phases = (Phase(PhaseKind.TRACTION, 1.0, begins[0], 135 * KMH), Phase(PhaseKind.BRAKE, 0.0, begins[1], 0.0))
    schedule = Schedule(
        section=here, phases=phases, known=known_run(here, np.full(len(here.node_m), 30.0)), back_share=0.7
    )
    for way_m, told_kmh in ((600.0, 135), (50.0, 125)):
        shown = Shown(Showing(SETTINGS), schedule).at(0.0, 47596.0 - way_m, 40 * KMH)
        assert (shown.now.mode, round(shown.now.speed_mps / KMH)) == (Regime.FULL_TRACTION, told_kmh)
        assert not any(one.mode in BRAKES and one.way_m < way_m for one in shown.following)
    faster = Shown(Showing(SETTINGS), schedule).at(0.0, 47596.0 - 600.0, 130 * KMH)
    assert faster.following[0].mode in BRAKES
    assert faster.following[0].way_m < 600.0


def test_an_acceleration_does_not_stand_to_a_speed_that_a_nearer_board_forbids() -> None:
    """foreign/04: "accelerate to 155" stood 83 m before a board of 150, until the last word lowered it."""
    here = section_of(("zurich-luzern", 2))
    phases = (Phase(PhaseKind.TRACTION, 0.4, 0, 135 * KMH), Phase(PhaseKind.BRAKE, 0.0, len(here.step_m) - 9, 0.0))
    known = known_run(here, np.full(len(here.node_m), 30.0))
    display = Shown(Showing(SETTINGS), Schedule(section=here, phases=phases, known=known, back_share=0.7))
    assert round(display.at(0.0, 47596.0 - 800.0, 110 * KMH).now.speed_mps / KMH) == 135
    assert round(display.at(2.0, 47596.0 - 60.0, 124 * KMH).now.speed_mps / KMH) == 125


def test_no_announced_instruction_repeats_the_one_before_it() -> None:
    here, coasts = section(), Instruction(mode=Regime.COAST, speed_mps=20.0, effort_ratio=0.0)
    brakes, harder = (Instruction(mode=Regime.REDUCED_BRAKE, speed_mps=15.0, effort_ratio=-e) for e in (0.2, 0.6))
    pulls, less = (Instruction(mode=Regime.REDUCED_TRACTION, speed_mps=20.0, effort_ratio=e) for e in (0.6, 0.4))
    for now, coming, left in (
        (coasts, (coasts, brakes), (brakes,)),
        (brakes, (harder, coasts), (coasts,)),
        (pulls, (less, pulls), (less, pulls)),
        (coasts, (replace(coasts, speed_mps=15.0),), (replace(coasts, speed_mps=15.0),)),
    ):
        placed = tuple(replace(one, way_m=100.0 * (k + 1)) for k, one in enumerate(coming))
        foreseen = Foreseen(np.array([0.0, 90.0]), np.array([100.0, 1000.0]), np.full(2, 10.0), as_shown=True)
        found = allowed(placed, now, 100.0, ShownBrakes(here, SETTINGS), foreseen)
        assert tuple(replace(one, way_m=0.0) for one in found) == left


def test_no_acceleration_is_announced_to_a_speed_that_a_nearer_limit_forbids() -> None:
    """foreign/04: 90 km/h was announced for the 20 m before a board of 70; here 135 km/h, 50 m before 125."""
    here = section_of(("zurich-luzern", 2))
    brakes = ShownBrakes(here, SETTINGS)
    pulls = Instruction(mode=Regime.FULL_TRACTION, speed_mps=135 * KMH, effort_ratio=1.0)
    now = Instruction(mode=Regime.CRUISE, speed_mps=50 * KMH)
    for way_m, v_kmh, told in ((50.0, 124, []), (50.0, 60, [125]), (800.0, 124, [135])):
        at_m = np.array([47000.0 - way_m, 47596.0])
        foreseen = Foreseen(np.array([0.0, 20.0]), at_m, np.full(2, v_kmh * KMH), as_shown=True)
        placed = replace(pulls, way_m=47596.0 - way_m - at_m[0], in_s=9.0)
        found = allowed((placed,), now, float(at_m[0]), brakes, foreseen)
        assert [round(one.speed_mps / KMH) for one in found] == told


def test_no_speed_is_announced_to_be_held_that_a_nearer_limit_forbids() -> None:
    """A restriction told too late: "hold 70 in 194 m" was announced where 40 applies from 200 m on."""
    line, train = section_of(("zurich-luzern", 2)).route, section_of(("zurich-luzern", 2)).vehicle
    board = Restriction(start_m=40_200.0, end_m=41_000.0, limit_mps=40 * KMH)
    brakes = ShownBrakes(build_section(line.with_restrictions((board,)), train), SETTINGS)
    now = Instruction(mode=Regime.FRICTION_BRAKE, speed_mps=40 * KMH, effort_ratio=-1.0)
    holds = Instruction(mode=Regime.CRUISE, speed_mps=70 * KMH, way_m=194.0, in_s=10.0)
    for v_kmh, told in ((65, []), (30, [40])):
        foreseen = Foreseen(
            np.array([0.0, 20.0]), np.array([40_000.0, 40_400.0]), np.full(2, v_kmh * KMH), as_shown=True
        )
        found = allowed((holds,), now, 40_000.0, brakes, foreseen)
        assert [round(one.speed_mps / KMH) for one in found] == told


def test_an_acceleration_that_a_limit_soon_brakes_is_not_begun() -> None:
    """The schedule has no phase to brake for it: at 24.5 m/s, 300 m before 25 m/s, the speed is held instead."""
    here = section_of(("zurich-luzern", 2))
    node_m = here.node_m
    begins = [int(np.searchsorted(node_m, at)) for at in (node_m[0], 47100.0, 47600.0, 56000.0)]
    phases = (
        Phase(PhaseKind.HOLD, 0.0, begins[0], 120 * KMH),
        Phase(PhaseKind.TRACTION, 0.4, begins[1], 135 * KMH),
        Phase(PhaseKind.TRACTION, 0.4, begins[2], 125 * KMH),
        Phase(PhaseKind.BRAKE, 0.0, begins[3], 0.0),
    )
    known = known_run(here, np.full(len(node_m), 30.0))
    schedule = Schedule(section=here, phases=phases, known=known, back_share=0.7)
    for v_kmh, mode in ((124.5, Regime.CRUISE), (100.0, Regime.REDUCED_TRACTION)):
        display = Shown(Showing(SETTINGS), schedule)
        display.at(0.0, 46500.0, 120 * KMH)
        found = [display.at(30.0 + k, 47150.0 + 30.0 * k, v_kmh * KMH).now.mode for k in range(9)]
        assert found[-1] is mode


def test_an_acceleration_towards_a_brake_that_the_train_is_too_slow_for_leads_to_the_speed_of_the_brake() -> None:
    """The speed allowed on the way falls from second to second; it would be named anew each time."""
    display = two_steps(PhaseKind.HOLD, 0.0, 70 * KMH)
    begin_m = display.schedule.begin_m(1)
    told = [display.at(float(k), begin_m - 240.0 + 10.0 * k, 10.0 + 0.1 * k).now for k in range(20)]
    assert {round(one.speed_mps / KMH) for one in told} == {70}
    assert {one.mode for one in told} == {Regime.REDUCED_TRACTION}


def test_news_that_want_a_slower_train_end_an_acceleration_without_notice() -> None:
    """A train ahead is reported while the driver accelerates: he is told to hold the lower speed; a brake to it comes
    after its notice. The same reference made because he is late lets him go on until its change was announced."""
    phases = (PhaseKind.HOLD, 0.0, 15.0), (PhaseKind.BRAKE, 4700.0, 0.0)
    for cause, mode in ((ReplanCause.LINE, Regime.CRUISE), (ReplanCause.LATE, Regime.REDUCED_TRACTION)):
        showing = Showing(SETTINGS)
        accelerates = Shown(showing, two_steps(PhaseKind.HOLD, 0.0, 70 * KMH).schedule)
        assert accelerates.at(0.0, 1000.0, 17.0).now.mode is Regime.REDUCED_TRACTION
        slower = shown_of(*phases, showing=showing).schedule
        replan = Replan(cause=cause, time_ns=ns(9.0))
        reference = StandingReference(schedule=slower, lambda_w=1e6, arrival_ns=ns(400), point=None, replan=replan)
        kept = Kept(reference, slower.forecast(1160.0, 18.0), 0.0)
        now = showing.show(kept, TrainState(ns(9.0), 1160.0, 18.0), FREE).now
        assert now.mode is mode
        assert mode is not Regime.CRUISE or round(now.speed_mps / KMH) == 55


def test_a_brake_that_is_nearly_done_is_not_eased() -> None:
    """5 s before it would have its speed: no driver would react before; 9 s before, less is shown."""
    brakes, at_m, to_mps = ShownBrakes(section(), SETTINGS), section().end_m - 2000.0, 60 * KMH
    first = brakes.shown(NeededBrake(0.5, to_mps, at_m), TrainState(ns(0), at_m - 150.0, 75 * KMH)).effort_ratio
    soon = TrainState(ns(8), at_m - 120.0, to_mps + 0.75)
    rate_mps2 = (soon.v_mps - to_mps) / brakes.lasts(brake_of(-first, to_mps), soon)[0]
    soon = soon._replace(v_mps=to_mps + 5.0 * rate_mps2)
    assert brakes.shown(NeededBrake(0.1, to_mps, at_m), soon).effort_ratio == first
    later = soon._replace(v_mps=to_mps + 9.0 * rate_mps2)
    assert brakes.shown(NeededBrake(0.1, to_mps, at_m), later).effort_ratio > first


def test_a_brake_that_ends_hardly_above_its_speed_does_not_grow() -> None:
    """A train that will end 0.25 m/s above its speed is shown no more effort in the last metres; at 0.8 m/s it is."""
    brakes, end_m = ShownBrakes(section(), SETTINGS), section().end_m
    at_m, target_mps = end_m - 2000.0, 60 * KMH
    from_m, v_mps = at_m - 100.0, 75 * KMH
    needed = brakes.ahead.effort_to(from_m, v_mps, at_m, target_mps)
    first = brakes.shown(NeededBrake(needed, target_mps, at_m), TrainState(ns(0), from_m, v_mps)).effort_ratio
    slowed_mps2 = brakes.lasts(brake_of(-first, 0.0), TrainState(ns(5), at_m - 40.0, target_mps))
    near_mps = math.sqrt((target_mps + 0.25) ** 2 + 2.0 * target_mps / slowed_mps2[0] * 40.0)
    near, far_above = (TrainState(ns(5), at_m - 40.0, near_mps + more) for more in (0.0, 0.5))
    asked = brakes.ahead.effort_to(near.s_m, near.v_mps, at_m, target_mps)
    assert asked > -first
    assert brakes.shown(NeededBrake(asked, target_mps, at_m), near).effort_ratio == first
    asked = brakes.ahead.effort_to(far_above.s_m, far_above.v_mps, at_m, target_mps)
    assert brakes.shown(NeededBrake(asked, target_mps, at_m), far_above).effort_ratio < first


def test_a_driver_just_above_the_speed_to_hold_is_not_told_to_brake_for_a_far_limit() -> None:
    """57 m before 80 km/h, at 80.9 km/h, he holds it: the least braking for 60 km/h, 900 m on, is no brake yet."""
    brakes, state = ShownBrakes(section_of(("zurich-luzern", 2)), SETTINGS), TrainState(0, 54243.0, 80.9 * KMH)
    holds = Instruction(mode=Regime.CRUISE, speed_mps=80 * KMH)
    assert brakes.safe(holds, state, 90 * KMH) is holds
    assert brakes.safe(holds, state._replace(v_mps=84 * KMH), 90 * KMH).mode in BRAKES


def test_no_brake_is_announced_for_rolling_above_a_limit_that_does_not_fall() -> None:
    """Down the Albis tunnel a train rolls above 120 km/h; the brake for 110 km/h at km 25.4 comes later."""
    here = section_of(("zurich-luzern", 1))
    brakes, nodes_m = ShownBrakes(here, SETTINGS), here.node_m
    rolling = np.full(int((nodes_m > 21000.0).sum()), 121.5 * KMH)
    assert brakes.brake_at(21500.0, rolling) is None
    for_110 = brakes.brake_at(25300.0, rolling)
    assert for_110 is not None
    assert for_110.speed_mps == pytest.approx(110 * KMH)


def test_to_a_driver_who_holds_a_speed_neither_a_brake_to_it_nor_the_same_again_is_announced() -> None:
    """57 m before 80 km/h, at 81 km/h, the hold does what the brake would; the brake to 60 km/h stays announced."""
    here, v_mps = section_of(("zurich-luzern", 2)), 81 * KMH
    brakes, state = ShownBrakes(here, SETTINGS), TrainState(0, 54243.0, v_mps)
    ahead_m = np.array([0.0, 60.0, 900.0])
    foreseen = Foreseen(ahead_m / v_mps, state.s_m + ahead_m, np.full(3, v_mps), as_shown=True)
    holds = Instruction(mode=Regime.CRUISE, speed_mps=80 * KMH)
    to_80, to_60 = (brake_of(0.2, v * KMH) for v in (80, 60))
    coming = (
        replace(to_80, way_m=10.0, in_s=0.5),
        replace(holds, way_m=57.0, in_s=2.5),
        replace(to_60, way_m=500.0, in_s=22.0),
    )
    found = allowed(in_time(coming, holds, brakes, state, foreseen), holds, state.s_m, brakes, foreseen)
    assert [round(one.speed_mps / KMH) for one in found] == [60]


def test_a_driver_hardly_above_the_speed_to_hold_is_announced_the_brake_from_that_speed() -> None:
    """57 m before 80 km/h, at 80.9 km/h: the brake to 60 km/h, 900 m on, is announced for there, not for now."""
    here, v_mps = section_of(("zurich-luzern", 2)), 80.9 * KMH
    brakes, state = ShownBrakes(here, SETTINGS), TrainState(0, 54243.0, v_mps)
    ahead_m = np.array([0.0, 60.0, 900.0])
    foreseen = Foreseen(ahead_m / v_mps, state.s_m + ahead_m, np.full(3, v_mps), as_shown=False)
    found = in_time((), Instruction(mode=Regime.CRUISE, speed_mps=80 * KMH), brakes, state, foreseen)
    assert found[0].speed_mps == pytest.approx(60 * KMH)
    assert found[0].way_m > 300.0


def test_a_brake_that_comes_before_the_one_of_the_schedule_is_announced_with_its_own_speed() -> None:
    """At 87 km/h, 300 m before 80 km/h, the schedule brakes to 60 km/h 1 km on: a brake to 80 km/h comes before."""
    here, v_mps = section_of(("zurich-luzern", 2)), 87 * KMH
    brakes, state = ShownBrakes(here, SETTINGS), TrainState(0, 54000.0, v_mps)
    ahead_m = np.array([0.0, 1500.0])
    foreseen = Foreseen(ahead_m / v_mps, state.s_m + ahead_m, np.full(2, v_mps), as_shown=False)
    to_60 = replace(brake_of(0.4, 60 * KMH), way_m=1100.0, in_s=45.0)
    coasts = Instruction(mode=Regime.COAST, speed_mps=70 * KMH, effort_ratio=0.0)
    found = in_time((to_60,), coasts, brakes, state, foreseen)
    assert [round(one.speed_mps / KMH) for one in found] == [80, 60]
    assert found[0].way_m < 300.0
    assert found[1] == to_60
