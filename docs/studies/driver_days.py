"""The driver data set of release 0.2: simulated drives, the only source of all tables about drivers.

`python -m docs.studies.driver_days` simulates the missing drives and writes docs/results/0.2/driver_days.csv, one row
for each drive, and the title of its page (242 drives, about ten minutes on two free cores). With `--persons` it writes
populations.csv, 30 persons of the default population in one scenario (a minute). Finished drives are stored in
build/driver-days: a stopped command continues from there, and only drives of another version of the program are
repeated. `python -m docs.studies.driver_tables` makes the tables.
"""

from __future__ import annotations

import argparse
import csv
import io
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

from das import __version__
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from das.domain.units import kmh
from docs.examples.weak_drivers import Belated, Doubting, Lazy, WeakBraking
from docs.studies.output import DOCS, plain, write_table
from precompute.workers import Workers
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass, Presentation
from sim.experiment.one_line import DaysAsked, row_of
from sim.experiment.runner import JobWords, Rows, Runner, TrialJob
from sim.experiment.trials import jobs_of, make_trial

FOLDER: Final = DOCS / "results" / "0.2"
TABLE: Final = FOLDER / "driver_days.csv"
PAGE: Final = FOLDER / "driver_days.md"
KEPT: Final = DOCS.parent / "build" / "driver-days"
SCENARIOS: Final = ("clear-day", "departure-delay", "signal-stop")
SEEDS: Final = tuple(range(8))
COMPARED: Final = (Presentation.NONE, Presentation.GUIDE)
EXAMPLES: Final = tuple(
    OwnClass(module=one.__module__, name=one.__name__) for one in (Lazy, Doubting, WeakBraking, Belated)
)
EXAMPLE_SEEDS: Final = SEEDS[:3]
FOLLOWED: Final = (Presentation.SPEED_AND_EFFORT, Presentation.GUIDE)
"""The presentations used by the perfect driver."""
PERFECT_SEEDS: Final = SEEDS[:1]

COLUMNS: Final = (
    *("scenario", "driver", "friction_policy", "advice", "seed"),
    *("late_s", "running_time_s", "energy_kwh", "energy_planned_kwh", "energy_optimum_kwh"),
    *("energy_blending_kwh", "energy_profile_kwh", "friction_brake_ratio", "not_comparable"),
    *("advice_changes_per_min", "reversals", "shortest_mode_s"),
    *("instructions", "shortest_instruction_s", "announced_ratio", "brakes_led_ratio", "promises_kept_ratio"),
    *("missed_coasts", "vain_accelerations", "odd_speeds", "hidden_limits", "last_word_acts", "availability_ratio"),
    *("over_limit_s", "over_limit_kmh", "above_limit_obeying_s", "signals_passed"),
)
"""The columns: the properties that identify a drive, and measures (docs/reference/measures.md)."""

PERSONS: Final = FOLDER / "populations.csv"
PERSON_NUMBERS: Final = tuple(range(1, 31))
PERSON_COLUMNS: Final = ("participant", "late_s", "energy_kwh", "energy_optimum_kwh")


def parts(seeds: Sequence[int] = SEEDS) -> Iterator[DaysAsked]:
    """The four parts: every presentation; none and guide, motors first; the example drivers; the perfect driver."""
    human, motors, clear = (DriverKind.HUMAN,), FrictionPolicy.ELECTRIC_FIRST, SCENARIOS[:1]
    yield DaysAsked(scenarios=SCENARIOS, drivers=human, advice=tuple(Presentation), seeds=seeds)
    yield DaysAsked(scenarios=SCENARIOS, drivers=human, advice=COMPARED, seeds=seeds, friction=motors)
    if few := tuple(seed for seed in seeds if seed in EXAMPLE_SEEDS):
        yield DaysAsked(scenarios=clear, drivers=EXAMPLES, advice=COMPARED, seeds=few)
    if one := tuple(seed for seed in seeds if seed in PERFECT_SEEDS):
        yield DaysAsked(scenarios=clear, drivers=(DriverKind.PERFECT,), advice=FOLLOWED, seeds=one)


def jobs(asked: DaysAsked) -> list[TrialJob]:
    """The drives of a part."""
    return jobs_of(asked.design(), KEPT)


def person_jobs(numbers: Sequence[int] = PERSON_NUMBERS) -> list[TrialJob]:
    """One drive of clear-day without advice for each person of the default population."""
    return jobs(
        DaysAsked(
            scenarios=SCENARIOS[:1], drivers=(DriverKind.HUMAN,), advice=(Presentation.NONE,), seeds=SEEDS[:1],
            participants=(numbers[0], len(numbers)),
        )
    )  # fmt: skip


def all_jobs() -> list[TrialJob]:
    """All drives, with half of the seeds first: a stopped command leaves drives that can be compared.

    Drives of one scenario are consecutive, because its plans are solved once for all of them.
    """
    half = len(SEEDS) // 2
    found: list[TrialJob] = []
    for seeds in (SEEDS[:half], SEEDS[half:]):
        some = (job for part in parts(seeds) for job in jobs(part))
        found += sorted(some, key=lambda job: SCENARIOS.index(row_of(job)["scenario"]))
    return found


def driven_row(job: TrialJob, measures: Mapping[str, Any]) -> dict[str, Any]:
    """The row of a drive: the properties that identify it, and its measures."""
    comparable = measures["above_optimum_kwh"] is not None
    return {
        **row_of(job),
        **measures,
        "over_limit_kmh": kmh(measures["over_limit_mps"]),
        "not_comparable": None if comparable else "not possible for the train, or no optimum",
    }


def rows_of(job_list: Sequence[TrialJob], finished: Rows, columns: Sequence[str] = COLUMNS) -> Iterator[dict[str, Any]]:
    """The rows of the table of all finished jobs, in the order of the jobs; DasError if one failed."""
    for job in job_list:
        row = finished.get(job.inputs_sha256)
        if row is None:
            continue
        if row.get("error") is not None:
            raise DasError(f"{job.trial.condition}, seed {job.trial.seed}: {row['error']}")
        whole = driven_row(job, row["measures"])
        yield {name: whole[name] for name in columns}


def csv_bytes(rows: Sequence[dict[str, Any]], columns: Sequence[str] = COLUMNS) -> bytes:
    """The rows as CSV: figures with seven digits, an empty cell for a missing one."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(plain(row) for row in rows)
    return text.getvalue().encode()


def facts(rows: Sequence[dict[str, Any]], of: int) -> Iterator[str]:
    """The title of the page, with the content of the data set and, after a stop, the number of missing drives."""
    found = subprocess.run(["git", "rev-parse", "HEAD"], cwd=DOCS, capture_output=True, text=True, check=False)
    seeds = sorted({row["seed"] for row in rows})
    made = f"{datetime.now(tz=UTC):%d %B %Y}".lstrip("0")
    yield (
        f"# Driver days of release {__version__}: {len(rows)} simulated drives, seeds {seeds[0]} to {seeds[-1]}, "
        f"commit {found.stdout[:8] or 'unknown'}, {made}"
    )
    if len(rows) < of:
        yield ""
        yield f"The command was stopped when {len(rows)} of {of} drives were finished: some means are of fewer drives."


def main(args: Sequence[str] | None = None) -> None:
    """Simulate the missing drives, and write the table and its facts."""
    parser = argparse.ArgumentParser(prog="python -m docs.studies.driver_days", description=__doc__)
    parser.add_argument("--workers", type=int, metavar="N", help="Number of processes; default: one for each core.")
    parser.add_argument("--persons", action="store_true", help="Simulate the persons of the population instead.")
    asked = parser.parse_args(args)
    wanted = person_jobs() if asked.persons else all_jobs()

    def write(finished: Rows, _: int) -> None:
        if asked.persons:
            write_whole(PERSONS, csv_bytes(list(rows_of(wanted, finished, PERSON_COLUMNS)), PERSON_COLUMNS))
            return
        rows = list(rows_of(wanted, finished))
        write_whole(TABLE, csv_bytes(rows))
        write_table(PAGE, "facts", facts(rows, len(wanted)))

    words = JobWords("driver-days", "drives", "make")
    try:
        Runner(make=make_trial, folder=KEPT, workers=Workers.asked(asked.workers), words=words).run(wanted, write)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
