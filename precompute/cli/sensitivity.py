"""The command `das-precompute sensitivity`."""

from __future__ import annotations

import json
import math
import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.loading import loading_solver
from das.command_line.outputs import offscreen_pyplot
from das.command_line.printing import busy, shown, tell
from precompute.cli.options import Pose, TableFiles, TripTime

if TYPE_CHECKING:
    from das.solver.section import Section
    from das.solver.solution import Solution
    from precompute.sensitivity.analysis import Variation

DEFAULT = "mass=±5%,±10%, resistance=±10%,±20%, wind=-20..20, receptivity=0.5,0, adhesion=0.6,0.3"
"""What is varied unless the user says something else."""


def sensitivity(
    pose: Pose,
    trip: TripTime,
    files: TableFiles,
    vary: Annotated[
        str | None,
        typer.Option(
            "--vary",
            metavar="LIST",
            help="What differs from the plan: mass and resistance by %, head wind in km/h (tail wind < 0), receptivity "
            f"and adhesion as ratios; ± is both ways, a..b five values [default: {DEFAULT}].",
        ),
    ] = None,
) -> None:
    """Tell how time and energy of a planned run move when train, wind, line or rail differ from the plan.

    The plan is the least-energy run under the options given. The driver follows its speeds over the way in the changed
    world as well as the train can, and brakes as early as the changed train needs. Beside it stands what planning anew
    would give there, for the planned time ("on time") and for the time that following the plan took ("saved": what the
    stale plan wastes). All % are of the plan's energy at the current collector.
    """
    trip.check(needed=True)
    files.check(*pose.inputs())
    if files.plot is not None:
        offscreen_pyplot()  # refuse before the work begins
    with loading_solver():
        from precompute.sensitivity.analysis import assess, by_effect
        from precompute.sensitivity.report import draw_tornado, outcome_row, print_rows, write_csv
    variations, left_out = _variations(pose, vary)
    section, plan, planned = _plan(pose, trip)
    outcomes = [assess(plan, one, pose.section) for one in shown(variations, lambda one: one.label)]
    pairs = by_effect(outcomes)
    rows = [outcome_row(outcome) for pair in pairs for outcome in pair]
    if files.out is not None:
        write_csv(files.out, rows)
    if files.plot is not None:
        draw_tornado(files.plot, section, plan, pairs)
    if files.as_json:
        print(json.dumps({"section": section.name, "plan": planned, "variations": rows, "left_out": left_out}))
        return
    print_rows(section, planned, rows)
    for line in left_out:
        tell(line)
    files.tell()


def _variations(pose: Pose, vary: str | None) -> tuple[list[Variation], list[str]]:
    """What to vary, and a line for what the default had to leave out."""
    from precompute.sensitivity.analysis import Parameter, parse_variations

    plan, vehicle = pose.conditions(), pose.vehicle()
    variations = parse_variations(DEFAULT if vary is None else vary, plan)
    if vary is not None:
        for variation in variations:
            if variation.parameter is Parameter.ADHESION:
                variation.conditions.train(vehicle)  # raises where the train has no data of it
        return variations, []
    variations = [x for x in variations if x.conditions != plan]
    if math.isfinite(vehicle.adhesive_mass_kg):
        return variations, []
    left_out = f"adhesion: left out, {vehicle.id} has no data of it ([adhesion] in its file)"
    return [x for x in variations if x.parameter is not Parameter.ADHESION], [left_out]


def _plan(pose: Pose, trip: TripTime) -> tuple[Section, Solution, dict[str, Any]]:
    """The section, the plan, and the plan as JSON."""
    from precompute.cli.report import solution_json
    from precompute.cli.solve import solved_front

    section, front, min_time_s, front_s = solved_front(pose)
    began = time.perf_counter()
    with busy("solving …"):
        wanted_s = trip.wanted_s(min_time_s)
        assert wanted_s is not None
        plan = front.trajectory(wanted_s)
    return section, plan, solution_json(plan, min_time_s, front_s + time.perf_counter() - began)
