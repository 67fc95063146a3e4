"""What the plan of a journey looks like as JSON, as a table in the terminal, and as a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from das.command_line.outputs import offscreen_pyplot, save_figure
from das.command_line.printing import print_table, tell
from das.domain.journey import Held, Window, clock
from das.domain.units import KM, KMH, KW, kmh, kwh
from das.solver.journey.plan import HopPlan, JourneyPlan, PlannedTime
from precompute.cli.report import ledger_kwh

MINUTE_S = 60.0
LEGEND = {
    "≥, ≤, =": "held at the earliest, the latest, the only time of a window",
    "run": "running time",
    "buffer": "running time above the least possible",
    "input": "net energy at the current collector",
    "λ": "price of time, what one second less would cost, between two points with a window",
}
_MARKS = {Held.FREE: " ", Held.EARLIEST: "≥", Held.LATEST: "≤", Held.FIXED: "="}


def as_json(plan: JourneyPlan, others_j: dict[str, float], solve_s: float) -> dict[str, Any]:
    """The plan as `--json` prints it; `others_j`: energy of other ways to keep the same windows, by name."""
    return {
        "journey": plan.journey.id,
        "time_s": plan.time_s,
        "energy_input_kwh": kwh(plan.input_j),
        "comfort_kwh": kwh(plan.comfort_j),
        "bound_kwh": _finite(kwh(plan.bound_j)),
        "table_bound_kwh": _finite(kwh(plan.table_bound_j)),
        "table_gap_ratio": _finite(plan.table_gap_ratio),
        "gap_ratio": _finite(plan.gap_ratio),
        "gap_reason": plan.gap_reason,
        "others_kwh": {name: kwh(energy_j) for name, energy_j in others_j.items()},
        "feasible": all(hop.feasible for hop in plan.hops),
        "solve_s": solve_s,
        "hops": [_hop_json(hop) for hop in plan.hops],
    }


def _hop_json(hop: HopPlan) -> dict[str, Any]:
    return {
        "from": hop.start.name,
        "to": hop.end.name,
        "departure": _timing_json(hop.departure),
        "arrival": _timing_json(hop.arrival),
        "time_s": hop.trajectory.time_s,
        "min_time_s": hop.least_time_s,
        "buffer_ratio": hop.buffer_ratio,
        "lambda_kw": [_finite(price_w / KW) for price_w in hop.lambda_w],
        "energy_input_kwh": kwh(hop.ledger.input),
        "ledger_kwh": ledger_kwh(hop.ledger),
        "feasible": hop.feasible,
        "passings": [
            {"name": x.passing.name, "s_m": x.passing.position_m, "speed_mps": x.speed_mps, **_timing_json(x.timing)}
            for x in hop.passings
        ],
    }


def _timing_json(timing: PlannedTime) -> dict[str, Any]:
    return {"time_s": timing.time_s, "held": str(timing.held)}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def print_plan(plan: JourneyPlan, title: str, others_j: dict[str, float]) -> None:
    """Hops and passings as a table, then the totals."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("section")
    for name in ("departs", "arrives", "km/h", "run\ns", "buffer\n%", "input\nkWh", "λ\nkW"):
        table.add_column(name, justify="right", no_wrap=True)
    for hop in plan.hops:
        table.add_row(
            f"{hop.start.name} – {hop.end.name}",
            _shown(hop.departure),
            _shown(hop.arrival),
            "",
            f"{hop.trajectory.time_s:.1f}",
            f"{100 * hop.buffer_ratio:.2f}",
            f"{kwh(hop.ledger.input):.2f}",
            "/".join(f"{price_w / KW:.0f}" if math.isfinite(price_w) else "∞" for price_w in hop.lambda_w),
        )
        for x in hop.passings:
            table.add_row(f"  {x.passing.name}", "", _shown(x.timing), f"{kmh(x.speed_mps):.1f}")
    print_table(table, LEGEND)
    for line in _totals(plan, others_j):
        tell(line)


def _shown(timing: PlannedTime) -> str:
    """A time, marked where it is held at a bound of its window."""
    return f"{_MARKS[timing.held]} {clock(timing.time_s)}"


def _totals(plan: JourneyPlan, others_j: dict[str, float]) -> Iterator[str]:
    gap = f", gap to the lower bound {100 * plan.gap_ratio:.3f} %" if math.isfinite(plan.gap_ratio) else ""
    yield f"in all {clock(plan.time_s)}, {kwh(plan.input_j):.2f} kWh{gap}"
    names = {"proportional": "with the same buffer everywhere", "fastest": "as fast as possible, waiting at the stops"}
    for name, energy_j in others_j.items():
        yield f"{names[name]}: {kwh(energy_j):.2f} kWh, the plan saves {100 * (1 - plan.input_j / energy_j):.2f} %"


def draw(path: Path, plan: JourneyPlan, title: str) -> None:
    """Draw speed with limit, and time with its windows, over the line."""
    pyplot = offscreen_pyplot()
    run, begin_s = plan.trajectory(), plan.hops[0].departure.time_s
    x_km = run.s_m / KM
    figure, (speed, time) = pyplot.subplots(2, 1, figsize=(12, 8), sharex=True, layout="constrained")
    speed.step(x_km[:-1], run.limit_mps / KMH, where="post", color="0.45", linewidth=1, label="limit over the train")
    speed.plot(x_km, run.v_mps / KMH, color="tab:blue", label="speed")
    speed.set_ylabel("speed, km/h")
    speed.set_ylim(bottom=0)
    speed.legend(loc="lower center", ncols=2)
    speed.set_title(f"{title}\n{clock(plan.time_s)}, {kwh(plan.input_j):.2f} kWh at the current collector")
    time.plot(x_km, (run.t_s - begin_s) / MINUTE_S, color="tab:blue", label="plan")
    for position_m, window, colour in _windows(plan):
        for marker, bound_s in (("^", window.earliest_s), ("v", window.latest_s)):
            if math.isfinite(bound_s):
                time.plot(position_m / KM, (bound_s - begin_s) / MINUTE_S, marker, color=colour, markersize=8)
    time.set_ylabel(f"min after {clock(begin_s)}")
    time.set_xlabel("position, km")
    time.set_title("▲ not before, ▼ not after (green: departure, red: arrival, orange: passing)", fontsize="small")
    save_figure(path, figure)
    pyplot.close(figure)


def _windows(plan: JourneyPlan) -> Iterator[tuple[float, Window, str]]:
    """Position, window and colour of everything that is timed."""
    for hop in plan.hops:
        yield hop.start.position_m, hop.start.departure, "tab:green"
        yield hop.end.position_m, hop.end.arrival, "tab:red"
        for x in hop.passings:
            yield x.passing.position_m, x.passing.window, "tab:orange"
