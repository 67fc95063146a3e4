"""The desk's session on the bus, in its own thread: it receives the cab, answers every look, and publishes actions. The
browser itself is not on the bus.

The desk answers a look with the setting of the controller as long as the page draws frames. A page that is closed,
suspended or covered draws none, and the run's dead-man brake then stops the train.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from das.bus import das_pb2
from das.bus.config import bus_options
from das.bus.session import Bus
from das.bus.topics import ACTION, CAB, CONTROL, CONTROLS, MARK
from das.domain.clocks import WALL, Clocks
from sim.desk.lsl import StreamedBus
from sim.desk.messages import DeskBus, Lever, Marked

CALLED_EVERY_S: Final = 0.1
"""Interval (s) of the desk's announcements before the run begins."""
UNSEEN_S: Final = 1.0
"""Time (s) without a frame after which a page counts as unwatched; the desk then stops answering looks."""
SETTLES_S: Final = 0.01
"""Time (s) within which a newer setting of the controller replaces one that has not been published yet."""
DEVICES: Final = {
    name.removeprefix("DEVICE_").lower().replace("_", "-"): number for name, number in das_pb2.Action.Device.items()
}
"""The devices by their names on the page."""
OPENED, GONE, AWAY = das_pb2.Mark.KIND_OPENED, das_pb2.Mark.KIND_GONE, das_pb2.Mark.KIND_AWAY
SILENCE: Final = das_pb2.Cab.INTERLOCK_SILENCE
BACK, SETTING, MARKED = das_pb2.Mark.KIND_BACK, das_pb2.Mark.KIND_SETTING, das_pb2.Mark.KIND_MARK
Told = Callable[[Any | None], None]
"""Callback in the bus's thread, with each message Cab and with None when the run is over."""


class Attention:
    """Whether the desk is visible to a person: its page has drawn a frame within the last second."""

    def __init__(self, clocks: Clocks) -> None:
        self._clocks = clocks
        self._drawn_s = -math.inf
        self._away = True

    @property
    def there(self) -> bool:
        """Whether the desk is visible now."""
        return self._clocks.seconds() - self._drawn_s < UNSEEN_S

    def drawn(self) -> bool:
        """Record a frame; returns whether the viewer is back."""
        back = self._away and math.isfinite(self._drawn_s)
        self._drawn_s, self._away = self._clocks.seconds(), False
        return back

    def left(self) -> bool:
        """Whether the viewer has gone; True once for each absence."""
        newly, self._away = not self.there and not self._away, not self.there
        return newly


class Peer:
    """The desk's session on the bus; `begin` opens it in a thread, `close` ends it. `tell` is called with each message.
    The run begins when it receives a driver's announcement, which `announce` permits. `clocks` are injected. Methods
    may be called from any thread.
    """

    def __init__(self, place: DeskBus, tell: Told, clocks: Clocks = WALL) -> None:
        self._place, self._tell, self._clocks = place, tell, clocks
        self._bus: Bus | None = None
        self._cab: Any | None = None
        self._lock = threading.Lock()
        self._waiting: Any | None = None
        self._free_s = 0.0
        self._attention = Attention(clocks)
        self._setting = 0.0, 0
        self._announced = self._paused = False
        self._over = threading.Event()

    @property
    def state(self) -> tuple[float, int]:
        """The setting of the controller (−1 … 1), and its sequence number."""
        return self._setting

    @property
    def joined(self) -> bool:
        """Whether the session on the bus is open."""
        return self._bus is not None

    def announce(self) -> None:
        """Announce the driver to the run, repeatedly until it begins."""
        self._announced = True

    def pause(self, paused: bool) -> None:
        """Stop the run's clock while the person is asked something, or let the run go on."""
        with self._lock:
            self._paused = paused
            if self._bus is not None and self._cab is not None:
                self._answer()

    def begin(self) -> None:
        """Join the bus."""
        threading.Thread(target=self._run, name="bus", daemon=True).start()

    def close(self) -> None:
        """Leave the bus."""
        self._over.set()

    def drawn(self) -> None:
        """Record that the page has drawn a frame."""
        if self._attention.drawn():
            self.mark(BACK)

    def settle(self) -> None:
        """Set the controller to 0 for a page that takes over after the desk was invisible for a second."""
        ratio, number = self._setting
        if ratio and not self._attention.there:
            self._put(number + 1, 0.0, das_pb2.Action.DEVICE_DESK)

    def lever(self, said: Lever) -> bool:
        """Set the controller as the page requests; False for a sequence number that is not newer than the last one."""
        if said.k <= self._setting[1]:
            return False
        self._put(said.k, said.ratio, DEVICES.get(said.by, 0), round(said.at * 1e6), said.look)
        return True

    def mark(self, kind: Any, said: Marked | None = None) -> None:
        """Publish an action at the desk."""
        now_ns = self._clocks.now_ns()
        with self._lock:
            if self._bus is None:
                return
            mark = das_pb2.Mark(time_ns=self._time_ns(), kind=kind, server_ns=now_ns, bus_ns=now_ns)
            if said is not None:
                mark.text, mark.look, mark.browser_ns = said.text, said.look, round(said.at * 1e6)
            self._bus.publish(MARK, mark)

    def _put(self, number: int, ratio: float, device: int, browser_ns: int = 0, look: int = 0) -> None:
        """Set the controller. The setting is published immediately, or when the previous one has settled."""
        with self._lock:
            self._setting = ratio, number
            self._waiting = das_pb2.Action(
                number=number, device=das_pb2.Action.Device.ValueType(device), lever_ratio=ratio, look=look,
                browser_ns=browser_ns, server_ns=self._clocks.now_ns(),
            )  # fmt: skip
        self.flush()

    def flush(self) -> bool:
        """Publish the newest setting if it is due; False if it must wait, and this method must be called again."""
        with self._lock:
            action, now_s = self._waiting, self._clocks.seconds()
            if action is None:
                return True
            if now_s < self._free_s:
                return False
            self._waiting, self._free_s = None, now_s + SETTLES_S
            if self._bus is not None and self._cab is not None:
                self._answer()
                action.time_ns, action.bus_ns = self._time_ns(), self._clocks.now_ns()
                self._bus.publish(ACTION, action)
            return True

    def _time_ns(self) -> int:
        """The run's time (ns since 1970) of the last cab; 1 before the first, because 0 is not recorded."""
        return 1 if self._cab is None else int(self._cab.time_ns)

    def _answer(self) -> None:
        assert self._bus is not None
        assert self._cab is not None
        controls = das_pb2.Controls(look=self._cab.look, lever_ratio=self._setting[0], paused=self._paused)
        self._bus.publish(CONTROLS, controls)

    def _run(self) -> None:
        """Receive from the bus until the run is over, or until this session is closed."""
        place = self._place
        file = None if place.file is None else bus_options(Path(place.file), place.insecure, None, None)
        joins = partial(StreamedBus, place.lsl) if place.lsl else Bus
        with joins(place.train, connect=place.connect, hear=(CAB, CONTROL), file=file) as bus:
            with self._lock:
                self._bus = bus
            while not self._over.is_set():
                received = bus.receive(CALLED_EVERY_S)
                message = None if received is None else received.message
                if received is None and self._cab is None and self._announced:
                    bus.publish(CONTROLS, das_pb2.Controls())
                if received is None or message is None:
                    continue
                if received.topic is CONTROL and message.command == das_pb2.Control.COMMAND_FINISH:
                    self._tell(None)
                    break
                if received.topic is CAB and message.look:
                    self._look(message)
            with self._lock:
                self._bus = None

    def _look(self, cab: Any) -> None:
        with self._lock:
            self._cab = cab
            if self._attention.there or self._paused:
                self._answer()
        if self._attention.left():
            self.mark(AWAY)
        self._tell(cab)
