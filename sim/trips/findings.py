"""What was wrong with a record and what was done about it: kinds, counts, first occurrences."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from das.domain.errors import DasError
from das.domain.units import NS
from sim.trips.record import Record


class Kind(StrEnum):
    """Everything cleaning looks for."""

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


class Told(NamedTuple):
    """A kind in words, what is done about it, and whether `--strict` refuses it."""

    words: str
    done: str
    refused: bool = False


TOLD = {
    Kind.NEWEST_FIRST: Told("newest point first", "turned round", True),
    Kind.OTHER_WAY: Told("trip runs the other way", "driven the other way", True),
    Kind.DUPLICATE_TIME: Told("time given twice", "dropped", True),
    Kind.TIME_BACK: Told("time running back", "dropped", True),
    Kind.NO_POSITION: Told("no position", "dropped", True),
    Kind.OFF_LINE: Told("off the line before or after", "cut", True),
    Kind.POSITION_FROZEN: Told("position frozen while moving", "dropped", True),
    Kind.POSITION_JUMP: Told("position jump", "dropped", True),
    Kind.FAR_APART: Told("other part of the record, beyond a long gap", "cut", True),
    Kind.BEFORE_SECTION: Told("before the section", "cut", True),
    Kind.AFTER_SECTION: Told("after the section", "cut", True),
    Kind.LONG_STAND_AT_START: Told("long stand at the start", "cut"),
    Kind.LONG_STAND_AT_END: Told("long stand at the end", "cut"),
    Kind.STANDING_DRIFT: Told("position drifts while standing", "put together"),
    Kind.SLOWS_TO_STAND: Told("slows down to a stand at an end of the record", "taken for a stand"),
    Kind.STEP_BACK: Told("small step back", "made flat"),
    Kind.SPEED_MISSING: Told("no usable speed", "speed from positions"),
    Kind.SPEED_DROPOUT: Told("speed dropout", "speed from positions"),
    Kind.SPEED_SPIKE: Told("impossible speed", "speed from positions"),
    Kind.GAP: Told("gap in time", "bridged"),
    Kind.STARTS_MOVING: Told("starts moving", "left open"),
    Kind.ENDS_MOVING: Told("ends moving, no final stop", "left open"),
}
_REMOVING = ("dropped", "cut")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One kind of dirt: how many points (gaps: how many gaps), where first, what was seen."""

    kind: Kind
    count: int
    first: str
    first_time_ns: int
    detail: str

    @property
    def told(self) -> Told:
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
    findings: tuple[Finding, ...] = ()
    unread: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        """One line."""
        parts = [f"{f.count} × {f.told.words} ({f.told.done})" for f in self.findings]
        return f"{self.kept} of {self.read} points kept; " + ("; ".join(parts) or "nothing to clean")

    def as_object(self) -> dict[str, Any]:
        """For JSON."""
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
    found: list[Finding] = field(default_factory=list)

    def add(self, kind: Kind, record: Record, which: Any, detail: str = "") -> None:
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
            Finding(
                kind=kind,
                count=len(points),
                first=record.where(first),
                first_time_ns=int(record.time_ns[first]),
                detail=detail,
            )
        )

    def report(self, kept: int, unread: tuple[str, ...]) -> CleaningReport:
        """All findings, those that removed points first."""
        ordered = sorted(self.found, key=lambda f: (f.told.done not in _REMOVING, list(Kind).index(f.kind)))
        return CleaningReport(read=self.read, kept=kept, findings=tuple(ordered), unread=unread)
