"""The command `das-precompute few-switch`: how much energy it costs that a driver changes the controller rarely."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from das.command_line.options import JsonOption
from das.command_line.printing import busy, loading_solver, new_table, print_table
from das.domain.errors import DasError
from das.domain.units import kwh
from precompute.cli.options import Pose, buffer_numbers, buffered, numbers
from precompute.cli.solve import solved_front

if TYPE_CHECKING:
    from das.domain.trajectory import Trajectory
    from das.solver.front import Front
    from das.solver.guide.policies import GuideFront
    from das.solver.section import Section

BUFFERS_PERCENT = "7"
PRICES_S = "0,0.03,0.08,0.15,0.3,1"
MOST_S = 100.0
"""Largest price of a change (s) that is accepted; at a higher price no change is ever worth making."""
OPTIMUM, FOUR_MODES = "optimum", "four modes"
LEGEND = {
    "price": "of a change, as seconds of the train's full power",
    "chg": "changes of instruction; for the optimum and four modes, changes of mode",
    "/min": "changes a minute",
    "short": "shortest time between two changes, brakes left out",
    "more": "energy above the optimum for the run's own time, which may differ by some seconds from the requested one",
}


def few_switch(
    pose: Pose,
    buffers: Annotated[
        str, typer.Option("--buffers", metavar="LIST", help="Buffers in %, separated by commas.")
    ] = BUFFERS_PERCENT,
    prices: Annotated[
        str,
        typer.Option(
            "--prices", metavar="LIST", help="Prices of a change, in s of the train's full power, separated by commas."
        ),
    ] = PRICES_S,
    as_json: JsonOption = False,
) -> None:
    """Show the energy cost of few changes of the controller, for each of a list of prices of a change.

    A change of what the driver does is made only where it saves as much energy as the train's full power needs in the
    time given as its price. The rows show the schedule that the guide would make, with the section's own braking,
    beside the optimum and the best run of four modes.
    """
    wanted = buffer_numbers(buffers)
    prices_s = numbers("--prices", prices)
    for price_s in prices_s:
        if not 0 <= price_s <= MOST_S:
            raise DasError(f"--prices {price_s:g}: expected times from 0 to {MOST_S:g} s")
    section, front, min_time_s, _ = solved_front(pose)
    with loading_solver():
        from precompute.baselines import strategies

        strategies.warm_up()
    with busy("solving …"):
        fronts = few_switch_fronts(section, prices_s)
    found = []
    for buffer_percent in wanted:
        with busy(f"searching for runs with a buffer of {buffer_percent:g} % …"):
            rows = list(few_switch_rows(front, fronts, buffered(min_time_s, buffer_percent)))
        found.append({"buffer_percent": buffer_percent, "runs": rows})
    if as_json:
        print(json.dumps({"min_time_s": min_time_s, "points": found}))
        return
    for point in found:
        _print_rows(section.name, point, last=point is found[-1])


def few_switch_fronts(section: Section, prices_s: Sequence[float]) -> list[tuple[float, GuideFront]]:
    """Each price of a change (s), with the policies of a section for it."""
    from das.solver.guide.policies import GuideFront, PolicySettings

    return [(price_s, GuideFront(section, PolicySettings(change_s=price_s))) for price_s in prices_s]


def few_switch_rows(
    front: Front, fronts: Sequence[tuple[float, GuideFront]], time_s: float
) -> Iterator[dict[str, Any]]:
    """The optimum for a time (s), the schedule for each price of a change, and the best run of four modes.

    `fronts` comes from `few_switch_fronts`. Rows are as `--json` prints them: `price_s` is None for the optimum and for
    four modes, `shortest_s` is the shortest time between two changes in which the train does not brake (None if there
    is none), and `more` is the energy above the optimum for the same time.
    """
    from precompute.baselines.strategies import four_modes

    section = front.section
    yield _row_of_modes(OPTIMUM, front.trajectory(time_s).trajectory, front)
    for price_s, solved in fronts:
        yield _row_of_schedule(price_s, solved, front, time_s)
    yield _row_of_modes(FOUR_MODES, four_modes(section, time_s).trajectory, front)


def _row_of_schedule(price_s: float, solved: GuideFront, front: Front, time_s: float) -> dict[str, Any]:
    """The row for a price of a change; its schedule is made as the guide makes it."""
    from das.solver.guide.from_run import scheduled_run
    from das.solver.guide.in_time import in_time
    from das.solver.guide.phases import BRAKES
    from das.solver.solution import trajectory_on
    from das.solver.state import State

    section = front.section
    found = scheduled_run(solved, in_time(solved, State.at(section), time_s)[0])
    phases = found.schedule.phases
    begins = np.array([one.begin for one in phases])
    brakes = np.array([one.kind in BRAKES for one in phases])
    run = trajectory_on(section, section, found.forecast.speeds_mps)
    return _row(f"{price_s:g}", price_s, run, front, (begins, brakes))


def _row_of_modes(name: str, run: Trajectory, front: Front) -> dict[str, Any]:
    """The row of a run whose phases are the modes of its intervals."""
    from das.advice.plan import classify_modes
    from das.advice.regimes import Regime

    modes = classify_modes(replace(front.trajectory(run.time_s), trajectory=run), front.section)
    begins = np.concatenate(([0], np.flatnonzero(np.diff(modes)) + 1))
    brakes = modes[begins] >= Regime.REDUCED_BRAKE
    return _row(name, None, run, front, (begins, brakes))


def _row(
    name: str,
    price_s: float | None,
    run: Trajectory,
    front: Front,
    phases: tuple[NDArray[np.int64], NDArray[np.bool_]],
) -> dict[str, Any]:
    """The row of a run; `phases` holds the first interval of each phase, and whether the train brakes in it."""
    begins, brakes = phases
    lasts_s = np.diff(np.append(run.t_s[begins], run.t_s[-1]))
    others = lasts_s[~brakes]
    energy_j = run.balance(front.section.vehicle, front.section.loss).input
    optimum_j = front.trajectory(run.time_s).balance.input
    return {
        "run": name,
        "price_s": price_s,
        "changes": len(begins) - 1,
        "changes_per_min": 60.0 * (len(begins) - 1) / run.time_s,
        "shortest_s": float(others.min()) if len(others) else None,
        "time_s": run.time_s,
        "energy_kwh": kwh(energy_j),
        "more_kwh": kwh(energy_j - optimum_j),
        "more_ratio": (energy_j - optimum_j) / optimum_j if optimum_j > 0 else None,
    }


def _print_rows(section: str, point: dict[str, Any], *, last: bool) -> None:
    """Print the runs of one buffer as a table, with a legend below the `last` table."""
    title = f"{section}, buffer {point['buffer_percent']:g} %"
    figures = ("price\ns", "chg", "/min", "short\ns", "time\ns", "energy\nkWh", "more\nkWh", "more\n%")
    table = new_table(title, (), figures)
    for run in point["runs"]:
        ratio, shortest_s = run["more_ratio"], run["shortest_s"]
        table.add_row(
            run["run"],
            f"{run['changes']}",
            f"{run['changes_per_min']:.2f}",
            "–" if shortest_s is None else f"{shortest_s:.1f}",
            f"{run['time_s']:.1f}",
            f"{run['energy_kwh']:.2f}",
            two_digits(run["more_kwh"]),
            "–" if ratio is None else two_digits(100 * ratio),
        )
    print_table(table, LEGEND if last else None)


def two_digits(value: float) -> str:
    """A difference with two decimals, never as −0.00."""
    return f"{round(value, 2) + 0.0:.2f}"
