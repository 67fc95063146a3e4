"""The desk's server answers only a browser on this machine that has the token; all others get an empty answer 403.

The address that the user opens has the token once. The server turns it into a cookie, which scripts cannot read and
other sites cannot use. Browsers send a cookie to every port of a host, so the cookie's name has the port. The server
checks the name of the host, because a foreign page can let its own name lead to 127.0.0.1, and the origin, because a
foreign page may open sockets to 127.0.0.1.
"""

from __future__ import annotations

import secrets
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

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


class Doorkeeper:
    """Lets through only requests that name this host, come from its own page, and have the token.

    `?token=…` of an address that is typed or clicked sets the cookie and leads to the page. All answers have `HEADERS`.
    """

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self._app, self._host, self._token = app, f"127.0.0.1:{port}", token
        self._cookie = f"desk-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        await self._answering(scope)(scope, receive, send_guarded)

    def _answering(self, scope: Scope) -> ASGIApp:
        """What answers a request: the page's application, the way into the page, or a refusal."""
        if scope["type"] == "lifespan":
            return self._app
        request = HTTPConnection(scope)
        if self._comes_from_here(request):
            tokens = request.query_params.getlist("token")
            if scope["type"] == "http" and scope["path"] == "/" and len(tokens) == 1 and self._is_token(tokens[0]):
                return self._way_in()
            if self._is_token(request.cookies.get(self._cookie, "")):
                return self._app
        return WebSocketClose() if scope["type"] == "websocket" else Response(status_code=403)

    def _comes_from_here(self, request: HTTPConnection) -> bool:
        """Whether host, origin and method are those of our own page; a socket always has an origin."""
        origins, own = request.headers.getlist("origin"), [f"http://{self._host}"]
        if request.headers.getlist("host") != [self._host]:
            return False
        if request.scope["type"] == "websocket":
            return origins == own
        return origins in ([], own) and request.scope["method"] in ("GET", "HEAD")

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self._token.encode())

    def _way_in(self) -> Response:
        """Sets the cookie and leads to the page, so that the token leaves the address."""
        answer = RedirectResponse("/", status_code=303)
        answer.set_cookie(self._cookie, self._token, httponly=True, samesite="strict", path="/")
        return answer
