"""The command `das-precompute front`."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from das.command_line.compiling import loading_solver
from das.command_line.options import JsonOption, OverwriteOption
from das.command_line.outputs import check_outputs
from das.command_line.printing import busy
from das.command_line.progress import progress_bar
from das.domain.errors import DasError
from precompute.cli.options import RefineOption, buffered, numbers, refine_seconds
from precompute.cli.pose import Pose
from precompute.cli.solve import certified, solved_front

if TYPE_CHECKING:
    from das.solver.front import Front
    from das.solver.solution import Solution

BUFFERS_PERCENT = "0,2,5,7,10,15,20"
EXACT_MAX_BUFFER_PERCENT = 10.0


@dataclass(frozen=True, kw_only=True)
class ExactOptions:
    """What `front --exact` is told: largest buffer (%), time in which one partial run is kept (ms), file of points."""

    exact: Annotated[
        bool,
        typer.Option(
            "--exact", help="Every undominated run on the paper's grid (100 m × 0.25 km/h), beside the solver's."
        ),
    ] = False
    max_buffer_percent: Annotated[
        float | None,
        typer.Option(
            "--max-buffer",
            metavar="PERCENT",
            help=f"With --exact: largest buffer in % [default: {EXACT_MAX_BUFFER_PERCENT:g}].",
        ),
    ] = None
    bucket_ms: Annotated[
        float,
        typer.Option(
            "--bucket",
            metavar="MS",
            min=0.0,
            max=1000.0,
            help="With --exact: keep one partial run per state and so many ms, for bounds where all take too long.",
        ),
    ] = 0.0
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help="With --exact: every point of the front to write (.csv)."),
    ] = None
    overwrite: OverwriteOption = False

    def largest_percent(self) -> float:
        """The largest buffer (%) of the exact front; DasError for one that cannot be."""
        largest = EXACT_MAX_BUFFER_PERCENT if self.max_buffer_percent is None else self.max_buffer_percent
        buffered(1.0, largest)
        return largest


def front(
    pose: Pose,
    witness: ExactOptions,
    buffers: Annotated[
        str | None,
        typer.Option(
            "--buffers", metavar="LIST", help=f"Buffers in %, with commas between [default: {BUFFERS_PERCENT}]."
        ),
    ] = None,
    refine: RefineOption = "on",
    as_json: JsonOption = False,
) -> None:
    """Show the trade-off between time and energy: the least-energy run for each of a list of buffers.

    By default every run is refined beyond the solver's table, as `solve` does: 0.2 to 0.5 s a run, and less for
    neighbouring buffers, which help each other.

    With --exact, the algorithm of the paper checks the solver. It keeps every partial run that could still belong to
    the front. Its times are those of its grid, which is a little slower than the continuous solver. 6 km with a buffer
    of 10 % take up to half a minute; time and memory grow fast with length and buffer. On a terminal it shows how much
    time is likely to be left. The solver's runs beside it are not refined.
    """
    if not witness.exact and (witness.out or witness.bucket_ms or witness.max_buffer_percent is not None):
        raise DasError("--out, --bucket and --max-buffer belong to --exact")
    largest, budget_s = witness.largest_percent(), refine_seconds(refine)
    wanted = _buffers(BUFFERS_PERCENT if buffers is None else buffers)
    check_outputs(witness.out, inputs=pose.inputs(), overwrite=witness.overwrite)
    section, solved, min_time_s, front_s = solved_front(pose)
    if witness.exact:
        from precompute.exact.command import exact_front

        if buffers is None:
            wanted = [x for x in wanted if x <= largest]
        exact_front(solved, (largest, witness.bucket_ms), wanted, witness.out, as_json=as_json)
        return

    from precompute.cli import report
    from precompute.cli.tables import print_solutions

    points = []
    for buffer_percent, (solution, solve_s) in zip(wanted, _runs(solved, min_time_s, wanted, budget_s), strict=True):
        point = report.solution_json(solution, min_time_s, solve_s)
        points.append({"buffer_percent": buffer_percent, **point})
    if as_json:
        print(json.dumps({"min_time_s": min_time_s, "front_s": front_s, "points": points}))
        return
    print_solutions(section.name, points)


def _runs(front: Front, min_time_s: float, buffers: list[float], budget_s: float) -> list[tuple[Solution, float]]:
    """The run of each buffer (%), refined within a budget (s), with its proof, and the seconds that it took."""
    runs, seconds = [], []
    with busy("rolling out …"):
        for buffer_percent in buffers:
            began = time.perf_counter()
            runs.append(front.trajectory(buffered(min_time_s, buffer_percent)))
            seconds.append(time.perf_counter() - began)
    if budget_s > 0:
        runs, refining_s = _refined(runs, budget_s)
        seconds = [sum(both) for both in zip(seconds, refining_s, strict=True)]
    with progress_bar("proving") as show:
        for done, solution in enumerate(runs):
            show("proving", done, len(runs))
            certified(solution)
    return list(zip(runs, seconds, strict=True))


def _refined(runs: list[Solution], budget_s: float) -> tuple[list[Solution], list[float]]:
    """The runs, refined for at most so many seconds, and the seconds that each took."""
    with loading_solver():
        from das.solver.refined_runs import refined_runs
        from das.solver.refinement import warm_up_refinement

        warm_up_refinement()
    began = time.perf_counter()
    finished_s, order = [began], []
    with progress_bar("refining") as show:

        def finished(index: int) -> None:
            order.append(index)
            finished_s.append(time.perf_counter())
            show("refining", len(order), len(runs))

        found = refined_runs(runs, is_over=lambda: time.perf_counter() - began > budget_s, watch=finished)
    seconds = dict(zip(order, np.diff(finished_s).tolist(), strict=True))
    return found, [seconds[i] for i in range(len(runs))]


def _buffers(text: str) -> list[float]:
    values = numbers("--buffers", text)
    for value in values:
        buffered(1.0, value)
    return values
