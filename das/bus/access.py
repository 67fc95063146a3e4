"""Access to the bus: what each role may publish, and certificates for trials.

Peers are connected directly, so each one checks incoming messages (`ingress`), by the name in the sender's certificate,
and its own messages (`egress`). The receiver's check is decisive.

`write_bus_folder` makes a test authority, certificates and bus files for trials (not a public-key infrastructure), and
a simulation reads them as a `BusFolder`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from das.bus.config import BusFile, refuse_lone_insecure
from das.bus.topics import TOPICS
from das.domain.errors import DasError
from das.domain.files.writing import write_folder_whole


class Role(StrEnum):
    """The role of a process on the bus."""

    SIMULATOR = "simulator"
    """The whole environment: sensors, operator, and the messages of a simulation."""
    SENSORS = "sensors"
    """Localisation and train control: the position of the train, and its forces."""
    OPERATOR = "operator"
    """The ground: journey, restrictions, targets and delay."""
    NODE = "node"
    RECORDER = "recorder"
    CAB = "cab"
    """A subscriber that publishes nothing."""
    DRIVER = "driver"
    DESK = "desk"
    """A person's cab desk: a driver that also reports the actions at the desk."""


PUBLISHERS: Final = {
    Role.SIMULATOR: ("localisation", "train control", "operator", "simulator"),
    Role.SENSORS: ("localisation", "train control"),
    Role.DESK: ("desk", "driver"),
}
"""The publishers of a role in the registry of topics, unless there is only one, with the name of the role."""
SUBSCRIBING = ["declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"]
"""Zenoh's messages of a subscriber, including the queries for the last message of a latched topic."""
PUBLISHING = ["put", "reply", "declare_queryable", "liveliness_token"]
"""Zenoh's messages of a publisher, including the answers for a latched topic, but no deletions."""
LISTENERS = (Role.NODE, Role.SIMULATOR, Role.RECORDER)
"""The roles that accept connections, in the order of their ports: the node has the same port as without TLS."""
CLOCK_SLACK = timedelta(minutes=5)
"""Time before now from which certificates are valid, because the clocks of other machines may be slow."""
AUTHORITY = "ca.pem"
MOST_LETTERS = 64
"""Largest number of characters in the common name of a certificate (RFC 5280, ub-common-name-length)."""


def common_name(role: Role, train: str) -> str:
    """The name in the certificate of a role."""
    return f"{role}.{train}"


def keys_of(role: Role, train: str) -> list[str]:
    """The keys that a role may publish. The simulator stands for localisation, operator and the train itself."""
    own = [topic for topic in TOPICS if topic.publisher in PUBLISHERS.get(role, (role,))]
    # A latched topic's history has separate keys, which `**` does not match.
    return [key for t in own for key in (t.key(train), *([f"{t.key(train)}/@adv/**"] if t.latched else []))]


def access_control(own: Role, train: str) -> dict[str, Any]:
    """Zenoh's `access_control` for a process; whatever no rule allows is denied."""
    roots = sorted({topic.root for topic in TOPICS})
    readable = [f"{root}/{train}/{rest}" for root in (*roots, "*") for rest in ("*", "*/@adv/**")]
    hear = _rule("hear", ["ingress", "egress"], SUBSCRIBING, readable)
    sent = {role: _rule(f"from-{role}", ["ingress"], PUBLISHING, keys_of(role, train)) for role in Role}
    ours = _rule("own", ["egress"], PUBLISHING, keys_of(own, train))
    names = {role: [rule["id"] for rule in (hear, sent[role], ours) if rule["key_exprs"]] for role in Role}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for rule in (hear, *sent.values(), ours) if rule["key_exprs"]],
        "subjects": [{"id": role, "cert_common_names": [common_name(role, train)]} for role in Role],
        "policies": [{"id": role, "rules": names[role], "subjects": [role]} for role in Role],
    }


def _rule(name: str, flows: list[str], messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}


@dataclass(frozen=True)
class BusFolder:
    """A folder with the bus files of all roles, `<role>.json5`, as `tls-init` makes them."""

    path: Path
    insecure: bool = False

    def file(self, role: Role) -> BusFile:
        """The file of a role; raises DasError if it is missing."""
        file = self.path / f"{role}.json5"
        if not file.is_file():
            raise DasError(f"{file}: does not exist; expected a folder made by das-node tls-init")
        return BusFile(file, self.insecure)


def bus_folder(path: Path | None, insecure: bool, train: str) -> BusFolder | None:
    """The folder that a simulation uses; raises DasError if one of its files cannot be used."""
    if path is None:
        refuse_lone_insecure(insecure)
        return None
    folder = BusFolder(path, insecure)
    for role in (Role.SIMULATOR, Role.NODE, Role.RECORDER):
        folder.file(role).config(train)
    return folder


def write_bus_folder(folder: Path, train: str, ports: Mapping[Role, int], days: float) -> datetime:
    """Make an authority, certificates, keys (mode 0600) and a bus file for each role; returns the time of expiry.

    A certificate serves both sides of a connection on this machine. The key of the authority is not stored. `ports`
    are those of the roles in `LISTENERS`. Raises DasError if the folder exists or cannot be written.
    """
    if folder.exists():
        raise DasError(f"{folder}: exists already, expected a new folder (nothing is overwritten)")
    if not folder.resolve().parent.is_dir():
        raise DasError(f"{folder}: no such folder {folder.parent}")
    longest = max(map(len, (_authority_of(train), *(common_name(role, train) for role in Role))))
    if longest > MOST_LETTERS:
        most = len(train) - (longest - MOST_LETTERS)
        raise DasError(f"train name {train!r}: expected at most {most} letters, for the names in certificates")
    try:
        from trustme import CA  # no session needs it
    except ImportError:
        raise DasError("tls-init needs the package trustme: pip install '.[tls]' in the checkout") from None

    now = datetime.now(UTC).replace(microsecond=0)
    until = now + timedelta(days=days)
    authority = CA(path_length=0, organization_name="DAS", organization_unit_name=_authority_of(train))
    files, secrets = {AUTHORITY: authority.cert_pem.bytes()}, set()
    for role in Role:
        issued = authority.issue_cert(
            "localhost",
            "127.0.0.1",
            common_name=common_name(role, train),
            organization_name="DAS",
            organization_unit_name=role,
            not_before=now - CLOCK_SLACK,
            not_after=until,
        )
        files[f"{role}.pem"] = issued.cert_chain_pems[0].bytes()
        files[f"{role}.key"] = issued.private_key_pem.bytes()
        files[f"{role}.json5"] = _bus_file(role, train, ports, until).encode()
        secrets.add(f"{role}.key")
    write_folder_whole(folder, files, private=secrets)
    return until


def _bus_file(role: Role, train: str, ports: Mapping[Role, int], until: datetime) -> str:
    """The text of a role's bus file; its paths are relative to the file."""
    own, key = f"{role}.pem", f"{role}.key"
    endpoint = {one: f"tls/127.0.0.1:{ports[one]}" for one in LISTENERS}
    config = {
        "metadata": {"das": {"train": train, "role": role}},
        "listen": {"endpoints": [endpoint[role]] if role in LISTENERS else []},
        "connect": {"endpoints": [endpoint[other] for other in LISTENERS if other != role]},
        "transport": {
            "link": {
                "protocols": ["tls"],
                "tls": {
                    "root_ca_certificate": AUTHORITY,
                    "listen_certificate": own,
                    "listen_private_key": key,
                    "connect_certificate": own,
                    "connect_private_key": key,
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                    "close_link_on_expiration": True,
                },
            }
        },
        "access_control": access_control(role, train),
    }
    head = f"// For tests and trials, not a public-key infrastructure. Valid until {until:%Y-%m-%d %H:%M} UTC."
    return f"{head}\n{json.dumps(config, indent=2)}\n"


def _authority_of(train: str) -> str:
    return f"DAS test authority of {train}"
