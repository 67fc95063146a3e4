"""Supervision of the desk's server by the run: start, restart if it is killed, stop.

The run owns the listening socket, which the server inherits. The address is therefore valid before the server answers,
and remains valid when a killed server is replaced.
"""

from __future__ import annotations

import os
import secrets
import socket
import threading
import time
from types import TracebackType
from typing import Final

import msgspec

from das.command_line.printing import warn
from das.domain.errors import DasError
from sim.desk.messages import GIVEN, DeskGiven, encoded
from sim.world.lockstep import Process

LOOK_S: Final = 0.5
"""Interval (s) at which the run checks whether the server is still running."""
STARTS_S: Final = 10.0
"""Time (s) after its start within which a server that ends is considered faulty, not killed."""
MOST_FAILURES: Final = 3


def listening(port: int) -> socket.socket:
    """A socket that listens on 127.0.0.1 at a port (0: any free one); DasError if the port is taken."""
    door = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # on Windows, the option would let two programs listen at one port
        door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        door.bind(("127.0.0.1", port))
        door.listen()
    except OSError as error:
        door.close()
        raise DasError(f"--port {port}: cannot listen at 127.0.0.1 ({error.strerror})") from error
    return door


def new_token() -> str:
    """An unguessable token."""
    return secrets.token_urlsafe(24)


def address_of(door: socket.socket, token: str) -> str:
    """The address of the page."""
    return f"http://127.0.0.1:{door.getsockname()[1]}/?token={token}"


class DeskHost:
    """Supervisor of a desk's server, used in a `with` statement. `address` is the address of the page."""

    def __init__(self, given: DeskGiven, door: socket.socket) -> None:
        self._given, self._door = given, door
        self.address = address_of(door, given.token)
        self._over, self._failures = threading.Event(), 0

    def __enter__(self) -> DeskHost:
        self._start()
        self._watch = threading.Thread(target=self._keep, name="desk", daemon=True)
        self._watch.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._over.set()
        self._watch.join()
        self._child.__exit__()
        self._door.close()

    def _start(self) -> None:
        told = {GIVEN: encoded(msgspec.structs.replace(self._given, door=self._door.fileno()))}
        self._child = Process("desk", "sim.desk", (), given=told, door=self._door.fileno())
        self._started_s = time.monotonic()

    def _keep(self) -> None:
        while not self._over.wait(LOOK_S):
            try:
                self._child.check()
            except DasError as error:
                self._failures = self._failures + 1 if time.monotonic() - self._started_s < STARTS_S else 1
                if self._failures > MOST_FAILURES:
                    warn(f"{error}; the desk does not start: end the run with Ctrl-C")
                    return
                warn(f"{error}; it is restarted")
                self._child.__exit__()
                self._start()
