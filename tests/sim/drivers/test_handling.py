"""How a human driver sets the controller: which brakes, the end stops, two speeds at a time, and a new departure."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from das.advice.regimes import Regime
from sim.drivers.cab import AdviceView, Diary
from sim.drivers.handling import WAITS_S, Hand, SpeedHold
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import FrictionPolicy, Presentation
from sim.drivers.parameters import HumanParameters
from sim.plant.kernels import Command, PlantState
from sim.plant.plant import COAST
from tests.sim.drivers.test_drivers import STEADY, cab_of, endless
from tests.support.ride import shown

WILLING = replace(
    STEADY, comply_traction_ratio=1.0, comply_hold_ratio=1.0, comply_coast_ratio=1.0, comply_brake_ratio=1.0
)


def view(mode: Regime, lever_ratio: float, time_s: float, speed_mps: float = 20.0) -> AdviceView:
    speeds = {"speed_mps": speed_mps, "display_speed_mps": speed_mps}
    return shown(Presentation.SPEED_AND_EFFORT, mode, time_s, **speeds, lever_ratio=lever_ratio, force_n=0.0)


def driven(human: HumanDriver, mode: Regime, lever_ratio: float, *, looks: int = 100, v_mps: float = 20.0) -> Command:
    """The last command of a driver who is shown one advice for a while."""
    command = COAST
    for i in range(looks):
        cab = cab_of(PlantState(0.2 * i, 100.0, v_mps), stop_m=50_000.0, advice=view(mode, lever_ratio, 0.2 * i))
        command = human.command(cab)
    return command


@pytest.mark.parametrize(
    ("policy", "followed", "refused"),
    [
        (FrictionPolicy.AS_MEASURED, 0.4, 0.4),
        (FrictionPolicy.ELECTRIC_FIRST, 0.0, 0.0),
        (FrictionPolicy.BY_ADVICE, 0.0, 0.4),
    ],
)
def test_friction_is_a_matter_of_the_policy_and_only_by_advice_of_what_is_shown(
    policy: FrictionPolicy, followed: float, refused: float
) -> None:
    willing = replace(WILLING, friction_ratio=0.4)
    for human, expected in ((willing, followed), (replace(willing, comply_brake_ratio=0.0), refused)):
        command = driven(HumanDriver(endless(), human, friction=policy), Regime.REDUCED_BRAKE, -0.3)
        assert command.friction_ratio == expected


@pytest.mark.parametrize(("mode", "end"), [(Regime.FULL_TRACTION, 1.0), (Regime.FULL_BRAKE, -1.0)])
def test_the_ends_of_the_scale_are_set_exactly_whatever_the_error_of_efforts(mode: Regime, end: float) -> None:
    """Drivers with errors of 50 %: of twenty, about half would set less than they are told."""
    set_to = [
        driven(HumanDriver(endless(), replace(WILLING, force_error_ratio=0.5), seed=seed), mode, end).value
        for seed in range(20)
    ]
    assert set_to == [end] * 20


def test_two_speeds_that_are_minded_at_once_do_not_disturb_each_other() -> None:
    """One to hold and a ceiling: a correction of the one is none of the other."""
    human = HumanParameters()
    both = [SpeedHold(human), SpeedHold(human)]
    alone = [SpeedHold(human), SpeedHold(human)]
    errors = [(-0.4, 2.5), (-0.7, 2.0), (-0.3, 0.2), (0.1, 0.1), (0.6, -0.6)]
    mixed = [[hold.force_n(e, 1e4, 4e5, crawls=False) for hold, e in zip(both, pair, strict=True)] for pair in errors]
    for k, hold in enumerate(alone):
        assert [pair[k] for pair in mixed] == [hold.force_n(pair[k], 1e4, 4e5, crawls=False) for pair in errors]


def test_at_departure_the_advice_up_to_the_stop_is_over() -> None:
    """A brake was followed into the stop; at departure he sees full traction and sets it, without braking at first."""
    human = HumanDriver(endless(), replace(WILLING, glance_mean_s=30.0, glance_least_s=10.0), seed=1)
    assert driven(human, Regime.REDUCED_BRAKE, -0.4).value < 0
    stands = PlantState(30.0, 200.0, 0.0)
    waiting = cab_of(stands, stop_m=50_000.0, advice=view(Regime.FULL_TRACTION, 1.0, 30.0, 5.0))
    assert human.command(waiting._replace(departure_s=60.0)) == COAST
    set_to = []
    for i in range(40):
        now_s = 60.0 + 0.2 * i
        cab = cab_of(stands._replace(time_s=now_s), stop_m=50_000.0, advice=view(Regime.FULL_TRACTION, 1.0, now_s, 5.0))
        set_to.append(human.command(cab).value)
    assert min(set_to) >= 0.0
    assert set_to[-1] == 1.0


def test_who_comes_to_a_stand_between_stops_releases_the_brakes_and_goes_on_after_a_reaction() -> None:
    """Advice to brake was followed to a stand far from any stop; then full traction is shown."""
    human = HumanDriver(endless(), replace(WILLING, reaction_median_s=3.0), seed=1)
    assert driven(human, Regime.FULL_TRACTION, 1.0, looks=50).value == 1.0
    set_to = []
    for i in range(50, 150):
        now_s, mode, ratio = 0.2 * i, Regime.FULL_TRACTION, 1.0
        if i < 100:
            mode, ratio = Regime.REDUCED_BRAKE, -0.4
        seen, v_mps = view(mode, ratio, now_s, 3.0), 3.0 if i < 100 else 0.0
        cab = cab_of(PlantState(now_s, 300.0, v_mps), stop_m=50_000.0, advice=seen)
        set_to.append(human.command(cab).value)
    assert set_to[49] == pytest.approx(-0.4)
    assert set_to[50:64] == [0.0] * 14
    assert set_to[-1] == 1.0


def test_advice_that_is_withdrawn_is_given_up_after_a_reaction() -> None:
    human = HumanDriver(endless(), replace(WILLING, reaction_median_s=3.0), seed=1)
    assert driven(human, Regime.FULL_TRACTION, 1.0, looks=100).value == 1.0
    noticed = human.events[-1].time_s
    set_to = []
    for i in range(100, 160):
        cab = cab_of(PlantState(0.2 * i, 100.0, 20.0), stop_m=50_000.0, arrival_s=1e7)
        set_to.append((0.2 * i, human.command(cab).value))
    given_up = next(t for t, value in set_to if value < 1.0)
    reaction = next(e for e in human.events if e.what == "reaction" and e.time_s > noticed)
    assert reaction.value == pytest.approx(3.0, rel=1e-6)
    assert given_up >= reaction.time_s + 3.0 - 1e-9
    assert given_up <= reaction.time_s + 3.0 + 0.4


def test_the_speed_that_is_read_is_the_one_on_the_display() -> None:
    seen = replace(view(Regime.CRUISE, 0.0, 0.0), speed_mps=20.3, display_speed_mps=20.0)
    assert seen.shown_speed_mps == 20.0
    assert replace(seen, display_speed_mps=math.nan).shown_speed_mps == 20.3


def announced(mode: Regime, next_mode: Regime, change_s: float, time_s: float) -> AdviceView:
    return replace(view(mode, 0.0, time_s), next_mode=next_mode, next_change_s=change_s - time_s)


def reactions(driver: HumanDriver, *, said: bool) -> tuple[list[float], list[float]]:
    """Show a change from hold to coast at 30 s, announced or not; the reactions, and the times of glances after it."""
    for i in range(300):
        now_s = 0.2 * i
        mode, change_s = (Regime.CRUISE, 30.0) if now_s < 30.0 else (Regime.COAST, 90.0)
        following = {Regime.CRUISE: Regime.COAST, Regime.COAST: Regime.FULL_BRAKE}[mode]
        seen = announced(mode, following, change_s, now_s) if said else view(mode, 0.0, now_s)
        driver.command(cab_of(PlantState(now_s, 100.0, 20.0), stop_m=50_000.0, advice=seen))
    glances = [event.time_s for event in driver.events if event.what == "glance" and event.time_s >= 30.0]
    return [event.value for event in driver.events if event.what == "reaction"], glances


def test_a_change_that_was_announced_is_seen_when_it_is_due_and_reacted_to_sooner() -> None:
    seldom = replace(WILLING, glance_mean_s=20.0, glance_least_s=1.0, reaction_median_s=2.0)
    said, unsaid = HumanDriver(endless(), seldom, seed=4), HumanDriver(endless(), seldom, seed=4)
    (first, announced_s), seen = reactions(said, said=True)
    (alone, unannounced_s), seen_later = reactions(unsaid, said=False)
    assert (first, alone, unannounced_s) == pytest.approx((2.0, 2.0, 2.0))
    assert announced_s == pytest.approx(0.6 * 2.0)
    assert seen[0] == pytest.approx(30.0, abs=0.3)
    assert seen_later[0] > 31.0
    assert [event.value for event in said.events if event.what == "expected"] == [0.6]


@pytest.mark.parametrize(("deviation_s", "lever"), [(30.0, 1.0), (0.0, 1.0), (-30.0, 0.0)])
def test_who_is_told_how_late_he_is_drives_faster_or_lets_the_train_roll(deviation_s: float, lever: float) -> None:
    """At 30 m/s with time in hand: late and on time he goes on to his usual speed, early to the one that will do."""
    human = HumanDriver(endless(), replace(WILLING, haste_ratio=0.6), seed=1)
    for i in range(150):
        seen = shown(Presentation.DEVIATION, Regime.CRUISE, 0.2 * i, deviation_s=deviation_s)
        cab = cab_of(PlantState(0.2 * i, 100.0, 30.0), stop_m=30_000.0, arrival_s=1200.0, advice=seen)
        command = human.command(cab)
    assert command.value == pytest.approx(lever, abs=0.5)


LOOK_S = 0.2


class Moved:
    """A hand that is asked for settings, look by look."""

    def __init__(self) -> None:
        self.hand, self.now_s = Hand(HumanParameters(), Diary()), 0.0

    def ask(self, wanted: float, for_s: float, *, task: object = None, urgent: bool = False) -> float:
        for _ in range(round(for_s / LOOK_S)):
            self.now_s += LOOK_S
            self.hand.move(wanted, self.now_s, LOOK_S, task=task, urgent=urgent)
        return self.hand.setting


def test_a_small_change_waits_for_the_effect_of_the_one_before() -> None:
    moved = Moved()
    assert moved.ask(0.2, 1.0) == pytest.approx(0.2)
    assert moved.ask(0.1, WAITS_S - 1.0) == pytest.approx(0.2)
    assert moved.ask(0.1, 2.0) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("wanted", "task", "urgent"),
    [(0.55, None, False), (1.0, None, False), (0.1, "other advice", False), (0.1, None, True)],
)
def test_a_large_change_another_task_and_what_is_urgent_do_not_wait(wanted: float, task: object, urgent: bool) -> None:
    moved = Moved()
    moved.ask(0.2, 1.0)
    assert moved.ask(wanted, 3.0, task=task, urgent=urgent) == pytest.approx(wanted)


def test_effort_that_has_lasted_is_given_up_at_once() -> None:
    """A brake of two settings, 5 s in all: the second one has just been made."""
    moved = Moved()
    assert moved.ask(-0.1, 1.0) == pytest.approx(-0.1)
    moved.ask(-0.2, WAITS_S + 0.4)
    assert moved.hand.setting == pytest.approx(-0.2)
    assert moved.ask(0.0, 1.0) == pytest.approx(0.0)


def test_a_movement_that_has_begun_is_finished() -> None:
    """At 0.4 of the scale a second, 0.25 takes four looks, each of them a small change."""
    moved = Moved()
    assert moved.ask(0.25, 0.8) == pytest.approx(0.25)
