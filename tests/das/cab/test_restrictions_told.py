"""A node advises only when it knows which restrictions are in force, and on journeys that have all their times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from das.advice.advice import Cause
from das.bus import das_pb2
from das.bus.topics import ADVICE, CONTROL, JOURNEY, POSITION, RESTRICTION, STATUS
from das.cab.cab import CabSettings
from das.cab.heard import PositionHeard, RestrictionsHeard
from das.estimate.estimate import PositionFix
from sim.world.in_process import InProcess
from sim.world.loop import Tick
from tests.support.driven_node import START_NS, DrivenNode, S, journey, restrictions
from tests.support.flat_days import FLAT, service_of
from tests.support.node_process import a_journey, node, status, until


def test_a_node_that_was_told_nothing_of_restrictions_does_not_advise_until_it_is() -> None:
    cab = DrivenNode(told=False)
    assert cab.tick(40).cause == Cause.NO_JOURNEY
    cab.tell(JOURNEY, journey())
    silent = cab.tick(50)
    assert (silent.mode, silent.cause) == (das_pb2.MODE_NONE, Cause.RESTRICTIONS_UNTOLD)
    assert silent.reason.text.startswith("no list of restrictions received yet")
    sent = cab.sink.of(STATUS)[-1]
    assert (sent.state, sent.cause, sent.reason) == (
        *(das_pb2.Status.STATE_WITHDRAWN, Cause.RESTRICTIONS_UNTOLD, silent.reason.text),
    )
    assert silent.reason.text in cab.sink.events()
    cab.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS))
    assert cab.tick(51).mode != das_pb2.MODE_NONE


def test_a_list_that_cannot_be_heeded_is_no_list() -> None:
    cab = DrivenNode(told=False)
    cab.tell(JOURNEY, journey())
    cab.tell(RESTRICTION, restrictions(49, -1.0))
    assert "restrictions cannot be applied" in cab.tick(50).reason.text
    cab.tell(RESTRICTION, restrictions(51, 10.0))
    assert cab.tick(52).limit_mps == 10.0


def test_a_site_without_restrictions_says_so_and_a_list_is_heeded_all_the_same() -> None:
    cab = DrivenNode(CabSettings(no_restrictions=True), told=False)
    cab.tell(JOURNEY, journey())
    assert cab.tick(50).limit_mps > 40.0
    cab.tell(RESTRICTION, restrictions(51, 10.0))
    assert cab.tick(52).limit_mps == 10.0


def test_a_list_holds_for_the_next_journey() -> None:
    cab = DrivenNode(told=False)
    cab.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS))
    for second in (50, 60):
        cab.tell(JOURNEY, journey(time_ns=START_NS + second * S))
        assert cab.tick(second).cause == Cause.NONE


@pytest.mark.parametrize("told", [False, True])
def test_the_simulators_node_in_process_is_told_as_over_the_bus(told: bool, tmp_path: Path) -> None:
    (tmp_path / "flat.toml").write_text(FLAT, encoding="utf-8")
    service = service_of(tmp_path / "flat.toml")
    link = InProcess(service)
    now_ns = service.moment_ns(60.0)
    position = PositionHeard(fix=PositionFix(time_ns=now_ns, s_m=1_000.0, speed_mps=20.0))
    nothing = RestrictionsHeard(time_ns=now_ns, restrictions=())
    for _ in range(2):  # Started anew it knows what it was told.
        advice = link.exchange(Tick(1, now_ns, (position, nothing) if told else (position,)))
        assert (advice.cause is Cause.RESTRICTIONS_UNTOLD) == (not told)
        link.restart()
        if told:
            again = link.exchange(Tick(1, now_ns, (position,)))
            assert again.cause is not Cause.RESTRICTIONS_UNTOLD


def asked(bus: Any, child: Any, *, tick: int) -> Any:
    now_ns = START_NS + 60 * S
    bus.publish(POSITION, das_pb2.Position(time_ns=START_NS, s_m=0.0, speed_mps=0.0))
    bus.publish(POSITION, das_pb2.Position(time_ns=now_ns, s_m=2_600.0, speed_mps=14.0))
    bus.publish(CONTROL, das_pb2.Control(time_ns=now_ns, tick=tick))
    return until(bus, lambda r: r.topic is ADVICE and r.message.tick == tick, child)


def test_the_option_of_a_site_without_restrictions_over_the_bus() -> None:
    with node("--clock", "bus", "--no-restrictions", journey=a_journey()) as (bus, child):
        until(bus, status(das_pb2.Status.STATE_READY), child)
        assert asked(bus, child, tick=1).mode != das_pb2.MODE_NONE


@pytest.mark.parametrize(
    ("places", "text"),
    [
        ([(20e3, 21e3)], "restriction: one of 10 m/s from 20000 to 21000 m is off the route (0 to 6000 m)"),
        ([(-900.0, -100.0)], "restriction: one of 10 m/s from -900 to -100 m is off the route"),
        ([(20e3, 21e3), (1e3, 2e3), (6e3, 7e3)], "one of 10 m/s from 20000 to 21000 m and 1 more is off the route"),
        ([(5.9e3, 7e3)], ""),
        ([(-100.0, 10.0)], ""),
        ([], ""),
    ],
)
def test_a_restriction_wholly_off_the_route_is_an_event(places: list[tuple[float, float]], text: str) -> None:
    driven = DrivenNode()
    them = [das_pb2.Restrictions.Restriction(start_m=a, end_m=b, limit_mps=10.0) for a, b in places]
    driven.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS + S, restrictions=them))
    advice = driven.tick(2)
    assert advice.mode != das_pb2.MODE_NONE
    assert text in driven.sink.events()
    assert ("off the route" in driven.sink.events()) is bool(text)


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
    cab = DrivenNode()
    cab.tell(JOURNEY, journey(stops=WRONG_TIMES[why]))
    for second in (51, 52):
        advice = cab.tick(second, s_m=0.0)
        assert advice.mode == das_pb2.MODE_NONE
        assert advice.reason.text.startswith("journey refused: ")
        assert why in advice.reason.text
    cab.tell(JOURNEY, journey())
    assert cab.tick(53).mode != das_pb2.MODE_NONE
