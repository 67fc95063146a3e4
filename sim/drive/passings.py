"""How a drive kept the passings of its journey: points at which it does not stop."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from das.domain.journey import Passing
from das.domain.units import NS
from sim.recording.course import known, minutes

PASSINGS: Final = "passings"
"""The key of a recording's metadata for the passings of its journey."""
KEPT_S: Final = 1.0
"""Time (s) beyond its tolerance by which a passing that is kept may be missed: states are recorded once a second."""


@dataclass(frozen=True, kw_only=True)
class DuePassing:
    """A passing of a journey under way, with its times in ns since 1970 (0: open)."""

    name: str
    s_m: float
    earliest_ns: int = 0
    latest_ns: int = 0
    wish: bool = False
    tolerance_s: float = 0.0

    @classmethod
    def of(cls, passing: Passing, zero_ns: int) -> DuePassing:
        """A passing of a journey whose clock shows 0 at `zero_ns`."""
        bounds_s = (passing.window.earliest_s, passing.window.latest_s)
        earliest_ns, latest_ns = (zero_ns + round(x / NS) if math.isfinite(x) else 0 for x in bounds_s)
        return cls(
            name=passing.name,
            s_m=passing.position_m,
            earliest_ns=earliest_ns,
            latest_ns=latest_ns,
            wish=passing.wish,
            tolerance_s=passing.tolerance_s,
        )


@dataclass(frozen=True, kw_only=True)
class KeptPassing:
    """A passing and when the train was there (ns since 1970; 0: it was not)."""

    due: DuePassing
    passed_ns: int

    @property
    def late_s(self) -> float:
        """By how much (s; early < 0) the train was outside the window; NaN if it was not there or no time is due."""
        due = self.due
        if not self.passed_ns or not (due.earliest_ns or due.latest_ns):
            return math.nan
        late_ns = max(self.passed_ns - due.latest_ns, 0) if due.latest_ns else 0
        early_ns = min(self.passed_ns - due.earliest_ns, 0) if due.earliest_ns else 0
        return (late_ns + early_ns) * NS

    @property
    def words(self) -> str:
        """Whether the passing was kept: its tolerance counts."""
        if not self.passed_ns:
            return "not reached"
        if math.isnan(self.late_s):
            return ""
        kept = abs(self.late_s) <= self.due.tolerance_s + KEPT_S
        return f"{'wish ' if self.due.wish else ''}{'kept' if kept else 'missed'}"


def keep(due: Sequence[DuePassing], time_ns: NDArray[np.int64], s_m: NDArray[np.float64]) -> tuple[KeptPassing, ...]:
    """When a train that was at positions (m) at times (ns) passed each point."""
    zero_ns, reached_m = int(time_ns[0]), np.maximum.accumulate(s_m)
    found = []
    for one in due:
        there = reached_m[0] <= one.s_m <= reached_m[-1]
        since = float(np.interp(one.s_m, reached_m, (time_ns - zero_ns).astype(float)))
        found.append(KeptPassing(due=one, passed_ns=zero_ns + round(since) if there else 0))
    return tuple(found)


def as_rows(kept: Sequence[KeptPassing], zero_ns: int) -> list[dict[str, Any]]:
    """How the passings were kept, for programs; times (s) count from `zero_ns`; None: there is none."""

    def since_s(time_ns: int) -> float | None:
        return (time_ns - zero_ns) * NS if time_ns else None

    return [
        {
            "name": one.due.name,
            "s_m": one.due.s_m,
            "earliest_s": since_s(one.due.earliest_ns),
            "latest_s": since_s(one.due.latest_ns),
            "passed_s": since_s(one.passed_ns),
            "late_s": known(one.late_s),
            "wish": one.due.wish,
            "tolerance_s": one.due.tolerance_s,
        }
        for one in kept
    ]


def passing_metadata(due: Sequence[DuePassing]) -> dict[str, str]:
    """The passings as a recording states them; empty without any."""
    return {PASSINGS: json.dumps([asdict(one) for one in due])} if due else {}


def recorded_passings(metadata: Mapping[str, str]) -> tuple[DuePassing, ...]:
    """The passings that a recording states; none if its text makes no sense."""
    try:
        return tuple(_checked(DuePassing(**row)) for row in json.loads(metadata.get(PASSINGS, "[]")))
    except (ValueError, TypeError, RecursionError):
        return ()


def _checked(due: DuePassing) -> DuePassing:
    """A passing with values that a passing may have; raises TypeError or ValueError for any other."""
    numbers = (due.s_m, due.earliest_ns, due.latest_ns, due.tolerance_s)
    if not isinstance(due.name, str) or not all(0 <= number < 2**63 for number in numbers):
        raise ValueError(due)
    return due


def table(kept: Sequence[KeptPassing], zero_ns: int) -> Table:
    """A table of when the train was at the passings of its journey, on a clock that shows 0 at `zero_ns`."""
    found = Table(title="passings", title_justify="left")
    found.add_column("point")
    for name in ("due", "passed", "late", ""):
        found.add_column(name, justify="right")
    for row, one in zip(as_rows(kept, zero_ns), kept, strict=True):
        ends = ["…" if row[key] is None else minutes(row[key]) for key in ("earliest_s", "latest_s")]
        due = "" if ends == ["…", "…"] else ends[0] if ends[0] == ends[1] else " – ".join(ends)
        due += f" ± {one.due.tolerance_s:g} s" if one.due.wish else ""
        passed = "" if row["passed_s"] is None else minutes(row["passed_s"])
        late = "" if row["late_s"] is None else f"{row['late_s']:+.0f} s"
        found.add_row(one.due.name, due, passed, late, one.words)
    return found
