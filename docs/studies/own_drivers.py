"""What advice is worth to the example drivers of `sim/drivers/examples.py`, on the same days with and without it.

`python -m docs.studies.own_drivers` writes the table into docs/explanation/coach.md again (180 runs, half an hour on
two busy cores). Finished runs are kept in build/own-drivers: the command goes on where it was stopped, and makes runs
again only where the program has changed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from docs.studies.output import DOCS, write_table
from precompute.workers import Workers
from sim.drivers.examples import Belated, Doubting, Lazy, WeakBraking
from sim.drivers.kinds import OwnClass, Presentation
from sim.jobs.batch import Batch, make_run
from sim.jobs.report import with_interval
from sim.jobs.runner import JobWords, Runner

DRIVERS: Final = tuple(
    OwnClass(module=one.__module__, name=one.__name__) for one in (Lazy, Doubting, WeakBraking, Belated)
)
DAYS: Final = ("clear-day", "restriction-ahead", "departure-delay")
SHOWN: Final = (Presentation.NONE, Presentation.COACH, Presentation.VECTOR)
SEEDS: Final = tuple(range(5))
FOLDER: Final = DOCS.parent / "build" / "own-drivers"

Row = Mapping[str, Any]


def asked(folder: Path = FOLDER, days: Sequence[str] = DAYS, seeds: Sequence[int] = SEEDS) -> Batch:
    """The runs of the table."""
    return Batch(scenarios=days, drivers=DRIVERS, advice=SHOWN, seeds=seeds, level=None, record=False, folder=folder)


def driven_rows(batch: Batch, workers: int | None = None) -> list[Row]:
    """The rows of all runs, as in the table of `das-sim batch`, driver by driver; DasError if one failed.

    Finished runs are kept in the folder of the batch.
    """
    jobs = list(batch.jobs())
    found: list[Row] = []
    words = JobWords(batch.folder.name, "runs", "make")
    runner = Runner(make=make_run, folder=batch.folder, workers=Workers.asked(workers), words=words)
    runner.run(jobs, lambda rows, _: found.extend(rows[job.inputs_sha256] for job in jobs if job.inputs_sha256 in rows))
    for row in found:
        if row.get("error") is not None:
            raise DasError(f"{row['scenario']}, {row['driver']}, seed {row['seed']}: {row['error']}")
    return found


def own_drivers_table(rows: Sequence[Row]) -> Iterator[str]:
    """The lines of the table: a driver, a day and what was shown, as means over the seeds.

    Of what a driver takes less with advice, `energy_optimum_kwh` is due to other running times; the rest is saved by
    advice, `energy_blending_kwh` of it by less friction braking where the motors could brake.
    """
    yield (
        "| driver | day | shown | kWh | less, kWh | % | by running times | by less friction | late, s | "
        "changes a minute | above limits, s |"
    )
    yield "|---|---|---|---:|---:|---:|---:|---:|---:|---:|---:|"
    groups: dict[tuple[str, str, str], dict[int, Row]] = {}
    for row in rows:
        groups.setdefault((row["driver"], row["scenario"], row["advice"]), {})[row["seed"]] = row
    days = dict.fromkeys(row["scenario"] for row in rows)
    for driver, day, shown in product(map(str, DRIVERS), days, SHOWN):
        yield _line((driver, day, shown), groups[driver, day, shown], groups[driver, day, Presentation.NONE])


def _line(names: tuple[str, str, str], runs: Mapping[int, Row], alone: Mapping[int, Row]) -> str:
    """The line of some runs, compared with those without advice on the same days; both by seed."""

    def less(name: str) -> np.ndarray:
        return np.array([alone[seed][f"energy_{name}kwh"] - row[f"energy_{name}kwh"] for seed, row in runs.items()])

    saved, changes = [""] * 4, ""
    if runs is not alone:
        percent = 100.0 * less("").mean() / _mean(alone, "energy_kwh")
        parts = (less("optimum_").mean(), less("blending_").mean())
        saved = [with_interval(less("")), *(f"{value:+.1f}" for value in (percent, *parts))]
        changes = f"{_mean(runs, 'advice_changes_per_min'):.1f}"
    late, over = f"{round(_mean(runs, 'late_s')):+d}", f"{_mean(runs, 'over_limit_s'):.1f}"
    cells = [names[0].partition(":")[2], *names[1:], f"{_mean(runs, 'energy_kwh'):.1f}", *saved, late, changes, over]
    return f"| {' | '.join(cells)} |"


def _mean(runs: Mapping[int, Row], name: str) -> float:
    return float(np.mean([row[name] for row in runs.values()]))


if __name__ == "__main__":
    write_table(DOCS / "explanation" / "coach.md", "own-drivers", own_drivers_table(driven_rows(asked())))
