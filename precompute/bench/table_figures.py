"""Figures of tables: look-up, open and verify, and the throughput of a build."""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from das.cab.warm_up import warm_up_tables
from das.command_line.process import available_cores
from das.domain.files.load import load_vehicle
from das.domain.route import Route, Stop
from das.domain.units import MEGABYTE
from das.solver.front import Front
from das.solver.section import Section
from das.table.hashes import Course
from das.table.reading import Table
from precompute.bench.figures import VEHICLE, Reference
from precompute.bench.measuring import Figure, Times, in_turns, seconds_of
from precompute.tables.build import solve_jobs
from precompute.tables.look_up import LookUp
from precompute.tables.synthetic import synthetic_routes
from precompute.tables.writing import Job, TableSettings, make_table, write_table
from precompute.workers import Workers

ROLLED_EVERY = 10
"""One look-up in this many is repeated as a roll-out, which is the baseline."""
SEED = 1
PER_BYTES = 100e6
NOT_REFINED = TableSettings(refine_s=0.0, proven=0)
"""The least that a node needs from a table: its trajectories are not refined, and no gap is proven."""


def look_up(reference: Reference) -> Iterator[Figure]:
    """Advice looked up in a table from many states, against rolling it out from the front."""
    with tempfile.TemporaryDirectory(prefix="das-bench-") as folder:
        front = _written(reference.section, Path(folder) / "table").front(reference.section)
    warm_up_tables()
    answer, states = LookUp(front), _states(front, reference.effort.look_ups)
    answer(*states[0])  # compiles
    own = [seconds_of(partial(answer, *state)) for state in states]
    rolled = [
        seconds_of(partial(reference.front.trajectory, left_s, s_m, v_mps))
        for s_m, v_mps, left_s in states[::ROLLED_EVERY]
    ]
    slow, slow_rolled = (float(np.percentile(seconds, 99)) for seconds in (own, rolled))
    what = f"advice looked up in a table, {len(states)} states"
    typical, rare = Times(seconds=own, baseline_seconds=rolled), Times(seconds=[slow], baseline_seconds=[slow_rolled])
    yield typical.figure("look-up", what, "ms", "the whole run rolled out")
    yield rare.figure("look-up-p99", f"{what}, 99 of 100", "ms", "the same of the roll-outs")


def _written(section: Section, folder: Path) -> Table:
    write_table(folder, make_table(section, NOT_REFINED))
    return Table.open(folder)


def _states(front: Front, count: int) -> list[tuple[float, float, float]]:
    """Random states along the section: position, speed, and time left, up to about 30 % above the least time."""
    section, random, states = front.section, np.random.default_rng(SEED), []
    for i in random.integers(1, len(section.node_m) - 2, count):
        v_mps = float(section.envelope_mps[i] * random.uniform(0.5, 0.99))
        s_m = float(section.node_m[i])
        least_s = front.least_time_s(s_m, v_mps)
        states.append((s_m, v_mps, 0.5 + least_s * (1 + 0.3 * random.random())))
    return states


def open_and_verify(reference: Reference) -> Iterator[Figure]:
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
    yield scaled.figure(
        "verify",
        f"table opened and verified, per {PER_BYTES / MEGABYTE:.0f} MB (this one has {size / MEGABYTE:.1f} MB)",
        "ms",
        "its files read into memory",
        ("its hashes", scale * hashed_s),
    )


def build(reference: Reference) -> Iterator[Figure]:
    """Tables built per second for the sections of a synthetic network, with one worker and with all cores."""
    jobs = _jobs(reference.effort.built_sections)
    workers = min(available_cores(), reference.threads)
    alone_s, together_s = _build_s(jobs, 1), _build_s(jobs, workers)
    times = Times(seconds=[together_s], baseline_seconds=[alone_s])
    what = f"{len(jobs)} sections (synthetic, seed {SEED}) + {VEHICLE} into tables, {workers} workers"
    yield times.figure("build", what, "sections/s", "one worker", amount=float(len(jobs)))


def _jobs(sections: int) -> list[Job]:
    vehicle = load_vehicle(VEHICLE)

    def job(label: str, route: Route, start: Stop, end: Stop) -> Job:
        course = Course(level=vehicle.default_level, start_m=start.position_m, end_m=end.position_m)
        return Job.of(label, route, vehicle, course, NOT_REFINED)

    return [
        job(f"{route.id}-{i}", route, start, end)
        for route in synthetic_routes(sections, SEED)
        for i, (start, end) in enumerate(pairwise(route.stops))
    ]


def _build_s(jobs: list[Job], workers: int) -> float:
    """Seconds from the first table to the last: the start of the workers, once per build, is not counted."""
    with tempfile.TemporaryDirectory(prefix="das-bench-") as folder:
        finished = [time.perf_counter() for _ in solve_jobs(jobs, Path(folder), Workers(count=workers))]
    return (finished[-1] - finished[0]) * len(jobs) / max(len(jobs) - 1, 1)
