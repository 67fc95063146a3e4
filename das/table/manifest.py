"""What a manifest must say: every key is checked before anything that depends on it is read."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from das.solver.solution import Fit
from das.table.format import ARRAYS, MANIFEST, SCHEMA_VERSION, Sizes, TableError, read_regular, seal_of

MOST_MANIFEST_BYTES: Final = 8_000_000
"""Largest manifest that is read; one of 1000 trajectories has 0.4 MB."""
MOST_BYTES: Final = 2_000_000_000
"""Largest table that is read; one of a section of 300 km has some 0.3 GB."""
MOST_NODES, MOST_SPEEDS, MOST_MULTIPLIERS, MOST_POINTS, MOST_RUNS = 200_000, 5_000, 2_000, 5_000_000, 5_000
LARGEST_NUMBER: Final = 1e300
MOST_SHOWN = 60
"""Characters of a wrong value that a message repeats."""
HASHED = ("line", "train", "losses", "ends", "braking", "solver")
"""Parts of what determines a table whose hashes every manifest has."""

_MISSING: Final = object()
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
_TEXT: Test = ("a text", _is_text)
_HASH: Test = ("a SHA-256", _is_hash)
_NUMBER_OR_NULL: Test = ("a finite number or null", lambda x: x is None or _is_number(x))
_TEXT_OR_NULL: Test = ("a text or null", lambda x: x is None or _is_text(x))
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
        raise TableError(f"{path}: schema_version = {_shown(version)}: expected {SCHEMA_VERSION}")
    if seal_of(content) != manifest.get("manifest_sha256"):
        raise TableError(f"{path}: was altered since it was written")
    _Facts(path, "", manifest).check()
    return dict(manifest)


def sizes_of(manifest: Mapping[str, Any]) -> Sizes:
    """The lengths of the axes of all arrays, as a checked manifest says."""
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


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"


class _Facts:
    """An object in the manifest, with the place where it stands."""

    def __init__(self, path: Path, place: str, facts: Mapping[str, Any]) -> None:
        self._path, self._place, self._facts = path, place, facts

    def check(self) -> None:
        """Check the whole manifest."""
        self._check_keys(_TOP)
        self._inner("section")._check_keys(_SECTION)
        self._inner("inputs_sha256")._check_keys(dict.fromkeys(HASHED, _HASH))
        self._inner("grid")._check_keys(_GRID)
        self._check_multipliers()
        runs = self._facts["trajectories"]
        if len(runs) > MOST_RUNS:
            raise self._error("trajectories", f"{len(runs)} of them", f"at most {MOST_RUNS}")
        for i, run in enumerate(runs):
            if not isinstance(run, dict):
                raise self._error(f"trajectories[{i}]", run, "an object")
            _Facts(self._path, f"trajectories[{i}].", run)._check_keys(_RUN)
        self._check_arrays(sizes_of(self._facts))

    def _check_keys(self, tests: Mapping[str, Test]) -> None:
        for key, (expected, is_right) in tests.items():
            value = self._facts.get(key, _MISSING)
            if value is _MISSING or not is_right(value):
                raise self._error(key, value, expected)

    def _check_multipliers(self) -> None:
        values = self._facts["lambda_w"]
        if len(values) > MOST_MULTIPLIERS:
            raise self._error("lambda_w", f"{len(values)} of them", f"at most {MOST_MULTIPLIERS}")
        for i, value in enumerate(values):
            if not _is_number(value) or value < 0 or (i > 0 and value <= values[i - 1]):
                raise self._error(f"lambda_w[{i}]", value, "a finite number >= 0 above the one before it")

    def _check_arrays(self, sizes: Sizes) -> None:
        total = sum(array.size_bytes(sizes) for array in ARRAYS.values())
        if total > MOST_BYTES:
            raise self._error("grid", f"arrays of {total / 1e9:.1f} GB", f"at most {MOST_BYTES / 1e9:g} GB")
        arrays = self._inner("arrays")
        for name, array in ARRAYS.items():
            if not isinstance(arrays._facts.get(name), dict):
                raise arrays._error(name, arrays._facts.get(name, _MISSING), "an object")
            wanted: dict[str, object] = {
                "dtype": array.kind,
                "shape": list(array.shape(sizes)),
                "size_bytes": array.size_bytes(sizes),
            }
            facts = arrays._inner(name)
            facts._check_keys({"sha256": _HASH, **{key: _exactly(value) for key, value in wanted.items()}})

    def _inner(self, key: str) -> _Facts:
        return _Facts(self._path, f"{self._place}{key}.", self._facts[key])

    def _error(self, key: str, value: object, expected: str) -> TableError:
        found = " is missing" if value is _MISSING else f" = {_shown(value)}"
        return TableError(f"{self._path}: {self._place}{key}{found}: expected {expected}")


def _exactly(wanted: object) -> Test:
    return f"{wanted!r}", lambda value: type(value) is type(wanted) and value == wanted
