"""The commands `das-precompute solve` and `das-precompute front`."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from das.command_line.application import refuse_given
from das.command_line.options import JsonOption, OverwriteOption, PlotOption
from das.command_line.printing import busy, loading_solver, steps_bar
from precompute.baselines import Strategy
from precompute.cli.options import (
    Files,
    Pose,
    RefineOption,
    RunFiles,
    TripTime,
    buffer_numbers,
    buffered,
    is_refined,
)

if TYPE_CHECKING:
    from das.solver.front import Front
    from das.solver.section import Section
    from das.solver.solution import Solution
    from precompute.cli.report import Answer


def solve(
    pose: Pose,
    trip: TripTime,
    files: RunFiles,
    strategy: Annotated[
        Strategy, typer.Option("--strategy", help="Driving strategy; 'fastest' takes no --time.")
    ] = Strategy.OPTIMAL,
    refine: RefineOption = "on",
) -> None:
    """Find the least-energy run over a section in a given time, or the run of a simpler strategy.

    Strategies to compare with: "fastest" uses full effort up to the limits, and full brakes. "top-speed" does the same
    below one reduced maximum speed. "four-mode" combines full traction, one cruising speed, coasting and full brakes,
    with the best switching points.

    A time below the least possible one gives the fastest run, and the column "fit" shows "late". A time beyond that of
    the least-energy run gives the least-energy run, and "fit" shows "early".

    The solver's table has decision points at most 150 m apart. By default the optimal run is then refined on a finer
    grid, without arriving later.

    The gap is the largest possible excess over the least energy. With a loss map (level l3), a gap of 0.1 to 1.3 %
    remains even for the best possible run.
    """
    trip.check(needed=strategy is not Strategy.FASTEST)
    if strategy is Strategy.FASTEST:
        refuse_given("the fastest run has no time to keep", "--time", "--buffer")
    if strategy is not Strategy.OPTIMAL:
        refuse_given(f"needs --strategy {Strategy.OPTIMAL}", "--refine")
    with_refinement = is_refined(refine)
    files.check(*pose.inputs())
    solved = _optimal(pose, trip, with_refinement) if strategy is Strategy.OPTIMAL else _baseline(pose, trip, strategy)
    section, answer, min_time_s, solve_s = solved

    from precompute.cli import report

    if files.out is not None:
        report.write_trajectory(files.out, answer.trajectory)
    if files.plot is not None:
        report.draw_answer(files.plot, section, answer)
    result = report.solution_json(answer, min_time_s, solve_s)
    if files.as_json:
        print(json.dumps(result))
        return
    title = section.name if strategy is Strategy.OPTIMAL else f"{section.name}, {strategy}"
    report.print_solutions(title, [result])
    report.print_parameters(result)
    files.tell()


def _solved_front(pose: Pose) -> tuple[Front, float, float]:
    """The front, its least time (s), and its computing time without compilation (s)."""
    with loading_solver("precompute.late_kernels"):
        from das.solver.solve import solve_front
        from das.solver.warm_up import warm_up

        section = pose.section()
        warm_up()
    began = time.perf_counter()
    with busy("solving …"):
        front = solve_front(section)
        min_time_s = front.fastest().time_s
    return front, min_time_s, time.perf_counter() - began


def _optimal(pose: Pose, trip: TripTime, refine: bool) -> tuple[Section, Answer, float, float]:
    front, min_time_s, front_s = _solved_front(pose)
    wanted_s = trip.wanted_s(min_time_s)
    assert wanted_s is not None
    ((answer, run_s),) = _runs(front, [wanted_s], refine)
    return front.section, answer, min_time_s, front_s + run_s


def _baseline(pose: Pose, trip: TripTime, strategy: Strategy) -> tuple[Section, Answer, float, float]:
    with loading_solver():
        from precompute.baselines import strategies

        section = pose.section()
        strategies.warm_up()
    began = time.perf_counter()
    with busy(f"searching for the {strategy} run …"):
        min_time_s = strategies.fastest(section).time_s
        run = strategies.baseline(strategy, section, trip.wanted_s(min_time_s))
    return section, run, min_time_s, time.perf_counter() - began


BUFFERS_PERCENT, EXACT_BUFFERS_PERCENT = "0,2,5,7,10,15,20", "0,2,5,7,10"


@dataclass(frozen=True, kw_only=True)
class FrontFiles(Files):
    """Whether `front` computes the exact front, and the files that it writes."""

    exact: Annotated[
        bool,
        typer.Option(
            "--exact", help="All non-dominated runs on the paper's grid (100 m × 0.25 km/h), next to the solver's."
        ),
    ] = False
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="With --exact: CSV file for all points of the front."),
    ] = None
    plot: PlotOption = None
    overwrite: OverwriteOption = False
    as_json: JsonOption = False

    def check(self, *inputs: str | Path | None) -> None:
        """Raise DasError for options that do not go together, and for outputs that cannot be written."""
        if self.exact:
            refuse_given("with --exact the solver's runs are not refined", "--refine")
            refuse_given("draws the solver's front only, and cannot be combined with --exact", "--plot")
        else:
            refuse_given("needs --exact", "--out")
        super().check(*inputs)


def front(
    pose: Pose,
    files: FrontFiles,
    buffers: Annotated[
        str | None,
        typer.Option(
            "--buffers",
            metavar="LIST",
            help=f"Buffers in %, separated by commas [default: {BUFFERS_PERCENT}; with --exact up to 10].",
        ),
    ] = None,
    refine: RefineOption = "on",
) -> None:
    """Show the trade-off between time and energy: the least-energy run for each of a list of buffers.

    By default every run is refined beyond the solver's table, as `solve` does: 0.2 to 0.5 s a run, and less for
    neighbouring buffers, because each run starts from its neighbours.

    With --exact, the algorithm of the paper checks the solver. It keeps every partial run that could still belong to
    the front, up to the largest buffer of the list. Times refer to its grid, on which runs are a little slower than
    those of the continuous solver. A section of 6 km with a buffer of 10 % takes up to half a minute; time and memory
    grow fast with length and buffer. The solver's runs are then not refined.
    """
    files.check(*pose.inputs())
    with_refinement, usual = is_refined(refine), EXACT_BUFFERS_PERCENT if files.exact else BUFFERS_PERCENT
    wanted = buffer_numbers(usual if buffers is None else buffers)
    solved, min_time_s, front_s = _solved_front(pose)
    if files.exact:
        from precompute.exact.command import exact_front

        exact_front(solved, wanted, files.out, as_json=files.as_json)
        return

    from precompute.cli import report

    points, runs = [], _runs(solved, [buffered(min_time_s, buffer) for buffer in wanted], with_refinement)
    for buffer_percent, (solution, solve_s) in zip(wanted, runs, strict=True):
        point = report.solution_json(solution, min_time_s, solve_s)
        points.append({"buffer_percent": buffer_percent, **point})
    if files.plot is not None:
        report.draw_front(files.plot, solved.section, [solution for solution, _ in runs])
    if files.as_json:
        print(json.dumps({"min_time_s": min_time_s, "front_s": front_s, "points": points}))
        return
    report.print_solutions(solved.section.name, points)
    files.tell()


def _runs(front: Front, times_s: list[float], refine: bool) -> list[tuple[Solution, float]]:
    """The run for each time (s), with its bound and refined if `refine`; and the computing time (s) of each."""
    runs, seconds = [], []
    with busy("computing the runs …"):
        for time_s in times_s:
            began = time.perf_counter()
            runs.append(front.trajectory(time_s))
            seconds.append(time.perf_counter() - began)
    if refine:
        runs, refining_s = _refined(runs)
        seconds = [sum(both) for both in zip(seconds, refining_s, strict=True)]
    with steps_bar("proving") as show:
        for done, solution in enumerate(runs):
            show("proving", done, len(runs))
            with loading_solver():  # the bound may need kernels that solving does not
                solution.certificate  # noqa: B018
    return list(zip(runs, seconds, strict=True))


def _refined(runs: list[Solution]) -> tuple[list[Solution], list[float]]:
    with loading_solver():
        from das.offline.refinement import refined_runs, warm_up_refinement

        warm_up_refinement()
    finished_s, order = [time.perf_counter()], []
    with steps_bar("refining") as show:

        def finished(index: int) -> None:
            order.append(index)
            finished_s.append(time.perf_counter())
            show("refining", len(order), len(runs))

        found = refined_runs(runs, watch=finished)
    seconds = dict(zip(order, np.diff(finished_s).tolist(), strict=True))
    return found, [seconds[i] for i in range(len(runs))]
