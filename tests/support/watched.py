"""A train on the bus, watched on the desk's page: the page's server in this process, and a stand-in for a simulator."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from das.bus.session import Bus
from das.domain.files.load import load_route, load_vehicle
from sim.desk.host import listening
from sim.desk.messages import PageSettings
from sim.desk.server import server_of
from sim.desk.watch import HEARD, WatchedTrain, WatchServer
from tests.support.desk_server import TOKEN, Visitor, serving

FRAMES_PER_S = 30


@contextmanager
def watched(train: str, connect: Sequence[str]) -> Iterator[Visitor]:
    """The page of a train on the flat line, from a real bus."""
    bus, door = Bus(train, connect=connect, hear=HEARD), listening(0)
    with bus, door:
        page = WatchServer(WatchedTrain(load_route("flat-6km"), load_vehicle("re460-ic")), bus, "en", PageSettings())
        server = server_of(page.routes(), door.getsockname()[1], TOKEN)
        with serving(server, lambda: asyncio.run(page.run(server, door))):
            yield Visitor(door.getsockname()[1])


class StandIn:
    """A stand-in for a driving simulator on the flat line, which sends 30 frames a second over UDP.

    `factor` is its time factor (0: paused); a test may also set `clock_s` and `s_m`. The train departs at 10:00:05 and
    holds 20 m/s. `front_m` answers where its front was at a time of its clock, as far as shown since the last jump.
    """

    def __init__(self, port: int) -> None:
        self.factor, self.clock_s, self.s_m, self.speed_mps = 1.0, 36_000.0, 0.0, 0.0
        self.shown: list[tuple[float, float]] = []
        self._port, self._over, self._lock = port, threading.Event(), threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> StandIn:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(5)

    def jump(self, *, by_m: float = 0.0, by_s: float = 0.0) -> None:
        """Move the train, or load another state."""
        with self._lock:
            self.s_m, self.clock_s, self.shown = self.s_m + by_m, self.clock_s + by_s, []

    def front_m(self, clock_s: float) -> float | None:
        """The position (m) of the front at a time of the clock; None if that was before the last jump."""
        shown = list(self.shown)
        near = min(shown, key=lambda one: abs(one[0] - clock_s), default=None)
        return near[1] if near is not None and abs(near[0] - clock_s) < 1.6 else None

    def _run(self) -> None:
        stations = [["A", 0.0, None, 36_005.0], ["B", 6_000.0, 36_305.0, None]]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            before_s = time.monotonic()
            while not self._over.wait(1 / FRAMES_PER_S):
                now_s = time.monotonic()
                with self._lock:
                    passed_s, before_s = (now_s - before_s) * self.factor, now_s
                    self.clock_s += passed_s
                    if self.clock_s > 36_005.0:
                        self.speed_mps = min(self.speed_mps + 0.5 * passed_s, 20.0)
                    self.s_m += self.speed_mps * passed_s
                    self.shown.append((self.clock_s, self.s_m))
                    frame = [self.clock_s, self.s_m, self.speed_mps, stations]
                out.sendto(json.dumps(frame).encode(), ("127.0.0.1", self._port))
