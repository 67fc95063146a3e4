"""Bridge from a driving simulator to the bus: it publishes the train's position and journey, and the node's clock."""

import json
import socket
from collections.abc import Iterator
from datetime import datetime

from das.bus import das_pb2
from das.bus.session import Bus
from das.bus.topics import CONTROL, JOURNEY, POSITION
from das.domain.files.load import load_route

TRAIN, ROUTE, VEHICLE = "IC1", "flat-6km", "re460-ic"
HERE, NODE, FRAMES = "tcp/127.0.0.1:7448", "tcp/127.0.0.1:7447", ("127.0.0.1", 5005)
S, DAY_S, POSITION_EVERY_S, ADVICE_EVERY_S = 10**9, 86_400, 0.2, 1.0

Station = tuple[str, float, float | None, float | None]
"""Name, position (m), and times of arrival and departure (s since midnight on the simulator's clock), None for none."""
Frame = tuple[float, float, float, list[Station]]
"""Simulator's clock (s since midnight), position of the front along the route (m), speed (m/s), and stations."""


def frames() -> Iterator[Frame]:
    """The simulator's frames, at any rate. Replace this function; it receives them as JSON arrays over UDP."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as door:
        door.bind(FRAMES)
        while True:
            yield json.loads(door.recv(65_536))


def journey(stations: list[Station], now_ns: int, zero_ns: int) -> das_pb2.Journey:
    """The journey of the stations as of now; midnight is at `zero_ns` (all in ns since 1970)."""
    stops = [das_pb2.Journey.Stop(name=name, s_m=s_m) for name, s_m, _, _ in stations]
    for stop, (_, _, arrival_s, departure_s) in zip(stops, stations, strict=True):
        stop.arrival_ns = 0 if arrival_s is None else zero_ns + round(arrival_s * S)
        stop.departure_ns = 0 if departure_s is None else zero_ns + round(departure_s * S)
    return das_pb2.Journey(time_ns=now_ns, route_id=ROUTE, vehicle_id=VEHICLE, stops=stops)


today = datetime.now(load_route(ROUTE).zone).replace(hour=0, minute=0, second=0, microsecond=0)
zero_ns = int(today.timestamp()) * S
before_s, tick_s, told = -1.0, -1.0, list[Station]()
with Bus(TRAIN, listen=HERE, connect=[NODE]) as bus:
    for clock_s, s_m, v_mps, stations in frames():
        if clock_s < before_s:  # An earlier state was loaded. Time on a bus never goes back: it is the next day.
            zero_ns, tick_s, told = zero_ns + DAY_S * S, -1.0, []
        elif clock_s - before_s < POSITION_EVERY_S:  # In a pause, nothing is sent.
            continue
        before_s, now_ns = clock_s, zero_ns + round(clock_s * S)
        if stations != told:
            told = stations
            bus.publish(JOURNEY, journey(stations, now_ns, zero_ns))
        place = das_pb2.Position(time_ns=now_ns, s_m=s_m, speed_mps=v_mps, uncertainty_m=1.0, speed_uncertainty_mps=0.1)
        bus.publish(POSITION, place)
        if clock_s - tick_s >= ADVICE_EVERY_S:  # The node answers each of these with its advice.
            tick_s = clock_s
            bus.publish(CONTROL, das_pb2.Control(time_ns=now_ns))
