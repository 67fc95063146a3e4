"""The Zenoh configuration of a bus: locked down to this machine, or a site's own file made fit and checked.

Zenoh's own defaults listen on every interface and look for others by multicast; neither happens here unless a
site's file says so, and then only over mutual TLS (or with the user's word that it may be open).
"""

from __future__ import annotations

import ipaddress
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import zenoh

from das.bus.access import Role
from das.domain.errors import DasError, InputError

LEASE_MS = 2000
"""A frozen peer is noticed after this."""
RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2}
LARGEST_BYTES = 1 << 20
"""Larger messages are thrown away while they arrive; the largest of ours, a plan, has some 100 kB."""
ALWAYS: dict[str, Any] = {
    "timestamping/enabled": True,
    "transport/shared_memory/enabled": False,  # a sender could alter a message after it was checked
    "transport/link/rx/max_message_size": LARGEST_BYTES,
}
"""What we rely on, whatever a file says."""
UNLESS_SAID: dict[str, Any] = {
    "mode": "peer",
    "listen/endpoints": [],
    "connect/endpoints": [],
    "connect/timeout_ms": -1,
    "connect/exit_on_failure": False,
    "connect/retry": RETRY,
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/link/tx/lease": LEASE_MS,
}
"""What takes the place of Zenoh's own defaults where a file does not say."""
SECRETS = "transport/link/tls"
FILES = (
    "root_ca_certificate",
    "listen_certificate",
    "listen_private_key",
    "connect_certificate",
    "connect_private_key",
)
ENCRYPTED, OF_THIS_MACHINE = ("tls", "quic"), ("unixsock-stream", "unixpipe")
SOURCE_PLACE = re.compile(r" at /\S+:\d+\.")
"""Where in Zenoh's own source an error arose; of no use to who reads it."""
SYNTAX_ERROR = re.compile(r"--> (\d+):(\d+) .*= (expected .*)")
"""A syntax error is drawn, over several lines."""
MOST_SAID = 200
DEEPEST = 64
"""Brackets nested deeper are no configuration."""


@dataclass(frozen=True)
class BusFile:
    """A site's configuration of the bus for one process; `insecure`: it may open the bus to the network."""

    path: Path
    insecure: bool = False

    def arguments(self) -> list[str]:
        """How a process of ours is told to use it."""
        return ["--bus", str(self.path), *(["--insecure-bus"] if self.insecure else [])]

    def config(self, train: str) -> zenoh.Config:
        """The configuration, ready to open; InputError where it cannot be used, or is open without leave."""
        try:
            config = zenoh.Config.from_json5(self._text())
        except OSError as error:
            raise DasError(f"{self.path}: cannot be read ({error.strerror})") from error
        except UnicodeDecodeError as error:
            raise DasError(f"{self.path}: expected a text in UTF-8") from error
        except zenoh.ZError as error:
            raise DasError(f"{self.path}: not a Zenoh configuration: {one_line(error)}") from error
        self._check_train(config, train)
        default = zenoh.Config()
        for key, value in UNLESS_SAID.items():
            if config.get_json(key) == default.get_json(key):
                config.insert_json5(key, json.dumps(value))
        for key, value in ALWAYS.items():
            config.insert_json5(key, json.dumps(value))
        self._find_files(config)
        if not self.insecure:
            self._check_closed(config)
        return config

    def _text(self) -> str:
        text = self.path.read_text()
        if _depth(text) > DEEPEST:  # Zenoh's parser would end the process
            raise DasError(f"{self.path}: not a Zenoh configuration: brackets are nested more than {DEEPEST} deep")
        return text

    def _check_train(self, config: zenoh.Config, train: str) -> None:
        """A file that `tls-init` made is for one train; under another name everything would be refused in silence."""
        metadata = _read(config, "metadata")
        of_ours = metadata.get("das") if isinstance(metadata, dict) else None
        its = of_ours.get("train") if isinstance(of_ours, dict) else None
        if its is not None and its != train:
            raise InputError(self.path, "metadata.das.train", its, f"{train!r}, the train of this process")

    def _find_files(self, config: zenoh.Config) -> None:
        """Certificates and keys are looked for beside the file."""
        for name in FILES:
            said = _read(config, f"{SECRETS}/{name}")
            if said is None:
                continue
            path = self.path.resolve().parent / said
            if not path.is_file():
                raise InputError(self.path, _dotted(f"{SECRETS}/{name}"), said, "a file that is there")
            config.insert_json5(f"{SECRETS}/{name}", json.dumps(str(path)))

    def _check_closed(self, config: zenoh.Config) -> None:
        """Whatever leaves this machine must be mutual TLS."""
        tls = _read(config, SECRETS)
        for key in ("listen/endpoints", "connect/endpoints"):
            for text in _texts(_read(config, key)):
                if not _is_closed(text, tls):
                    raise InputError(
                        self.path,
                        _dotted(key),
                        text,
                        "an endpoint of this machine, or tls with transport.link.tls.enable_mtls and "
                        "root_ca_certificate (--insecure-bus opens the bus all the same)",
                    )
        for key in ("scouting/multicast/enabled", "scouting/gossip/enabled"):
            protocols = _read(config, "transport/link/protocols") or ["any"]
            if _read(config, key) and not (set(protocols) <= set(ENCRYPTED) and _is_mutual(tls)):
                raise InputError(
                    self.path,
                    _dotted(key),
                    True,
                    'false, or transport.link.protocols = ["tls"] with enable_mtls (--insecure-bus allows it)',
                )


@dataclass(frozen=True)
class BusFolder:
    """Bus files of all roles, `<role>.json5`, as tls-init makes them."""

    path: Path
    insecure: bool = False

    def file(self, role: Role) -> BusFile:
        """The file of one role; DasError where it is missing."""
        file = self.path / f"{role}.json5"
        if not file.is_file():
            raise DasError(f"{file}: not there; expected a folder as das-node tls-init makes it")
        return BusFile(file, self.insecure)


def bus_folder(path: Path | None, insecure: bool, train: str) -> BusFolder | None:
    """The folder a simulation was told, the files it needs read once; DasError where one cannot be used."""
    if path is None:
        _refuse_lone_insecure(insecure)
        return None
    folder = BusFolder(path, insecure)
    for role in (Role.SIMULATOR, Role.NODE, Role.RECORDER):
        folder.file(role).config(train)
    return folder


def bus_options(file: Path | None, insecure: bool, listen: str | None, connect: Sequence[str] | None) -> BusFile | None:
    """What a process was told about its bus; DasError where the options contradict each other."""
    if file is None:
        _refuse_lone_insecure(insecure)
        return None
    if listen or connect:
        raise DasError(f"--{'listen' if listen else 'connect'}: with --bus the file says so ({file})")
    return BusFile(file, insecure)


def locked_down(listen: str | None, connect: Sequence[str]) -> zenoh.Config:
    """The configuration of a bus that stays on this machine; the endpoints are checked before."""
    config = zenoh.Config()
    own = {"listen/endpoints": [listen] if listen else [], "connect/endpoints": list(connect)}
    for key, value in {**UNLESS_SAID, **ALWAYS, **own}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _refuse_lone_insecure(insecure: bool) -> None:
    if insecure:
        raise DasError("--insecure-bus: expected with --bus; without it the bus stays on this machine")


def one_line(error: Exception) -> str:
    """What Zenoh says, shortened to what is of use."""
    said = " ".join(SOURCE_PLACE.sub("", str(error)).split())
    if drawn := SYNTAX_ERROR.match(said):
        return "line {}, column {}: {}".format(*drawn.groups())
    return said[:MOST_SAID]


def _read(config: zenoh.Config, key: str) -> Any:
    return json.loads(config.get_json(key))


def _dotted(key: str) -> str:
    return key.replace("/", ".")


def _depth(text: str) -> int:
    """How deep brackets are nested, those in texts and comments counted with the others."""
    steps = ((letter in "[{") - (letter in "]}") for letter in text)
    return max(accumulate(steps), default=0)


def _texts(value: Any) -> Iterator[str]:
    """All texts in nested lists and objects: endpoints may depend on the mode, or have a strategy."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | dict):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _texts(inner)


def _is_closed(text: str, tls: dict[str, Any]) -> bool:
    """Whether an endpoint (`protocol/address?metadata#key=value;…`) stays here or is mutual TLS."""
    protocol, _, rest = text.partition("/")
    address, _, settings = rest.partition("#")
    if protocol in OF_THIS_MACHINE or _is_loopback(address.partition("?")[0]):
        return True
    own = dict(pair.partition("=")[::2] for pair in settings.split(";"))
    return protocol in ENCRYPTED and "enable_mtls" not in own and _is_mutual(tls)


def _is_mutual(tls: dict[str, Any]) -> bool:
    return bool(tls["enable_mtls"]) and tls["root_ca_certificate"] is not None


def _is_loopback(address: str) -> bool:
    host = address.rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
