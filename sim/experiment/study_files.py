"""The files of a study: its table of trials, its participants, the events and series of each trial, and their columns.

Sidecars in the form of BIDS say what each column means: LongName, Description, Units.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from das import __version__
from das.advice.advice import ReplanCause
from das.advice.regimes import Regime, mode_name
from das.domain.levels import Level
from das.domain.units import NS
from sim.drive.export.tables import Column, DataTable, as_parquet
from sim.drivers.cab import AdviceView
from sim.drivers.kinds import DriverKind, FrictionPolicy, Presentation
from sim.drivers.parameters import HumanParameters, load_population
from sim.drivers.presentations.presenter import Shown, presenter_of
from sim.experiment.design import Design
from sim.experiment.driving import Driven, StudyTrial
from sim.experiment.factors import FACTORS, FactorLevel, Setting, day_of
from sim.experiment.measures import MEASURES
from sim.experiment.plan import (
    CHECK_RESULT,
    CHECKED_TABLES,
    CHECKSUMS,
    DESIGN_JSON,
    DESIGN_TEXT,
    PEOPLE_TABLE,
    PERSON_ID,
    PERSON_NUMBER,
    PROVENANCE,
    TRIALS_SIDECAR,
    TRIALS_TABLE,
    as_json,
)
from sim.recording.course import known
from sim.recording.inputs import sha256

Sidecar = dict[str, dict[str, Any]]
BIDS_VERSION: Final = "1.10.0"
TASK: Final = "drive"
MISSING_TEXT: Final = "n/a"
"""Text of BIDS for a missing value, and for a number without a unit."""
IGNORED: Final = (
    *("*.parquet", "*.mcap", "*.jsonl", "*.csv", "*.toml", "*.html"),
    *(DESIGN_JSON, TRIALS_SIDECAR, CHECK_RESULT, CHECKSUMS, PROVENANCE, f"task-{TASK}_series.json"),
)
"""Files that a BIDS validator must skip, because BIDS has no place for them."""

_TRIAL_COLUMNS: Final = {
    "trial": ("Trial", "number of the trial in the study, from 1"),
    "participant": ("Participant", "who drove; participants.tsv describes each"),
    "session": ("Session", "part of the trials between two breaks"),
    "position": ("Position", "place of the trial in the order of its participant, from 1, practice included"),
    "practice": ("Practice", "1 for a practice trial, which is not for analysis, else 0"),
    "condition": ("Condition", "levels of all factors in the order of the design, joined by _"),
}
"""The first columns of the table of trials; those of the factors, the seed and the measures follow."""
EVENT_KINDS: Final = {
    "glance": "the driver looks at the display; value: mode shown",
    "noticed": "the driver notices new advice; value: its mode",
    "reaction": "a reaction begins; value: its length (s)",
    "followed": "the driver decides to follow the advice that was noticed; value: its mode",
    "refused": "the driver decides not to follow the advice that was noticed; value: its mode",
    "acted": "a decision takes effect; value: 1 if the driver now follows the advice, else 0",
    "lapse": "the driver's attention goes away; value: its length (s); a warning of the train ends it earlier",
    "lever": "a controller that stood still begins to move; value: its aim (−1 … 1)",
    "changed": "advice was replaced before the driver acted on it; value: mode of the advice that is gone",
    "expected": "advice was announced before; value: share of a reaction time that acting on it takes",
    "shown": "what is read off the display changes, or the reason or the next mode; value: mode shown, 0 for none",
    "departure": "the train departs from a stop; value: delay (s)",
    "arrival": "the train arrives at a stop; value: delay (s)",
}
"""Kinds of events, and what the value of each means."""
CLOCKS: Final = {
    "monotonic_ns": ("Monotonic clock", "time since the trial began, on a clock that is never set", "ns"),
    "utc_ns": ("UTC", "time since 1970-01-01 UTC; for a simulated trial, the time on the simulated day", "ns"),
}
EVENT_COLUMNS: Final = {
    "onset": ("Onset", "time since the trial began, which is when its series begins", "s"),
    "duration": ("Duration", "how long the event lasts; 0 for a moment", "s"),
    "trial_type": ("Kind of event", "what happened", ""),
    "value": ("Value", "a number that goes with the event; its kind says which", MISSING_TEXT),
    "time_s": ("Clock of the trip", "time since the first departure by the timetable", "s"),
    **CLOCKS,
    "shown_speed_mps": ("Speed shown", "speed on the display; only of shown, as the columns that follow", "m/s"),
    "shown_effort_ratio": ("Effort shown", "effort on the display on the controller's scale", "1"),
    "shown_reason": ("Reason shown", "kind of the reason on the display, by its name in the message Reason", ""),
    "next_mode": ("Next mode", "mode after the next change on the display", ""),
    "next_change_s": ("Next change", "time until the next change on the display", "s"),
    "next_speed_mps": ("Next speed", "speed after the next change on the display", "m/s"),
    "replan_cause": ("Cause of replanning", "why the guide made the reference behind its instruction", ""),
    "replan_age_s": ("Age of the reference", "time since the guide made that reference", "s"),
}
_OF_SHOWN: Final = list(EVENT_COLUMNS)[-8:]
"""The columns of what was shown, which other events do not have."""
SERIES_COLUMNS: Final = {
    "time_s": ("Clock of the trip", "time since the first departure by the timetable", "s"),
    **CLOCKS,
    "s_m": ("Position", "position of the train's head on the route", "m"),
    "speed_mps": ("Speed", "true speed of the train", "m/s"),
    "acceleration_mps2": ("Acceleration", "true acceleration of the train", "m/s²"),
    "limit_mps": ("Speed limit", "limit that the cab shows", "m/s"),
    "force_el_n": ("Electric force", "wheel force of the motors, braking < 0", "N"),
    "force_friction_n": ("Friction force", "wheel force of the friction brakes, <= 0", "N"),
    "energy_input_j": ("Energy", "energy at the current collector since the trial began", "J"),
    "lever_ratio": ("Controller", "setting of the controller: 1 full traction, −1 all brakes; empty without one", "1"),
    "shown_mode": ("Mode shown", "mode of the advice on the display; empty where nothing is shown", ""),
    "shown_speed_mps": ("Speed shown", "speed on the display; empty where none is shown", "m/s"),
    "shown_effort_ratio": ("Effort shown", "effort on the display on the controller's scale; empty without one", "1"),
}
_FRICTION: Final = {
    FrictionPolicy.AS_MEASURED: "a share of each braking by friction brakes, as measured on real trains, whatever is "
    "advised",
    FrictionPolicy.ELECTRIC_FIRST: "friction brakes only where the motors cannot give what is asked",
    FrictionPolicy.BY_ADVICE: "as measured, but electric first while the driver follows advice on effort",
}
_DRIVERS: Final = {
    DriverKind.PERFECT: "follows advice exactly and at once",
    DriverKind.LITERAL: "does what the guide's card says and knows nothing else",
    DriverKind.FAST: "drives as fast as is allowed",
    DriverKind.TOP_SPEED: "never drives faster than the reduced maximum speed",
    DriverKind.TIMETABLE: "keeps to the timetable without advice",
    DriverKind.HUMAN: "a simulated human driver, who looks, reacts, errs and refuses",
}
_LEVELS: Final = {
    Level.L0_NOREG: "no losses, but all braking energy becomes heat",
    Level.L0_REG: "no losses",
    Level.L1: "a constant efficiency",
    Level.L2: "a constant efficiency and an idle loss",
    Level.L3: "a map of losses over force and speed",
    Level.OWN: "the losses that the train's file gives",
}
_WORDS: Final[Mapping[str, Mapping[str, str]]] = {
    "loss_level": {str(level): text for level, text in _LEVELS.items()},
    "friction": {str(level): text for level, text in _FRICTION.items()},
    "driver": {str(level): text for level, text in _DRIVERS.items()},
}
_KINDS: Final = {"monotonic_ns": "int", "utc_ns": "int", "shown_mode": "choice"}
_LASTING: Final = ("reaction", "lapse")
"""Events whose value is how long they last (s)."""
EVENTS, SETTING, SERIES = "events.tsv", "events.json", "series.parquet"
RECORDING: Final = "recording.mcap"


def trial_file(trial: StudyTrial, what: str) -> str:
    """Path of a file of a trial within the study's folder: `EVENTS`, `SETTING`, `SERIES` or `RECORDING`."""
    name = f"{trial.participant}_{trial.session_name}_task-{TASK}_run-{trial.position:03d}"
    return f"{trial.participant}/{trial.session_name}/beh/{name}_{what}"


def table_text(columns: Iterable[str], rows: Iterable[Iterable[Any]], between: str = ",", missing: str = "") -> bytes:
    """A table as text: one header line, then a line for each row; None and NaN are written as missing."""

    def cell(value: Any) -> Any:
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return missing
        return repr(float(value)) if isinstance(value, float) else value  # numpy's floats have another repr

    out = io.StringIO()
    writer = csv.writer(out, delimiter=between, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(map(cell, row) for row in rows)
    return out.getvalue().encode()


def tab_separated(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """A table as BIDS writes it: tabs, and n/a for what is missing."""
    return table_text(columns, rows, "\t", MISSING_TEXT)


def trials_table(design: Design, trials: Sequence[StudyTrial], measures: Mapping[int, Mapping[str, Any]]) -> bytes:
    """The tidy table of the finished trials; `measures` has those of each finished trial by its number."""
    head = [*_TRIAL_COLUMNS, *(factor.name for factor in design.factors), "seed", *design.plan.measures]
    rows = (
        [
            *(one.number, one.participant, one.session_name, one.position, int(one.practice), one.condition),
            *(*one.levels, one.seed, *(measures[one.number][name] for name in design.plan.measures)),
        ]
        for one in trials
        if one.number in measures
    )
    return table_text(head, rows)


def study_files(design: Design, trials: Sequence[StudyTrial]) -> dict[str, bytes]:
    """The files of a study that do not depend on how its trials went, by their names."""
    people, persons = _participants(design, trials)
    events = {name: _entry(*texts) for name, texts in EVENT_COLUMNS.items()}
    events["trial_type"]["Levels"] = EVENT_KINDS
    description = {
        "Name": design.title,
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "das-sim experiment", "Version": __version__}],
    }
    return {
        "dataset_description.json": as_json(description),
        "README": _readme(design).encode(),
        ".bidsignore": "".join(f"{one}\n" for one in IGNORED).encode(),
        PEOPLE_TABLE: people,
        "participants.json": as_json(participants_sidecar(design, persons)),
        f"task-{TASK}_events.json": as_json(events),
        f"task-{TASK}_series.json": as_json({name: _entry(*texts) for name, texts in SERIES_COLUMNS.items()}),
        TRIALS_SIDECAR: as_json(trials_sidecar(design)),
    }


def checksums(folder: Path) -> bytes:
    """The hashes of the tables in a study's folder that are analysed, as JSON."""
    return as_json({name: sha256(folder / name) for name in CHECKED_TABLES})


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
        f"{DESIGN_TEXT} is the design as it was frozen, and {DESIGN_JSON} the same with all defaults and its hash.\n"
        "sub-XX/ses-YY/beh has for each trial what the driver decided (events.tsv), how the trial was set up\n"
        "(events.json) and a series with one row per second (series.parquet).\n"
        f"task-{TASK}_events.json and task-{TASK}_series.json say what their columns are.\n"
        "All participants are simulated drivers. Their clocks are those of the simulated day.\n"
    )


def trials_sidecar(design: Design) -> Sidecar:
    """What the columns of the table of trials mean."""
    found = {name: _entry(title, text, MISSING_TEXT) for name, (title, text) in _TRIAL_COLUMNS.items()}
    for factor in design.factors:
        known = FACTORS[factor.name]
        levels = ", ".join(level.text for level in factor.levels)
        within = "within" if factor.within else "between"
        found[factor.name] = _entry(
            known.title, f"{known.meaning}; levels {levels}; {within} participants", known.unit or MISSING_TEXT
        )
        meant = {level.text: level_words(factor.name, level) for level in factor.levels}
        if any(meant.values()):
            found[factor.name]["Levels"] = meant
    found["seed"] = _entry("Seed", "seed of the day; trials with one seed meet the same day", MISSING_TEXT)
    for name in design.plan.measures:
        measure = MEASURES[name]
        found[name] = _entry(measure.title, f"{measure.formula} ({measure.source})", measure.unit)
    return found


def participants_sidecar(design: Design, parameters: list[str]) -> Sidecar:
    """What the columns of participants.tsv mean: the group, and each parameter of the driver."""
    found = {
        PERSON_ID: _entry("Participant", "who drove"),
        "population": _entry("Population", "the population that the participant is drawn from"),
        PERSON_NUMBER: _entry("Person", "number of the participant in the population", MISSING_TEXT),
    }
    found |= {
        factor.name: _entry(FACTORS[factor.name].title, "the one level that the participant meets")
        for factor in design.factors
        if not factor.within
    }
    for name in parameters:
        item = HumanParameters.__dataclass_fields__[name].metadata
        unit = "1" if item["unit"] == "–" else item["unit"]
        found[name] = _entry(name, f"{item['meaning']}, before the effects of practice and of the scenario", unit)
    return found


def _entry(title: str, text: str, unit: str = "") -> dict[str, Any]:
    """What a column means. Only a column of numbers has units: BIDS takes every column with units for one."""
    return {"LongName": title, "Description": text} | ({"Units": unit} if unit else {})


def level_words(factor: str, level: FactorLevel) -> str:
    """What a level means; empty where its text says it already. Raises DasError for a scenario that cannot be read."""
    if factor == "scenario":
        return day_of(level.value).title
    if factor == "presentation":
        return presenter_of(Presentation(level.text)).meaning
    return _WORDS.get(factor, {}).get(level.text, "")


def trial_files(trial: StudyTrial, driven: Driven) -> dict[str, bytes]:
    """The files of events, setting and series of a trial, by their paths within the study's folder."""
    setting = setting_sidecar(trial.setting, driven)
    about = {"participant": trial.participant, "condition": trial.condition, "trial": str(trial.number)}
    about |= {name: str(entry["Value"]) for name, entry in setting.items()}
    return {
        trial_file(trial, SETTING): as_json({"Setting": setting}),
        trial_file(trial, EVENTS): tab_separated(EVENT_COLUMNS, _event_rows(driven)),
        trial_file(trial, SERIES): as_parquet(_series(driven), about),
    }


def setting_sidecar(setting: Setting, driven: Driven) -> Sidecar:
    """How a trial was set up: the value of every factor, whether it was varied or not, with unit and meaning."""
    service = driven.day.service
    named = {"scenario": service.scenario.id, "train": service.vehicle.id, "loss_level": str(service.level)}
    values = {**setting.figures(), **named}
    if values["preview_s"] is None:
        values["preview_s"] = "all"
    return {
        name: {"Value": values[name], "Units": one.unit or MISSING_TEXT, "Description": one.meaning}
        for name, one in FACTORS.items()
    }


class _Event(NamedTuple):
    """An event of a trial: its time on the trip's clock (s), its kind, its value, and what was shown, if it says so."""

    time_s: float
    what: str
    value: float
    shown: AdviceView | None = None


def _event_rows(driven: Driven) -> Iterator[tuple[Any, ...]]:
    """The rows of the file of events, in the order of time."""
    service, began_s = driven.day.service, driven.run.states[0].time_s
    began_ns = service.moment_ns(began_s)
    for one in sorted(_events(driven), key=lambda one: one.time_s):
        utc_ns = service.moment_ns(one.time_s)
        lasts_s = one.value if one.what in _LASTING else 0.0
        since_ns = utc_ns - began_ns
        yield (since_ns * NS, lasts_s, one.what, one.value, one.time_s, since_ns, utc_ns, *_shown_cells(one))


def _events(driven: Driven) -> Iterator[_Event]:
    """Every event of a trial."""
    for event in driven.run.decisions:
        yield _Event(event.time_s, event.what, float(event.value))
    before: tuple[Any, ...] | None = None
    for state, look in driven.seconds:
        view = look.shown
        now = None if view is None else (Shown.of(view), view.reason.code, view.next_mode)
        if now != before:
            yield _Event(state.time_s, "shown", 0.0 if view is None else float(view.mode), view)
        before = now
    service = driven.day.service
    for (departed, arrived), table in zip(driven.run.legs, service.timetables, strict=True):
        yield _Event(departed.time_s, "departure", departed.time_s - service.clock_s(table.departure_ns))
        yield _Event(arrived.time_s, "arrival", arrived.time_s - service.clock_s(table.arrival_ns))


def _shown_cells(event: _Event) -> tuple[Any, ...]:
    """The cells of `_OF_SHOWN`; None for what the display did not show."""
    view = event.shown
    if view is None:
        return (None,) * len(_OF_SHOWN)
    return (
        known(view.shown_speed_mps),
        known(view.lever_ratio),
        view.reason.code.name.lower() if view.reason else None,
        mode_name(Regime(view.next_mode)) if view.next_mode else None,
        known(view.next_change_s),
        known(view.next_speed_mps) if view.next_mode else None,
        ReplanCause(view.replan_cause).label if view.replan_cause else None,
        known(event.time_s - view.replanned_s),
    )


def _series(driven: Driven) -> DataTable:
    """One row a second of the trial."""
    service = driven.day.service
    began_ns = service.moment_ns(driven.run.states[0].time_s)
    rows: list[tuple[Any, ...]] = []
    for state, look in driven.seconds:
        utc_ns, view = service.moment_ns(state.time_s), look.shown
        shown: tuple[Any, ...] = (None, None, None)
        if view is not None:
            shown = (mode_name(Regime(view.mode)), known(view.shown_speed_mps), known(view.lever_ratio))
        rows.append((
            *(state.time_s, utc_ns - began_ns, utc_ns, state.s_m, state.speed_mps, state.acceleration_mps2),
            *(look.limit_mps, state.force_el_n, state.force_friction_n, state.input_j, known(look.lever_ratio)),
            *shown,
        ))  # fmt: skip
    columns = [
        Column(name=name, kind=_KINDS.get(name, "float"), values=list(values), meaning=text)
        for (name, (_, text, _)), values in zip(SERIES_COLUMNS.items(), zip(*rows, strict=True), strict=True)
    ]
    return DataTable(name="series", columns=columns)
