"""Who may see the desk: a browser on this machine, at this address, with the token. Everybody else gets an empty 403.

The token is once in the address; it becomes a cookie that scripts cannot read and other sites cannot use. Cookies do
not know ports, which is why the cookie's name has the port. The name of the host is checked because a foreign page can
let its own name lead to 127.0.0.1, and the origin because a foreign page may open sockets to 127.0.0.1.
"""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from typing import Any, Final
from urllib.parse import parse_qs

from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

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
REFUSED: Final = 4403
"""Code with which a socket is closed that may not be opened."""


class Doorkeeper:
    """Lets through only requests that name this host, come from its own page, and have the token.

    `?token=…` of an address that is typed or clicked sets the cookie and leads to the page.
    """

    def __init__(self, app: ASGIApp, port: int, token: str) -> None:
        self._app, self._host, self._token = app, f"127.0.0.1:{port}", token
        self._cookie = f"desk-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        kind = scope["type"]
        if kind == "lifespan":
            await self._app(scope, receive, send)
            return
        heads = _heads(scope)
        if self._comes_from_here(kind, scope.get("method", "GET"), heads):
            if kind == "http" and self._brings_token(scope):
                await self._entered(scope, receive, send)
                return
            if self._is_known(heads):
                await self._app(scope, receive, send)
                return
        if kind == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": REFUSED})
            return
        await Response(status_code=403, headers=HEADERS)(scope, receive, send)

    def _comes_from_here(self, kind: str, method: str, heads: dict[str, list[str]]) -> bool:
        """Whether host, origin and method are those of our own page; a socket always has an origin."""
        origins, own = heads.get("origin", []), [f"http://{self._host}"]
        if heads.get("host") != [self._host]:
            return False
        return origins == own if kind == "websocket" else origins in ([], own) and method in ("GET", "HEAD")

    def _brings_token(self, scope: Scope) -> bool:
        tokens = parse_qs(scope["query_string"].decode("latin1")).get("token", [])
        return scope["path"] == "/" and len(tokens) == 1 and self._is_token(tokens[0])

    def _is_known(self, heads: dict[str, list[str]]) -> bool:
        cookies = [one.strip().partition("=") for text in heads.get("cookie", []) for one in text.split(";")]
        return any(name == self._cookie and self._is_token(value) for name, _, value in cookies)

    def _is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self._token.encode())

    async def _entered(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Set the cookie and lead to the page, so that the token leaves the address."""
        answer = RedirectResponse("/", status_code=303, headers=HEADERS)
        answer.set_cookie(self._cookie, self._token, httponly=True, samesite="strict", path="/")
        await answer(scope, receive, send)


def _heads(scope: Scope) -> dict[str, list[str]]:
    """The headers of a request by their names in small letters."""
    pairs: Sequence[tuple[bytes, bytes]] = scope["headers"]
    found: dict[str, list[str]] = {}
    for name, value in pairs:
        found.setdefault(name.decode("latin1").lower(), []).append(value.decode("latin1"))
    return found


def app_of(routes: Sequence[Any], port: int, token: str) -> ASGIApp:
    """The guarded application with these routes."""
    from starlette.applications import Starlette

    return Doorkeeper(Starlette(routes=routes), port, token)
