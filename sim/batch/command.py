"""The command `das-sim batch`: many days in closed loop, on all cores, into one table."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.entry import STOP_SIGNALS
from das.command_line.printing import busy
from das.command_line.running import interrupt_on_termination, signals_held
from das.domain.errors import DasError
from das.domain.losses import Level
from sim.cli.shared import Kind, chosen, progress_bar

if TYPE_CHECKING:
    from sim.batch.journal import Journal
    from sim.batch.plan import Job

TABLE = "runs.parquet"


def batch(
    scenarios: Annotated[list[str], typer.Argument(help="Bundled scenarios or TOML files.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder of the results.")],
    seeds: Annotated[str, typer.Option(help="Seeds, like 0-99 or 1,5,10-19.")] = "0-9",
    drivers: Annotated[str, typer.Option(help="Drivers (see das-sim run), with commas between.")] = "human",
    advice: Annotated[str, typer.Option(help="What is shown (see das-sim run), with commas between.")] = "vector",
    level: Annotated[Level | None, typer.Option(help="Loss level [default: the vehicle's].")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes [default: one a core].", min=1, max=1024)] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Run over the bus and keep the recordings (slower).")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
) -> None:
    """Run every scenario with every driver, presentation and seed; a batch that was stopped goes on where it was.

    Writes the table runs.parquet into the folder, one row a run; runs are made again only where an input has changed.
    """
    with busy("reading the scenarios …"):
        from sim.batch.journal import Journal
        from sim.batch.plan import Batch, parse_seeds
        from sim.batch.report import print_summary, summary
        from sim.batch.table import require_pyarrow, write_table
        from sim.batch.worker import recorded
        from sim.drivers.cab import Presentation
        from sim.drivers.registry import DriverKind

        require_pyarrow()
        asked = Batch(
            scenarios=scenarios,
            drivers=_each(DriverKind, "--drivers", drivers),
            advice=_each(Presentation, "--advice", advice),
            seeds=parse_seeds(seeds),
            level=level,
            record=record,
            folder=out,
        )
        jobs = list(asked.jobs())
        _make_folders(out, record)
    with Journal(out) as journal:
        left = [job for job in jobs if not _good(journal, job) or not recorded(job)]
        interrupt_on_termination()
        try:
            _work(left, len(jobs), workers or os.cpu_count() or 1, journal)
        except KeyboardInterrupt:
            done = sum(_good(journal, job) for job in jobs)
            print(f"{done} of {len(jobs)} runs are finished; the same command goes on from there", file=sys.stderr)
            raise
        finally:
            finished = [journal.rows[job.inputs_sha256] for job in jobs if job.inputs_sha256 in journal.rows]
            write_table(out / TABLE, finished)
    found = {"file": str(out / TABLE), "runs": len(jobs), "made": len(left), "groups": summary(finished)}
    if as_json:
        print(json.dumps(found))
    else:
        print_summary(found)
    failed = sum(row.get("error") is not None for row in finished)
    if failed:
        print(f"{failed} of {len(jobs)} runs failed: see the column error of {out / TABLE}", file=sys.stderr)
        raise typer.Exit(1)


def _good(journal: Journal, job: Job) -> bool:
    """Whether a run is finished; one that failed is tried again."""
    row = journal.rows.get(job.inputs_sha256)
    return row is not None and row.get("error") is None


def _each(kind: type[Kind], option: str, text: str) -> list[Kind]:
    return list(dict.fromkeys(chosen(kind, option, part.strip()) for part in text.split(",")))


def _make_folders(out: Path, record: bool) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
        if record:
            (out / "recordings").mkdir(exist_ok=True)
    except OSError as error:
        raise DasError(f"{out}: cannot be made ({error.strerror})") from error


def _work(left: Sequence[Job], of: int, workers: int, journal: Journal) -> None:
    """Run what is left, on all workers, and note each run as it ends."""
    if not left:
        return
    done = of - len(left)
    with progress_bar("batch", f"{len(left)} of {of} runs to make", "runs") as progress:
        for row in _results(left, min(workers, len(left))):
            journal.add(row)
            done += 1
            progress(done, of)


def _results(left: Sequence[Job], workers: int) -> Iterator[dict[str, Any]]:
    """Rows as they are finished; when it is stopped, those of the runs under way as well."""
    from sim.batch.worker import begin

    # Not forked: the solver's threads would not survive it.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=begin, initargs=(os.getpid(),))
    running: set[Future[dict[str, Any]]] = set()
    waiting = iter(left)
    try:
        while True:
            _submit(pool, islice(waiting, workers - len(running)), running)
            if not running:
                return
            finished, still = wait(running, return_when=FIRST_COMPLETED)
            running.intersection_update(still)
            yield from (future.result() for future in finished)
    except BrokenProcessPool:
        raise DasError("a worker of the batch was killed (out of memory?); the same command goes on") from None
    except KeyboardInterrupt:
        with contextlib.suppress(BrokenProcessPool):
            yield from (future.result() for future in running)
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _submit(pool: ProcessPoolExecutor, jobs: Iterable[Job], running: set[Future[dict[str, Any]]]) -> None:
    """Hand jobs to the pool, which may start workers: Ctrl-C waits, or it would kill one that does not heed it yet."""
    from sim.batch.worker import work

    with signals_held(STOP_SIGNALS):
        running.update(pool.submit(work, job) for job in jobs)
