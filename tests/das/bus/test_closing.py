"""Messages that come while a session is being closed do no harm: Zenoh prints every exception of a callback."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from das.bus import das_pb2
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import JOURNEY, POSITION


class Closing:
    """A session of Zenoh while it is being closed: it answers nothing that it is asked."""

    def __getattr__(self, name: str) -> object:
        raise RuntimeError("Already mutably borrowed")


def heard_until(hearer: Bus, times_ns: set[int]) -> Iterator[tuple[int, str]]:
    """The times and sources of what is heard, until all of `times_ns` were heard or nothing comes for 10 s."""
    left = set(times_ns)
    while left and (received := hearer.receive(10.0)) is not None:
        left.discard(received.message.time_ns)
        yield received.message.time_ns, received.source


def source_once_connected(speaker: Bus, hearer: Bus) -> str:
    """The speaker's source, once both topics are heard: Zenoh tells the speaker of one subscription after the other."""
    speaker.publish(JOURNEY, das_pb2.Journey(time_ns=1))
    first = hearer.receive(10.0)
    assert first is not None
    for _ in range(100):
        speaker.publish(POSITION, das_pb2.Position(time_ns=1))
        if hearer.receive(0.1) is not None:
            break
    return first.source


@pytest.mark.more
@pytest.mark.processes
def test_a_message_that_comes_while_the_session_is_closed_is_heard_or_dropped_but_no_error(
    capfd: pytest.CaptureFixture[str],
) -> None:
    here, there = free_ports(2)
    with (
        Bus("t1", listen=endpoint(here)) as speaker,
        Bus("t1", listen=endpoint(there), connect=[endpoint(here)], hear=[POSITION, JOURNEY]) as hearer,
    ):
        source = source_once_connected(speaker, hearer)
        hearer._session = Closing()
        speaker.publish(POSITION, das_pb2.Position(time_ns=2))
        speaker.publish(JOURNEY, das_pb2.Journey(time_ns=3))
        heard = dict(heard_until(hearer, {2, 3}))
        assert set(heard) - {1} == {2, 3}
        assert set(heard.values()) == {source}
        assert hearer.presences() == []
    assert "Traceback" not in capfd.readouterr().err
