"""A node without sockets: the test passes messages to it, and all published messages are stored."""

from __future__ import annotations

from typing import Any

from google.protobuf.message import Message

from das.bus import das_pb2
from das.bus.session import Presence
from das.bus.topics import ADVICE, CONTROL, EVENT, JOURNEY, POSITION, RESTRICTION, Topic, decoded
from das.cab.cab import Cab, CabSettings
from das.cab.orders import Post, Trains
from das.cab.preparation import Fronts
from das.cab.situation import Situation
from das.domain.files.load import load_route, load_vehicle
from das.node.node import BusClock, Node

TRAIN = "T1"
START_NS = 1_800_000_000_000_000_000
S = 10**9
FRONTS = Fronts(threads=1)
ROUTE, VEHICLE = load_route("flat-6km"), load_vehicle("re460-ic")


class Sink:
    """A replacement for the bus, which stores the node's messages and sends nothing."""

    train = TRAIN
    dropped = 0

    def __init__(self) -> None:
        self.said: list[tuple[Topic, Any]] = []
        self.seen: list[Presence] = []

    def publish(self, topic: Topic, message: Message) -> None:
        payload = message.SerializeToString()
        assert len(payload) < 100_000
        self.said.append((topic, topic.message.FromString(payload)))

    def presences(self) -> list[Presence]:
        """Publishers that appeared or disappeared since the last call."""
        seen, self.seen = self.seen, []
        return seen

    def of(self, topic: Topic) -> list[Any]:
        return [message for one, message in self.said if one is topic]

    def events(self) -> str:
        return "\n".join(message.message for message in self.of(EVENT))


def make_node(sink: Sink, settings: CabSettings | None = None, fronts: Fronts = FRONTS) -> Node:
    """A node on the flat line that takes its time from the bus."""
    post = Post(train=TRAIN, route=ROUTE, trains=Trains(VEHICLE, VEHICLE))
    cab = Cab(post, Situation(route=ROUTE, vehicle=VEHICLE), fronts, settings)
    return Node(sink, cab, BusClock())  # type: ignore[arg-type]


class DrivenNode:
    """A node whose train runs at 20 m/s from second 0 on; it has a journey, and an empty list of restrictions.

    If the train stood for a minute before (`stood`), its speeds are trusted from the first one.
    """

    def __init__(
        self, settings: CabSettings | None = None, *, told: bool = True, stood: bool = True, fronts: Fronts = FRONTS
    ) -> None:
        self.sink = Sink()
        self.node = make_node(self.sink, settings, fronts)
        if stood:
            self.tell(POSITION, das_pb2.Position(time_ns=START_NS - 60 * S, s_m=0.0, speed_mps=0.0))
        if told:
            self.tell(JOURNEY, journey())
            self.tell(RESTRICTION, das_pb2.Restrictions(time_ns=START_NS))

    def tell(self, topic: Topic, message: Message, source: str = "") -> None:
        self.node.take(decoded(topic, topic.key(TRAIN), message.SerializeToString(), source))

    def tell_time(self, second: float) -> None:
        """Request the advice at a second."""
        self.tell(CONTROL, das_pb2.Control(time_ns=START_NS + round(second * S), tick=round(second)))

    def last_advice(self) -> Any:
        """The newest advice message."""
        return self.sink.of(ADVICE)[-1]

    def tick(self, second: float, s_m: float | None = None) -> Any:
        """The single advice message published by the node for a second."""
        now_ns = START_NS + round(second * S)
        before = len(self.sink.of(ADVICE))
        place_m = 20.0 * second if s_m is None else s_m
        self.tell(POSITION, das_pb2.Position(time_ns=now_ns, s_m=place_m, speed_mps=20.0))
        self.tell(CONTROL, das_pb2.Control(time_ns=now_ns, tick=round(second)))
        (advice,) = self.sink.of(ADVICE)[before:]
        assert (advice.time_ns, advice.tick) == (now_ns, round(second))
        return advice


def journey(**changes: Any) -> das_pb2.Journey:
    stops = [
        das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=START_NS),
        das_pb2.Journey.Stop(name="B", s_m=6_000.0, arrival_ns=START_NS + 300 * S),
    ]
    known = {"time_ns": START_NS, "route_id": "flat-6km", "vehicle_id": "re460-ic", "stops": stops}
    return das_pb2.Journey(**{**known, **changes})


def restrictions(second: float, limit_mps: float) -> das_pb2.Restrictions:
    one = das_pb2.Restrictions.Restriction(start_m=0.0, end_m=6_000.0, limit_mps=limit_mps)
    return das_pb2.Restrictions(time_ns=START_NS + round(second * S), restrictions=[one])
