"""Findings of the cleaning: what was wrong with a record, how often, where first, and what was done about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

import numpy as np

from das.domain.errors import DasError
from das.domain.units import NS
from sim.trips.record import Record


class FindingKind(StrEnum):
    """All that cleaning looks for: a name, words, what is done about it, and whether `--strict` refuses it."""

    words: str
    done: str
    refused: bool

    def __new__(cls, name: str, words: str, done: str, refused: bool = False) -> FindingKind:
        """A kind of finding, whose value is its name."""
        kind = str.__new__(cls, name)
        kind._value_, kind.words, kind.done, kind.refused = name, words, done, refused
        return kind

    NEWEST_FIRST = "newest_first", "newest point first", "turned round", True
    OTHER_WAY = "other_way", "trip runs the other way", "driven the other way", True
    DUPLICATE_TIME = "duplicate_time", "time given twice", "dropped", True
    TIME_BACK = "time_back", "time running back", "dropped", True
    NO_POSITION = "no_position", "no position", "dropped", True
    OFF_LINE = "off_line", "off the line before or after", "cut", True
    POSITION_FROZEN = "position_frozen", "position frozen while moving", "dropped", True
    POSITION_JUMP = "position_jump", "position jump", "dropped", True
    FAR_APART = "far_apart", "other part of the record, beyond a long gap", "cut", True
    BEFORE_SECTION = "before_section", "before the section", "cut", True
    AFTER_SECTION = "after_section", "after the section", "cut", True
    LONG_STAND_AT_START = "long_stand_at_start", "long stand at the start", "cut"
    LONG_STAND_AT_END = "long_stand_at_end", "long stand at the end", "cut"
    STANDING_DRIFT = "standing_drift", "position drifts while standing", "put together"
    SLOWS_TO_STAND = "slows_to_stand", "slows down to a stand at an end of the record", "taken for a stand"
    STEP_BACK = "step_back", "small step back", "made flat"
    SPEED_MISSING = "speed_missing", "no usable speed", "speed from positions"
    SPEED_DROPOUT = "speed_dropout", "speed dropout", "speed from positions"
    SPEED_SPIKE = "speed_spike", "impossible speed", "speed from positions"
    GAP = "gap", "gap in time", "bridged"
    STARTS_MOVING = "starts_moving", "starts moving", "left open"
    ENDS_MOVING = "ends_moving", "ends moving, no final stop", "left open"


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
        parts = [f"{f.count} × {f.kind.words} ({f.kind.done})" for f in self.findings]
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
                    "done": f.kind.done,
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
        if self.strict and kind.refused:
            seen = f", {detail}" if detail else ""
            raise DasError(
                f"{record.source}: {record.where(first)}: {kind.words}{seen} ({len(points)} in all; --strict)"
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
        ordered = sorted(self.found, key=lambda f: (f.kind.done not in _REMOVING, list(FindingKind).index(f.kind)))
        return CleaningReport(read=self.read, kept=kept, findings=tuple(ordered), unread=unread)
