"""The recorded trip of `das-sim example` and its kilometre posts.

`python -m tests.support.example_trip` rewrites both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import numpy as np

from das.domain.earth import MEAN_RADIUS_M
from das.domain.files.load import load_route, load_vehicle
from das.domain.route import Floats, Route
from das.domain.units import KM, KMH
from das.domain.vehicle import Vehicle
from sim.drivers.cab import Driver
from sim.drivers.drivers import make_driver
from sim.drivers.kinds import DriverKind
from sim.drivers.knowledge import LineKnowledge
from sim.plant.kernels import PlantState
from sim.plant.plant import Plant
from tests.support.made_map import EXAMPLE
from tests.support.ride import Leg, Ride, ride

SEED: Final = 1
"""Seed of the committed trip."""
POSTS_EVERY_M: Final = 100.0
"""Distance (m) between kilometre posts; straight lines between them deviate from the curves by only some metres."""
DEPARTURE: Final = datetime(2026, 11, 21, 8, 31, 0, tzinfo=UTC)
"""Departure of the train of the recorded trip."""


@dataclass(frozen=True, kw_only=True)
class Receiver:
    """A GPS receiver and its recording of a trip; the errors are assumptions for a good receiver."""

    position_sd_m: float = 3.0
    """Standard deviation (m) of the position, each to the north and to the east."""
    correlation_s: float = 20.0
    """Correlation time (s) of the position error."""
    speed_sd_mps: float = 0.08
    """Standard deviation (m/s) of the reported speed of a moving train."""
    standing_s: int = 20
    """Seconds of standing that are recorded before the departure and after the arrival."""


def trip_files(seed: int = SEED) -> dict[str, bytes]:
    """The recorded trip, drawn from a seed, and the kilometre posts, by the names of their files."""
    route = load_route(EXAMPLE / "route.toml").reversed()
    driven = _driven(route, load_vehicle(EXAMPLE / "vehicle.toml"), seed)
    return {"posts.csv": _posts(route), "trip.csv": _record(route, driven, seed)}


def _driven(route: Route, vehicle: Vehicle, seed: int) -> tuple[PlantState, ...]:
    """A human driver's trip without advice; the timetable allows a tenth more time than a hurrying driver needs."""
    line, plant = LineKnowledge(route=route, vehicle=vehicle), Plant(route, vehicle)
    start_m, stop_m = route.stops[0].position_m, route.stops[-1].position_m

    def driven(driver: Driver, arrival_s: float) -> Ride:
        return ride(plant, driver, line, Leg(start_m=start_m, stop_m=stop_m, departure_s=0.0, arrival_s=arrival_s))

    fastest_s = driven(make_driver(DriverKind.FAST, line), 0.0).arrival_s
    return driven(make_driver(DriverKind.HUMAN, line, seed=seed), 1.1 * fastest_s).states


def _record(route: Route, states: tuple[PlantState, ...], seed: int) -> bytes:
    """The trip as a receiver records it, one row a second."""
    receiver, random = Receiver(), np.random.default_rng([seed, 1])
    time_s = np.arange(-receiver.standing_s, math.ceil(states[-1].time_s) + receiver.standing_s + 1.0)
    at_s = np.array([state.time_s for state in states])
    s_m = np.interp(time_s, at_s, [state.s_m for state in states])
    speed = np.interp(time_s, at_s, [state.speed_mps for state in states])
    noisy = np.maximum(speed + receiver.speed_sd_mps * random.standard_normal(len(speed)), 0.0)
    speed_mps = np.where(speed > 0, noisy, 0.0)
    place = np.array([route.location_deg(float(at)) for at in s_m])
    latitude, longitude = place[:, 0], place[:, 1]
    north_m, east_m = (_wandering(receiver, speed > 0, random) for _ in range(2))
    latitude = latitude + np.degrees(north_m / MEAN_RADIUS_M)
    longitude = longitude + np.degrees(east_m / (MEAN_RADIUS_M * np.cos(np.radians(latitude))))
    rows = ["time,latitude,longitude,speed_kmh"]
    for t, north, east, v in zip(time_s, latitude, longitude, speed_mps, strict=True):
        moment = datetime.fromtimestamp(DEPARTURE.timestamp() + t, UTC)
        rows.append(f"{moment:%Y-%m-%dT%H:%M:%SZ},{north:.6f},{east:.6f},{v / KMH:.1f}")
    return _lines(rows)


def _wandering(receiver: Receiver, moving: np.ndarray, random: np.random.Generator) -> Floats:
    """The error (m) of a coordinate, one value a second; it does not change while the train stands."""
    keep = math.exp(-1.0 / receiver.correlation_s)
    fresh = receiver.position_sd_m * random.standard_normal(len(moving))
    error = np.empty(len(moving))
    last = fresh[0]
    for i, moves in enumerate(moving):
        last = keep * last + math.sqrt(1.0 - keep**2) * fresh[i] if moves else last
        error[i] = last
    return error


def _posts(route: Route) -> bytes:
    """Kilometre posts in the order in which the trip passes them; `route` is as driven, so their kilometres fall."""
    rows = ["latitude,longitude,kilometre"]
    for s_m in np.arange(0.0, route.length_m + 1.0, POSTS_EVERY_M):
        place = route.location_deg(float(s_m))
        assert place is not None
        rows.append(f"{place[0]:.6f},{place[1]:.6f},{(route.length_m - s_m) / KM:.1f}")
    return _lines(rows)


def _lines(rows: list[str]) -> bytes:
    return ("\n".join(rows) + "\n").encode()


if __name__ == "__main__":
    for name, content in trip_files().items():
        (EXAMPLE / name).write_bytes(content)
