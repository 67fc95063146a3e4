"""The tables of docs/results/0.2/solver: peers, the solver's table, refinement and proven bounds side by side.

`python -m docs.studies.peers` solves all rows again, which takes about ten minutes, and writes the tables. It needs the
third-party data next to the checkout (../shared).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from das.domain.errors import InfeasibleError
from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.route import Route, Stretches, Zone
from das.domain.units import KMH, kwh
from das.domain.vehicle import Vehicle
from das.offline.refinement import refined
from das.solver.front import Front
from das.solver.section import build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from docs.studies.output import DOCS, write_csv, write_table
from docs.studies.tight_bound import tightened
from tests.das.solver.test_solver import pose_reference
from tests.support.benchmark import SHARED, ReferenceResult, reference_results
from tests.support.making import make_route

PAGE = DOCS / "results" / "0.2" / "solver.md"
PEERS, HARD = (PAGE.with_suffix("") / name for name in ("peers.csv", "hard.csv"))
MAP = SHARED / "loss_maps" / "NL_Intercity_VIRM6_chain.csv"
LEVELS = (Level.L0_REG, Level.L1, Level.L2, Level.L3)
SEED = 14
TIGHT_S = 40.0
"""Largest CPU time (s) of the tight bound of a loss map."""


class PeerRow(NamedTuple):
    """One problem: the run of the table, and the refined run."""

    name: str
    given: Solution
    found: Solution

    @classmethod
    def of(cls, name: str, front: Front, time_s: float) -> PeerRow:
        """The row of a problem for a time, solved and refined."""
        given = front.trajectory(time_s)
        return cls(name, given, refined(given))

    @property
    def gap(self) -> str:
        """The cell with the gap, common to both tables."""
        return f"{100 * self.found.gap_ratio:.3f} %"


def benchmark_rows() -> Iterator[tuple[ReferenceResult, PeerRow]]:
    """Every result of other optimisers, with the solver's for the same time."""
    fronts: dict[tuple[str, ...], Front] = {}
    for result in reference_results():
        if result.problem not in fronts:
            section, *_ = pose_reference(result, MAP if result.losses == "map" else None)
            fronts[result.problem] = solve_front(section, threads=1)
        yield result, PeerRow.of(result.route, fronts[result.problem], result.time_s)


def _table(heads: str, rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """The lines of a table; the headings are separated by commas."""
    names = heads.split(", ")
    for cells in chain((names, ["---"] * len(names)), rows):
        yield f"| {' | '.join(cells)} |"


def peers_table() -> Iterator[str]:
    """The rows of the public benchmark."""
    heads = "track, train, losses, time s, peer kWh, table kWh, refined kWh, refined against peer, bound kWh, "
    return _table(heads + "gap", map(_peer_cells, benchmark_rows()))


def _peer_cells(pair: tuple[ReferenceResult, PeerRow]) -> list[str]:
    result, row = pair
    found_kwh = kwh(row.found.balance.input)
    return [
        result.route,
        result.vehicle,
        result.losses,
        f"{result.time_s:.1f}",
        f"{result.energy_kwh:.2f}",
        f"{kwh(row.given.balance.input):.2f}",
        f"{found_kwh:.2f}",
        f"{100 * (found_kwh / result.energy_kwh - 1):+.2f} %",
        f"{kwh(row.found.bound_j):.2f}",
        row.gap,
    ]


class Hard(NamedTuple):
    """A hard problem: its kind, its line and train, and the buffer (ratio of the least time)."""

    kind: str
    route: Route
    vehicle: Vehicle
    buffer_ratio: float


def hard_problems(rng: np.random.Generator) -> Iterator[Hard]:
    """Ten kinds of hard problems for the Re 460, different in each call of the generator."""
    train = load_vehicle("re460-ic")

    def drawn(length_m: float, every_m: float, steepest: float) -> Route:
        """A line with random limits of 40 to 160 km/h and gradients, which change every `every_m` metres."""
        places = np.arange(0.0, length_m - 0.5 * every_m, every_m)
        limits = [(float(at), float(rng.uniform(40.0, 160.0)) * KMH) for at in places]
        grades = [(float(at), float(rng.uniform(-steepest, steepest))) for at in places]
        return make_route(length_m, limits, grades)

    yield Hard("a limit every 100 m", drawn(6e3, 100.0, 0.0), train, 0.05)
    yield Hard("gradients of ± 35 ‰", drawn(1e4, 1e3, 0.035), train, 0.1)
    yield Hard("a section of 200 m", drawn(200.0, 200.0, 0.0), train, 0.05)
    yield Hard("a section of 1200 m", drawn(1.2e3, 600.0, 0.01), train, 0.05)
    yield Hard("25 km, buffer of 0.5 %", drawn(2.5e4, 2.5e3, 0.01), train, 0.005)
    yield Hard("25 km, buffer of 20 %", drawn(2.5e4, 2.5e3, 0.01), train, 0.2)
    for receptivity in (0.0, 0.5):
        line = replace(drawn(8e3, 1e3, 0.01), receptivity_ratio=Stretches.constant(receptivity))
        yield Hard(f"receptivity of {receptivity:.0%}", line, train, 0.05)
    gaps = tuple(Zone(start_m=at, length_m=300.0) for at in (2e3, 5e3))
    yield Hard("neutral sections", replace(drawn(8e3, 1e3, 0.01), neutral_sections=gaps), train, 0.1)
    yield Hard(
        "a freight train of 2000 t", drawn(1.5e4, 3e3, 0.004), replace(train, mass_kg=2e6, train_length_m=500.0), 0.05
    )


def hard_rows() -> Iterator[tuple[Hard, Level, PeerRow]]:
    """Every hard problem at every level, solved; problems without a solution are replaced."""
    for number, level in enumerate(LEVELS):
        rng = np.random.default_rng([SEED, number])
        wanted = [one.kind for one in hard_problems(np.random.default_rng(0))]
        while wanted:
            for one in hard_problems(rng):
                if one.kind not in wanted:
                    continue
                try:
                    front = solve_front(build_section(one.route, one.vehicle, level=level), threads=1)
                    row = PeerRow.of(one.kind, front, front.fastest().time_s * (1.0 + one.buffer_ratio))
                except InfeasibleError:
                    continue
                wanted.remove(one.kind)
                yield one, level, row


def hard_table() -> Iterator[str]:
    """The hard problems and a summary of their gaps; the tight gap is to the bound computed in `TIGHT_S`."""
    rows = list(hard_rows())
    of_maps = [row for _, level, row in rows if level is Level.L3]
    tight = {id(row): tightened(row.found, TIGHT_S).gap_ratio for row in of_maps}
    convex = [row.found.gap_ratio for _, level, row in rows if level is not Level.L3]
    yield from _table(
        "problem, buffer, level, table kWh, refined kWh, saved, gap, tight gap",
        (_hard_cells(hard, level, row, tight.get(id(row))) for hard, level, row in rows),
    )
    yield from ("", "- " + _summed("Convex losses (L0 to L2)", convex))
    yield from ("", "- " + _summed("Loss map (L3)", [row.found.gap_ratio for row in of_maps]))
    yield from ("", "- " + _summed(f"Loss map with the tight bound, {TIGHT_S:.0f} s", list(tight.values())))


def _hard_cells(hard: Hard, level: Level, row: PeerRow, tight_ratio: float | None) -> list[str]:
    given_kwh, found_kwh = kwh(row.given.balance.input), kwh(row.found.balance.input)
    return [
        hard.kind,
        f"{100 * hard.buffer_ratio:g} %",
        str(level),
        f"{given_kwh:.3f}",
        f"{found_kwh:.3f}",
        f"{100 * (given_kwh - found_kwh) / abs(given_kwh):.2f} %",
        row.gap,
        "" if tight_ratio is None else f"{100 * tight_ratio:.3f} %",
    ]


def _summed(what: str, gap_ratios: Sequence[float]) -> str:
    gaps = 100.0 * np.array(gap_ratios)
    return (
        f"{what}, {len(gaps)} problems: the gap is {np.median(gaps):.3f} % in the median, {gaps.max():.2f} % at most, "
        f"and at most 0.2 % in {(gaps <= 0.2).sum()}."
    )


def main() -> None:
    """Write both tables, and the summary of the hard problems in the page."""
    write_csv(PEERS, peers_table())
    lines = list(hard_table())
    write_csv(HARD, (line for line in lines if line.startswith("|")))
    write_table(PAGE, "hard", (line for line in lines if line and not line.startswith("|")))


if __name__ == "__main__":
    main()
