"""The trials of a design, each with participant, condition, position and simulated day; and their execution.

`run_study` drives all unfinished trials, on all workers, and writes the files of the study's folder.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from threading import Lock
from typing import Any, Final

import numpy as np

from das import __version__
from das.domain.errors import DasError
from das.domain.files.writing import write_whole
from precompute.workers import Workers, source_sha256
from sim.drivers.kinds import Presentation
from sim.drivers.parameters import load_population
from sim.experiment.design import Chances, ConditionOrder, Days, Design
from sim.experiment.driving import LINES_KEPT, StudyTrial, drive
from sim.experiment.factors import FactorLevel, setting_files
from sim.experiment.measures import MEASURES, measured, needs_table
from sim.experiment.runner import JobWords, Rows, Runner, TrialJob
from sim.experiment.study_files import (
    FAILED_TABLE,
    README,
    TRIALS_TABLE,
    readme,
    recording_file,
    table_text,
    trials_table,
)
from sim.recording.opening import sha256
from sim.world.service import PLANNED

ORDER_STREAM: Final = 1
"""Number of the stream of a design's seed from which orders are drawn."""
DAY_STREAM: Final = 2
"""Number of the stream of a design's seed from which the seeds of days are drawn."""
EVERYBODY: Final = 2**32 - 1
"""Replacement for the participant's number if all participants drive the same days."""


def trials_of(design: Design) -> list[StudyTrial]:
    """All trials, sorted by participant and then by position."""
    found: list[StudyTrial] = []
    for who in range(design.people.count):
        found += _of_participant(design, who, len(found))
    return found


def _of_participant(design: Design, who: int, before: int) -> Iterator[StudyTrial]:
    groups = design.conditions(within=False)
    between, row = groups[who % len(groups)], who // len(groups)
    inside = design.conditions(within=True)
    people, procedure = design.people, design.procedure
    orders = [
        order_of(procedure.order, len(inside), row * procedure.repetitions + turn, (design.seed, who, turn))
        for turn in range(procedure.repetitions)
    ]
    planned = _practice(design, between) + [(number, turn) for turn, order in enumerate(orders) for number in order]
    for place, (number, turn) in enumerate(planned):
        condition = between | inside[number]
        yield StudyTrial(
            number=before + place + 1,
            who=who + 1,
            person=None if people.average else people.first + who,
            session=1 + (place // procedure.break_after if procedure.break_after else 0),
            position=place + 1,
            practice=turn < 0,
            levels=tuple(condition[factor.name].text for factor in design.factors),
            setting=design.setting(condition),
            seed=_day_seed(design, who, turn),
            chance=place if procedure.chances is Chances.NEW else 0,
            trips=people.trips_before + place if people.learning else None,
        )


def _practice(design: Design, between: dict[str, FactorLevel]) -> list[tuple[int, int]]:
    """The condition and the turn (negative) of each practice trial of a group of participants.

    Each presentation that they meet is practised once before one is repeated, in the first condition that has it; those
    with advice come last, and the last of all is the first of them in the design.
    """
    if not (count := design.procedure.practice_trials):
        return []
    shown = [design.setting(between | one).presentation for one in design.conditions(within=True)]
    first = {one: shown.index(one) for one in shown}.values()
    met = sorted(first, key=lambda i: (shown[i] is Presentation.NONE, i))
    return [(met[i % len(met)], -1 - i // len(met)) for i in reversed(range(count))]


def _day_seed(design: Design, who: int, turn: int) -> int:
    """The seed of a trial's day, below 2**31; `turn` is the repetition, negative for practice."""
    days, seeds = design.procedure.days, design.procedure.seeds
    if seeds and turn >= 0:
        return seeds[turn]
    key = (EVERYBODY if days is Days.COMMON else who, 1 + 2 * turn if turn >= 0 else -2 * turn, 0)
    drawn = np.random.SeedSequence([design.seed, DAY_STREAM], spawn_key=key)
    return int(drawn.generate_state(1)[0] >> 1)


def imbalances(design: Design, trials: Sequence[StudyTrial]) -> list[str]:
    """A sentence for each imbalance: groups of unequal size, orders or conditions that are not used equally often."""
    found = []
    groups = len(design.conditions(within=False))
    if design.people.count % groups:
        found.append(f"{design.people.count} participants cannot be divided equally among {groups} groups")
    conditions = len(design.conditions(within=True))
    turns = -(-design.people.count // groups) * design.procedure.repetitions
    count = order_count(design.procedure.order, conditions)
    if conditions > 1 and count is not None and count > 1 and turns % count:
        found.append(f"{turns} orders in each group, expected a multiple of {count} for order {design.procedure.order}")
    uneven = set(Counter(trial.condition for trial in trials if not trial.practice).values())
    if len(uneven) > 1:
        found.append(f"conditions have between {min(uneven)} and {max(uneven)} trials")
    return found


def order_count(order: ConditionOrder, conditions: int) -> int | None:
    """The number of different orders, after which they repeat (each repetition of a participant takes one); None if
    orders are drawn at random."""
    if order is ConditionOrder.WILLIAMS:
        return conditions * (1 if conditions % 2 == 0 or conditions == 1 else 2)
    return 1 if order is ConditionOrder.LISTED else None


def order_of(order: ConditionOrder, conditions: int, row: int, seed: Sequence[int]) -> list[int]:
    """The order of a participant: the numbers of the conditions, from 0.

    `row` counts all orders before it: the orders of other participants and of earlier repetitions. `seed` seeds an
    order drawn at random.
    """
    if order is ConditionOrder.RANDOM:
        return [int(one) for one in np.random.default_rng([*seed, ORDER_STREAM]).permutation(conditions)]
    if order is ConditionOrder.LISTED:
        return list(range(conditions))
    rows = williams(conditions)
    return rows[row % len(rows)]


def williams(count: int) -> list[list[int]]:
    """The rows of a Williams design for a number of conditions: a Latin square, with its mirror if the number is odd.

    Every condition occurs once in every position (twice with the mirror), and follows each of the others equally often:
    Williams (1949), Australian Journal of Scientific Research A 2, 149–168.
    """
    first = [0]
    for step in range(1, count):
        first.append((first[-1] + (step if step % 2 else -step)) % count)
    rows = [[(one + shift) % count for one in first] for shift in range(count)]
    return rows if count % 2 == 0 or count == 1 else rows + [row[::-1] for row in rows]


FAILED: Final = ("trial", "participant", "condition", "error")
"""Columns of the list of failed trials."""
ONE_AT_A_TIME: Final = Lock()
"""Lock held while a trial is driven: the threads of a cluster worker share solved lines."""


def jobs_of(design: Design, folder: Path, *, record: bool = False) -> list[TrialJob]:
    """The jobs of a design in the order of its trials, recorded in the study's folder if asked.

    Raises DasError for files that cannot be used.
    """
    population = design.people.population
    common = {"version": __version__, "code": source_sha256(), "population": sha256(load_population(population).source)}
    common |= {name: MEASURES[name].source for name in design.measures if needs_table([name])}
    trials = trials_of(design)
    settings = dict.fromkeys(trial.setting for trial in trials)
    files = {setting: tuple((common | setting_files(setting)).items()) for setting in settings}
    return [
        TrialJob(
            trial=trial, population=population, measures=design.measures, files=files[trial.setting],
            record=folder / recording_file(trial) if record else None,
        )
        for trial in trials
    ]  # fmt: skip


_files_here = cache(setting_files)
"""The hashes of a setting's files on the running machine, read once."""


def make_trial(job: TrialJob) -> dict[str, Any]:
    """Drive a trial and compute its measures; raises DasError if it cannot be driven.

    DasError is also raised if a file of the trial differs from the file from which the jobs were made: it was
    changed afterwards, or this is another machine with a different file at the same path.
    """
    here = _files_here(job.trial.setting)
    # The hashes of version, code and population are not compared: they are not files of a setting.
    others = [name for name, digest in job.files if here.get(name, digest) != digest]
    if others:
        raise DasError(f"a worker's copy differs: {', '.join(others)}; expected the same file at the same path")
    with ONE_AT_A_TIME:
        driven = drive(job.trial, job.population, job.recording, keep=needs_table(job.measures))
        return {"measures": measured(driven, list(job.measures)), "error": None}


def in_order_of_work(jobs: Sequence[TrialJob]) -> list[TrialJob]:
    """The jobs in the order of the trials, but all jobs of one solved line together.

    A worker keeps `LINES_KEPT` solved lines. If the study has fewer loss levels, all jobs of a line are in the order of
    the trials, whatever the level, so that a stopped study has a balanced set of finished trials.
    """
    settings = {job.trial.setting: job.trial.setting.read_scenario() for job in jobs}
    by_level = len({setting.loss_level for setting in settings}) >= LINES_KEPT
    lines = {
        setting: repr([*(getattr(scenario, name) for name in PLANNED), setting.loss_level if by_level else None])
        for setting, scenario in settings.items()
    }
    return sorted(jobs, key=lambda job: (lines[job.trial.setting], job.trial.number))


@dataclass(frozen=True, kw_only=True)
class StudyRun:
    """A finished run of a study: its number of trials, the number driven in this run, and the rows of failed trials.

    `measures` maps the number of each finished trial to its measures.
    """

    folder: Path
    trials: int
    made: int
    failed: tuple[Mapping[str, Any], ...]
    measures: Mapping[int, Mapping[str, Any]]

    def as_dict(self) -> dict[str, Any]:
        """The figures, for programs."""
        failed = [{name: one[name] for name in FAILED} for one in self.failed]
        return {"folder": str(self.folder), "trials": self.trials, "made": self.made, "failed": failed}


def run_study(design: Design, jobs: Sequence[TrialJob], folder: Path, workers: Workers) -> StudyRun:
    """Drive all trials that are not finished, and write the study's files, even if the run is interrupted.

    Raises DasError if files cannot be written, a worker is killed or a cluster cannot be used.
    """
    began = datetime.now(UTC)
    good: dict[int, Mapping[str, Any]] = {}
    failed: list[Mapping[str, Any]] = []

    def write(rows: Rows, made: int) -> None:
        for job in jobs:
            row = rows.get(job.inputs_sha256)
            if row is not None and row.get("error") is None:
                good[job.trial.number] = row["measures"]
            elif row is not None:
                failed.append(job.row | {"error": row["error"]})
        write_whole(folder / TRIALS_TABLE, trials_table(design, [job.trial for job in jobs], good))
        if failed:
            write_whole(folder / FAILED_TABLE, table_text(FAILED, ([row[name] for name in FAILED] for row in failed)))
        else:
            (folder / FAILED_TABLE).unlink(missing_ok=True)
        if made or not (folder / README).exists():
            write_whole(folder / README, readme(design, workers, began, datetime.now(UTC)))

    once = {(job.inputs_sha256, job.record): job for job in reversed(jobs)}  # some drivers do not depend on the person
    words = JobWords("experiment", "trials", "drive")
    ordered = in_order_of_work(list(once.values()))
    made = Runner(make=make_trial, folder=folder, workers=workers, words=words).run(ordered, write)
    return StudyRun(folder=folder, trials=len(jobs), made=made, failed=tuple(failed), measures=good)
