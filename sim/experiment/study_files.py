"""The files of a study: table of trials, recordings, README; and the recomputation of measures from recordings."""

from __future__ import annotations

import csv
import io
import json
import math
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from das import __version__
from das.command_line.printing import progress_bar
from das.domain.errors import DasError
from das.domain.files.reading import read_json, read_text
from das.domain.files.writing import make_folder, write_whole
from das.domain.levels import Level
from precompute.workers import Workers, source_sha256
from sim.drive.table import DriveTable
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import presenter_of
from sim.experiment.design import DESIGN_JSON, DESIGN_TEXT, Design, design_sha256, read_frozen
from sim.experiment.driving import StudyTrial
from sim.experiment.factors import FACTORS, FactorLevel, day_of
from sim.experiment.measures import MEASURES
from sim.options import typed_command
from sim.recording.opening import open_recording

TRIALS_TABLE: Final = "trials.csv"
"""The tidy table (UTF-8, comma, decimal point): one row for each finished trial, sorted by participant and trial order.

A missing value is an empty cell. No column depends on the wall clock: the same design gives the same bytes.
"""
FAILED_TABLE: Final = "failed.csv"
"""The table of failed trials, each with the reason; written only if a trial failed."""
README: Final = "README"
"""File with the contents of the study, the meanings of columns, and the program and time of the run."""
RECORDINGS: Final = "recordings"
"""The folder of the recordings, if they are kept."""
PEOPLE_FOLDER: Final = "people"
"""The folder that contains a folder for each person, in a study driven by people at the desk."""
_PSEUDONYM = re.compile(r"P([0-9]{1,5})")
TRIAL_COLUMNS: Final = {
    "trial": "number of the trial in the study, from 1",
    "participant": "the driver of the trial",
    "session": "part of the trials between two breaks",
    "position": "place of the trial in the participant's order, from 1, practice included",
    "practice": "1 for a practice trial, which is not for analysis, else 0",
    "braked": "1 if the dead-man brake stopped the train because nobody was at the desk, else 0",
    "condition": "levels of all factors in the order of the design, joined by _",
}
"""The first columns of the table of trials; columns of factors, the seed of the day and measures follow."""

RESCORED: Final = "rescored from"
"""Key of the frozen design for the hash of the design whose recordings were read."""

_WORDS: Final[Mapping[str, Mapping[str, str]]] = {
    "loss_level": {
        Level.L0_NOREG: "no losses, but all braking energy becomes heat",
        Level.L0_REG: "no losses",
        Level.L1: "a constant efficiency",
        Level.L2: "a constant efficiency and an idle loss",
        Level.L3: "a map of losses over force and speed",
        Level.OWN: "the losses that the train's file gives",
    },
    "friction": {
        FrictionPolicy.AS_MEASURED: "a share of each braking by friction brakes, as measured on real trains, whatever "
        "is advised",
        FrictionPolicy.ELECTRIC_FIRST: "friction brakes only if the motors cannot supply the braking force",
        FrictionPolicy.BY_ADVICE: "as measured, but electric first while the driver follows advice on effort",
    },
    "driver": {
        DriverKind.PERFECT: "follows advice exactly and immediately",
        DriverKind.LITERAL: "follows only the guide's card",
        DriverKind.FAST: "drives as fast as allowed",
        DriverKind.TOP_SPEED: "never drives faster than the reduced maximum speed",
        DriverKind.TIMETABLE: "keeps to the timetable without advice",
        DriverKind.HUMAN: "a simulated human driver, who looks, reacts, errs and refuses",
    },
}
"""Meanings of the levels of factors whose texts do not explain themselves."""


def pseudonym(who: int) -> str:
    """The pseudonym of a participant (from 1), which is also the name of the person's folder."""
    return f"P{who:02d}"


def participant_number(text: str, most: int = 99_999) -> int:
    """The number of the participant with a pseudonym (`P07`: 7); DasError for another text, and for too large a one."""
    match = _PSEUDONYM.fullmatch(text)
    if match is None or not 1 <= int(match[1]) <= most:
        raise DasError(f"--participant {text}: expected P1 to P{most}, a pseudonym")
    return int(match[1])


def recording_file(trial: StudyTrial) -> str:
    """Path of the recording of a trial within the study's folder."""
    return f"{RECORDINGS}/{recording_name(trial.participant, trial.position, trial.condition, trial.seed)}"


def recording_name(participant: str, position: int, condition: str, seed: object) -> str:
    """Name of the recording of a trial, from its row in the table of trials."""
    return f"{participant}_run-{position:03d}_{condition}_seed-{seed}.mcap"


def table_text(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """A table as text: one header line, then a line for each row; None and NaN are empty."""

    def cell(value: Any) -> Any:
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return ""
        return repr(float(value)) if isinstance(value, float) else value  # numpy's floats have another repr

    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(map(cell, row) for row in rows)
    return out.getvalue().encode()


def trials_table(design: Design, trials: Sequence[StudyTrial], measures: Mapping[int, Mapping[str, Any]]) -> bytes:
    """The tidy table of finished trials; `measures` has those of each finished trial by its number."""
    head = [*TRIAL_COLUMNS, *(factor.name for factor in design.factors), "seed", *design.measures]
    rows = (
        [
            *(one.number, one.participant, one.session_name, one.position, int(one.practice)),
            *(measures[one.number].get("braked", 0), one.condition, *one.levels, one.seed),
            *(measures[one.number][name] for name in design.measures),
        ]
        for one in trials
        if one.number in measures
    )
    return table_text(head, rows)


def readme(design: Design, workers: Workers, began: datetime, ended: datetime) -> bytes:
    """The README: contents of a study's folder, meanings of the columns, and origin."""
    people, kept = design.people, f"{DESIGN_TEXT}, {DESIGN_JSON}"
    who = (
        "one simulated driver with the default of every parameter"
        if people.average
        else f"simulated drivers {people.first} to {people.first + people.count - 1} of {people.population}"
    )
    made = {
        "command": typed_command(),
        "version": __version__,
        "code (SHA-256)": source_sha256(),
        "Python": f"{platform.python_version()}, {platform.platform()}",
        **workers.facts,
        "begun (UTC)": began.isoformat(timespec="seconds"),
        "ended (UTC)": ended.isoformat(timespec="seconds"),
    }
    lines = [
        design.title,
        *(["", design.description] if design.description else []),
        "",
        f"{kept}: the design, with all defaults, the hashes of its files, and its hash.",
        f"{TRIALS_TABLE}: one row for each finished trial, of {who}.",
        f"{RECORDINGS}: a recording (MCAP) of each trial, if they were kept (--recordings).",
        "",
        *(f"{name}: {text}" for name, text in column_meanings(design).items()),
        "",
        *(f"{name}: {text}" for name, text in made.items()),
    ]
    return "".join(f"{line}\n" for line in lines).encode()


def column_meanings(design: Design) -> dict[str, str]:
    """The meaning of each column of the table of trials, with its unit."""
    found = dict(TRIAL_COLUMNS)
    for factor in design.factors:
        known = FACTORS.get(factor.name)
        unit = f" ({known.unit})" if known and known.unit else ""
        meaning = known.meaning if known else f"settings under one name: {', '.join(factor.varied)}"
        within = "within" if factor.within else "between"
        found[factor.name] = f"{meaning}{unit}; levels {', '.join(factor.texts)}; {within} participants"
    found["seed"] = "seed of the day; trials with the same seed have the same day"
    for name in design.measures:
        measure = MEASURES.get(name)
        if measure is None:
            found[name] = "of people at the desk: a score of a questionnaire, or a measure of a secondary task"
            continue
        found[name] = f"{measure.title} ({measure.unit}): {measure.formula} ({measure.source})"
    return found


def level_meaning(factor: str, level: FactorLevel) -> str:
    """The meaning of a level (of a named level: its settings); empty if its text explains itself or is unknown."""
    texts = {f"{name} {one.text}": level_words(name, one.text) for name, one in level.settings.items()}
    return "; ".join(f"{text} ({words})" if words else text for text, words in texts.items()) or level_words(
        factor, level.text
    )


def level_words(factor: str, level: str) -> str:
    """The meaning of a level of a factor; empty if its text explains itself, or is unknown to this program."""
    if factor == "scenario":
        try:
            return day_of(level).title
        except DasError:  # a file next to the design, which may be gone
            return ""
    if factor == "presentation" and level in list(Presentation):
        return presenter_of(Presentation(level)).meaning
    return _WORDS.get(factor, {}).get(level, "")


def rescore(folder: Path, names: Sequence[str], out: Path) -> int:
    """Write a study's design and table into another folder, with some measures computed from its recordings.

    Only measures that can be computed from a recording alone are possible; existing columns are replaced, others are
    added. Returns the number of trials. Raises DasError for a study without recordings, and for other measures.
    """
    able = {one.name: one.of_table for one in MEASURES.values() if one.of_table is not None}
    for name in names:
        if name not in able:
            raise DasError(f"--measure {name}: expected a measure that a recording alone gives: {', '.join(able)}")
    design = read_frozen(folder)
    rows = list(csv.DictReader(io.StringIO(read_text(folder / TRIALS_TABLE))))
    if out.resolve() == folder.resolve() or (out / TRIALS_TABLE).exists():
        raise DasError(f"{out}: holds a study already, expected another folder")
    files = [folder / RECORDINGS / _recording(row) for row in rows]
    if missing := [file for file in files if not file.is_file()]:
        raise DasError(f"{missing[0]}: no such file: only a study with recordings (--recordings) can be rescored")
    with progress_bar("rescore", f"{len(rows)} recordings to read", "trials") as progress:
        for number, (row, file) in enumerate(zip(rows, files, strict=True), start=1):
            table = DriveTable.of(open_recording(file))
            row.update({name: able[name](table) for name in names})
            progress(number, len(rows))
    make_folder(out)
    head = [*rows[0]] if rows else []
    write_whole(out / TRIALS_TABLE, table_text(head, ([row[name] for name in head] for row in rows)))
    write_whole(out / DESIGN_JSON, _frozen_with(folder, tuple(dict.fromkeys([*design.measures, *names]))))
    return len(rows)


def _recording(row: Mapping[str, str]) -> str:
    try:
        return recording_name(row["participant"], int(row["position"]), row["condition"], row["seed"])
    except (KeyError, TypeError, ValueError) as error:
        raise DasError(f"{TRIALS_TABLE}: expected the rows that the study wrote ({error})") from error


def _frozen_with(folder: Path, measures: tuple[str, ...]) -> bytes:
    """The frozen design with these measures and a new hash."""
    data = {**read_json(folder / DESIGN_JSON).data}
    was = data.pop("hash")
    data["analysis"] = {**data["analysis"], "measures": list(measures)}
    data["files"] = {**data.get("files", {}), RESCORED: was}
    return json.dumps({"hash": design_sha256(data), **data}, indent=2, ensure_ascii=False).encode() + b"\n"
