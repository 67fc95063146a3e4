"""The stops of a drive, as served, and the passings of its journey, at which it does not stop.

In a recording, positions give arrivals and departures to a fraction of a second.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from das.domain.journey import OrderedStop
from das.domain.route import Stop
from das.domain.units import NS
from sim.drive.table import DriveTable
from sim.recording.course import DrivenCourse, StandingTime, known, minutes, stood_ns

if TYPE_CHECKING:
    from das.offline.asked_journey import Passing

NEAR_M: Final = 100.0
"""Largest distance (m) from a stop at which a train stands at the stop; of several standstills, the nearest counts."""
NEAR_ON_THE_WAY_M: Final = 300.0
"""Largest distance (m) from a stop outside the journey at which a train is at the stop: long trains reach far."""


@dataclass(frozen=True, kw_only=True)
class KeptCall:
    """One stop of a journey as served, in a run just driven or in a recording.

    Times are in ns since 1970, 0 if there is none: timetabled times (`due_`), and the train's arrival and departure.
    `stood_m` is where the train stood, NaN if it did not stop. `reached`: the train got as far as the stop. `stand`:
    the samples of the recording in which it stood. `passed_mps`: its speed there, if this is an end of a part without a
    stop.
    """

    name: str
    s_m: float
    due_arrival_ns: int
    due_departure_ns: int
    arrived_ns: int
    departed_ns: int
    stood_m: float
    reached: bool = True
    stand: StandingTime | None = None
    passed_mps: float = 0.0

    @property
    def served(self) -> bool:
        """Whether the train stopped."""
        return not math.isnan(self.stood_m)

    @property
    def stopping_error_m(self) -> float:
        """Distance of the train beyond the stop (m; before it: negative); NaN if it did not stop."""
        return self.stood_m - self.s_m

    @property
    def timed(self) -> bool:
        """Whether the timetable has a time for the stop."""
        return bool(self.due_arrival_ns or self.due_departure_ns)

    @property
    def arrived_late_s(self) -> float:
        """Lateness of the arrival (s; early < 0); NaN if the arrival or the due time is not known."""
        return _late_s(self.arrived_ns, self.due_arrival_ns)

    @property
    def departed_late_s(self) -> float:
        """Lateness of the departure (s; early < 0); NaN if the departure or the due time is not known."""
        return _late_s(self.departed_ns, self.due_departure_ns)

    @property
    def late_s(self) -> float:
        """Lateness of the arrival (s; early < 0), at the first stop of the departure; NaN if not known."""
        return self.arrived_late_s if self.due_arrival_ns else self.departed_late_s


class Travelled(NamedTuple):
    """The first and the last moment (ns since 1970) and position (m) of a drive.

    `between_stops`: from the departure at the first stop served to the arrival at the last. Otherwise the drive
    served fewer than two stops, and its whole course counts.
    """

    start_ns: int
    end_ns: int
    start_m: float
    end_m: float
    between_stops: bool

    @property
    def time_s(self) -> float:
        """The duration of the drive (s)."""
        return (self.end_ns - self.start_ns) * NS

    @property
    def way_m(self) -> float:
        """The distance covered (m)."""
        return self.end_m - self.start_m


class AtStop(NamedTuple):
    """A stop's name, and the span of time in which the train was there (ns since 1970); a moment if it did not stop."""

    name: str
    start_ns: int
    end_ns: int


def calls(table: DriveTable) -> tuple[KeptCall, ...]:
    """The stops of the last journey as served; empty without a journey. Without a timetable no times are due: the times
    of the journey are then taken from the drive itself.
    """
    if table.journey is None:
        return ()
    kept = kept_calls(table.journey.stops, table.course, table.received)
    return tuple(replace(one, due_arrival_ns=0, due_departure_ns=0) if table.own_timetable else one for one in kept)


def kept_calls(
    stops: Iterable[Any], trip: DrivenCourse, measured: DrivenCourse | None = None, near_m: float = NEAR_M
) -> tuple[KeptCall, ...]:
    """These stops as served; each stop has `name`, `s_m`, `arrival_ns` and `departure_ns`.

    `trip` shows where and when the train stood. If the course of a receiver (`measured`) has the same stand, it gives
    the times.
    """
    found: list[KeptCall] = []
    for stop in stops:
        stand, came_ns, left_ns = stood_ns(stop.s_m, near_m, trip, measured)
        found.append(
            KeptCall(
                name=stop.name,
                s_m=stop.s_m,
                due_arrival_ns=stop.arrival_ns,
                due_departure_ns=stop.departure_ns,
                arrived_ns=came_ns,
                departed_ns=left_ns,
                stood_m=math.nan if stand is None else stand.s_m,
                stand=stand,
                reached=bool(trip.s_m.max() >= stop.s_m - near_m),
            )
        )
    return tuple(found)


def calls_on_the_way(
    stops: Iterable[Stop], trip: DrivenCourse, measured: DrivenCourse | None = None
) -> tuple[KeptCall, ...]:
    """Stops of the route outside the journey, as served."""
    ordered = (OrderedStop(one.name, one.position_m) for one in stops)
    return kept_calls(ordered, trip, measured, near_m=NEAR_ON_THE_WAY_M)


def travelled(made: Sequence[KeptCall], trip: DrivenCourse) -> Travelled:
    """The first and the last moment and position of a drive, between its stops if it served two or more."""
    served = [one for one in made if one.served]
    if len(served) > 1 and served[0].departed_ns and served[-1].arrived_ns:
        first, last = served[0], served[-1]
        return Travelled(first.departed_ns, last.arrived_ns, first.s_m, last.s_m, between_stops=True)
    (start_ns, end_ns), (start_m, end_m) = trip.time_ns[[0, -1]].tolist(), trip.s_m[[0, -1]].tolist()
    return Travelled(start_ns, end_ns, start_m, end_m, between_stops=False)


def at_stops(made: Sequence[KeptCall], trip: DrivenCourse) -> tuple[AtStop, ...]:
    """The stops at which the train stood or which it passed, in order of time."""
    first_m, last_m = float(trip.s_m.min()), float(trip.s_m.max())
    met = (one for one in made if one.stand is not None or first_m <= one.s_m <= last_m)
    return tuple(sorted((_at(call, trip) for call in met), key=lambda at: at.start_ns))


def _at(call: KeptCall, trip: DrivenCourse) -> AtStop:
    if call.stand is None:
        came = min(int(np.searchsorted(np.maximum.accumulate(trip.s_m), call.s_m)), len(trip.time_ns) - 1)
        return AtStop(call.name, int(trip.time_ns[came]), int(trip.time_ns[came]))
    first_ns, last_ns = (int(trip.time_ns[i]) for i in call.stand[:2])
    return AtStop(call.name, call.arrived_ns or first_ns, call.departed_ns or last_ns)


def as_rows(made: Sequence[KeptCall], zero_ns: int) -> list[dict[str, Any]]:
    """Punctuality at every stop, for programs; times (s) count from `zero_ns`; None: not known.

    `stopping_error_m` is how far beyond the stop the train stood.
    """
    return [
        {
            "name": one.name,
            "s_m": one.s_m,
            "due_arrival_s": _since_s(one.due_arrival_ns, zero_ns),
            "arrived_s": _since_s(one.arrived_ns, zero_ns),
            "arrived_late_s": known(one.arrived_late_s),
            "due_departure_s": _since_s(one.due_departure_ns, zero_ns),
            "departed_s": _since_s(one.departed_ns, zero_ns),
            "departed_late_s": known(one.departed_late_s),
            "stopping_error_m": known(one.stopping_error_m),
            "reached": one.reached,
            "served": one.served,
        }
        for one in made
    ]


def _since_s(time_ns: int, zero_ns: int) -> float | None:
    return (time_ns - zero_ns) * NS if time_ns else None


def _late_s(time_ns: int, due_ns: int) -> float:
    return (time_ns - due_ns) * NS if time_ns and due_ns else math.nan


PASSINGS: Final = "passings"
"""The key of a recording's metadata for the passings of its journey."""
KEPT_S: Final = 1.0
"""Time (s) added to the tolerance of a passing, because states are recorded once a second."""


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
    """A passing and the time at which the train was there (ns since 1970; 0: never)."""

    due: DuePassing
    passed_ns: int

    @property
    def late_s(self) -> float:
        """Deviation (s; early < 0) of the train from the window; NaN if it was not there or no time is due."""
        due = self.due
        if not self.passed_ns or not (due.earliest_ns or due.latest_ns):
            return math.nan
        late_ns = max(self.passed_ns - due.latest_ns, 0) if due.latest_ns else 0
        early_ns = min(self.passed_ns - due.earliest_ns, 0) if due.earliest_ns else 0
        return (late_ns + early_ns) * NS

    @property
    def words(self) -> str:
        """Words on whether the passing was kept, within its tolerance."""
        if not self.passed_ns:
            return "not reached"
        if math.isnan(self.late_s):
            return ""
        kept = abs(self.late_s) <= self.due.tolerance_s + KEPT_S
        return f"{'wish ' if self.due.wish else ''}{'kept' if kept else 'missed'}"


def keep(due: Sequence[DuePassing], time_ns: NDArray[np.int64], s_m: NDArray[np.float64]) -> tuple[KeptPassing, ...]:
    """The time (ns) at which a train that was at positions (m) at times (ns) passed each point."""
    zero_ns, reached_m = int(time_ns[0]), np.maximum.accumulate(s_m)
    found = []
    for one in due:
        there = reached_m[0] <= one.s_m <= reached_m[-1]
        since = float(np.interp(one.s_m, reached_m, (time_ns - zero_ns).astype(float)))
        found.append(KeptPassing(due=one, passed_ns=zero_ns + round(since) if there else 0))
    return tuple(found)


def passings_as_rows(kept: Sequence[KeptPassing], zero_ns: int) -> list[dict[str, Any]]:
    """The passings and their deviations, for programs; times (s) count from `zero_ns`; None: there is none."""
    return [
        {
            "name": one.due.name,
            "s_m": one.due.s_m,
            "earliest_s": _since_s(one.due.earliest_ns, zero_ns),
            "latest_s": _since_s(one.due.latest_ns, zero_ns),
            "passed_s": _since_s(one.passed_ns, zero_ns),
            "late_s": known(one.late_s),
            "wish": one.due.wish,
            "tolerance_s": one.due.tolerance_s,
        }
        for one in kept
    ]


def passing_metadata(due: Sequence[DuePassing]) -> dict[str, str]:
    """The passings as a recording states them; empty if there are none."""
    return {PASSINGS: json.dumps([asdict(one) for one in due])} if due else {}


def recorded_passings(metadata: Mapping[str, str]) -> tuple[DuePassing, ...]:
    """The passings that a recording states; none if its text is invalid."""
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


def passing_table(kept: Sequence[KeptPassing], zero_ns: int) -> Table:
    """A table of the train's times at the passings of its journey, on a clock that shows 0 at `zero_ns`."""
    found = Table(title="passings", title_justify="left")
    found.add_column("point")
    for name in ("due", "passed", "late", ""):
        found.add_column(name, justify="right")
    for row, one in zip(passings_as_rows(kept, zero_ns), kept, strict=True):
        ends = ["…" if row[key] is None else minutes(row[key]) for key in ("earliest_s", "latest_s")]
        due = "" if ends == ["…", "…"] else ends[0] if ends[0] == ends[1] else " – ".join(ends)
        due += f" ± {one.due.tolerance_s:g} s" if one.due.wish else ""
        passed = "" if row["passed_s"] is None else minutes(row["passed_s"])
        late = "" if row["late_s"] is None else f"{row['late_s']:+.0f} s"
        found.add_row(one.due.name, due, passed, late, one.words)
    return found
