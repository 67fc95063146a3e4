"""Hostile messages to the node, by the way they come (decoding, inbox, Node.take): no crash, no advice from garbage.

20 000 inputs from a fixed seed; more with DAS_FUZZ=1000000 (and another seed with DAS_FUZZ_SEED=7).
"""

from __future__ import annotations

import math
import os
import random
import struct
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
from google.protobuf.message import Message

from das.bus import das_pb2
from das.bus.session import Inbox
from das.bus.topics import (
    ADVICE,
    CONTROL,
    DELAY,
    EFFORT,
    EVENT,
    JOURNEY,
    POSITION,
    RESTRICTION,
    STATUS,
    TARGET,
    TOPICS,
    Topic,
    decoded,
)
from das.cab.cab import CabSettings
from tests.support.crossing import numbered
from tests.support.driven_node import START_NS, TRAIN, S, Sink, make_node

SEED = int(os.environ.get("DAS_FUZZ_SEED", "20261121"))
TICK_EVERY = 25
"""One Control per so many inputs: the time it takes is that of the advice."""
RESTART_EVERY = 2_500
"""A lie that a simulator could tell (the first journey is of the far future) silences a node until it restarts."""
HEARD = (JOURNEY, POSITION, DELAY, RESTRICTION, TARGET, EFFORT, CONTROL)
WEIGHTS = (20, 30, 10, 3, 5, 5, 10)
"""Few lies about restrictions: one that cannot be read silences the node until the next that can."""
NUMBERS = (0.0, -0.0, math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -1.0, 1e9, 0.3, 6_000.0, 1e-9)
TIMES = (0, 1, -1, 2**63 - 1, -(2**63), START_NS - 3_600 * S, START_NS + 86_400 * S)


class World:
    """A train that runs, as those say who may, with lies strewn in by one who may not."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.second = 0.0
        self.sent: list[tuple[Topic, bytes]] = []

    @property
    def now_ns(self) -> int:
        return START_NS + round(self.second * S)

    def truth(self, topic: Topic) -> Message:
        """What the right sender says now."""
        at_s, now_ns = self.second % 240.0, self.now_ns
        if topic is POSITION:
            return das_pb2.Position(time_ns=now_ns, s_m=25.0 * at_s, speed_mps=25.0)
        if topic is DELAY:
            return das_pb2.Delay(time_ns=now_ns, delay_s=self.random.uniform(-60.0, 600.0))
        if topic is RESTRICTION:
            return das_pb2.Restrictions(time_ns=now_ns)
        if topic is TARGET:
            arrival_ns = now_ns + round(self.random.uniform(60.0, 400.0) * S)
            return das_pb2.Targets(time_ns=now_ns, targets=[das_pb2.Targets.Target(stop="B", arrival_ns=arrival_ns)])
        if topic is EFFORT:
            return das_pb2.Effort(time_ns=now_ns, force_el_n=self.random.uniform(-3e5, 3e5))
        if topic is CONTROL:
            return das_pb2.Control(time_ns=now_ns, tick=round(self.second))
        start_ns = now_ns - round(at_s * S)
        stops = [
            das_pb2.Journey.Stop(name="A", s_m=0.0, departure_ns=start_ns),
            das_pb2.Journey.Stop(name="B", s_m=6_000.0, arrival_ns=start_ns + 300 * S),
        ]
        return das_pb2.Journey(time_ns=now_ns, train=TRAIN, route_id="flat-6km", vehicle_id="re460-ic", stops=stops)

    def number(self) -> float:
        draw = self.random.random()
        if draw < 0.5:
            return self.random.choice(NUMBERS)
        return self.random.uniform(-1e4, 1e4) if draw < 0.8 else struct.unpack("<d", self.random.randbytes(8))[0]

    def time(self) -> int:
        return self.random.choice((*TIMES, self.now_ns, self.now_ns - self.random.randrange(100 * S)))

    def disturbed(self, message: Message) -> Message:
        """The message with some fields replaced by what nobody means."""
        for field in message.DESCRIPTOR.fields:
            if self.random.random() > 0.4:
                continue
            if field.is_repeated:
                self._disturb_repeated(message, field)
            elif field.type == field.TYPE_DOUBLE:
                setattr(message, field.name, self.number())
            elif field.type == field.TYPE_INT64:
                setattr(message, field.name, self.time())
            elif field.type == field.TYPE_UINT64:
                setattr(message, field.name, self.random.choice((0, 1, 2**64 - 1)))
            elif field.type == field.TYPE_STRING:
                setattr(message, field.name, self.random.choice(("", "T2", "x" * 10_000, "re460-ic", "\0\n\x1b[2J")))
            elif field.type == field.TYPE_ENUM and message.DESCRIPTOR.name != "Control":  # FINISH is a right word
                setattr(message, field.name, self.random.choice((0, 1, 2, 3, 99, -1, 2**31 - 1)))
        return message

    def _disturb_repeated(self, message: Message, field: Any) -> None:
        few = self.random.random() > 0.02
        for _ in range(self.random.randrange(5) if few else 5_000):
            self.disturbed(getattr(message, field.name).add())
        if self.random.random() < 0.3:
            message.ClearField(field.name)

    def lie(self) -> tuple[Topic, bytes]:
        """A topic and a payload nobody should act on, or one of the past."""
        topic = self.random.choices(HEARD, WEIGHTS)[0]
        kinds: tuple[Callable[[], bytes], ...] = (
            lambda: self.random.randbytes(self.random.randrange(200)),
            lambda: self._cut(self.truth(topic).SerializeToString()),
            lambda: self._flipped(self.truth(topic).SerializeToString()),
            lambda: self.disturbed(self.truth(topic)).SerializeToString(),
            lambda: self.disturbed(topic.message()).SerializeToString(),
            lambda: self.truth(self.random.choice(HEARD)).SerializeToString(),  # of another type
        )
        if self.sent and self.random.random() < 0.15:
            return self.random.choice(self.sent)  # replayed
        return topic, self.random.choice(kinds)()

    def _cut(self, payload: bytes) -> bytes:
        return payload[: self.random.randrange(len(payload) + 1)]

    def _flipped(self, payload: bytes) -> bytes:
        bits = bytearray(payload)
        for _ in range(self.random.randrange(1, 6) if bits else 0):
            bits[self.random.randrange(len(bits))] ^= 1 << self.random.randrange(8)
        return bytes(bits)


class Witness:
    """Keeps, by rules of its own, the positions an advice may rest on, and judges every advice against them."""

    def __init__(self) -> None:
        self.positions: dict[int, set[tuple[float, float, float]]] = {}
        self.advices: Counter[bool] = Counter()

    def heard(self, topic: Topic, payload: bytes) -> None:
        message = decoded(topic, topic.key(TRAIN), payload).message
        if topic is POSITION and message is not None and message.quality != das_pb2.Position.QUALITY_INVALID:
            self.positions.setdefault(message.time_ns, set()).add(
                (message.s_m, message.speed_mps, message.uncertainty_m)
            )

    def judge(self, advice: das_pb2.Advice) -> None:
        given = advice.mode != das_pb2.MODE_NONE
        self.advices[given] += 1
        if not given:
            assert advice.reason.text
            assert math.isnan(advice.advised_speed_mps)
            assert not advice.horizon_speed_mps
            return
        assert abs(advice.time_ns - advice.position_time_ns) <= 3 * S
        assert any(_can_be_said(*state) for state in self.positions[advice.position_time_ns])
        assert _can_be(advice.s_m, advice.speed_mps), f"advice for where nobody can be: {advice}"
        numbers = [advice.s_m, advice.speed_mps, advice.advised_speed_mps, advice.advised_force_n, advice.limit_mps]
        numbers += [advice.advised_force_ratio, *advice.horizon_speed_mps, *advice.horizon_force_n]
        assert all(map(math.isfinite, numbers))
        assert len(advice.horizon_speed_mps) == len(advice.horizon_force_n) == 30
        assert -1e-6 <= advice.advised_speed_mps <= advice.limit_mps + 1e-6
        assert all(-1e-6 <= speed <= 200.0 / 3.6 + 1e-6 for speed in advice.horizon_speed_mps)
        assert abs(advice.advised_force_ratio) <= 1.0 + 1e-6


def _can_be(s_m: float, speed_mps: float) -> bool:
    """Whether a Re 460 (200 km/h) can be there on flat-6km, with what the advisor allows a sensor to be wrong by."""
    return -50.0 <= s_m <= 6_500.0 and -0.3 <= speed_mps <= 1.3 * 200.0 / 3.6


def _can_be_said(s_m: float, speed_mps: float, uncertainty_m: float) -> bool:
    """The same of a fix, of which place or speed may not be measured (NaN); it is off by five deviations at most."""
    off_m = 5.0 * (min(uncertainty_m, 200.0) if uncertainty_m > 30.0 else 30.0)
    nearest_m = 0.0 if math.isnan(s_m) else s_m - max(-off_m, min(off_m, s_m))
    return _can_be(nearest_m, 0.0 if math.isnan(speed_mps) else speed_mps)


@pytest.mark.parametrize("numbers", numbered("DAS_FUZZ", 20_000))
def test_no_crash_no_hang_no_advice_from_garbage(numbers: range) -> None:
    """Random hostile messages between true ones: the node lives and advises only from what a witness holds true."""
    sink, world, witness, inbox = Sink(), World(SEED + numbers.start), Witness(), Inbox()
    events = 0
    for i in range(len(numbers)):
        if i % RESTART_EVERY == 0:
            node = make_node(sink, CabSettings(calibrate=True))
        if i % TICK_EVERY == 0:
            world.second += 1.0
            batch = [
                (topic, world.truth(topic).SerializeToString()) for topic in (JOURNEY, RESTRICTION, POSITION, CONTROL)
            ]
            world.sent = [*world.sent[-200:], *batch]
        else:
            batch = [world.lie()]
        for topic, payload in batch:
            witness.heard(topic, payload)
            inbox.put(decoded(topic, topic.key(TRAIN), payload))
        while (received := inbox.get(0.0)) is not None:
            node.take(received)
        for topic, message in sink.said:
            if topic is ADVICE:
                witness.judge(message)
            events += topic is EVENT
        sink.said.clear()
        if i % 1_000 == 0:
            horizon = world.now_ns - 10 * S
            kept = {t: states for t, states in witness.positions.items() if t > horizon}
            witness.positions = {**kept, **{t: witness.positions[t] for t in TIMES if t in witness.positions}}
    assert witness.advices[True] > len(numbers) / TICK_EVERY / 10  # the fuzzer must not just have silenced the node
    assert witness.advices[False] > len(numbers) / TICK_EVERY / 20
    assert events < 0.65 * len(numbers)  # in moderation; clocks and efforts that come to be doubted make some of them


def test_every_topic_the_node_hears_is_fuzzed() -> None:
    """The fuzzer would prove nothing of a topic that it never sends."""
    world = World(1)
    assert {world.lie()[0].name for _ in range(1_000)} == {topic.name for topic in HEARD}
    assert {topic.publisher for topic in TOPICS if topic not in HEARD} <= {
        "node",
        "recorder",
        "simulator",
        "driver",
        "desk",
    }
    assert STATUS not in HEARD
