"""Findings of the cleaning: what was wrong with a record, how often, where first, and what was done about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from das.domain.errors import DasError
from das.domain.units import NS
from sim.trips.record import Record


class FindingKind(StrEnum):
    """Everything that cleaning looks for."""

    NEWEST_FIRST = "newest_first"
    OTHER_WAY = "other_way"
    DUPLICATE_TIME = "duplicate_time"
    TIME_BACK = "time_back"
    NO_POSITION = "no_position"
    OFF_LINE = "off_line"
    POSITION_FROZEN = "position_frozen"
    POSITION_JUMP = "position_jump"
    FAR_APART = "far_apart"
    BEFORE_SECTION = "before_section"
    AFTER_SECTION = "after_section"
    LONG_STAND_AT_START = "long_stand_at_start"
    LONG_STAND_AT_END = "long_stand_at_end"
    STANDING_DRIFT = "standing_drift"
    SLOWS_TO_STAND = "slows_to_stand"
    STEP_BACK = "step_back"
    SPEED_MISSING = "speed_missing"
    SPEED_DROPOUT = "speed_dropout"
    SPEED_SPIKE = "speed_spike"
    GAP = "gap"
    STARTS_MOVING = "starts_moving"
    ENDS_MOVING = "ends_moving"


class KindWords(NamedTuple):
    """A kind of finding in words, what is done about it, and whether `--strict` refuses it."""

    words: str
    done: str
    refused: bool = False


TOLD = {
    FindingKind.NEWEST_FIRST: KindWords("newest point first", "turned round", True),
    FindingKind.OTHER_WAY: KindWords("trip runs the other way", "driven the other way", True),
    FindingKind.DUPLICATE_TIME: KindWords("time given twice", "dropped", True),
    FindingKind.TIME_BACK: KindWords("time running back", "dropped", True),
    FindingKind.NO_POSITION: KindWords("no position", "dropped", True),
    FindingKind.OFF_LINE: KindWords("off the line before or after", "cut", True),
    FindingKind.POSITION_FROZEN: KindWords("position frozen while moving", "dropped", True),
    FindingKind.POSITION_JUMP: KindWords("position jump", "dropped", True),
    FindingKind.FAR_APART: KindWords("other part of the record, beyond a long gap", "cut", True),
    FindingKind.BEFORE_SECTION: KindWords("before the section", "cut", True),
    FindingKind.AFTER_SECTION: KindWords("after the section", "cut", True),
    FindingKind.LONG_STAND_AT_START: KindWords("long stand at the start", "cut"),
    FindingKind.LONG_STAND_AT_END: KindWords("long stand at the end", "cut"),
    FindingKind.STANDING_DRIFT: KindWords("position drifts while standing", "put together"),
    FindingKind.SLOWS_TO_STAND: KindWords("slows down to a stand at an end of the record", "taken for a stand"),
    FindingKind.STEP_BACK: KindWords("small step back", "made flat"),
    FindingKind.SPEED_MISSING: KindWords("no usable speed", "speed from positions"),
    FindingKind.SPEED_DROPOUT: KindWords("speed dropout", "speed from positions"),
    FindingKind.SPEED_SPIKE: KindWords("impossible speed", "speed from positions"),
    FindingKind.GAP: KindWords("gap in time", "bridged"),
    FindingKind.STARTS_MOVING: KindWords("starts moving", "left open"),
    FindingKind.ENDS_MOVING: KindWords("ends moving, no final stop", "left open"),
}
_REMOVING = ("dropped", "cut")


@dataclass(frozen=True, kw_only=True)
class TripFinding:
    """One kind of finding: at how many points (or gaps) it was, where first, and what was seen."""

    kind: FindingKind
    count: int
    first: str
    first_time_ns: int
    detail: str

    @property
    def told(self) -> KindWords:
        return TOLD[self.kind]

    @property
    def first_time(self) -> str:
        """Time of the first occurrence, UTC."""
        return f"{datetime.fromtimestamp(self.first_time_ns * NS, UTC):%Y-%m-%d %H:%M:%S}"


@dataclass(frozen=True, kw_only=True)
class CleaningReport:
    """What was found in a record of `read` points, of which `kept` are left."""

    read: int
    kept: int
    findings: tuple[TripFinding, ...] = ()
    unread: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        """The report in one line."""
        parts = [f"{f.count} × {f.told.words} ({f.told.done})" for f in self.findings]
        return f"{self.kept} of {self.read} points kept; " + ("; ".join(parts) or "nothing to clean")

    def as_object(self) -> dict[str, Any]:
        """The report as an object for JSON."""
        return {
            "points_read": self.read,
            "points_kept": self.kept,
            "columns_not_read": list(self.unread),
            "findings": [
                {
                    "kind": str(f.kind),
                    "count": f.count,
                    "done": f.told.done,
                    "first": f.first,
                    "first_time": f.first_time,
                    "first_time_ns": f.first_time_ns,
                    "detail": f.detail,
                }
                for f in self.findings
            ],
        }


@dataclass
class FindingLog:
    """Collects findings while a record is cleaned; `strict` refuses what would drop points or turn the trip round."""

    strict: bool = False
    read: int = 0
    found: list[TripFinding] = field(default_factory=list)

    def add(self, kind: FindingKind, record: Record, which: Any, detail: str = "") -> None:
        """Count the points `which` (mask or indices) of a record; nothing where there are none.

        Raises DasError where the log is strict about this kind.
        """
        which = np.asarray(which)
        points = np.flatnonzero(which) if which.dtype == bool else which
        if not len(points):
            return
        first = int(points[0])
        told = TOLD[kind]
        if self.strict and told.refused:
            seen = f", {detail}" if detail else ""
            raise DasError(
                f"{record.source}: {record.where(first)}: {told.words}{seen} ({len(points)} in all; --strict)"
            )
        self.found.append(
            TripFinding(
                kind=kind,
                count=len(points),
                first=record.where(first),
                first_time_ns=int(record.time_ns[first]),
                detail=detail,
            )
        )

    def report(self, kept: int, unread: tuple[str, ...]) -> CleaningReport:
        """All findings, those that removed points first."""
        ordered = sorted(self.found, key=lambda f: (f.told.done not in _REMOVING, list(FindingKind).index(f.kind)))
        return CleaningReport(read=self.read, kept=kept, findings=tuple(ordered), unread=unread)
