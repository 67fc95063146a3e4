"""A small GTFS feed like published ones: quoted, with a byte order mark, in a folder of the zip, with platforms."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from das.domain.route import Route, Stop
from precompute.gtfs import WEEKDAYS
from tests.support.made_line import north
from tests.support.making import make_route

Rows = Sequence[Sequence[object]]
PLACES_M = (0.0, 4_000.0, 9_000.0, 15_000.0)
NAMES = ("Altdorf", "Bad Über", "Neu Altdorf", "Zell")
OFF_M = 100.0
"""Distance (m) of platforms east of the line, as in real feeds."""
ODD = 'odd "x"/ü #7'


def feed_route(*, geometry: bool = False, names: Sequence[str] = NAMES) -> Route:
    """The line of the feed, which runs north."""
    stops = tuple(Stop(name=name, position_m=at_m) for name, at_m in zip(names, PLACES_M, strict=True))
    route = replace(make_route(PLACES_M[-1], [(0.0, 30.0)]), stops=stops)
    if not geometry:
        return route
    at_m = np.linspace(0.0, PLACES_M[-1], 301)
    latitude, longitude = north(at_m)
    return replace(route, geometry_position_m=at_m, geometry_latitude_deg=latitude, geometry_longitude_deg=longitude)


def clock(time_s: float) -> str:
    whole = round(time_s)
    return f"{whole // 3600}:{whole // 60 % 60:02}:{whole % 60:02}"


def feed_tables() -> dict[str, Rows]:
    """The tables of the feed, each with its header.

    Trip 101 runs north at 4:28 and dwells at its third stop, 102 south, 103 at intervals, and ODD over midnight.
    """
    latitude, longitude = north(np.array(PLACES_M), OFF_M)
    line = north(np.linspace(0.0, PLACES_M[-1], 151))
    stops: list[list[object]] = [["stop_id", "stop_name", "stop_lat", "stop_lon", "location_type", "parent_station"]]
    for i, name in enumerate(NAMES):
        stops.append([f"s{i}", f"{name} Station", f"{latitude[i]:.6f}", f"{longitude[i]:.6f}", "1", ""])
        stops.append([f"p{i}", f"{name} platform 1", f"{latitude[i]:.6f}", f"{longitude[i]:.6f}", "", f"s{i}"])
    times: list[list[object]] = [
        ["trip_id", "arrival_time", "departure_time", "stop_id", "stop_sequence", "pickup_type", "drop_off_type"]
    ]
    for trip, start_s, order in (("101", 16_080, 1), ("102", 16_080, -1), ("103", 18_000, 1), (ODD, 85_800, 1)):
        for k, i in enumerate(range(4)[::order]):
            arrival_s = start_s + 360 * k
            departure_s = arrival_s + (60 if (trip, i) == ("101", 2) else 0)
            passes = 1 if (trip, i) == (ODD, 2) else 0
            times.append([trip, clock(arrival_s), clock(departure_s), f"p{i}", 10 * k + 5, passes, passes])
    times[1:] = times[:0:-1]
    shape = [["sh", f"{a:.6f}", f"{b:.6f}", 7 * i] for i, (a, b) in enumerate(zip(*line, strict=True))]
    trips = [("101", "sh"), ("102", ""), ("103", "sh"), (ODD, "")]
    return {
        "agency": [["agency_id", "agency_name", "agency_timezone"], ["A", "Made Railway", "Europe/Zurich"]],
        "stops": stops,
        "stop_times": times,
        "trips": [
            ["route_id", "service_id", "trip_id", "trip_headsign", "trip_short_name", "shape_id"],
            *(["R", "week", trip, "Zell", f"n{trip[:3]}", shape_id] for trip, shape_id in trips),
        ],
        "routes": [["route_id", "agency_id", "route_short_name", "route_type"], ["R", "A", "S1", "2"]],
        "shapes": [["shape_id", "shape_pt_lat", "shape_pt_lon", "shape_pt_sequence"], *shape],
        "calendar": [
            ["service_id", *WEEKDAYS, "start_date", "end_date"],
            ["week", 1, 1, 1, 1, 1, 0, 0, "20260101", "20261231"],
        ],
        "calendar_dates": [
            ["service_id", "date", "exception_type"],
            ["week", "20261126", "2"],
            ["week", "20261128", "1"],
        ],
        "frequencies": [["trip_id", "start_time", "end_time", "headway_secs"], ["103", "5:00:00", "9:00:00", "1200"]],
    }


def table_text(rows: Rows) -> str:
    """A table as in published feeds: every cell quoted, with a byte order mark and CRLF."""
    text = io.StringIO()
    csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\r\n").writerows(rows)
    return "\ufeff" + text.getvalue()


def write_feed(
    path: Path, changed: Mapping[str, Rows | str | bytes | None] | None = None, folder: str = "made/"
) -> Path:
    """Write the feed; `changed` replaces tables by name (a text is written unchanged; None removes the table)."""
    tables: dict[str, Rows | str | bytes | None] = {**feed_tables(), **(changed or {})}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, rows in tables.items():
            if rows is not None:
                archive.writestr(f"{folder}{name}.txt", rows if isinstance(rows, str | bytes) else table_text(rows))
    return path
