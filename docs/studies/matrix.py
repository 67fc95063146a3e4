"""`python -m docs.studies.matrix [--cells N] [--first N] [--seeds N] [--workers N] [--write]`: any train on any line.

It simulates cells of the matrix (line, train, driver, seed) and prints the bounds and the means of every line. With
--write it writes the title of docs/results/0.2/matrix.md and the CSV files next to it; with --seeds, the human driver's
cells with several seeds, as matrix-seeds.csv. 100 cells take ten minutes of CPU time; cells of public data sets need
../shared/data.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from das import __version__
from docs.studies.output import DOCS, plain, write_csv, write_table
from tests.support.matrix import ADVISED, Judged, bounds_table, judged, lines_table, seeds_table
from tests.support.matrix_lines import Cell, Who, cells

PAGE: Final = DOCS / "results" / "0.2" / "matrix.md"


def driven(cell: Cell) -> Judged:
    """The assessment of one cell."""
    with tempfile.TemporaryDirectory() as folder:
        return judged(cell, Path(folder))


def facts(rows: Sequence[Judged]) -> Iterator[str]:
    """The title of the page: the simulated cells, the commit and the date."""
    found = subprocess.run(["git", "rev-parse", "HEAD"], cwd=DOCS, capture_output=True, text=True, check=False)
    pairs, seeds = {(row.line, row.train) for row in rows}, sorted({row.seed for row in rows})
    which = f"seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"seed {seeds[0]}"
    made = f"{datetime.now(tz=UTC):%d %B %Y}".lstrip("0")
    yield (
        f"# Any train on any line, release {__version__}: {len(rows)} cells, {len(pairs)} lines with a train, "
        f"{which}, advice {ADVISED}, commit {found.stdout[:8] or 'unknown'}, {made}"
    )


def write(rows: Sequence[Judged]) -> None:
    """Write the tables of the page and the rows."""
    with PAGE.with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(Judged.columns())
        out.writerows(plain(row.as_row()) for row in rows)
    write_table(PAGE, "facts", facts(rows))
    write_csv(PAGE.with_name("matrix-bounds.csv"), bounds_table(rows))


def main(args: Sequence[str] | None = None) -> None:
    """Simulate the cells, and print or write their tables."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.matrix", description=__doc__)
    parser.add_argument("--cells", type=int, default=100, metavar="N", help="Number of cells.")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="Number of the first cell.")
    parser.add_argument("--seeds", type=int, metavar="N", help="Only the human driver, with this number of seeds.")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="Number of processes.")
    parser.add_argument("--write", action="store_true", help="Write the files of the release.")
    asked = parser.parse_args(args)
    rows, chosen = [], cells(asked.cells, asked.first)
    if asked.seeds is not None:
        humans = dict.fromkeys(cell._replace(seed=0) for cell in chosen if cell.who is Who.HUMAN)
        chosen = [cell._replace(seed=seed) for cell in humans for seed in range(asked.seeds)]
    with ProcessPoolExecutor(asked.workers) as pool:
        for row in pool.map(driven, chosen):
            rows.append(row)
            print(f"{row.line}, {row.train}, {row.who}, seed {row.seed} {row.said}", file=sys.stderr, flush=True)
    if asked.write and asked.seeds is None:
        write(rows)
    elif asked.write:
        write_csv(PAGE.with_name("matrix-seeds.csv"), seeds_table(rows))
    elif asked.seeds is None:
        print(*bounds_table(rows), "", *lines_table(rows), sep="\n")
    else:
        print(*seeds_table(rows), sep="\n")


if __name__ == "__main__":
    main()
