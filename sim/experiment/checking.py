"""The check of a design before any trial is driven, and the printed results of an experiment's commands."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from das.command_line.files import warn_once, warn_unusual
from das.command_line.printing import busy, new_table, paragraph, print_table, tell, typed
from das.domain.errors import DasError, InputError, one_of
from das.domain.files.reading import read_text
from das.domain.files.writing import make_folder
from sim.drivers.kinds import DESK, DriverKind, External, Presentation
from sim.drivers.parameters import HumanParameters, load_population
from sim.experiment.design import (
    COLUMNS,
    DESIGN_JSON,
    ConditionOrder,
    Days,
    Design,
    bundled_studies,
    check_frozen,
    freeze,
    read_design,
    resolved,
)
from sim.experiment.driving import StudyTrial, service_of
from sim.experiment.factors import Setting
from sim.experiment.measures import MEASURES
from sim.experiment.people.forms import load_form
from sim.experiment.people.steps import described
from sim.experiment.people.tasks import TASK_MEASURES
from sim.experiment.people_plan import PeoplePlan
from sim.experiment.study_files import PEOPLE_FOLDER, TRIALS_TABLE
from sim.experiment.trials import StudyRun, imbalances, trials_of
from sim.world.loop import AFTER_S, BEFORE_S

MINUTE_S: Final = 60.0
HOUR_S: Final = 3600.0
FAILED_SHOWN: Final = 5
"""Largest number of failed trials that are printed; the table of failed trials lists all."""
OF_DISPLAY: Final = ("loss_level", "update_interval_s", "hold_s", "preview_s", "reason")
"""Factors that change the content of a display."""


def idle_factors(design: Design) -> Iterator[str]:
    """A sentence with the reason for each factor that cannot have any effect on the driver."""
    settings = list(design.settings())
    names = {factor.name for factor in design.factors}
    if all(one.presentation is Presentation.NONE for one in settings):
        for name in OF_DISPLAY:
            if name in names:
                yield f"factor {name}: the display is blank (presentation none), so the factor has no effect"
    simulated = any(one.driver is DriverKind.HUMAN for one in settings)
    if "friction" in names and not simulated and all(isinstance(one.driver, DriverKind | External) for one in settings):
        yield "factor friction: only the human driver has a choice of brakes"
    if "punctuality" in names and design.desk is None and all(one.driver is not DESK for one in settings):
        yield "factor punctuality: only people at the desk see it, and the design has no table [desk]"
    if "reason" in names and design.desk is None and _ignores_reasons(design):
        yield f"factor reason: {IGNORED}"


IGNORED: Final = (
    "human drivers ignore reasons unless reason_refusal_ratio is below 1, in the population or in [human] of the "
    "scenario"
)


def _ignores_reasons(design: Design) -> bool:
    """Whether there are simulated human drivers, and all of them ignore the reason for advice."""
    name, people = "reason_refusal_ratio", [one for one in design.settings() if one.driver is DriverKind.HUMAN]
    if not people or name in {spread.name for spread in load_population(design.people.population).spreads}:
        return False
    usual = getattr(HumanParameters(), name)
    return not any(name in one.read_scenario().human.given or dict(one.human).get(name, usual) < 1 for one in people)


def level_notes(design: Design) -> list[str]:
    """A note on each factor with named levels that differ in the reason, if simulated drivers ignore reasons."""
    named = [factor for factor in design.factors if factor.name not in factor.varied and "reason" in factor.varied]
    return [f"factor {factor.name}: {IGNORED}" for factor in named] if _ignores_reasons(design) else []


@dataclass(frozen=True, kw_only=True)
class DesignCheck:
    """The result of the check of a design; the fields are the keys of `--json`.

    `longest_participant_s` is the longest time of a participant, breaks included. `notes` concern balance and order;
    `refused` is the reason for rejecting the design, if any. `desk` are the steps of a participant at the desk; empty
    for a design without any.
    """

    hash: str
    trials: int
    practice_trials: int
    conditions: int
    participants: int
    longest_participant_s: float
    all_participants_s: float
    notes: tuple[str, ...]
    refused: tuple[str, ...]
    desk: str = ""


def check_design(design: Design) -> DesignCheck:
    """Check a design: files, whether the trains can run, balance, and factors without any effect.

    Raises DasError for files that cannot be used, and for days that cannot be driven.
    """
    trials = trials_of(design)
    _check_forms(design)
    with busy("solving the lines …"):
        spans_s = _spans_s(design, trials, _lengths_s(design, trials))
    return DesignCheck(
        hash=resolved(design)["hash"],
        trials=len(trials),
        practice_trials=sum(trial.practice for trial in trials),
        conditions=len(design.conditions(within=True)) * len(design.conditions(within=False)),
        participants=design.people.count,
        longest_participant_s=max(spans_s),
        all_participants_s=sum(spans_s),
        notes=(
            *imbalances(design, trials),
            *_order_notes(design),
            *group_notes(design),
            *pair_notes(design),
            *level_notes(design),
        ),
        refused=tuple(idle_factors(design)),
        desk=described(design) if design.desk is not None or design.driven_by_people else "",
    )


def _check_forms(design: Design) -> None:
    """Check the texts and questionnaires of a design, and that each of its measures is known or a score of one of them.

    Raises DasError or InputError for a file that cannot be used, for a score whose column would be another's, and for
    an unknown measure.
    """
    desk = design.desk or PeoplePlan()
    for text in filter(None, (desk.consent, desk.instructions, desk.debriefing)):
        read_text(desk.folder / text)
    forms = {name: load_form(name, desk.folder) for name in desk.forms}
    taken = [*MEASURES, *TASK_MEASURES, *COLUMNS, *(factor.name for factor in design.factors)]
    scores: list[str] = []
    for form in [forms[name] for name in dict.fromkeys(desk.of_a_trial)]:
        for rule in form.score_rules:
            if rule.name in [*taken, *scores]:
                expected = "a name that no measure, column, factor or other score of a trial has"
                raise InputError(form.source, "scores.name", rule.name, expected)
            scores.append(rule.name)
    usable = [*MEASURES, *scores, *(name for name in TASK_MEASURES if name.startswith(desk.tasks))]
    for name in design.measures:
        if name not in usable:
            raise InputError(design.source, "analysis.measures", name, one_of(usable, name))


def _lengths_s(design: Design, trials: Sequence[StudyTrial]) -> dict[Setting, float]:
    """The duration of a trial of each setting by its timetable (s), as simulated time.

    Unusual values of a line or train, and a timetable that advice cannot keep, cause warnings on standard error.
    Raises DasError if the true train of a trial cannot be driven.
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
    """The time that each participant needs (s): the trips by their timetables, and the breaks."""
    spans, sessions = [0.0] * design.people.count, [1] * design.people.count
    for trial in trials:
        spans[trial.who - 1] += lengths_s[trial.setting]
        sessions[trial.who - 1] = trial.session
    breaks = design.procedure.break_s
    return [span + breaks * (count - 1) for span, count in zip(spans, sessions, strict=True)]


def _order_notes(design: Design) -> list[str]:
    """Notes on the order of the conditions."""
    if len(design.conditions(within=True)) < 2:
        return []
    if not design.people.learning and not design.driven_by_people:
        return [
            "the order has no effect on simulated drivers: earlier trips do not change them "
            "(participants.learning = false), and nothing else carries over from trial to trial"
        ]
    if design.procedure.order is ConditionOrder.LISTED:
        return ["order listed: practice grows from condition to condition, so the comparisons include its effect"]
    return []


def group_notes(design: Design) -> list[str]:
    """Notes on factors with only one level for each participant."""
    between = [factor for factor in design.factors if not factor.within]
    if not between:
        return []
    names, groups = " and ".join(factor.name for factor in between), len(design.conditions(within=False))
    each = design.people.count // groups
    said = [
        f"{names}: each participant meets one level, so groups of {each} are compared unpaired, which takes "
        "many more participants than a paired comparison"
    ]
    if design.procedure.days is not Days.COMMON:
        said.append("the groups have different runs, which adds noise (procedure.days = 'common')")
    return said


def pair_notes(design: Design) -> list[str]:
    """A note if there are too few participants for any paired difference to be statistically significant."""
    count = design.people.count
    within = {factor.name for factor in design.factors if factor.within}
    number = 1 if design.correction == "none" else len(design.comparisons)
    least = 2.0 / 2.0**count * number
    if least < design.alpha or not any(one.factor in within for one in design.comparisons):
        return []
    corrected = f", corrected for {number} comparisons" if number > 1 else ""
    return [
        f"with {count} participants no difference can be statistically significant: if all differ to the same "
        f"side, p is {min(least, 1.0):.3g}{corrected}"
    ]


def refuse_people(design: Design, folder: Path) -> None:
    """Raise DasError if people drive the trials of a design or of a study's folder."""
    if design.driven_by_people:
        how = f"das-sim experiment desk {design.source} -o {folder} --participant P1"
        raise DasError(f"{design.source}: driver = desk: people drive these trials: {how}")
    if (folder / PEOPLE_FOLDER).exists():
        raise DasError(f"{folder}: holds trials that people drive, expected another folder for simulated drivers")


def checked_in(design: Design, folder: Path) -> None:
    """Check a design and freeze it in its folder, unless that was done before.

    Raises DasError if the design is rejected.
    """
    if (folder / DESIGN_JSON).exists():
        check_frozen(design, folder)
        return
    with made_folder(folder):
        found = check_design(design)
        if found.refused:
            raise DasError(f"{design.source}: {found.refused[0]}")
        freeze(design, folder)


@contextlib.contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder, so that a bad path is rejected before minutes of work; remove the folder if it stays empty."""
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
    """Print the result of the check."""
    tell(f"{design.name}: {design.title}")
    table = new_table("", ("levels", "participants meet"), whole=("factor",))
    for factor in design.factors:
        table.add_row(factor.name, ", ".join(factor.texts), "all" if factor.within else "one")
    print_table(table)
    practice = f", {found.practice_trials} of them practice" if found.practice_trials else ""
    each = found.trials / found.participants
    paragraph(
        f"{found.trials} trials{practice}: {found.participants} participants, {each:g} trials each, "
        f"{found.conditions} conditions, order {design.procedure.order}"
    )
    asked = ", without questionnaires" if found.desk else ""
    paragraph(
        f"duration: {found.longest_participant_s / MINUTE_S:.0f} min for a participant with breaks{asked}, "
        f"{found.all_participants_s / HOUR_S:.1f} h for all"
    )
    if found.desk:
        paragraph(f"a participant at the desk: {found.desk}", hanging="  ")
    planned = len(design.comparisons)
    planned_words = f"{planned}, alpha {design.alpha:g}, correction {design.correction}" if planned else "none"
    paragraph(f"measures: {len(design.measures)}; planned comparisons: {planned_words}")
    for note in found.notes:
        paragraph(f"note: {note}", hanging="  ")
    tell(f"hash: {found.hash}")
    if folder is not None and not found.refused:
        tell(f"frozen: {folder}")


def print_run(design: Design, found: StudyRun) -> None:
    """Print the number of driven trials of a study, and the trials that failed."""
    paragraph(f"{design.name}: {found.trials} trials, {found.made} of them driven now, {len(found.failed)} failed")
    for row in found.failed[:FAILED_SHOWN]:
        paragraph(f"note: trial {row['trial']} ({row['participant']}, {row['condition']}): {row['error']}", "  ")
    tell(f"written: {found.folder / TRIALS_TABLE}")
    tell(f"next: {typed(f'das-sim experiment analyse {found.folder} -o report.html')}")


def print_studies() -> None:
    """Print the bundled studies."""
    table = new_table("", ("title", "participants", "factors"), whole=("study",))
    for one in map(read_design, bundled_studies().values()):
        factors = " × ".join(f"{len(factor.levels)} {factor.name}" for factor in one.factors)
        table.add_row(one.name, one.title, str(one.people.count), factors)
    print_table(table)
