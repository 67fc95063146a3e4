"""Checks a design by driving a few of its conditions, and prints what the commands of an experiment found."""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any, Final

from das.command_line.files import warn_once, warn_unusual
from das.command_line.printing import new_table, paragraph, print_table, progress_bar, tell, typed
from das.command_line.process import available_cores
from das.domain.errors import DasError
from das.domain.files.reading import read_json
from das.domain.files.writing import make_folder, write_whole
from sim.experiment.design import ConditionOrder, Days, Design, Factor, check_frozen, freeze, resolved
from sim.experiment.driving import StudyTrial, drive, lever_trace_sha256, service_of
from sim.experiment.factors import FactorLevel, Setting
from sim.experiment.plan import CHECK_RESULT, DESIGN_JSON, TRIALS_TABLE, as_json
from sim.experiment.trials import StudyRun, imbalances, trials_of
from sim.world.loop import AFTER_S, BEFORE_S

MINUTE_S: Final = 60.0
HOUR_S: Final = 3600.0
DAYS_TRIED: Final = 5
"""Days on at least one of which a factor must change what the driver does to be admitted."""
FAILED_SHOWN: Final = 5
"""Most failed trials that are printed; the table of failed trials has all."""


@dataclass(frozen=True, kw_only=True)
class Sensed:
    """Whether the driver senses a factor, which means that the driver drives differently at each of its levels.

    `alike` are the pairs of levels that made no difference on `days` days. `failed` says why a drive failed; None if
    none failed.
    """

    factor: str
    days: int
    alike: tuple[tuple[str, str], ...]
    failed: str | None = None

    @property
    def refusal(self) -> str | None:
        """Why the factor is refused; None where all its levels are sensed."""
        if not self.alike:
            return None
        a, b = self.alike[0]
        if self.failed is not None:
            return f"factor {self.factor}: levels {a} and {b} cannot be compared: {self.failed}"
        return (
            f"factor {self.factor}: levels {a} and {b} give the same lever trace on {self.days} of {self.days} days, "
            "expected a difference that the driver senses"
        )


@dataclass(eq=False)
class SensingTest:
    """Drives a design's conditions on a few days until every two levels of every factor are told apart.

    `said` is called after each drive with the number of drives so far. Every condition is driven at most once on each
    day. `clock` is a stopwatch (s), which times the drives.
    """

    design: Design
    said: Callable[[int], None]
    clock: Callable[[], float]
    timed: list[tuple[Setting, float]] = field(default_factory=list)
    """Settings that were driven, and the time that each took by the stopwatch (s)."""
    _traces: dict[tuple[Setting, int], str | None] = field(default_factory=dict)
    _failed: str | None = None

    def of(self, factor: Factor) -> Sensed:
        """Drive to see whether the levels of a factor are sensed; a drive that fails tells no two levels apart."""
        alike = set(combinations([level.text for level in factor.levels], 2))
        for day in range(DAYS_TRIED):
            for context in self._contexts(factor):
                traces = {
                    level.text: self._trace(self.design.setting({**context, factor.name: level}), day)
                    for level in factor.levels
                    if any(level.text in pair for pair in alike)
                }
                alike -= {(a, b) for a, b in alike if None not in (traces[a], traces[b]) and traces[a] != traces[b]}
                if not alike:
                    return Sensed(factor=factor.name, days=day + 1, alike=())
        return Sensed(factor=factor.name, days=DAYS_TRIED, alike=tuple(sorted(alike)), failed=self._failed)

    def _contexts(self, factor: Factor) -> Iterator[dict[str, FactorLevel]]:
        """Levels of the other factors: all at their first level, then one of them at another level at a time."""
        others = [other for other in self.design.factors if other is not factor]
        first = {other.name: other.levels[0] for other in others}
        yield first
        for other in others:
            yield from ({**first, other.name: level} for level in other.levels[1:])

    def _trace(self, setting: Setting, day: int) -> str | None:
        """The hash of the lever trace of a setting on a day; None where the drive fails."""
        key = (setting, day)
        if key not in self._traces:
            trial, population, began_s = self._trial(setting, day), self.design.people.population, self.clock()
            try:
                self._traces[key] = lever_trace_sha256(drive(trial, population).looks)
            except DasError as error:
                self._traces[key], self._failed = None, str(error)
            self.timed.append((setting, self.clock() - began_s))
            self.said(len(self._traces))
        return self._traces[key]

    def _trial(self, setting: Setting, day: int) -> StudyTrial:
        """A trial for this test only: all settings of a day have the same person and the same random numbers."""
        people = self.design.people
        return StudyTrial(
            number=1,
            who=1,
            person=people.first + day % people.count,
            session=1,
            position=1,
            practice=True,
            levels=(),
            setting=setting,
            seed=day,
            chance=0,
            trips=people.trips_before if people.learning else None,
        )


@dataclass(frozen=True, kw_only=True)
class DesignCheck:
    """What the check of a design found.

    `person_s` is the time of the busiest participant, breaks included, and `all_s` that of all participants together.
    `notes` are sentences about balance and order; `sensed` says what driving showed of each factor. `work_s` is how
    long one core of this machine would take to drive all trials, judged by the drives of the check.
    """

    digest: str
    trials: int
    practice: int
    conditions: int
    participants: int
    person_s: float
    all_s: float
    notes: tuple[str, ...]
    sensed: tuple[Sensed, ...]
    work_s: float = math.nan

    @property
    def refusals(self) -> list[str]:
        """Why the design is refused; empty where it is not."""
        return [one.refusal for one in self.sensed if one.refusal is not None]

    def as_dict(self) -> dict[str, Any]:
        """The figures, for programs."""
        return {
            "hash": self.digest,
            "trials": self.trials,
            "practice_trials": self.practice,
            "conditions": self.conditions,
            "participants": self.participants,
            "longest_participant_s": self.person_s,
            "all_participants_s": self.all_s,
            "notes": list(self.notes),
            "sensed": {one.factor: not one.alike for one in self.sensed},
            "refused": self.refusals,
        }

    def keep(self, folder: Path) -> None:
        """Write what was found beside the frozen design."""
        write_whole(folder / CHECK_RESULT, as_json(self.as_dict()))


def was_checked(folder: Path, digest: str) -> bool:
    """Whether the folder holds the result of a check that refused nothing, for the design with the hash `digest`."""
    try:
        kept = read_json(folder / CHECK_RESULT).data
    except DasError:
        return False
    return bool(kept.get("hash") == digest and kept.get("refused") == [])


def check_design(design: Design, clock: Callable[[], float] = time.perf_counter) -> DesignCheck:
    """Check a design, and drive a few of its conditions to see whether every factor is sensed; `clock` times them.

    Raises DasError for files that cannot be used, and for days that cannot be driven.
    """
    trials = trials_of(design)
    digest = resolved(design)["hash"]
    with progress_bar("check", "solving the lines", "drives") as progress:

        def said(done: int) -> None:
            progress(done, max(done + 1, _least_drives(design)))

        lengths_s = _lengths_s(design, trials)
        spans_s = _spans_s(design, trials, lengths_s)
        test = SensingTest(design=design, said=said, clock=clock)
        sensed = tuple(test.of(factor) for factor in design.factors)
    return DesignCheck(
        digest=digest,
        trials=len(trials),
        practice=sum(trial.practice for trial in trials),
        conditions=len(design.conditions(within=True)) * len(design.conditions(within=False)),
        participants=design.people.count,
        person_s=max(spans_s),
        all_s=sum(spans_s),
        notes=(*imbalances(design, trials), *_order_notes(design), *group_notes(design), *pair_notes(design)),
        sensed=sensed,
        work_s=_work_s(test, trials, lengths_s),
    )


def _least_drives(design: Design) -> int:
    """Drives that the check needs if every factor is sensed on the first day."""
    return 1 + sum(len(factor.levels) - 1 for factor in design.factors)


def _lengths_s(design: Design, trials: Sequence[StudyTrial]) -> dict[Setting, float]:
    """How long a trial of each setting takes by its timetable (s), as simulated time.

    What is unusual about a line or train, and a timetable that its advice cannot keep, are warnings on standard error.
    Raises DasError for a true train of a trial that cannot be driven.
    """
    found = {}
    for setting in sorted(set(design.settings()), key=str):
        service = service_of(setting)
        warn_unusual(service.route, service.vehicle)
        warn_once(*service.unkept())
        for seed in dict.fromkeys(trial.seed for trial in trials if trial.setting == setting):
            service.check_train(service.scenario.truth.draw(seed))
        found[setting] = BEFORE_S + service.clock_s(service.timetables[-1].arrival_ns) + AFTER_S
    return found


def _spans_s(design: Design, trials: Sequence[StudyTrial], lengths_s: Mapping[Setting, float]) -> list[float]:
    """How long each participant is busy (s): the trips by their timetables, and the breaks."""
    spans, sessions = [0.0] * design.people.count, [1] * design.people.count
    for trial in trials:
        spans[trial.who - 1] += lengths_s[trial.setting]
        sessions[trial.who - 1] = trial.session
    breaks = design.procedure.break_s
    return [span + breaks * (count - 1) for span, count in zip(spans, sessions, strict=True)]


def _work_s(test: SensingTest, trials: Sequence[StudyTrial], lengths_s: Mapping[Setting, float]) -> float:
    """How long one core takes to drive all trials (s), judged by the drives of the check."""
    driven_s = sum(lengths_s[setting] for setting, _ in test.timed)
    return sum(span_s for _, span_s in test.timed) / driven_s * sum(lengths_s[trial.setting] for trial in trials)


def _order_notes(design: Design) -> list[str]:
    """Notes on the order of the conditions."""
    if len(design.conditions(within=True)) < 2:
        return []
    if not design.people.learning:
        return [
            "the order has no effect: earlier trips do not change these drivers (participants.learning = false), "
            "and nothing else carries over from trial to trial"
        ]
    if design.procedure.order is ConditionOrder.LISTED:
        return ["order listed: practice grows from condition to condition, so the comparisons include its effect"]
    return []


def group_notes(design: Design) -> list[str]:
    """Notes on factors of which each participant drives one level."""
    between = [factor for factor in design.factors if not factor.within]
    if not between:
        return []
    names, groups = " and ".join(factor.name for factor in between), len(design.conditions(within=False))
    each = design.people.count // groups
    said = [
        f"{names}: each participant meets one level, so groups of {each} are compared unpaired, which takes "
        "many more participants than a paired comparison (das-sim experiment power --groups)"
    ]
    if design.procedure.days is not Days.COMMON:
        said.append(
            "the groups meet different days, and luck with days is part of the noise (procedure.days = 'common')"
        )
    return said


def pair_notes(design: Design) -> list[str]:
    """A note if there are too few participants for any paired difference to stand out from chance."""
    plan, count = design.plan, design.people.count
    within = {factor.name for factor in design.factors if factor.within}
    number = 1 if plan.correction == "none" else len(plan.comparisons)
    least = 2.0 / 2.0**count * number
    if least < plan.alpha or not any(one.factor in within for one in plan.comparisons):
        return []
    corrected = f", corrected for {number} comparisons" if number > 1 else ""
    return [
        f"with {count} participants nothing can stand out from chance: if all differ to the same side, p is "
        f"{min(least, 1.0):.3g}{corrected}"
    ]


def checked_in(design: Design, folder: Path) -> None:
    """Check a design and freeze it in its folder, unless that was done before; DasError if the design is refused."""
    digest = resolved(design)["hash"]
    if (folder / DESIGN_JSON).exists():
        check_frozen(design, folder, digest)
    if was_checked(folder, digest):
        return
    with made_folder(folder):
        found = check_design(design)
        if found.refusals:
            raise DasError(f"{design.source}: {found.refusals[0]}")
        freeze(design, folder)
        found.keep(folder)


@contextlib.contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder, so that a bad one is refused before minutes of work; remove it if nothing was written into it."""
    new = not folder.exists()
    make_folder(folder)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise DasError(f"{folder}: cannot be written (Permission denied)")
    try:
        yield
    finally:
        if new and not any(folder.iterdir()):
            folder.rmdir()


def print_check(design: Design, found: DesignCheck, folder: Path | None) -> None:
    """Print what the check found."""
    tell(f"{design.name}: {design.title}")
    table = new_table("", ("levels", "participants meet", "sensed"), whole=("factor",))
    sensed = {one.factor: one for one in found.sensed}
    for factor in design.factors:
        one = sensed[factor.name]
        levels = ", ".join(level.text for level in factor.levels)
        table.add_row(factor.name, levels, "all" if factor.within else "one", _sensed_words(one))
    print_table(table)
    practice = f", {found.practice} of them practice" if found.practice else ""
    each = found.trials / found.participants
    paragraph(
        f"{found.trials} trials{practice}: {found.participants} participants, {each:g} trials each, "
        f"{found.conditions} conditions, order {design.procedure.order}"
    )
    paragraph(
        f"duration: {found.person_s / MINUTE_S:.0f} min for a participant with breaks, "
        f"{found.all_s / HOUR_S:.1f} h for all"
    )
    cores = available_cores()
    paragraph(
        f"driving them takes about {math.ceil(found.work_s / cores / MINUTE_S)} min on {cores} cores at this "
        "machine's present load"
    )
    plan, planned = design.plan, len(design.plan.comparisons)
    planned_words = f"{planned}, alpha {plan.alpha:g}, correction {plan.correction}" if planned else "none"
    paragraph(f"measures: {len(plan.measures)}; planned comparisons: {planned_words}")
    for note in found.notes:
        paragraph(f"note: {note}", hanging="  ")
    tell(f"hash: {found.digest}")
    if folder is not None and not found.refusals:
        tell(f"frozen: {folder}")


def _sensed_words(one: Sensed) -> str:
    if one.alike:
        return f"no: {' = '.join(one.alike[0])}"
    return "yes, on the first day" if one.days == 1 else f"yes, within {one.days} days"


def print_run(design: Design, found: StudyRun) -> None:
    """Print how many trials of a study were driven, and those that failed."""
    paragraph(f"{design.name}: {found.trials} trials, {found.made} of them driven now, {len(found.failed)} failed")
    for row in found.failed[:FAILED_SHOWN]:
        paragraph(f"note: trial {row['trial']} ({row['participant']}, {row['condition']}): {row['error']}", "  ")
    tell(f"written: {found.folder / TRIALS_TABLE}")
    tell(f"next: {typed(f'das-sim experiment analyse {found.folder} -o report.html')}")


def print_studies(found: Sequence[Design]) -> None:
    """Print the bundled studies."""
    table = new_table("", ("title", "participants", "factors"), whole=("study",))
    for one in found:
        factors = " × ".join(f"{len(factor.levels)} {factor.name}" for factor in one.factors)
        table.add_row(one.name, one.title, str(one.people.count), factors)
    print_table(table)
