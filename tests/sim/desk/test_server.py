"""The server of the cab desk: who is let in, what a page may say, and what happens when pages misbehave."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from http.cookiejar import CookieJar
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection

from das.bus import das_pb2
from das.domain.errors import DasError
from sim.desk.host import listening
from sim.desk.messages import GIVEN, LARGEST_BYTES, DeskBus, DeskGiven, encoded, heard
from sim.desk.server import BAD, FILES, FLOOD, MOST_AT_ONCE, OF_WATCH, TAKEN, Allowance, Outbox
from sim.drivers.kinds import Presentation
from sim.world.lockstep import Process
from tests.support.desk_page import FLAT_DAY, desk_command
from tests.support.desk_server import TOKEN, MadeUpBus, Visitor, desk_server, next_of, say, until

Served = tuple[Visitor, MadeUpBus]
MARKUP = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with desk_server() as found:
        yield found


@pytest.fixture
def fresh() -> Iterator[Served]:
    with desk_server() as found:
        yield found


@contextmanager
def driving(visitor: Visitor, bus: MadeUpBus) -> Iterator[ClientConnection]:
    """A page that drives and has drawn the first cab."""
    with visitor.open() as socket:
        look = bus.cab()
        assert next_of(socket, "cab")["cab"]["look"] == look
        say(socket, "drawn", look=look)
        yield socket


def closed_with(socket: ClientConnection) -> int:
    """The code with which the server closes a socket."""
    with suppress(ConnectionClosed):
        for _ in socket:
            pass
    assert socket.close_code is not None
    return socket.close_code


def test_the_token_of_the_address_becomes_a_cookie_and_leaves_the_address(served: Served) -> None:
    visitor, _ = served
    entered = visitor.ask(f"/?token={TOKEN}")
    assert (entered.status, entered.headers["Location"]) == (303, "/")
    cookie = entered.headers["Set-Cookie"].lower()
    assert f"desk-{visitor.port}={TOKEN}" in cookie
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    page = visitor.ask("/", Cookie=visitor.cookie)
    assert page.status == 200
    assert "default-src 'none'" in page.headers["Content-Security-Policy"]
    assert "unsafe" not in page.headers["Content-Security-Policy"]
    assert b"desk.js" in page.read()


@pytest.mark.parametrize("name", sorted(name for name in FILES if f"/{name}" not in OF_WATCH))
def test_every_file_of_the_page_is_served_with_a_strict_policy(served: Served, name: str) -> None:
    answer = served[0].ask(f"/{name}", Cookie=served[0].cookie)
    assert (answer.status, answer.headers["X-Content-Type-Options"]) == (200, "nosniff")
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}),
        ("/?token=wrong", {}),
        (f"/?token={TOKEN}&token={TOKEN}", {}),
        (f"/desk.js?token={TOKEN}", {}),
        ("/", {"Cookie": "desk-1=a-token-of-tests"}),
        (f"/?token={TOKEN}", {"Host": "evil.example"}),
        (f"/?token={TOKEN}", {"Host": "127.0.0.1"}),
        (f"/?token={TOKEN}", {"Host": "localhost"}),
        (f"/?token={TOKEN}", {"Origin": "http://evil.example"}),
    ],
)
def test_whoever_has_no_token_or_comes_from_elsewhere_gets_an_empty_403(
    served: Served, path: str, headers: dict[str, str]
) -> None:
    answer = served[0].ask(path, **headers)
    assert (answer.status, answer.read()) == (403, b"")


def test_nothing_but_reading_and_no_other_file_is_allowed(served: Served) -> None:
    visitor, cookie = served[0], served[0].cookie
    assert visitor.ask("/", "POST", Cookie=cookie).status == 403
    for path in ("/server.py", "/../server.py", "/%2e%2e/server.py", "/page/desk.js"):
        assert visitor.ask(path, Cookie=cookie).status == 404


@pytest.mark.parametrize(
    "headers",
    [{"Cookie": ""}, {"Cookie": "desk=x"}, {"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": None}],
)
def test_a_socket_without_the_cookie_or_from_another_page_is_refused(served: Served, headers: dict[str, str]) -> None:
    with pytest.raises(InvalidStatus) as raised, served[0].open(**headers):
        pass
    assert raised.value.response.status_code == 403


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", '{"t":"fly"}', '{"t":"lever"}', '{"t":"lever","k":1,"ratio":1.1,"at":1,"by":"key"}',
     '{"t":"lever","k":-1,"ratio":0,"at":1,"by":"key"}', '{"t":"lever","k":1,"ratio":NaN,"at":1,"by":"key"}',
     '{"t":"lever","k":1,"ratio":"1","at":1,"by":"key"}', '{"t":"drawn","look":1e30}', "[" * 4000,
     '{"t":"drawn","look":1,"x":' + "[" * 1900 + "]" * 1900 + "}x"],
)  # fmt: skip
def test_what_is_no_message_of_the_page_is_refused(served: Served, text: str) -> None:
    assert heard(text) is None
    with served[0].open() as socket:
        socket.send(text)
        assert closed_with(socket) == BAD


def test_a_message_that_is_too_large_closes_the_socket(served: Served) -> None:
    with served[0].open() as socket:
        socket.send("x" * (LARGEST_BYTES + 1))
        assert closed_with(socket) == 1009


def test_numbers_that_json_has_no_word_for_become_null() -> None:
    assert json.loads(encoded({"a": float("nan"), "b": [float("inf"), 1.5]})) == {"a": None, "b": [None, 1.5]}


def test_a_page_that_says_more_than_a_hand_can_is_cut_off(fresh: Served) -> None:
    visitor, bus = fresh
    with driving(visitor, bus) as socket:
        with suppress(ConnectionClosed):
            for k in range(1, 20_000):
                say(socket, "lever", k=k, ratio=(k % 3 - 1) / 10, at=1.0, by="key")
        assert closed_with(socket) == FLOOD
    assert 0 < len(bus.of("action")) < MOST_AT_ONCE
    with driving(visitor, bus) as again:
        say(again, "lever", k=30_000, ratio=0.7, at=1.0, by="key")
        until(lambda: bus.of("action")[-1].lever_ratio == 0.7, "the setting of a page that behaves")


def test_an_allowance_fills_up_with_time() -> None:
    allowance = Allowance(0.0)
    assert [allowance.spend(0.0) for _ in range(int(MOST_AT_ONCE))] == [True] * int(MOST_AT_ONCE)
    assert not allowance.spend(0.0)
    assert allowance.spend(1.0)


def test_no_file_of_the_page_makes_markup_of_a_string_but_of_the_text_that_the_server_rendered() -> None:
    scripts = "".join(path.read_text(encoding="utf-8") for path in FILES.values() if path.suffix == ".js")
    rendered = '$("prose").innerHTML = step.html ?? "";'
    assert scripts.count(rendered) == 1
    scripts = scripts.replace(rendered, "")
    assert not [word for word in ("innerHTML", "outerHTML", "insertAdjacent", "document.write") if word in scripts]


def test_the_page_does_not_hear_what_will_happen(fresh: Served) -> None:
    """A scenario's title ("Unplanned stop at a signal") or a presentation's name would tell the manipulation."""
    with fresh[0].open() as socket:
        hello = next_of(socket, "hello")
    assert "title" not in hello
    told = json.dumps(hello) + "".join(path.read_text(encoding="utf-8", errors="replace") for path in FILES.values())
    named = {name: re.search(rf"[\"'`]{name}[\"'`]", told) for name in Presentation if name is not Presentation.NONE}
    assert [name for name, found in named.items() if found] == []


def test_the_run_begins_when_the_person_is_ready(fresh: Served) -> None:
    visitor, bus = fresh
    with visitor.open() as socket:
        assert next_of(socket, "hello")["phase"] == "welcome"
        assert bus.of("controls") == []
        say(socket, "ready")
        assert next_of(socket, "phase")["phase"] == "preparing"
        until(lambda: [one.look for one in bus.of("controls")][:1] == [0], "the driver's announcement")
        bus.cab()
        assert next_of(socket, "phase")["phase"] == "driving"
        bus.finish()
        assert next_of(socket, "phase")["phase"] == "over"


def test_a_setting_is_on_the_bus_with_its_three_clocks(fresh: Served) -> None:
    visitor, bus = fresh
    with driving(visitor, bus) as socket:
        at_ms = time.time() * 1000
        say(socket, "lever", k=1, ratio=0.4, at=at_ms, by="key", look=1)
        action = until(lambda: bus.of("action"), "the action")[0]
        assert (action.number, action.lever_ratio, action.look) == (1, 0.4, 1)
        assert action.device == das_pb2.Action.DEVICE_KEY
        assert action.browser_ns == pytest.approx(at_ms * 1e6)
        assert action.browser_ns <= action.server_ns <= action.bus_ns
        assert bus.of("controls")[-1].lever_ratio == 0.4
        look = bus.cab()
        until(lambda: bus.of("controls")[-1].look == look, "the answer to the next look")
        assert bus.of("controls")[-1].lever_ratio == 0.4
        say(socket, "lever", k=1, ratio=1.0, at=at_ms, by="key")  # not newer than the last one
        say(socket, "mark", at=at_ms, look=look)
        say(socket, "mark", at=at_ms, text="sound on")
        marks = until(lambda: [x for x in bus.of("mark") if x.text], "the marks") and bus.of("mark")
        kinds = [one.kind for one in marks]
        assert kinds == [das_pb2.Mark.KIND_OPENED, das_pb2.Mark.KIND_MARK, das_pb2.Mark.KIND_SETTING]
        assert len(bus.of("action")) == 1


def test_a_page_that_draws_nothing_answers_no_look(fresh: Served) -> None:
    """A covered or sleeping page keeps its socket; after 1 s without a frame the run's dead-man brake takes over."""
    visitor, bus = fresh
    with driving(visitor, bus) as socket:
        time.sleep(1.1)
        away = bus.cab()
        until(lambda: [x for x in bus.of("mark") if x.kind == das_pb2.Mark.KIND_AWAY], "the mark")
        assert away not in [one.look for one in bus.of("controls")]
        say(socket, "drawn", look=away)
        until(lambda: [x for x in bus.of("mark") if x.kind == das_pb2.Mark.KIND_BACK], "the mark")
        look = bus.cab()
        until(lambda: look in [one.look for one in bus.of("controls")], "the answer")


def test_a_paused_desk_answers_every_look_with_the_pause_although_nothing_is_drawn(fresh: Served) -> None:
    visitor, bus = fresh
    with driving(visitor, bus):
        peer = bus.peer
        peer.pause(True)
        until(lambda: bus.of("controls")[-1].paused, "the pause")
        time.sleep(1.1)
        look = bus.cab()
        until(lambda: bus.of("controls")[-1].look == look, "the answer")
        assert bus.of("controls")[-1].paused
        peer.pause(False)
        assert not until(lambda: bus.of("controls")[-1:], "the end of the pause")[0].paused


def test_over_a_slow_line_the_person_drives_and_the_times_say_so(fresh: Served) -> None:
    """250 ms from the cab to the page and from the page to the desk: every look is answered, nobody is away."""
    visitor, bus = fresh
    with driving(visitor, bus) as socket:
        for k in range(1, 6):
            look = bus.cab()
            next_of(socket, "cab")
            at_ms = time.time() * 1000
            time.sleep(0.25)
            say(socket, "drawn", look=look)
            say(socket, "lever", k=k, ratio=k / 10, at=at_ms, by="touch", look=look)
        actions = until(lambda: bus.of("action")[4:] and bus.of("action"), "the actions")
        assert [(one.server_ns - one.browser_ns) * 1e-9 > 0.24 for one in actions] == [True] * 5
        assert {one.look for one in bus.of("controls")} >= set(range(2, 7))
        assert das_pb2.Mark.KIND_AWAY not in [one.kind for one in bus.of("mark")]


def test_the_newer_page_drives_and_the_older_says_so(fresh: Served) -> None:
    visitor, bus = fresh
    with driving(visitor, bus) as old, ExitStack() as later:
        say(old, "lever", k=1, ratio=0.4, at=1.0, by="key")
        until(lambda: bus.of("action"), "the action")
        new = later.enter_context(visitor.open())
        hello = next_of(new, "hello")
        assert (hello["lever"], hello["seq"], hello["phase"]) == (0.4, 1, "driving")  # a reload keeps the lever
        assert next_of(old, "phase")["phase"] == "taken"
        assert closed_with(old) == TAKEN
        say(new, "lever", k=2, ratio=0.5, at=1.0, by="touch")
        until(lambda: [one.number for one in bus.of("action")] == [1, 2], "the new page's action")


def test_a_page_that_comes_back_after_a_second_finds_the_lever_at_0(fresh: Served) -> None:
    visitor, bus = fresh
    with driving(visitor, bus) as socket:
        say(socket, "lever", k=1, ratio=1.0, at=1.0, by="key")
        until(lambda: bus.of("action"), "the action")
    until(lambda: [x for x in bus.of("mark") if x.kind == das_pb2.Mark.KIND_GONE], "the mark")
    time.sleep(1.0)
    with visitor.open() as back:
        hello = next_of(back, "hello")
        assert (hello["lever"], hello["seq"]) == (0.0, 2)
        action = bus.of("action")[-1]
        assert (action.lever_ratio, action.device) == (0.0, das_pb2.Action.DEVICE_DESK)


def test_a_cab_goes_to_the_page_exactly_as_it_is_recorded(fresh: Served) -> None:
    visitor, bus = fresh
    with visitor.open() as socket:
        bus.cab(speed_mps=1 / 3, presentation=4, mode=1, advised_speed_mps=0.1 + 0.2, valid_until_s=9.0,
                reason=das_pb2.Reason(code=5, stop=MARKUP, late_s=float("nan")))  # fmt: skip
        said = next_of(socket, "cab")
    assert said["cab"]["speed_mps"] == 1 / 3
    assert said["cab"]["advised_speed_mps"] == 0.1 + 0.2
    assert said["cab"]["signal_m"] is None
    assert set(said["cab"]) == {field.name for field in das_pb2.Cab.DESCRIPTOR.fields}
    assert said["why"] == {"en": f"stop at {MARKUP}", "de": f"Halt in {MARKUP}", "fr": f"arrêt à {MARKUP}"}


class SlowSocket:
    """A page that reads slowly: while it reads a message, others come."""

    def __init__(self) -> None:
        self.box: Outbox | None = None
        self.read: list[Any] = []
        self.closed = 0

    async def send_text(self, text: str) -> None:
        """Read a message; the first takes so long that two cabs and a phase come meanwhile."""
        self.read.append(json.loads(text))
        if len(self.read) == 1 and self.box is not None:
            for look in (2, 3):
                self.box.put({"t": "cab", "look": look})
            self.box.put({"t": "phase", "phase": "over"}, last=TAKEN)

    async def close(self, code: int) -> None:
        """The server closes the socket."""
        self.closed = code


def test_a_slow_page_loses_old_cabs_and_nothing_else() -> None:
    socket = SlowSocket()
    socket.box = Outbox(socket)  # type: ignore[arg-type]
    socket.box.put({"t": "cab", "look": 1})
    asyncio.run(socket.box.send())
    assert socket.read == [{"t": "cab", "look": 1}, {"t": "cab", "look": 3}, {"t": "phase", "phase": "over"}]
    assert socket.closed == TAKEN


def test_a_page_that_reads_nothing_keeps_only_the_newest_of_each_kind() -> None:
    box = Outbox(SlowSocket())  # type: ignore[arg-type]
    for number in range(1000):
        for kind in ("hello", "phase", "cab", "state"):
            box.put({"t": kind, "n": number})
    assert box._waiting == [{"t": kind, "n": 999} for kind in ("hello", "phase", "cab", "state")]


def test_a_server_that_cannot_join_the_bus_ends_and_says_why(tmp_path: Path) -> None:
    """Or the run would wait for its driver for good, and the page for the run."""
    lost = str(tmp_path / "desk.json5")
    with listening(0) as door:
        bus = DeskBus(train="T1", file=lost)
        given = DeskGiven(door=door.fileno(), token=TOKEN, scenario="clear-day", language="en", bus=bus)
        child = Process("desk", "sim.desk", (), given={GIVEN: encoded(given)}, door=door.fileno())
        with child, pytest.raises(DasError) as raised:
            until(child.check, "the end of the server")
    assert lost in str(raised.value)


def test_settings_within_10_ms_are_published_as_the_last_of_them(fresh: Served) -> None:
    visitor, bus = fresh
    with driving(visitor, bus) as socket:
        for k in range(1, 101):
            say(socket, "lever", k=k, ratio=k / 100, at=1.0, by="wheel")
        until(lambda: [one for one in bus.of("action") if one.number == 100], "the last setting")
        numbers = [one.number for one in bus.of("action")]
        assert numbers == sorted(numbers)
        assert len(numbers) < 100
        assert bus.of("controls")[-1].lever_ratio == 1.0


@pytest.mark.slow
def test_the_command_serves_its_page_until_it_is_asked_to_end(tmp_path: Path) -> None:
    cookies = urllib.request.HTTPCookieProcessor(CookieJar())
    with desk_command(tmp_path, str(FLAT_DAY), "--out", "d.mcap") as (child, address):
        with urllib.request.build_opener(cookies).open(address, timeout=60) as answer:
            assert b'src="desk.js"' in answer.read()
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=60)
    assert "Traceback" not in said
