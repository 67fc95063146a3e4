"""What a simulated driver decided, where the recording has it: nothing has to be inferred from the controller then."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from das.advice.modes import Mode, mode_name
from das.bus import topics
from das.bus.recording import Recording
from das.domain.units import NS, PERCENT
from sim.drive.events.event import DriveEvent, EventKind
from sim.drivers.diary import KINDS
from sim.recording.course import DrivenCourse

DECIDED = {"followed": True, "refused": False}


def decision_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """Advice that the driver followed or refused, with his reaction time, and lapses of his attention.

    Nothing where no decisions were recorded: of a real drive, or with a driver who keeps no diary.
    """
    told = [(KINDS[one.message.kind - 1], one.message) for one in recording.of(topics.DECISION)]
    kept = [one for one in told if one[0] != "expected"]
    for (kind, one), (after, reaction) in pairwise([*kept, ("", None)]):
        s_m = float(trip.at(np.array([one.time_ns]), trip.s_m)[0])
        if kind in DECIDED:
            follows = DECIDED[kind]
            advice = mode_name(Mode(int(one.value)))
            text, facts = f"advice '{advice}' is not followed", {"mode": advice, "followed": follows}
            if not follows:
                text += _controller(recording, int(one.time_ns))
            if after == "reaction":  # A decision is noted with the reaction that begins with it.
                facts |= {"reaction_s": reaction.value}
                text = f"{advice} is followed after a reaction of {reaction.value:.1f} s" if follows else text
            yield DriveEvent(time_ns=one.time_ns, kind=EventKind.DRIVER, text=text, s_m=s_m, facts=facts)
        elif kind == "lapse":
            yield DriveEvent(
                time_ns=one.time_ns, end_ns=one.time_ns + round(one.value / NS), kind=EventKind.DRIVER, s_m=s_m,
                text=f"attention is away for {one.value:.0f} s, unless the train warns", facts={"away_s": one.value},
            )  # fmt: skip


def _controller(recording: Recording, time_ns: int) -> str:
    """What the controller was set to at a moment, in words; nothing where that was not recorded."""
    cab = recording.columns(topics.CAB, "time_ns", "lever_ratio")
    at = int(np.searchsorted(cab["time_ns"], time_ns, side="right")) - 1
    if at < 0 or not np.isfinite(cab["lever_ratio"][at]):
        return ""
    share = round(float(cab["lever_ratio"][at]) / PERCENT)
    return f"; the controller {f'stays at {share:+d} %' if share else 'stays at 0'}"
