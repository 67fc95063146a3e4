"""A server in this process that speaks the messages of a session with people, as a test says, to the real pages."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from sim.desk.host import listening
from sim.desk.server import Outbox, page_routes, server_of
from sim.experiment.people.watching import Watchers, WatcherSaid
from tests.support.desk_server import TOKEN, WAITS_S, Visitor, serving, until

WATCH_TOKEN = "another-token-of-tests"


class ScriptedSession:
    """The server's side of a session. A page that connects is sent `greeting`; `said` has what pages have said."""

    def __init__(self) -> None:
        self.greeting: list[dict[str, Any]] = []
        self.said: list[dict[str, Any]] = []
        self.shown: dict[str, Any] = {"language": "en", "participant": "P07", "others": [], "events": []}
        self.asked: list[WatcherSaid] = []
        self.watchers = Watchers(lambda: self.shown, self.asked.append)
        self._box: Outbox | None = None
        self._socket: WebSocket | None = None
        self.loop = asyncio.new_event_loop()

    def put(self, message: dict[str, Any], *, greets: bool = True) -> None:
        """Send a message to the page; one that `greets` is also what a page hears that connects later."""
        if greets:
            self.greeting = [message]
        if self._box is not None:
            self.loop.call_soon_threadsafe(self._box.put, message)

    def of(self, kind: str) -> list[dict[str, Any]]:
        """What pages have said, of a kind."""
        return [one for one in list(self.said) if one["t"] == kind]

    def drop(self) -> None:
        """Break the connection of the page."""
        assert self._socket is not None
        asyncio.run_coroutine_threadsafe(self._socket.close(1001), self.loop).result(WAITS_S)

    async def connect(self, socket: WebSocket) -> None:
        """The socket of the page."""
        await socket.accept()
        box = Outbox(socket)
        self._box, self._socket = box, socket
        for message in self.greeting:
            box.put(message)
        sending = asyncio.create_task(box.send())
        try:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                async for text in socket.iter_text():
                    self.said.append(json.loads(text))
        finally:
            sending.cancel()


@contextmanager
def scripted_session() -> Iterator[tuple[Visitor, ScriptedSession]]:
    """A scripted session behind the real doors and page files."""
    door, session = listening(0), ScriptedSession()
    port, loop = door.getsockname()[1], session.loop
    routes = [WebSocketRoute("/desk", session.connect), *session.watchers.routes(), *page_routes()]
    server = server_of(routes, port, TOKEN, WATCH_TOKEN)
    with door, closing(loop), serving(server, lambda: loop.run_until_complete(server.serve(sockets=[door]))):
        until(lambda: server.started, "the server")
        yield Visitor(port), session
