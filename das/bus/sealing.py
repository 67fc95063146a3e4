"""Metadata of a recording with a checksum of their own: MCAP gives them none until the file is finished."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Final

CHECKSUM: Final = "crc32"
"""The key of the checksum, in hexadecimal, over the record's name and its other entries."""
UNCHECKED: Final = "unchecked "
"""Metadata that nothing proves are given under a name that begins so; no command uses them."""


def sealed(name: str, data: Mapping[str, str]) -> dict[str, str]:
    """The entries of a metadata record, and their checksum."""
    return {**data, CHECKSUM: f"{_checksum(name, data):08x}"}


def unsealed(name: str, data: Mapping[str, str]) -> tuple[dict[str, str], bool | None]:
    """The entries without their checksum, and whether it is right (None: there is none)."""
    entries = {key: value for key, value in data.items() if key != CHECKSUM}
    if CHECKSUM not in data:
        return entries, None
    return entries, data[CHECKSUM] == f"{_checksum(name, entries):08x}"


def _checksum(name: str, data: Mapping[str, str]) -> int:
    return zlib.crc32(json.dumps([name, sorted(data.items())], ensure_ascii=True).encode())
