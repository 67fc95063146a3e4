"""What calm costs, as `das-precompute calm` finds it, as the table of docs/explanation/coach.md."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from das.command_line.loading import load_route, load_vehicle
from das.domain.route import section_stops
from das.solver.calm.calm import solve_calm
from das.solver.calm.settings import CalmSettings
from das.solver.section import Section, build_section
from das.solver.solve import solve_front
from precompute.cli.calm import PRICES_S, calm_rows

BUFFERS_PERCENT: Final = (4.0, 7.0)


def zug_luzern() -> Section:
    """The section of the table."""
    route = load_route("zurich-luzern")
    start, end = section_stops(route, "Zug", "Luzern")
    return build_section(route, load_vehicle("re460-ic"), start_m=start.position_m, end_m=end.position_m)


def price_table(section: Section, buffers_percent: tuple[float, ...] = BUFFERS_PERCENT) -> Iterator[str]:
    """The lines of the table, in Markdown, as they are found."""
    front = solve_front(section)
    least_s = front.fastest().time_s
    prices = [float(price) for price in PRICES_S.split(",")]
    calms = [(price, solve_calm(section, CalmSettings(change_s=price))) for price in prices]
    yield "| buffer | run | changes | a minute | shortest, s | time, s | kWh | more, kWh | more, % |"
    yield "|---:|---|---:|---:|---:|---:|---:|---:|---:|"
    for buffer_percent in buffers_percent:
        for row in calm_rows(front, calms, least_s * (1.0 + buffer_percent / 100.0)):
            found = row.as_dict()
            name = row.name if row.price_s is None else f"price {row.name}"
            yield (
                f"| {buffer_percent:g} % | {name} | {row.changes} | {found['changes_per_min']:.2f} | "
                f"{row.shortest_s:.1f} | {row.time_s:.1f} | {found['energy_kwh']:.2f} | "
                f"{round(found['more_kwh'], 2) + 0.0:.2f} | {round(100 * found['more_ratio'], 2) + 0.0:.2f} |"
            )
