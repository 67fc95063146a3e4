"""Where a drive lost and won time, in sentences: by leg and by stop, with what happened there."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

from das.domain.units import NS
from sim.drive.calls import KeptCall
from sim.drive.drive import Drive
from sim.drive.events.chronicle import place_text
from sim.drive.events.event import DriveEvent, EventKind

TOLD_S: Final = 3.0
"""A change of the lateness by less than this (s) is not told."""
HELD_UP: Final = (EventKind.SIGNAL, EventKind.STAND, EventKind.RESTRICTION)
"""Events that take time."""


def where_time_went(drive: Drive) -> list[str]:
    """A sentence for each leg and each stop at which the lateness changed; nothing without a timetable."""
    calls = drive.served
    told = []
    for before, after in pairwise(calls):
        told += _at_stop(before)
        change_s = after.arrived_late_s - before.departed_late_s
        if not math.isnan(change_s) and abs(change_s) >= TOLD_S:
            word = "lost" if change_s > 0 else "made up"
            told.append(
                f"From {before.name} to {after.name} it {word} {abs(change_s):.0f} s against the timetable"
                f"{_because(drive, before, after)}."
            )
    if calls and not told and not math.isnan(calls[-1].arrived_late_s):
        told.append(f"Nowhere did it lose or make up more than {TOLD_S:.0f} s against the timetable.")
    return told


def _at_stop(call: KeptCall) -> list[str]:
    change_s = call.departed_late_s - (0.0 if math.isnan(call.arrived_late_s) else max(call.arrived_late_s, 0.0))
    if math.isnan(change_s) or abs(change_s) < TOLD_S:
        return []
    if change_s < 0:
        return [f"At {call.name} it made up {abs(change_s):.0f} s."]
    return [f"At {call.name} it stayed {change_s:.0f} s longer than it had to."]


def _because(drive: Drive, before: KeptCall, after: KeptCall) -> str:
    """What took time on the way between two stops, in words."""
    on_way = [
        one for one in drive.events if one.kind in HELD_UP and before.departed_ns <= one.time_ns <= after.arrived_ns
    ]
    words = [_held_up(one) for one in on_way]
    return f"; on the way: {'; '.join(words)}" if words else ""


def _held_up(one: DriveEvent) -> str:
    lasted_s = (one.last_ns - one.time_ns) * NS
    match one.kind:
        case EventKind.SIGNAL:
            return f"a signal at danger, in sight from {place_text(one.s_m)} for {lasted_s:.0f} s"
        case EventKind.STAND:
            return f"a stand of {lasted_s:.0f} s at {place_text(one.s_m)}"
        case _:
            return one.text
