"""A desk's server in this process with a made-up bus, and its clients in tests over HTTP and a socket."""

from __future__ import annotations

import asyncio
import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from functools import partial
from typing import Any
from unittest.mock import patch

import uvicorn
from google.protobuf.message import Message
from websockets.sync.client import ClientConnection, connect

from das.bus import das_pb2
from das.bus.topics import CAB, CONTROL, Received, Topic
from das.domain.route import Route, Stop
from das.domain.vehicle import Vehicle
from sim.desk.host import listening
from sim.desk.line import hello_of
from sim.desk.messages import DeskBus, PageSettings
from sim.desk.peer import Peer
from sim.desk.server import Desk, server_of
from tests.support.making import flat, make_train

TOKEN = "a-token-of-tests"
WAITS_S = 20.0
Line = tuple[Route, Vehicle, tuple[Stop, ...]]


class MadeUpBus:
    """A replacement of `das.bus.session.Bus`: a test sends messages (`cab`, `finish`) and reads those of the desk."""

    latest: MadeUpBus
    peer: Peer

    def __init__(self, train: str, **_: Any) -> None:
        self.said: list[tuple[str, Any]] = []
        self._coming: list[Received] = []
        self._look = 0
        MadeUpBus.latest = self

    def __enter__(self) -> MadeUpBus:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def receive(self, timeout_s: float) -> Received | None:
        if not self._coming:
            time.sleep(0.005)
            return None
        return self._coming.pop(0)

    def publish(self, topic: Topic, message: Message) -> None:
        kept = type(message)()
        kept.CopyFrom(message)
        self.said.append((topic.name, kept))

    def of(self, name: str) -> list[Any]:
        """The messages of a topic that the desk has published."""
        return [message for topic, message in list(self.said) if topic == name]

    def cab(self, like: Any = None, **fields: Any) -> int:
        """Send a Cab, `like` another one or with these fields; returns the number of its look."""
        self._look += 1
        cab = das_pb2.Cab(time_ns=self._look, stop_m=6000.0, signal_m=float("nan"), **fields)
        if like is not None:
            cab.CopyFrom(like)
        cab.look = self._look
        self._coming.append(Received(CAB, "", cab))
        return self._look

    def finish(self) -> None:
        """End the run."""
        self._coming.append(Received(CONTROL, "", das_pb2.Control(command=das_pb2.Control.COMMAND_FINISH)))


class Visitor:
    """The browser of a test at the server of a port; `stall(seconds)` keeps the server from answering for a while."""

    def __init__(self, port: int, stall: Callable[[float], object] = time.sleep) -> None:
        self.port, self.host, self.stall = port, f"127.0.0.1:{port}", stall

    def ask(self, path: str, method: str = "GET", **headers: str) -> http.client.HTTPResponse:
        """The answer to a request; without a header Host it names the server's own host."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAITS_S)
        connection.putrequest(method, path, skip_host=True)
        for name, value in {"Host": self.host, **{k.replace("_", "-"): v for k, v in headers.items()}}.items():
            connection.putheader(name, value)
        connection.endheaders()
        return connection.getresponse()

    @property
    def cookie(self) -> str:
        """The cookie set for the token."""
        return str(self.ask(f"/?token={TOKEN}").headers["Set-Cookie"]).partition(";")[0]

    def open(self, **headers: Any) -> AbstractContextManager[ClientConnection]:
        """A socket of the desk's own page; `Origin` and `Cookie` replace the page's values."""
        given = {"Cookie": self.cookie, **headers}
        origin: Any = given.pop("Origin", f"http://{self.host}")
        address = f"ws://{self.host}/desk"
        opened: AbstractContextManager[ClientConnection]
        opened = connect(address, origin=origin, additional_headers=given, compression=None)
        return opened


def until(done: Callable[[], Any], what: str) -> Any:
    """Wait until a call returns a true value and return that value."""
    end = time.monotonic() + WAITS_S
    while time.monotonic() < end:
        if found := done():
            return found
        time.sleep(0.005)
    raise AssertionError(f"waited {WAITS_S:.0f} s for {what}")


def next_of(socket: ClientConnection, kind: str) -> dict[str, Any]:
    """The next message of a kind sent to the page."""
    while True:
        message: dict[str, Any] = json.loads(socket.recv(timeout=WAITS_S))
        if message["t"] == kind:
            return message


def say(socket: ClientConnection, kind: str, **fields: Any) -> None:
    """Send a message as from the page."""
    socket.send(json.dumps({"t": kind, **fields}))


@contextmanager
def serving(server: uvicorn.Server, run: Callable[[], object]) -> Iterator[None]:
    """A server that another thread runs, until the end of the block."""
    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.should_exit = True
        thread.join(WAITS_S)


@contextmanager
def desk_server(line: Line | None = None) -> Iterator[tuple[Visitor, MadeUpBus]]:
    """A server of a made-up run, by default on a flat line of 6 km."""
    door = listening(0)
    line = line or (flat(6000.0), make_train(), flat(6000.0).stops)
    loop = asyncio.new_event_loop()
    with patch("sim.desk.peer.Bus", MadeUpBus):
        desk = Desk(DeskBus(train="T1"), hello_of(line, 0, "en", PageSettings()), line[0])
        until(lambda: desk.peer.joined, "the made-up bus")
        MadeUpBus.latest.peer = desk.peer
        server = server_of(desk.routes(), door.getsockname()[1], TOKEN)
        with door, closing(loop), serving(server, lambda: loop.run_until_complete(server.serve(sockets=[door]))):
            stall = partial(loop.call_soon_threadsafe, time.sleep)
            try:
                yield Visitor(door.getsockname()[1], stall), MadeUpBus.latest
            finally:
                desk.peer.close()
