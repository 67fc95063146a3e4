"""Runs and journeys as JSON, as tables in the terminal and as pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from das.command_line.printing import new_table, print_table, tell
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.trajectory import Trajectory
from das.domain.units import KM, KMH, KW, in_kwh, kmh, kwh, kwh_figure, kwh_words
from das.drawing.plotted import PlottedFront, plotted_on
from das.offline.asked_journey import Held, clock
from das.offline.journey import JourneyPlan, JourneyPlanner, PassedAt, PlannedTime, SectionPlan
from das.solver.section import Section
from das.solver.solution import Solution
from precompute.baselines import Strategy
from precompute.baselines.strategies import Baseline

Answer = Solution | Baseline
"""A run: the optimal one, or a baseline strategy's."""


def solution_json(answer: Answer, min_time_s: float, solve_s: float) -> dict[str, Any]:
    """One run as the commands' `--json` prints it; figures that a strategy does not have are null."""
    return {
        "strategy": _strategy(answer),
        "min_time_s": min_time_s,
        "time_s": answer.time_s,
        "requested_time_s": answer.requested_s,
        "fit": str(answer.fit),
        "feasible": answer.feasible,
        "energy_kwh": kwh(answer.balance.input),
        "energy_irreversible_kwh": kwh(answer.balance.irreversible),
        "energy_stored_kwh": kwh(answer.balance.stored),
        "ledger_kwh": answer.balance.as_kwh(),
        "ledger_residual_ratio": answer.balance.residual_ratio,
        **_certified(answer),
        "solve_s": solve_s,
    }


def _strategy(answer: Answer) -> str:
    return str(answer.strategy if isinstance(answer, Baseline) else Strategy.OPTIMAL)


def _certified(answer: Answer) -> dict[str, Any]:
    if isinstance(answer, Baseline):
        return {
            **dict.fromkeys(("lambda_kw", "bound_kwh", "gap_ratio")),
            "gap_reason": "a strategy other than optimal has no certificate",
            "cruise_speed_mps": answer.cruise_speed_mps,
            "coasting_m": [list(pair) for pair in answer.coasting_m],
        }
    return {
        "lambda_kw": _finite(answer.lambda_w / KW),
        "bound_kwh": _finite(kwh(answer.bound_j)),
        "gap_ratio": _finite(answer.gap_ratio),
        "gap_reason": answer.gap_reason,
        **dict.fromkeys(("cruise_speed_mps", "coasting_m")),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory as CSV: one row per node (see `Trajectory.columns`); errors as in `whole_file`."""
    columns = trajectory.columns()
    lines = [",".join(columns)]
    lines += [",".join(f"{x + 0.0:.12g}" for x in row) for row in zip(*columns.values(), strict=True)]
    write_whole(path, ("\n".join(lines) + "\n").encode())


def draw_answer(path: Path, section: Section, answer: Answer) -> None:
    """Draw one run; the picture names its strategy."""
    from das.drawing.picture import draw_runs

    run = plotted_on(section, answer.trajectory).named(_strategy(answer))
    draw_runs([run]).save(path, overwrite=True)


def draw_front(path: Path, section: Section, solutions: Sequence[Solution]) -> None:
    """Draw the front through some solutions."""
    from das.drawing.picture import draw_fronts

    rising = sorted(solutions, key=lambda solution: solution.time_s)
    time_s = np.array([solution.time_s for solution in rising])
    front = PlottedFront(
        names=section.titles,
        buffer_percent=100.0 * (time_s / rising[0].least_time_s - 1.0),
        time_s=time_s,
        energy_j=np.array([solution.balance.input for solution in rising]),
        credit=section.route.credit,
    )
    draw_fronts([front]).save(path, overwrite=True)


LEGEND = {
    "buffer": "time above the least possible",
    "input": "net energy at the current collector = lost + stored",
    "lost": "irreversible losses",
    "stored": "increase of kinetic and potential energy",
    "saved": "energy below that of the first row",
    "λ": "price of time, the cost of one second less",
    "gap": "largest possible excess over the least energy; – if not proven",
    "ms": "computing time",
    "fit": "whether the requested time is met",
}


def print_solutions(title: str, results: list[dict[str, Any]]) -> None:
    """Print runs, as `solution_json` gives them, one per row; for several, also the savings relative to the first."""
    several = len(results) > 1
    energies = (*(f"{name}\nkWh" for name in ("input", "lost", "stored")), *(["saved\n%"] if several else []))
    table = new_table(title, (), ("time s", "buffer %", *energies, "λ kW", "gap %", "ms", "fit"))
    first = results[0]["energy_kwh"]
    for result in results:
        buffer = 100 * (result["time_s"] / result["min_time_s"] - 1)
        table.add_row(
            f"{result['time_s']:.1f}",
            f"{buffer:.2f}",
            in_kwh(result["energy_kwh"], finer=1),
            in_kwh(result["energy_irreversible_kwh"], finer=1),
            in_kwh(result["energy_stored_kwh"], signed=True, finer=1),
            *([f"{100 * (1 - result['energy_kwh'] / first):.1f}" if first else "–"] if several else []),
            _price(result),
            f"{100 * result['gap_ratio']:.3f}" if result["gap_ratio"] is not None else "–",
            f"{1e3 * result['solve_s']:.0f}",
            result["fit"],
        )
    print_table(table, LEGEND if several else {name: LEGEND[name] for name in LEGEND if name != "saved"})


def _price(result: dict[str, Any]) -> str:
    if result["strategy"] != Strategy.OPTIMAL:
        return "–"
    return f"{result['lambda_kw']:.0f}" if result["lambda_kw"] is not None else "∞"


def print_parameters(result: dict[str, Any]) -> None:
    """Print the cruising speed and the switching points of a baseline, if it has any."""
    if result["cruise_speed_mps"] is not None:
        print(f"holds {result['cruise_speed_mps'] / KMH:.1f} km/h")
    for start_m, end_m in result["coasting_m"] or ():
        print(f"coasts from km {start_m / KM:.3f} to km {end_m / KM:.3f}")


JOURNEY_LEGEND = {
    "≥, ≤, =": "held at the earliest, the latest or the only time of a window",
    "run": "running time",
    "buffer": "running time above the least possible",
    "input": "net energy at the current collector",
    "λ": "price of time, the cost of one second less, between two points with a window",
}
WISH_LEGEND = {"~, !": "a preferred time kept within its tolerance, or missed"}
_MARKS = {Held.FREE: " ", Held.EARLIEST: "≥", Held.LATEST: "≤", Held.FIXED: "="}


class MissedWish(NamedTuple):
    """A wish that a plan does not keep, and the energy (J) that keeping it would cost; NaN if it cannot be kept."""

    passed: PassedAt
    costs_j: float

    def words(self) -> str:
        """Words for the wish, the train's planned time, and the price of keeping the wish."""
        passing = self.passed.passing
        bounds = passing.window.earliest_s, passing.window.latest_s
        first, last = (clock(bound) if math.isfinite(bound) else "…" for bound in bounds)
        wished = first if first == last else f"{first} – {last}"
        late = f"{abs(self.passed.missed_s):.0f} s too {'late' if self.passed.missed_s > 0 else 'early'}"
        possible = f"keeping it would cost {kwh_words(self.costs_j, finer=1)}"
        price = "it cannot be kept between these stops" if math.isnan(self.costs_j) else possible
        planned = f"planned {clock(self.passed.timing.time_s)}, {late}"
        return f"wish {passing.name} {wished} (± {passing.tolerance_s:g} s): {planned}; {price}"

    def as_dict(self) -> dict[str, Any]:
        """The wish for programs; `costs_kwh` is None if it cannot be kept."""
        missed_s, costs_kwh = self.passed.missed_s, _finite(kwh(self.costs_j))
        return {"name": self.passed.passing.name, "missed_s": missed_s, "costs_kwh": costs_kwh}


def missed_wishes(planner: JourneyPlanner, plan: JourneyPlan) -> list[MissedWish]:
    """The wishes that a plan misses, each with its price, for the plan's times at the stops."""
    found = []
    for section in plan.sections:
        for passed in section.passings:
            if passed.missed_s:
                try:
                    found.append(MissedWish(passed, planner.wish_costs_j(section, passed)))
                except DasError:  # no run keeps the wish, or an earlier window excludes it
                    found.append(MissedWish(passed, math.nan))
    return found


def journey_json(
    plan: JourneyPlan, others_j: dict[str, float], missed: Sequence[MissedWish], solve_s: float
) -> dict[str, Any]:
    """The plan as `--json` prints it; `others_j` is the energy of other plans that keep the same windows, by name."""
    return {
        "journey": plan.journey.id,
        "time_s": plan.time_s,
        "energy_kwh": kwh(plan.input_j),
        "comfort_kwh": kwh(plan.comfort_j),
        "bound_kwh": _finite(kwh(plan.bound_j)),
        "gap_ratio": _finite(plan.gap_ratio),
        "gap_reason": plan.gap_reason,
        "others_kwh": {name: kwh(energy_j) for name, energy_j in others_j.items()},
        "feasible": all(section.feasible for section in plan.sections),
        "wishes_missed": [one.as_dict() for one in missed],
        "solve_s": solve_s,
        "hops": [_section_json(section) for section in plan.sections],
    }


def _section_json(section: SectionPlan) -> dict[str, Any]:
    return {
        "from": section.start.name,
        "to": section.end.name,
        "departure": _timing_json(section.departure),
        "arrival": _timing_json(section.arrival),
        "time_s": section.trajectory.time_s,
        "min_time_s": section.least_time_s,
        "buffer_ratio": section.buffer_ratio,
        "lambda_kw": [_finite(price_w / KW) for price_w in section.lambda_w],
        "energy_kwh": kwh(section.balance.input),
        "ledger_kwh": section.balance.as_kwh(),
        "feasible": section.feasible,
        "passings": [
            {
                "name": x.passing.name,
                "s_m": x.passing.position_m,
                "speed_mps": x.speed_mps,
                **_timing_json(x.timing),
                **({"wish": True, "missed_s": x.missed_s} if x.passing.wish else {}),
            }
            for x in section.passings
        ],
    }


def _timing_json(timing: PlannedTime) -> dict[str, Any]:
    return {"time_s": timing.time_s, "held": str(timing.held)}


def print_plan(plan: JourneyPlan, title: str, others_j: dict[str, float], missed: Sequence[MissedWish]) -> None:
    """Sections and passings as a table, then the totals and the wishes that are missed."""
    figures = ("departs", "arrives", "km/h", "run\ns", "buffer\n%", "input\nkWh", "λ\nkW")
    table = new_table(title, ("section",), figures)
    for section in plan.sections:
        table.add_row(
            f"{section.start.name} – {section.end.name}",
            _shown(section.departure),
            _shown(section.arrival),
            "",
            f"{section.trajectory.time_s:.1f}",
            f"{100 * section.buffer_ratio:.2f}",
            kwh_figure(section.balance.input, finer=1),
            "/".join(f"{price_w / KW:.0f}" if math.isfinite(price_w) else "∞" for price_w in section.lambda_w),
        )
        for x in section.passings:
            shown = f"{'!' if x.missed_s else '~'} {clock(x.timing.time_s)}" if x.passing.wish else _shown(x.timing)
            table.add_row(f"  {x.passing.name}", "", shown, f"{kmh(x.speed_mps):.1f}")
    wishes = any(passing.wish for passing in plan.journey.passings)
    print_table(table, JOURNEY_LEGEND | (WISH_LEGEND if wishes else {}))
    for line in (*_totals(plan, others_j), *(one.words() for one in missed)):
        tell(line)


def _shown(timing: PlannedTime) -> str:
    """A time as text, with a mark if it is at a bound of its window."""
    return f"{_MARKS[timing.held]} {clock(timing.time_s)}"


def _totals(plan: JourneyPlan, others_j: dict[str, float]) -> Iterator[str]:
    gap = f", gap to the lower bound {100 * plan.gap_ratio:.3f} %" if math.isfinite(plan.gap_ratio) else ""
    yield f"in total {clock(plan.time_s)}, {kwh_words(plan.input_j, finer=1)}{gap}"
    names = {"proportional": "with the same buffer everywhere", "fastest": "as fast as possible, waiting at the stops"}
    for name, energy_j in others_j.items():
        saved = f"{100 * (1 - plan.input_j / energy_j):.2f} %"
        yield f"{names[name]}: {kwh_words(energy_j, finer=1)}, the plan saves {saved}"
