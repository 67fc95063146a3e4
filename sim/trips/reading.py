"""Reading a trip's file: a GPS record as CSV or GPX, or a recording of das-sim."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from das.bus.recording import Recording
from das.bus.scanning import MAGIC
from das.bus.topics import DELAY, JOURNEY, LOCATION, POSITION
from das.domain.errors import DasError, InputError
from das.domain.route import Floats
from das.estimate.fix import Quality
from sim.recording.opening import open_recording
from sim.trips.csv_record import read_csv
from sim.trips.gpx import read_gpx
from sim.trips.record import Record

_BEFORE_XML = b"\xef\xbb\xbf\xff\xfe \t\r\n"
BACKWARD_NOISE_MPS = 0.3
"""A recorded speed that is below 0 by less than this (m/s) is a sensor's noise at a standstill."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """A record, the format of its file, and what a recording of ours says besides: its journey and its delays.

    `delays` are pairs of a time (ns) and a delay (s). `recording` is None for a record of another format.
    """

    record: Record
    format: str
    journey: Any | None = None
    delays: tuple[tuple[int, float], ...] = ()
    recording: Recording | None = None


@dataclass(frozen=True, kw_only=True)
class RecordedJourney:
    """The parts of a recording's journey from which route, vehicle and stops are chosen."""

    route_id: str
    vehicle_id: str
    reversed: bool
    from_stop: str
    to_stop: str

    @classmethod
    def of(cls, reading: Reading) -> RecordedJourney | None:
        """The journey of a reading; None for a GPS record or a recording without a journey of two stops."""
        journey = reading.journey
        if journey is None or len(journey.stops) < 2:
            return None
        return cls(
            route_id=journey.route_id,
            vehicle_id=journey.vehicle_id,
            reversed=journey.reversed,
            from_stop=journey.stops[0].name,
            to_stop=journey.stops[-1].name,
        )


def read_trip(path: Path, train: str | None = None) -> Reading:
    """Read a trip's file; its format is told by how it begins (MCAP and GPX also by their suffix).

    `train` says which train of a recording that holds several. What is damaged in
    a recording is left out with a warning.
    Raises DasError or InputError (file, line, value, expectation) for anything unusable.
    """
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError as error:
        raise DasError(f"{path}: cannot be read ({error.strerror})") from error
    suffix = path.suffix.lower()
    if head.startswith(MAGIC) or suffix == ".mcap":
        return reading_of(open_recording(path, train))
    if head.lstrip(_BEFORE_XML).startswith(b"<") or suffix == ".gpx":
        return Reading(record=read_gpx(path), format="GPX")
    return Reading(record=read_csv(path), format="CSV")


def reading_of(recording: Recording) -> Reading:
    """The record of a recording: its positions are on the route as driven, its journey and delays tell the timetable.

    Raises DasError or InputError for positions that cannot be used.
    """
    path = recording.path
    data = recording.columns(POSITION, "time_ns", "s_m", "speed_mps", "quality", "uncertainty_m")
    time_ns = data["time_ns"]
    if len(time_ns) < 2:
        raise DasError(f"{path}: the recording has {len(time_ns)} positions, expected at least 2")
    invalid = data["quality"] == Quality.INVALID
    for name in ("s_m", "speed_mps"):
        _refuse(path, name, data[name], ~np.isfinite(data[name]) & ~invalid, "a finite number")
    _refuse(path, "speed_mps", data["speed_mps"], (data["speed_mps"] < -BACKWARD_NOISE_MPS) & ~invalid, "a speed >= 0")
    latitude, longitude = _locations(recording, time_ns)
    delays = recording.columns(DELAY, "time_ns", "delay_s")
    journeys = recording.of(JOURNEY)
    return Reading(
        record=Record.of(
            str(path),
            np.arange(len(time_ns)),
            time_ns,
            place="position",
            latitude_deg=latitude,
            longitude_deg=longitude,
            position_m=np.where(invalid, np.nan, data["s_m"]),
            speed_mps=np.maximum(np.where(invalid, np.nan, data["speed_mps"]), 0.0),
            uncertainty_m=data["uncertainty_m"],
            degraded=data["quality"] == Quality.DEGRADED,
            invalid=invalid,
            as_driven=True,
        ),
        format="MCAP",
        journey=journeys[0].message if journeys else None,
        delays=tuple(zip(delays["time_ns"].tolist(), delays["delay_s"].tolist(), strict=True)),
        recording=recording,
    )


def _refuse(path: Path, name: str, values: Floats, bad: Any, expected: str) -> None:
    if bad.any():
        i = int(bad.argmax())
        raise InputError(path, f"position[{i}].{name}", float(values[i]), expected)


def _locations(recording: Recording, time_ns: Any) -> tuple[Floats, Floats]:
    """Latitude and longitude at the times of the positions; NaN where the recording has none."""
    fixes = [
        (m.message.timestamp.ToNanoseconds(), m.message.latitude, m.message.longitude) for m in recording.of(LOCATION)
    ]
    if not fixes:
        return np.full(len(time_ns), np.nan), np.full(len(time_ns), np.nan)
    t, latitude, longitude = (np.array(column) for column in zip(*sorted(fixes), strict=True))
    return np.interp(time_ns, t, latitude), np.interp(time_ns, t, longitude)
