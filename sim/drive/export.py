"""Exports a recording: one table per topic, one joined by time, and a note of their origin; anonymous on request."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das import __version__
from das.bus import topics
from das.bus.recording import Recording
from das.domain.errors import DasError
from das.domain.files.writing import write_folder_whole
from das.domain.units import NS
from sim.drive.message_tables import (
    LOG_TIME,
    ON_THE_CLOCK,
    SINCE_START,
    TIME,
    Column,
    DataTable,
    as_csv,
    as_parquet,
    columns_table,
    require_parquet,
    tables_of,
)
from sim.drive.table import HOLDS_S, DriveTable
from sim.recording.course import DriveClock
from sim.recording.opening import open_recording

MOVING: Final = ("truth", "position")
"""Topics that state the position of the train; the table by time has the rows of the first one that was recorded."""
JOINED: Final = ("truth", "position", "advice", "cab", "effort", "delay", "estimate", "status")
"""Topics whose columns are in the table by time."""
LASTING: Final = ("delay", "estimate")
"""Topics whose messages are valid until the next message, however late; other messages are valid for `HOLDS_S`."""
KINDS: Final = ("float", "int", "bool", "choice")


def by_time(tables: Mapping[str, DataTable], zero_ns: int) -> DataTable | None:
    """A table with a row for each message that states the position of the train, with the last message of each topic;
    None if there is none."""
    base = next((tables[name] for name in MOVING if name in tables and len(tables[name])), None)
    if base is None:
        return None
    at_ns = np.unique(_times(base))
    columns = [
        Column(name=TIME, kind="int", values=at_ns.tolist(), meaning="since 1970 (UTC)"),
        Column(name=SINCE_START, kind="float", values=((at_ns - zero_ns) / 1e9).tolist(), meaning=ON_THE_CLOCK),
    ]
    for name in JOINED:
        if name in tables and len(tables[name]):
            columns += _at(tables[name], at_ns)
    return DataTable(name="by_time", columns=columns)


def _times(table: DataTable) -> NDArray[np.int64]:
    return np.array(table[TIME].values, dtype=np.int64)


def _at(table: DataTable, at_ns: NDArray[np.int64]) -> list[Column]:
    """The columns of a topic at some moments, with the topic's name as prefix."""
    order = np.argsort(_times(table), kind="stable")
    time_ns = _times(table)[order]
    last = np.searchsorted(time_ns, at_ns, side="right") - 1
    age_s = (at_ns - time_ns[np.maximum(last, 0)]) * NS
    known = ((last >= 0) & ((age_s <= HOLDS_S) | (table.name in LASTING))).tolist()
    rows = order[np.maximum(last, 0)].tolist()
    return [
        replace(
            one,
            name=f"{table.name}_{one.name}",
            values=[one.values[row] if there else None for row, there in zip(rows, known, strict=True)],
        )
        for one in table.columns[3:]  # after the columns of times
        if one.kind in KINDS
    ]


STANDING_MPS: Final = 0.1
"""Speed (m/s) below which a train stands."""
LAST_NS: Final = 2**62


class FileFormat(StrEnum):
    """The file formats of the tables."""

    PARQUET = "parquet"
    CSV = "csv"
    BOTH = "both"


@dataclass(frozen=True, kw_only=True)
class ExportSettings:
    """The exported part of a recording, and options. Times are as the user wrote them (see `DriveClock.moment_ns`)."""

    start: str | None = None
    end: str | None = None
    trim_ends: bool = False
    anonymous: bool = False
    format: FileFormat = FileFormat.BOTH


def export(path: Path, folder: Path, settings: ExportSettings, train: str | None = None) -> dict[str, int]:
    """Write the tables of a recording into a new folder, which appears complete or not at all; return their rows.

    Raises DasError for an unusable recording or time, and if the folder is not empty or cannot be made.
    """
    check_folder(folder)
    if settings.format is not FileFormat.CSV:
        require_parquet()
    drive = DriveTable.of(open_recording(path, train))
    clock, zero_m = DriveClock.of_recording(drive.recording), first_m(drive)
    zero_ns, span = clock.zero_ns, _span(drive, settings, clock)
    tables = _as_recorded(drive.recording, zero_ns, span)
    if not any(len(one) for one in tables):
        raise DasError(f"{path}: there is nothing between --from and --to")
    if settings.anonymous:
        tables = [kept for one in tables if (kept := anonymous(one, zero_ns, zero_m)) is not None]
    named = {one.name: one for one in tables}
    joined = by_time(named, 0 if settings.anonymous else zero_ns)
    tables += [] if joined is None else [joined]
    about = _about(drive.recording, settings, zero_ns, span)
    write_folder_whole(folder, _files(tables, about, settings.format))
    return {one.name: len(one) for one in tables}


def check_folder(folder: Path) -> None:
    """Raise DasError if a folder is not empty or cannot be made."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise DasError(f"{folder}: exists already, expected a new or empty folder")
    if not folder.resolve().parent.is_dir():
        raise DasError(f"{folder}: no such folder {folder.parent}")


def first_m(drive: DriveTable) -> float:
    """The position (m) of the journey's first stop, else the first position recorded; 0 if there is none."""
    for journey in drive.said.journeys[:1]:
        if journey.stops:
            return journey.stops[0].s_m
    _, positions = drive.of_topic("position", "s_m")
    known = positions[np.isfinite(positions)]
    return float(known[0]) if len(known) else 0.0


def _span(drive: DriveTable, settings: ExportSettings, clock: DriveClock) -> tuple[int, int]:
    start_ns = clock.moment_ns(settings.start) if settings.start is not None else 0
    end_ns = clock.moment_ns(settings.end) if settings.end is not None else LAST_NS
    if end_ns < start_ns:
        raise DasError(f"--to {settings.end}: expected a time after --from")
    if not settings.trim_ends:
        return start_ns, end_ns
    time_ns, speed_mps = drive.of_topic("truth" if drive.has("truth") else "position", "speed_mps")
    moving = time_ns[speed_mps > STANDING_MPS]
    if not len(moving):
        raise DasError(f"{drive.recording.path}: --trim-ends: the train does not move in this recording")
    return max(start_ns, int(moving[0])), min(end_ns, int(moving[-1]))


def _as_recorded(recording: Recording, zero_ns: int, span: tuple[int, int]) -> list[DataTable]:
    """A table for each topic: every message with all its fields, texts, lists and times of recording.

    A `DriveTable` does not contain them all: it has only the evaluated columns, and one message of a topic at a moment.
    """
    found = []
    for topic in topics.TOPICS:
        entries = recording.of(topic)
        for table in tables_of(topic.name, entries, zero_ns) if entries else ():
            found.append(table.only([span[0] <= one <= span[1] for one in table[TIME].values]))
    return found


def _about(recording: Recording, settings: ExportSettings, zero_ns: int, span: tuple[int, int]) -> dict[str, Any]:
    """The origin of the tables; in an anonymous export without anything that identifies the train or the line."""
    health = recording.health
    about: dict[str, Any] = {
        "version": __version__,
        "anonymous": settings.anonymous,
        "trim_ends": settings.trim_ends,
        "complete": recording.complete,
        "damage": [one.what for one in health.damage],
        "messages_missing": health.missing,
    }
    if settings.anonymous:
        return about
    return {
        **about,
        "recording": recording.path.name,
        "train": recording.train,
        "zero_ns": zero_ns,
        "from_ns": span[0] or None,
        "to_ns": span[1] if span[1] != LAST_NS else None,
        "metadata": recording.metadata,
        "attachments": list(recording.attachments),
    }


def _files(tables: Sequence[DataTable], about: dict[str, Any], kind: FileFormat) -> dict[str, bytes]:
    texts = {key: value if isinstance(value, str) else json.dumps(value) for key, value in about.items()}
    files = {"export.json": json.dumps(about, indent=2, ensure_ascii=False).encode()}
    files["columns.csv"] = as_csv(columns_table(list(tables)))
    for one in tables:
        if kind is not FileFormat.PARQUET:
            files[f"{one.name}.csv"] = as_csv(one)
        if kind is not FileFormat.CSV:
            files[f"{one.name}.parquet"] = as_parquet(one, texts)
    return files


KEPT: Final[Mapping[str, str]] = {
    "position": "s_m speed_mps uncertainty_m quality speed_uncertainty_mps",
    "delay": "delay_s",
    "effort": "force_el_n force_friction_n",
    "journey": "",
    "journey_stops": "number s_m arrival_ns departure_ns",
    "restriction": "",
    "restriction_restrictions": "number start_m end_m limit_mps valid_from_ns valid_until_ns",
    "target": "",
    "target_targets": "number s_m arrival_ns earliest_ns latest_ns",
    "control": "tick command restrictions_ns targets_ns",
    "advice": (
        "tick position_time_ns s_m speed_mps mode advised_speed_mps advised_force_n advised_force_ratio "
        "horizon_speed_mps horizon_force_n next_mode next_change_m next_change_s predicted_arrival_ns "
        "predicted_deviation_s buffer_ratio energy_to_go_j source valid_until_ns limit_mps position_sd_m "
        "display_speed_mps cause guide_now_mode "
        "guide_now_speed_mps guide_now_effort_ratio guide_now_way_m guide_now_in_s guide_target_m guide_target_s "
        "guide_force_n guide_replan_cause guide_replan_time_ns guide_replan_gain_j guide_replan_gain_s "
        "guide_reference_force_n guide_reason_code guide_reason_speed_mps guide_reason_at_m guide_reason_time_ns "
        "guide_reason_late_s guide_lever_ratio departure_speed_mps departure_force_ratio reason_code "
        "reason_speed_mps reason_at_m reason_time_ns reason_late_s replaced_parts"
    ),
    "advice_guide_following": "number mode speed_mps effort_ratio way_m in_s",
    "plan": "s_m t_s speed_mps force_n",
    "estimate": "mass_ratio mass_sd_ratio resistance_ratio resistance_sd_ratio samples usable differs",
    "status": "state solve_s last_advice_s advices cause",
    "event": "level",
    "truth": (
        "s_m speed_mps acceleration_mps2 force_el_n force_friction_n energy_input_j gradient_ratio limit_mps "
        "adhesion_ratio head_wind_mps resistance_j component_loss_j auxiliary_j friction_brake_j unreturned_j "
        "comfort_j blending_j"
    ),
    "cab": (
        "presentation mode advised_speed_mps advised_lever_ratio next_mode next_change_s limit_mps signal_m "
        "lever_ratio display_speed_mps look clock_s s_m speed_mps stop_m departure_s arrival_s may_depart advice_s "
        "valid_until_s advised_force_n due_s target_way_m friction_ratio deviation_s next_speed_mps "
        "next_effort_ratio horizon_speed_mps horizon_force_n reason_code reason_speed_mps reason_at_m "
        "reason_time_ns reason_late_s interlock late_s gradient_ratio force_el_n force_friction_n cause "
        "next_change_m second_mode second_change_s second_change_m second_speed_mps second_effort_ratio wall_ns"
    ),
    "cab_restrictions": "number start_m end_m limit_mps valid_from_ns valid_until_ns",
    "cab_limits_ahead": "number s_m limit_mps",
    "controls": "look lever_ratio force_n friction_ratio",
    "action": "number device lever_ratio look browser_ns server_ns bus_ns",
    "mark": "kind look browser_ns server_ns bus_ns",
    "decision": "kind value",
    "measures": "shown_s advice_changes_per_min reversals shortest_mode_s",
    "saving": "measured comparable driven_j optimum_j likely_low_j likely_high_j",
    "saving_sections": "number trip_s driven_j optimum_j faster_than_possible",
    "log": "level",
    "recorder": "tick messages advice_tick node_state",
}
"""Columns of each table that an anonymous export keeps in addition to the times of a row; all others are left out.

A new field is therefore left out until it is added here. A position on the route is added to `POSITIONS` as well.
Texts are not kept, since reasons and remarks may name stops.
"""
POSITIONS: Final = ("s_m", "start_m", "end_m", "signal_m", "stop_m", "reason_at_m", "guide_reason_at_m")
"""Columns that are positions on the route; in an anonymous export they count from the first stop."""
TIMES_END: Final = "_ns"
"""Ending of columns that are moments; in an anonymous export they count from the departure, which hides the date."""


def anonymous(table: DataTable, zero_ns: int, zero_m: float) -> DataTable | None:
    """The table without anything that identifies the train or the line; None for a table that is left out.

    `zero_ns` (ns since 1970) and `zero_m` become 0.
    """
    if table.name not in KEPT:
        return None
    kept = {LOG_TIME, TIME, SINCE_START, *KEPT[table.name].split()}
    return replace(table, columns=[_shifted(one, zero_ns, zero_m) for one in table.columns if one.name in kept])


def _shifted(column: Column, zero_ns: int, zero_m: float) -> Column:
    if column.name.endswith(TIMES_END):
        values: list[Any] = [None if not value else value - zero_ns for value in column.values]
        return replace(column, values=values, meaning=f"{column.meaning or 'a moment'}; counted from the departure")
    if column.name not in POSITIONS:
        return column
    return replace(
        column,
        values=[
            [x - zero_m for x in one] if isinstance(one, list) else None if one is None else one - zero_m
            for one in column.values
        ],
    )
