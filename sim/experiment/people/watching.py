"""The experimenter's page: its socket, and what it may ask of a session. It shows everything and drives nothing.

The page has its own address and token (`sim.desk.server.Doorkeeper`), because it names the condition.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket

from sim.desk.messages import heard
from sim.desk.server import FILES, WATCH, OpenPages

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


WatcherSaid = WatcherMark | WatcherNote | Abort
_decoded: Final = partial(heard, decoder=msgspec.json.Decoder(WatcherSaid))


class Watchers:
    """The pages of the experimenter; `changed` sends the state at once, after a change in the session.

    `state` returns the content of the message `state`, and `take` is called with what a page says, both in the thread
    of the server's loop.
    """

    def __init__(self, state: Callable[[], dict[str, Any]], take: Callable[[WatcherSaid], None]) -> None:
        self._state, self._take = state, take
        self._pages = OpenPages()

    def routes(self) -> list[BaseRoute]:
        """The routes of the page; they must precede those of the participant's page."""

        async def page(_request: Request) -> Response:
            return FileResponse(FILES["watch.html"])

        return [Route(WATCH, page), WebSocketRoute("/watching", self._connect)]

    def changed(self) -> None:
        """Send the state to every page."""
        if self._pages:
            self._pages.put(self._message())

    async def _connect(self, socket: WebSocket) -> None:
        telling = asyncio.create_task(self._tell())
        try:
            await self._pages.serve(socket, self._message(), self._take, _decoded)
        finally:
            telling.cancel()

    def _message(self) -> dict[str, Any]:
        return {"t": "state", **self._state()}

    async def _tell(self) -> None:
        while True:
            await asyncio.sleep(STATE_S)
            self.changed()
