"""Messages that come while a session is being closed do no harm: Zenoh prints every exception of a callback."""

from __future__ import annotations

import pytest

from das.bus import das_pb2
from das.bus.session import Bus, endpoint, free_ports
from das.bus.topics import JOURNEY, POSITION


class Closing:
    """A session of Zenoh while it is being closed: it answers nothing that it is asked."""

    def __getattr__(self, name: str) -> object:
        raise RuntimeError("Already mutably borrowed")


@pytest.mark.processes
def test_a_message_that_comes_while_the_session_is_closed_is_heard_or_dropped_but_no_error(
    capfd: pytest.CaptureFixture[str],
) -> None:
    here, there = free_ports(2)
    with (
        Bus("t1", listen=endpoint(here)) as speaker,
        Bus("t1", listen=endpoint(there), connect=[endpoint(here)], hear=[POSITION, JOURNEY]) as hearer,
    ):
        speaker.publish(JOURNEY, das_pb2.Journey(time_ns=1))
        first = hearer.receive(10.0)
        assert first is not None
        hearer._session = Closing()
        speaker.publish(POSITION, das_pb2.Position(time_ns=2))
        speaker.publish(JOURNEY, das_pb2.Journey(time_ns=3))
        heard = [hearer.receive(10.0), hearer.receive(10.0)]
        assert {one.message.time_ns for one in heard if one is not None} == {2, 3}
        assert {one.source for one in heard if one is not None} == {first.source}
        assert hearer.presences() == []
    assert "Traceback" not in capfd.readouterr().err
