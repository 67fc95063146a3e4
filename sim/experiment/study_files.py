"""The files of a whole study beside those of its trials: the tidy table, the participants, and their descriptions."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from das import __version__
from sim.drivers.population import load_population
from sim.experiment.describing import events_sidecar, participants_sidecar, series_sidecar, trials_sidecar
from sim.experiment.design import Design
from sim.experiment.files import (
    CHECKED_TABLES,
    CHECKSUMS,
    DESIGN_JSON,
    PEOPLE_TABLE,
    PERSON_ID,
    PERSON_NUMBER,
    PROVENANCE,
    TRIALS_SIDECAR,
    TRIALS_TABLE,
    columns,
)
from sim.experiment.trial_files import TASK, tab_separated
from sim.experiment.trials import StudyTrial
from sim.recording.inputs import sha256

BIDS_VERSION: Final = "1.10.0"
IGNORED: Final = (
    *("*.parquet", "*.mcap", "*.jsonl", "*.csv", "*.toml", "*.html"),
    *(DESIGN_JSON, TRIALS_SIDECAR, "check.json", CHECKSUMS, PROVENANCE, f"task-{TASK}_series.json"),
)
"""What a BIDS validator is not to look at: BIDS has no place for it."""


def trials_table(design: Design, trials: Sequence[StudyTrial], measures: Mapping[int, Mapping[str, Any]]) -> bytes:
    """The tidy table of the trials that are finished: `measures` by the number of the trial."""
    names = list(design.plan.measures)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns([factor.name for factor in design.factors], names))
    for trial in trials:
        if trial.number in measures:
            found = measures[trial.number]
            writer.writerow([*_head(trial), *trial.levels, trial.seed, *(_cell(found[name]) for name in names)])
    return out.getvalue().encode()


def _head(trial: StudyTrial) -> list[Any]:
    place = (trial.number, trial.participant, trial.session_name, trial.position)
    return [*place, int(trial.practice), trial.condition]


def _cell(value: Any) -> Any:
    if value is None:
        return ""
    return repr(float(value)) if isinstance(value, float) else value  # numpy's floats have another repr


def study_files(design: Design, trials: Sequence[StudyTrial]) -> dict[str, bytes]:
    """The files of a study that do not depend on how its trials went, by their names."""
    people, persons = _participants(design, trials)
    return {
        "dataset_description.json": _json(_description(design)),
        "README": _readme(design).encode(),
        ".bidsignore": "".join(f"{one}\n" for one in IGNORED).encode(),
        PEOPLE_TABLE: people,
        "participants.json": _json(participants_sidecar(design, persons)),
        f"task-{TASK}_events.json": _json(events_sidecar()),
        f"task-{TASK}_series.json": _json(series_sidecar()),
        TRIALS_SIDECAR: _json(trials_sidecar(design)),
    }


def checksums(folder: Path) -> bytes:
    """The hashes of the tables of a study that are analysed, as they lie in its folder."""
    return _json({name: sha256(folder / name) for name in CHECKED_TABLES})


def _json(content: Any) -> bytes:
    return json.dumps(content, indent=2, ensure_ascii=False).encode() + b"\n"


def _description(design: Design) -> dict[str, Any]:
    return {
        "Name": design.title,
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "das-sim experiment", "Version": __version__}],
    }


def _participants(design: Design, trials: Sequence[StudyTrial]) -> tuple[bytes, list[str]]:
    """The table of participants, and the names of the parameters in it."""
    population = load_population(design.people.population)
    parameters = [spread.name for spread in population.spreads]
    between = [i for i, factor in enumerate(design.factors) if not factor.within]
    first = {trial.who: trial for trial in reversed(trials)}
    rows = [
        [
            *(trial.participant, population.id, trial.person, *(trial.levels[i] for i in between)),
            *population.draw(trial.person).values(),
        ]
        for _, trial in sorted(first.items())
    ]
    head = [PERSON_ID, "population", PERSON_NUMBER, *(design.factors[i].name for i in between), *parameters]
    return tab_separated(head, rows), parameters


def _readme(design: Design) -> str:
    described = f"{design.description}\n\n" if design.description else ""
    return (
        f"{design.title}\n\n{described}"
        f"{TRIALS_TABLE} has one row for each trial, and {TRIALS_SIDECAR} says what each column is.\n"
        f"{CHECKSUMS} has the SHA-256 of the tables that are analysed.\n"
        "design.toml is the design as it was frozen, and design.json the same with all defaults and its hash.\n"
        "sub-XX/ses-YY/beh has for each trial what the driver decided (events.tsv), how the trial was set up\n"
        "(events.json) and a series of one row a second (series.parquet).\n"
        f"task-{TASK}_events.json and task-{TASK}_series.json say what their columns are.\n"
        "All participants are simulated drivers. Their clocks are those of the simulated day.\n"
    )
