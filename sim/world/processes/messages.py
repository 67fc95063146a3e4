"""Messages that replay and closed loop record beside what the on-board system is told."""

from __future__ import annotations

from typing import Any

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log


def location(time_ns: int, latitude_deg: float, longitude_deg: float) -> LocationFix:
    """A place of the train on the map."""
    fix = LocationFix(latitude=latitude_deg, longitude=longitude_deg, frame_id="train")
    fix.timestamp.FromNanoseconds(time_ns)
    return fix


def happened(time_ns: int, text: str, level: Any = Log.INFO) -> Log:
    """Something for people to read."""
    log = Log(level=level, message=text, name="das-sim")
    log.timestamp.FromNanoseconds(time_ns)
    return log
