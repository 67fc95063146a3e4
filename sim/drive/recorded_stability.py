"""How restless the advice was that a recording shows: the run's measures, found again from what the cab showed."""

from __future__ import annotations

import math
from typing import Any, Final

from das.bus import topics
from das.bus.recording import Recording
from sim.drive.stability import Restlessness, ShownWatch
from sim.drivers.cab import AdviceView
from sim.drivers.messages import SHOWN
from sim.drivers.shown import Shown

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
        watch.look(since_s, speeds_mps.get(cab.time_ns, 0.0), _shown(cab))
    return watch.found


def _shown(cab: Any) -> Shown | None:
    """What a message says that the driver read; None for nothing, or for a presentation that is not known."""
    presentation = SHOWN.get(cab.presentation)
    if presentation is None:
        return None
    view = AdviceView(
        time_s=0.0,
        valid_until_s=math.inf,
        presentation=presentation,
        mode=cab.mode,
        speed_mps=cab.advised_speed_mps,
        # 0 in a recording that is older than the field, and than the stop in the same message.
        display_speed_mps=cab.display_speed_mps if cab.display_speed_mps or cab.stop_m else math.nan,
        lever_ratio=cab.advised_lever_ratio,
        deviation_s=cab.deviation_s,
    )
    return Shown.of(view)
