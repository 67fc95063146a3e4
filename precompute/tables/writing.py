"""Making a table: a section is solved, and its policies and trajectories become the files of a table."""

from __future__ import annotations

import hashlib
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.files.writing import write_folder_whole
from das.domain.units import PERCENT
from das.solver.front import Front
from das.solver.section import Section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from das.table.format import ARRAYS, MANIFEST, SCHEMA_VERSION, Arrays, packed, sealed, section_facts
from das.table.hashes import combined, hashes_of, with_code

Floats = NDArray[np.float64]

MULTIPLIERS = 28
"""Multipliers of a table, of the 64 a front is solved with: fewer lose energy, more take room
(docs/reference/tables.md)."""
FEWEST_MULTIPLIERS = 8
LONGEST_BUFFER_RATIO = 1.0
SHORTEST_BUFFER_RATIO = 0.0003
"""Between the multipliers of these buffers those of a table run geometrically; a few more lie beyond."""
UNBOUNDED_S = 1e9
"""A trip time longer than any run needs: asked for it, the solver gives the run of least energy."""


@dataclass(frozen=True, kw_only=True)
class TableSettings:
    """What a table holds.

    `buffers_percent`: a trajectory is stored for each of these, in % above the least time. `with_max`: the run of least
    energy is stored as well. `multipliers`: number of policies.
    """

    buffers_percent: tuple[float, ...] = tuple(0.5 * i for i in range(41))
    with_max: bool = True
    multipliers: int = MULTIPLIERS


def table_key(hashes: Mapping[str, str], settings: TableSettings) -> str:
    """SHA-256 of everything that determines a table: hashes of section and code, the settings and the schema."""
    return combined({
        **hashes,
        "schema": str(SCHEMA_VERSION),
        "buffers": repr(settings.buffers_percent),
        "max": repr(settings.with_max),
        "multipliers": repr(settings.multipliers),
    })  # fmt: skip


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
    arrays = {**packed(policies), **_run_arrays(section, runs)}
    files = {f"{name}.npy": _npy(arrays[name].astype(array.kind, copy=False)) for name, array in ARRAYS.items()}
    hashes = with_code(hashes_of(section))
    manifest = {
        "schema_version": SCHEMA_VERSION,
        "units": "SI: m, s, m/s, N, J, W",
        "section": section_facts(section),
        "inputs_sha256": hashes,
        "table_sha256": table_key(hashes, settings),
        "grid": _grid_facts(section),
        "lambda_w": policies.lambda_w.tolist(),
        "least_time_s": least_time_s,
        "trajectories": [_run_facts(buffer, run) for buffer, run in zip(buffers, runs, strict=True)],
        "arrays": {name: _array_facts(name, arrays[name], files[f"{name}.npy"]) for name in ARRAYS},
    }
    return {**files, MANIFEST: sealed(manifest)}


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


def _run_arrays(section: Section, runs: list[Solution]) -> Arrays:
    paths = [run.trajectory for run in runs]
    return {
        "run_s_m": section.node_m,
        "run_v_mps": np.stack([path.v_mps for path in paths]),
        "run_t_s": np.stack([path.t_s for path in paths]),
        "run_force_el_n": np.stack([path.force_el_n for path in paths]),
        "run_force_friction_n": np.stack([path.force_friction_n for path in paths]),
    }


def _grid_facts(section: Section) -> dict[str, int]:
    return {
        "decision_nodes": len(section.decision),
        "speeds": section.speed_steps + 1,
        "integration_nodes": len(section.node_m),
    }


def _array_facts(name: str, array: NDArray[Any], content: bytes) -> dict[str, Any]:
    return {
        "size_bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
        "dtype": ARRAYS[name].kind,
        "shape": array.shape,
        "meaning": ARRAYS[name].meaning,
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
        "table_bound_j": _finite(run.table_bound_j),
        "table_gap_ratio": _finite(run.table_gap_ratio),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _npy(array: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.ascontiguousarray(array), allow_pickle=False)
    return buffer.getvalue()
