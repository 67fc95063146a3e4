"""How restless the advice was that a recording shows: the run's measures, found again from what the cab showed."""

from __future__ import annotations

from typing import Final

from das.bus import topics
from das.bus.recording import Recording
from sim.drive.stability import Restlessness, ShownWatch
from sim.drivers.messages import recorded_view
from sim.drivers.presentations.presenter import Shown

A_SECOND_NS: Final = 1_000_000_000


def recorded_restlessness(recording: Recording) -> Restlessness:
    """The measures of a recorded run, by its messages `cab` and, for whether the train moved, `truth`.

    Without those messages nothing was shown. In a recording without the shown speed, the advised one is rounded. Of the
    looks of an external driver, one a second counts, as of every other driver.
    """
    truth = recording.columns(topics.TRUTH, "time_ns", "speed_mps")
    speeds_mps = dict(zip(truth["time_ns"].tolist(), truth["speed_mps"].tolist(), strict=True))
    watch, messages = ShownWatch(), [entry.message for entry in recording.of(topics.CAB)]
    for cab in (one for one in messages if not one.look or one.time_ns in speeds_mps):
        since_s = (cab.time_ns - messages[0].time_ns) / A_SECOND_NS
        view = recorded_view(cab)
        watch.look(since_s, speeds_mps.get(cab.time_ns, 0.0), None if view is None else Shown.of(view))
    return watch.found
