"""The speed of the solver on this machine, as `das-precompute bench` measures it.

`python -m docs.studies.bench` writes the table into docs/reference/bench.md again (a minute on two cores that do
nothing else).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from docs.studies.output import DOCS, write_table
from precompute.bench.command import NAMES, ROUTE, VEHICLE, default_threads, longest_section, measure


def bench_table(result: Mapping[str, Any]) -> Iterator[str]:
    """The lines of the table, and the machine; `result` is what `das-precompute bench --json` prints."""
    yield "| figure | what | median (least … most) | baseline | its value | × better | of best |"
    yield "|---|---|---|---|---:|---:|---:|"
    for one in result["figures"]:
        best = "" if one["bound_ratio"] is None else f"{100.0 * one['bound_ratio']:.0f} %"
        value, least, most, baseline, ratio = (
            f"{one[key]:.3g}" for key in ("value", "least", "most", "baseline_value", "ratio")
        )
        cells = (one["name"], one["what"], f"{value} ({least} … {most}) {one['unit']}", one["baseline"], baseline)
        yield f"| {' | '.join(cells)} | {ratio} | {best} |"
    about = result["machine"]
    names = ", ".join(f"{name} {about[name]}" for name in ("python", "numpy", "numba"))
    load = "" if about["load_average"] is None else f" with a load of {about['load_average']:.1f}"
    yield ""
    yield f"{about['cpu']}, {about['cores']} cores{load}, {names}, {about['date'][:10]}."


def main() -> None:
    """Measure, and write the table again."""
    result = measure(list(NAMES), longest_section(ROUTE, VEHICLE), default_threads(), quick=False)
    write_table(DOCS / "reference" / "bench.md", "bench", bench_table(result))


if __name__ == "__main__":
    main()
