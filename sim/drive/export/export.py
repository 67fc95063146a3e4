"""Exports a recording: one table per topic, one joined by time, one joined by position, and a note of their origin."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from sim.drive.export.anonymous import anonymous
from sim.drive.export.tables import (
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

STEP_M: Final = 10.0
"""Distance (m) between two rows of the table by position."""
MOVING: Final = ("truth", "position")
"""Topics that state where the train is; the first one recorded is used. Their numbers are interpolated between two
messages; numbers of other topics hold until the next message."""
JOINED: Final = ("truth", "position", "advice", "cab", "effort", "delay", "estimate", "status")
"""Topics whose columns are in the tables by time and by position."""
LASTING: Final = ("delay", "estimate")
"""Topics whose messages hold until the next one, however long that takes; those of others hold for `HOLDS_S`."""
KINDS: Final = ("float", "int", "bool", "choice")


def by_time(tables: Mapping[str, DataTable], zero_ns: int) -> DataTable | None:
    """One row for each message that states where the train is; None if there are none."""
    base = _base(tables)
    if base is None:
        return None
    at_ns = np.unique(_times(base))
    return DataTable(name="by_time", columns=[*_moments(at_ns, zero_ns), *_joined(tables, at_ns)])


def by_position(tables: Mapping[str, DataTable], zero_ns: int) -> DataTable | None:
    """One row every `STEP_M` along the route as driven; None if the train did not move.

    A row has the time at which the train first reached its position. There are no rows where the position was not
    recorded for longer than `HOLDS_S`.
    """
    base = _base(tables)
    if base is None:
        return None
    time_ns, s_m = _first_there(base)
    if len(s_m) < 2:
        return None
    places = np.arange(np.ceil(s_m[0] / STEP_M), np.floor(s_m[-1] / STEP_M) + 1) * STEP_M
    if len(places):
        at_ns = time_ns[0] + np.rint(np.interp(places, s_m, (time_ns - time_ns[0]).astype(np.float64))).astype(np.int64)
        there = _between_neighbours(np.sort(_times(base)), at_ns)
        places, at_ns = places[there], at_ns[there]
    if not len(places):
        return None
    lasts = [*(np.diff(at_ns) * NS).tolist(), None]
    columns = [
        Column(name="s_m", kind="float", values=places.tolist(), meaning="position of the train's head on the route"),
        *_moments(at_ns, zero_ns),
        Column(name="to_next_s", kind="float", values=lasts, meaning="time from this row to the next, stands included"),
        *_joined(tables, at_ns),
    ]
    return DataTable(name="by_position", columns=columns)


def _first_there(base: DataTable) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Times (ns) and positions (m) at which the train was further than ever before, in the order of the times."""
    time_ns, s_m = _times(base), np.array(base["s_m"].values, dtype=np.float64)
    order = np.argsort(time_ns, kind="stable")
    order = order[np.isfinite(s_m[order])]
    time_ns, s_m = time_ns[order], s_m[order]
    ahead = np.ones(len(s_m), dtype=bool)
    ahead[1:] = s_m[1:] > np.maximum.accumulate(s_m)[:-1]
    return time_ns[ahead], s_m[ahead]


def _base(tables: Mapping[str, DataTable]) -> DataTable | None:
    return next((tables[name] for name in MOVING if name in tables and len(tables[name])), None)


def _times(table: DataTable) -> NDArray[np.int64]:
    return np.array(table[TIME].values, dtype=np.int64)


def _moments(at_ns: NDArray[np.int64], zero_ns: int) -> list[Column]:
    return [
        Column(name=TIME, kind="int", values=at_ns.tolist(), meaning="since 1970 (UTC)"),
        Column(name=SINCE_START, kind="float", values=((at_ns - zero_ns) / 1e9).tolist(), meaning=ON_THE_CLOCK),
    ]


def _joined(tables: Mapping[str, DataTable], at_ns: NDArray[np.int64]) -> list[Column]:
    """The columns of all topics at some moments, each with its topic's name in front."""
    columns = []
    for name in JOINED:
        if name in tables and len(tables[name]):
            columns += _at(tables[name], at_ns)
    return columns


def _at(table: DataTable, at_ns: NDArray[np.int64]) -> list[Column]:
    order = np.argsort(_times(table), kind="stable")
    time_ns = _times(table)[order]
    last = np.searchsorted(time_ns, at_ns, side="right") - 1
    age_s = (at_ns - time_ns[np.maximum(last, 0)]) * NS
    known = (last >= 0) & ((age_s <= HOLDS_S) | (table.name in LASTING))
    near = known & _between_neighbours(time_ns, at_ns)
    columns = []
    for one in table.columns[3:]:  # behind the times
        if one.kind not in KINDS:
            continue
        ordered = [one.values[i] for i in order]
        values = _steady(ordered, time_ns, at_ns) if table.name in MOVING and one.kind == "float" else None
        held: Sequence[Any] = values if values is not None else [ordered[i] for i in np.maximum(last, 0)]
        kept = [x if there else None for x, there in zip(held, known if values is None else near, strict=True)]
        columns.append(Column(name=f"{table.name}_{one.name}", kind=one.kind, values=kept, meaning=one.meaning))
    return columns


def _between_neighbours(time_ns: NDArray[np.int64], at_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether moments lie on a message or between two that are close together; elsewhere messages are missing."""
    last = np.maximum(np.searchsorted(time_ns, at_ns, side="right") - 1, 0)
    following = np.minimum(last + 1, len(time_ns) - 1)
    near: NDArray[np.bool_] = (time_ns[last] == at_ns) | ((time_ns[following] - time_ns[last]) * NS <= HOLDS_S)
    return near


def _steady(values: list[Any], time_ns: NDArray[np.int64], at_ns: NDArray[np.int64]) -> list[float]:
    """Numbers at some moments, interpolated linearly between the known ones."""
    numbers = np.array([np.nan if one is None else one for one in values], dtype=np.float64)
    zero = time_ns[0]
    return [float(x) for x in np.interp((at_ns - zero).astype(float), (time_ns - zero).astype(float), numbers)]


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
    """Which part of a recording is exported, and how. Times are as the user wrote them (see `DriveClock.moment_ns`)."""

    start: str | None = None
    end: str | None = None
    trim_ends: bool = False
    anonymous: bool = False
    format: FileFormat = FileFormat.BOTH


@dataclass(frozen=True, kw_only=True)
class Exported:
    """What was written: the number of rows of each table, and of all files."""

    folder: Path
    rows: dict[str, int]
    files: int


def export(path: Path, folder: Path, settings: ExportSettings, train: str | None = None) -> Exported:
    """Write the tables of a recording into a new folder, which appears complete or not at all.

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
    joined = [one(named, 0 if settings.anonymous else zero_ns) for one in (by_time, by_position)]
    tables += [one for one in joined if one is not None]
    about = _about(drive.recording, settings, zero_ns, span)
    write_folder_whole(folder, _files(tables, about, settings.format))
    return Exported(folder=folder, rows={one.name: len(one) for one in tables}, files=len(list(folder.iterdir())))


def check_folder(folder: Path) -> None:
    """Raise DasError if a folder is not empty or cannot be made."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise DasError(f"{folder}: exists already, expected a new or empty folder")
    if not folder.resolve().parent.is_dir():
        raise DasError(f"{folder}: no such folder {folder.parent}")


def first_m(drive: DriveTable) -> float:
    """The position (m) of the journey's first stop, else the first position recorded; 0 without any."""
    for journey in drive.said.journeys[:1]:
        if journey.stops:
            return journey.stops[0].s_m
    _, positions = drive.of_topic("position", "s_m")
    known = positions[np.isfinite(positions)]
    return float(known[0]) if len(known) else 0.0


def _span(drive: DriveTable, settings: ExportSettings, clock: DriveClock) -> tuple[int, int]:
    """The first and the last moment (ns) to export."""
    start_ns = clock.moment_ns(settings.start) if settings.start is not None else 0
    end_ns = clock.moment_ns(settings.end) if settings.end is not None else LAST_NS
    if end_ns < start_ns:
        raise DasError(f"--to {settings.end}: expected a time after --from")
    if not settings.trim_ends:
        return start_ns, end_ns
    moving = _moving_ns(drive)
    if not len(moving):
        raise DasError(f"{drive.recording.path}: --trim-ends: the train does not move in this recording")
    return max(start_ns, int(moving[0])), min(end_ns, int(moving[-1]))


def _moving_ns(drive: DriveTable) -> NDArray[np.int64]:
    """The times (ns) at which the train moves, in order."""
    time_ns, speed_mps = drive.of_topic("truth" if drive.has("truth") else "position", "speed_mps")
    return np.asarray(time_ns[speed_mps > STANDING_MPS])


def _as_recorded(recording: Recording, zero_ns: int, span: tuple[int, int]) -> list[DataTable]:
    """A table for each topic: every message with all its fields, texts, lists and times of recording.

    A `DriveTable` has what is evaluated of a drive, one message of a topic at a moment: not these.
    """
    found = []
    for topic in topics.TOPICS:
        entries = recording.of(topic)
        for table in tables_of(topic.name, entries, zero_ns) if entries else ():
            found.append(table.only([span[0] <= one <= span[1] for one in table[TIME].values]))
    return found


def _about(recording: Recording, settings: ExportSettings, zero_ns: int, span: tuple[int, int]) -> dict[str, Any]:
    """What the tables are made from; in an anonymous export without what identifies the train or the line."""
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
