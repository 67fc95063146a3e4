"""Streams of a drive over the lab streaming layer (LSL), beside the recording, to align it with other instruments."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from google.protobuf.message import Message

from das.bus.session import Bus
from das.bus.topics import ACTION, CAB, MARK, Received, Topic
from das.domain.clocks import WALL
from das.domain.errors import DasError
from das.domain.units import NS

LONGEST_AGE_S: Final = 1.0
"""Largest age (s) of a message that its LSL time allows for; with a larger one, a clock was set."""


class Stream(NamedTuple):
    """A stream: its name and LSL type, the units of its channels, and the sample and time that a message gives."""

    name: str
    kind: str
    channels: dict[str, str]
    sample: Callable[[Any], list[Any]]
    arose_ns: Callable[[Any], int]
    """The wall clock (ns since 1970) when the content of a message arose; 0: not known."""


STREAMS: Final = {
    ACTION.name: Stream(
        "lever", "Control", {"lever": "ratio", "device": "", "number": ""},
        lambda one: [one.lever_ratio, float(one.device), float(one.number)],
        lambda one: one.browser_ns or one.server_ns,
    ),
    MARK.name: Stream(
        "marks", "Markers", {"mark": ""},
        lambda one: [": ".join(filter(None, (one.Kind.Name(one.kind).removeprefix("KIND_").lower(), one.text)))],
        lambda one: one.browser_ns or one.server_ns,
    ),
    CAB.name: Stream(
        "cab", "Vehicle", {"speed": "m/s", "limit": "m/s", "advised_speed": "m/s", "mode": "", "position": "m"},
        lambda one: [one.speed_mps, one.limit_mps, one.advised_speed_mps, float(one.mode), one.s_m],
        lambda one: one.wall_ns,
    ),
}  # fmt: skip
"""The streams by the topics from which they are made; docs/how-to/drive-at-the-desk.md lists them."""


def lsl_library() -> Any:
    """The package pylsl; DasError if it, or the library liblsl that it loads, is not installed."""
    try:
        return importlib.import_module("pylsl")
    except ImportError as error:
        raise DasError("--lsl: pylsl is not installed: pip install '.[lsl]' in the checkout") from error
    except RuntimeError as error:  # how pylsl reports that it has found no library
        raise DasError("--lsl: liblsl is not installed: see https://github.com/sccn/liblsl/releases") from error


class StreamedBus(Bus):
    """A session on the bus whose messages, sent and received, are also sent over LSL, if a stream is made from them.

    The streams are named `das-NAME-lever` and so on; their `name` is that of the train or the participant.
    """

    def __init__(self, name: str, *given: Any, **more: Any) -> None:
        super().__init__(*given, **more)
        self._name = name

    def __enter__(self) -> Bus:
        self._lsl = lsl_library()
        self._outlets = {topic: self._outlet(f"das-{self._name}-{one.name}", one) for topic, one in STREAMS.items()}
        return super().__enter__()

    def publish(self, topic: Topic, message: Message) -> None:
        """Send a message on the bus and over LSL."""
        super().publish(topic, message)
        self._push(topic, message)

    def receive(self, timeout_s: float, *, skip_outdated: bool = False) -> Received | None:
        """The next message of the bus, which is also sent over LSL; None after a time (s) without one."""
        received = super().receive(timeout_s, skip_outdated=skip_outdated)
        if received is not None and received.message is not None:
            self._push(received.topic, received.message)
        return received

    def _push(self, topic: Topic, message: Message) -> None:
        """Send a message with the LSL time when its content arose."""
        if (stream := STREAMS.get(topic.name)) is not None:
            now_ns = WALL.now_ns()
            age_s = min(max((now_ns - (stream.arose_ns(message) or now_ns)) * NS, 0.0), LONGEST_AGE_S)
            self._outlets[topic.name].push_sample(stream.sample(message), self._lsl.local_clock() - age_s)

    def _outlet(self, name: str, stream: Stream) -> Any:
        lsl, form = self._lsl, self._lsl.cf_string if stream.kind == "Markers" else self._lsl.cf_double64
        # The name is also the source's identity: receivers go on when a killed server is replaced.
        info = lsl.StreamInfo(name, stream.kind, len(stream.channels), lsl.IRREGULAR_RATE, form, name)
        channels = info.desc().append_child("channels")
        for label, unit in stream.channels.items():
            channels.append_child("channel").append_child_value("label", label).append_child_value("unit", unit)
        return lsl.StreamOutlet(info)
