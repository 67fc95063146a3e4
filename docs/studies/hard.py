"""The hard sections of docs/results/0.2/solver: the solver's table, refinement and proven bounds side by side.

`python -m docs.studies.hard` solves all of them again and writes the table, which takes about eight minutes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from das.domain.errors import InfeasibleError
from das.domain.files.load import load_vehicle
from das.domain.levels import Level
from das.domain.route import Route, Stretches, Zone
from das.domain.units import KMH, kwh
from das.domain.vehicle import Vehicle
from das.offline.refinement import refined
from das.solver.section import build_section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from docs.studies.output import DOCS, write_csv, write_table
from docs.studies.tight_bound import tightened
from tests.support.making import make_route

PAGE = DOCS / "results" / "0.2" / "solver.md"
HARD = PAGE.with_suffix("") / "hard.csv"
HEAD = "| problem | buffer | level | table kWh | refined kWh | saved | gap | tight gap |"
LEVELS = (Level.L0_REG, Level.L1, Level.L2, Level.L3)
SEED = 14
TIGHT_S = 40.0
"""Largest CPU time (s) of the tight bound of a loss map."""


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


def hard_rows() -> Iterator[tuple[Hard, Level, Solution, Solution]]:
    """Every hard problem at every level, from the table and refined; problems without a solution are replaced."""
    for number, level in enumerate(LEVELS):
        rng = np.random.default_rng([SEED, number])
        wanted = [one.kind for one in hard_problems(np.random.default_rng(0))]
        while wanted:
            for one in hard_problems(rng):
                if one.kind not in wanted:
                    continue
                try:
                    front = solve_front(build_section(one.route, one.vehicle, level=level), threads=1)
                    given = front.trajectory(front.fastest().time_s * (1.0 + one.buffer_ratio))
                except InfeasibleError:
                    continue
                wanted.remove(one.kind)
                yield one, level, given, refined(given)


def hard_table() -> Iterator[str]:
    """The hard problems and a summary of their gaps; the tight gap is to the bound computed in `TIGHT_S`."""
    rows = list(hard_rows())
    of_maps = [found for _, level, _, found in rows if level is Level.L3]
    tight = {id(found): tightened(found, TIGHT_S).gap_ratio for found in of_maps}
    convex = [found.gap_ratio for _, level, _, found in rows if level is not Level.L3]
    yield HEAD
    yield from (hard_line(*row, tight.get(id(row[-1]))) for row in rows)
    yield from ("", "- " + _summed("Convex losses (L0 to L2)", convex))
    yield from ("", "- " + _summed("Loss map (L3)", [found.gap_ratio for found in of_maps]))
    yield from ("", "- " + _summed(f"Loss map with the tight bound, {TIGHT_S:.0f} s", list(tight.values())))


def hard_line(hard: Hard, level: Level, given: Solution, found: Solution, tight_ratio: float | None) -> str:
    """The line of a problem in the table; `tight_ratio` is None where the tight bound is not computed."""
    given_kwh, found_kwh = kwh(given.balance.input), kwh(found.balance.input)
    saved = f"{100 * (given_kwh - found_kwh) / abs(given_kwh):.2f} %"
    tight = "" if tight_ratio is None else f"{100 * tight_ratio:.3f} %"
    energies = f"{given_kwh:.3f} | {found_kwh:.3f} | {saved} | {100 * found.gap_ratio:.3f} %"
    return f"| {hard.kind} | {100 * hard.buffer_ratio:g} % | {level} | {energies} | {tight} |"


def _summed(what: str, gap_ratios: Sequence[float]) -> str:
    gaps = 100.0 * np.array(gap_ratios)
    return (
        f"{what}, {len(gaps)} problems: the gap is {np.median(gaps):.3f} % in the median, {gaps.max():.2f} % at most, "
        f"and at most 0.2 % in {(gaps <= 0.2).sum()}."
    )


def main() -> None:
    """Write the table, and its summary in the page."""
    lines = list(hard_table())
    write_csv(HARD, (line for line in lines if line.startswith("|")))
    write_table(PAGE, "hard", (line for line in lines if line and not line.startswith("|")))


if __name__ == "__main__":
    main()
