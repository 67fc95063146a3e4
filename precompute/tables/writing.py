"""Making a table: a section is solved, and its policies and trajectories become the files of a table."""

from __future__ import annotations

import copyreg
import hashlib
import io
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.files.writing import write_folder_whole
from das.domain.route import Floats, Route
from das.domain.units import PERCENT
from das.domain.vehicle import Vehicle
from das.solver.front import Front
from das.solver.refinement import TABLE, refined_runs
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from das.solver.warm_up import warm_up as compile_solver
from das.table.format import ARRAYS, MANIFEST, SCHEMA_VERSION, Arrays, packed, sealed, section_facts
from das.table.hashes import REFINEMENT, Course, combined, hashes_of, refinement_code_sha256, section_hashes, with_code

MULTIPLIERS = 28
"""Number of multipliers that a table keeps, of the 64 that a front is solved with: fewer would cost energy, more would
take space (docs/reference/tables.md)."""
FEWEST_MULTIPLIERS = 8
PROVEN = 5
"""Number of a table's trajectories whose gap is proven: each takes 0.05 s, or 0.5 s with a loss map."""
LONGEST_BUFFER_RATIO = 1.0
SHORTEST_BUFFER_RATIO = 0.0003
"""A table's multipliers form a geometric series between the multipliers of these two buffers; a few more lie beyond."""
NOT_PROVEN = "not proven when the table was built"
UNBOUNDED_S = 1e9
"""A trip time longer than any run needs, for which the solver gives the run of least energy."""


@dataclass(frozen=True, kw_only=True)
class TableSettings:
    """What a table holds.

    `buffers_percent`: a trajectory is stored for each of these, in % above the least time. `with_max`: the run of least
    energy is stored as well. `multipliers`: number of policies. `refine_s`: for how many seconds the trajectories are
    refined (0: not at all, inf: to the end). `proven`: number of trajectories whose gap is proven.
    """

    buffers_percent: tuple[float, ...] = tuple(0.5 * i for i in range(41))
    with_max: bool = True
    multipliers: int = MULTIPLIERS
    refine_s: float = math.inf
    proven: int = PROVEN

    @property
    def refine(self) -> str:
        """Whether trajectories are refined, in the words of `--refine`: off, on, or the number of seconds."""
        return {0.0: "off", math.inf: "on"}.get(self.refine_s, f"{self.refine_s:g}")


def table_key(hashes: Mapping[str, str], settings: TableSettings) -> str:
    """SHA-256 of everything that determines a table: hashes of section and code, the settings and the schema."""
    return combined({
        **hashes,
        "refine": settings.refine,
        "proven": repr(settings.proven),
        "schema": str(SCHEMA_VERSION),
        "buffers": repr(settings.buffers_percent),
        "max": repr(settings.with_max),
        "multipliers": repr(settings.multipliers),
    })  # fmt: skip


def table_hashes(hashes: Mapping[str, str], settings: TableSettings) -> dict[str, str]:
    """The hashes of a section and of the code that solves it and refines its trajectories."""
    refining = {REFINEMENT: refinement_code_sha256()} if settings.refine_s > 0 else {}
    return {**with_code(hashes), **refining}


def make_table(
    section: Section,
    settings: TableSettings | None = None,
    *,
    threads: int = 1,
    stopwatch: Callable[[], float] = time.perf_counter,
) -> dict[str, bytes]:
    """Solve a section; returns the files of its table by name.

    The trajectories come from the full front and are refined. The policies come from a second sweep, with the
    multipliers that a table keeps. The `stopwatch` (s) measures the time that the settings allow for the
    refinement. Raises InfeasibleError if the section cannot be driven.
    """
    settings = settings or TableSettings()
    front = solve_front(section, threads=threads)
    least_time_s = front.fastest().time_s
    buffers: list[float | None] = [*settings.buffers_percent, *([None] if settings.with_max else [])]
    times_s = [UNBOUNDED_S if buffer is None else least_time_s * (1 + PERCENT * buffer) for buffer in buffers]
    given = [front.trajectory(time_s) for time_s in times_s]
    runs, proven = _refined(given, settings, stopwatch), _to_be_proven(given, settings.proven)
    policies = solve_front(section, threads=threads, lambda_w=table_ladder(front, settings.multipliers))
    arrays = {**packed(policies), **_run_arrays(section, runs)}
    files = {f"{name}.npy": _npy(arrays[name].astype(array.kind, copy=False)) for name, array in ARRAYS.items()}
    hashes = table_hashes(hashes_of(section), settings)
    manifest = {
        "schema_version": SCHEMA_VERSION,
        "units": "SI: m, s, m/s, N, J, W",
        "section": section_facts(section),
        "inputs_sha256": hashes,
        "table_sha256": table_key(hashes, settings),
        "grid": {
            "decision_nodes": len(section.decision),
            "speeds": section.speed_steps + 1,
            "integration_nodes": len(section.node_m),
        },
        "lambda_w": policies.lambda_w.tolist(),
        "least_time_s": least_time_s,
        "refine": settings.refine,
        "trajectories": [
            {"buffer_percent": buffer, **_run_facts(run, before), **_gap_facts(run, i in proven)}
            for i, (buffer, run, before) in enumerate(zip(buffers, runs, given, strict=True))
        ],
        "arrays": {name: _array_facts(name, arrays[name], files[f"{name}.npy"]) for name in ARRAYS},
    }
    return {**files, MANIFEST: sealed(manifest)}


def table_ladder(front: Front, size: int) -> Floats:
    """The multipliers (W) that a table keeps of a section.

    They are 0 and the front's smallest multiplier (for very slow runs), its largest, and a geometric ladder between the
    multipliers whose runs have the buffers `LONGEST_BUFFER_RATIO` and `SHORTEST_BUFFER_RATIO` on the whole section.
    """
    lambda_w = front.lambda_w[1:]
    times_s = np.maximum.accumulate(front.ladder_times_s()[:0:-1])  # rising from the largest multiplier on
    buffers = np.maximum(times_s / times_s[0] - 1.0, 1e-9)
    ends = np.log([LONGEST_BUFFER_RATIO, SHORTEST_BUFFER_RATIO])
    low, high = (float(x) for x in np.interp(ends, np.log(buffers), np.log(lambda_w[::-1])))
    middle = np.exp(np.linspace(low, high, size - 3))
    return np.unique(np.concatenate(([0.0, lambda_w[0]], middle, [lambda_w[-1]])))


def write_table(folder: Path, files: Mapping[str, bytes]) -> None:
    """Put the files of a table into place, all or none; DasError if that fails."""
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


def _array_facts(name: str, array: NDArray[Any], content: bytes) -> dict[str, Any]:
    return {
        "size_bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
        "dtype": ARRAYS[name].kind,
        "shape": array.shape,
        "meaning": ARRAYS[name].meaning,
    }


def _refined(given: list[Solution], settings: TableSettings, stopwatch: Callable[[], float]) -> list[Solution]:
    """The trajectories, refined for as long as the settings allow."""
    if settings.refine_s <= 0:
        return given
    began = stopwatch()
    return refined_runs(given, TABLE, is_over=lambda: stopwatch() - began > settings.refine_s)


def _to_be_proven(runs: list[Solution], count: int) -> set[int]:
    """Indices of the trajectories to prove: up to `count`, spread evenly over those that are on time."""
    on_time = [i for i, run in enumerate(runs) if run.fit is Fit.ON_TIME and math.isfinite(run.lambda_w)]
    places = np.linspace(0, len(on_time) - 1, min(count, len(on_time)))
    return {on_time[round(place)] for place in places.tolist()}


def _gap_facts(run: Solution, is_proven: bool) -> dict[str, Any]:
    """The proven bound of a trajectory in the manifest, or why there is none."""
    if not is_proven:
        return {"bound_j": None, "gap_ratio": None, "gap_reason": NOT_PROVEN}
    return {"bound_j": _finite(run.bound_j), "gap_ratio": _finite(run.gap_ratio), "gap_reason": run.gap_reason}


def _run_facts(run: Solution, before: Solution) -> dict[str, Any]:
    """A trajectory in the manifest; `before` is the same one unrefined. λ is null for the fastest run."""
    return {
        "time_s": run.time_s,
        "fit": str(run.fit),
        "feasible": run.feasible,
        "energy_input_j": run.balance.input,
        "energy_irreversible_j": run.balance.irreversible,
        "refinement_saved_j": before.balance.input - run.balance.input,
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


HASH_DIGITS = 8
"""Digits of the hash in a table's name."""


def _read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


# Vehicles hold their losses in read-only mappings, which pickle does not know.
copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """A section of a line for a train, with the hash of everything that determines its table."""

    label: str
    key: str
    route: Route
    vehicle: Vehicle
    course: Course
    settings: TableSettings

    @classmethod
    def of(cls, label: str, route: Route, vehicle: Vehicle, course: Course, settings: TableSettings) -> Job:
        """A job with its hash; raises DasError if the vehicle has no such level or our source is not installed."""
        hashes = table_hashes(section_hashes(route, vehicle, course), settings)
        return cls(
            label=label,
            key=table_key(hashes, settings),
            route=route,
            vehicle=vehicle,
            course=course,
            settings=settings,
        )

    @property
    def name(self) -> str:
        """Name of the table's folder: readable, and with the beginning of the hash."""
        return f"{self.label}_{self.key[:HASH_DIGITS]}"

    def solve(self) -> dict[str, bytes]:
        """The files of the table; raises DasError with the reason if the section cannot be solved."""
        warm_up()
        course = self.course
        section = build_section(
            self.route,
            self.vehicle,
            level=course.level,
            start_m=course.start_m,
            end_m=course.end_m,
            options=SectionOptions(braking=course.braking),
        )
        return make_table(section, self.settings, threads=1)


@cache
def warm_up() -> None:
    """Compile the solver, once in a process."""
    compile_solver()
