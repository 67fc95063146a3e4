"""The two doors of a session: the participant's token opens nothing of the experimenter's page, nor the reverse."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the extra desk is not installed")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from sim.desk.server import BAD, OF_WATCH, SHARED
from sim.experiment.people.watching import LONGEST_NOTE, Abort, WatcherMark, WatcherNote
from tests.support.desk_server import TOKEN, Visitor, next_of, say, until
from tests.support.scripted_session import WATCH_TOKEN, ScriptedSession, scripted_session

Served = tuple[Visitor, ScriptedSession]
TOKENS = {"/": TOKEN, "/watch": WATCH_TOKEN}
SOCKETS = {"/": "/desk", "/watch": "/watching"}


@pytest.fixture
def served() -> Iterator[Served]:
    with scripted_session() as found:
        yield found


def cookie(visitor: Visitor, page: str) -> str:
    answer = visitor.ask(f"{page}?token={TOKENS[page]}")
    assert (answer.status, answer.headers["Location"]) == (303, page)
    return str(answer.headers["Set-Cookie"]).partition(";")[0]


def socket_of(visitor: Visitor, path: str, cookie: str) -> Any:
    own: Any = f"http://{visitor.host}"
    address = f"ws://{visitor.host}{path}"
    return connect(address, origin=own, additional_headers={"Cookie": cookie}, compression=None)


def status(visitor: Visitor, path: str, cookie: str) -> int:
    return visitor.ask(path, Cookie=cookie).status


def test_each_token_opens_its_own_page_and_the_shared_files_only(served: Served) -> None:
    visitor, _ = served
    person, watcher = cookie(visitor, "/"), cookie(visitor, "/watch")
    pages = OF_WATCH - {"/watching"}
    desk = {"/", "/desk.html", "/desk.js", "/session.js", "/lever.js"}
    for path in SHARED:
        assert (status(visitor, path, person), status(visitor, path, watcher)) == (200, 200)
    for path in pages:
        assert (status(visitor, path, person), status(visitor, path, watcher)) == (403, 200), path
    for path in desk:
        assert (status(visitor, path, person), status(visitor, path, watcher)) == (200, 403), path
    for path in ("/Watch", "/watch/", "//watch", "/watch%2ejs/", "/x/../watch", "/%77atch.html/"):
        assert status(visitor, path, person) in (307, 403, 404), path  # 307: to the path without its last stroke
    assert status(visitor, "/%77atch", person) == 403


@pytest.mark.parametrize(("page", "other"), [("/", "/watch"), ("/watch", "/")])
def test_the_token_of_one_page_does_not_open_the_other_nor_its_socket(served: Served, page: str, other: str) -> None:
    visitor, _ = served
    assert visitor.ask(f"{other}?token={TOKENS[page]}").status == 403
    name = cookie(visitor, other).partition("=")[0]
    for forged in (cookie(visitor, page), f"{name}={TOKENS[page]}"):
        with pytest.raises(InvalidStatus) as raised, socket_of(visitor, SOCKETS[other], forged):
            pass
        assert raised.value.response.status_code == 403
        assert visitor.ask(other, Cookie=forged).status == 403
    with socket_of(visitor, SOCKETS[page], cookie(visitor, page)):
        pass


def watching(visitor: Visitor) -> Any:
    return socket_of(visitor, "/watching", cookie(visitor, "/watch"))


def test_the_experimenter_sees_the_state_at_changes_and_may_mark_note_and_abort(served: Served) -> None:
    visitor, session = served
    with watching(visitor) as socket, watching(visitor) as second:
        session.shown["step"] = "consent"
        assert next_of(socket, "state")["participant"] == "P07"
        session.shown["step"] = "tlx-1"
        session.loop.call_soon_threadsafe(session.watchers.changed)
        for one in (socket, second):
            while next_of(one, "state").get("step") != "tlx-1":
                pass
        for kind, text in (("mark", "3"), ("note", 'asked {twice} "why"')):
            say(socket, kind, text=text)
        say(socket, "abort")
        until(lambda: len(session.asked) == 3, "the requests")
    assert session.asked == [WatcherMark("3"), WatcherNote('asked {twice} "why"'), Abort()]


@pytest.mark.parametrize(
    "text",
    ['{"t":"lever","k":1,"ratio":1,"at":1,"by":"key"}', '{"t":"note","text":""}', '{"t":"mark"}', "[" * 3000, "{",
     json.dumps({"t": "note", "text": "x" * (LONGEST_NOTE + 1)})],
)  # fmt: skip
def test_the_experimenter_cannot_drive_and_what_is_no_message_closes_the_socket(served: Served, text: str) -> None:
    visitor, session = served
    with watching(visitor) as socket:
        socket.send(text)
        with suppress(ConnectionClosed):
            for _ in socket:
                pass
        assert socket.close_code == BAD
    assert session.asked == []
