"""A test authority, certificates and bus files for trials. Not a public-key infrastructure."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path

from trustme import CA

from das.bus.acl import Role, access_control, common_name
from das.domain.errors import DasError
from das.domain.files.writing import write_folder_whole

LISTENERS = (Role.NODE, Role.SIMULATOR, Role.RECORDER)
"""In the order of their ports, so that the node has the port it has without TLS."""
CLOCK_SLACK = timedelta(minutes=5)
"""Certificates are valid from so long ago: other machines' clocks may be slow."""
AUTHORITY = "ca.pem"
MOST_LETTERS = 64
"""Of a common name (RFC 5280, ub-common-name-length)."""


def write_bus_folder(folder: Path, train: str, ports: Mapping[Role, int], days: float) -> datetime:
    """Make authority, certificates, keys (mode 0600) and one bus file per role; returns until when they are valid.

    A certificate is for both sides of a connection on this machine. The key of the authority is kept nowhere.
    `ports` are those of the roles in `LISTENERS`. DasError where the folder exists or cannot be written.
    """
    if folder.exists():
        raise DasError(f"{folder}: exists already, expected a new folder (nothing is overwritten)")
    if not folder.resolve().parent.is_dir():
        raise DasError(f"{folder}: no such folder {folder.parent}")
    longest = max(map(len, (_authority_of(train), *(common_name(role, train) for role in Role))))
    if longest > MOST_LETTERS:
        most = len(train) - (longest - MOST_LETTERS)
        raise DasError(f"train name {train!r}: expected at most {most} letters, for the names in certificates")
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
    """The configuration of a role; paths are relative to the file."""
    own, key = f"{role}.pem", f"{role}.key"
    config = {
        "metadata": {"das": {"train": train, "role": role}},
        "listen": {"endpoints": [_endpoint(ports[role])] if role in LISTENERS else []},
        "connect": {"endpoints": [_endpoint(ports[other]) for other in LISTENERS if other != role]},
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


def _endpoint(port: int) -> str:
    return f"tls/127.0.0.1:{port}"


def _authority_of(train: str) -> str:
    return f"DAS test authority of {train}"
