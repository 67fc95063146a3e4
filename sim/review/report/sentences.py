"""Sentences about a drive: how it came about, when it ran, and where it lost time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime
from itertools import pairwise
from typing import Final

import numpy as np

from das.domain.units import KM, NS
from sim.drive.attribution.attribution import Attribution
from sim.drive.attribution.causes import APART_MPS, EnergyCause
from sim.drive.calls import KeptCall
from sim.drive.drive import Drive
from sim.drive.events import DriveEvent, EventKind, lateness_text, place_text
from sim.drive.table import HOLDS_S
from sim.drivers.kinds import DriverKind, External, FrictionPolicy, Presentation
from sim.drivers.presentations.presenter import presenter_of
from sim.recording.course import spell
from sim.recording.opening import CHANGED, NOTHING, OF, WHAT_IF

NAMED_KWH: Final = 0.1
"""Least energy (kWh) of a cause that the page names."""
RIGHT_TRAIN: Final = "Is it the right train?"
LIMIT_UNKNOWN: Final = "Whether it kept the line's limits is not known: the recording does not contain its line."
DRIVERS: Final[Mapping[str, str]] = {
    DriverKind.PERFECT: "a driver who follows advice exactly",
    DriverKind.LITERAL: "a driver who follows the guide's card and nothing else",
    DriverKind.FAST: "a driver who runs as fast as permitted",
    DriverKind.TOP_SPEED: "a driver who keeps a reduced maximum speed",
    DriverKind.TIMETABLE: "a driver who keeps to the timetable",
    DriverKind.HUMAN: "a simulated human",
    External.EXTERNAL: "a driver in a separate process",
    External.DESK: "a person at the cab desk",
}
FRICTION: Final[Mapping[str, str]] = {
    FrictionPolicy.AS_MEASURED: "the simulated driver's habit to brake a share by friction, with any display",
    FrictionPolicy.ELECTRIC_FIRST: "the simulated driver, who brakes by friction only if the motors cannot",
    FrictionPolicy.BY_ADVICE: "the simulated driver's habit, but electric first while following advice on effort",
}
TOLD_S: Final = 3.0
"""Least change (s) of the lateness in the sentences."""
HELD_UP: Final = (EventKind.SIGNAL, EventKind.STAND, EventKind.RESTRICTION)
"""Events that hold the train up."""
LEAST_STAND_S: Final = 10.0
"""A shorter stand on the way (s) is no reason for lateness."""


def title(drive: Drive) -> str:
    """Train, first and last stop, day and file, for the head of the page."""
    calls = [call for call in drive.calls if call.reached]
    way = f"{calls[0].name} – {calls[-1].name}, " if len(calls) > 1 else ""
    return f"{drive.recording.train}, {way}{_day(drive)} ({drive.name})"


def _day(drive: Drive) -> str:
    """The date of a drive in words."""
    return f"{datetime.fromtimestamp(drive.table.clock.zero_ns * NS, drive.table.zone):%d %B %Y}".lstrip("0")


def ran(drive: Drive) -> list[str]:
    """When the train ran from where to where, and how late it was."""
    clock, served, day, went = drive.table.clock, drive.served, _day(drive), drive.travelled
    km, lasted = f"{went.way_m / KM:.1f} km", spell(went.time_s)
    if not went.between_stops:
        return [f"The recording of {drive.recording.train} on {day} covers {km} in {lasted}."]
    first, last = served[0], served[-1]
    left, arrived = _late(first.departed_late_s), _late(last.arrived_late_s)
    told = [
        f"On {day}, {drive.recording.train} ran the {km} from {first.name} to {last.name} in {lasted}.",
        f"It left at {clock.of_day(first.departed_ns)}{left} and arrived at {clock.of_day(last.arrived_ns)}{arrived}.",
    ]
    missed = [call.name for call in drive.calls if not call.served and call.reached]
    return [*told, *([f"It did not stop at {', '.join(missed)}."] if missed else [])]


def _late(late_s: float) -> str:
    return "" if math.isnan(late_s) else f" ({lateness_text(late_s)})"


def came_about(drive: Drive) -> list[str]:
    """Sentences about how the drive came about; none if the recording does not say."""
    run = drive.table.run
    told = []
    if run.get("kind") == "run":
        driver, shown = DRIVERS.get(run.get("driver", ""), run.get("driver", "")), run.get("advice", "")
        day = (
            f"The day was simulated (scenario {run.get('scenario', '?')}, seed {run.get('seed', '?')}): {driver} drove"
        )
        told.append(f"{day} and was shown {_presentation(shown)}.")
        happens = run.get("happens", NOTHING)
        told.append("The run had no disturbances." if happens == NOTHING else f"Disturbances: {happens}.")
    elif run.get("kind") == "replay":
        told.append(f"It is a replay of {run.get('trip', 'a trip')}: the driver did not see the advice.")
    if WHAT_IF in run:
        of, changed = run.get(OF, "?"), run.get(CHANGED, "?")
        told.append(f"It is a what-if of {of}, {run[WHAT_IF]}; otherwise: {changed}.")
    return told


def _presentation(name: str) -> str:
    """A presentation in words; an unknown presentation by its name."""
    try:
        return presenter_of(Presentation(name)).phrase
    except ValueError:
        return name


def friction_chosen_by(drive: Drive) -> str:
    """What the choice of the friction brake goes back to on a simulated drive; empty for any other drive."""
    run = drive.table.run
    return FRICTION.get(run.get("friction_policy", ""), "") if run.get("driver") == DriverKind.HUMAN else ""


def told_causes(attribution: Attribution) -> list[tuple[EnergyCause, float]]:
    """The causes with their energies (J), the largest first; for an estimated drive, only those that are not 0."""
    parts = [one for one in attribution.by_cause.items() if one[1] or attribution.above.measured]
    return sorted(parts, key=lambda one: -one[1])


def compliance(drive: Drive) -> float | None:
    """For which share of the time that a speed to keep was shown it was kept within 2 km/h; None if none was shown.

    A speed shown as the highest is also kept at any lower speed.
    """
    shown, trip = drive.energy.shown, drive.table.course
    speed_mps = trip.at(shown.time_ns, trip.speed_mps)
    given = shown.comparable & (speed_mps > 1.0)
    if not given.any():
        return None
    apart_mps = (speed_mps - shown.speed_mps)[given]
    apart_mps = np.where(shown.top_only[given], np.maximum(apart_mps, 0.0), apart_mps)
    return float((np.abs(apart_mps) <= APART_MPS).mean())


def shown_s(drive: Drive) -> float:
    """For how long (s) a speed to keep was shown while the train moved."""
    shown, trip = drive.energy.shown, drive.table.course
    if len(shown.time_ns) < 2:
        return 0.0
    given = shown.comparable & (trip.at(shown.time_ns, trip.speed_mps) > 1.0)
    lasts_s = np.minimum(np.diff(shown.time_ns, append=shown.time_ns[-1]) * NS, HOLDS_S)
    return float(lasts_s[given].sum())


def where_time_went(drive: Drive, most: int | None = None) -> list[str]:
    """A sentence for each leg and each stop at which the lateness changed, or for the `most` largest changes; nothing
    without a timetable."""
    calls = drive.served
    told: list[tuple[float, str]] = []
    for before, after in pairwise(calls):
        told += _at_stop(before)
        change_s = after.arrived_late_s - before.departed_late_s
        if not math.isnan(change_s) and abs(change_s) >= TOLD_S:
            word = "lost" if change_s > 0 else "made up"
            what = f"From {before.name} to {after.name} it {word} {abs(change_s):.0f} s against the timetable"
            told.append((abs(change_s), f"{what}{_because(drive, before, after)}."))
    if calls and not told and not math.isnan(calls[-1].arrived_late_s):
        told.append((0.0, f"It never lost or made up more than {TOLD_S:.0f} s against the timetable."))
    kept = sorted((change_s for change_s, _ in told), reverse=True)[:most]
    return [text for change_s, text in told if change_s in kept]


def _at_stop(call: KeptCall) -> list[tuple[float, str]]:
    change_s = call.departed_late_s - (0.0 if math.isnan(call.arrived_late_s) else max(call.arrived_late_s, 0.0))
    if math.isnan(change_s) or abs(change_s) < TOLD_S:
        return []
    if change_s < 0:
        return [(-change_s, f"At {call.name} it made up {abs(change_s):.0f} s.")]
    return [(change_s, f"At {call.name} it stayed {change_s:.0f} s longer than necessary.")]


def _because(drive: Drive, before: KeptCall, after: KeptCall) -> str:
    """What held the train up between two stops, in words."""
    on_way = [one for one in drive.events if _holds_up(one) and before.departed_ns <= one.time_ns <= after.arrived_ns]
    words = dict.fromkeys(_held_up(one) for one in on_way)
    return f"; on the way: {'; '.join(words)}" if words else ""


def _holds_up(one: DriveEvent) -> bool:
    """Whether an event held the train up: a short stand before a stop and the end of a restriction do not."""
    short = one.kind is EventKind.STAND and (one.last_ns - one.time_ns) * NS < LEAST_STAND_S
    ends = one.kind is EventKind.RESTRICTION and not one.text.startswith("restriction received")
    return one.kind in HELD_UP and not short and not ends


def _held_up(one: DriveEvent) -> str:
    lasted_s = (one.last_ns - one.time_ns) * NS
    match one.kind:
        case EventKind.SIGNAL:
            return f"a signal at danger, in sight from {place_text(one.s_m)} for {lasted_s:.0f} s"
        case EventKind.STAND:
            return f"a stand of {lasted_s:.0f} s at {place_text(one.s_m)}"
        case _:
            return one.text
