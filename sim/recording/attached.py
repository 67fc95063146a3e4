"""The input files that a recording brings along, put where programs of today can read them."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from mcap import records

from das.bus.contents import Contents
from das.domain.errors import DasError
from das.domain.files.reading import read_toml

DEEP: Final = PurePosixPath("a/b/c/d")
"""A vehicle may name its loss map in a folder above its own: the files are put this deep, so that it stays inside."""


class AttachedFiles:
    """The attached files of a recording by what its metadata call them; each is written when it is asked for."""

    def __init__(self, contents: Contents, folder: Path) -> None:
        """`folder` is where the files are put."""
        self._run = contents.metadata.get("run", {})
        self._attached = {hashlib.sha256(one.data).hexdigest(): one for one in contents.attachments}
        self._folder = folder

    def has(self, kind: str) -> bool:
        """Whether the recording brings a file along: "route", "vehicle", "loss_map", "scenario", "true_vehicle" …"""
        return self._run.get(f"{kind}_sha256", "") in self._attached

    def sha256(self, kind: str) -> str:
        """The hash of a file as the metadata have it; nothing where they do not name it."""
        return self._run.get(f"{kind}_sha256", "")

    def others(self, but: Collection[str] = ()) -> list[records.Attachment]:
        """All attached files but those of some hashes (SHA-256), in the order of the recording."""
        return [one for hashed, one in self._attached.items() if hashed not in but]

    def place(self, kind: str) -> Path:
        """Where a file is, written now; DasError where it cannot be written."""
        one = self._attached[self.sha256(kind)]
        return put(self._folder / kind / DEEP / Path(one.name).name, one.data)

    def place_vehicle(self, kind: str = "vehicle", loss_map: str = "loss_map") -> Path:
        """Where a vehicle is, with its own loss map where its file says that it is."""
        path = self.place(kind)
        if self.has(loss_map):
            _put_beside(path, self.place(loss_map), self._folder / kind)
        return path


def put(path: Path, content: bytes) -> Path:
    """Write a file and the folders above it; DasError where it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise DasError(f"attached file {path.name!r}: cannot be written ({error})") from None
    return path


def _put_beside(vehicle: Path, loss_map: Path, root: Path) -> None:
    """Put a loss map where the vehicle's file says that it is, as long as that stays within the folder."""
    for name in _maps_of(vehicle):
        target = (vehicle.parent / name).resolve()
        if target.is_relative_to(root.resolve()):
            put(target, loss_map.read_bytes())


def _maps_of(vehicle: Path) -> Sequence[str]:
    """The loss maps that a vehicle's file names."""
    if vehicle.suffix.lower() != ".toml":
        return ()
    losses = read_toml(vehicle).data.get("losses")
    levels = losses.values() if isinstance(losses, Mapping) else ()
    paths = (level.get("path") for level in levels if isinstance(level, Mapping))
    return [path for path in paths if isinstance(path, str)]
