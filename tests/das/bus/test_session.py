"""The bus: its endpoints stay on this machine, keys tell its topics, and what is kept reaches late subscribers."""

from __future__ import annotations

from pathlib import Path

import pytest

from das.bus.session import Bus, check_endpoint, endpoint, free_ports
from das.bus.topics import JOURNEY, TOPICS, topic_of
from das.domain.errors import DasError
from tests.support.making import REPOSITORY
from tests.support.node_process import TRAIN, a_journey, until


def test_docs_list_every_topic() -> None:
    page = (REPOSITORY / "docs" / "reference" / "bus.md").read_text()
    for topic in TOPICS:
        name = topic.message.DESCRIPTOR.full_name
        assert f"| `{topic.key('<train>')}` | `{name}` |" in page


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
