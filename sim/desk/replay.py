"""Replay of a recorded drive on the desk's page, as the driver saw it, at any speed and with the review's bookmarks."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket

from das.bus import topics
from das.domain.errors import DasError
from das.domain.units import NS
from sim.desk.line import hello_of
from sim.desk.messages import encoded, recorded_settings
from sim.desk.server import Outbox, cab_of, page_routes, server_of
from sim.drive.drive import Drive
from sim.drive.events import bookmarks


class Replay:
    """The page's view of a recorded drive, from the time `at` of its clock on (default: from its beginning).

    Raises DasError for a recording without a cab, or with an unknown line, train or display settings.
    """

    def __init__(self, drive: Drive, language: str, *, at: str | None = None) -> None:
        path = drive.recording.path
        self.cabs = [entry.message for entry in drive.recording.of(topics.CAB)]
        """The messages Cab, in order."""
        if not self.cabs:
            raise DasError(f"{path}: contains no cab: expected a recording of das-sim run, desk or what-if")
        inputs = drive.table.inputs
        self._route, first_ns = inputs.route, int(self.cabs[0].time_ns)
        self._start_s = 0.0 if at is None else (drive.table.clock.moment_ns(at) - first_ns) * NS
        served = {call.name for call in drive.calls}
        stops = [stop for stop in inputs.route.stops if not served or stop.name in served]
        page = recorded_settings(drive.recording)
        line = (inputs.route, inputs.vehicle, stops)
        self.hello = hello_of(line, first_ns, language, page) | {"phase": "replay", "lever": 0.0, "seq": 0}
        self.bookmarks = _bookmarks(drive, first_ns)
        """The bookmarks: seconds from the first cab message, and texts."""

    def routes(self) -> list[BaseRoute]:
        """The routes that the server answers."""
        shown = [cab_of(cab, self._route) for cab in self.cabs]
        text = encoded({"cabs": shown, "bookmarks": self.bookmarks, "start_s": self._start_s})

        async def drive(_request: Request) -> Response:
            return Response(text, media_type="application/json")

        return [WebSocketRoute("/desk", self._connect), Route("/drive.json", drive), *page_routes()]

    async def _connect(self, socket: WebSocket) -> None:
        box = Outbox(socket)
        box.put(self.hello)
        await box.serve()


def _bookmarks(drive: Drive, first_ns: int) -> list[dict[str, Any]]:
    """The bookmarks of the review; empty for a recording too short or too damaged for events."""
    try:
        events = bookmarks(drive.events)
    except DasError:
        return []
    return [{"at_s": (one.time_ns - first_ns) * NS, "text": one.text, "mark": one.mark or "note"} for one in events]


def play(replay: Replay, door: Any, token: str) -> None:
    """Serve the page until Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(server_of(replay.routes(), door.getsockname()[1], token).serve(sockets=[door]))
