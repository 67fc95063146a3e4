"""The tables that `das-precompute solve` and `front` print."""

from __future__ import annotations

from typing import Any

from rich import box
from rich.table import Table

from das.command_line.printing import print_table
from das.domain.units import KM, KMH
from precompute.baselines.strategy import Strategy

LEGEND = {
    "buffer": "time above the least possible",
    "input": "net energy at the current collector",
    "lost": "the part of it that never comes back",
    "saved": "energy below that of the first row",
    "λ": "price of time, what one second less would cost",
    "gap": "how far the energy can be above the least, at most; – where that is not proven",
    "ms": "computing time",
    "fit": "whether the time asked for was met",
}


def print_solutions(title: str, results: list[dict[str, Any]]) -> None:
    """Print runs, as `solution_json` gives them, one a row; savings are told against the first."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for name in ("time s", "buffer %", "input\nkWh", "lost\nkWh", "saved\n%", "λ kW", "gap %", "ms", "fit"):
        table.add_column(name, justify="right", no_wrap=True)
    first = results[0]["energy_input_kwh"]
    for result in results:
        buffer = 100 * (result["time_s"] / result["min_time_s"] - 1)
        table.add_row(
            f"{result['time_s']:.1f}",
            f"{buffer:.2f}",
            f"{result['energy_input_kwh']:.2f}",
            f"{result['energy_irreversible_kwh']:.2f}",
            f"{100 * (1 - result['energy_input_kwh'] / first):.1f}" if len(results) > 1 and first else "–",
            _price(result),
            f"{100 * result['gap_ratio']:.3f}" if result["gap_ratio"] is not None else "–",
            f"{1e3 * result['solve_s']:.0f}",
            result["fit"],
        )
    print_table(table, LEGEND if len(results) > 1 else {name: LEGEND[name] for name in LEGEND if name != "saved"})


def _price(result: dict[str, Any]) -> str:
    if result["strategy"] != Strategy.OPTIMAL:
        return "–"
    return f"{result['lambda_kw']:.0f}" if result["lambda_kw"] is not None else "∞"


def print_parameters(result: dict[str, Any]) -> None:
    """Print the cruising speed and the switching points of a baseline, where it has some."""
    if result["cruise_speed_mps"] is not None:
        print(f"holds {result['cruise_speed_mps'] / KMH:.1f} km/h")
    for start_m, end_m in result["coasting_m"] or ():
        print(f"coasts from km {start_m / KM:.3f} to km {end_m / KM:.3f}")
