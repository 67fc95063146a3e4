"""The tables of docs/reference/results.md: peers, the solver's table, refinement and proven bounds side by side.

`python -m docs.studies.peers` solves all rows again, which takes about ten minutes, and writes the tables into the
page. It needs the third-party data beside the checkout (../shared).
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
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
from das.solver.front import Front
from das.solver.refinement import refined, warm_up_refinement
from das.solver.section import build_section
from das.solver.solution import Solution, tightened
from das.solver.solve import solve_front
from das.solver.warm_up import warm_up
from docs.studies.output import DOCS, write_table
from tests.das.solver.test_solver import pose_reference
from tests.support.benchmark import SHARED, ReferenceResult, reference_results
from tests.support.making import make_route

PAGE = DOCS / "reference" / "results.md"
MAP = SHARED / "loss_maps" / "NL_Intercity_VIRM6_chain.csv"
LEVELS = (Level.L0_REG, Level.L1, Level.L2, Level.L3)
SEED = 14
TIGHT_S = 40.0
"""CPU seconds that the tight bound of a loss map may take."""


class PeerRow(NamedTuple):
    """One problem: the run of the table, the refined run, and how long refinement and certificate took (s)."""

    name: str
    given: Solution
    found: Solution
    refine_s: float
    certify_s: float

    @classmethod
    def of(cls, name: str, front: Front, time_s: float) -> PeerRow:
        """Solve, refine and certify for a time."""
        given = front.trajectory(time_s)
        began = time.process_time()
        found = refined(given)
        refine_s, began = time.process_time() - began, time.process_time()
        found.certificate  # noqa: B018
        return cls(name, given, found, refine_s, time.process_time() - began)

    @property
    def last_cells(self) -> tuple[str, ...]:
        """The cells that both tables end with: gaps and times."""
        return (
            f"{100 * self.given.table_gap_ratio:+.2f} %",
            f"{100 * self.found.gap_ratio:.3f} %",
            f"{self.refine_s:.2f}",
            f"{self.certify_s:.2f}",
        )


class Tight(NamedTuple):
    """The gap (ratio) of a refined run to its tight bound, and how long the proof took (s)."""

    gap_ratio: float
    prove_s: float

    @classmethod
    def of(cls, row: PeerRow) -> Tight:
        """Prove the tight bound; with constant efficiencies it is the quick bound."""
        began = time.process_time()
        found = tightened(row.found, TIGHT_S)
        return cls(found.gap_ratio, time.process_time() - began)


def benchmark_rows() -> Iterator[tuple[ReferenceResult, PeerRow]]:
    """Every result of other optimisers, with our answer for the same time."""
    fronts: dict[tuple[str, ...], Front] = {}
    for result in reference_results():
        if result.problem not in fronts:
            section, *_ = pose_reference(result, MAP if result.losses == "map" else None)
            fronts[result.problem] = solve_front(section, threads=1)
        yield result, PeerRow.of(result.route, fronts[result.problem], result.time_s)


def _table(heads: str, rows: Iterable[Iterable[str]]) -> Iterator[str]:
    """The lines of a table; the heads are separated by commas."""
    names = heads.split(", ")
    for cells in chain((names, ["---"] * len(names)), rows):
        yield f"| {' | '.join(cells)} |"


def peers_table() -> Iterator[str]:
    """The rows of the public benchmark."""
    heads = "track, train, losses, time s, peer kWh, table kWh, refined kWh, refined against peer, bound kWh, "
    return _table(heads + "table gap, gap, refining CPU s, proving CPU s", map(_peer_cells, benchmark_rows()))


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
        *row.last_cells,
    ]


class Hard(NamedTuple):
    """A hard problem: its kind, its line and train, and the buffer (ratio of the least time)."""

    kind: str
    route: Route
    vehicle: Vehicle
    buffer_ratio: float


def hard_problems(rng: np.random.Generator) -> Iterator[Hard]:
    """Ten kinds of hard problems for the Re 460, drawn anew at each call."""
    train = load_vehicle("re460-ic")

    def drawn(length_m: float, every_m: float, steepest: float) -> Route:
        """A line with limits of 40 to 160 km/h and gradients, which change every `every_m` metres."""
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
    """Every hard problem at every level, with our answer; problems without any solution are drawn again."""
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
    """The hard problems, and how they are solved as a whole."""
    rows = list(hard_rows())
    tightened(rows[-1][2].found, 1e-9)  # loads the kernels, so that their loading counts for no row
    proofs = [Tight.of(row) for *_, row in rows]
    heads = "problem, buffer, level, table kWh, refined kWh, saved, table gap, gap, refining CPU s, proving CPU s"
    sums = [
        _summed("Convex losses (L0 to L2)", [row for _, level, row in rows if level is not Level.L3]),
        _summed("Loss map (L3)", [row for _, level, row in rows if level is Level.L3]),
        _tight_summed([proof for proof, (_, level, _) in zip(proofs, rows, strict=True) if level is Level.L3], proofs),
    ]
    cells = (_hard_cells(*one, proof) for one, proof in zip(rows, proofs, strict=True))
    yield from _table(heads + ", tight gap, its CPU s", cells)
    for text in sums:
        yield from ("", text)


def _hard_cells(hard: Hard, level: Level, row: PeerRow, proof: Tight) -> list[str]:
    given_kwh, found_kwh = kwh(row.given.balance.input), kwh(row.found.balance.input)
    tight = (f"{100 * proof.gap_ratio:.3f} %", f"{proof.prove_s:.1f}") if level is Level.L3 else ("", "")
    return [
        hard.kind,
        f"{100 * hard.buffer_ratio:g} %",
        str(level),
        f"{given_kwh:.3f}",
        f"{found_kwh:.3f}",
        f"{100 * (given_kwh - found_kwh) / abs(given_kwh):.2f} %",
        *row.last_cells,
        *tight,
    ]


def _summed(what: str, rows: list[PeerRow]) -> str:
    gaps = 100.0 * np.array([row.found.gap_ratio for row in rows])
    refine_s, certify_s = (np.median([getattr(row, name) for row in rows]) for name in ("refine_s", "certify_s"))
    return (
        f"{what}, {len(rows)} problems: the gap is {np.median(gaps):.3f} % in the median, {gaps.max():.2f} % at most,\n"
        f"and at most 0.2 % in {(gaps <= 0.2).sum()}. Refinement takes {refine_s:.2f} s in the median, the proof"
        f" {certify_s:.2f} s."
    )


def _tight_summed(of_maps: list[Tight], everything: list[Tight]) -> str:
    gaps, cpu_s = 100.0 * np.array([one.gap_ratio for one in of_maps]), [one.prove_s for one in of_maps]
    close = sum(one.gap_ratio <= 2e-3 for one in everything)
    return (
        f"Loss map with `--bound {TIGHT_S:.0f}`: the gap is {np.median(gaps):.3f} % in the median,"
        f" {gaps.max():.2f} % at most;\n"
        f"the proof takes {np.median(cpu_s):.0f} s in the median, {max(cpu_s):.0f} s at most."
        f" With it, the gap is at most 0.2 % in {close} of all {len(everything)} problems."
    )


def main() -> None:
    """Write both tables."""
    warm_up_refinement()
    front = warm_up()
    front.trajectory(1.1 * front.fastest().time_s).certificate  # noqa: B018
    for name, table in (("peers", peers_table), ("hard", hard_table)):
        write_table(PAGE, name, table())


if __name__ == "__main__":
    main()
