"""Messages that replay and closed loop send alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log

from das.bus import das_pb2
from das.domain.route import Route
from das.domain.vehicle import Vehicle


class StopTimes(NamedTuple):
    """A stop of a journey: name, position (m), arrival and departure (ns since 1970; 0: none)."""

    name: str
    s_m: float
    arrival_ns: int
    departure_ns: int


def journey(
    train: str, route: Route, vehicle: Vehicle, stops: Sequence[StopTimes], *, reversed_: bool, time_ns: int
) -> das_pb2.Journey:
    """What the train is to do."""
    return das_pb2.Journey(
        time_ns=time_ns,
        train=train,
        route_id=route.id,
        vehicle_id=vehicle.id,
        reversed=reversed_,
        stops=[das_pb2.Journey.Stop(**stop._asdict()) for stop in stops],
    )


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
