"""Computing times of the solver on the machine: `python -m docs.studies.bench`.

Each row is the median of several rounds, with minimum and maximum. Other load on the machine increases them.
"""

from __future__ import annotations

import platform
import statistics
import tempfile
import time
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.metadata import version
from itertools import cycle
from pathlib import Path
from typing import Final

from das.advice.guide.planning import Wanted, departing, planned
from das.command_line.process import available_cores
from das.domain.files.load import load_route, load_vehicle
from das.domain.units import KM
from das.solver.guide.policies import DEFAULT, GuideFront
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import solve_front
from das.solver.warm_up import warm_up
from das.table import Table
from precompute.tables.writing import TableSettings, make_table

ROUTE: Final = "zurich-luzern"
VEHICLE: Final = "re460-ic"
SECTION_KM: Final = (29.0, 57.0)
LENGTHS_KM: Final = (7.0, 14.0, 28.0, 57.0)
BUFFERS: Final = (0.03, 0.05, 0.08, 0.12)
"""Buffers of the measured runs and departures, as shares of the least time."""
HALF_WAY_RATIO: Final = 0.9
"""Share of the braking envelope's speed at which the train is when the rest of its section is solved again."""
NOT_REFINED: Final = TableSettings(buffers_percent=(0.0,), refined=False, proven=0)

Work = Callable[[], object]


def seconds(work: Work, rounds: int) -> list[float]:
    """Durations (s) of several rounds of a task, after one that is not counted."""
    work()
    found = []
    for _ in range(rounds):
        began = time.perf_counter()
        work()
        found.append(time.perf_counter() - began)
    return found


def works(section: Section, folder: Path) -> Iterator[tuple[str, Work]]:
    """The tasks measured on a section, by name; a table is written to the folder."""
    front, middle = solve_front(section), len(section.node_m) // 2
    least_s = front.fastest().time_s
    at_m, at_mps = float(section.node_m[middle]), HALF_WAY_RATIO * float(section.envelope_mps[middle])
    left_s = front.fastest(at_m, at_mps).time_s * (1.0 + BUFFERS[-1])
    times = cycle(least_s * (1.0 + buffer) for buffer in BUFFERS)
    departures = cycle(
        Wanted(s_m=section.start_m, v_mps=section.start_speed_mps, left_s=least_s * (1.0 + buffer))
        for buffer in BUFFERS
    )
    path = folder / "table.json"
    path.write_bytes(make_table(section, NOT_REFINED))

    def rest() -> Section:
        options = SectionOptions(start_speed_mps=at_mps, end_speed_mps=section.end_speed_mps)
        return build_section(section.route, section.vehicle, start_m=at_m, end_m=section.end_m, options=options)

    def opened() -> GuideFront:
        return GuideFront(section, references=Table.read(path).references_for(section, DEFAULT))

    known = opened()
    yield "front of the section", lambda: solve_front(section)
    yield "run for one time from its front", lambda: front.trajectory(next(times))
    yield "front and run from half-way", lambda: solve_front(rest()).trajectory(left_s)
    yield "reference of the guide, solved", lambda: planned(GuideFront(section), next(departures))
    yield "the same from a table, read first", lambda: departing(opened(), next(departures))
    yield "the same from a table in memory", lambda: departing(known, next(departures))


def part(first_km: float, last_km: float) -> Section:
    """A part of the bundled line for the bundled train."""
    route = load_route(ROUTE)
    end_m = min(last_km * KM, route.length_m)
    return build_section(route, load_vehicle(VEHICLE), start_m=first_km * KM, end_m=end_m)


def rows(rounds: int, lengths_km: Sequence[float] = LENGTHS_KM) -> Iterator[str]:
    """The lines of the table, in Markdown."""
    yield "| | median ms | least | most |"
    yield "|---|---:|---:|---:|"
    with tempfile.TemporaryDirectory(prefix="das-bench-") as folder:
        for name, work in works(part(*SECTION_KM), Path(folder)):
            yield row(name, seconds(work, rounds))
    for length_km in lengths_km:
        line = part(0.0, length_km)
        yield row(f"front of {length_km:g} km", seconds(partial(solve_front, line), rounds))


def row(name: str, found: Sequence[float]) -> str:
    """One row: durations (s) in ms."""
    figures = (statistics.median(found), min(found), max(found))
    return f"| {name} | {' | '.join(f'{1e3 * value:.3g}' for value in figures)} |"


def main(args: Sequence[str] | None = None) -> None:
    """Measure, and print the machine and the table."""
    parser = ArgumentParser(prog="python -m docs.studies.bench", description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    given = parser.parse_args(args)
    warm_up()
    print(f"{platform.processor() or platform.machine()}, {available_cores()} cores, numba {version('numba')}\n")
    for line in rows(given.rounds):
        print(line, flush=True)


if __name__ == "__main__":
    main()
