"""What a simulated driver decided, where the recording has it: nothing has to be inferred from the controller then."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from das.advice.modes import Mode, mode_name
from das.bus import topics
from das.bus.das_pb2 import Decision
from das.bus.recording import Recording
from das.domain.units import NS
from sim.events.event import DriveEvent, EventKind
from sim.review.series import DrivenCourse

DECIDED = {Decision.KIND_FOLLOWED: True, Decision.KIND_REFUSED: False}


def decision_events(recording: Recording, trip: DrivenCourse) -> Iterator[DriveEvent]:
    """Advice that the driver followed or refused, with his reaction time, and lapses of his attention.

    Nothing where no decisions were recorded: of a real drive, or with a driver who keeps no diary.
    """
    kept = [one.message for one in recording.of(topics.DECISION)]
    for one, after in pairwise([*kept, Decision()]):
        s_m = float(trip.at(np.array([one.time_ns]), trip.s_m)[0])
        if one.kind in DECIDED:
            follows = DECIDED[one.kind]
            advice = mode_name(Mode(int(one.value)))
            text, facts = f"{advice} is refused", {"mode": advice, "followed": follows}
            if after.kind == Decision.KIND_REACTION:  # A decision is noted with the reaction that begins with it.
                facts |= {"reaction_s": after.value}
                text = f"{advice} is followed after a reaction of {after.value:.1f} s" if follows else text
            yield DriveEvent(time_ns=one.time_ns, kind=EventKind.DRIVER, text=text, s_m=s_m, facts=facts)
        elif one.kind == Decision.KIND_LAPSE:
            yield DriveEvent(
                time_ns=one.time_ns, end_ns=one.time_ns + round(one.value / NS), kind=EventKind.DRIVER, s_m=s_m,
                text=f"attention is away for {one.value:.0f} s, unless the train warns", facts={"away_s": one.value},
            )  # fmt: skip
