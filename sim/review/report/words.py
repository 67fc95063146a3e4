"""The drive in plain words and in tables: what the page says besides its pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np

from das.bus import topics
from das.domain.units import KM, NS, kmh, kwh
from sim.drive.attribution.account import OTHER_TRAIN, Account
from sim.drive.attribution.causes import OVER_MPS, EnergyCause
from sim.drive.attribution.rows import seconds_by_cause, worst_places
from sim.drive.drive import Drive
from sim.drive.events.chronicle import place_text
from sim.drive.events.event import DriveEvent, EventKind, Filter, bookmarks
from sim.recording.clock import minutes, spell
from sim.review.report.circumstances import at_signals, came_about, moment_words, restrictions_told
from sim.review.summary import readable

LASTS_S: Final = 3.0
"""What a display shows counts for this long at most (s) until it says something again."""
MAIN_CAUSES: Final = 3
"""Causes that the paragraph names."""
NAMED_KWH: Final = 0.1
"""A cause of less than this is not named in the paragraph."""
BEFORE_S: Final = 10.0
"""Changes of the advice are listed from this long (s) before a bookmark …"""
AFTER_S: Final = 5.0
"""… to this long (s) after it was over."""
TOLD: Final = tuple(
    kind for kind in EventKind if kind not in (EventKind.ADVICE, EventKind.REPLAN, EventKind.LOG, EventKind.DRIVER)
)
"""The kinds of events that the page lists; it counts the others."""

RIGHT_TRAIN: Final = "Is it the right train?"
LIMIT_UNKNOWN: Final = "Whether it kept the line's limits is not known: the recording does not bring its line along."

Row = dict[str, Any]


def title(drive: Drive) -> str:
    """Train, way, day and file, for the head of the page."""
    clock, calls = drive.clock, [call for call in drive.calls if call.reached]
    day = f"{datetime.fromtimestamp(clock.zero_ns * NS, UTC):%d %B %Y}".lstrip("0")
    way = f"{calls[0].name} – {calls[-1].name}, " if len(calls) > 1 else ""
    return f"{drive.recording.train}, {way}{day} ({drive.name})"


def paragraph(drive: Drive) -> str:
    """The figures of a drive in a few sentences."""
    cut = [] if drive.recording.complete else ["The recording was cut off; what follows is about the drive until then."]
    return " ".join([*cut, *_ran(drive), *came_about(drive), *_took(drive), *_kept(drive)])


def _ran(drive: Drive) -> list[str]:
    """When the train ran from where to where, and how late it was."""
    trip, clock, served = drive.course, drive.clock, drive.served
    day = f"{datetime.fromtimestamp(clock.zero_ns * NS, UTC):%d %B %Y}".lstrip("0")
    km = (float(trip.s_m[-1]) - float(trip.s_m[0])) / KM
    if len(served) < 2 or not served[0].departed_ns or not served[-1].arrived_ns:
        lasted = spell(float(trip.time_ns[-1] - trip.time_ns[0]) * NS)
        return [f"The recording of {drive.recording.train} on {day} covers {km:.1f} km in {lasted}."]
    first, last = served[0], served[-1]
    km = (last.s_m - first.s_m) / KM
    # Of the times as they are shown, to the second, so that they add up.
    ran = spell(round(last.arrived_ns * NS) - round(first.departed_ns * NS))
    told = [
        f"On {day}, {drive.recording.train} ran the {km:.1f} km from {first.name} to {last.name} in {ran}.",
        f"It left at {clock.of_day(first.departed_ns)} UTC{_late(first.departed_late_s)} "
        f"and arrived at {clock.of_day(last.arrived_ns)}{_late(last.arrived_late_s)}.",
    ]
    missed = [call.name for call in drive.calls if not call.served and call.reached]
    return [*told, *([f"It did not stop at {', '.join(missed)}."] if missed else [])]


def _late(late_s: float) -> str:
    if math.isnan(late_s):
        return ""
    return " (on time)" if abs(late_s) < 0.5 else f" ({abs(late_s):.0f} s {'late' if late_s > 0 else 'early'})"


def _took(drive: Drive) -> list[str]:
    """How much energy the drive took, how much more than the best, and why."""
    account = drive.account
    if account is None:
        return [f"Where its energy went cannot be said: {drive.why_no_account}."]
    driven, more, best = kwh(account.driven_j), kwh(account.difference_j), kwh(account.optimum_j)
    ratio = account.above.ratio
    word = "above" if more >= 0 else "below"
    how = "It drew" if account.measured else "By its positions it drew about"
    share = "" if ratio is None else f" ({abs(ratio):.1%})"
    told = [
        f"{how} {driven:.1f} kWh at the current collector: {abs(more):.1f} kWh{share} {word} "
        f"the {best:.1f} kWh of the best possible drive with the same departures and arrivals, which knew of no "
        "signal and no temporary restriction."
    ]
    if drive.likely is not None:
        low, high = kwh(drive.likely.low_j), kwh(drive.likely.high_j)
        told.append(
            f"Mass, resistance and wind are not known; by these alone it is likely {low:.1f} to {high:.1f} kWh."
        )
        if not math.isnan(drive.likely.by_friction_j):
            told.append(f"If the train braked by friction alone, it is {kwh(drive.likely.by_friction_j):.0f} kWh.")
    named = told_causes(account)[:MAIN_CAUSES]
    words = [f"{cause.label} {kwh(energy_j):.1f} kWh" for cause, energy_j in named if kwh(energy_j) >= NAMED_KWH]
    if words:
        told.append(f"Most of that is: {', '.join(words)}.")
    worst = worst_places(account, 1)
    if worst and kwh(worst[0].more_j) >= NAMED_KWH:
        causes = " and ".join(cause.label for cause in worst[0].causes)
        told.append(f"The most was lost from {worst[0].where}: {kwh(worst[0].more_j):.1f} kWh ({causes}).")
    return told


def _kept(drive: Drive) -> list[str]:
    """How limits and advice were kept."""
    events = drive.events
    told = _fast(events, EventKind.OVERSPEED, "above the limit")
    told = told or (["It kept every limit."] if drive.limit_known else [LIMIT_UNKNOWN])
    told += _fast(events, EventKind.BEYOND_TRAIN, "faster than the vehicle file says the train can go")
    told += [RIGHT_TRAIN] if any(one.kind is EventKind.BEYOND_TRAIN for one in events) else []
    followed = compliance(drive)
    if followed is not None:
        lasted = spell(shown_s(drive))
        told.append(
            f"While a speed to keep was shown (for {lasted}), it drove within {kmh(OVER_MPS):.0f} km/h of it "
            f"{followed:.0%} of the time."
        )
    gone = [one for one in events if one.kind is EventKind.WITHDRAWAL]
    if gone:
        lasted = sum(one.facts["lasted_s"] for one in gone)
        told.append(f"Advice was withdrawn {_times(len(gone))}, for {lasted:.0f} s in all.")
    elif drive.recording.of(topics.ADVICE):
        told.append("Advice was never withdrawn.")
    told += at_signals(drive)
    return told


def _fast(events: Sequence[DriveEvent], kind: EventKind, words: str) -> list[str]:
    """How often, how long and by how much the train was faster than allowed or possible; nothing where it was not."""
    over = [one.facts for one in events if one.kind is kind]
    if not over:
        return []
    worst_kmh, lasted_s = max(one["over_kmh"] for one in over), sum(one["lasted_s"] for one in over)
    return [f"The train was {words} {_times(len(over))}, for {lasted_s:.0f} s in all, by up to {worst_kmh:.0f} km/h."]


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def compliance(drive: Drive) -> float | None:
    """Share of the time with a shown speed to keep in which the train was within 2 km/h of it, or below a top speed."""
    shown, trip = drive.shown, drive.course
    speed_mps = trip.at(shown.time_ns, trip.speed_mps)
    given = shown.comparable & (speed_mps > 1.0)
    if not given.any():
        return None
    apart_mps = (speed_mps - shown.speed_mps)[given]
    apart_mps = np.where(shown.top_only[given], np.maximum(apart_mps, 0.0), apart_mps)
    return float((np.abs(apart_mps) <= OVER_MPS).mean())


def shown_s(drive: Drive) -> float:
    """For how long (s) a speed to keep was shown while the train moved."""
    shown, trip = drive.shown, drive.course
    if len(shown.time_ns) < 2:
        return 0.0
    given = shown.comparable & (trip.at(shown.time_ns, trip.speed_mps) > 1.0)
    lasts_s = np.minimum(np.diff(shown.time_ns, append=shown.time_ns[-1]) * NS, LASTS_S)
    return float(lasts_s[given].sum())


def figures(drive: Drive) -> list[tuple[str, str]]:
    """The figures of a drive, by name."""
    account, events = drive.account, drive.events
    rows: list[tuple[str, str]] = []
    if account is not None:
        rows += _energy_rows(account)
    for one in () if drive.likely is None else drive.likely.unknowns:
        spread = f"{kwh(one.low_j):+.1f} to {kwh(one.high_j):+.1f} kWh"
        rows.append((f"above the optimum, by {one.name} {one.assumed}", spread))
    told = restrictions_told(drive)
    rows += [("temporary restrictions told", told)] if told else []
    followed = compliance(drive)
    if followed is not None:
        share = f"{followed:.0%} of {spell(shown_s(drive))}"
        rows.append((f"within {kmh(OVER_MPS):.0f} km/h of a speed shown to keep", share))
    answers = [one.facts for one in events if "followed" in one.facts]
    if answers:
        seconds = [float(one["reaction_s"]) for one in answers if one["followed"]]
        rows.append(("advice followed, of the changes that asked for something", f"{len(seconds)} of {len(answers)}"))
        if seconds:
            rows.append(("median time until he followed", f"{float(np.median(seconds)):.0f} s"))
    return rows


def _energy_rows(account: Account) -> list[tuple[str, str]]:
    """From the optimum for the timetable to the energy as driven, in steps that sum."""
    rows = []
    against = account.against_timetable
    if against is not None and account.timetable_j is not None:
        rows.append(("optimum for the timetable", f"{kwh(account.timetable_j):.1f} kWh"))
        for cause in (EnergyCause.RECOVERED, EnergyCause.ARRIVAL):
            rows.append((cause.label, f"{kwh(against[cause]):+.1f} kWh"))
        if account.other_train_j:
            rows.append((OTHER_TRAIN, f"{kwh(account.other_train_j):+.1f} kWh"))
    return [
        *rows,
        ("optimum for the same times", f"{kwh(account.optimum_j):.1f} kWh"),
        ("above that optimum", account.above.words),
        ("energy as driven", f"{kwh(account.driven_j):.1f} kWh{'' if account.measured else ' (estimated)'}"),
    ]


def stop_rows(drive: Drive) -> list[Row]:
    """How every stop was kept."""
    clock = drive.clock

    def at(time_ns: int) -> str:
        return clock.of_day(time_ns) if time_ns else ""

    def late(late_s: float) -> str:
        return "" if math.isnan(late_s) else f"{late_s:+.0f} s"

    return [
        {
            "name": call.name,
            "place": place_text(call.s_m),
            "due": at(call.due_arrival_ns),
            "arrived": at(call.arrived_ns) if index else "",
            "arrived_late": late(call.arrived_late_s),
            "leaves": at(call.due_departure_ns),
            "departed": at(call.departed_ns) if index < len(drive.calls) - 1 else "",
            "departed_late": late(call.departed_late_s),
            "remark": "" if call.served else ("passed without stopping" if call.reached else "not reached"),
        }
        for index, call in enumerate(drive.calls)
    ]


def cause_rows(account: Account) -> list[Row]:
    """Every cause with its energy, its share, how long it went on and what it means."""
    lasted, whole_j = seconds_by_cause(account), account.difference_j
    always = (EnergyCause.FRICTION, EnergyCause.TRAIN)
    return [
        {
            "label": cause.label,
            "kwh": f"{kwh(energy_j):+.1f}",
            "share": f"{energy_j / whole_j:.0%}" if kwh(abs(whole_j)) >= 1.0 else "",
            "time": "" if cause in always else minutes(lasted.get(cause, 0.0)),
            "meaning": cause.meaning,
        }
        for cause, energy_j in told_causes(account)
    ]


def time_rows(account: Account) -> list[Row]:
    """What the times themselves cost against the timetable; nothing without one."""
    against = account.against_timetable
    return [
        {"label": cause.label, "kwh": f"{kwh(against[cause]):+.1f}", "meaning": cause.meaning}
        for cause in (EnergyCause.RECOVERED, EnergyCause.ARRIVAL)
        if against is not None
    ]


def told_causes(account: Account) -> list[tuple[EnergyCause, float]]:
    """The causes with their energies (J), the largest first; without those that nobody could measure."""
    parts = [one for one in account.by_cause.items() if one[1] or account.measured]
    return sorted(parts, key=lambda one: -one[1])


def leg_rows(account: Account) -> list[Row]:
    """Every leg with its times and energies."""
    return [
        {
            "name": f"{leg.leg.start.name} – {leg.leg.end.name}",
            "time": minutes(leg.leg.trip_s),
            "timetable": "" if leg.leg.timetable_s is None else minutes(leg.leg.timetable_s),
            "driven": f"{kwh(leg.driven_j):.1f}",
            "optimum": f"{kwh(leg.optimum_j):.1f}",
            "more": f"{kwh(leg.driven_j - leg.optimum_j):+.1f}",
            "late": "" if leg.recovered_j is None else f"{kwh(leg.recovered_j):+.1f}",
            "early": "" if leg.early_j is None else f"{kwh(leg.early_j):+.1f}",
        }
        for leg in account.legs
    ]


def event_rows(drive: Drive) -> list[Row]:
    """What happened: everything but the single changes of the advice, and answers that were as they should be."""
    told = Filter(kinds=TOLD).choose(drive.events)
    unanswered = [
        one
        for one in drive.events
        if one.kind is EventKind.DRIVER and not one.facts.get("followed")  # refused, or attention was away
    ]
    clock = drive.clock
    found = sorted([*told, *unanswered, *_advice_at_marks(drive)], key=lambda one: one.time_ns)
    return [
        {
            "time": clock.shown(one.time_ns),
            "utc": clock.of_day(one.time_ns),
            "place": place_text(one.s_m),
            "kind": str(one.kind),
            "text": one.text,
            "mark": one.mark,
        }
        for one in found
    ]


def _advice_at_marks(drive: Drive) -> list[DriveEvent]:
    """The changes of the advice around the bookmarks that are about the train or the line."""
    marks = [one for one in drive.events if one.mark and one.kind is not EventKind.DRIVER]
    before_ns, after_ns = round(BEFORE_S / NS), round(AFTER_S / NS)
    return [
        one
        for one in drive.events
        if one.kind is EventKind.ADVICE
        and any(mark.time_ns - before_ns <= one.time_ns <= mark.last_ns + after_ns for mark in marks)
    ]


def advice_rows(drive: Drive) -> list[Row]:
    """Every change of the advice and every new plan, with its reason."""
    clock = drive.clock
    return [
        {
            "time": clock.shown(one.time_ns),
            "utc": clock.of_day(one.time_ns),
            "place": place_text(one.s_m),
            "text": one.text,
        }
        for one in Filter(kinds=(EventKind.ADVICE, EventKind.REPLAN)).choose(drive.events)
    ]


def left_out(drive: Drive) -> str:
    """How many events the page does not list, in words."""
    counts = {kind: sum(one.kind is kind for one in drive.events) for kind in (EventKind.ADVICE, EventKind.REPLAN)}
    counts[EventKind.ADVICE] -= len(_advice_at_marks(drive))
    return f"{counts[EventKind.ADVICE]} changes of the advice elsewhere and {counts[EventKind.REPLAN]} new plans"


def bookmark_rows(drive: Drive) -> list[Row]:
    """What a reviewer wants to see first, with the notes of people."""
    clock = drive.clock
    return [
        {
            "time": clock.shown(one.time_ns),
            "utc": clock.of_day(one.time_ns),
            "place": place_text(one.s_m),
            "mark": one.mark or "note",
            "text": one.text,
            "driven": driven,
            "shown": shown,
        }
        for one in bookmarks(drive.events)
        for driven, shown in [moment_words(drive, one.time_ns)]
    ]


def input_rows(drive: Drive) -> list[tuple[str, str]]:
    """What the drive was made from: metadata, hashes and files."""
    rows = [
        readable(key, value)
        for entries in drive.recording.metadata.values()
        for key, value in entries.items()
        if key != "drawn"
    ]
    if drive.account is not None:
        rows.append(("line and train of this page", drive.account.inputs.source))
        rows.append(("energies", "measured" if drive.account.measured else "estimated from positions"))
    said = [] if drive.said is None else drive.said.rows()
    rows += [(f"said by the recording: {name}", text) for name, text in said]
    return [*rows, ("attached files", ", ".join(drive.recording.attachments) or "none")]
