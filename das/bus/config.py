"""The Zenoh configuration of a bus: locked down to this machine, or a site's own file, completed and checked.

By default Zenoh listens on every interface and finds peers by multicast; here both must be configured.
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

from das.domain.errors import DasError, InputError

LEASE_MS = 2000
"""Silence (ms) after which a peer counts as gone."""
RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2}
LARGEST_BYTES = 1 << 20
"""Size (bytes) above which incoming messages are dropped; our largest message has about 100 kB."""
ALWAYS: dict[str, Any] = {
    "timestamping/enabled": True,
    "transport/shared_memory/enabled": False,  # a sender could alter a message after it was checked
    "transport/link/rx/max_message_size": LARGEST_BYTES,
}
"""Settings that replace those of every file, because the bus relies on them."""
DEFAULTS: dict[str, Any] = {
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
"""Settings that replace Zenoh's own defaults if a file does not set them."""
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
"""The place in Zenoh's source where an error arose; it is cut from messages."""
SYNTAX_ERROR = re.compile(r"--> (\d+):(\d+) .*= (expected .*)")
"""The pattern of a syntax error, which Zenoh reports as a drawing over several lines."""
LONGEST_ERROR = 200
"""Longest error message of Zenoh (characters); the rest is cut."""
DEEPEST = 64
"""Deepest nesting of brackets in a file that is accepted."""


@dataclass(frozen=True)
class BusFile:
    """A site's configuration file of the bus for one process; `insecure`: it may open the bus to the network."""

    path: Path
    insecure: bool = False

    def arguments(self) -> list[str]:
        """The command-line options that make a program of this project use the file."""
        return ["--bus", str(self.path), *(["--insecure-bus"] if self.insecure else [])]

    def config(self, train: str) -> zenoh.Config:
        """The configuration, ready for a session; DasError if it is unusable, or opens the bus without permission."""
        try:
            config = zenoh.Config.from_json5(self._text())
        except OSError as error:
            raise DasError(f"{self.path}: cannot be read ({error.strerror})") from error
        except UnicodeDecodeError as error:
            raise DasError(f"{self.path}: expected text in UTF-8") from error
        except zenoh.ZError as error:
            raise DasError(f"{self.path}: not a Zenoh configuration: {one_line(error)}") from error
        self._check_train(config, train)
        default = zenoh.Config()
        for key, value in DEFAULTS.items():
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
        # Zenoh's parser would end the process; brackets in texts and comments count as well.
        steps = ((letter in "[{") - (letter in "]}") for letter in text)
        if max(accumulate(steps), default=0) > DEEPEST:
            raise DasError(f"{self.path}: not a Zenoh configuration: brackets are nested more than {DEEPEST} deep")
        return text

    def _check_train(self, config: zenoh.Config, train: str) -> None:
        """Check that a file made by `tls-init` is for this train: with another's file, Zenoh would fail silently."""
        metadata = _read(config, "metadata")
        ours = metadata.get("das") if isinstance(metadata, dict) else None
        its = ours.get("train") if isinstance(ours, dict) else None
        if its is not None and its != train:
            raise InputError(self.path, "metadata.das.train", its, f"{train!r}, the train of this process")

    def _find_files(self, config: zenoh.Config) -> None:
        """Make the paths of certificates and keys, which are relative to the file, absolute."""
        for name in FILES:
            named = _read(config, f"{SECRETS}/{name}")
            if named is None:
                continue
            path = self.path.resolve().parent / named
            if not path.is_file():
                raise InputError(self.path, _dotted(f"{SECRETS}/{name}"), named, "an existing file")
            config.insert_json5(f"{SECRETS}/{name}", json.dumps(str(path)))

    def _check_closed(self, config: zenoh.Config) -> None:
        """Refuse every connection that leaves this machine without mutual TLS."""
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


def bus_options(file: Path | None, insecure: bool, listen: str | None, connect: Sequence[str] | None) -> BusFile | None:
    """The bus file from the options of a process; raises DasError if the options contradict each other."""
    if file is None:
        refuse_lone_insecure(insecure)
        return None
    if listen is not None or connect:
        option = "--connect" if listen is None else "--listen"
        raise DasError(f"{option}: not together with --bus, whose file states the endpoints ({file})")
    return BusFile(file, insecure)


def locked_down(listen: str | None, connect: Sequence[str]) -> zenoh.Config:
    """The configuration of a bus that stays on this machine; the caller has checked the endpoints."""
    config = zenoh.Config()
    own = {"listen/endpoints": [listen] if listen else [], "connect/endpoints": list(connect)}
    for key, value in {**DEFAULTS, **ALWAYS, **own}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def refuse_lone_insecure(insecure: bool) -> None:
    """Raise DasError for --insecure-bus without --bus."""
    if insecure:
        raise DasError("--insecure-bus: needs --bus; without --bus, the bus stays on this machine")


def one_line(error: Exception) -> str:
    """The useful part of a Zenoh error, in one line."""
    text = " ".join(SOURCE_PLACE.sub("", str(error)).split())
    if drawn := SYNTAX_ERROR.match(text):
        return "line {}, column {}: {}".format(*drawn.groups())
    return text[:LONGEST_ERROR]


def _read(config: zenoh.Config, key: str) -> Any:
    return json.loads(config.get_json(key))


def _dotted(key: str) -> str:
    return key.replace("/", ".")


def _texts(value: Any) -> Iterator[str]:
    """All strings in nested lists and objects; Zenoh lets endpoints be nested, by mode or with a strategy."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | dict):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _texts(inner)


def _is_closed(text: str, tls: dict[str, Any]) -> bool:
    """Whether an endpoint (`protocol/address?metadata#key=value;…`) is on this machine or uses mutual TLS."""
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
