"""Another drive of the line beside the one that is reviewed: its curves, and where the two part most."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from das.domain.errors import DasError
from das.domain.units import KM, kwh
from sim.drive.comparison import AlignedDrives, drives_on_track
from sim.drive.drive import Drive
from sim.review.series import Found, driven, filled_in, on_trip

MOST_PARTED: Final = 3
"""At most this many stretches are bookmarks."""
LEAST_KWH: Final = 0.5
"""Stretches on which the drives part by less than this (kWh) are no bookmarks."""


def series_beside(drive: Drive, other: Drive | None) -> Found:
    """Speed and energy of another drive, at the times of this drive at which the clocks of both show the same."""
    if other is None:
        return {}
    found = {**driven(other.recording, other.course), **filled_in(other).series}
    later_ns = drive.clock.zero_ns - other.clock.zero_ns
    moved = {f"{name}/other": found[f"{name}/driven"] for name in ("speed", "energy")}
    return {name: on_trip(drive.course, time_ns + later_ns, one, held=False) for name, (time_ns, one) in moved.items()}


def partings(drive: Drive, other: Drive | None) -> Iterator[tuple[int, str]]:
    """When this drive came to the stretches on which its losses differ most from those of the other one, and by how
    much; nothing if the energy of either is not known."""
    try:
        aligned = None if other is None else AlignedDrives.of(drives_on_track([other, drive]))
    except DasError:
        return
    parted = [] if aligned is None else sorted(aligned.stretches(1), key=lambda one: -abs(one.lost_j))[:MOST_PARTED]
    for one in parted:
        if abs(kwh(one.lost_j)) >= LEAST_KWH:
            reached = int(np.argmax(drive.course.s_m >= one.start_m))
            more = f"{abs(kwh(one.lost_j)):.1f} kWh {'less' if one.lost_j < 0 else 'more'} lost"
            where = f"km {one.start_m / KM:.1f}–{one.end_m / KM:.1f}"
            yield int(drive.course.time_ns[reached]), f"{where}  {more} than the other drive"
