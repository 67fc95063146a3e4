"""What is wrong with the bytes of a recording: where, what it is, and what was lost by it.

Metadata get a checksum of their own here, by which damage shows: MCAP gives them none until the file is finished.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

MOST_SAID = 5
"""So many places of damage are told one by one."""
CHECKSUM: Final = "crc32"
"""The key of the checksum, in hexadecimal, over the record's name and its other entries."""
UNCHECKED: Final = "unchecked "
"""Metadata that nothing proves are given under a name that begins so; no command uses them."""


@dataclass(frozen=True, kw_only=True)
class Damage:
    """A stretch of a file that is not as it was written.

    `what` says it in words. `lost` tells whether messages, attachments or metadata were in the stretch, which are left
    out. `from_ns` and `to_ns` are the times (ns since 1970) of its first and last message as far as the file says them
    (0: it does not).
    """

    start_byte: int
    end_byte: int
    what: str
    lost: bool = True
    from_ns: int = 0
    to_ns: int = 0

    def __str__(self) -> str:
        return f"{self.what} (bytes {self.start_byte} to {self.end_byte})" if self.end_byte else self.what


@dataclass(frozen=True, kw_only=True)
class Health:
    """What the reading of a file found out about it.

    `complete`: its end is there. `checked`: every byte of its data is covered by a checksum that is right, or all of
    what was handed out is. `cut_byte`: where a file that was cut off ends in the middle of a record (-1: it does not).
    `missing`: so many messages are missing by their running numbers, None where they have none. `unchecked` names what
    was written without a checksum.
    """

    size_bytes: int
    complete: bool
    damage: tuple[Damage, ...] = ()
    cut_byte: int = -1
    missing: int | None = None
    unchecked: tuple[str, ...] = ()

    @property
    def sound(self) -> bool:
        """Whether the file is whole, undamaged and without holes."""
        return self.complete and not self.damage and not self.missing

    def warnings(self) -> list[str]:
        """What a reader must know, in lines: damage, what is missing, a cut, and what has no checksum."""
        lines = [f"damaged: {one}{'; it is left out' if one.lost else ''}" for one in self.damage[:MOST_SAID]]
        if len(self.damage) > MOST_SAID:
            lines.append(f"damaged: {len(self.damage) - MOST_SAID} more places")
        if self.missing:
            lines.append(f"{self.missing} messages are missing, by their running numbers")
        if not self.complete:
            lines.append("it was cut off: it holds what was written before")
        if self.unchecked:
            lines.append(f"damage would not be seen, for there is no checksum, in: {', '.join(self.unchecked)}")
        return lines


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
