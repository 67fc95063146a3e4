"""A node advises only when it knows which restrictions are in force, and on journeys that have all their times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from das.advice.advisor import Advice
from das.cab.trip import NOT_TOLD, Trip

from das.bus import das_pb2
from das.bus.topics import ADVICE, CONTROL, JOURNEY, POSITION, RESTRICTION, STATUS
from das.cab.fronts import Situation
from das.cab.trains import Trains
from das.estimate.localisation import PositionFix
from das.node.process import Node
from sim.world.in_process import InProcess
from sim.world.link import Heard
from tests.das.node.test_node import START_NS, journey, node, status, until
from tests.das.node.test_node_faults import ROUTE, VEHICLE, Bus, Cab, restrictions
from tests.das.node.test_node_faults import journey as changed_journey
from tests.support.flat_days import FLAT, service_of
from tests.support.small_trips import DUE, FRONTS, LINE, TRAIN, at

S = 10**9


class Untold(Cab):
    """A node that has heard nothing at all."""

    def __init__(self, *, unrestricted: bool) -> None:
        self.sink = Bus()
        situation = Situation(route=ROUTE, vehicle=VEHICLE)
        trip = Trip(situation, FRONTS, background=False, unrestricted=unrestricted)
        trains = Trains(VEHICLE, VEHICLE)
        self.node = Node(self.sink, trip, ROUTE, trains, reverse=False, wall_clock=False)  # type: ignore[arg-type]


def test_a_node_that_was_told_nothing_of_restrictions_does_not_advise_until_it_is() -> None:
    cab = Untold(unrestricted=False)
    assert cab.tick(40).reason == "no journey yet"
    cab.tell(JOURNEY, changed_journey())
    silent = cab.tick(50)
    assert (silent.mode, silent.reason) == (das_pb2.MODE_NONE, NOT_TOLD)
    assert NOT_TOLD.startswith("no list of restrictions has been heard yet")
    said = cab.sink.of(STATUS)[-1]
    assert (said.state, said.reason) == (das_pb2.Status.STATE_WITHDRAWN, NOT_TOLD)
    assert NOT_TOLD in cab.sink.events()
    cab.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS))
    assert cab.tick(51).mode != das_pb2.MODE_NONE


def test_a_list_that_cannot_be_heeded_is_no_list() -> None:
    cab = Untold(unrestricted=False)
    cab.tell(JOURNEY, changed_journey())
    cab.tell(RESTRICTION, restrictions(49, -1.0))
    assert "restrictions that cannot be heeded" in cab.tick(50).reason
    cab.tell(RESTRICTION, restrictions(51, 10.0))
    assert cab.tick(52).limit_mps == 10.0


def test_a_site_without_restrictions_says_so_and_a_list_is_heeded_all_the_same() -> None:
    cab = Untold(unrestricted=True)
    cab.tell(JOURNEY, changed_journey())
    assert cab.tick(50).limit_mps > 40.0
    cab.tell(RESTRICTION, restrictions(51, 10.0))
    assert cab.tick(52).limit_mps == 10.0


def test_what_was_told_holds_for_the_next_journey() -> None:
    made = Trip(Situation(route=LINE, vehicle=TRAIN), FRONTS, background=False)
    made.set_restrictions(())
    for _ in range(2):
        made.begin(LINE.stops, DUE)
        assert at(made, 60, 1500.0, 24.0).reason.startswith("least energy")


@pytest.mark.parametrize("told", [False, True])
def test_the_simulators_node_in_process_is_told_as_over_the_bus(told: bool, tmp_path: Path) -> None:
    (tmp_path / "flat.toml").write_text(FLAT, encoding="utf-8")
    service = service_of(tmp_path / "flat.toml")
    link = InProcess(service)
    now_ns = service.moment_ns(60.0)
    for _ in range(2):  # started anew it knows what it was told
        fix = PositionFix(time_ns=now_ns, s_m=1_000.0, speed_mps=20.0)
        advice = link.exchange(Heard(1, now_ns, fix, None, () if told else None, None, None))
        assert isinstance(advice, Advice)
        assert (advice.reason == NOT_TOLD) == (not told)
        link.restart()
        if told:
            again = link.exchange(Heard(1, now_ns, fix, None, None, None, None))
            assert again.reason != NOT_TOLD


def asked(bus: Any, child: Any, *, tick: int) -> Any:
    now_ns = START_NS + 60 * S
    bus.publish(POSITION, das_pb2.Position(time_ns=now_ns, s_m=2_600.0, speed_mps=14.0))
    bus.publish(CONTROL, das_pb2.Control(time_ns=now_ns, tick=tick))
    return until(bus, lambda r: r.topic is ADVICE and r.message.tick == tick, child)


def test_the_option_of_a_site_without_restrictions_over_the_bus() -> None:
    with node("--clock", "bus", "--no-restrictions") as (bus, child):
        until(bus, status(das_pb2.Status.STATE_WAITING), child)
        bus.publish(JOURNEY, journey())
        until(bus, status(das_pb2.Status.STATE_READY), child)
        assert asked(bus, child, tick=1).mode != das_pb2.MODE_NONE


# --- times of a journey ------------------------------------------------------------------------------------------


def stops(*times: tuple[int, int]) -> list[das_pb2.Journey.Stop]:
    """Stops with arrival and departure (s after the start; 0: none; negative: nanoseconds)."""
    places = (0.0, 3_000.0, 6_000.0) if len(times) == 3 else (0.0, 6_000.0)

    def ns(second: int) -> int:
        return START_NS + second * S if second > 0 else second

    return [
        das_pb2.Journey.Stop(name=name, s_m=s_m, arrival_ns=ns(arrival), departure_ns=ns(departure))
        for name, s_m, (arrival, departure) in zip("ABC", places, times, strict=False)
    ]


WRONG_TIMES = {
    "the first stop has no departure": stops((0, 0), (300, 0)),
    "the last stop has no arrival": stops((0, 1), (0, 0)),
    "stop 1 has the departure -5 ns, expected nanoseconds since 1970": stops((0, -5), (300, 0)),
    "stop 1 has the arrival -1 ns, expected nanoseconds since 1970": stops((-1, 1), (300, 0)),
    "stop 2 has the arrival -7 ns, expected nanoseconds since 1970": stops((0, 1), (-7, 0)),
    "the departure from stop 2 is before the arrival there": stops((0, 1), (150, 0), (300, 0)),
}


@pytest.mark.parametrize("why", WRONG_TIMES)
def test_a_journey_without_its_times_is_refused_in_words_and_the_train_stays_where_it_is(why: str) -> None:
    cab = Cab()
    cab.tell(JOURNEY, changed_journey(stops=WRONG_TIMES[why]))
    for second in (51, 52):
        advice = cab.tick(second, s_m=0.0)
        assert advice.mode == das_pb2.MODE_NONE
        assert advice.reason.startswith("journey refused: ")
        assert why in advice.reason
    cab.tell(JOURNEY, changed_journey())
    assert cab.tick(53).mode != das_pb2.MODE_NONE
