"""The command `das-precompute bench`."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.files import load_route, load_vehicle
from das.command_line.given import refuse_given
from das.command_line.options import JsonOption
from das.command_line.printing import busy, new_table, paragraph, print_table, shown
from precompute.cli.options import chosen

if TYPE_CHECKING:
    from das.solver.section import Section
    from precompute.bench.figures import Reference
    from precompute.bench.measuring import Figure

NAMES = (
    *("front", "steps", "transitions", "sweep", "trajectory", "re-solve", "look-up", "build", "exact"),
    *("growth", "memory"),
)
"""The figures, in order."""
WITH_LINES_OF_THEIR_OWN = frozenset({"build", "exact", "growth", "memory"})
"""Figures that are not of the reference section."""
ON_ONE_THREAD = frozenset({"transitions", "sweep", "trajectory"})
"""Figures that take one thread, however many there are."""
ROUTE, VEHICLE = "zurich-luzern", "re460-ic"
GIGA = 1e9
LEGEND = {
    "median, least, most": "of all rounds of the figure, in its unit",
    "baseline": "the median of the alternative that the figure is compared with; both are measured in turns",
    "× better": "how many times better than the baseline; below 1 it is worse",
    "of best %": "the share of what its arithmetic alone would allow; –: no such bound is known",
}


def bench(
    only: Annotated[
        str | None,
        typer.Option(help=f"Only these figures, separated by commas: {', '.join(NAMES)}.", show_default=False),
    ] = None,
    track: Annotated[
        str, typer.Option(help="Route; its longest section between two neighbouring stops is the reference section.")
    ] = ROUTE,
    train: Annotated[str, typer.Option(help="Vehicle of the reference section.")] = VEHICLE,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Threads of one front [default: the cores, at most 2].")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Short lines and few rounds, only to see whether the bench works.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Measure the solver's speed on this machine, and compare it with baselines and the machine's limits.

    Everything is measured in the same run. Each figure is a median, with the least and the most; a legend below the
    table explains its columns. It takes half a minute, and half a minute more the first time. Other work on the
    machine makes the figures worse, and the ratios less so.
    """
    wanted = chosen(only, NAMES, "figure")
    if WITH_LINES_OF_THEIR_OWN.issuperset(wanted):
        refuse_given(f"the figures of --only {only} have lines and trains of their own", "--track", "--train")
    if ON_ONE_THREAD.issuperset(wanted):
        refuse_given(f"the figures of --only {only} take one thread", "--threads")
    section = longest_section(track, train)
    began = time.perf_counter()
    result = measure(wanted, section, default_threads() if threads is None else threads, quick=quick)
    result["took_s"] = time.perf_counter() - began
    if as_json:
        print(json.dumps(result, ensure_ascii=False))
        return
    _print(result)


def default_threads() -> int:
    """The solver's default number of threads, or the number of cores if that is smaller."""
    from das.command_line.process import available_cores

    return min(available_cores(), 2)


def longest_section(track: str, train: str) -> Section:
    """The longest section of a route between two neighbouring stops."""
    from das.solver.section import build_section

    route, vehicle = load_route(track), load_vehicle(train)
    start, end = max(pairwise(route.stops), key=lambda pair: pair[1].position_m - pair[0].position_m)
    return build_section(route, vehicle, start_m=start.position_m, end_m=end.position_m)


def figures_by_name() -> dict[str, Callable[[Reference], Iterator[Figure]]]:
    """The function that measures each figure, by the figure's name; importing them takes a while."""
    from precompute.bench import figures, table_figures

    return {
        "front": figures.front_of_reference,
        "steps": figures.short_steps,
        "transitions": figures.transition_rate,
        "sweep": figures.sweep_rate,
        "trajectory": figures.trajectory,
        "re-solve": figures.resolve,
        "look-up": table_figures.look_up,
        "build": table_figures.build,
        "exact": figures.exact,
        "growth": figures.growth,
        "memory": figures.memory,
    }


def measure(wanted: list[str], section: Section, threads: int, *, quick: bool) -> dict[str, Any]:
    """Measure figures; returns what `--json` prints."""
    with busy("compiling the solver (about 10 s, and only the first time) …"):
        from das.solver.solve import solve_front
        from das.solver.warm_up import warm_up
        from precompute.bench.figures import FULL, QUICK, Reference, Workload
        from precompute.bench.measuring import Roofline, machine

        warm_up()
        by_name = figures_by_name()
    with busy("measuring the machine …"):
        one_thread = Roofline.measured()
        reference = Reference(
            section=section,
            front=solve_front(section),
            workload=Workload.of(section),
            effort=QUICK if quick else FULL,
            threads=threads,
            one_thread=one_thread,
            all_threads=one_thread.of_threads(threads),
        )
    figures = [figure for name in shown(wanted) for figure in by_name[name](reference)]
    return {
        "machine": machine(),
        "roofline": asdict(one_thread),
        "figures": [figure.as_json() for figure in figures],
    }


def _print(result: dict[str, Any]) -> None:
    about, best = result["machine"], result["roofline"]
    load = "" if about["load_average"] is None else f", load {about['load_average']:.1f}"
    paragraph(f"{about['cpu']}, {about['cores']} cores{load}, numba {about['numba']}, {about['date']}")
    table = new_table("", (), ())
    for name in ("figure", "median", "least", "most", "unit", "base-\nline", "×\nbetter", "of\nbest %"):
        table.add_column(name, justify="left" if name in ("figure", "unit") else "right", no_wrap=True)
    for figure in result["figures"]:
        table.add_row(
            figure["name"],
            *(_number(figure[key]) for key in ("value", "least", "most")),
            figure["unit"],
            *(_number(figure[key]) for key in ("baseline_value", "ratio")),
            "–" if figure["bound_ratio"] is None else _number(100 * figure["bound_ratio"]),
        )
    print_table(table, LEGEND)
    for figure in result["figures"]:
        paragraph(f"{figure['name']}: {figure['what']}; baseline: {figure['baseline']}", hanging="  ")
    rates = f"{best['flops'] / GIGA:.0f} GFlop/s, {best['divisions_ps'] / GIGA:.2f} G divisions/s"
    paragraph(f"one thread at best: {rates}")


def _number(value: float) -> str:
    if value >= 1000:
        return f"{value:.0f}"
    return f"{value:.3g}" if value >= 10 else f"{value:.2g}"
