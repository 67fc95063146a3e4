"""The on-board system in the process of the simulation, as the link of a run without a bus."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, Final
from weakref import WeakKeyDictionary

from das.advice.advice import Advice
from das.bus import codec
from das.bus.recording import Stamped
from das.bus.topics import Topic
from das.cab.cab import Cab, CabSettings
from das.cab.heard import STATES, Heard, Kind
from das.cab.orders import Post, Trains
from das.cab.preparation import Fronts
from sim.drivers.knowledge import LineKnowledge
from sim.world.loop import BEFORE_S, Tick, Told
from sim.world.service import Service

KEPT_BYTES: Final = 300_000_000
"""Largest total size (bytes) of the fronts that the on-board systems of a service keep."""
FRONTS: Final[WeakKeyDictionary[LineKnowledge, Fronts]] = WeakKeyDictionary()
"""The fronts of the on-board systems of each service, by its line; they are kept as long as the service."""
TRAIN = "train"
"""Name of the train whose advice is computed within the process."""
Recorded = Callable[[int, Told], Iterable[tuple[Topic, Any]]]
"""A function that returns the messages of a tick that are only recorded; called with the time (ns since 1970)."""


class InProcess:
    """The link to an on-board system in this process, which receives the same messages as over a bus.

    With `recorded`, `messages` has all messages that a recorder would write, by topic; else nothing is kept.
    """

    def __init__(self, service: Service, *, guide: bool = False, recorded: Recorded | None = None) -> None:
        self._service, self._guide, self._recorded = service, guide, recorded
        self._kept: dict[Kind, Heard] = {}
        self.messages: dict[str, list[Stamped]] = {}
        self.restart()
        began_ns = service.moment_ns(-BEFORE_S)
        journey = service.journey(TRAIN, began_ns)
        self._hear(journey)
        self.keep(*codec.encode_input(journey), began_ns)

    def restart(self) -> None:
        """Start a new on-board system, which receives only messages kept by the bus: journey, restrictions, targets."""
        service = self._service
        trains = Trains(service.vehicle, service.vehicle)
        post = Post(train=TRAIN, route=service.route, trains=trains, reverse=service.scenario.reverse)
        calibrate = service.scenario.sensors.force_noise_ratio is not None
        fronts = FRONTS.setdefault(service.line, Fronts(kept_bytes=KEPT_BYTES))
        self.cab = Cab(post, service.situation, fronts, CabSettings(calibrate=calibrate, guide=self._guide))
        """The on-board system."""
        self._judged_ns = 0
        for heard in list(self._kept.values()):
            self._hear(heard)

    def exchange(self, tick: Tick) -> Advice:
        """The advice for a tick."""
        for heard in tick.told:
            self._hear(heard)
        outputs = self.cab.tick(tick.now_ns)
        self._judged_ns = tick.now_ns
        if self._recorded is not None:
            sent = [*map(codec.encode_input, tick.told), *(codec.encode_output(one, tick.number) for one in outputs)]
            for topic, message in sent:
                self.keep(topic, message, tick.now_ns)
        advice = outputs[-1]
        assert isinstance(advice, Advice)
        return advice

    def newest(self) -> None:
        """Return None: `exchange` has returned all advice."""

    def tell(self, now_ns: int, told: Told) -> None:
        """Keep the messages that the on-board system does not receive, if messages are kept."""
        for topic, message in () if self._recorded is None else self._recorded(now_ns, told):
            self.keep(topic, message, now_ns)

    def keep(self, topic: Topic, message: Any, now_ns: int) -> None:
        """Keep a message that was sent at a time (ns since 1970)."""
        self.messages.setdefault(topic.name, []).append(Stamped(now_ns, message))

    def _hear(self, heard: Heard) -> None:
        if heard.kind in STATES:
            self._kept[heard.kind] = heard
        self.cab.hear(replace(heard, heard_ns=self._judged_ns))
