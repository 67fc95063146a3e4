"""The commands `das-precompute build` and `verify`, and the output of `show` for tables."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from das.command_line.files import warn_unusual
from das.command_line.options import JsonOption
from das.command_line.printing import busy, new_table, print_table, progress_bar, shown
from das.domain.errors import DasError
from das.domain.units import KM, MEGABYTE, in_kwh, kwh
from precompute.cli.options import RefineOption, is_refined
from precompute.workers import Workers

if TYPE_CHECKING:
    from rich.table import Table as PrintedTable

    from das.table import Table

EXIT_SOME_FAILED = 1
LEGEND = """\
least s: the least running time; refs: finished references for the cab.
kWh: net energy at the current collector of the first and of the last run of the
  front, which is mostly the one of least energy.
gap %: largest excess of a run's energy over the least possible, of the runs
  for which the build proved it. –: none was proven.
refined: by how much the refinement lowered the energy of the runs, on average
  in %. –: they were not refined."""


def build(
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Routes × trains × loads × levels.")],
    folder: Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder of tables; it is created.")],
    workers: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Processes [default: one a core].", show_default=False)
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Solve on this Dask cluster.", show_default=False)
    ] = None,
    refine: RefineOption = "on",
    as_json: JsonOption = False,
) -> None:
    """Solve every section of a plan into a table for the cab.

    A table that is already there is kept if it is whole and neither an input nor the method has changed. A build that
    was stopped continues where it ended. A section that fails is reported and does not stop the rest; the exit code is
    then 1. DIR/build.json has the outcome of each section.

    A table holds the guide's finished references for departures, which take most of the time, and the front of time and
    energy. By default the front is refined, which takes 2 to 3 s a section.
    """
    hands = Workers.asked(workers, scheduler)
    with busy("reading the plan …"):
        from precompute.tables.build import build as build_plan
        from precompute.tables.plan import read_plan

        wanted = read_plan(plan, refined=is_refined(refine))
    warn_unusual(*{job.route.source: job.route for job in wanted.jobs}.values())
    done = count(1)
    with progress_bar("building", f"{len(wanted.jobs)} sections", "sections") as show:
        report = build_plan(wanted, folder, hands, lambda _outcome: show(next(done), len(wanted.jobs)))
    if as_json:
        print(json.dumps(report, ensure_ascii=False))
    else:
        for section in report["sections"]:
            if section["reason"]:
                print(f"{section['name']}: {section['status']}: {section['reason']}")
        counts = ", ".join(f"{count} {status}" for status, count in report["counts"].items() if count)
        size_mb = sum(section["size_bytes"] or 0 for section in report["sections"]) / MEGABYTE
        print(f"{folder}: {counts or 'nothing to do'} ({size_mb:.1f} MB, {report['seconds']:.1f} s)")
    if report["counts"]["failed"] or report["counts"]["poison"]:
        raise typer.Exit(EXIT_SOME_FAILED)


def verify(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of tables, or one table.")],
    as_json: JsonOption = False,
) -> None:
    """Check tables: every byte, compatibility with this release, and completeness.

    The exit code is 1 if a table is damaged, missing, or of another release.
    """
    from precompute.tables.build import REPORT, missing_tables, table_files

    paths, missing = table_files(folder), missing_tables(folder)
    if not paths and not missing:
        raise DasError(f"{folder}: no tables in it")
    results: list[dict[str, Any]] = [
        {"name": name, "size_bytes": 0, "problem": f"{folder / name}: is missing ({REPORT} lists it)"}
        for name in missing
    ]
    began = time.perf_counter()
    for path, table, problem in _checked(paths):
        results.append({"name": path.name, "size_bytes": path.stat().st_size if table else 0, "problem": problem})
    seconds, damaged = time.perf_counter() - began, [result for result in results if result["problem"]]
    if as_json:
        print(json.dumps({"tables": results, "damaged": len(damaged), "seconds": seconds}, ensure_ascii=False))
    else:
        for result in damaged:
            print(result["problem"])
        size_mb = sum(result["size_bytes"] for result in results) / MEGABYTE
        print(f"{len(results) - len(damaged)} of {len(results)} tables are whole ({size_mb:.1f} MB in {seconds:.1f} s)")
    if damaged:
        raise typer.Exit(EXIT_SOME_FAILED)


def print_tables(folder: Path, *, as_json: bool) -> None:
    """Print the content of tables in a folder, or of one: sections, trains, sizes, times, energies and certificates.

    Each table is checked first; those with problems are listed last. JSON has all points of the fronts and the times
    and energies of all references. Raises DasError if there is no table.
    """
    from precompute.tables.build import table_files

    paths = table_files(folder)
    if not paths:
        raise DasError(f"{folder}: no tables in it")
    rows: list[dict[str, Any]] = [
        _facts(table) if table else {"name": path.name, "problem": problem, "size_bytes": 0}
        for path, table, problem in _checked(paths)
    ]
    size_bytes, problems = sum(row["size_bytes"] for row in rows), [row["problem"] for row in rows if row["problem"]]
    if problems and not folder.is_dir():
        raise DasError(problems[0])
    if as_json:
        print(json.dumps({"tables": rows, "size_bytes": size_bytes}, ensure_ascii=False))
    else:
        if whole := [row for row in rows if not row["problem"]]:
            print(folder)
            print_table(_printed(whole))
            print(LEGEND)
        print(*problems, f"{len(rows)} tables, {size_bytes / MEGABYTE:.1f} MB", sep="\n")
    if problems:
        raise typer.Exit(EXIT_SOME_FAILED)


def _checked(paths: Sequence[Path]) -> Iterator[tuple[Path, Table | None, str | None]]:
    """Each file with its table if that is whole and of this release; else with a description of the fault."""
    from das.table import Table, TableError

    for path in shown(paths, lambda path: path.name):
        if path.is_dir():
            earlier = "a table of an earlier release, which is not supported; remove it and build it again"
            yield path, None, f"{path}: {earlier}"
            continue
        try:
            yield path, Table.read(path), None
        except TableError as error:
            yield path, None, str(error)


def _facts(table: Table) -> dict[str, Any]:
    """The output of `show` for a table; energies at the collector (kWh)."""
    front, references = table.front, table.references.finished
    gaps = [one["gap_ratio"] for one in front if one["gap_ratio"] is not None]
    saved = [one["refinement_saved_j"] / max(abs(one["energy_input_j"]), 1.0) for one in front]
    return {
        "name": table.path.name,
        "problem": None,
        **table.facts,
        "size_bytes": table.path.stat().st_size,
        "least_time_s": table.least_time_s,
        "first_energy_kwh": kwh(front[0]["energy_input_j"]),
        "last_energy_kwh": kwh(front[-1]["energy_input_j"]),
        "largest_gap_ratio": max(gaps, default=None),
        "gaps_proven": len(gaps),
        "refine": table.settings["refine"],
        "refinement_saved_ratio": sum(saved) / len(saved),
        "front": front,
        "references": [{"time_s": x.time_s, "energy_j": x.energy_j, "phases": len(x.phases)} for x in references],
    }


def _printed(rows: list[dict[str, Any]]) -> PrintedTable:
    """The output of `show`, at most 80 columns wide unless names are long; a row has two or three lines."""
    figures = ("\nkm", "least\ns", "\nrefs", "kWh\nfirst", "kWh\nlast", "refined\n%", "gap\n%", "\nMB")
    printed = new_table("", ("route, section\ntrain, level",), figures)
    for row in rows:
        gap = row["largest_gap_ratio"]
        ends = f"{row['from']} – {row['to']}"
        printed.add_row(
            # Names come from a file: markup in them is printed literally.
            Text(f"{row['route']}\n{ends}\n{row['train']}, {row['level']}"),
            f"{(row['end_m'] - row['start_m']) / KM:.1f}",
            f"{row['least_time_s']:.1f}",
            f"{len(row['references'])}",
            in_kwh(row["first_energy_kwh"], finer=1),
            in_kwh(row["last_energy_kwh"], finer=1),
            f"{100 * row['refinement_saved_ratio']:.2f}" if row["refine"] != "off" else "–",
            f"{100 * gap:.3f}" if gap is not None else "–",
            f"{row['size_bytes'] / MEGABYTE:.2f}",
        )
    return printed
