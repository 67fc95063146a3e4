"""Figures of tables: a departure looked up against one solved again, and the throughput of a build."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from itertools import cycle, pairwise
from pathlib import Path

from das.advice.guide.planning import Wanted, departing, planned
from das.command_line.process import available_cores
from das.domain.files.load import load_vehicle
from das.domain.units import MEGABYTE
from das.solver.guide.policies import DEFAULT, GuideFront
from das.solver.section import Section
from das.table.table import Table
from precompute.bench.figures import VEHICLE, Reference
from precompute.bench.measuring import Figure, Times, in_turns
from precompute.tables.build import solve_jobs
from precompute.tables.synthetic import synthetic_routes
from precompute.tables.writing import Job, TableSettings, make_table
from precompute.workers import Workers

SEED = 1
BUFFERS = (0.03, 0.05, 0.08, 0.12)
"""Buffers of the departures that are looked up, as shares of the least time."""
NOT_REFINED = TableSettings(buffers_percent=(0.0,), refine_s=0.0, proven=0)
"""The least front of a table; the cab does not need it."""


def departures(section: Section) -> Iterator[Wanted]:
    """What is looked up, again and again: departures with each of the `BUFFERS`."""
    least_s = float(section.fastest_run.time_to_go_s[0])
    for buffer in cycle(BUFFERS):
        yield Wanted(s_m=section.start_m, v_mps=section.start_speed_mps, left_s=least_s * (1.0 + buffer))


def look_up(reference: Reference) -> Iterator[Figure]:
    """A departure's reference looked up in a table, with the table known and just opened, against solving it again."""
    section, threads, wanted = reference.section, reference.threads, departures(reference.section)

    def solved() -> None:
        planned(GuideFront(section, threads=threads), next(wanted))

    with tempfile.TemporaryDirectory(prefix="das-bench-") as folder:
        path = Path(folder) / "table.json"
        path.write_bytes(make_table(section, NOT_REFINED, threads=threads))
        size_mb = path.stat().st_size / MEGABYTE

        def opened() -> GuideFront:
            references = Table.read(path).references_for(section, DEFAULT)
            return GuideFront(section, threads=threads, references=references)

        front, rounds, baseline = opened(), reference.effort.rounds, "policies and reference solved again"
        known = in_turns(lambda: departing(front, next(wanted)), solved, rounds=rounds)
        cold = in_turns(lambda: departing(opened(), next(wanted)), solved, rounds=rounds)
    yield known.figure("look-up", f"a departure's reference from a table, {section.name}", "ms", baseline)
    yield cold.figure("cold-start", f"the same with its table, {size_mb:.2f} MB, read and checked", "ms", baseline)


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
    return [
        Job(
            route=route,
            vehicle=vehicle,
            level=vehicle.default_level,
            start_m=start.position_m,
            end_m=end.position_m,
            braking=None,
            settings=NOT_REFINED,
        )
        for route in synthetic_routes(sections, SEED)
        for start, end in pairwise(route.stops)
    ]


def _build_s(jobs: list[Job], workers: int) -> float:
    """Seconds from the first table to the last: the start of the workers, once per build, is not counted."""
    with tempfile.TemporaryDirectory(prefix="das-bench-") as folder:
        finished = [time.perf_counter() for _ in solve_jobs(jobs, Path(folder), Workers(count=workers))]
    return (finished[-1] - finished[0]) * len(jobs) / max(len(jobs) - 1, 1)
