"""The tables of a report: figures, stops, causes, legs, events, bookmarks and sources."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from das.advice.regimes import mode_name
from das.domain.levels import Level
from das.domain.plausibility import energy_range
from das.domain.units import NS, kmh, kwh, kwh_figure, kwh_words
from sim.drive.attribution import OTHER_TRAIN, Attribution, seconds_by_cause
from sim.drive.calls import PASSINGS, KeptPassing, keep, recorded_passings
from sim.drive.causes import APART_MPS, EnergyCause
from sim.drive.drive import Drive
from sim.drive.events import DriveEvent, EventKind, Filter, bookmarks, place_text
from sim.drive.table import HOLDS_S
from sim.recording.course import minutes, spell, times_text
from sim.review.first_page import friction_chosen_by, told_causes

TOLD: Final = tuple(
    kind for kind in EventKind if kind not in (EventKind.ADVICE, EventKind.REPLAN, EventKind.LOG, EventKind.DRIVER)
)
"""The kinds of events that the page lists; changes of the advice have their own list."""
TOLD_ELSEWHERE: Final = ("drawn", PASSINGS)
"""Keys of the metadata that the page shows in other tables, or not at all."""
NONE_TOLD: Final = "none (an empty list was received)"
LOSSES: Final[Mapping[str, str]] = {
    Level.L0_NOREG: "none, and nothing is fed back (level L0 without regeneration)",
    Level.L0_REG: "none (level L0)",
    Level.L1: "a constant efficiency (level L1)",
    Level.L2: "of each component, by power (level L2)",
    Level.L3: "of each component, by speed and force (level L3)",
}
Row = dict[str, Any]


def figures(drive: Drive) -> list[tuple[str, str]]:
    """The figures of a drive, by name."""
    attribution, events = drive.energy.attribution, drive.events
    rows: list[tuple[str, str]] = []
    if attribution is not None:
        rows += _energy_rows(attribution)
    unknowns = () if drive.energy.likely is None else drive.energy.likely.unknowns
    for one in (one for one in unknowns if one.high_j > one.low_j):
        spread = f"{kwh_figure(one.low_j, signed=True)} to {kwh_words(one.high_j, signed=True)}"
        rows.append((f"effect of {one.name} {one.assumed} on the energy above the optimum", spread))
    told = restrictions_told(drive)
    rows += [("temporary restrictions received", told)] if told else []
    if drive.table.has("advice"):
        lasted_s = [one.facts["lasted_s"] for one in events if one.kind is EventKind.WITHDRAWAL]
        often = f"{times_text(len(lasted_s))}, for {sum(lasted_s):.0f} s in all" if lasted_s else "never"
        rows.append(("advice withdrawn", often))
    followed, shown_s = compliance(drive)
    if followed is not None:
        share = f"{followed:.0%} of {spell(shown_s)}"
        rows.append((f"time within {kmh(APART_MPS):.0f} km/h of the displayed speed", share))
    answers = [one.facts for one in events if "followed" in one.facts]
    if answers:
        seconds = [float(one["reaction_s"]) for one in answers if one["followed"]]
        rows.append(("advice followed, of the changes that required an action", f"{len(seconds)} of {len(answers)}"))
        if seconds:
            rows.append(("median time until the driver followed", f"{float(np.median(seconds)):.0f} s"))
    warning = drive.figures.stability.warning
    rows += [(name.strip(), value) for name, value in drive.figures.rows()]
    return rows + ([] if warning is None else [("warning", warning)])


def _energy_rows(attribution: Attribution) -> list[tuple[str, str]]:
    """The energy terms from the optimum for the timetable to the energy as driven; they add up."""
    rows = []
    against = attribution.against_timetable
    if against is not None and attribution.timetable_j is not None:
        rows.append(("optimum for the timetable", kwh_words(attribution.timetable_j)))
        for cause in (EnergyCause.RECOVERED, EnergyCause.ARRIVAL):
            rows.append((cause.label, kwh_words(against[cause], signed=True)))
        if attribution.other_train_j:
            rows.append((OTHER_TRAIN, kwh_words(attribution.other_train_j, signed=True)))
    return [
        *rows,
        ("optimum for the same times", kwh_words(attribution.above.optimum_j)),
        ("above that optimum", attribution.above.words),
        (
            "energy as driven",
            f"{kwh_words(attribution.above.driven_j)}{'' if attribution.above.measured else ' (estimated)'}",
        ),
    ]


def restrictions_told(drive: Drive) -> str:
    """The temporary restrictions that the node received, in words; empty if it received no list."""
    lists = drive.table.said.restrictions
    if not lists:
        return ""
    told = dict.fromkeys(one for entry in lists for one in entry.valid)
    nothing = "none that is valid" if any(one.all for one in lists) else NONE_TOLD
    return "; ".join(one.words_in(drive.table.zone) for one in told) or nothing


def stop_rows(drive: Drive) -> list[Row]:
    """Punctuality at every stop."""
    clock = drive.table.clock

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


def passings(drive: Drive) -> tuple[KeptPassing, ...]:
    """The passings of the journey, with the time of the train at each."""
    due = recorded_passings(drive.table.run)
    return keep(due, drive.table.course.time_ns, drive.table.course.s_m)


def passing_rows(drive: Drive) -> list[Row]:
    """The time of the train at each passing of its journey, and whether the due time was kept."""
    clock = drive.table.clock
    return [
        {
            "name": one.due.name,
            "place": place_text(one.due.s_m),
            "earliest": clock.of_day(one.due.earliest_ns) if one.due.earliest_ns else "",
            "latest": clock.of_day(one.due.latest_ns) if one.due.latest_ns else "",
            "passed": clock.of_day(one.passed_ns) if one.passed_ns else "",
            "late": "" if math.isnan(one.late_s) else f"{one.late_s:+.0f} s",
            "remark": one.words,
        }
        for one in passings(drive)
    ]


def cause_rows(attribution: Attribution) -> list[Row]:
    """Every cause with its energy, its share, its duration and its meaning."""
    lasted, whole_j = seconds_by_cause(attribution), attribution.above.difference_j
    always = (EnergyCause.FRICTION, EnergyCause.TRAIN)
    return [
        {
            "label": cause.label,
            "kwh": kwh_figure(energy_j, signed=True),
            "share": f"{round(energy_j / whole_j, 2) + 0.0:.0%}" if kwh(abs(whole_j)) >= 1.0 else "",
            "time": "" if cause in always else minutes(lasted.get(cause, 0.0)),
            "meaning": cause.meaning,
        }
        for cause, energy_j in told_causes(attribution)
    ]


def leg_rows(attribution: Attribution) -> list[Row]:
    """Every leg with its times and energies."""
    return [
        {
            "name": f"{leg.leg.start.name} – {leg.leg.end.name}",
            "time": minutes(leg.leg.trip_s),
            "timetable": "" if leg.leg.timetable_s is None else minutes(leg.leg.timetable_s),
            "driven": kwh_figure(leg.driven_j),
            "optimum": kwh_figure(leg.optimum_j),
            "more": kwh_figure(leg.driven_j - leg.optimum_j, signed=True),
            "late": "" if leg.recovered_j is None else kwh_figure(leg.recovered_j, signed=True),
            "early": "" if leg.early_j is None else kwh_figure(leg.early_j, signed=True),
        }
        for leg in attribution.legs
    ]


def event_rows(drive: Drive) -> list[Row]:
    """The events, without changes of the advice and without the responses of a driver who followed it."""
    told = Filter(kinds=TOLD).choose(drive.events)
    unanswered = [
        one
        for one in drive.events
        if one.kind is EventKind.DRIVER and not one.facts.get("followed")  # refused, or inattentive
    ]
    return _rows(drive, sorted([*told, *unanswered], key=lambda one: one.time_ns))


def advice_rows(drive: Drive) -> list[Row]:
    """Every change of the advice and every new plan, with its reason."""
    return _rows(drive, Filter(kinds=(EventKind.ADVICE, EventKind.REPLAN)).choose(drive.events))


def bookmark_rows(drive: Drive) -> list[Row]:
    """The bookmarks of the review and people's notes, each with the speed and the display at that time."""
    found = bookmarks(drive.events)
    moments = [dict(zip(("driven", "shown"), _moment_words(drive, one.time_ns), strict=True)) for one in found]
    rows = zip(_rows(drive, found), moments, strict=True)
    return [{**row, **moment, "mark": row["mark"] or "note"} for row, moment in rows]


def _rows(drive: Drive, events: Iterable[DriveEvent]) -> list[Row]:
    clock = drive.table.clock
    return [
        {
            "time": clock.shown(one.time_ns),
            "of_day": clock.of_day(one.time_ns),
            "place": place_text(one.s_m),
            "kind": str(one.kind),
            "text": one.text,
            "mark": one.mark,
        }
        for one in events
    ]


def _moment_words(drive: Drive, time_ns: int) -> tuple[str, str]:
    trip = drive.table.course
    driven = f"{kmh(float(trip.at(np.array([time_ns]), trip.speed_mps)[0])):.0f} km/h"
    seen = drive.energy.shown.at(time_ns)
    if seen is None:
        return driven, "nothing"
    if seen.top_only:
        return driven, f"at most {kmh(seen.speed_mps):.0f} km/h"
    speed = "" if np.isnan(seen.speed_mps) else f", {kmh(seen.speed_mps):.0f} km/h"
    return driven, f"{mode_name(seen.mode)}{speed}"


def input_rows(drive: Drive) -> list[tuple[str, str]]:
    """The sources of the drive and of its figures: metadata, hashes, files, line and train."""
    rows = [
        readable(key, value)
        for entries in drive.recording.metadata.values()
        for key, value in entries.items()
        if key not in TOLD_ELSEWHERE
    ]
    if drive.energy.attribution is not None:
        inputs = drive.table.inputs
        vehicle, level = inputs.vehicle, inputs.level
        rows += [
            ("line and train of this page", inputs.source),
            ("energies", "simulated" if drive.energy.attribution.above.measured else "estimated from positions"),
            ("planned mass", f"{vehicle.mass_kg / 1000:.0f} t, train length {vehicle.train_length_m:.0f} m"),
            ("losses of the optimum", LOSSES.get(level, str(level))),
        ]
    chosen = friction_chosen_by(drive)
    rows += line_rows(drive) + ([("choice of the friction brake", chosen)] if chosen else [])
    said = [] if drive.table.said.saving is None else drive.table.said.saving.rows()
    rows += [(f"stated in the recording: {name}", text) for name, text in said]
    return [*rows, ("attached files", ", ".join(drive.recording.attachments) or "none")]


def line_rows(drive: Drive) -> list[tuple[str, str]]:
    """Origin of the line's data as its file states it, and the possible error of energies due to altitudes."""
    if drive.table.known_inputs is None:
        return []
    route = drive.table.known_inputs.route
    rows = (("data of the line", route.credit), ("altitudes of the line", energy_range(route)))
    return [(name, text) for name, text in rows if text]


def readable(key: str, value: str) -> tuple[str, str]:
    """An entry of the metadata for people: energies in kWh, hashes shortened."""
    if key.endswith("_j"):
        try:
            return key[:-2].replace("_", " "), kwh_words(float(value))
        except ValueError:
            return key, value
    return key.replace("_", " "), value[:12] + "…" if "sha256" in key and len(value) > 12 else value


def compliance(drive: Drive) -> tuple[float | None, float]:
    """The share of the time with a speed to keep in which it was kept within 2 km/h (None: none was shown), and that
    time (s), in which the train moved. A speed shown as the highest is also kept at any lower speed.
    """
    shown, trip = drive.energy.shown, drive.table.course
    speed_mps = trip.at(shown.time_ns, trip.speed_mps)
    given = shown.comparable & (speed_mps > 1.0)
    if not given.any():
        return None, 0.0
    apart_mps = (speed_mps - shown.speed_mps)[given]
    apart_mps = np.where(shown.top_only[given], np.maximum(apart_mps, 0.0), apart_mps)
    lasts_s = np.minimum(np.diff(shown.time_ns, append=shown.time_ns[-1]) * NS, HOLDS_S)
    return float((np.abs(apart_mps) <= APART_MPS).mean()), float(lasts_s[given].sum())
