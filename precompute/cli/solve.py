"""The command `das-precompute solve`."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.compiling import loading_solver
from das.command_line.printing import busy
from precompute.baselines.strategy import Strategy
from precompute.cli.options import BoundOption, RefineOption, RunFiles, TripTime, bound_seconds, refine_seconds
from precompute.cli.pose import Pose

if TYPE_CHECKING:
    from das.solver.front import Front
    from das.solver.section import Section
    from das.solver.solution import Solution
    from precompute.cli.report import Answer

StrategyOption = Annotated[
    Strategy, typer.Option("--strategy", help="How the section is driven; fastest needs no time.")
]


def solve(
    pose: Pose,
    trip: TripTime,
    files: RunFiles,
    strategy: StrategyOption = Strategy.OPTIMAL,
    refine: RefineOption = "on",
    bound: BoundOption = "quick",
) -> None:
    """Find the least-energy run over a section in a given time, or the run of a simpler strategy.

    Strategies to compare with: "fastest" is full effort, the limits, full brake. "rms" is the same under one reduced
    maximum speed. "four-mode" is full traction, one cruising speed, coasting and full brake, with the best switching
    points.

    A time below the least possible one gives the fastest run, and the column "fit" says "late". A time beyond that of
    the least-energy run gives the least-energy run, and "fit" says "early".

    The solver's table decides once in up to 150 m. By default the optimal run is then refined on a finer grid, without
    arriving later.

    The gap says how far the energy can be above the least possible. With a loss map (level l3) the quick bound leaves
    0.1 to 1.3 % that no run could save; "--bound 30" searches for 30 s for a higher bound.
    """
    trip.check(needed=strategy is not Strategy.FASTEST)
    budget_s, bound_s = refine_seconds(refine), bound_seconds(bound)
    files.check(*pose.inputs())
    if strategy is Strategy.OPTIMAL:
        section, answer, min_time_s, solve_s = _optimal(pose, trip, budget_s, bound_s)
    else:
        section, answer, min_time_s, solve_s = _baseline(pose, trip, strategy)

    from das.domain.files.trajectory_csv import write_trajectory
    from precompute.cli import report

    if files.out is not None:
        write_trajectory(files.out, answer.trajectory)
    if files.plot is not None:
        report.draw_solution(files.plot, section, answer)
    result = report.solution_json(answer, min_time_s, solve_s)
    if files.as_json:
        print(json.dumps(result))
        return

    from precompute.cli.tables import print_parameters, print_solutions

    print_solutions(section.name if strategy is Strategy.OPTIMAL else f"{section.name}, {strategy}", [result])
    print_parameters(result)
    files.tell()


def solved_front(pose: Pose) -> tuple[Section, Front, float, float]:
    """Section, front, least time (s), and the seconds the front took once everything was compiled."""
    with loading_solver():
        from das.solver.solve import solve_front
        from das.solver.warm_up import warm_up

        section = pose.section()
        warm_up()
    began = time.perf_counter()
    with busy("solving …"):
        front = solve_front(section)
        min_time_s = front.fastest().time_s
    return section, front, min_time_s, time.perf_counter() - began


def _optimal(pose: Pose, trip: TripTime, budget_s: float, bound_s: float) -> tuple[Section, Answer, float, float]:
    section, front, min_time_s, front_s = solved_front(pose)
    if budget_s > 0:
        with loading_solver():
            from das.solver.refinement import refined, warm_up_refinement

            warm_up_refinement()
    began = time.perf_counter()
    wanted_s = trip.wanted_s(min_time_s)
    assert wanted_s is not None
    answer = front.trajectory(wanted_s)
    if budget_s > 0:
        with busy("refining …"):
            answer = refined(answer, is_over=lambda: time.perf_counter() - began > budget_s)
    solve_s = front_s + time.perf_counter() - began
    return section, _with_bound(answer, bound_s), min_time_s, solve_s


def _with_bound(answer: Solution, bound_s: float) -> Solution:
    """The answer with its bound proven, after a search of about `bound_s` seconds for a tight one."""
    if bound_s > 0:
        from das.solver.solution import tightened

        with busy("proving the bound …"):
            answer = tightened(answer, bound_s)
    certified(answer)
    return answer


def certified(solution: Solution) -> None:
    """Prove the bound of a solution, which may compile kernels that solving does not need; it is kept."""
    with loading_solver():
        solution.certificate  # noqa: B018


def _baseline(pose: Pose, trip: TripTime, strategy: Strategy) -> tuple[Section, Answer, float, float]:
    with loading_solver():
        from precompute.baselines import strategies

        section = pose.section()
        strategies.warm_up()
    began = time.perf_counter()
    with busy(f"searching the {strategy} run …"):
        min_time_s = strategies.fastest(section).time_s
        run = strategies.baseline(strategy, section, trip.wanted_s(min_time_s))
    return section, run, min_time_s, time.perf_counter() - began
