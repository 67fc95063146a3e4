"""A solved section on disk and back (docs/reference/tables.md): policies, and one trajectory per buffer.

A table is a folder: manifest.json and plain .npy arrays, which are opened memory-mapped. It is refused with the reason
where it is cut, altered, of another schema, or of another section than the one it is asked for.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import mmap
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.domain.files.writing import write_folder_whole
from das.domain.trajectory import Trajectory
from das.domain.units import PERCENT
from das.solver.front import Front
from das.solver.kernels.tuples import PackedTimes
from das.solver.look_up import Continuation, LookUp
from das.solver.section import Section, build_section
from das.solver.solution import Solution, trajectory_on
from das.solver.solve import solve_front
from das.solver.tolerances import UNREACHABLE
from das.solver.warm_up import tiny_route, tiny_vehicle
from das.table.hashes import combined, section_hashes

Floats = NDArray[np.float64]

SCHEMA_VERSION = 1
MANIFEST = "manifest.json"
MULTIPLIERS = 28
"""Multipliers of a table, of the 64 a front is solved with: fewer lose energy, more take room
(docs/reference/tables.md)."""
FEWEST_MULTIPLIERS = 8
LONGEST_BUFFER_RATIO = 1.0
SHORTEST_BUFFER_RATIO = 0.0003
"""Between the multipliers of these buffers those of a table run geometrically; a few more lie beyond."""
UNBOUNDED_S = 1e9
"""A trip time no run needs: asked for, it gives the least energy."""
INFEASIBLE_STEP = np.iinfo(np.uint16).max
GRID_TOLERANCE = 1e-6
"""Positions (m) and speeds (m/s) of the grid rebuilt from route and train may differ by this from the table's."""

_ARRAYS = {
    "value_j": ("<f4", "least cost energy + λ·time to the end [decision node, speed, λ], J"),
    "time_to_go_steps": ("<u2", "time to the end [decision node, speed, λ], in steps of time_to_go_scale_s"),
    "time_to_go_scale_s": ("<f4", "[least time, time of a step; decision node; λ], s"),
    "grid": ("<f8", "[position (m), slowest speed, braking envelope (m/s); decision node]"),
    "run_s_m": ("<f8", "route position [integration node], m"),
    "run_v_mps": ("<f8", "speed [trajectory, integration node], m/s"),
    "run_t_s": ("<f4", "time [trajectory, integration node], s"),
    "run_force_el_n": ("<f4", "traction > 0, electric brake < 0 [trajectory, interval], N"),
    "run_force_friction_n": ("<f4", "friction brake <= 0 [trajectory, interval], N"),
}
"""Every array of a table: type and meaning."""

_SEAL = b',\n "manifest_sha256": "'
_KEYS = (
    *("schema_version", "section", "inputs_sha256", "table_sha256", "grid", "lambda_w", "least_time_s"),
    *("trajectories", "arrays"),
)


class TableError(DasError):
    """A table cannot be used; the message says why."""


@dataclass(frozen=True, kw_only=True)
class TableSettings:
    """What a table holds: a trajectory for each buffer (%), the least-energy run (`with_max`), so many multipliers."""

    buffers_percent: tuple[float, ...] = tuple(0.5 * i for i in range(41))
    with_max: bool = True
    multipliers: int = MULTIPLIERS


def table_key(hashes: Mapping[str, str], settings: TableSettings) -> str:
    """SHA-256 of everything that determines a table: the section's hashes, the settings and the schema."""
    return combined({
        **hashes,
        "schema": str(SCHEMA_VERSION),
        "buffers": repr(settings.buffers_percent),
        "max": repr(settings.with_max),
        "multipliers": repr(settings.multipliers),
    })  # fmt: skip


def hashes_of(section: Section) -> dict[str, str]:
    """Hashes of what determines a section (see `section_hashes`)."""
    return section_hashes(
        section.route,
        section.vehicle,
        level=section.level,
        start_m=section.start_m,
        end_m=section.end_m,
        start_speed_mps=section.start_speed_mps,
        end_speed_mps=section.end_speed_mps,
        length_m=section.train_length_m,
    )


def make_table(section: Section, settings: TableSettings | None = None, *, threads: int = 1) -> dict[str, bytes]:
    """Solve a section; the files of its table by name.

    The trajectories come from the full front, the policies from a second sweep of the multipliers a table keeps. Raises
    InfeasibleError where the section cannot be driven.
    """
    settings = settings or TableSettings()
    front = solve_front(section, threads=threads)
    least_time_s = front.fastest().time_s
    buffers: list[float | None] = [*settings.buffers_percent, *([None] if settings.with_max else [])]
    times_s = [UNBOUNDED_S if buffer is None else least_time_s * (1 + PERCENT * buffer) for buffer in buffers]
    runs = [front.trajectory(time_s) for time_s in times_s]
    policies = solve_front(section, threads=threads, lambda_w=table_ladder(front, settings.multipliers))
    arrays = {**_policy_arrays(policies), **_run_arrays(section, runs)}
    files = {f"{name}.npy": _npy(arrays[name].astype(kind, copy=False)) for name, (kind, _) in _ARRAYS.items()}
    hashes = hashes_of(section)
    manifest = {
        "schema_version": SCHEMA_VERSION,
        "units": "SI: m, s, m/s, N, J, W",
        "section": _section_facts(section),
        "inputs_sha256": hashes,
        "table_sha256": table_key(hashes, settings),
        "grid": _grid_facts(section),
        "lambda_w": policies.lambda_w.tolist(),
        "least_time_s": least_time_s,
        "trajectories": [_run_facts(buffer, run) for buffer, run in zip(buffers, runs, strict=True)],
        "arrays": {name: _array_facts(name, arrays[name], files[f"{name}.npy"]) for name in _ARRAYS},
    }
    return {**files, MANIFEST: _sealed(manifest)}


def table_ladder(front: Front, size: int) -> Floats:
    """The multipliers a table keeps of a section (W).

    0 and the smallest of the front (very slow runs), its largest, and a geometric ladder between those whose buffers on
    the whole section are `LONGEST_BUFFER_RATIO` and `SHORTEST_BUFFER_RATIO`.
    """
    lambda_w = front.lambda_w[1:]
    times_s = np.maximum.accumulate(front.ladder_times_s()[:0:-1])  # rising from the largest multiplier on
    buffers = np.maximum(times_s / times_s[0] - 1.0, 1e-9)
    ends = np.log([LONGEST_BUFFER_RATIO, SHORTEST_BUFFER_RATIO])
    low, high = (float(x) for x in np.interp(ends, np.log(buffers), np.log(lambda_w[::-1])))
    middle = np.exp(np.linspace(low, high, size - 3))
    return np.unique(np.concatenate(([0.0, lambda_w[0]], middle, [lambda_w[-1]])))


def write_table(folder: Path, files: Mapping[str, bytes]) -> None:
    """Put the files of a table into place, all or none; DasError where that fails."""
    write_folder_whole(folder, files)


def warm_up() -> None:
    """Compile (or load from cache) what answers from a mapped table; about 6 s the first time on a machine."""
    section = build_section(tiny_route(), tiny_vehicle())
    files = make_table(section, TableSettings(buffers_percent=(0.0,), multipliers=FEWEST_MULTIPLIERS))
    with tempfile.TemporaryDirectory() as folder:
        write_table(Path(folder) / "table", files)
        table = Table.open(Path(folder) / "table").bind(section)
        least_time_s = table.table.manifest["least_time_s"]
        for buffer_ratio in (0.01, 0.1, 0.3):
            table.front.trajectory(least_time_s * (1 + buffer_ratio))
            table.look_up(section.start_m, 0.0, least_time_s * (1 + buffer_ratio))


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A table opened memory-mapped: `manifest` as written, `arrays` by name (see docs/reference/tables.md)."""

    folder: Path
    manifest: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    @classmethod
    def open(cls, folder: Path) -> Table:
        """Open a table and check schema, manifest and the sizes of all files.

        Raises TableError, which says what is wrong. What the arrays hold is checked by `verify`.
        """
        manifest = _read_manifest(folder)
        facts = manifest["arrays"]
        arrays = {name: _mapped(_file(folder, name), kind, facts[name]) for name, (kind, _) in _ARRAYS.items()}
        return cls(folder=folder, manifest=manifest, arrays=arrays)

    @property
    def size_bytes(self) -> int:
        """Size of all its files."""
        return sum(path.stat().st_size for path in self.folder.iterdir())

    def verify(self) -> None:
        """Check every array against its hash; TableError names the first that was altered."""
        for name, facts in self.manifest["arrays"].items():
            path = _file(self.folder, name)
            try:
                with path.open("rb") as file:
                    found = hashlib.file_digest(file, "sha256").hexdigest()
            except OSError as error:
                raise TableError(f"{path}: cannot be read ({error.strerror})") from error
            if found != facts["sha256"]:
                raise TableError(f"{path}: was altered since it was written")

    def check_matches(self, section: Section) -> None:
        """Raise TableError with the differences where this is not the table of a section."""
        facts, wanted = self.manifest["section"], _section_facts(section)
        hashes = hashes_of(section)
        differing = [name for name, value in self.manifest["inputs_sha256"].items() if hashes.get(name) != value]
        if differing:
            named = [f"{key} {facts[key]!r}, not {wanted[key]!r}" for key in facts if facts[key] != wanted[key]]
            also = f" ({'; '.join(named)})" if named else ""
            raise TableError(f"{self.folder}: not the table of {section.name}: other {', '.join(differing)}{also}")
        grid, rebuilt = self.arrays["grid"], _grid(section)
        if grid.shape != rebuilt.shape or not np.allclose(grid, rebuilt, rtol=0.0, atol=GRID_TOLERANCE):
            raise TableError(f"{self.folder}: solved on another grid than this solver makes of {section.name}")

    def bind(self, section: Section) -> SectionTable:
        """The table together with its section; TableError where it is not the table of this section."""
        self.check_matches(section)
        return SectionTable(self, section)

    def trajectory_index(self, buffer_percent: float | None) -> int:
        """Which trajectory has this buffer (None: the least energy); TableError where the table has none."""
        have = [run["buffer_percent"] for run in self.manifest["trajectories"]]
        if buffer_percent in have:
            return have.index(buffer_percent)
        names = ", ".join("max" if buffer is None else f"{buffer:g}" for buffer in have)
        wanted = "max" if buffer_percent is None else f"{buffer_percent:g} %"
        raise TableError(f"{self.folder}: no trajectory for a buffer of {wanted}; it has {names}")


class SectionTable:
    """A table in use on its section."""

    def __init__(self, table: Table, section: Section) -> None:
        arrays = table.arrays
        self.table, self.section = table, section
        low_s, step_s = arrays["time_to_go_scale_s"]
        self.front = Front(
            section=section,
            lambda_w=np.array(table.manifest["lambda_w"]),
            value_j=arrays["value_j"],
            time_to_go_s=PackedTimes(arrays["time_to_go_steps"], low_s, step_s),
        )
        self._look_up = LookUp(self.front)

    def look_up(self, s_m: float, v_mps: float, time_left_s: float) -> Continuation:
        """The optimal continuation from a state (see `das.solver.look_up`)."""
        return self._look_up(s_m, v_mps, time_left_s)

    def trajectory_for(self, buffer_percent: float | None) -> Trajectory:
        """The trajectory of a buffer over the whole section (None: the least energy), as it was solved.

        Times and forces follow from the speeds, which are stored in full. TableError where there is no such buffer.
        """
        index = self.table.trajectory_index(buffer_percent)
        return trajectory_on(self.section, self.section, np.array(self.table.arrays["run_v_mps"][index]))


def _grid(section: Section) -> Floats:
    nodes = section.decision
    return np.stack((section.node_m[nodes], section.floor_mps[nodes], section.envelope_mps[nodes]))


def _policy_arrays(front: Front) -> dict[str, NDArray[Any]]:
    """Values as float32, times-to-go as 16 bits between the least and the greatest of each node and multiplier."""
    assert isinstance(front.time_to_go_s, np.ndarray)
    known = front.value_j < UNREACHABLE
    times = np.where(known, front.time_to_go_s, np.nan).astype(np.float64)
    empty = ~known.any(axis=1, keepdims=True)
    times = np.where(empty, 0.0, times)
    low = np.nanmin(times, axis=1).astype(np.float32)
    step = ((np.nanmax(times, axis=1) - low) / (INFEASIBLE_STEP - 1)).astype(np.float32)
    parts = np.round((times - low[:, np.newaxis]) / np.maximum(step, np.finfo(np.float32).tiny)[:, np.newaxis])
    steps = np.where(known, np.clip(parts, 0, INFEASIBLE_STEP - 1), INFEASIBLE_STEP)
    return {
        "value_j": front.value_j.astype(np.float32),
        "time_to_go_steps": steps.astype(np.uint16),
        "time_to_go_scale_s": np.stack((low, step)),
        "grid": _grid(front.section),
    }


def _run_arrays(section: Section, runs: list[Solution]) -> dict[str, NDArray[Any]]:
    paths = [run.trajectory for run in runs]
    return {
        "run_s_m": section.node_m,
        "run_v_mps": np.stack([path.v_mps for path in paths]),
        "run_t_s": np.stack([path.t_s for path in paths]),
        "run_force_el_n": np.stack([path.force_el_n for path in paths]),
        "run_force_friction_n": np.stack([path.force_friction_n for path in paths]),
    }


def _section_facts(section: Section) -> dict[str, Any]:
    """What people call the section; the hashes decide."""
    places = {round(stop.position_m, 3): stop.name for stop in section.route.stops}
    return {
        "route": section.route.id,
        "from": places.get(round(section.start_m, 3)),
        "to": places.get(round(section.end_m, 3)),
        "start_m": section.start_m,
        "end_m": section.end_m,
        "start_speed_mps": section.start_speed_mps,
        "end_speed_mps": section.end_speed_mps,
        "train": section.vehicle.id,
        "mass_kg": section.vehicle.mass_kg,
        "length_m": section.train_length_m,
        "level": str(section.level),
    }


def _grid_facts(section: Section) -> dict[str, int]:
    return {
        "decision_nodes": len(section.decision),
        "speeds": section.speed_steps + 1,
        "integration_nodes": len(section.node_m),
    }


def _array_facts(name: str, array: NDArray[Any], content: bytes) -> dict[str, Any]:
    kind, meaning = _ARRAYS[name]
    return {
        "size_bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
        "dtype": kind,
        "shape": array.shape,
        "meaning": meaning,
    }


def _run_facts(buffer_percent: float | None, run: Solution) -> dict[str, Any]:
    """A trajectory in the manifest; λ is null for the fastest run, the buffer for the least energy."""
    return {
        "buffer_percent": buffer_percent,
        "time_s": run.time_s,
        "fit": str(run.fit),
        "feasible": run.feasible,
        "energy_input_j": run.ledger.input,
        "energy_irreversible_j": run.ledger.irreversible,
        "lambda_w": _finite(run.lambda_w),
        "bound_j": _finite(run.bound_j),
        "gap_ratio": _finite(run.gap_ratio),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _npy(array: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.ascontiguousarray(array), allow_pickle=False)
    return buffer.getvalue()


def _sealed(manifest: Mapping[str, Any]) -> bytes:
    """The manifest as JSON; its last key is the hash of all bytes before it."""
    body = json.dumps(manifest, ensure_ascii=False, allow_nan=False, indent=1).encode()[: -len("\n}")]
    return body + _SEAL + hashlib.sha256(body).hexdigest().encode() + b'"\n}\n'


def _read_manifest(folder: Path) -> dict[str, Any]:
    path = folder / MANIFEST
    try:
        content = path.read_bytes()
        manifest = json.loads(content)
    except (FileNotFoundError, NotADirectoryError):
        raise TableError(f"{folder}: not a table (no {MANIFEST})") from None
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        raise TableError(f"{path}: not valid JSON ({error})") from error
    version = manifest.get("schema_version") if isinstance(manifest, dict) else None
    if version != SCHEMA_VERSION:
        raise TableError(f"{path}: schema_version = {version!r}: expected {SCHEMA_VERSION}")
    if _sealed_by(content) != manifest.get("manifest_sha256"):
        raise TableError(f"{path}: was altered since it was written")
    missing = [key for key in _KEYS if key not in manifest] or [
        name for name in _ARRAYS if name not in manifest["arrays"]
    ]
    if missing:
        raise TableError(f"{path}: {missing[0]} is missing")
    return dict(manifest)


def _sealed_by(content: bytes) -> str:
    return hashlib.sha256(content.rpartition(_SEAL)[0]).hexdigest()


def _file(folder: Path, name: str) -> Path:
    return folder / f"{name}.npy"


def _mapped(path: Path, kind: str, facts: Mapping[str, Any]) -> NDArray[Any]:
    """An array of a table, memory-mapped; TableError where its file is missing or has another size.

    `np.load(path, mmap_mode="r")` gives the same in five times the time; the header is checked by the file's hash.
    """
    try:
        with path.open("rb") as file:
            content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError:
        raise TableError(f"{path}: is missing") from None
    except (OSError, ValueError) as error:
        raise TableError(f"{path}: cannot be read ({error})") from error
    if len(content) != facts["size_bytes"]:
        raise TableError(f"{path}: {len(content)} bytes, expected {facts['size_bytes']}: was it cut?")
    shape = tuple(facts["shape"])
    offset = facts["size_bytes"] - math.prod(shape) * np.dtype(kind).itemsize
    return np.frombuffer(content, kind, offset=offset).reshape(shape)
