"""Data that the recorder writes in addition to messages, to detect damage and to keep the rest readable."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Final

MAGIC: Final = b"\x89MCAP0\r\n"
CHECKSUM: Final = "crc32"
"""The key of the hexadecimal checksum over the name of a metadata record and its other entries."""
CHANNELS: Final = "channel "
"""Metadata named "channel <number>" describe a channel a second time: if the chunk that describes it is lost, its later
messages can still be read."""
NUMBERED: Final = "numbered"
"""The entry of a channel's metadata that marks a file of das-record, in which all messages are numbered."""
RECORDING: Final = "recording"
"""The entry of a channel's metadata, and of each metadata record, that names the recording in which it was written.

Programs that merge files copy the entry. It is the only entry of a channel, because `mcap merge` joins channels with
equal metadata and compares several entries in no fixed order.
"""


def sealed(name: str, data: Mapping[str, str]) -> dict[str, str]:
    """The entries of a metadata record with their checksum."""
    return {**data, CHECKSUM: f"{zlib.crc32(json.dumps([name, sorted(data.items())]).encode()):08x}"}


def unsealed(name: str, data: Mapping[str, str]) -> tuple[dict[str, str], bool | None]:
    """The entries of a metadata record without the checksum, and whether that checksum is right (None: it has none)."""
    entries = {key: value for key, value in data.items() if key != CHECKSUM}
    return entries, None if CHECKSUM not in data else sealed(name, entries) == data
