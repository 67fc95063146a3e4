"""Which leg of a journey the train is on, whatever the positions do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from das.advice.advice import Timetable
from das.advice.reason import ReasonCode
from das.advice.regimes import Regime
from das.cab.situation import Situation
from das.domain.errors import DasError
from das.domain.route import Route, Stop
from das.estimate.estimate import PositionFix
from tests.support.followed import after_a_second_mps
from tests.support.making import flat, make_train
from tests.support.small_trips import FRONTS, SmallTrip, ns

STOPS_M = (0.0, 3000.0, 6000.0, 8000.0)
DUE_S = ((0, 200), (240, 440), (480, 640))


TRAIN = make_train(resistance=(1e3, 0.0, 5.0), power_w=2e6)
STOPS = tuple(Stop(name=f"{s_m:.0f} m", position_m=s_m) for s_m in STOPS_M)
LINE: Route = replace(flat(8000.0, 30.0), stops=STOPS)


def timetables(due_s: Sequence[tuple[int, int]]) -> list[Timetable]:
    return [Timetable(departure_ns=ns(a), arrival_ns=ns(b)) for a, b in due_s]


def journey(due_s: Sequence[tuple[int, int]] = DUE_S) -> SmallTrip:
    made = SmallTrip(Situation(route=LINE, vehicle=TRAIN), FRONTS)
    made.begin(STOPS, timetables(due_s), vehicle=TRAIN)
    return made


def test_a_follower_is_led_from_stop_to_stop_on_time_and_never_departs_early() -> None:
    made = journey()
    s, v, arrivals, departures, stood = 0.0, 0.0, [], [], True
    for second in range(700):
        made.set_position(PositionFix(time_ns=ns(second), s_m=s, speed_mps=v))
        advice = made.update(ns(second))
        after = after_a_second_mps(advice)
        if stood and after > 0:
            departures.append(second)
        if not stood and after == 0 and v == 0:
            arrivals.append(second)
        stood = v == 0 and after == 0
        s, v = s + 0.5 * (v + after), after
    assert departures == [a for a, _ in DUE_S]
    assert arrivals == pytest.approx([b for _, b in DUE_S], abs=6)
    assert advice.mode is Regime.STOP
    assert advice.reason.code is ReasonCode.ARRIVED


@pytest.mark.parametrize(
    ("fixes", "section"),
    [
        ([(0, 0)], 0),
        ([(4000, 20)], 1),  # first received in the middle of the way: a node that was restarted
        ([(2000, 20), (2960, 3)], 0),  # nearly at the stop, still moving
        ([(2000, 20), (2960, 0)], 1),  # standing there
        ([(2000, 20), (2960, 0), (2990, 2)], 1),  # departed again
        ([(2000, 20), (2960, 0), (2930, 0), (2940, 2)], 1),  # a position that scatters does not put it back
        ([(2000, 20), (2960, 0), (2700, 0)], 0),  # really further back
        ([(2900, 20), (3200, 20)], 0),  # ran through its stop
        ([(2900, 20), (3200, 20), (3210, 0)], 1),  # and stands
        ([(2900, 20), (3600, 20)], 1),
        ([(7990, 0)], 2),
    ],
)
def test_the_section_follows_the_positions(fixes: list[tuple[float, float]], section: int) -> None:
    made = journey()
    for minute, (s, v) in enumerate(fixes):
        for second in range(4):  # a standstill has to last
            made.set_position(PositionFix(time_ns=ns(60.0 * minute + second), s_m=s + v * second, speed_mps=v))
    assert made.legs.index == section


def test_a_late_train_that_nearly_stands_is_not_sent_off() -> None:
    """At 0.1 m/s before the mark, its departure past: the next section begins when it stands."""
    made, advices = journey(), []
    for second, (s, v) in enumerate(((2998.2, 1.4), (2999.3, 0.7), (2999.9, 0.1), (3000.0, 0.0), (3000.0, 0.0))):
        fix = PositionFix(time_ns=ns(300 + second), s_m=s, speed_mps=v, uncertainty_m=0.5, speed_uncertainty_mps=0.02)
        made.set_position(fix)
        advices.append(made.update(ns(300 + second)))
    assert made.legs.index == 1
    assert [advice.advised_speed_mps for advice in advices[2:4]] == [0.0, 0.0]
    assert advices[-1].mode is Regime.DEPART


def test_one_position_far_off_is_not_believed() -> None:
    made = journey()
    for second, s in enumerate((4000.0, 7500.0, 4040.0)):
        made.set_position(PositionFix(time_ns=ns(250 + second), s_m=s, speed_mps=20.0))
        assert made.legs.index == 1
        advice = made.update(ns(250 + second))
        assert advice.mode is not Regime.NONE
        assert advice.s_m == pytest.approx(4000.0 + 20.0 * second, abs=5.0)
    assert made.localisation.at(ns(252)).rejected == 1


def test_the_state_outlives_a_new_timetable() -> None:
    made = journey()
    made.set_position(PositionFix(time_ns=ns(250), s_m=4000.0, speed_mps=20.0))
    made.begin(STOPS, timetables([(a, b + 30) for a, b in DUE_S]), vehicle=TRAIN)
    assert made.legs.index == 1
    assert made.update(ns(250)).mode is not Regime.NONE


def test_a_stop_run_through_withdraws_the_advice() -> None:
    made = journey()
    for second, s in enumerate((2960.0, 2985.0, 3010.0, 3035.0, 3060.0)):
        made.set_position(PositionFix(time_ns=ns(190 + second), s_m=s, speed_mps=25.0))
        advice = made.update(ns(190 + second))
    assert advice.mode is Regime.NONE
    assert advice.reason.text == "ran 60 m past the stop"


def test_a_timetable_that_departs_before_it_arrives_is_refused() -> None:
    with pytest.raises(DasError, match="the departure from stop 2 is before the arrival there"):
        journey([(0, 200), (190, 440), (480, 640)])


def test_a_repeated_journey_does_not_send_a_train_off_that_rolls_past_its_mark() -> None:
    made = journey()
    for second, (s_m, v_mps) in enumerate([(2000.0, 20.0), (3003.5, 1.1)]):
        made.set_position(PositionFix(time_ns=ns(100 + second), s_m=s_m, speed_mps=v_mps))
    assert made.legs.index == 0
    made.begin(STOPS, timetables(DUE_S), vehicle=TRAIN)
    assert made.legs.index == 0
    assert made.update(ns(102)).mode in (Regime.FULL_BRAKE, Regime.FRICTION_BRAKE)
    # Without that stop the train is on its way to the next one.
    made.begin((STOPS[0], *STOPS[2:]), timetables(((0, 440), (480, 640))), vehicle=TRAIN)
    assert made.leg.end.position_m == STOPS_M[2]
