"""The events of a recorded drive with time, place and cause, the filter of a list of events, and the bookmarks."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, tzinfo
from enum import StrEnum
from itertools import pairwise
from typing import Any, Final, NamedTuple, Self

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from numpy.typing import NDArray

from das.advice.advice import Cause, Source
from das.advice.reason import Reason
from das.advice.regimes import Regime, mode_name
from das.advice.wording import words
from das.domain.units import KM, NS, PERCENT, kmh
from sim.drive.calls import NEAR_M, KeptCall
from sim.drive.limits import signals, spans_above, temporary_limits
from sim.drive.table import HOLDS_NS, HOLDS_S, DriveTable, PlanMade
from sim.drivers.cab import AT_STOP_M
from sim.drivers.presentations.presenter import ShownRegime, known_mode
from sim.recording.course import (
    STANDING_MPS,
    DriveClock,
    DrivenCourse,
    Floats,
    arrival_ns,
    departure_ns,
    stands,
    times_text,
)
from sim.recording.opening import notes_path


class EventKind(StrEnum):
    """The kind of an event; `das-sim report --kind` takes these words."""

    DEPARTURE = "departure"
    ARRIVAL = "arrival"
    MISSED_STOP = "missed-stop"
    STAND = "stand"
    """The train came to a stand where it has no stop."""
    SIGNAL = "signal"
    RESTRICTION = "restriction"
    TARGET = "target"
    JOURNEY = "journey"
    DELAY = "delay"
    ADVICE = "advice"
    """The advised mode changed."""
    REPLAN = "replan"
    """The node made a new plan that differs from the previous one."""
    WITHDRAWAL = "withdrawal"
    OVERSPEED = "overspeed"
    """The train was above the limit of the line, or above a temporary restriction."""
    BEYOND_TRAIN = "beyond-train"
    """The train exceeded the top speed in its vehicle file: it may be another train."""
    DRIVER = "driver"
    """The driver's answer to a change of the advice."""
    LAPSE = "lapse"
    """A message stream paused: no positions, or no advice, came for a while."""
    DEVIATION = "deviation"
    """The first large deviation, present or predicted for the arrival, from the timetable."""
    LOG = "log"
    WARNING = "warning"
    NOTE = "note"
    """A bookmark made by a person."""


@dataclass(frozen=True, kw_only=True)
class DriveEvent:
    """An event: its time (ns since 1970), place (m, NaN if unknown), kind and text, and its figures.

    `end_ns` is the time of its end, 0 if it has no duration. The names in `facts` carry their units. `mark` is the
    reason why the program made the event a bookmark; it is empty for all others.
    """

    time_ns: int
    kind: EventKind
    text: str
    s_m: float
    end_ns: int = 0
    facts: Mapping[str, Any] = field(default_factory=dict)
    mark: str = ""

    @classmethod
    def on(cls, trip: DrivenCourse, kind: EventKind, time_ns: int, text: str, *, end_ns: int = 0, **facts: Any) -> Self:
        """An event at the place of the train at that moment; the figures of the event are given by name."""
        return cls(time_ns=time_ns, end_ns=end_ns, kind=kind, text=text, s_m=place_m(trip, time_ns), facts=facts)

    @property
    def last_ns(self) -> int:
        """Time of the end of the event (ns since 1970)."""
        return max(self.time_ns, self.end_ns)


def place_m(trip: DrivenCourse, time_ns: int) -> float:
    """Position of the train's head at a moment (m)."""
    return float(trip.at(np.array([time_ns]), trip.s_m)[0])


def lateness_text(late_s: float) -> str:
    """Words for the lateness of a train: "12 s late", "3 s early" or "on time"."""
    return "on time" if abs(late_s) <= 0.5 else f"{abs(late_s):.0f} s {'late' if late_s > 0 else 'early'}"


@dataclass(frozen=True, kw_only=True)
class Filter:
    """A filter of events; a field that is empty or None lets every event pass."""

    kinds: Collection[EventKind] = ()
    from_ns: int | None = None
    to_ns: int | None = None
    bookmarks: bool = False
    """Whether only bookmarks pass: those that the program made, and notes."""

    def choose(self, events: Iterable[DriveEvent]) -> tuple[DriveEvent, ...]:
        """The events that pass, in their order."""
        return tuple(
            one
            for one in events
            if (not self.kinds or one.kind in self.kinds)
            and (not self.bookmarks or one.mark or one.kind is EventKind.NOTE)
            and (self.from_ns is None or one.last_ns >= self.from_ns)
            and (self.to_ns is None or one.time_ns <= self.to_ns)
        )


MUCH_OVER_KMH: Final = 3.0
"""Least excess (km/h) over the limit of a train that is too fast; less is within the error of a speedometer."""
LONG_OVER_S: Final = 5.0
"""Least time (s) above a limit that counts as exceeding it, not just touching it."""
LONG_AWAY_S: Final = 10.0
"""Least time (s) of inattention; anything shorter is a look at something else."""
LARGE_DEVIATION_S: Final = 60.0
"""Least deviation (s) from the timetable, present or expected, that is an event."""


def with_marks(events: Iterable[DriveEvent]) -> tuple[DriveEvent, ...]:
    """The events in order of time; bookmarks have their reason in `mark`."""
    found = sorted(events, key=lambda one: one.time_ns)
    # Only the first refusal of each leg is marked, and only under way: a driver who refuses once usually does so again.
    may_refuse = not any(one.kind is EventKind.DEPARTURE for one in found)
    marked = []
    for one in found:
        if one.kind in (EventKind.DEPARTURE, EventKind.ARRIVAL):
            may_refuse = one.kind is EventKind.DEPARTURE
        mark = _mark(one)
        if mark == REFUSED:
            mark, may_refuse = (mark if may_refuse else ""), False
        marked.append(replace(one, mark=mark) if mark else one)
    return tuple(marked)


REFUSED: Final = "advice not followed"


def _mark(one: DriveEvent) -> str:
    lasted_s = (one.last_ns - one.time_ns) * NS
    match one.kind:
        case EventKind.MISSED_STOP:
            return "stop missed"
        case EventKind.ARRIVAL if one.facts["stopping_error_m"] > AT_STOP_M:
            return "beyond the stop"
        case EventKind.STAND:
            return "unplanned stop"
        case EventKind.SIGNAL:
            return "signal at danger"
        case EventKind.OVERSPEED if one.facts["over_kmh"] >= MUCH_OVER_KMH or one.facts["lasted_s"] >= LONG_OVER_S:
            return "too fast"
        case EventKind.BEYOND_TRAIN if one.facts["over_kmh"] >= MUCH_OVER_KMH or one.facts["lasted_s"] >= LONG_OVER_S:
            return "another train?"
        case EventKind.WITHDRAWAL if lasted_s >= HOLDS_S:
            return "advice withdrawn"
        case EventKind.LAPSE if lasted_s >= HOLDS_S:
            return "no messages received"
        case EventKind.DRIVER if one.facts.get("followed") is False:
            return REFUSED
        case EventKind.DRIVER if one.facts.get("away_s", 0.0) >= LONG_AWAY_S:
            return "driver inattentive"
        case EventKind.DEVIATION:
            return "a minute off the timetable"
        case _:
            return ""


def deviation_events(table: DriveTable) -> Iterator[DriveEvent]:
    """The first event of being, or of being expected to arrive, a minute or more off the timetable.

    The operator reports the present lateness; the node predicts that at arrival. Without a timetable there is no such
    event.
    """
    if table.own_timetable:
        return
    advised_ns, mode, deviation_s = table.of_topic("advice", "mode", "predicted_deviation_s")
    told_ns, delay_s = table.of_topic("delay", "delay_s")
    firsts = [
        (int(time_ns[at]), float(late_s[at]), said)
        for time_ns, late_s, said in (
            (told_ns, delay_s, "the operator reports the train"),
            (advised_ns, np.where(mode > 0, deviation_s, 0.0), "the next arrival is expected"),
        )
        for at in np.flatnonzero(np.abs(late_s) >= LARGE_DEVIATION_S)[:1]
    ]
    for time_ns, late_s, said in sorted(firsts)[:1]:
        text = f"{said} {lateness_text(late_s)}"
        yield DriveEvent.on(table.course, EventKind.DEVIATION, time_ns, text, deviation_s=late_s)


def bookmarks(events: Sequence[DriveEvent]) -> tuple[DriveEvent, ...]:
    """All bookmarks in order of time: those that the program made, and the notes of people."""
    return Filter(bookmarks=True).choose(events)


NOT_HEARD: Final = "no message from the node"


class Span(NamedTuple):
    """A span of time (ns since 1970), and its meaning."""

    start_ns: int
    end_ns: int
    text: str


def silences(table: DriveTable) -> tuple[Span, ...]:
    """The times without advice, each with its first reason: advice withdrawn, or no message from the node.

    A drive without a node has none.
    """
    first_ns, last_ns = table.course.time_ns[[0, -1]].tolist()
    found: list[Span] = []
    before: int | str = ""
    for said, cause in _silent(table, first_ns, last_ns):
        span = said._replace(start_ns=max(said.start_ns, first_ns), end_ns=min(said.end_ns, last_ns))
        if span.end_ns <= span.start_ns:
            continue
        if found and found[-1].end_ns == span.start_ns and before == cause:
            found[-1] = found[-1]._replace(end_ns=span.end_ns)
        else:
            found.append(span)
        before = cause
    return tuple(found)


def _silent(table: DriveTable, first_ns: int, last_ns: int) -> Iterator[tuple[Span, int | str]]:
    times_ns, valid_ns, sources, causes, reasons = (
        one.tolist() for one in table.of_topic("advice", "valid_until_ns", "source", "cause", "reason")
    )
    heard_ns = first_ns
    for row, time_ns in enumerate(times_ns):
        if time_ns > heard_ns:
            yield Span(heard_ns, time_ns, NOT_HEARD), NOT_HEARD
        next_ns = times_ns[row + 1] if row + 1 < len(times_ns) else last_ns
        heard_ns = min(next_ns, max(valid_ns[row], time_ns + HOLDS_NS))
        if sources[row] == Source.NONE:
            yield Span(time_ns, heard_ns, withdrawal_words(reasons[row], causes[row])), causes[row]
    if times_ns:
        yield Span(heard_ns, last_ns, NOT_HEARD), NOT_HEARD


def withdrawal_words(reason: Reason, cause: int) -> str:
    """The reason why advice was withdrawn; in a recording older than the codes of reasons, the name of the cause."""
    return words(reason) or Cause(cause).label.replace("-", " ")


OFF_PLAN_MPS: Final = 0.3
"""Least deviation (m/s) of the speed from the plan at which a train counts as off the plan."""
OFF_PLAN_S: Final = 1.0
"""Least deviation (s) of the time at a place from the plan at which a train counts as off the plan."""

REPLANS: Final = {
    2: "the time of arrival changed",
    3: "limits, line or train changed",
    4: "the time window of a point ahead changed",
    5: "keeping the plan would mean arriving too late",
    6: "the new one saves energy: keeping the old one would have meant arriving early",
    7: "keeping the plan would cost more energy than a new one",
    8: "the plan could no longer be kept",
}
"""The guide's reasons for a new reference plan, by the numbers of `ReplanCause` on the bus."""


class NewPlan(NamedTuple):
    """A plan that replaced another: its time (ns), and its cause as far as it is known."""

    time_ns: int
    cause: str


def new_plans(table: DriveTable) -> tuple[NewPlan, ...]:
    """The plans after the first of each leg, with their causes.

    The node records no cause with a plan. The cause is inferred from the messages that the node received shortly
    before, or else from the deviation of the train from the previous plan.
    """
    news = _news(table)
    moments = [at for at, _ in news]
    found: list[NewPlan] = []
    before: PlanMade | None = None
    for plan in table.said.plans:
        if not len(plan.s_m):
            continue
        if before is not None and plan.s_m[-1] <= before.s_m[-1] + 1.0:
            last = bisect_right(moments, plan.time_ns) - 1
            fresh = last >= 0 and plan.time_ns - moments[last] <= HOLDS_NS
            found.append(NewPlan(plan.time_ns, news[last][1] if fresh else _off_plan(before, plan)))
        before = plan
    return tuple(found)


def _news(table: DriveTable) -> list[tuple[int, str]]:
    """The messages that make the node replan: time (ns) and cause in words, in order of time."""
    found = [(one.time_ns, "restrictions were received or lifted") for one in table.said.restrictions]
    found += [(one.told_ns, "traffic management wants another time") for one in table.said.targets]
    found += [(one.time_ns, "a journey was received") for one in table.said.journeys]
    return sorted(found)


def _off_plan(before: PlanMade, plan: PlanMade) -> str:
    """Words for the deviation of the train from the previous plan when the new plan was made."""
    s_m = float(plan.s_m[0])
    planned_mps = float(np.interp(s_m, before.s_m, before.speed_mps))
    planned_s = float(np.interp(s_m, before.s_m, before.t_s))
    faster_mps = float(plan.speed_mps[0]) - planned_mps
    late_s = (plan.time_ns - before.time_ns) * NS - planned_s
    parts = []
    if abs(faster_mps) >= OFF_PLAN_MPS:
        parts.append(f"{abs(kmh(faster_mps)):.1f} km/h {'above' if faster_mps > 0 else 'below'} the plan")
    if abs(late_s) >= OFF_PLAN_S:
        parts.append(f"{abs(late_s):.0f} s {'behind' if late_s > 0 else 'ahead of'} it")
    return f"the train was {' and '.join(parts)}" if parts else "the plan was refreshed; the train had kept to it"


def advice_events(table: DriveTable) -> Iterator[DriveEvent]:
    """Every change of the advised driving regime, as the display showed it, with its cause: the next step of the plan,
    a new plan, or advice given again after a pause. If the display showed no regime, that of the speed profile counts.
    """
    plans, trip = new_plans(table), table.course
    made = [one.time_ns for one in plans]
    before, since_ns, replanned_ns = Regime.NONE, 0, 0
    columns = table.of_topic("advice", "display", "guide", "reason", "s_m", "predicted_deviation_s")
    for time_ns, told, guide, reason, s_m, deviation_s in zip(*(one.tolist() for one in columns), strict=True):
        if told.mode is before or not trip.time_ns[0] <= time_ns <= trip.time_ns[-1]:
            continue
        if told.mode is not Regime.NONE:
            last = bisect_right(made, time_ns) - 1
            new = last >= 0 and made[last] > since_ns
            cause = f"new plan: {plans[last].cause}" if new else "the plan continues"
            if guide is not None and guide.replan.time_ns > max(since_ns, replanned_ns):
                cause = f"new plan: {REPLANS.get(guide.replan.cause, 'there was none before')}"
                replanned_ns = guide.replan.time_ns
            if before is Regime.NONE:
                cause = "advice is given again" if since_ns else "the first advice"
            facts = _changed(before, told, cause, reason, table.zone)
            facts["predicted_deviation_s"] = None if table.own_timetable else deviation_s
            yield DriveEvent(
                time_ns=time_ns, kind=EventKind.ADVICE, text=_change_text(told, cause, table.zone), s_m=s_m, facts=facts
            )
        before, since_ns = told.mode, time_ns


def _change_text(told: ShownRegime, cause: str, zone: tzinfo) -> str:
    held = f" at {kmh(told.speed_mps):.0f} km/h" if told.mode is Regime.CRUISE else ""
    reason = words(told.reason, zone=zone)
    return f"{mode_name(told.mode)}{held}: {f'{reason} ({cause})' if reason else cause}"


def _changed(before: Regime, told: ShownRegime, cause: str, reason: Reason, zone: tzinfo) -> dict[str, Any]:
    return {
        "mode": mode_name(told.mode),
        "mode_before": mode_name(before),
        "cause": cause,
        "reason": words(told.reason, zone=zone) or words(reason, zone=zone),
        "advised_speed_mps": told.speed_mps,
    }


def withdrawal_events(table: DriveTable) -> Iterator[DriveEvent]:
    """The times without advice, each with its cause and duration."""
    columns = table.of_topic("advice", "source", "cause")
    causes = {time_ns: cause for time_ns, source, cause in zip(*columns, strict=True) if source == Source.NONE}
    for span in silences(table):
        lasted_s = (span.end_ns - span.start_ns) * NS
        unheard = span.text == NOT_HEARD
        cause = "not-heard" if unheard else Cause(int(causes.get(span.start_ns, 0))).label
        yield DriveEvent.on(
            table.course, EventKind.LAPSE if unheard else EventKind.WITHDRAWAL, span.start_ns,
            f"no advice for {lasted_s:.0f} s: {span.text}",
            end_ns=span.end_ns, cause=cause, lasted_s=lasted_s, reason=span.text,
        )  # fmt: skip


def place_text(s_m: float) -> str:
    """A position as "km 12.30"; nothing for NaN."""
    return "" if math.isnan(s_m) else f"km {s_m / KM:.2f}"


DELAY_STEP_S: Final = 15.0
"""Least change (s) of the delay since the last delay event for a new event; smaller changes are frequent."""


def events(table: DriveTable, made: tuple[KeptCall, ...], limit_mps: Floats) -> tuple[DriveEvent, ...]:
    """Everything that happened on a drive, in order of time, with times of day in the time zone of the line.

    `made` are the stops as served, `limit_mps` is the limit in force (m/s) at every position of the drive.
    """
    trip, inputs = table.course, table.known_inputs
    found = (
        *call_events(trip, made),
        *stand_events(trip, made),
        *_told_events(table),
        *advice_events(table),
        *(
            DriveEvent.on(trip, EventKind.REPLAN, plan.time_ns, f"new plan: {plan.cause}", cause=plan.cause)
            for plan in new_plans(table)
        ),
        *withdrawal_events(table),
        *overspeed_events(trip, limit_mps),
        *top_speed_events(trip, math.inf if inputs is None else inputs.vehicle.max_speed_mps),
        *(decision_events(table) if table.said.decisions else driver_events(table)),
        *pause_events(table),
        *deviation_events(table),
        *_notes(table),
        *(DriveEvent.on(trip, EventKind.NOTE, time_ns, "marked by the driver") for time_ns in table.said.marks_ns),
    )
    return with_marks(found)


def as_rows(events: Iterable[DriveEvent], clock: DriveClock) -> list[dict[str, Any]]:
    """Events for programs: times in s on the clock and as UTC text, positions in m."""
    return [
        {
            "time_s": round(clock.since_s(one.time_ns), 3),
            "time_utc": replace(clock, zone=UTC).of_day(one.time_ns),
            "time_ns": one.time_ns,
            "end_s": round(clock.since_s(one.last_ns), 3),
            "s_m": round(one.s_m, 1),
            "kind": str(one.kind),
            "text": one.text,
            **({"bookmark": one.mark} if one.mark else {}),
            # JSON does not know NaN.
            **{name: x for name, x in one.facts.items() if not (isinstance(x, float) and math.isnan(x))},
        }
        for one in events
    ]


def _notes(table: DriveTable) -> Iterator[DriveEvent]:
    """The notes that people made on the recording, as events; notes outside the time of the drive are left out."""
    trip, recording = table.course, table.recording.path
    if not notes_path(recording).exists():
        return
    from sim.drive.notes import read_notes  # with the libraries of MCAP

    for number, note in enumerate(read_notes(recording), start=1):
        if not trip.time_ns[0] <= note.time_ns <= trip.time_ns[-1]:
            continue
        yield DriveEvent.on(trip, EventKind.NOTE, note.time_ns, note.text, number=number, note=note.text)


def _told_events(table: DriveTable) -> Iterator[DriveEvent]:
    trip = table.course
    yield from _restrictions(table)
    yield from _targets(table)
    for journey in table.said.journeys[1:]:
        text = f"another journey was received: {' – '.join(stop.name for stop in journey.stops)}"
        yield DriveEvent.on(trip, EventKind.JOURNEY, journey.time_ns, text)
    yield from _delays(table)
    for signal in signals(table):
        lasted_s = (signal.end_ns - signal.start_ns) * NS
        yield DriveEvent.on(
            trip, EventKind.SIGNAL, signal.start_ns,
            f"signal at danger at km {signal.s_m / KM:.2f} in sight for {lasted_s:.0f} s",
            end_ns=signal.end_ns, signal_m=signal.s_m, lasted_s=lasted_s,
        )  # fmt: skip
    for line in table.said.simulator:
        yield DriveEvent.on(trip, EventKind.LOG, line.time_ns, line.words)
    for line in table.said.node:
        if line.level >= Log.WARNING:
            yield DriveEvent.on(trip, EventKind.WARNING, line.time_ns, line.words)


def _restrictions(table: DriveTable) -> Iterator[DriveEvent]:
    for span in temporary_limits(table):
        one = span.restriction
        facts: dict[str, Any] = {"start_m": one.start_m, "end_m": one.end_m, "limit_mps": one.limit_mps}
        for at, word in span.changes():
            if word == "received" or at <= table.course.time_ns[-1]:
                text = f"restriction {word}: {one.words_in(table.zone)}"
                yield DriveEvent.on(table.course, EventKind.RESTRICTION, at, text, **facts)


def _targets(table: DriveTable) -> Iterator[DriveEvent]:
    """The targets of traffic management that the node received, each once."""
    known = set()
    for one in table.said.targets:
        said = (("arrival", one.arrival_ns), ("not before", one.earliest_ns), ("not after", one.latest_ns))
        wish = ", ".join(f"{word} {table.clock.shown(at_ns)}" for word, at_ns in said if at_ns)
        if (one.s_m, wish) not in known:
            text = f"traffic management: {wish} at km {one.s_m / KM:.1f}"
            yield DriveEvent.on(table.course, EventKind.TARGET, one.told_ns, text)
        known.add((one.s_m, wish))


def _delays(table: DriveTable) -> Iterator[DriveEvent]:
    """An event for each delay that differs by at least `DELAY_STEP_S` from the delay of the last of these events.

    Without a timetable there is no event: replays of older versions sent the node invented delays.
    """
    if table.own_timetable:
        return
    before_s = 0.0
    for time_ns, delay_s in zip(*(one.tolist() for one in table.of_topic("delay", "delay_s")), strict=True):
        if abs(delay_s - before_s) >= DELAY_STEP_S:
            text = f"the operator reports the train {lateness_text(delay_s)}"
            yield DriveEvent.on(table.course, EventKind.DELAY, time_ns, text, delay_s=delay_s)
            before_s = delay_s


LEVER_RATIO: Final = 0.03
"""Share of the effort below which a controller is at neutral."""
LEAST_STOOD: Final = 5
"""Least display time (s) of advice that should be followed: drivers take some seconds to react."""
LONGEST_ANSWER_S: Final = 30.0
"""Time (s) after which an act of the driver is no longer an answer to the advice."""
LATE_ANSWER_S: Final = 10.0
"""Time (s) after which an answer is called late."""
LEAST_STAND_S: Final = 1.0
"""Shortest standstill (s) outside the stops that becomes an event."""
PAUSE_NS: Final = 5_000_000_000
"""Longest pause (ns) of the positions that is not an event; they usually arrive once a second."""

DECIDED: Final = {"followed": True, "refused": False}
"""A driver's decisions about advice, and whether they mean that the advice is followed."""
PULLS, COASTS, BRAKES = 1, 0, -1
WANTED: Final = {
    Regime.FULL_TRACTION: PULLS,
    Regime.REDUCED_TRACTION: PULLS,
    Regime.COAST: COASTS,
    Regime.REDUCED_BRAKE: BRAKES,
    Regime.FULL_BRAKE: BRAKES,
    Regime.FRICTION_BRAKE: BRAKES,
}
"""Settings of the controller that follow an advised mode; holding a speed may need any of the three."""


def call_events(trip: DrivenCourse, made: tuple[KeptCall, ...]) -> Iterator[DriveEvent]:
    """Departures, arrivals and stops that were missed."""
    for index, call in enumerate(made):
        if call.arrived_ns and index > 0:
            late = "" if math.isnan(call.arrived_late_s) else f", {lateness_text(call.arrived_late_s)}"
            beyond = f", {call.stopping_error_m:.0f} m beyond the stop" if call.stopping_error_m > AT_STOP_M else ""
            yield DriveEvent(
                time_ns=call.arrived_ns, kind=EventKind.ARRIVAL, s_m=call.s_m,
                text=f"arrived at {call.name}{late}{beyond}",
                facts={"stop": call.name, "late_s": call.arrived_late_s, "stopping_error_m": call.stopping_error_m},
            )  # fmt: skip
        if call.departed_ns and index < len(made) - 1:
            late = "" if math.isnan(call.departed_late_s) else f", {lateness_text(call.departed_late_s)}"
            yield DriveEvent(
                time_ns=call.departed_ns, kind=EventKind.DEPARTURE, text=f"left {call.name}{late}", s_m=call.s_m,
                facts={"stop": call.name, "late_s": call.departed_late_s},
            )  # fmt: skip
        if not call.served and call.reached and trip.s_m[-1] > call.s_m + NEAR_M and trip.s_m[0] < call.s_m - NEAR_M:
            passed = int(np.argmax(trip.s_m >= call.s_m))
            speed_kmh = kmh(float(trip.speed_mps[passed]))
            yield DriveEvent(
                time_ns=int(trip.time_ns[passed]), kind=EventKind.MISSED_STOP, s_m=call.s_m,
                text=f"{call.name} was passed at {speed_kmh:.0f} km/h without stopping",
                facts={"stop": call.name, "speed_mps": float(trip.speed_mps[passed])},
            )  # fmt: skip


def stand_events(trip: DrivenCourse, made: tuple[KeptCall, ...]) -> Iterator[DriveEvent]:
    """The standstills of the train outside the stops of its journey."""
    at_stops = {call.stand for call in made}
    for stand in stands(trip):
        arrived, departed = arrival_ns(trip, stand), departure_ns(trip, stand)
        if stand in at_stops or not arrived or not departed:
            continue
        lasted_s = (departed - arrived) * NS
        if lasted_s < LEAST_STAND_S:
            continue
        yield DriveEvent(
            time_ns=arrived, end_ns=departed, kind=EventKind.STAND, s_m=stand.s_m,
            text=f"stood for {lasted_s:.0f} s outside stops", facts={"lasted_s": lasted_s},
        )  # fmt: skip


def overspeed_events(trip: DrivenCourse, limit_mps: Floats) -> Iterator[DriveEvent]:
    """The stretches of time in which the train was above the limit in force (`sim.drive.limits`)."""
    for over in spans_above(trip, limit_mps):
        over_kmh, limit_kmh = kmh(over.over_mps), kmh(over.allowed_mps)
        text = f"up to {over_kmh:.0f} km/h above the limit of {limit_kmh:.0f} km/h for {over.lasted_s:.0f} s"
        facts = {"limit_mps": over.allowed_mps, "over_kmh": over_kmh, "lasted_s": over.lasted_s}
        yield DriveEvent.on(trip, EventKind.OVERSPEED, over.start_ns, text, end_ns=over.end_ns, **facts)


def top_speed_events(trip: DrivenCourse, top_mps: float) -> Iterator[DriveEvent]:
    """The event that the train exceeded the top speed in its vehicle file (m/s); nothing if it did not.

    There is one event, at the highest speed, however often it happened: the only question is which train it was.
    """
    spans = tuple(spans_above(trip, np.full(len(trip.time_ns), top_mps)))
    if not spans:
        return
    worst, lasted_s = max(spans, key=lambda one: one.over_mps), sum(one.lasted_s for one in spans)
    often = "" if len(spans) == 1 else f" in all, {times_text(len(spans))}"
    text = (
        f"up to {kmh(worst.over_mps):.0f} km/h above the top speed in the vehicle file "
        f"({kmh(top_mps):.0f} km/h) for {lasted_s:.0f} s{often}: is it the right train?"
    )
    facts = {"top_speed_mps": top_mps, "over_kmh": kmh(worst.over_mps), "lasted_s": lasted_s, "times": len(spans)}
    yield DriveEvent.on(trip, EventKind.BEYOND_TRAIN, worst.start_ns, text, end_ns=worst.end_ns, **facts)


def driver_events(table: DriveTable) -> Iterator[DriveEvent]:
    """The driver's answers to changes of the shown mode and their delays, inferred from the controller.

    A change to a mode that the controller is already set to needs no answer. The driver's intentions are not recorded.
    """
    trip = table.course
    at, shown, mode, lever_ratio, signal_m = table.of_topic("cab", "presentation", "mode", "lever_ratio", "signal_m")
    does = np.where(np.abs(lever_ratio) < LEVER_RATIO, COASTS, np.sign(np.nan_to_num(lever_ratio)))
    changes = [*np.flatnonzero(np.diff(mode, prepend=-1)), len(mode)] if len(mode) else []
    for first, end in pairwise(changes):
        wanted = WANTED.get(known_mode(int(mode[first])))
        if wanted is None or not shown[first] > 0 or does[first] == wanted:
            continue
        answers = does[first:end] == wanted
        standing = bool((trip.at(at[first:end], trip.speed_mps) < STANDING_MPS).all())
        minds_signal = bool((signal_m[first:end] > 0).any())
        excused = end - first < LEAST_STOOD or standing or minds_signal  # too short, at a stand, or for a signal
        if answers.any() or not excused:
            yield _answer(trip, at[first:end], answers, Regime(int(mode[first])))


def _answer(trip: DrivenCourse, at: NDArray[np.int64], does: NDArray[np.bool_], mode: Regime) -> DriveEvent:
    """The driver's answer to advice that was shown at the times `at`; `does`: the controller was set as advised."""
    waited_s = (at - at[0]) * NS
    answered = np.flatnonzero(does & (waited_s <= LONGEST_ANSWER_S))
    stood_s = float(waited_s[-1]) + 1.0
    if len(answered):
        reaction_s = float(waited_s[answered[0]])
        late = ", which is late" if reaction_s > LATE_ANSWER_S else ""
        text = f"{mode_name(mode)} was followed after {reaction_s:.0f} s{late}"
        facts: dict[str, Any] = {"followed": True, "reaction_s": reaction_s}
    else:
        over = f"shown for {stood_s:.0f} s" if stood_s <= LONGEST_ANSWER_S else f"within {LONGEST_ANSWER_S:.0f} s"
        text = f"{mode_name(mode)} was not followed ({over})"
        facts = {"followed": False, "stood_s": stood_s}
    return DriveEvent.on(trip, EventKind.DRIVER, int(at[0]), text, mode=mode_name(mode), **facts)


def pause_events(table: DriveTable) -> Iterator[DriveEvent]:
    """The pauses in the positions that the train's localisation gave."""
    (at,), trip = table.of_topic("position"), table.course
    for index in np.flatnonzero(np.diff(at) > PAUSE_NS):
        lasted_s = float(at[index + 1] - at[index]) * NS
        start_ns, end_ns = int(at[index]), int(at[index + 1])
        text = f"no position for {lasted_s:.0f} s from km {place_m(trip, start_ns) / KM:.2f}"
        yield DriveEvent.on(trip, EventKind.LAPSE, start_ns, text, end_ns=end_ns, lasted_s=lasted_s)


def decision_events(table: DriveTable) -> Iterator[DriveEvent]:
    """Advice that the driver followed or refused, with the reaction time, and lapses of attention.

    There are none if no decisions were recorded, as in a real drive, or with a driver who does not report them.
    """
    trip, kept = table.course, [one for one in table.said.decisions if one.kind != "expected"]
    for one, after in pairwise([*kept, None]):
        assert one is not None
        if one.kind in DECIDED:
            follows = DECIDED[one.kind]
            advice = mode_name(Regime(int(one.value)))
            text = f"advice '{advice}' is not followed"
            facts: dict[str, Any] = {"mode": advice, "followed": follows}
            if not follows:
                text += _controller(table, one.time_ns)
            if after is not None and after.kind == "reaction":  # A reaction is recorded right after its decision.
                facts |= {"reaction_s": after.value}
                text = f"{advice} is followed after a reaction of {after.value:.1f} s" if follows else text
            yield DriveEvent.on(trip, EventKind.DRIVER, one.time_ns, text, **facts)
        elif one.kind == "lapse":
            text = f"inattention for {one.value:.0f} s, unless the train warns"
            end_ns = one.time_ns + round(one.value / NS)
            yield DriveEvent.on(trip, EventKind.DRIVER, one.time_ns, text, end_ns=end_ns, away_s=one.value)


def _controller(table: DriveTable, time_ns: int) -> str:
    times_ns, lever_ratio = table.of_topic("cab", "lever_ratio")
    at = int(np.searchsorted(times_ns, time_ns, side="right")) - 1
    if at < 0 or not np.isfinite(lever_ratio[at]):
        return ""
    share = round(float(lever_ratio[at]) / PERCENT)
    return f"; the controller {f'stays at {share:+d} %' if share else 'stays at 0'}"
