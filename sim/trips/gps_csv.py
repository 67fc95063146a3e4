"""GPS records as CSV without a header: latitude (deg), longitude (deg), speed (km/h), epoch time (ms)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import InputError
from das.domain.route import Floats
from das.domain.units import KMH, MS, NS
from sim.trips.rows import check_column, check_location, read_rows

Ints = NDArray[np.int64]

_NAMES = ("latitude", "longitude", "speed", "time")
_LATEST_MS = 9e12
"""Later epoch times (year 2255) do not fit in integer nanoseconds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GpsTrip:
    """Points of a record in the order of time, each array of shape (points,); point i is line i + 1 of `source`."""

    source: str
    latitude_deg: Floats
    longitude_deg: Floats
    speed_mps: Floats
    time_ns: Ints

    def __post_init__(self) -> None:
        for array in (self.latitude_deg, self.longitude_deg, self.speed_mps, self.time_ns):
            array.setflags(write=False)

    def elapsed_s(self) -> Floats:
        """Time since the first point (s)."""
        return np.asarray((self.time_ns - self.time_ns[0]) * NS, dtype=np.float64)


def read_gps_trip(path: Path) -> GpsTrip:
    """Read a record; at least two points, each later than the one before.

    Raises DasError or InputError (file, line, value, expectation). Speeds that drop out are left for the matching,
    which knows where the train was.
    """
    latitude, longitude, speed_kmh, time_ms = read_rows(path, _NAMES, 2, "trip").T.copy()
    check_location(path, latitude, longitude)
    check_column(path, "speed", speed_kmh, speed_kmh < 0, "a speed >= 0 km/h")
    check_column(path, "time", time_ms, (time_ms < 0) | (time_ms > _LATEST_MS), "an epoch time in ms")
    time_ns = _to_ns(time_ms)
    back = np.flatnonzero(np.diff(time_ns) <= 0)
    if len(back):
        i = int(back[0]) + 1
        raise InputError(path, f"line {i + 1} time", f"{time_ms[i]:.0f} ms", f"later than {time_ms[i - 1]:.0f} ms")
    return GpsTrip(
        source=str(path),
        latitude_deg=latitude,
        longitude_deg=longitude,
        speed_mps=speed_kmh * KMH,
        time_ns=time_ns,
    )


def _to_ns(time_ms: Floats) -> Ints:
    """Whole milliseconds apart from their fraction: an epoch time in ns has more digits than a double."""
    whole = np.floor(time_ms)
    per_ms = round(MS / NS)
    return whole.astype(np.int64) * per_ms + np.rint((time_ms - whole) * per_ms).astype(np.int64)
