"""A cleaned trip as CSV, which reads back as the same trip."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from das.domain.files.writing import write_whole
from das.domain.units import MS, NS
from sim.trips.trip import Trip

COLUMNS = ("time_ms", "position_m", "speed_mps", "speed_from_positions", "latitude_deg", "longitude_deg")
_NS_PER_MS = round(MS / NS)


def write_cleaned(path: Path, trip: Trip) -> None:
    """Write the points that are left, with positions as in the route's file, to 1 µm.

    Points a recording calls invalid are left out. DasError where the file cannot be written.
    """
    matched = trip.matched
    s_m = trip.route.length_m - matched.s_m if trip.reversed else matched.s_m
    lines = [",".join(COLUMNS)]
    for i in np.flatnonzero(~matched.invalid):
        cells = (
            _milliseconds(int(matched.time_ns[i])),
            f"{round(s_m[i], 6) + 0.0:.6f}",
            f"{matched.speed_mps[i]:.6f}",
            f"{matched.dropout[i]:d}",
            _degrees(matched.latitude_deg[i]),
            _degrees(matched.longitude_deg[i]),
        )
        lines.append(",".join(cells))
    write_whole(path, ("\n".join(lines) + "\n").encode())


def _milliseconds(time_ns: int) -> str:
    """A time (ns) in ms: whole milliseconds and, if there is one, their fraction digit by digit."""
    whole, rest = divmod(time_ns, _NS_PER_MS)
    return f"{whole}.{rest:06d}".rstrip("0") if rest else f"{whole}"


def _degrees(angle: float) -> str:
    return "" if np.isnan(angle) else repr(float(angle))
