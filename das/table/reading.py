"""Reading a table: its files are checked in one way, and it answers for the section it was made for and no other."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.compiling.sources import SourcesMissingError
from das.domain.trajectory import Trajectory
from das.solver.front import Front
from das.solver.section import Section
from das.solver.solution import trajectory_on
from das.table.format import (
    ARRAYS,
    ArrayFormat,
    Arrays,
    Sizes,
    TableError,
    grid_of,
    read_regular,
    regular_size_bytes,
    section_facts,
    unpacked,
)
from das.table.hashes import (
    CODE,
    REFINEMENT,
    differing_parts,
    hashes_of,
    is_other_code,
    refinement_code_sha256,
    solver_code_sha256,
    with_code,
)
from das.table.manifest import read_manifest, sizes_of

READERS = 2
"""So many files of a table are read at once."""
GRID_TOLERANCE = 1e-6
"""Positions (m) and speeds (m/s) of the grid rebuilt from route and train may differ by this from the table's."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A table on disk: its folder and its checked manifest (docs/reference/tables.md).

    Its arrays are read when they are needed, whole and checked against their hashes. They are not mapped: what somebody
    writes into a file, or cuts off it, later on cannot reach an answer.
    """

    folder: Path
    manifest: Mapping[str, Any]

    @classmethod
    def open(cls, folder: Path) -> Table:
        """Open a table: check the manifest and the sizes of all files; takes a millisecond.

        Raises TableError, which says what is wrong. What the arrays hold is checked when they are read.
        """
        table = cls(folder=folder, manifest=read_manifest(folder))
        for name, array in ARRAYS.items():
            _check_size(table.path_of(name), array.size_bytes(table.sizes))
        return table

    @property
    def sizes(self) -> Sizes:
        """The lengths of the axes of its arrays."""
        return sizes_of(self.manifest)

    @property
    def size_bytes(self) -> int:
        """The size of all its files."""
        return sum(path.stat().st_size for path in self.folder.iterdir())

    def path_of(self, name: str) -> Path:
        """The file of an array."""
        return self.folder / f"{name}.npy"

    def arrays(self) -> Arrays:
        """All arrays, read into memory; TableError names the first that is cut, altered or not finite."""
        sizes = self.sizes
        # Hashing takes most of the time, and two files can be hashed at once.
        with ThreadPoolExecutor(READERS, "table") as pool:
            read = pool.map(lambda name: self._array(name, ARRAYS[name], sizes), ARRAYS)
            return dict(zip(ARRAYS, read, strict=True))

    def verify(self) -> None:
        """Check that this very code made the table, and every byte of it; raises TableError."""
        try:
            code = solver_code_sha256()
        except SourcesMissingError as error:
            raise TableError(f"{self.folder}: {_unknown_code(error)}") from None
        hashes = self.manifest["inputs_sha256"]
        if hashes.get(CODE) != code:
            raise TableError(f"{self.folder}: made by other solver code; build it again")
        if REFINEMENT in hashes and hashes[REFINEMENT] != refinement_code_sha256():
            raise TableError(f"{self.folder}: refined by other code; build it again")
        self.arrays()

    def front(self, section: Section) -> Front:
        """The front of a section from its table; TableError where it is of another section, or damaged."""
        self.check_matches(section)
        arrays = self.arrays()
        rebuilt = grid_of(section)
        if arrays["grid"].shape != rebuilt.shape or not np.allclose(
            arrays["grid"], rebuilt, rtol=0.0, atol=GRID_TOLERANCE
        ):
            raise TableError(f"{self.folder}: solved on another grid than this solver makes of {section.name}")
        return unpacked(section, np.array(self.manifest["lambda_w"]), arrays)

    def check_matches(self, section: Section) -> None:
        """Raise TableError, which names the differences, where this is not the table of a section."""
        try:
            wanted = with_code(hashes_of(section))
        except SourcesMissingError as error:
            raise TableError(f"{self.folder}: {_unknown_code(error)}") from None
        differing = differing_parts(self.manifest["inputs_sha256"], wanted)
        if differing:
            facts, names = self.manifest["section"], section_facts(section)
            named = [f"{key} {facts[key]!r}, not {names[key]!r}" for key in names if facts[key] != names[key]]
            also = f" ({'; '.join(named)})" if named else ""
            raise TableError(f"{self.folder}: {why_not(section, differing)}{also}")

    def trajectory(self, section: Section, buffer_percent: float | None) -> Trajectory:
        """The stored trajectory of a buffer (%; None: the least energy) over the section, refined where the table is.

        Times and forces follow from the speeds, which are stored in full. Raises TableError where there is no such
        buffer, and as `front` does.
        """
        index = self._trajectory_index(buffer_percent)
        self.check_matches(section)
        return trajectory_on(section, section, np.array(self.arrays()["run_v_mps"][index]))

    def _trajectory_index(self, buffer_percent: float | None) -> int:
        have = [run["buffer_percent"] for run in self.manifest["trajectories"]]
        if buffer_percent in have:
            return have.index(buffer_percent)
        names = ", ".join("max" if buffer is None else f"{buffer:g}" for buffer in have)
        wanted = "max" if buffer_percent is None else f"{buffer_percent:g} %"
        raise TableError(f"{self.folder}: no trajectory for a buffer of {wanted}; it has {names}")

    def _array(self, name: str, array: ArrayFormat, sizes: Sizes) -> NDArray[Any]:
        path, header = self.path_of(name), array.header(sizes)
        try:
            content = read_regular(path, array.size_bytes(sizes))
        except FileNotFoundError:
            raise TableError(f"{path}: is missing") from None
        if hashlib.sha256(content).hexdigest() != self.manifest["arrays"][name]["sha256"]:
            raise TableError(f"{path}: was altered since it was written")
        if len(content) != array.size_bytes(sizes) or not content.startswith(header):
            raise TableError(f"{path}: its header is not that of {array.kind} numbers {array.shape(sizes)}")
        numbers = np.frombuffer(content, array.kind, offset=len(header)).reshape(array.shape(sizes))
        if numbers.dtype.kind == "f" and not (np.isfinite(numbers.min()) and np.isfinite(numbers.max())):
            raise TableError(f"{path}: holds a number that is not finite")
        return numbers


def read_front(folder: Path, section: Section) -> Front:
    """The front of a section from its table, read whole and checked; TableError says why it cannot be used."""
    return Table.open(folder).front(section)


def why_not(section: Section, differing: Sequence[str]) -> str:
    """Why a table is not that of a section (`differing`: see das.table.hashes.differing_parts)."""
    if is_other_code(differing):
        return "made by other solver code"
    return f"not the table of {section.name}: other {', '.join(differing)}"


def _unknown_code(error: SourcesMissingError) -> str:
    return f"nobody can tell which solver code made it ({error})"


def _check_size(path: Path, expected: int) -> None:
    try:
        size = regular_size_bytes(path)
    except FileNotFoundError:
        raise TableError(f"{path}: is missing") from None
    if size != expected:
        raise TableError(f"{path}: {size} bytes, expected {expected}: was it cut?")
