"""A train on the bus on the desk's page: its cab is made from messages alone, which a simulator's bridge may send."""

from __future__ import annotations

import asyncio
import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import cache
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from das.advice.advice import Cause
from das.bus import das_pb2
from das.bus.recording import Recording
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import ADVICE, CAB, CONTROL, DELAY, JOURNEY, POSITION, RESTRICTION, Received, Topic
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from sim.desk.messages import PageSettings
from sim.desk.watch import CLOCK_RUNS_ON_S, WatchedTrain, WatchServer
from sim.drivers.kinds import DriverKind, Presentation
from tests.support.desk_server import next_of, until
from tests.support.flat_days import flat_day
from tests.support.hand_clock import HandClock
from tests.support.making import REPOSITORY, refusal
from tests.support.node_process import FLAT, process
from tests.support.recorded_days import recorded_day
from tests.support.watched import StandIn, watched

S = 10**9
SLOW = "[[disturbances]]\nkind = 'restriction'\nfrom_m = 3000\nto_m = 3400\nspeed_kmh = 60\nannounced_m = 1500\n"
SAME = (
    *("presentation", "mode", "advised_speed_mps", "display_speed_mps", "advised_lever_ratio", "advised_force_n"),
    *("next_mode", "next_change_s", "next_change_m", "next_speed_mps", "second_mode", "second_change_m", "reason"),
    *("due_s", "target_way_m", "advice_s", "valid_until_s", "stop_m", "limit_mps"),
)
"""What a desk and the page of the same train show alike; the position is the sensor's on the page."""


@cache
def recorded() -> Recording:
    """A run with a restriction, whose driver was shown the guide."""
    day = flat_day(SLOW)
    return recorded_day(day, day.driver(DriverKind.PERFECT), Presentation.GUIDE)


class Told:
    """A watched train, and the clock by which it receives messages."""

    def __init__(self) -> None:
        self.clock = HandClock(recorded().of(CAB)[0].message.time_ns)
        self.train = WatchedTrain(load_route("flat-6km"), load_vehicle("re460-ic"), clocks=self.clock.clocks)

    def tell(self, topic: Topic, message: Any) -> None:
        self.train.hear(Received(topic, "", message))

    def replay(self, until_s: float, look: Callable[[Any], None] = lambda cab: None) -> None:
        """Receive the recording up to a time (s after its first cab); `look` gets each recorded cab."""
        entries = [(entry, topic) for topic in (JOURNEY, RESTRICTION, DELAY, POSITION, ADVICE, CAB)
                   for entry in recorded().of(topic)]  # fmt: skip
        end_ns = self.clock.time_ns + round(until_s * S)
        for entry, topic in sorted(entries, key=lambda one: one[0].log_time_ns):
            if entry.log_time_ns > end_ns:
                return
            self.clock.time_ns = max(self.clock.time_ns, entry.log_time_ns)
            if topic is CAB:
                look(entry.message)
            else:
                self.tell(topic, entry.message)

    def wait(self, seconds: float) -> None:
        self.clock.time_ns += round(seconds * S)

    @property
    def cab(self) -> Any:
        return self.train.cab()


def changed(message: Any, **fields: Any) -> Any:
    copy = type(message)()
    copy.CopyFrom(message)
    for name, value in fields.items():
        setattr(copy, name, value)
    return copy


def advised(seconds: float = 60.0) -> tuple[Told, Any, Any]:
    """A train with advice under way, its last position and its last advice."""
    told = Told()
    told.replay(seconds)
    assert told.cab.presentation == das_pb2.Cab.PRESENTATION_GUIDE
    last = {topic.name: [x for x in recorded().of(topic) if x.log_time_ns <= told.clock.time_ns][-1].message
            for topic in (POSITION, ADVICE)}  # fmt: skip
    return told, last["position"], last["advice"]


def test_the_page_shows_what_the_desk_of_the_same_train_shows() -> None:
    seen, told = [], Told()

    def look(desk: Any) -> None:
        cab = told.cab
        assert {name: str(getattr(cab, name)) for name in SAME} == {name: str(getattr(desk, name)) for name in SAME}
        for name in ("clock_s", "departure_s", "arrival_s"):
            assert getattr(cab, name) == pytest.approx(getattr(desk, name), abs=1e-6)
        assert list(cab.restrictions) == list(desk.restrictions)
        assert cab.s_m == pytest.approx(desk.s_m, abs=40.0)
        assert cab.speed_mps == pytest.approx(desk.speed_mps, abs=1.0)
        seen.append((cab.mode, len(cab.restrictions)))

    told.replay(150.0, look)
    assert len(seen) > 140
    assert len({mode for mode, _ in seen}) >= 3
    assert {count for _, count in seen} == {0, 1}


@pytest.mark.parametrize("ahead_s", [0, 60])
def test_advice_that_is_not_renewed_disappears_and_the_train_goes_on(ahead_s: int) -> None:
    """Also advice from a clock that is ahead, whose validity has not ended by the page's clock."""
    told, position, advice = advised()
    told.tell(ADVICE, changed(advice, valid_until_ns=advice.valid_until_ns + ahead_s * S))
    told.wait(3.5)
    goes_on_m = position.s_m + 3.5 * position.speed_mps
    told.tell(POSITION, changed(position, time_ns=told.clock.time_ns, s_m=goes_on_m))
    assert told.cab.presentation == 0
    assert told.cab.s_m == pytest.approx(goes_on_m)


def test_late_and_withdrawn_advice_is_not_shown() -> None:
    told, position, advice = advised()
    withdrawn = das_pb2.Advice(time_ns=advice.time_ns, s_m=math.nan, cause=das_pb2.CAUSE_POSITION_STALE)
    told.tell(ADVICE, withdrawn)
    assert (told.cab.presentation, told.cab.cause) == (0, Cause.POSITION_STALE)
    told.wait(4.0)
    told.tell(POSITION, changed(position, time_ns=told.clock.time_ns))
    told.tell(ADVICE, advice)
    assert told.cab.presentation == 0


@pytest.mark.parametrize(
    ("by_m", "uncertainty_m", "shown"), [(40, 1, True), (-300, 1, False), (800, 1, False), (300, 150, True)]
)
def test_advice_for_another_place_is_not_shown(by_m: float, uncertainty_m: float, shown: bool) -> None:
    told, position, advice = advised()
    told.tell(POSITION, changed(position, s_m=position.s_m + by_m, uncertainty_m=uncertainty_m))
    assert told.cab.s_m == pytest.approx(advice.s_m if shown else position.s_m + by_m, abs=0.1)
    assert (told.cab.presentation != 0) is shown
    assert shown or told.cab.cause == Cause.POSITION_REJECTED


def test_an_unusable_position_is_left_out() -> None:
    told, position, _ = advised()
    before = told.cab.s_m
    told.tell(POSITION, changed(position, s_m=math.nan))
    told.tell(POSITION, changed(position, s_m=5.0, quality=das_pb2.Position.QUALITY_INVALID))
    told.train.hear(Received(POSITION, "", None))
    assert told.cab.s_m == before


def test_the_page_says_what_is_missing() -> None:
    told = Told()
    journey = recorded().of(JOURNEY)[0].message
    assert told.cab == "journey"
    told.tell(JOURNEY, changed(journey, route_id="another"))
    assert told.cab == "line"
    told.tell(JOURNEY, changed(journey, vehicle_id="another"))
    assert told.cab == "line"
    told.tell(JOURNEY, journey)
    assert told.cab == "position"
    told.tell(POSITION, recorded().of(POSITION)[0].message)
    assert told.cab.stop_m == 6000.0
    told.wait(10.5)
    assert told.cab == "silent"
    told.tell(POSITION, changed(recorded().of(POSITION)[0].message, time_ns=told.clock.time_ns))
    assert told.cab.stop_m == 6000.0


def test_a_stop_counts_as_called_at_when_the_train_has_stood_there() -> None:
    told, journey = Told(), recorded().of(JOURNEY)[0].message
    start_ns = journey.stops[0].departure_ns
    middle = das_pb2.Journey.Stop(name="M", s_m=3000.0, arrival_ns=start_ns + 120 * S, departure_ns=start_ns + 150 * S)
    told.tell(JOURNEY, changed(das_pb2.Journey(stops=[journey.stops[0], middle, journey.stops[1]]),
                               route_id=journey.route_id, vehicle_id=journey.vehicle_id))  # fmt: skip
    found = []
    for s_m, speed_mps in ((2500, 20), (2995, 5), (2995, 0), (2995, 0), (3050, 8)):
        told.wait(1.0)
        told.tell(POSITION, das_pb2.Position(time_ns=told.clock.time_ns, s_m=s_m, speed_mps=speed_mps))
        found.append((told.cab.stop_m, told.cab.may_depart))
    assert found == [(3000, True), (3000, True), (6000, False), (6000, False), (6000, True)]


def test_the_clock_of_a_simulation_counts_and_stands_when_it_is_paused() -> None:
    told, position, _ = advised()
    at_ns = position.time_ns - 86_400 * S
    told.tell(POSITION, changed(position, time_ns=at_ns))
    told.tell(CONTROL, das_pb2.Control(time_ns=at_ns))
    told.wait(1.0)
    assert told.train.now_ns == pytest.approx(at_ns + S, abs=1e3)
    told.wait(5.0)
    assert told.train.now_ns == at_ns + round(CLOCK_RUNS_ON_S * S)
    assert told.cab.wall_ns == 0


@pytest.mark.parametrize("figure", [math.nan, math.inf, -1e300, 0.0])
@pytest.mark.parametrize("time_ns", [-(2**63), 0, 2**63 - 1])
@pytest.mark.parametrize("simulated", [False, True])
def test_no_message_ends_the_page(figure: float, time_ns: int, simulated: bool) -> None:
    told, _, advice = advised()
    odd = changed(advice, s_m=figure, speed_mps=figure, position_sd_m=figure, time_ns=time_ns, valid_until_ns=time_ns)
    stops = [das_pb2.Journey.Stop(s_m=figure, departure_ns=time_ns), das_pb2.Journey.Stop(s_m=figure)]
    slow = das_pb2.Restrictions.Restriction(start_m=figure, end_m=figure, limit_mps=figure)
    if simulated:
        told.tell(CONTROL, das_pb2.Control(time_ns=time_ns))
    for topic, message in (
        (ADVICE, odd),
        (POSITION, das_pb2.Position(time_ns=time_ns, s_m=1.0, speed_mps=figure, uncertainty_m=figure)),
        (RESTRICTION, das_pb2.Restrictions(restrictions=[slow])),
        (DELAY, das_pb2.Delay(delay_s=figure)),
        (JOURNEY, changed(das_pb2.Journey(stops=stops), route_id="flat-6km", vehicle_id="re460-ic")),
    ):
        told.tell(topic, message)
        assert told.cab
    told.wait(3.1)
    told.tell(DELAY, das_pb2.Delay())
    assert told.cab


class OpenServer:
    """A server that serves until it is asked to stop."""

    should_exit = False

    async def serve(self, sockets: object) -> None:
        while not self.should_exit:
            await asyncio.sleep(0.01)


def test_the_command_ends_if_its_page_can_no_longer_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    told, bus = Told(), Mock(train="T1", receive=lambda *_, **__: time.sleep(0.01))
    monkeypatch.setattr(told.train, "cab", Mock(side_effect=DasError("a fault of the page")))
    with pytest.raises(DasError, match="a fault of the page"):
        asyncio.run(WatchServer(told.train, bus, "en", PageSettings()).run(OpenServer(), None))


def test_of_a_flood_of_advice_only_the_newest_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    (told, _, advice), server = advised(), OpenServer()
    coming, drawn = iter([Received(ADVICE, "", advice)] * 2000), Mock(return_value="silent")

    def receive(*_: object, **__: object) -> Received | None:
        server.should_exit = (received := next(coming, None)) is None
        return received

    monkeypatch.setattr(told.train, "cab", drawn)
    before = told.train._advices
    bus = Mock(train="T1", receive=receive, trains=list)
    asyncio.run(WatchServer(told.train, bus, "en", PageSettings()).run(server, None))
    assert told.train._advices == before + 2000
    assert drawn.call_count < 200


def test_the_command_ends_even_if_news_arrive_with_its_end() -> None:
    """asyncio before Python 3.12 loses a cancellation that comes together with what the task waits for."""
    page = WatchServer(Told().train, Mock(train="T1", receive=lambda *_, **__: time.sleep(0.01)), "en", PageSettings())

    async def serve(sockets: object) -> None:
        await asyncio.sleep(0.05)
        page._news.set()
        await asyncio.sleep(0)

    async def ends() -> bool:
        ended, _ = await asyncio.wait({asyncio.create_task(page.run(Mock(serve=serve), None))}, timeout=10.0)
        return bool(ended)

    assert asyncio.run(ends())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--watch", "--watch: needs --route and --vehicle, as given to the node"),
        ("--watch --route nowhere --vehicle re460-ic", "nowhere: not a bundled route"),
        ("--watch --route flat-6km --vehicle re460-ic --train a/b", "train name 'a/b': expected"),
        ("--watch --route flat-6km --vehicle re460-ic --connect tcp/0.0.0.0:1", "the bus stays on this machine"),
        ("--watch --route flat-6km --vehicle re460-ic --advice four-mode", "--advice four-mode: expected guide or"),
        ("--watch --notches 5", "--notches 5: --watch shows a train on the bus; nothing is driven"),
        ("--watch run.mcap", "run.mcap: --watch shows a train on the bus: expected neither a scenario nor a recording"),
        ("clear-day --connect tcp/127.0.0.1:1", "--connect tcp/127.0.0.1:1: only --watch uses it"),
    ],
)
def test_what_cannot_be_watched_is_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, words: str, said: str
) -> None:
    assert said in refusal("desk", *words.split(), "--no-open", cwd=tmp_path_factory.mktemp("refused"))


@pytest.mark.slow
def test_a_simulator_is_advised_over_its_bridge_and_no_advice_is_shown_for_another_place() -> None:
    """30 frames a second; pause, jump, time factor and an earlier state, with a real node and the page's socket."""
    ours, theirs = (endpoint(port) for port in free_ports(2))
    (port,) = free_ports(1)
    bridge = (REPOSITORY / "docs" / "examples" / "simulator_bridge.py").read_text(encoding="utf-8")
    for old, new in {"tcp/127.0.0.1:7448": ours, "tcp/127.0.0.1:7447": theirs, "5005": str(port)}.items():
        bridge = bridge.replace(old, new)
    arguments = ("--train", "IC1", "--listen", theirs, "--connect", ours, "--clock", "bus", "--no-restrictions")
    with process("das.node", *FLAT, *arguments), watched("IC1", [ours, theirs]) as visitor, visitor.open() as page:
        assert next_of(page, "hello")["missing"] == "journey"
        user = subprocess.Popen([sys.executable, "-c", bridge])
        with StandIn(port) as game:

            def check(cab: dict[str, Any]) -> None:
                """The train is where the page shows it, and it was near there when the advice was made."""
                front_m, made_m = (game.front_m(36_005.0 + cab[name]) for name in ("clock_s", "advice_s"))
                assert front_m is not None
                assert made_m is not None
                assert abs(cab["s_m"] - front_m) < 40.0
                assert -5.0 <= front_m - made_m < 3.2 * 20.0

            def see(shown: bool, within_s: float, then_for_s: float = 0.0) -> None:
                """Wait until advice is shown, or is not, for a time; all advice must be for the place of the train."""
                began_s, seen_s = time.monotonic(), math.inf
                while time.monotonic() < min(seen_s, began_s + within_s) + then_for_s:
                    cab = next_of(page, "cab")["cab"]
                    if bool(cab["presentation"]) is shown:
                        seen_s = min(seen_s, time.monotonic())
                    assert bool(cab["presentation"]) is shown or math.isinf(seen_s)
                    if shown and cab["presentation"]:
                        check(cab)
                assert seen_s <= began_s + within_s

            see(True, 60.0, then_for_s=5.0)
            game.factor = 5.0
            seen = []
            while game.s_m < 800.0:
                cab = next_of(page, "cab")["cab"]
                seen.append(cab["presentation"] != 0)
                if seen[-1]:
                    check(cab)
            assert seen.count(True) > 0.8 * len(seen)
            game.factor = 0.0
            see(False, 6.0, then_for_s=3.0)
            game.factor = 1.0
            see(True, 8.0)
            game.jump(by_m=1500.0)
            see(False, 1.5)
            see(True, 10.0, then_for_s=2.0)
            game.jump(by_m=-1000.0, by_s=-40.0)
            while next_of(page, "cab")["cab"]["s_m"] > game.s_m + 200.0:
                pass
            see(True, 10.0, then_for_s=2.0)
        with Bus("IC2", connect=[theirs]) as other:
            until(lambda: other.trains() == ["IC1"], "the name of the train that the node advises")
        user.kill()
        user.communicate()
        assert next_of(page, "phase") == {"t": "phase", "phase": "waiting", "missing": "silent", "others": ""}


class Node:
    """A node and a simulator by hand on a real bus: they tell where a train is now, and give it advice for that place.

    `flood` sends, for a time, positions, advice, journeys, and payloads that are no messages.
    """

    def __init__(self, bus: Bus) -> None:
        _, position, advice = advised()
        journey = recorded().of(JOURNEY)[0].message
        self._bus, self._position, self._advice, self._journey = bus, position, advice, das_pb2.Journey()
        self._journey.CopyFrom(journey)
        for stop in self._journey.stops:
            stop.arrival_ns += time.time_ns() - advice.time_ns
            stop.departure_ns += time.time_ns() - advice.time_ns
        self.s_m = advice.s_m

    def begin(self) -> None:
        """Send the journey."""
        self._bus.publish(JOURNEY, changed(self._journey, time_ns=time.time_ns()))

    def move(self) -> None:
        """Send a position, a little further on."""
        self.s_m += 0.001
        self._bus.publish(POSITION, changed(self._position, time_ns=time.time_ns(), s_m=self.s_m))

    def advise(self) -> None:
        """Send advice for this place."""
        now_ns = time.time_ns()
        self._bus.publish(ADVICE, changed(self._advice, time_ns=now_ns, valid_until_ns=now_ns + 3 * S, s_m=self.s_m))

    def flood(self, for_s: float, *, advice: bool) -> None:
        junk = [self._bus._declare(topic) for topic in (POSITION, ADVICE, JOURNEY, CONTROL, DELAY, RESTRICTION)]
        rng, end_s, sent = np.random.default_rng(5), time.monotonic() + for_s, 0
        while time.monotonic() < end_s:
            self.move()
            if advice:
                self.advise()
            if sent % 5 == 0:
                self.begin()
                junk[sent % len(junk)].put(b"\xff" + rng.bytes(int(rng.integers(0, 40))))
            sent += 1
            time.sleep(0.001)


CROWD = """
import sys, time
from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import POSITION
mine, other, for_s, s_m = *sys.argv[1:3], *map(float, sys.argv[3:])
with Bus("IC1", listen=mine) as a, Bus("IC2", listen=other) as b:
    sent, end_s = 0, time.monotonic() + for_s
    while time.monotonic() < end_s:
        for bus, at_m in ((a, s_m), (b, 5000.0)):
            bus.publish(POSITION, das_pb2.Position(time_ns=time.time_ns(), s_m=at_m, speed_mps=1.0))
        sent += 1
        time.sleep(0.0005)
print(sent / for_s)
"""
"""Another program on the bus: about a thousand positions a second of a train, and as many of another one."""


@pytest.mark.slow
def test_floods_junk_another_train_and_a_lost_bus_leave_the_page_true() -> None:
    """Also beside a page that reads nothing; advice that is not renewed disappears within 3 s in the flood."""
    places = [endpoint(port) for port in free_ports(3)]
    with watched("IC1", places) as visitor, visitor.open() as page, visitor.open():

        def cab_after(wall_s: float) -> dict[str, Any]:
            while True:
                cab: dict[str, Any] = next_of(page, "cab")["cab"]
                if cab["time_ns"] > wall_s * S:
                    return cab

        def reads_while(runs: Callable[[], object]) -> None:
            while runs():  # or the server would close the socket
                page.recv(timeout=20)

        def drives(bus: Bus, then_silent_s: float) -> None:
            """A train is advised in a flood, and then no longer, for a time."""
            node = Node(bus)
            flood = threading.Thread(target=node.flood, args=(6.0,), kwargs={"advice": True})
            flood.start()
            while not next_of(page, "cab")["cab"]["presentation"]:
                assert flood.is_alive()
            while flood.is_alive():
                cab = next_of(page, "cab")["cab"]
                assert cab["presentation"] == das_pb2.Cab.PRESENTATION_GUIDE
                assert abs(cab["s_m"] - node.s_m) < 30.0
            advised_s = time.time()
            flood = threading.Thread(target=node.flood, args=(then_silent_s,), kwargs={"advice": False})
            flood.start()
            cab = cab_after(advised_s + 3.5)
            assert cab["presentation"] == 0
            assert abs(cab["s_m"] - node.s_m) < 30.0
            reads_while(flood.is_alive)

        words = [sys.executable, "-c", CROWD, *places[1:], "16", str(advised()[2].s_m)]
        crowd = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        with Bus("IC1", listen=places[0]) as bus:
            drives(bus, 5.0)
        reads_while(lambda: crowd.poll() is None)
        assert float(crowd.communicate()[0]) > 300
        until(lambda: next_of(page, "phase").get("missing") == "silent", "the silence")
        with Bus("IC1", listen=places[0]) as bus:  # the bus is there again, and the node
            drives(bus, 4.0)
