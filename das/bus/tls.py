"""A test authority, certificates and bus files for trials. Not a public-key infrastructure."""

from __future__ import annotations

import ipaddress
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

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


@dataclass(frozen=True)
class Authority:
    """A key nobody keeps: it signs the certificates made with it and is forgotten."""

    key: ec.EllipticCurvePrivateKey
    name: x509.Name
    since: datetime
    until: datetime

    @staticmethod
    def new(train: str, days: float) -> Authority:
        """An authority for one train, valid for `days`."""
        now = datetime.now(UTC).replace(microsecond=0)
        name = _name(_authority_of(train))
        return Authority(ec.generate_private_key(ec.SECP256R1()), name, now - CLOCK_SLACK, now + timedelta(days=days))

    def certificate(self) -> bytes:
        """Its own certificate (PEM)."""
        usage = _usage(signs_certificates=True)
        builder = self._builder(self.name, self.key).add_extension(x509.BasicConstraints(ca=True, path_length=0), True)
        return _pem(builder.add_extension(usage, critical=True).sign(self.key, hashes.SHA256()))

    def issue(self, common_name: str) -> tuple[bytes, bytes]:
        """Certificate and private key (PEM) for a name, for both sides of a connection on this machine."""
        key = ec.generate_private_key(ec.SECP256R1())
        hosts = [x509.DNSName("localhost"), x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]
        sides = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        builder = (
            self._builder(_name(common_name), key)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_certificates=False), critical=True)
            .add_extension(x509.SubjectAlternativeName(hosts), critical=False)
            .add_extension(x509.ExtendedKeyUsage(sides), critical=False)
        )
        secret = key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        return _pem(builder.sign(self.key, hashes.SHA256())), secret

    def _builder(self, subject: x509.Name, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        return x509.CertificateBuilder(
            issuer_name=self.name,
            subject_name=subject,
            public_key=key.public_key(),
            serial_number=x509.random_serial_number(),
            not_valid_before=self.since,
            not_valid_after=self.until,
        )


def write_bus_folder(folder: Path, train: str, ports: Mapping[Role, int], days: float) -> datetime:
    """Make authority, certificates, keys (mode 0600) and one bus file per role; returns until when they are valid.

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
    authority = Authority.new(train, days)
    files, secrets = {AUTHORITY: authority.certificate()}, set()
    for role in Role:
        files[f"{role}.pem"], files[f"{role}.key"] = authority.issue(common_name(role, train))
        files[f"{role}.json5"] = _bus_file(role, train, ports, authority.until).encode()
        secrets.add(f"{role}.key")
    write_folder_whole(folder, files, private=secrets)
    return authority.until


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


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )
