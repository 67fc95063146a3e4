"""The advisor of a journey: which section speaks, whatever the positions do."""

from __future__ import annotations

from itertools import pairwise

import pytest

from das.advice.advisor import Advisor, Timetable
from das.advice.plan import Mode
from das.cab.journey_advisor import JourneyAdvisor
from das.domain.errors import DasError
from das.domain.units import NS
from das.estimate.localisation import PositionFix
from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solve import solve_front
from tests.support.making import flat, make_train

T0 = 1_800_000_000_000_000_000
STOPS_M = (0.0, 3000.0, 6000.0, 8000.0)
DUE_S = ((0, 200), (240, 440), (480, 640))


def ns(seconds: float) -> int:
    return T0 + round(seconds / NS)


@pytest.fixture(scope="module")
def fronts() -> list[Front]:
    train = make_train(resistance=(1e3, 0.0, 5.0), power_w=2e6)
    line = flat(8000.0, 30.0)
    return [solve_front(build_section(line, train, start_m=a, end_m=b)) for a, b in pairwise(STOPS_M)]


def journey(fronts: list[Front]) -> JourneyAdvisor:
    advisor = JourneyAdvisor([Advisor(front) for front in fronts])
    advisor.set_timetables([Timetable(departure_ns=ns(a), arrival_ns=ns(b)) for a, b in DUE_S])
    return advisor


def test_a_follower_is_led_from_stop_to_stop_on_time_and_never_departs_early(fronts: list[Front]) -> None:
    advisor = journey(fronts)
    s, v, arrivals, departures, stood = 0.0, 0.0, [], [], True
    for second in range(700):
        advisor.set_position(PositionFix(time_ns=ns(second), s_m=s, speed_mps=v))
        advice = advisor.update(ns(second))
        after = advice.horizon_speed_mps[0]
        if stood and after > 0:
            departures.append(second)
        if not stood and after == 0 and v == 0:
            arrivals.append(second)
        stood = v == 0 and after == 0
        s, v = s + 0.5 * (v + after), after
    assert departures == [a for a, _ in DUE_S]
    assert arrivals == pytest.approx([b for _, b in DUE_S], abs=6)
    assert advice.mode is Mode.STOP
    assert advice.reason.startswith("arrived")


@pytest.mark.parametrize(
    ("heard", "section"),
    [
        ([(0, 0)], 0),
        ([(4000, 20)], 1),  # heard first in the middle of the way: a node that was restarted
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
def test_the_section_follows_the_positions(fronts: list[Front], heard: list[tuple[float, float]], section: int) -> None:
    advisor = journey(fronts)
    for minute, (s, v) in enumerate(heard):
        for second in range(4):  # a standstill has to last
            advisor.set_position(PositionFix(time_ns=ns(60.0 * minute + second), s_m=s + v * second, speed_mps=v))
    assert advisor.current is advisor.advisors[section]


def test_a_late_train_that_nearly_stands_is_not_sent_off(fronts: list[Front]) -> None:
    """At 0.1 m/s before the mark, its departure past: the next section begins when it stands."""
    advisor, advices = journey(fronts), []
    for second, (s, v) in enumerate(((2998.2, 1.4), (2999.3, 0.7), (2999.9, 0.1), (3000.0, 0.0), (3000.0, 0.0))):
        fix = PositionFix(time_ns=ns(300 + second), s_m=s, speed_mps=v, uncertainty_m=0.5, speed_uncertainty_mps=0.02)
        advisor.set_position(fix)
        advices.append(advisor.update(ns(300 + second)))
    assert advisor.current is advisor.advisors[1]
    assert [advice.advised_speed_mps for advice in advices[2:4]] == [0.0, 0.0]
    assert advices[-1].horizon_speed_mps[0] > 0.0


def test_one_position_far_off_is_not_believed(fronts: list[Front]) -> None:
    advisor = journey(fronts)
    for second, s in enumerate((4000.0, 7500.0, 4040.0)):
        advisor.set_position(PositionFix(time_ns=ns(250 + second), s_m=s, speed_mps=20.0))
        assert advisor.current is advisor.advisors[1]
        advice = advisor.update(ns(250 + second))
        assert advice.mode is not Mode.NONE
        assert advice.s_m == pytest.approx(4000.0 + 20.0 * second, abs=5.0)
    assert advisor.here.rejected == 1


def test_the_state_outlives_a_new_timetable(fronts: list[Front]) -> None:
    advisor = journey(fronts)
    advisor.set_position(PositionFix(time_ns=ns(250), s_m=4000.0, speed_mps=20.0))
    advisor.set_timetables(
        [Timetable(departure_ns=ns(a), arrival_ns=ns(b + 30)) for a, b in ((0, 200), (240, 440), (480, 640))]
    )
    assert advisor.current is advisor.advisors[1]
    assert advisor.update(ns(250)).mode is not Mode.NONE


def test_a_stop_run_through_withdraws_the_advice(fronts: list[Front]) -> None:
    advisor = journey(fronts)
    for second, s in enumerate((2960.0, 2985.0, 3010.0, 3035.0, 3060.0)):
        advisor.set_position(PositionFix(time_ns=ns(190 + second), s_m=s, speed_mps=25.0))
        advice = advisor.update(ns(190 + second))
    assert advice.mode is Mode.NONE
    assert advice.reason == "ran 60 m past the stop"


def test_a_timetable_that_departs_before_it_arrives_is_refused(fronts: list[Front]) -> None:
    advisor = JourneyAdvisor([Advisor(front) for front in fronts])
    bad = [(0, 200), (190, 440), (480, 640)]
    with pytest.raises(DasError, match="the departure from stop 2 is before the arrival there"):
        advisor.set_timetables([Timetable(departure_ns=ns(a), arrival_ns=ns(b)) for a, b in bad])
