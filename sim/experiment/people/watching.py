"""The experimenter's page: its socket, and what it may ask of a session. It shows everything and drives nothing.

The page has its own address and token (`sim.desk.server.Doorkeeper`), because it names the condition.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Annotated, Any, Final, Protocol

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from sim.desk.messages import heard
from sim.desk.server import BAD, FILES, FLOOD, WATCH, Allowance, Outbox

STATE_S: Final = 1.0
"""Interval (s) of the states; a change is sent at once."""
LONGEST_NOTE: Final = 500
"""Longest note (characters)."""


class WatcherMark(msgspec.Struct, tag_field="t", tag="mark", frozen=True):
    """A mark of the experimenter: the key that was pressed."""

    text: Annotated[str, msgspec.Meta(min_length=1, max_length=40)]


class WatcherNote(msgspec.Struct, tag_field="t", tag="note", frozen=True):
    """A note of the experimenter."""

    text: Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_NOTE)]


class Abort(msgspec.Struct, tag_field="t", tag="abort", frozen=True):
    """The request to end the running trial as interrupted."""


_decoder: Final = msgspec.json.Decoder(WatcherMark | WatcherNote | Abort)


class Watched(Protocol):
    """A session as the experimenter sees it. All methods are called in the thread of the server's loop."""

    def state(self) -> dict[str, Any]:
        """The present state: the content of the message `state` to the page."""

    def mark(self, text: str) -> None:
        """Write a mark into the journal."""

    def note(self, text: str) -> None:
        """Write a note into the journal."""

    def abort(self) -> None:
        """End the running trial as interrupted; nothing happens if none runs."""


class Watchers:
    """The open pages of the experimenter. `changed` sends the state at once, after a change in the session."""

    def __init__(self, session: Watched) -> None:
        self._session = session
        self._boxes: set[Outbox] = set()

    def routes(self) -> list[BaseRoute]:
        """The routes of the page; they must precede those of the participant's page."""

        async def page(_request: Request) -> Response:
            return FileResponse(FILES["watch.html"])

        return [Route(WATCH, page), WebSocketRoute("/watching", self._connect)]

    def changed(self) -> None:
        """Send the state to every page."""
        for box in self._boxes:
            box.put({"t": "state", **self._session.state()})

    async def _connect(self, socket: WebSocket) -> None:
        await socket.accept()
        box = Outbox(socket)
        self._boxes.add(box)
        tasks = [asyncio.create_task(one) for one in (box.send(), self._tell(box))]
        try:
            await self._listen(socket)
        finally:
            self._boxes.discard(box)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _tell(self, box: Outbox) -> None:
        while True:
            box.put({"t": "state", **self._session.state()})
            await asyncio.sleep(STATE_S)

    async def _listen(self, socket: WebSocket) -> None:
        """Receive messages until the page disconnects, sends an invalid message, or sends too many."""
        loop = asyncio.get_running_loop()
        allowance = Allowance(loop.time())
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            async for text in socket.iter_text():
                said = heard(text, _decoder)
                if said is None or not allowance.spend(loop.time()):
                    await socket.close(BAD if said is None else FLOOD)
                    return
                self._take(said)
                self.changed()

    def _take(self, said: WatcherMark | WatcherNote | Abort) -> None:
        if isinstance(said, WatcherMark):
            self._session.mark(said.text)
        elif isinstance(said, WatcherNote):
            self._session.note(said.text)
        else:
            self._session.abort()
