"""The files of one trial: its events, its series, and where they go in the study's folder."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator
from typing import Any, Final

from das.advice.modes import Mode, mode_name
from das.domain.units import NS
from sim.drive.export.tables import Column, DataTable, as_parquet
from sim.drivers.presentations.presenter import Shown
from sim.experiment.describing import EVENT_COLUMNS, NO_UNIT, SERIES_COLUMNS, Sidecar
from sim.experiment.driven import Driven
from sim.experiment.factors import FACTORS
from sim.experiment.setting import Setting
from sim.experiment.trials import StudyTrial

MISSING_TEXT: Final = "n/a"
"""What BIDS writes for a missing value."""
TASK: Final = "drive"
_KINDS: Final = {"monotonic_ns": "int", "utc_ns": "int", "shown_mode": "choice"}
_LASTING: Final = ("reaction", "lapse")
"""Events whose value is how long they last (s)."""


def trial_folder(trial: StudyTrial) -> str:
    """Folder of a trial's files within the study's."""
    return f"{trial.participant}/{trial.session_name}/beh"


def trial_name(trial: StudyTrial) -> str:
    """What the names of a trial's files begin with."""
    return f"{trial.participant}_{trial.session_name}_task-{TASK}_run-{trial.position:03d}"


def events_file(trial: StudyTrial) -> str:
    """Path of a trial's events within the study's folder."""
    return f"{trial_folder(trial)}/{trial_name(trial)}_events.tsv"


def setting_file(trial: StudyTrial) -> str:
    """Path of the sidecar that says how a trial was set up, beside its events within the study's folder."""
    return f"{trial_folder(trial)}/{trial_name(trial)}_events.json"


def series_file(trial: StudyTrial) -> str:
    """Path of a trial's series within the study's folder."""
    return f"{trial_folder(trial)}/{trial_name(trial)}_series.parquet"


def recording_file(trial: StudyTrial) -> str:
    """Path of a trial's recording within the study's folder."""
    return f"{trial_folder(trial)}/{trial_name(trial)}_recording.mcap"


def trial_files(trial: StudyTrial, driven: Driven) -> dict[str, bytes]:
    """The files of events, setting and series of a trial, by their paths within the study's folder."""
    setting = setting_sidecar(trial.setting, driven)
    about = {"participant": trial.participant, "condition": trial.condition, "trial": str(trial.number)}
    about |= {name: str(entry["Value"]) for name, entry in setting.items()}
    return {
        setting_file(trial): json.dumps({"Setting": setting}, indent=2, ensure_ascii=False).encode() + b"\n",
        events_file(trial): tab_separated(EVENT_COLUMNS, _event_rows(driven)),
        series_file(trial): as_parquet(_series(driven), about),
    }


def setting_sidecar(setting: Setting, driven: Driven) -> Sidecar:
    """How a trial was set up: the value of every factor, whether it was varied or not, with unit and meaning."""
    service = driven.day.service
    named = {"scenario": service.scenario.id, "train": service.vehicle.id, "loss_level": str(service.level)}
    values = {**setting.figures(), **named}
    if values["preview_s"] is None:
        values["preview_s"] = "all"
    return {
        name: {"Value": values[name], "Units": one.unit or NO_UNIT, "Description": one.meaning}
        for name, one in FACTORS.items()
    }


def tab_separated(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """A table as BIDS writes it: tabs, one head line, n/a for what is missing."""
    out = io.StringIO()
    writer = csv.writer(out, delimiter="\t", lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return out.getvalue().encode()


def _cell(value: Any) -> Any:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return MISSING_TEXT
    return repr(float(value)) if isinstance(value, float) else value  # numpy's floats have another repr


def _event_rows(driven: Driven) -> Iterator[tuple[Any, ...]]:
    """The rows of the events, in the order of time."""
    service, began_s = driven.day.service, driven.run.states[0].time_s
    began_ns = service.moment_ns(began_s)
    for time_s, what, value in sorted(_events(driven), key=lambda one: one[0]):
        utc_ns = service.moment_ns(time_s)
        lasts_s = value if what in _LASTING else 0.0
        yield (utc_ns - began_ns) * NS, lasts_s, what, value, time_s, utc_ns - began_ns, utc_ns


def _events(driven: Driven) -> Iterator[tuple[float, str, float]]:
    """What happened: the time on the trip's clock (s), its kind and its number."""
    for event in driven.run.decisions:
        yield event.time_s, event.what, float(event.value)
    before: Shown | None = None
    for state, look in driven.seconds:
        now = None if look.shown is None else Shown.of(look.shown)
        if now != before:
            yield state.time_s, "shown", 0.0 if look.shown is None else float(look.shown.mode)
        before = now
    service = driven.day.service
    for (departed, arrived), table in zip(driven.run.legs, service.timetables, strict=True):
        yield departed.time_s, "departure", departed.time_s - service.clock_s(table.departure_ns)
        yield arrived.time_s, "arrival", arrived.time_s - service.clock_s(table.arrival_ns)


def _series(driven: Driven) -> DataTable:
    """One row a second of the trial."""
    service = driven.day.service
    began_ns = service.moment_ns(driven.run.states[0].time_s)
    values: dict[str, list[Any]] = {name: [] for name in SERIES_COLUMNS}
    for state, look in driven.seconds:
        utc_ns, view = service.moment_ns(state.time_s), look.shown
        row = (
            *(state.time_s, utc_ns - began_ns, utc_ns, state.s_m, state.speed_mps, state.acceleration_mps2),
            *(look.limit_mps, state.force_el_n, state.force_friction_n, state.input_j, _number(look.lever_ratio)),
            None if view is None else mode_name(Mode(view.mode)),
            None if view is None else _number(view.shown_speed_mps),
            None if view is None else _number(view.lever_ratio),
        )
        for column, value in zip(values.values(), row, strict=True):
            column.append(value)
    columns = [
        Column(name=name, kind=_KINDS.get(name, "float"), values=values[name], meaning=text)
        for name, (_, text, _) in SERIES_COLUMNS.items()
    ]
    return DataTable(name="series", columns=columns)


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value
