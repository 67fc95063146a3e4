"""The cost of few changes of the controller: `python -m docs.studies.few_switch ROUTE VEHICLE`.

A change of instruction is made only if it saves the energy that the train's full power needs in the time given as the
price of a change. The rows show the schedule of the guide with the section's own braking, compared with the optimum and
the best run of four modes.
"""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.advice.plan import classify_modes
from das.advice.regimes import Regime
from das.command_line.printing import new_table, print_table
from das.domain.trajectory import Trajectory
from das.domain.units import kwh
from das.solver.front import Front
from das.solver.guide.from_run import scheduled_run
from das.solver.guide.in_time import in_time
from das.solver.guide.policies import GuideFront, PolicySettings
from das.solver.guide.schedule import BRAKES
from das.solver.section import Section
from das.solver.solution import trajectory_on
from das.solver.solve import solve_front
from das.solver.state import State
from docs.studies.asked_section import add_section, section_of
from precompute.baselines.strategies import four_modes

BUFFERS_PERCENT: Final = (4.0, 7.0)
PRICES_S: Final = (0.0, 0.03, 0.08, 0.15, 0.3, 1.0)
OPTIMUM, FOUR_MODES = "optimum", "four modes"
LEGEND: Final = {
    "price": "of a change, as seconds of the train's full power",
    "chg": "changes of instruction; for the optimum and four modes, changes of mode",
    "/min": "changes a minute",
    "short": "shortest time between two changes, brakes left out",
    "more": "energy above the optimum for the run's own time, which may differ by some seconds from the requested one",
}


def few_switch_fronts(section: Section, prices_s: Sequence[float]) -> list[tuple[float, GuideFront]]:
    """Each price of a change (s), with the policies of a section for that price."""
    return [(price_s, GuideFront(section, PolicySettings(change_s=price_s))) for price_s in prices_s]


def few_switch_rows(
    front: Front, fronts: Sequence[tuple[float, GuideFront]], time_s: float
) -> Iterator[dict[str, Any]]:
    """The optimum for a time (s), the schedule for each price of a change, and the best run of four modes.

    `fronts` comes from `few_switch_fronts`. `shortest_s` is the shortest time without braking between two changes (None
    if there is none), and `more` is the energy above the optimum for the same time.
    """
    section = front.section
    yield _row_of_modes(OPTIMUM, front.trajectory(time_s).trajectory, front)
    for price_s, solved in fronts:
        yield _row_of_schedule(price_s, solved, front, time_s)
    yield _row_of_modes(FOUR_MODES, four_modes(section, time_s).trajectory, front)


def _row_of_schedule(price_s: float, solved: GuideFront, front: Front, time_s: float) -> dict[str, Any]:
    """The row for a price of a change, with a schedule computed as for the guide."""
    section = front.section
    found = scheduled_run(solved, in_time(solved, State.at(section), time_s)[0])
    phases = found.schedule.phases
    begins = np.array([one.begin for one in phases])
    brakes = np.array([one.kind in BRAKES for one in phases])
    run = trajectory_on(section, section, found.forecast.speeds_mps)
    return _row(f"{price_s:g}", run, front, (begins, brakes))


def _row_of_modes(name: str, run: Trajectory, front: Front) -> dict[str, Any]:
    """The row of a run whose phases are the modes of its intervals."""
    modes = classify_modes(replace(front.trajectory(run.time_s), trajectory=run), front.section)
    begins = np.concatenate(([0], np.flatnonzero(np.diff(modes)) + 1))
    brakes = modes[begins] >= Regime.REDUCED_BRAKE
    return _row(name, run, front, (begins, brakes))


def _row(
    name: str, run: Trajectory, front: Front, phases: tuple[NDArray[np.int64], NDArray[np.bool_]]
) -> dict[str, Any]:
    """The row of a run; `phases` contains the first interval of each phase and whether the train brakes in it."""
    begins, brakes = phases
    lasts_s = np.diff(np.append(run.t_s[begins], run.t_s[-1]))
    others = lasts_s[~brakes]
    energy_j = run.balance(front.section.vehicle, front.section.loss).input
    optimum_j = front.trajectory(run.time_s).balance.input
    return {
        "run": name,
        "changes": len(begins) - 1,
        "changes_per_min": 60.0 * (len(begins) - 1) / run.time_s,
        "shortest_s": float(others.min()) if len(others) else None,
        "time_s": run.time_s,
        "energy_kwh": kwh(energy_j),
        "more_kwh": kwh(energy_j - optimum_j),
        "more_ratio": (energy_j - optimum_j) / optimum_j if optimum_j > 0 else None,
    }


def _print_rows(title: str, rows: Sequence[dict[str, Any]], *, last: bool) -> None:
    """Print the runs of one buffer as a table, with a legend below the `last` table."""
    figures = ("price\ns", "chg", "/min", "short\ns", "time\ns", "energy\nkWh", "more\nkWh", "more\n%")
    table = new_table(title, (), figures)
    for run in rows:
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


def main(args: Sequence[str] | None = None) -> None:
    """Solve the section, and print a table for each buffer."""
    parser = ArgumentParser(prog="python -m docs.studies.few_switch", description=__doc__)
    add_section(parser)
    parser.add_argument("--buffers", type=float, nargs="+", default=BUFFERS_PERCENT, help="in %%")
    parser.add_argument("--prices", type=float, nargs="+", default=PRICES_S, help="in s of the train's full power")
    given = parser.parse_args(args)
    front = solve_front(section_of(given))
    fronts, least_s = few_switch_fronts(front.section, given.prices), front.fastest().time_s
    for buffer_percent in given.buffers:
        rows = list(few_switch_rows(front, fronts, least_s * (1.0 + buffer_percent / 100.0)))
        title = f"{front.section.name}, buffer {buffer_percent:g} %"
        _print_rows(title, rows, last=buffer_percent == given.buffers[-1])


if __name__ == "__main__":
    main()
