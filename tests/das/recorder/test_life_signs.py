"""What das-record says while it records."""

from __future__ import annotations

from das.bus import das_pb2
from das.bus.topics import ADVICE, POSITION, STATUS, Received, Topic
from das.domain.clocks import Clocks
from das.recorder.process import COUNTED_EVERY_S, SILENT_S, LifeSigns


def received(topic: Topic, source: str) -> Received:
    """A message of a topic from a session."""
    return Received(topic, topic.key("T1"), das_pb2.Status(), source)


def test_senders_silence_and_counts_are_said_once_each() -> None:
    now_s, said = [0.0], []
    signs = LifeSigns("T1", Clocks(seconds=lambda: now_s[0]), said.append)
    now_s[0] = SILENT_S
    signs.look(0)
    signs.look(0)
    assert said == [
        "das-record T1: nothing received for 10 s: is every process that sends running, and named by --connect?"
    ]
    for topic, source in ((STATUS, "a"), (ADVICE, "a"), (STATUS, "b"), (POSITION, "c")):
        signs.take(received(topic, source))
    assert said[1:] == [
        "das-record T1: hears the node (status)",
        "das-record T1: hears the node (status)",  # another session: a second node, or the first one restarted
        "das-record T1: hears the localisation (position)",
    ]
    now_s[0] = COUNTED_EVERY_S - 1.0
    signs.look(4)
    assert said[4:] == ["das-record T1: nothing received for 10 s"]
    now_s[0] = COUNTED_EVERY_S
    signs.take(received(POSITION, "c"))
    signs.look(5)
    signs.look(5)
    assert said[5:] == ["das-record T1: 5 messages so far"]
