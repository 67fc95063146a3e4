"""The timelines of the viewer: the clock of the drive, the time of day, and the position on the route."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun as rr

from sim.recording.clock import DriveClock
from sim.recording.course import DrivenCourse, Times

DRIVE_CLOCK, TIME_OF_DAY, POSITION = "drive_clock", "time_of_day", "position_m"
"""Names of the timelines: time on the drive's clock, time of day (UTC), position on the route (m)."""


@dataclass(frozen=True, kw_only=True)
class Timelines:
    """Puts messages on all timelines. The drive's clock is that of all tables and pictures."""

    trip: DrivenCourse
    clock: DriveClock

    def of(self, time_ns: Times) -> list[rr.TimeColumn]:
        """Columns of all timelines for moments (ns since 1970); what was before the first position counts as at it.

        The viewer therefore opens at the first position of the trip.
        """
        at_ns = np.maximum(time_ns, self.trip.time_ns[0])
        position_m = np.maximum(np.rint(self.trip.at(at_ns, self.trip.s_m)), 0.0)
        return [
            rr.TimeColumn(DRIVE_CLOCK, duration=(at_ns - self.clock.zero_ns).astype("timedelta64[ns]")),
            rr.TimeColumn(TIME_OF_DAY, timestamp=at_ns.astype("datetime64[ns]")),
            rr.TimeColumn(POSITION, sequence=position_m.astype(np.int64)),
        ]
