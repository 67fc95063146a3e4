"""The command `das-precompute journey`."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.application import refuse_given
from das.command_line.printing import busy, loading_solver
from das.domain.errors import DasError
from precompute.cli.options import LineOptions, RunFiles, TrainOnLine, TrainOptions, WorldOptions, buffered

if TYPE_CHECKING:
    from das.domain.route import Route
    from das.domain.vehicle import Vehicle
    from das.offline.asked_journey import Journey
    from das.offline.journey import JourneyPlan, JourneyPlanner

ALL_STOPS = "stops"
"""Argument that stands for a journey with calls at all stops of the route."""
DWELL_S = 30.0


@dataclass(frozen=True, kw_only=True)
class StopsOptions:
    """Times of a journey over all stops of the route; they do not apply to a journey that has its own times."""

    time_s: Annotated[
        float | None,
        typer.Option("--time", metavar="S", help=f"With {ALL_STOPS!r}: whole time in s, dwells included."),
    ] = None
    buffer_percent: Annotated[
        float | None,
        typer.Option(
            "--buffer",
            metavar="PERCENT",
            help=f"With {ALL_STOPS!r}: running time as % above the least possible one; dwells are added.",
        ),
    ] = None
    dwell_s: Annotated[
        float | None,
        typer.Option(
            "--dwell", metavar="S", help=f"With {ALL_STOPS!r}: least dwell at every stop in s [default: {DWELL_S:g}]."
        ),
    ] = None

    def journey(self, route: Route, train: Vehicle, options: TrainOptions) -> Journey:
        """A journey over all stops of a route in a time, or with a buffer; DasError for impossible times."""
        from das.offline.asked_journey import Journey

        dwell_s = DWELL_S if self.dwell_s is None else self.dwell_s
        if (self.time_s is None) is (self.buffer_percent is None):
            raise DasError(f"{ALL_STOPS}: give either --time (s) or --buffer (%)")
        if self.time_s is not None:
            return Journey.over_stops(route.stops, time_s=self.time_s, dwell_s=dwell_s)
        if not 0 <= dwell_s < math.inf:
            raise DasError(f"--dwell {dwell_s} s: expected a finite number >= 0")
        assert self.buffer_percent is not None
        running_s = buffered(_least_time_s(route, train, options), self.buffer_percent)
        return Journey.over_stops(route.stops, time_s=running_s + dwell_s * (len(route.stops) - 2), dwell_s=dwell_s)


@dataclass(frozen=True, kw_only=True)
class JourneyFiles(RunFiles):
    """The files that `journey` writes (trajectory, picture and driver's sheet), and whether it prints JSON."""

    sheet: Annotated[
        Path | None,
        typer.Option(
            "--sheet",
            metavar="FILE",
            help="Driver's sheet to write (.html, or .pdf with Chromium): instructions by kilometre.",
        ),
    ] = None

    def outputs(self) -> tuple[Path | None, ...]:
        """All files to write; None for one that was not requested."""
        return *super().outputs(), self.sheet

    def check(self, *inputs: str | Path | None) -> None:
        """Raise DasError if a file cannot be written; called before the work begins."""
        kind = "" if self.sheet is None else self.sheet.suffix.lower()
        if self.sheet is not None and kind not in (".html", ".htm", ".pdf"):
            raise DasError(f"{self.sheet}: expected a file name that ends in .html or .pdf")
        super().check(*inputs)
        if kind == ".pdf":
            from precompute.pdf import browser

            browser()


JourneyArgument = Annotated[
    str,
    typer.Argument(
        metavar="JOURNEY",
        help=f"Bundled journey, TOML file or TTOBench journey (JSON); or {ALL_STOPS!r}: all stops of the route.",
    ),
]


def journey(
    journey: JourneyArgument,
    where: LineOptions,
    driven: TrainOptions,
    world: WorldOptions,
    stops: StopsOptions,
    files: JourneyFiles,
) -> None:
    """Plan a train's whole journey with the least energy: times at all points, and driving between them.

    Every window is kept: no stop is left early, none is reached late, and passing points are passed in time. The time
    is divided so that one second less would cost the same energy on every section; this price of time changes only at a
    window that binds. With "stops" only the departure (at 0) and the last arrival are timed.

    For comparison the command prints the energy of two other plans within the same windows: one with the same buffer
    (in per cent) on every section, and one that drives as fast as possible and then waits. An error names windows that
    cannot be kept and the missing seconds.
    """
    posed = TrainOnLine(where=where, driven=driven, world=world)
    files.check(journey, *posed.inputs())
    with loading_solver():
        from das.offline.chains import Split
        from das.offline.journey import JourneyPlanner
        from das.solver.warm_up import warm_up

        line = posed.route()
        asked, train = _asked(journey, line, posed, stops)
        warm_up()
    began = time.perf_counter()
    with busy(f"planning {len(asked.calls) - 1} sections …"):
        planner = JourneyPlanner(asked, line, train, level=driven.level)
        plan = planner.plan()
        solve_s = time.perf_counter() - began
        others_j = {"proportional": planner.plan(Split.PROPORTIONAL).input_j, "fastest": planner.fastest_j()}

    from precompute.cli import report

    with busy("pricing the missed preferred times …"):
        missed = report.missed_wishes(planner, plan)
    _write(files, planner, plan)
    if files.as_json:
        print(json.dumps(report.journey_json(plan, others_j, missed, solve_s)))
        return
    title = f"{asked.name}: {train.id}, {planner.sections[0].whole.level}"
    report.print_plan(plan, title, others_j, missed)
    files.tell()


def _write(files: JourneyFiles, planner: JourneyPlanner, plan: JourneyPlan) -> None:
    if files.out is not None:
        from precompute.cli.report import write_trajectory

        write_trajectory(files.out, plan.trajectory())
    if files.plot is not None:
        from das.drawing.picture import draw_runs

        draw_runs([plan.plotted()]).save(files.plot, overwrite=True)
    if files.sheet is not None:
        with busy("writing the sheet …"):
            _write_sheet(files.sheet, planner, plan)


def _write_sheet(path: Path, planner: JourneyPlanner, plan: JourneyPlan) -> None:
    from das.domain.files.writing import write_whole
    from precompute.sheet import sheet_page, sheets_of

    page = sheet_page(plan, list(sheets_of(planner, plan)), Path(plan.journey.source).name)
    if path.suffix.lower() == ".pdf":
        from precompute.pdf import write_pdf

        write_pdf(page, path)
    else:
        write_whole(path, page.encode())


def _asked(name: str, line: Route, posed: TrainOnLine, stops: StopsOptions) -> tuple[Journey, Vehicle]:
    """The journey that the user names, or a journey over all stops, and the train in the journey's mode."""
    from das.domain.files.load import load_journey

    driven, train = posed.driven, posed.vehicle()
    if name == ALL_STOPS:
        return stops.journey(line, train, driven), train
    refuse_given(f"needs {ALL_STOPS!r}: {name} has times of its own", "--time", "--buffer", "--dwell")
    found = load_journey(name, line)
    if found.mode and driven.mode is None:
        train = replace(posed, driven=replace(driven, mode=found.mode)).vehicle()
    return found, train


def _least_time_s(route: Route, train: Vehicle, options: TrainOptions) -> float:
    from das.solver.section import build_section
    from precompute.baselines import strategies

    ends = pairwise(stop.position_m for stop in route.stops)
    sections = (build_section(route, train, level=options.level, start_m=a, end_m=b) for a, b in ends)
    return sum(strategies.fastest(section).time_s for section in sections)
