"""The desk's page for any train on the bus, whoever drives it: a display without a lever, which publishes nothing.

The cab on the page is built from what the node and the train's publishers send (advice, position, journey,
restrictions, delay), by the code that builds the cab of a simulated run.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import threading
from typing import Any, Final

from google.protobuf.message import Message
from starlette.routing import BaseRoute, WebSocketRoute
from starlette.websockets import WebSocket

from das.advice.advice import Cause
from das.advice.display import VALID_FOR_S
from das.advice.regimes import Regime
from das.bus.session import Bus
from das.bus.topics import ADVICE, CONTROL, DELAY, JOURNEY, POSITION, RESTRICTION, Received, valid_restrictions
from das.cab.legs import leg_of
from das.command_line.printing import say
from das.domain.clocks import WALL, Clocks
from das.domain.restriction import LATEST_NS
from das.domain.route import Route, Stop
from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate.estimate import STALE_AFTER_S, Quality
from das.estimate.plausibility import STANDSTILL_MPS
from sim.desk.line import hello_of
from sim.desk.messages import PageSettings
from sim.desk.server import OpenPages, cab_of, page_routes, server_of
from sim.drivers.cab import CabView
from sim.drivers.kinds import Presentation
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.messages import CabLook, cab_message
from sim.drivers.presentations.presenter import present
from sim.plant.plant import COAST

HEARD: Final = (ADVICE, POSITION, JOURNEY, RESTRICTION, DELAY, CONTROL)
"""The topics from which the page is made."""
SILENT_S: Final = 10.0
"""Time (s) without any message after which the page says so."""
PICTURE_S: Final = 0.2
"""Interval (s) between two cabs on the page; new advice is shown at once."""
LEAST_S: Final = 0.02
"""Shortest interval (s) between two cabs."""
AWAY_M, AWAY_SDS = 50.0, 3.0
"""Distance (m, plus standard deviations of both positions) from the train up to which advice is for its place."""
CLOCK_RUNS_ON_S: Final = 1.5
"""Time (s) for which a simulation's clock is assumed to run on after its last message; it may be paused."""
DELAY_COUNTS_S: Final = 60.0
"""Time (s) for which a reported delay is shown."""


class WatchedTrain:
    """A train as the bus describes it: `hear` takes a message, `cab` is the cab at this moment.

    Advice is shown until it is withdrawn or no longer valid, has not been renewed for `VALID_FOR_S`, or was made for
    another place than that of the train. `clocks` are injected.
    """

    def __init__(
        self, route: Route, vehicle: Vehicle, presentation: Presentation = Presentation.GUIDE, clocks: Clocks = WALL
    ) -> None:
        self._route, self._vehicle, self._presentation, self._clocks = route, vehicle, presentation, clocks
        self._newest: dict[str, Any] = {}
        self._heard_s = {"": clocks.seconds()}
        self._leg: int | None = None
        self._advices = 0
        self.line, self.stops = LineKnowledge(route=route, vehicle=vehicle), route.stops
        """Line and train in the direction of the journey, and the stops of the journey."""

    def hear(self, received: Received) -> None:
        """Take a message; an unreadable one and an unusable position are ignored."""
        topic, message = received.topic, received.message
        if message is None:
            return
        if topic is POSITION and (message.quality == Quality.INVALID or not math.isfinite(message.s_m)):
            return
        self._newest[topic.name] = message
        self._heard_s[topic.name] = self._heard_s[""] = self._clocks.seconds()
        self._advices += topic is ADVICE
        if topic is JOURNEY and self._fits(message):
            self._leg, route = None, self._route.reversed() if message.reversed else self._route
            self.line = LineKnowledge(route=route, vehicle=self._vehicle)
            self.stops = tuple(Stop(name=one.name, position_m=one.s_m) for one in message.stops)

    @property
    def now_ns(self) -> int:
        """The train's time (ns since 1970): the time of day, or in a simulation that of its last message."""
        if CONTROL.name not in self._newest:
            return self._clocks.now_ns()
        name = min((CONTROL.name, POSITION.name), key=self._age_s)
        return min(int(self._newest[name].time_ns) + round(min(self._age_s(name), CLOCK_RUNS_ON_S) / NS), LATEST_NS)

    def cab(self) -> Message | str:
        """The message `Cab` of this moment, or what is missing for it: "silent", "journey", "line" or "position".

        Its look is the number of the advice. "line" means that the journey is not for this line and this train.
        """
        journey, now_ns = self._newest.get(JOURNEY.name), self.now_ns
        if self._age_s("") > SILENT_S:
            return "silent"
        if journey is None or not self._fits(journey):
            return "journey" if journey is None else "line"
        place = self._place(now_ns)
        if place is None:
            return "position"
        # By the time of day, the page can measure how long it takes from the advice to the picture.
        advice = self._newest.get(ADVICE.name) if CONTROL.name not in self._newest else None
        wall_ns = 0 if advice is None else int(advice.time_ns)
        look = CabLook(now_ns, self._view(journey, now_ns, *place), COAST, self._advices + 1, wall_ns=wall_ns)
        return cab_message(look, self.line)

    @property
    def _advises(self) -> bool:
        """Whether there is advice that has been renewed in time."""
        advice = self._newest.get(ADVICE.name)
        return advice is not None and advice.mode != Regime.NONE and self._age_s(ADVICE.name) <= VALID_FOR_S

    def _age_s(self, topic: str) -> float:
        """Time (s) since the last message of a topic, or of all topics (""); infinite if there was none."""
        return self._clocks.seconds() - self._heard_s.get(topic, -math.inf)

    def _fits(self, journey: Any) -> bool:
        """Whether a journey is one for this line and this train; the node judges all the rest."""
        ends_m = [0.0, *(one.s_m for one in journey.stops), self._route.length_m]
        possible = len(ends_m) > 3 and ends_m == sorted(ends_m) and not (journey.reversed and self._route.one_way)
        vehicle = journey.vehicle_id.partition("/")[0]
        return possible and (journey.route_id, vehicle) == (self._route.id, self._vehicle.id.partition("/")[0])

    def _place(self, now_ns: int) -> tuple[float, float, bool] | None:
        """Position (m) and speed (m/s) now, and whether the advice is for this place; None if neither is known.

        The node's estimate, sent with its advice, is smoother than the measured position, unless the two contradict.
        """
        advice, position = self._newest.get(ADVICE.name), self._newest.get(POSITION.name)
        if advice is None or not self._advises or not math.isfinite(advice.s_m):
            advice = None
        elif self._age_s(POSITION.name) > STALE_AFTER_S:
            position = None
        known = [one for one in (advice, position) if one is not None]
        if not known:
            return None
        later = sorted(known, key=lambda one: -one.time_ns)
        speed_mps = next((max(one.speed_mps, 0.0) for one in later if math.isfinite(one.speed_mps)), 0.0)
        places_m = [one.s_m + speed_mps * min(max((now_ns - one.time_ns) * NS, 0.0), STALE_AFTER_S) for one in known]
        sds_m = (getattr(one, "position_sd_m", 0.0) + getattr(one, "uncertainty_m", 0.0) for one in known)
        agrees = abs(places_m[0] - places_m[-1]) <= AWAY_M + AWAY_SDS * sum(sds_m)
        return places_m[0 if agrees else -1], speed_mps, agrees

    def _view(self, journey: Any, now_ns: int, s_m: float, speed_mps: float, agrees: bool) -> CabView:
        """The driver's view. A standing train may not depart before its time; signals and doors are not on the bus."""
        stops, stands, told = journey.stops, speed_mps < STANDSTILL_MPS, self._newest.get(RESTRICTION.name)
        self._leg = leg_of([stop.s_m for stop in stops[1:-1]], self._leg, (s_m, stands))
        start, end, zero_ns = stops[self._leg], stops[self._leg + 1], stops[0].departure_ns
        slow, rear_m = valid_restrictions(told.restrictions if told else ()), s_m - self._vehicle.train_length_m
        advice = self._newest.get(ADVICE.name)
        cause = Cause.NONE if advice is None else advice.cause if agrees else Cause.POSITION_REJECTED
        shown = present(advice, self._presentation, clock_zero_ns=zero_ns) if agrees and self._advises else None
        return CabView(
            time_s=(now_ns - zero_ns) * NS,
            s_m=s_m,
            speed_mps=speed_mps,
            limit_mps=float(self.line.limits_mps.at(s_m)),
            stop_m=end.s_m,
            departure_s=(start.departure_ns - zero_ns) * NS,
            arrival_s=(end.arrival_ns - zero_ns) * NS,
            may_depart=not stands or now_ns >= start.departure_ns,
            restrictions=tuple(one for one in slow if one.counts_at(now_ns) and rear_m <= one.end_m),
            advice=shown,
            cause=int(cause),
            late_s=self._newest[DELAY.name].delay_s if self._age_s(DELAY.name) < DELAY_COUNTS_S else math.nan,
            gradient_ratio=float(self.line.route.gradients_ratio.at(s_m)),
        )


class WatchServer:
    """The server of the page: the cab for every open page, from the messages of an open bus.

    Messages are taken in the thread that receives them, and only the newest state is drawn. A flood therefore fills
    neither the loop nor the memory: `Bus` drops what is too much.
    """

    def __init__(self, train: WatchedTrain, bus: Bus, language: str, page: PageSettings) -> None:
        self._train, self._bus, self._language, self._page = train, bus, language, page
        self._pages, self._lock = OpenPages(), threading.Lock()
        self._news, self._over = asyncio.Event(), threading.Event()
        self._others = ""
        self._drawn: dict[str, Any] = {}
        self._line = train.line

    def routes(self) -> list[BaseRoute]:
        """The routes that the server answers."""

        async def connect(socket: WebSocket) -> None:
            with self._lock:
                hello = self._hello()
            await self._pages.serve(socket, hello)

        return [WebSocketRoute("/desk", connect), *page_routes()]

    async def run(self, server: Any, door: Any) -> None:
        """Serve the page until the server is stopped."""

        def end(_task: object) -> None:
            server.should_exit = True

        receiving = asyncio.create_task(asyncio.to_thread(self._receive, asyncio.get_running_loop()))
        drawing = asyncio.create_task(self._draw())
        for task in (receiving, drawing):  # a page that is no longer drawn would look alive
            task.add_done_callback(end)
        try:
            await server.serve(sockets=[door])
        finally:
            self._over.set()
            drawing.cancel()
            await receiving
            with contextlib.suppress(asyncio.CancelledError):
                await drawing

    def _receive(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take the messages of the bus; after a silence, look for the other trains on it."""
        quiet_s = 0.0
        while not self._over.is_set():
            received = self._bus.receive(PICTURE_S, skip_outdated=True)
            quiet_s = quiet_s + PICTURE_S if received is None else 0.0
            if received is not None:
                with self._lock:
                    self._train.hear(received)
                if received.topic in (ADVICE, JOURNEY) and not self._news.is_set():
                    loop.call_soon_threadsafe(self._news.set)
            elif quiet_s >= SILENT_S:
                self._others, quiet_s = ", ".join(one for one in self._bus.trains() if one != self._bus.train), 0.0

    async def _draw(self) -> None:
        while not self._over.is_set():  # A cancellation is lost if `wait_for` has just ended (Python before 3.12).
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), PICTURE_S)
            self._news.clear()
            with self._lock:
                self._show()
            await asyncio.sleep(LEAST_S)

    def _show(self) -> None:
        """Send a new line, and the cab or what is missing for it; a change of what is missing is also printed."""
        train = self._train
        cab = train.cab()
        if self._line is not train.line:
            self._line = train.line
            self._pages.put(self._hello())
        if (phase := self._phase(cab)) != self._drawn:
            self._drawn = phase
            self._pages.put({"t": "phase", **phase})
            if cab == "silent":
                others = f"; trains with advice on this bus: {self._others}" if self._others else ""
                say(f"{self._bus.train}: nothing received for {SILENT_S:.0f} s{others}")
        if not isinstance(cab, str) and self._pages:
            self._pages.put(cab_of(cab, train.line.route) | {"seq": 0})

    def _phase(self, cab: Message | str) -> dict[str, Any]:
        if not isinstance(cab, str):
            return {"phase": "watching"}
        return {"phase": "waiting", "missing": cab, "others": self._others if cab == "silent" else ""}

    def _hello(self) -> dict[str, Any]:
        train, line = self._train, self._train.line
        hello = hello_of((line.route, line.vehicle, train.stops), train.now_ns, self._language, self._page)
        return hello | {"watched": self._bus.train, "lever": 0.0, "seq": 0} | self._phase(train.cab())


def watch(train: WatchedTrain, bus: Bus, shown: tuple[str, PageSettings], door: Any, token: str) -> None:
    """Show a train's page, in a language and with settings, until Ctrl-C. Raises DasError for an unusable bus."""
    with contextlib.suppress(KeyboardInterrupt), bus:
        page = WatchServer(train, bus, *shown)
        asyncio.run(page.run(server_of(page.routes(), door.getsockname()[1], token), door))
