"""Reading a table: every key of its manifest and every byte of its files are checked before anything uses them.

A table answers only for the section that it was made for.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.compiling import SourcesMissingError
from das.domain.errors import MISSING, InputError
from das.domain.files.reading import Fields
from das.domain.trajectory import Trajectory
from das.solver.front import Front
from das.solver.section import Section
from das.solver.solution import Fit, trajectory_on
from das.table.format import (
    ARRAYS,
    MANIFEST,
    SCHEMA_VERSION,
    ArrayFormat,
    Arrays,
    Sizes,
    TableError,
    grid_of,
    read_regular,
    regular_size_bytes,
    seal_of,
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

READERS = 2
"""Files of a table that are read at the same time."""
GRID_TOLERANCE = 1e-6
"""Positions (m) and speeds (m/s) of the grid rebuilt from route and train may differ by this much from the table's."""
MOST_MANIFEST_BYTES: Final = 8_000_000
"""Largest manifest that is read (bytes); that of 1000 trajectories has 0.4 MB."""
MOST_BYTES: Final = 2_000_000_000
"""Largest table that is read (bytes); that of a section of 300 km has some 0.3 GB."""
MOST_NODES, MOST_SPEEDS, MOST_MULTIPLIERS, MOST_POINTS, MOST_RUNS = 200_000, 5_000, 2_000, 5_000_000, 5_000
LARGEST_NUMBER: Final = 1e300
HASHED = ("line", "train", "losses", "ends", "braking", "solver")
"""The parts of a table's inputs whose hashes every manifest has."""

Test = tuple[str, Callable[[Any], bool]]


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and -LARGEST_NUMBER < value < LARGEST_NUMBER


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_hash(value: Any) -> bool:
    return isinstance(value, str) and len(value) == 64 and set(value) <= set("0123456789abcdef")


def _whole(least: int, most: int) -> Test:
    return f"a whole number from {least} to {most}", lambda x: type(x) is int and least <= x <= most


_NUMBER: Test = ("a finite number", _is_number)
_POSITIVE: Test = ("a finite number > 0", lambda x: _is_number(x) and x > 0)
_TEXT: Test = ("a string", _is_text)
_HASH: Test = ("a SHA-256", _is_hash)
_NUMBER_OR_NULL: Test = ("a finite number or null", lambda x: x is None or _is_number(x))
_TEXT_OR_NULL: Test = ("a string or null", lambda x: x is None or _is_text(x))
_OBJECT: Test = ("an object", lambda x: isinstance(x, dict))
_LIST: Test = ("a list that is not empty", lambda x: isinstance(x, list) and len(x) > 0)

_SECTION: Mapping[str, Test] = {
    **dict.fromkeys(("route", "train", "level"), _TEXT),
    **dict.fromkeys(("from", "to"), _TEXT_OR_NULL),
    **dict.fromkeys(("start_m", "end_m", "start_speed_mps", "end_speed_mps", "length_m"), _NUMBER),
    "mass_kg": _POSITIVE,
}
_RUN: Mapping[str, Test] = {
    "buffer_percent": _NUMBER_OR_NULL,
    "time_s": _POSITIVE,
    "fit": ("one of " + ", ".join(Fit), lambda x: x in list(Fit)),
    "feasible": ("true or false", lambda x: isinstance(x, bool)),
    **dict.fromkeys(("energy_input_j", "energy_irreversible_j", "refinement_saved_j"), _NUMBER),
    **dict.fromkeys(("lambda_w", "table_bound_j", "table_gap_ratio", "bound_j", "gap_ratio"), _NUMBER_OR_NULL),
    "gap_reason": _TEXT,
}
_GRID: Mapping[str, Test] = {
    "decision_nodes": _whole(2, MOST_NODES),
    "speeds": _whole(2, MOST_SPEEDS),
    "integration_nodes": _whole(2, MOST_POINTS),
}
_TOP: Mapping[str, Test] = {
    **dict.fromkeys(("section", "inputs_sha256", "grid", "arrays"), _OBJECT),
    **dict.fromkeys(("lambda_w", "trajectories"), _LIST),
    "table_sha256": _HASH,
    "refine": _TEXT,
    "least_time_s": _POSITIVE,
}


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a table, checked; TableError names the file, the key, the value and what was expected."""
    path = folder / MANIFEST
    try:
        content = read_regular(path, MOST_MANIFEST_BYTES)
    except FileNotFoundError:
        raise TableError(f"{folder}: not a table (no {MANIFEST})") from None
    try:
        manifest = json.loads(content, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise TableError(f"{path}: not valid JSON ({error})") from error
    version = manifest.get("schema_version") if isinstance(manifest, dict) else None
    if type(version) is not int or version != SCHEMA_VERSION:
        raise TableError(str(InputError(path, "schema_version", version, f"{SCHEMA_VERSION}")))
    if seal_of(content) != manifest.get("manifest_sha256"):
        raise TableError(f"{path}: was altered since it was written")
    try:
        _check_manifest(Fields(path, "", manifest))
    except InputError as error:
        raise TableError(str(error)) from None
    return dict(manifest)


def sizes_of(manifest: Mapping[str, Any]) -> Sizes:
    """The lengths of the axes of all arrays, from a checked manifest."""
    grid = manifest["grid"]
    return Sizes(
        nodes=grid["decision_nodes"],
        speeds=grid["speeds"],
        points=grid["integration_nodes"],
        multipliers=len(manifest["lambda_w"]),
        runs=len(manifest["trajectories"]),
    )


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is not a number of JSON")


def _check_manifest(manifest: Fields) -> None:
    """Raise InputError for the first value of a manifest that is not allowed."""
    _check_values(manifest, _TOP)
    _check_values(manifest.table("section"), _SECTION)
    _check_values(manifest.table("inputs_sha256"), dict.fromkeys(HASHED, _HASH))
    _check_values(manifest.table("grid"), _GRID)
    _check_multipliers(manifest)
    runs = manifest.data["trajectories"]
    if len(runs) > MOST_RUNS:
        raise manifest.error("trajectories", f"{len(runs)} of them", f"at most {MOST_RUNS}")
    for i, run in enumerate(runs):
        if not isinstance(run, dict):
            raise manifest.error(f"trajectories[{i}]", run, "an object")
        _check_values(Fields(manifest.source, f"trajectories[{i}].", run), _RUN)
    _check_arrays(manifest, sizes_of(manifest.data))


def _check_values(fields: Fields, tests: Mapping[str, Test]) -> None:
    for key, (expected, is_right) in tests.items():
        value = fields.data.get(key, MISSING)
        if value is MISSING or not is_right(value):
            raise fields.error(key, value, expected)


def _check_multipliers(manifest: Fields) -> None:
    values = manifest.data["lambda_w"]
    if len(values) > MOST_MULTIPLIERS:
        raise manifest.error("lambda_w", f"{len(values)} of them", f"at most {MOST_MULTIPLIERS}")
    for i, value in enumerate(values):
        if not _is_number(value) or value < 0 or (i > 0 and value <= values[i - 1]):
            raise manifest.error(f"lambda_w[{i}]", value, "a finite number >= 0 above the one before it")


def _check_arrays(manifest: Fields, sizes: Sizes) -> None:
    total = sum(array.size_bytes(sizes) for array in ARRAYS.values())
    if total > MOST_BYTES:
        raise manifest.error("grid", f"arrays of {total / 1e9:.1f} GB", f"at most {MOST_BYTES / 1e9:g} GB")
    arrays = manifest.table("arrays")
    for name, array in ARRAYS.items():
        wanted: dict[str, object] = {
            "dtype": array.kind,
            "shape": list(array.shape(sizes)),
            "size_bytes": array.size_bytes(sizes),
        }
        _check_values(arrays, {name: _OBJECT})
        exact = {key: _exactly(value) for key, value in wanted.items()}
        _check_values(arrays.table(name), {"sha256": _HASH, **exact})


def _exactly(wanted: object) -> Test:
    return f"{wanted!r}", lambda value: type(value) is type(wanted) and value == wanted


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A table on disk: its folder and its checked manifest (docs/reference/tables.md).

    Its arrays are read when they are needed, whole and checked against their hashes. They are not mapped into memory:
    a file that is changed or cut afterwards does not change an answer.
    """

    folder: Path
    manifest: Mapping[str, Any]

    @classmethod
    def open(cls, folder: Path) -> Table:
        """Open a table: check the manifest and the sizes of all files; takes a millisecond.

        Raises TableError, which says what is wrong. The contents of the arrays are checked when they are read.
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
        """Check that this very code made the table, and check every byte of it; raises TableError."""
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
        """The front of a section from its table; TableError if the table is damaged or of another section."""
        self.check_matches(section)
        arrays = self.arrays()
        rebuilt = grid_of(section)
        if arrays["grid"].shape != rebuilt.shape or not np.allclose(
            arrays["grid"], rebuilt, rtol=0.0, atol=GRID_TOLERANCE
        ):
            raise TableError(f"{self.folder}: solved on another grid than this solver makes of {section.name}")
        return unpacked(section, np.array(self.manifest["lambda_w"]), arrays)

    def check_matches(self, section: Section) -> None:
        """Raise TableError, which names the differences, if this is not the table of a section."""
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
        """The stored trajectory of a buffer (%; None: the least energy), refined if the table is.

        Times and forces are computed from the speeds, which are stored in full. Raises TableError for an unknown
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
    """Why a table does not belong to a section (`differing`: see `das.table.hashes.differing_parts`)."""
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
