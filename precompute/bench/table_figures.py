"""Figures of tables: look-up, open and verify, and the throughput of a build."""

from __future__ import annotations

import hashlib
import tempfile
import time
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from das.domain.files.load import load_vehicle
from das.solver.kernels.landings import LANDINGS
from das.solver.section import Section
from das.table import table as tables
from das.table.table import SectionTable, Table, TableSettings, make_table, write_table
from precompute.bench.figures import DIVISIONS_PER_LANDING_TRIED, MEGA, POLISHED_LANDINGS, VEHICLE, Reference
from precompute.bench.measuring import Figure, Times, available_cores, in_turns, seconds_of
from precompute.bench.synthetic import synthetic_routes
from precompute.tables.job import Job
from precompute.tables.pool import solve_locally

POLICIES_TRIED = 6
"""First steps that a look-up tries, about: two neighbours of the ladder and what narrows between them."""
ROLLED_EVERY = 10
"""One look-up in so many is repeated as a roll-out, the baseline."""
SEED = 1
PER_BYTES = 100e6


def look_up(reference: Reference) -> list[Figure]:
    """Advice looked up in a memory-mapped table from many states, against rolling it out from the front."""
    section = reference.section
    with tempfile.TemporaryDirectory(prefix="das-bench-") as folder:
        table = _written(section, Path(folder) / "table").bind(section)
        tables.warm_up()
        states = _states(section, table, reference.effort.look_ups)
        own = [seconds_of(partial(table.look_up, *state)) for state in states]
        rolled = [
            seconds_of(partial(reference.front.trajectory, left_s, s_m, v_mps))
            for s_m, v_mps, left_s in states[::ROLLED_EVERY]
        ]
    tried = POLICIES_TRIED * (LANDINGS + POLISHED_LANDINGS)
    least_s = reference.one_thread.least_s(divisions=tried * DIVISIONS_PER_LANDING_TRIED)
    what = f"advice looked up in a memory-mapped table, {len(states)} states"
    slow, slow_rolled = (float(np.percentile(seconds, 99)) for seconds in (own, rolled))
    typical = Times(seconds=own, baseline_seconds=rolled)
    rare = Times(seconds=[slow], baseline_seconds=[slow_rolled])
    bound = "the divisions of the landings it tries"
    return [
        typical.figure("look-up", what, "the whole run rolled out", bound, least_s, unit="ms"),
        rare.figure("look-up-p99", f"{what}, 99 of 100", "the same of the roll-outs", bound, least_s, unit="ms"),
    ]


def _written(section: Section, folder: Path) -> Table:
    write_table(folder, make_table(section, TableSettings()))
    return Table.open(folder)


def _states(section: Section, table: SectionTable, count: int) -> list[tuple[float, float, float]]:
    """Positions, speeds and times left over the section, where a run is on its way; half a second to 30 % to spare."""
    random = np.random.default_rng(SEED)
    states = []
    for i in random.integers(1, len(section.node_m) - 2, count):
        v_mps = float(section.envelope_mps[i] * random.uniform(0.5, 0.99))
        s_m = float(section.node_m[i])
        least_s = table.front.least_time_s(s_m, v_mps)
        states.append((s_m, v_mps, 0.5 + least_s * (1 + 0.3 * random.random())))
    return states


def open_and_verify(reference: Reference) -> list[Figure]:
    """Opening a table and hashing all of it, per 100 MB, against reading its files plainly."""
    with tempfile.TemporaryDirectory(prefix="das-bench-") as name:
        folder = Path(name) / "table"
        size = _written(reference.section, folder).size_bytes
        contents = [path.read_bytes() for path in folder.iterdir()]
        times = in_turns(
            lambda: Table.open(folder).verify(),
            lambda: [path.read_bytes() for path in folder.iterdir()],
            rounds=reference.effort.rounds,
        )
        hashed_s = min(seconds_of(lambda: [hashlib.sha256(x).digest() for x in contents]) for _ in range(3))
    scale = PER_BYTES / size
    scaled = Times(
        seconds=[scale * s for s in times.seconds], baseline_seconds=[scale * s for s in times.baseline_seconds]
    )
    what = f"table opened and verified, per {PER_BYTES / MEGA:.0f} MB (this one has {size / MEGA:.1f} MB)"
    return [scaled.figure("verify", what, "its files read into memory", "its hashes", scale * hashed_s, unit="ms")]


def build(reference: Reference) -> list[Figure]:
    """Sections of a synthetic network solved into tables per second, with one worker and with all cores."""
    jobs = _jobs(reference.effort.built_sections)
    workers = min(available_cores(), reference.threads)
    alone_s, together_s = _build_s(jobs, 1), _build_s(jobs, workers)
    times = Times(seconds=[together_s], baseline_seconds=[alone_s])
    what = f"{len(jobs)} sections (synthetic, seed {SEED}) + {VEHICLE} into tables, {workers} workers"
    return [
        times.figure(
            "build", what, "one worker", "the baseline times the workers", alone_s / workers, unit="sections/s",
            amount=float(len(jobs)),
        )
    ]  # fmt: skip


def _jobs(sections: int) -> list[Job]:
    vehicle, settings = load_vehicle(VEHICLE), TableSettings()
    return [
        Job.of(
            f"{route.id}-{i}", route, vehicle, level=vehicle.default_level, start_m=start.position_m,
            end_m=end.position_m, settings=settings,
        )
        for route in synthetic_routes(sections, SEED)
        for i, (start, end) in enumerate(pairwise(route.stops))
    ]  # fmt: skip


def _build_s(jobs: list[Job], workers: int) -> float:
    """Seconds from the first table to the last: the start of the workers, once a build, is left out."""
    with tempfile.TemporaryDirectory(prefix="das-bench-") as folder:
        finished = [time.perf_counter() for _ in solve_locally(jobs, Path(folder), workers)]
    return (finished[-1] - finished[0]) * len(jobs) / max(len(jobs) - 1, 1)
