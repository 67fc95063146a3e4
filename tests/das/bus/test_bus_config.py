"""Bus files: what is refused and why, what a file may change, what tls-init makes."""

from __future__ import annotations

import json
import stat
import sys
from pathlib import Path
from typing import Any

import pytest

from das.bus.access import LISTENERS, BusFolder, Role, access_control, bus_folder, keys_of, write_bus_folder
from das.bus.config import BusFile, bus_options
from das.bus.topics import TOPICS, Topic
from das.command_line.application import single_command
from das.domain.errors import DasError, InputError
from das.node.command import tls_init

TLS_INIT = single_command("tls-init", tls_init, ())
PORTS = {role: 7447 + i for i, role in enumerate(LISTENERS)}


def written(folder: Path, text: str) -> BusFile:
    path = folder / "site.json5"
    path.write_text(text)
    return BusFile(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{mode: 'peer'", "not a Zenoh configuration: line 1, column 8: expected"),
        ("[" * 20_000, "not a Zenoh configuration: brackets are nested more than 64 deep"),
        ("{nonsense: 1}", "not a Zenoh configuration: unknown field `nonsense`"),
        ("{listen: {endpoints: ['x']}}", "Endpoints must be of the form"),
        ("{metadata: {das: {train: 'T2'}}}", "metadata.das.train = 'T2': expected 'T1', the train of this process"),
        (
            "{transport: {link: {tls: {root_ca_certificate: 'no.pem'}}}}",
            "transport.link.tls.root_ca_certificate = 'no.pem': expected an existing file",
        ),
        (
            "{listen: {endpoints: ['tcp/0.0.0.0:7447']}}",
            "listen.endpoints = 'tcp/0.0.0.0:7447': expected an endpoint of this machine, or tls with",
        ),
        ("{connect: {endpoints: {peer: ['udp/10.0.0.1:1']}}}", "connect.endpoints = 'udp/10.0.0.1:1': expected"),
        ("{connect: {endpoints: ['tls/10.0.0.1:1']}}", "connect.endpoints = 'tls/10.0.0.1:1': expected"),
        ("{connect: {endpoints: ['tcp/localhost.evil.org:1']}}", "expected an endpoint of this machine"),
        ("{listen: {endpoints: ['tcp/127.0.0.1:1#iface=eth0', 'ws/[::]:2']}}", "'ws/[::]:2': expected"),
        ("{scouting: {multicast: {enabled: true}}}", "scouting.multicast.enabled = True: expected false, or"),
        ("{scouting: {gossip: {enabled: true}}}", "scouting.gossip.enabled = True: expected false, or"),
    ],
)
def test_a_bus_file_that_cannot_be_used_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(DasError) as error:
        file.config("T1")
    assert str(error.value).startswith(f"{file.path}: ")
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    assert "/.cargo/" not in str(error.value)


def test_a_missing_file_or_folder_is_said(tmp_path: Path) -> None:
    with pytest.raises(DasError, match="cannot be read"):
        BusFile(tmp_path / "none.json5").config("T1")
    with pytest.raises(
        DasError, match=r"simulator\.json5: does not exist; expected a folder made by das-node tls-init"
    ):
        bus_folder(tmp_path, False, "T1")


def test_options_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DasError, match="--insecure-bus: needs --bus"):
        bus_options(None, True, None, None)
    with pytest.raises(DasError, match="--listen: not together with --bus, whose file states the endpoints"):
        bus_options(tmp_path / "x", False, "tcp/127.0.0.1:7447", None)
    with pytest.raises(DasError, match="--connect: not together with --bus, whose file states the endpoints"):
        bus_options(tmp_path / "x", False, None, ["tcp/127.0.0.1:7447"])
    with pytest.raises(DasError, match="--listen: not together with --bus"):
        bus_options(tmp_path / "x", False, "", None)
    assert bus_options(None, False, "tcp/127.0.0.1:7447", []) is None


def test_an_empty_file_stays_as_closed_as_no_file(tmp_path: Path) -> None:
    config = written(tmp_path, "{}").config("T1")
    expected: dict[str, Any] = {
        "mode": "peer",
        "listen/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": True,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": 2000,
    }
    assert {key: json.loads(config.get_json(key)) for key in expected} == expected


def test_what_a_file_says_stays_but_for_what_we_need(tmp_path: Path) -> None:
    text = "{timestamping: {enabled: false}, transport: {link: {tx: {lease: 4000}}}, mode: 'client'}"
    config = written(tmp_path, text).config("T1")
    assert json.loads(config.get_json("timestamping/enabled")) is True
    assert json.loads(config.get_json("transport/link/tx/lease")) == 4000
    assert json.loads(config.get_json("mode")) == "client"


def test_the_network_needs_mutual_tls_or_the_users_word(tmp_path: Path) -> None:
    write_bus_folder(tmp_path / "bus", "T1", PORTS, days=1.0)
    path = tmp_path / "bus" / "node.json5"
    text = path.read_text().replace("tls/127.0.0.1:7447", "tls/0.0.0.0:7447")
    path.write_text(text)
    BusFile(path).config("T1")
    path.write_text(text.replace("tls/0.0.0.0:7447", "tls/0.0.0.0:7447#enable_mtls=false"))
    with pytest.raises(InputError, match=r"listen\.endpoints"):
        BusFile(path).config("T1")
    path.write_text(text.replace('"enable_mtls": true', '"enable_mtls": false'))
    with pytest.raises(InputError, match=r"enable_mtls"):
        BusFile(path).config("T1")
    BusFile(path, insecure=True).config("T1")


def test_tls_init_makes_a_folder_that_can_be_used_and_never_overwrites(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "bus"
    TLS_INIT(args=[str(folder), "--train", "T1", "--port", "8000"], standalone_mode=False)
    said = capsys.readouterr().out
    assert "not a public-key infrastructure" in said
    assert "valid until" in said
    for role in Role:
        assert stat.S_IMODE((folder / f"{role}.key").stat().st_mode) == 0o600
        BusFolder(folder).file(role).config("T1")
    before = (folder / "ca.pem").read_bytes()
    with pytest.raises(DasError, match="exists already"):
        TLS_INIT(args=[str(folder)], standalone_mode=False)
    assert (folder / "ca.pem").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--days", "0"], "--days 0: expected more than 0"),
        (["--port", "65534"], "--port 65534: expected at most 65533"),
        (["--train", "a/b"], "train name 'a/b'"),
        (["--train", "a" * 43], "expected at most 42 letters, for the names in certificates"),
    ],
)
def test_tls_init_refuses_what_makes_no_sense(tmp_path: Path, arguments: list[str], said: str) -> None:
    with pytest.raises(DasError, match=said):
        TLS_INIT(args=[str(tmp_path / "bus"), *arguments], standalone_mode=False)
    assert not (tmp_path / "bus").exists()


def may_say(topic: Topic) -> list[Role]:
    return [role for role in Role if topic.key("T1") in keys_of(role, "T1")]


def test_every_topic_has_one_role_that_may_say_it_and_the_simulator_says_what_the_world_does() -> None:
    others = {topic.name: set(may_say(topic)) - {Role.SIMULATOR} for topic in TOPICS}
    assert others.pop("controls") == {Role.DRIVER, Role.DESK}
    assert all(len(roles) <= 1 for roles in others.values())
    said = {role: {topic.name for topic in TOPICS if role in may_say(topic)} for role in Role}
    assert said[Role.SENSORS] == {"position", "effort"}
    assert said[Role.OPERATOR] == {"journey", "restriction", "target", "delay"}
    assert said[Role.SIMULATOR] >= said[Role.SENSORS] | said[Role.OPERATOR]
    by_us = said[Role.NODE] | said[Role.RECORDER] | said[Role.DRIVER] | said[Role.DESK]
    assert said[Role.SIMULATOR] == {topic.name for topic in TOPICS} - by_us
    assert keys_of(Role.CAB, "T1") == []
    assert keys_of(Role.DRIVER, "T1") == ["sim/T1/controls"]
    assert keys_of(Role.DESK, "T1") == ["sim/T1/controls", "sim/T1/action", "sim/T1/mark"]
    assert keys_of(Role.NODE, "T1") == [
        f"das/T1/{name}" for name in ("advice", "plan", "estimate", "status", "status/@adv/**", "event")
    ]


def test_access_control_allows_no_wildcard_and_no_deletion() -> None:
    for own in Role:
        rules = access_control(own, "T1")["rules"]
        saying = [rule for rule in rules if "put" in rule["messages"]]
        assert all(key.split("/@adv")[0].count("*") == 0 for rule in saying for key in rule["key_exprs"])
        assert all("delete" not in rule["messages"] for rule in rules)


def test_without_trustme_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trustme", None)
    with pytest.raises(DasError, match=r"^tls-init needs the package trustme: pip install '\.\[tls\]'"):
        write_bus_folder(tmp_path / "bus", "T1", PORTS, days=1.0)
    assert not list(tmp_path.iterdir())
