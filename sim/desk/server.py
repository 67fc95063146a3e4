"""The desk's server: one page at a time drives and receives the messages of the bus.

Only a browser on this machine with the token gets answers; all others get an empty answer 403. The address that the
user opens contains the token once. The server converts it into a cookie, which scripts cannot read and other sites
cannot use. Browsers send a cookie to every port of a host, so the cookie's name contains the port. The server checks
the host name, because a foreign page can make its own name resolve to 127.0.0.1, and the origin, because a foreign page
may open sockets to 127.0.0.1.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
import socket
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Protocol

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketClose, WebSocketDisconnect

from das.domain.errors import DasError
from das.domain.route import Route as Line
from sim.desk import peer as on_bus
from sim.desk.line import cab_fields, hello_of, reasons
from sim.desk.messages import (
    GIVEN,
    LARGEST_BYTES,
    DeskBus,
    DeskGiven,
    FrameDrawn,
    Lever,
    Marked,
    Ready,
    Said,
    encoded,
    given_to,
    heard,
)
from sim.desk.peer import Peer
from sim.drivers.messages import recorded_view
from sim.world.lockstep import run_child
from sim.world.scenario import load_scenario
from sim.world.service import lay_out

PAGE: Final = Path(__file__).parent / "page"
FILES: Final = {path.name: path for path in sorted(PAGE.iterdir()) if path.is_file()}
"""The files of the pages by name; the server delivers no others."""
WATCH: Final = "/watch"
"""The address of the experimenter's page."""
OF_WATCH: Final = frozenset({WATCH, "/watching", "/watch.html", "/watch.js"})
"""The paths that only the experimenter's page opens."""
SHARED: Final = frozenset({"/desk.css", "/icon.svg", "/draw.js", "/show.js", "/words.js"}) | {
    f"/{name}" for name in FILES if name.endswith(".woff2")
}
"""The files that both pages open."""
BEAT_S: Final = 0.5
"""Longest time (s) between two messages to the page."""
MOST_PER_S, MOST_AT_ONCE = 200.0, 400.0
"""Largest number of messages from a page, per second and in one burst; the desk's own page sends up to 60 a second."""
BAD, TAKEN, FLOOD = 4400, 4409, 4429
"""Close codes of a socket: invalid message, a newer page drives, too many messages."""
HEADERS: Final = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "font-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Cache-Control": "no-store",
}


NEWEST: Final = frozenset({"cab", "hello", "phase", "state"})
"""The kinds of messages of which only the newest waits: a page that reads nothing does not fill the memory."""


class Outbox:
    """The queue of messages to a page, in order; a newer one of the kinds `NEWEST` replaces a waiting one."""

    def __init__(self, socket: WebSocket) -> None:
        self._socket, self._waiting = socket, list[dict[str, Any]]()
        self._news, self._last = asyncio.Event(), 0

    def put(self, message: dict[str, Any], *, last: int = 0) -> None:
        """Add a message; `last` is the close code after it (0: the socket stays open)."""
        if message["t"] in NEWEST:
            self._waiting = [one for one in self._waiting if one["t"] != message["t"]]
        self._waiting.append(message)
        self._last = self._last or last
        self._news.set()

    async def send(self) -> None:
        """Send messages until the socket closes."""
        while self._waiting or not self._last:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), BEAT_S)
            self._news.clear()
            batch, self._waiting = self._waiting, []
            for message in batch or [{"t": "beat"}]:
                await self._socket.send_text(encoded(message))
        await self._socket.close(self._last)

    async def serve(
        self, take: Callable[[Any], object] = lambda _said: None, decoded: Callable[[str], Any | None] = heard
    ) -> None:
        """Accept the socket, send messages, and pass those of the page to `take` as `listen` does, until it closes."""
        await self._socket.accept()
        sending = asyncio.create_task(self.send())
        try:
            await listen(self._socket, take, decoded)
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)


class OpenPages:
    """The open pages of one kind, which all receive the same messages; false if none is open."""

    def __init__(self) -> None:
        self._boxes: set[Outbox] = set()

    def __bool__(self) -> bool:
        return bool(self._boxes)

    def put(self, message: dict[str, Any]) -> None:
        """Send a message to every page."""
        for box in self._boxes:
            box.put(message)

    async def serve(self, socket: WebSocket, first: dict[str, Any], *heard_by: Any) -> None:
        """Serve a page from its first message on; `heard_by` are the arguments of `Outbox.serve`."""
        box = Outbox(socket)
        box.put(first)
        self._boxes.add(box)
        try:
            await box.serve(*heard_by)
        finally:
            self._boxes.discard(box)


class Allowance:
    """The number of messages that a page may still send; it increases with time (s)."""

    def __init__(self, now_s: float) -> None:
        self._left, self._at_s = MOST_AT_ONCE, now_s

    def spend(self, now_s: float) -> bool:
        """Count one message; False if the allowance is exceeded."""
        self._left = min(self._left + (now_s - self._at_s) * MOST_PER_S, MOST_AT_ONCE) - 1
        self._at_s = now_s
        return self._left >= 0


async def listen(socket: WebSocket, take: Callable[[Any], object], decoded: Callable[[str], Any | None]) -> None:
    """Pass the messages of a page to `take` until it disconnects, sends an invalid message, or sends too many.

    `decoded` returns the message that a text is, None for an invalid one. A DasError of `take` ends the socket as well;
    who raises it reports it.
    """
    loop = asyncio.get_running_loop()
    allowance = Allowance(loop.time())
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, DasError):
        async for text in socket.iter_text():
            said = decoded(text)
            if said is None or not allowance.spend(loop.time()):
                await socket.close(BAD if said is None else FLOOD)
                return
            take(said)


class PageUser(Protocol):
    """What a page shows and does, as the page's link to the server uses it."""

    def opened(self) -> Sequence[dict[str, Any]]:
        """The messages to a page that has just been opened."""

    def closed(self) -> None:
        """The page is closed."""

    def on_page(self, said: Said) -> None:
        """The page has sent a message."""


class PageLink:
    """The link to the newest page; an older page is told that another one has taken over."""

    def __init__(self, user: PageUser) -> None:
        self._user = user
        self._box: Outbox | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def is_open(self) -> bool:
        """Whether a page is connected."""
        return self._box is not None

    def routes(self) -> list[BaseRoute]:
        """The routes of the server."""
        return [WebSocketRoute("/desk", self._connect), *page_routes()]

    def put(self, message: dict[str, Any]) -> None:
        """Send a message to the page, if there is one."""
        if self._box is not None:
            self._box.put(message)

    def soon(self, do: Callable[..., object], *given: Any) -> None:
        """Call a function in the server's thread, from any other thread."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(do, *given)

    async def _connect(self, socket: WebSocket) -> None:
        self._loop = asyncio.get_running_loop()
        box, before = Outbox(socket), self._box
        if before is not None:  # the newer page drives: after a reload, the old page may still seem to be connected
            before.put({"t": "phase", "phase": "taken"}, last=TAKEN)
        self._box = box
        for message in self._user.opened():
            box.put(message)
        try:
            await box.serve(lambda said: self._user.on_page(said) if box is self._box else None)
        finally:
            if self._box is box:
                self._box = None
                self._user.closed()


class Desk:
    """A person's desk in a run: messages to the page and actions from it. `hello` is the constant data of the page.

    The phases are welcome, preparing (the person is ready, the run has not begun), driving and over. A server that
    replaces a killed one during a run starts in the phase driving. `link` is the link to the page (None: its own).
    """

    def __init__(self, place: DeskBus, hello: dict[str, Any], route: Line, link: PageLink | None = None) -> None:
        self._hello, self._route = hello, route
        self.phase = "welcome"
        """The present phase."""
        self.cab: dict[str, Any] | None = None
        """The fields of the last cab."""
        self.looks: Callable[[dict[str, Any]], None] = lambda _cab: None
        """The function that is called with the fields of each cab."""
        self._link = link or PageLink(self)
        self.peer = Peer(place, lambda cab: self._link.soon(self._take, cab))
        self.peer.begin()

    def routes(self) -> list[BaseRoute]:
        """The routes of the server."""
        return self._link.routes()

    def opened(self) -> list[dict[str, Any]]:
        """The line, the phase and the lever, for a new page."""
        self.peer.settle()
        self.peer.mark(on_bus.OPENED)
        ratio, number = self.peer.state
        return [self._hello | {"phase": self.phase, "lever": ratio, "seq": number}]

    def closed(self) -> None:
        """Record that the page is closed."""
        self.peer.mark(on_bus.GONE)

    def on_page(self, said: Said) -> None:
        """Do what the page says; messages of a session are ignored."""
        if isinstance(said, Lever):
            if self.phase == "driving" and self.peer.lever(said):
                self._flush()
        elif isinstance(said, FrameDrawn):
            self.peer.drawn()
        elif isinstance(said, Ready):
            if self.phase == "welcome":
                self._enter("preparing")
                self.peer.announce()
        elif isinstance(said, Marked):
            self.peer.mark(on_bus.SETTING if said.text else on_bus.MARKED, said)

    def _enter(self, phase: str) -> None:
        self.phase = phase
        self._link.put({"t": "phase", "phase": phase})

    def _take(self, cab: Any | None) -> None:
        if cab is None:
            self._enter("over")
            return
        if self.phase != "driving":
            self._enter("driving")
        said = cab_of(cab, self._route)
        self.cab = said["cab"]
        self._link.put(said | {"seq": self.peer.state[1]})
        self.looks(said["cab"])

    def _flush(self) -> None:
        if not self.peer.flush():
            asyncio.get_running_loop().call_later(on_bus.SETTLES_S, self._flush)


def cab_of(message: Any, route: Line) -> dict[str, Any]:
    """The message to the page for a Cab: every field as recorded, and the reason as text."""
    return {"t": "cab", "cab": cab_fields(message), "why": reasons(recorded_view(message), route)}


def page_routes() -> list[BaseRoute]:
    """The files of the page."""

    async def page(request: Request) -> Response:
        path = FILES.get(request.path_params.get("name", "desk.html"))
        return Response(status_code=404) if path is None else FileResponse(path)

    return [Route("/", page), Route("/{name}", page)]


class Doorkeeper:
    """The access check: accepts only requests with this host's name, from the server's own page, and with its token.

    `tokens` are those of the participant's page ("/") and of the experimenter's (`WATCH`), by path. Neither token opens
    what belongs to the other page. `?token=…` in a typed or clicked address sets the cookie and redirects to the page.
    All answers have `HEADERS`.
    """

    def __init__(self, app: ASGIApp, port: int, tokens: Mapping[str, str]) -> None:
        self._app, self._host, self._tokens = app, f"127.0.0.1:{port}", tokens
        self._cookies = {path: f"{path[1:] or 'desk'}-{port}" for path in tokens}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer or reject a request."""

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        await self._answering(scope)(scope, receive, send_guarded)

    def _answering(self, scope: Scope) -> ASGIApp:
        """The application that answers a request: the page, the redirect to the page, or the rejection."""
        if scope["type"] == "lifespan":
            return self._app
        request = HTTPConnection(scope)
        if self._comes_from_here(request):
            tokens, path = request.query_params.getlist("token"), scope["path"]
            if scope["type"] == "http" and path in self._tokens and len(tokens) == 1 and self._fits(path, tokens[0]):
                return self._way_in(path)
            pages = (WATCH,) if path in OF_WATCH else ("/", WATCH) if path in SHARED else ("/",)
            if any(self._fits(page, request.cookies.get(self._cookies.get(page, ""), "")) for page in pages):
                return self._app
        return WebSocketClose() if scope["type"] == "websocket" else Response(status_code=403)

    def _comes_from_here(self, request: HTTPConnection) -> bool:
        """Whether host, origin and method are those of the desk's own page; a socket always has an origin."""
        origins, own = request.headers.getlist("origin"), [f"http://{self._host}"]
        if request.headers.getlist("host") != [self._host]:
            return False
        if request.scope["type"] == "websocket":
            return origins == own
        return origins in ([], own) and request.scope["method"] in ("GET", "HEAD")

    def _fits(self, page: str, text: str) -> bool:
        """Whether a text is the token of a page."""
        return page in self._tokens and secrets.compare_digest(text.encode(), self._tokens[page].encode())

    def _way_in(self, page: str) -> Response:
        answer = RedirectResponse(page, status_code=303)
        answer.set_cookie(self._cookies[page], self._tokens[page], httponly=True, samesite="strict", path="/")
        return answer


def server_of(routes: Sequence[BaseRoute], port: int, token: str, watch_token: str | None = None) -> uvicorn.Server:
    """The server of some routes; its `serve(sockets=[…])` answers until the process is asked to stop.

    `token` opens the participant's page, `watch_token` the experimenter's (None: there is none).
    """
    tokens = {"/": token} | ({} if watch_token is None else {WATCH: watch_token})
    config = uvicorn.Config(
        Doorkeeper(Starlette(routes=routes), port, tokens),
        log_level="warning", access_log=False, server_header=False, lifespan="off", timeout_graceful_shutdown=1,
        ws="websockets-sansio", ws_max_size=LARGEST_BYTES, ws_ping_interval=5, ws_ping_timeout=10,
        ws_per_message_deflate=False,
    )  # fmt: skip
    return uvicorn.Server(config)


def main() -> None:
    """Serve the desk."""
    threading.excepthook = _end_with_thread
    run_child(lambda: asyncio.run(_serve(given_to(GIVEN, DeskGiven, "das-sim desk"))))


def _end_with_thread(failed: threading.ExceptHookArgs) -> None:
    """End this process when a thread fails; without its session on the bus, a run would wait forever for the desk."""
    print(f"error: {failed.exc_value}", file=sys.stderr, flush=True)
    os._exit(2)


async def _serve(given: DeskGiven) -> None:
    scenario = load_scenario(given.scenario, given.journey)
    line = lay_out(scenario)
    desk = Desk(given.bus, hello_of(line, scenario.departure_ns, given.language, given.page), line[0])
    try:
        door = socket.socket(fileno=given.door)
        await server_of(desk.routes(), door.getsockname()[1], given.token).serve(sockets=[door])
    finally:
        desk.peer.close()
