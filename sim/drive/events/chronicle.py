"""All events of a recording in order of time: what happened, when, where and why."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import replace
from datetime import UTC, tzinfo
from typing import Any, Final, NamedTuple

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.advice.advice import Cause, Source
from das.advice.reason import Reason
from das.advice.regimes import Regime, mode_name
from das.advice.wording import words
from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import KM, NS, kmh
from sim.drive.calls import KeptCall
from sim.drive.events.driving_events import (
    call_events,
    decision_events,
    driver_events,
    overspeed_events,
    pause_events,
    stand_events,
    top_speed_events,
)
from sim.drive.events.event import (
    DriveEvent,
    EventKind,
    deviation_events,
    lateness_text,
    read_notes,
    with_marks,
)
from sim.drive.happenings import NOT_HEARD, Span, points, signals, silence_text
from sim.drive.limits import temporary_limits
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import Presenter, ShownRegime, presenter_of, shown_presentation
from sim.recording.course import DriveClock, DrivenCourse, Floats, own_timetable

NEWS_NS: Final = 3_000_000_000
"""A plan made within this time (ns) after, say, a new restriction counts as caused by it: solving takes time."""
OFF_PLAN_MPS: Final = 0.3
"""A train whose speed differs by at least this (m/s) from the plan has left the plan."""
OFF_PLAN_S: Final = 1.0
"""A train whose time at a place differs by this much (s) from the plan has left the plan."""

REPLANS: Final = {
    2: "the time of arrival changed",
    3: "limits, line or train changed",
    4: "the time window of a point ahead changed",
    5: "keeping the plan would mean arriving too late",
    6: "the new one saves energy: keeping the old one would have meant arriving early",
    7: "keeping the plan would cost more energy than a new one",
    8: "the plan could no longer be kept",
}
"""Why the guide made a new reference plan, by the numbers of `ReplanCause` on the bus."""


class NewPlan(NamedTuple):
    """A plan that replaced another: when it was made (ns), and why as far as it is known."""

    time_ns: int
    cause: str


def new_plans(recording: Recording, trip: DrivenCourse) -> tuple[NewPlan, ...]:
    """The plans after the first of each leg, with their causes.

    The node records no cause with a plan. The cause is inferred from the messages that the node received shortly
    before, or else from how far the train was from the previous plan.
    """
    news = _news(recording)
    moments = [at for at, _ in news]
    found: list[NewPlan] = []
    before: Any = None
    for entry in recording.of(topics.PLAN):
        plan = entry.message
        if before is not None and plan.s_m and before.s_m and plan.s_m[-1] <= before.s_m[-1] + 1.0:
            last = bisect_right(moments, plan.time_ns) - 1
            fresh = last >= 0 and plan.time_ns - moments[last] <= NEWS_NS
            found.append(NewPlan(int(plan.time_ns), news[last][1] if fresh else _off_plan(before, plan, trip)))
        before = plan if plan.s_m else before
    return tuple(found)


def _news(recording: Recording) -> list[tuple[int, str]]:
    """The messages that make the node plan anew: time (ns) and cause in words, in order of time."""
    words = (
        (topics.RESTRICTION, "restrictions were received or lifted"),
        (topics.TARGET, "traffic management wants another time"),
        (topics.JOURNEY, "a journey was received"),
    )
    return sorted((int(entry.message.time_ns), text) for topic, text in words for entry in recording.of(topic))


def _off_plan(before: Any, plan: Any, trip: DrivenCourse) -> str:
    """How far the train was from the previous plan when the new plan was made, in words."""
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


def advice_events(recording: Recording, trip: DrivenCourse, zone: tzinfo = UTC) -> Iterator[DriveEvent]:
    """Every change of the advised driving regime, as the display showed it, with its cause: the next step of the plan,
    a new plan, or advice given again after a pause. If the display showed no regime, that of the speed profile counts.
    """
    plans = new_plans(recording, trip)
    made = [one.time_ns for one in plans]
    display = _display(recording)
    before, since_ns, replanned_ns = Regime.NONE, 0, 0
    for entry in recording.of(topics.ADVICE):
        advice = entry.message
        told = display.shown_mode(advice)
        if told.mode is before or not trip.time_ns[0] <= advice.time_ns <= trip.time_ns[-1]:
            continue
        if told.mode is not Regime.NONE:
            last = bisect_right(made, advice.time_ns) - 1
            new = last >= 0 and made[last] > since_ns
            cause = f"new plan: {plans[last].cause}" if new else "the plan goes on"
            if advice.HasField("guide") and advice.guide.replan.time_ns > max(since_ns, replanned_ns):
                cause = f"new plan: {REPLANS.get(advice.guide.replan.cause, 'there was none before')}"
                replanned_ns = advice.guide.replan.time_ns
            if before is Regime.NONE:
                cause = "advice is given again" if since_ns else "the first advice"
            yield _changed(advice, before, told, cause, zone, timed=not own_timetable(recording))
        before, since_ns = told.mode, int(advice.time_ns)


def _display(recording: Recording) -> Presenter:
    """The presenter of the first presentation that the cab showed; the one without advice if none was recorded."""
    numbers = (entry.message.presentation for entry in recording.of(topics.CAB))
    first = next((int(one) for one in numbers if one), 0)
    return presenter_of(shown_presentation(first) or Presentation.NONE)


def _changed(advice: Any, before: Regime, told: ShownRegime, cause: str, zone: tzinfo, *, timed: bool) -> DriveEvent:
    held = f" at {kmh(told.speed_mps):.0f} km/h" if told.mode is Regime.CRUISE else ""
    reason = words(told.reason, zone=zone)
    why = f"{reason} ({cause})" if reason else cause
    return DriveEvent(
        time_ns=int(advice.time_ns),
        kind=EventKind.ADVICE,
        text=f"{mode_name(told.mode)}{held}: {why}",
        s_m=float(advice.s_m),
        facts={
            "mode": mode_name(told.mode),
            "mode_before": mode_name(before),
            "cause": cause,
            "reason": reason or words(Reason.read(advice.reason), zone=zone),
            "advised_speed_mps": told.speed_mps,
            "predicted_deviation_s": float(advice.predicted_deviation_s) if timed else None,
        },
    )


def replan_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """Every plan that replaced another."""
    for plan in new_plans(recording, trip):
        yield DriveEvent.on(trip, EventKind.REPLAN, plan.time_ns, f"new plan: {plan.cause}", cause=plan.cause)


def withdrawal_events(recording: Recording, trip: DrivenCourse, silent: tuple[Span, ...]) -> Iterator[DriveEvent]:
    """The times without advice, each with its cause and how long it lasted."""
    causes = {
        int(entry.message.time_ns): int(entry.message.cause)
        for entry in recording.of(topics.ADVICE)
        if entry.message.source == Source.NONE
    }
    for span in silent:
        lasted_s = (span.end_ns - span.start_ns) * NS
        unheard = span.text == NOT_HEARD
        cause = "not-heard" if unheard else Cause(causes.get(span.start_ns, 0)).label
        yield DriveEvent.on(
            trip, EventKind.LAPSE if unheard else EventKind.WITHDRAWAL, span.start_ns, silence_text(span),
            end_ns=span.end_ns, cause=cause, lasted_s=lasted_s, reason=span.text,
        )  # fmt: skip


def place_text(s_m: float) -> str:
    """A position as "km 12.3"; nothing for NaN."""
    return "" if math.isnan(s_m) else f"km {s_m / KM:.2f}"


DELAY_STEP_S: Final = 15.0
"""A delay that differs by at least this (s) from that of the last such event is an event; smaller changes are many."""


class LineAndTrain(NamedTuple):
    """The limit at every position of a course (m/s), the top speed of its train (m/s; infinite if not known), and the
    time zone of the line."""

    limit_mps: Floats
    top_mps: float
    zone: tzinfo


def events_of(
    recording: Recording, trip: DrivenCourse, made: tuple[KeptCall, ...], silent: tuple[Span, ...], known: LineAndTrain
) -> tuple[DriveEvent, ...]:
    """Everything that happened on a recorded drive, in order of time, with the line's times of day.

    `made` says how the drive kept each stop, and `silent` are the times without advice.
    """
    found = (
        *call_events(trip, made),
        *stand_events(trip, made),
        *_told_events(recording, trip, known.zone),
        *advice_events(recording, trip, known.zone),
        *replan_events(recording, trip),
        *withdrawal_events(recording, trip, silent),
        *overspeed_events(trip, known.limit_mps),
        *top_speed_events(trip, known.top_mps),
        *(decision_events(recording, trip) if recording.of(topics.DECISION) else driver_events(recording, trip)),
        *pause_events(recording, trip),
        *deviation_events(recording, trip),
        *_notes(recording, trip),
        *_marked_moments(recording, trip),
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


def _marked_moments(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """The moments that the person at a cab desk marked, as notes."""
    for mark in (entry.message for entry in recording.of(topics.MARK)):
        if mark.kind == mark.KIND_MARK:
            yield DriveEvent.on(trip, EventKind.NOTE, mark.time_ns, "marked by the driver")


def _notes(recording: Recording, trip: DrivenCourse) -> Iterable[DriveEvent]:
    """The notes that people made on the recording, as events; notes outside the time of the drive are left out."""
    for number, note in enumerate(read_notes(recording.path), start=1):
        if not trip.time_ns[0] <= note.time_ns <= trip.time_ns[-1]:
            continue
        tags = f" [{', '.join(note.tags)}]" if note.tags else ""
        by = f" ({note.author})" if note.author else ""
        yield DriveEvent.on(
            trip, EventKind.NOTE, note.time_ns, f"{note.text}{tags}{by}", end_ns=note.end_ns,
            number=number, note=note.text, tags=list(note.tags), author=note.author,
        )  # fmt: skip


def _told_events(recording: Recording, trip: DrivenCourse, zone: tzinfo) -> Iterator[DriveEvent]:
    """Events for everything that node or driver received or that node or simulator logged, in no particular order."""
    yield from _restrictions(recording, trip, zone)
    for point in points(recording, trip):
        text = f"traffic management: {point.text} at km {point.s_m / KM:.1f}"
        yield DriveEvent.on(trip, EventKind.TARGET, point.told_ns, text)
    for entry in recording.of(topics.JOURNEY)[1:]:
        stops = " – ".join(stop.name for stop in entry.message.stops)
        text = f"another journey was received: {stops}"
        yield DriveEvent.on(trip, EventKind.JOURNEY, int(entry.message.time_ns), text)
    yield from _delays(recording, trip)
    for signal in signals(recording):
        lasted_s = (signal.end_ns - signal.start_ns) * NS
        yield DriveEvent.on(
            trip, EventKind.SIGNAL, signal.start_ns,
            f"signal at danger at km {signal.s_m / KM:.2f} in sight for {lasted_s:.0f} s",
            end_ns=signal.end_ns, signal_m=signal.s_m, lasted_s=lasted_s,
        )  # fmt: skip
    for entry in recording.of(topics.LOG):
        yield _said(entry.message, EventKind.LOG, trip)
    for entry in recording.of(topics.EVENT):
        if entry.message.level >= Log.WARNING:
            yield _said(entry.message, EventKind.WARNING, trip)


def _restrictions(recording: Recording, trip: DrivenCourse, zone: tzinfo) -> Iterator[DriveEvent]:
    for span in temporary_limits(recording, trip):
        one = span.restriction
        facts: dict[str, Any] = {"start_m": one.start_m, "end_m": one.end_m, "limit_mps": one.limit_mps}
        for at, word in span.changes():
            if word == "received" or at <= trip.time_ns[-1]:
                text = f"restriction {word}: {one.words_in(zone)}"
                yield DriveEvent.on(trip, EventKind.RESTRICTION, at, text, **facts)


def _delays(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """An event for each delay that differs by at least `DELAY_STEP_S` from that of the last such event.

    There is none without a timetable: older replays made up delays for the node.
    """
    if own_timetable(recording):
        return
    delay = recording.columns(topics.DELAY, "time_ns", "delay_s")
    before_s = 0.0
    for time_ns, delay_s in zip(delay["time_ns"].tolist(), delay["delay_s"].tolist(), strict=True):
        if abs(delay_s - before_s) >= DELAY_STEP_S:
            text = f"the operator reports {lateness_text(delay_s)}"
            yield DriveEvent.on(trip, EventKind.DELAY, time_ns, text, delay_s=delay_s)
            before_s = delay_s


def _said(log: Any, kind: EventKind, trip: DrivenCourse) -> DriveEvent:
    said = f"{log.name}: {log.message}" if log.name else str(log.message)
    return DriveEvent.on(trip, kind, log.timestamp.ToNanoseconds(), said)
