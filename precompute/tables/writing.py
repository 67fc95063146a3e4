"""Production of a table: solution and refinement of a section's front, and references for departures."""

from __future__ import annotations

import copyreg
import math
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from das.domain.braking import ServiceBraking
from das.domain.levels import Level
from das.domain.route import Route
from das.domain.units import PERCENT
from das.domain.vehicle import Vehicle
from das.offline.refinement import QUICK, refined_runs
from das.solver.guide.from_run import scheduled_run
from das.solver.guide.in_time import all_tried
from das.solver.guide.policies import DEFAULT, GuideFront, GuideRun
from das.solver.guide.references import Finished, References
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_front
from das.solver.state import State
from das.table import Table, facts_of, key_of, table_content, table_name

FINE = replace(DEFAULT, line_mps=0.5 * DEFAULT.line_mps, ladder_ratio=1.015, kept_bytes=300_000_000)
"""Settings with which references are solved: twice as many speeds and prices of time as on board, and more memory."""
EVERY_RATIO = 0.002
"""Step between the times for which runs are sought, as a share of the least time."""
LONGEST_RATIO = 1.25
"""Multiple of the least time up to which runs are sought; a train with more time is planned separately."""
PARTS = 4
"""Number of times in each step of `EVERY_RATIO` for which the best run is kept."""


def finished_references(section: Section, *, threads: int = 1) -> References:
    """The finished references of a section; raises InfeasibleError if the train stalls."""
    front = GuideFront(section, FINE, threads=threads)
    state, least_s = State.at(section), float(section.fastest_run.time_to_go_s[0])
    steps = math.ceil((LONGEST_RATIO - 1.0) / EVERY_RATIO)
    times_s, wanted_s = (least_s * np.linspace(1.0, LONGEST_RATIO, size + 1) for size in (steps, PARTS * steps))
    runs = sorted(all_tried(front, state, times_s.tolist()), key=lambda run: run.time_s)
    pool = References([Finished(run.time_s, _priced_j(front, run), run.lambda_w, ()) for run in runs])
    found: list[Finished] = []
    for number in sorted({best for time_s in wanted_s if (best := pool.best(float(time_s))) is not None}):
        schedule, forecast, lambda_w, _ = scheduled_run(front, runs[number])
        if not found or (forecast.time_s > found[-1].time_s and forecast.energy_j < found[-1].energy_j):
            found.append(Finished(forecast.time_s, forecast.energy_j, lambda_w, schedule.phases))
    return References(found)


def _priced_j(front: GuideFront, run: GuideRun) -> float:
    """The energy of a run and the price of the changes in it (J): changes that gain little should not be shown."""
    return run.energy_j + front.change_j(run.lambda_w) * float(np.count_nonzero(np.diff(run.said)))


NOT_PROVEN = "not proven when the table was built"
UNBOUNDED_S = 1e9
"""A trip time longer than any run needs, for which the solver gives the run of least energy."""


@dataclass(frozen=True, kw_only=True)
class TableSettings:
    """The content of a table's front.

    `buffers_percent`: a point for each of these, in % above the least time. `with_max`: the least energy as well.
    `refined`: whether the runs are refined. `proven`: number of points whose gap is proven (each takes 0.05 s, or 0.5 s
    with a loss map).
    """

    buffers_percent: tuple[float, ...] = tuple(0.5 * i for i in range(41))
    with_max: bool = True
    refined: bool = True
    proven: int = 5

    @property
    def as_kept(self) -> dict[str, Any]:
        """The settings as a table keeps them."""
        return {"buffers_percent": self.buffers, "refine": "on" if self.refined else "off", "proven": self.proven}

    @property
    def buffers(self) -> list[float | None]:
        """The buffer of each point (%); None: the least energy."""
        return [*self.buffers_percent, *([None] if self.with_max else [])]


def make_table(section: Section, settings: TableSettings, *, threads: int = 1) -> bytes:
    """Solve a section; returns the content of its table. Raises InfeasibleError if the section cannot be driven."""
    found = front_facts(section, settings, threads=threads)
    references = finished_references(section, threads=threads)
    return table_content(section, found, references)


def front_facts(section: Section, settings: TableSettings, *, threads: int = 1) -> dict[str, Any]:
    """The front of a section as a table keeps it, with its settings and the least time; raises as `make_table` does."""
    front = solve_front(section, threads=threads)
    least_time_s = front.fastest().time_s
    times_s = [UNBOUNDED_S if one is None else least_time_s * (1 + PERCENT * one) for one in settings.buffers]
    given = [front.trajectory(time_s) for time_s in times_s]
    runs = refined_runs(given, QUICK) if settings.refined else given
    proven = _to_be_proven(given, settings.proven)
    points = [
        {"buffer_percent": buffer, **_run_facts(run, before, i in proven)}
        for i, (buffer, run, before) in enumerate(zip(settings.buffers, runs, given, strict=True))
    ]
    return {"settings": settings.as_kept, "least_time_s": least_time_s, "front": points}


def _to_be_proven(runs: list[Solution], count: int) -> set[int]:
    """Indices of the runs to prove: up to `count`, spread evenly over those that are on time."""
    on_time = [i for i, run in enumerate(runs) if run.fit is Fit.ON_TIME and math.isfinite(run.lambda_w)]
    wanted = min(count, len(on_time))
    return {on_time[round(i * (len(on_time) - 1) / max(wanted - 1, 1))] for i in range(wanted)}


def _run_facts(run: Solution, before: Solution, is_proven: bool) -> dict[str, Any]:
    """A run in the table; `before` is the same run unrefined. λ is null for the fastest run."""
    gap: dict[str, Any] = {"bound_j": None, "gap_ratio": None, "gap_reason": NOT_PROVEN}
    if is_proven:
        gap = {"bound_j": _finite(run.bound_j), "gap_ratio": _finite(run.gap_ratio), "gap_reason": run.gap_reason}
    return {
        "time_s": run.time_s,
        "fit": str(run.fit),
        "energy_input_j": run.balance.input,
        "energy_irreversible_j": run.balance.irreversible,
        "refinement_saved_j": before.balance.input - run.balance.input,
        "lambda_w": _finite(run.lambda_w),
        **gap,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


# Vehicles hold their losses in read-only mappings, which pickle does not support.
copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """A section of a line for a train that stops at both ends, and the content of its table.

    `braking`: the braking for limits and stops; None: full brakes.
    """

    route: Route
    vehicle: Vehicle
    level: Level
    start_m: float
    end_m: float
    braking: ServiceBraking | None
    settings: TableSettings

    @cached_property
    def name(self) -> str:
        """The name of the table's file."""
        facts = facts_of(
            self.route, self.vehicle, self.level, (self.start_m, self.end_m),
            length_m=self.vehicle.train_length_m, braking=self.braking,
        )  # fmt: skip
        return table_name(facts)

    def section(self) -> Section:
        """The section; raises as `build_section` does."""
        return build_section(
            self.route,
            self.vehicle,
            level=self.level,
            start_m=self.start_m,
            end_m=self.end_m,
            options=SectionOptions(braking=self.braking),
        )

    def is_done(self, table: Table) -> bool:
        """Whether a table equals the one that the job would make; raises as `section` does."""
        return table.settings == self.settings.as_kept and table.key == key_of(self.section(), DEFAULT)

    def solve(self) -> bytes:
        """The content of the table; raises DasError with the reason if the section cannot be solved."""
        return make_table(self.section(), self.settings)
