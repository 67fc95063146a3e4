"""What few changes of the controller cost, as `das-precompute few-switch` finds it.

`python -m docs.studies.coach price` prints the table of docs/explanation/coach.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from das.command_line.files import load_route, load_vehicle
from das.domain.route import section_stops
from das.solver.section import build_section
from das.solver.solve import solve_front
from precompute.cli.few_switch import PRICES_S, few_switch_fronts, few_switch_rows, two_digits
from precompute.cli.options import numbers

BUFFERS_PERCENT: Final = (4.0, 7.0)


def price_table() -> Iterator[str]:
    """The lines of the table of what few changes cost from Zug to Luzern, as in `das-precompute few-switch`."""
    route = load_route("zurich-luzern")
    start, end = section_stops(route, "Zug", "Luzern")
    section = build_section(route, load_vehicle("re460-ic"), start_m=start.position_m, end_m=end.position_m)
    front = solve_front(section)
    least_s = front.fastest().time_s
    fronts = few_switch_fronts(section, numbers("--prices", PRICES_S))
    yield "| buffer | run | changes | a minute | shortest, s | time, s | kWh | more, kWh | more, % |"
    yield "|---:|---|---:|---:|---:|---:|---:|---:|---:|"
    for buffer_percent in BUFFERS_PERCENT:
        for found in few_switch_rows(front, fronts, least_s * (1.0 + buffer_percent / 100.0)):
            name = found["run"] if found["price_s"] is None else f"price {found['run']}"
            shortest = "–" if found["shortest_s"] is None else f"{found['shortest_s']:.1f}"
            yield (
                f"| {buffer_percent:g} % | {name} | {found['changes']} | {found['changes_per_min']:.2f} | "
                f"{shortest} | {found['time_s']:.1f} | {found['energy_kwh']:.2f} | "
                f"{two_digits(found['more_kwh'])} | {two_digits(100 * found['more_ratio'])} |"
            )


if __name__ == "__main__":
    for row in price_table():
        print(row)
