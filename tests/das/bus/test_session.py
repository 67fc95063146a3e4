"""The bus: its endpoints stay on this machine, keys tell its topics, and what is kept reaches late subscribers.

The inbox bounds what waits. Messages that come while a session is being closed do no harm; Zenoh prints every exception
of a callback.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from das.bus import das_pb2
from das.bus.session import CONTROL_FACTOR, Bus, Inbox, check_endpoint, endpoint, free_ports
from das.bus.topics import CONTROL, JOURNEY, POSITION, RESTRICTION, TOPICS, Received, Topic, topic_of
from das.domain.errors import DasError
from docs.studies.reference import topics
from tests.support.making import REPOSITORY
from tests.support.node_process import TRAIN, a_journey, until


def test_docs_list_every_topic() -> None:
    assert "docs.studies.reference -> topics.md }}" in (REPOSITORY / "docs" / "reference" / "bus.md").read_text()
    for topic in TOPICS:
        name = topic.message.DESCRIPTOR.full_name
        assert f"| `{topic.key('<train>')}` | `{name}` |" in topics()


def test_the_session_listens_on_loopback_only_and_does_not_scout() -> None:
    with Bus(TRAIN, listen=endpoint(free_ports(1)[0])) as bus:
        settings = bus._config
        assert settings.get_json("scouting/multicast/enabled") == "false"
        assert settings.get_json("scouting/gossip/enabled") == "false"
        port = int(str(bus.listen).rpartition(":")[2])
        loopback = "0100007F"
        for table in ("tcp", "tcp6", "udp", "udp6"):
            path = Path("/proc/net") / table
            for line in path.read_text().splitlines()[1:] if path.exists() else []:
                address, _, number = line.split()[1].rpartition(":")
                assert int(number, 16) != port or address == loopback


@pytest.mark.parametrize(
    "text", ["tcp/0.0.0.0:7447", "udp/127.0.0.1:7447", "tcp/127.0.0.1:0", "tcp/127.0.0.1:99999", "x"]
)
def test_endpoints_off_this_machine_are_refused(text: str) -> None:
    with pytest.raises(DasError, match=r"expected tcp/127\.0\.0\.1:PORT"):
        check_endpoint(text)


def test_a_free_port_is_kept_for_a_bus() -> None:
    """No other program gets it before the bus listens."""
    for port in free_ports(3):
        with socket.socket() as other, pytest.raises(OSError, match="in use"):
            other.bind(("127.0.0.1", port))
        with Bus(TRAIN, listen=endpoint(port)):
            pass


def test_registry_keys_are_unique_and_lead_back_to_their_topic() -> None:
    assert len({topic.key(TRAIN) for topic in TOPICS}) == len(TOPICS)
    assert all(topic_of(topic.key(TRAIN)) is topic for topic in TOPICS)
    assert topic_of("das/T1/nothing") is None


def test_a_late_subscriber_gets_the_last_journey() -> None:
    ours, theirs = (endpoint(port) for port in free_ports(2))
    with Bus(TRAIN, listen=ours) as sender:
        sender.publish(JOURNEY, a_journey())
        with Bus(TRAIN, listen=theirs, connect=[ours], hear=(JOURNEY,)) as late:
            assert until(late, lambda r: r.topic is JOURNEY).route_id == "flat-6km"


def test_zenoh_default_session_is_never_opened() -> None:
    """Only das/bus/session.py opens a session."""
    files = [path for folder in ("das", "sim", "precompute") for path in (REPOSITORY / folder).rglob("*.py")]
    users = [path.relative_to(REPOSITORY).as_posix() for path in files if "zenoh.open" in path.read_text()]
    assert users == ["das/bus/session.py"]


def received(topic: Topic, number: int = 0, source: str = "") -> Received:
    message = topic.message()
    message.time_ns = number
    return Received(topic, topic.key("T1"), message, source)


def numbers_of(inbox: Inbox) -> list[tuple[str, int]]:
    left = []
    while (one := inbox.get(0.0)) is not None:
        left.append((one.topic.name, one.message.time_ns))
    return left


def test_a_flood_of_positions_costs_the_oldest_of_them_and_no_journey_or_control() -> None:
    inbox = Inbox(capacity=100)
    inbox.put(received(JOURNEY, 1))
    inbox.put(received(CONTROL, 2))
    for i in range(10_000):
        inbox.put(received(POSITION, i))
    inbox.put(received(CONTROL, 3))
    left = numbers_of(inbox)
    assert left[:2] == [("journey", 1), ("control", 2)]
    assert left[2:-1] == [("position", i) for i in range(10_000 - 97, 10_000)]
    assert left[-1] == ("control", 3)
    assert inbox.dropped == 10_000 - 97


def test_a_flood_of_journeys_leaves_the_newest_and_one_of_controls_is_bounded() -> None:
    inbox = Inbox(capacity=10)
    for i in range(10):
        inbox.put(received(CONTROL, i))
    for i in range(1_000):
        inbox.put(received(JOURNEY, i))
    assert numbers_of(inbox) == [*(("control", i) for i in range(10)), ("journey", 999)]
    for i in range(1_000):
        inbox.put(received(CONTROL, i))
    assert len(inbox) == CONTROL_FACTOR * 10


def test_a_flood_of_large_journeys_does_not_fill_the_memory() -> None:
    inbox = Inbox(capacity=1_000)
    for i in range(1_000):
        message = das_pb2.Journey(time_ns=i)
        inbox.put(Received(JOURNEY, JOURNEY.key("T1"), message, size=1_000_000))
    assert len(inbox) < 10
    assert numbers_of(inbox)[-1] == ("journey", 999)


@given(st.lists(st.one_of(st.none(), st.sampled_from([POSITION, JOURNEY, CONTROL, RESTRICTION])), max_size=200))
def test_the_inbox_keeps_order_and_stays_bounded(steps: list[Topic | None]) -> None:
    inbox, taken, put = Inbox(capacity=5), 0, 0
    last = -1
    for number, topic in enumerate(steps):
        if topic is not None:
            inbox.put(received(topic, number))
            put += 1
        elif (one := inbox.get(0.0)) is not None:
            assert one.message.time_ns > last
            last, taken = one.message.time_ns, taken + 1
        assert len(inbox) <= CONTROL_FACTOR * 5
        assert put == taken + len(inbox) + inbox.dropped


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


@pytest.mark.nightly
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
