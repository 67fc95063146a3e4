"""A journey file from a trip of a GTFS feed: its stops placed on a route, its times as windows."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import typer

from das.domain.earth import distances_m
from das.domain.errors import DasError
from das.domain.files.writing import toml_string
from das.domain.route import Route, Stop
from das.domain.units import KM
from das.offline.asked_journey import LEAST_SPACING_M, TOLERANCE_S, file_clock
from precompute.gtfs import FeedTrip, TripStop, check_ends, key_of, tidy
from precompute.polylines import Projection, along_m, projected_in_order

LONGEST_S = 3600.0
"""Longest dwell and tolerance (s) that are accepted."""


@dataclass(frozen=True, kw_only=True)
class TimesRead:
    """The options for turning the times of a feed into windows. Raises DasError for an impossible time.

    The train may be `rounded_s` later than the timetable. None: by `ROUNDED_S`, except at the last stop, if all times
    are whole minutes, else by 0.
    """

    dwell_s: Annotated[
        float,
        typer.Option("--dwell", metavar="S", help="Least dwell (s) where the feed has arrival = departure."),
    ] = 30.0
    rounded_s: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="S",
            help="Delay (s) against the feed that is allowed [default: 59 at departures if all times are "
            "whole minutes, else 0].",
        ),
    ] = None

    def __post_init__(self) -> None:
        for option, value_s in (("--dwell", self.dwell_s), ("--tolerance", self.rounded_s)):
            if value_s is not None and not 0 <= value_s <= LONGEST_S:
                raise DasError(f"{option} {value_s:g}: expected seconds from 0 to {LONGEST_S:g}")


NEAR_M = 500.0
"""Largest distance (m) of a stop of the feed from its stop or point of the route."""
FAR_M = 5000.0
"""Largest distance (m) of a stop of the route with the same name; beyond it, it is a different stop."""
OFF_SHAPE_M = 1000.0
"""Largest distance (m) of a stop from a shape that counts as the path of the train."""
ROUNDED_S = 59.0
"""Delay (s) allowed if times are given in whole minutes."""


class Placed(NamedTuple):
    """A stop of a trip at its position (m); `route_stop` is the name of the route's stop there, or empty."""

    stop: TripStop
    position_m: float
    route_stop: str = ""


@dataclass(frozen=True, kw_only=True)
class Placement:
    """The stops of a trip with their positions, and remarks for the user on these."""

    stops: tuple[Placed, ...]
    notes: tuple[str, ...]


def placed(trip: FeedTrip, route: Route | None) -> Placement:
    """The positions of a trip's stops: those of the route's stops, or on its geometry, or else along the feed's shape.

    Raises DasError for a stop in the middle that is not on the route, for stops against its direction, and for an end
    without a time.
    """
    found = _along_feed(trip) if route is None else _on_route(trip, route)
    check_ends(trip.feed, trip.id, [one.stop for one in found.stops])
    for before, after in zip(found.stops, found.stops[1:], strict=False):
        if after.position_m < before.position_m + LEAST_SPACING_M:
            raise DasError(
                f"{trip.feed}: {after.stop.name} (km {after.position_m / KM:.3f}) does not come after "
                f"{before.stop.name} (km {before.position_m / KM:.3f})"
            )
    return found


def _along_feed(trip: FeedTrip) -> Placement:
    """Positions along the trip's shape or, without one that fits, along straight lines between the stops."""
    places = np.array([(stop.latitude_deg, stop.longitude_deg) for stop in trip.stops])
    nowhere = np.flatnonzero(np.isnan(places).any(axis=1))
    if len(nowhere):
        name = trip.stops[nowhere[0]].name
        raise DasError(f"{trip.feed}: {name} has no coordinates in stops.txt: expected coordinates, or --route")
    shape = along_m(*trip.shape_deg.T), *trip.shape_deg.T
    found = projected_in_order(shape, places, OFF_SHAPE_M) if len(trip.shape_deg) else None
    if found is not None and found.off_m.max() <= OFF_SHAPE_M and (np.diff(found.position_m) > 0).all():
        position_m = found.position_m - found.position_m[0]
        how = f"along the feed's shape, at most {found.off_m.max():.0f} m from it"
    else:
        position_m = along_m(*places.T)
        how = "along straight lines between the stops, because the feed has no shape that fits: the line is longer"
    stops = tuple(Placed(stop, round(float(x), 1)) for stop, x in zip(trip.stops, position_m, strict=True))
    return Placement(stops=stops, notes=(f"positions are distances from the first stop {how}",))


def _on_route(trip: FeedTrip, route: Route) -> Placement:
    """Positions on a route: by the name of a stop, by the place of a stop, or by the route's geometry."""
    places = np.array([(stop.latitude_deg, stop.longitude_deg) for stop in trip.stops])
    on_line: Projection | None = None
    if len(route.geometry_position_m):
        line = route.geometry_position_m, route.geometry_latitude_deg, route.geometry_longitude_deg
        on_line = projected_in_order(line, places, OFF_SHAPE_M)
    found: list[Placed | None] = []
    reached_m = -math.inf
    for i, stop in enumerate(trip.stops):
        fits = _route_stop(stop, route, reached_m)
        if fits is not None:
            found.append(Placed(stop, fits.position_m, fits.name))
        elif on_line is not None and on_line.off_m[i] <= NEAR_M:
            found.append(Placed(stop, round(float(on_line.position_m[i]), 1)))
        else:
            found.append(None)
        if found[-1] is not None:
            reached_m = found[-1].position_m + LEAST_SPACING_M
    on_it = [i for i, one in enumerate(found) if one is not None]
    if len(on_it) < 2:
        raise DasError(_why_not(trip, route))
    missing = [trip.stops[i].name for i in range(on_it[0], on_it[-1]) if found[i] is None]
    if missing:
        raise DasError(f"{trip.feed}: {missing[0]} is neither a stop of {route.source} nor within {NEAR_M:g} m of it")
    beyond = [stop.name for stop, one in zip(trip.stops, found, strict=True) if one is None]
    named = sum(bool(one.route_stop) for one in found if one is not None)
    others = "" if named == len(on_it) else "; the others are placed on its geometry"
    notes = [f"{named} of {len(on_it)} stops are stops of the route {route.id}{others}"]
    notes += [f"left out, because they are beyond the route: {', '.join(beyond)}"] if beyond else []
    return Placement(stops=tuple(one for one in found if one is not None), notes=tuple(notes))


def _why_not(trip: FeedTrip, route: Route) -> str:
    backwards = route.reversed()
    places = [_route_stop(stop, backwards, -math.inf) for stop in trip.stops]
    positions = [place.position_m for place in places if place is not None]
    if len(positions) > 1 and positions == sorted(positions):
        return f"{trip.feed}: trip {trip.id} runs from the end of {route.source} to its start: give --reverse"
    names = ", ".join(stop.name for stop in route.stops)
    return f"{trip.feed}: fewer than two stops of trip {trip.id} are on {route.source}, which has {names}"


def _route_stop(stop: TripStop, route: Route, from_m: float) -> Stop | None:
    """The stop of the route, from a position on, that matches a stop of the feed: by name, else by place."""
    ahead = [one for one in route.stops if one.position_m >= from_m]
    away_m = {one.name: _away_m(stop, one, route) for one in ahead}
    alike = {one.name: _likeness(stop.name, one.name) for one in ahead if not away_m[one.name] > FAR_M}
    most = max(alike.values(), default=0.0)
    same = [one for one in ahead if most > 0 and alike.get(one.name) == most]
    near = [one for one in ahead if away_m[one.name] <= NEAR_M]
    closest = min(near, key=lambda one: away_m[one.name], default=None)
    return same[0] if len(same) == 1 or most == 1.0 else closest


def _likeness(name: str, other: str) -> float:
    """The similarity of two names, from 0 to 1 (the same words); 0 unless one has all words of the other.

    "South San Francisco Station" is more similar to the stop "South San Francisco" than to "San Francisco".
    """
    words, others = set(key_of(name).split()), set(key_of(other).split())
    common = words & others
    return len(common) / len(words | others) if common and common in (words, others) else 0.0


def _away_m(stop: TripStop, other: Stop, route: Route) -> float:
    """Distance (m) from a stop of the feed to a stop of the route; NaN if one of them has no coordinates."""
    latitude, longitude = other.latitude_deg, other.longitude_deg
    if latitude is None or longitude is None:
        place = route.location_deg(other.position_m)
        if place is None:
            return math.nan
        latitude, longitude = float(place[0]), float(place[1])
    return float(distances_m(stop.latitude_deg, stop.longitude_deg, latitude, longitude))


def journey_text(trip: FeedTrip, placement: Placement, times: TimesRead, route: Route | None, command: str) -> str:
    """The journey as a TOML file."""
    return "\n".join(_file(trip, placement, times, route, command)) + "\n"


def notes(trip: FeedTrip, placement: Placement, times: TimesRead, route: Route | None) -> list[str]:
    """Choices and assumptions, one sentence each: for the file and for the user."""
    inner = [one.stop for one in placement.stops[1:-1] if one.stop.serves]
    without = sum(stop.arrival_s == stop.departure_s for stop in inner)
    found = [*trip.notes, *placement.notes]
    if without:
        found.append(
            f"{without} of {len(inner)} stops on the way have arrival = departure: assumed dwell {times.dwell_s:g} s"
        )
    rounded_s = _rounded_s(trip.stops, times)
    minutes = "all times are whole minutes: " if times.rounded_s is None and rounded_s else ""
    may_leave = f"may leave up to {rounded_s:g} s after each departure"
    late = may_leave if rounded_s else "leaves at each departure, no later"
    found.append(f"{minutes}the train {late} (--tolerance)")
    if any(not one.stop.serves for one in placement.stops):
        found.append("a stop without boarding becomes a passing, with its time as a wish")
    if route is not None and trip.time_zone not in ("", route.time_zone):
        found.append(
            f"the times are those of {trip.time_zone}, but the time zone of {route.name} is {route.time_zone}: "
            f'write time_zone = "{trip.time_zone}" into the [route] of its file'
        )
    return found


def _file(trip: FeedTrip, placement: Placement, times: TimesRead, route: Route | None, command: str) -> Iterator[str]:
    stops = placement.stops
    first, last = stops[0].stop, stops[-1].stop
    yield f"# Made by: {tidy(command)}"
    for note in notes(trip, placement, times, route):
        yield from (f"# {tidy(line)}" for line in textwrap.wrap(f"{note}.", 110))
    yield "# Times count from midnight of the service day (24:10:00 is ten past midnight)."
    yield "# Keys: docs/reference/file-formats.md. departure: not before; departure_latest and arrival: not after."
    yield "schema_version = 1"
    yield ""
    yield "[journey]"
    yield f"id = {_quoted(trip.id[:80] or 'trip')}"
    line = f"{trip.title}: " if trip.title else ""
    minute = file_clock(first.departure_s).rpartition(":")[0]
    yield f"name = {_quoted(f'{line}{first.name} – {last.name}, {minute}')}"
    of = f", {trip.agency}" if trip.agency else ""
    zone = f"; times of {trip.time_zone}" if trip.time_zone else ""
    yield f"source = {_quoted(f'GTFS feed {trip.feed.name}, trip {trip.id}{of}{zone}; the licence of the feed holds')}"
    if route is not None:
        yield f"route = {_quoted(route.id)}"
    rounded_s = _rounded_s(trip.stops, times)
    for i, one in enumerate(stops):
        yield ""
        yield from _point(one, times, rounded_s, first=i == 0, last=i == len(stops) - 1)


def _point(one: Placed, times: TimesRead, rounded_s: float, *, first: bool, last: bool) -> Iterator[str]:
    """The lines of a stop, or of a passing at a stop without boarding."""
    stop = one.stop
    passes = not (stop.serves or first or last)
    yield "[[passings]]" if passes else "[[stops]]"
    if one.route_stop:
        yield f"stop = {_quoted(one.route_stop)}"
    else:
        yield f"name = {_quoted(stop.name)}"
        yield f"position_km = {one.position_m / KM:.4f}"
    timed = not math.isnan(stop.departure_s)
    if passes:
        if timed:
            yield from (f'time = "{file_clock(stop.departure_s)}"', "wish = true", f"tolerance_s = {TOLERANCE_S}")
        return
    stands_s = stop.departure_s - stop.arrival_s if timed else 0.0
    if last:
        yield f'arrival = "{file_clock(stop.arrival_s + (times.rounded_s or 0.0))}"'
        return
    if stands_s > 0 and not first:
        yield f'arrival = "{file_clock(stop.arrival_s + rounded_s)}"'
    if timed:
        yield f'departure = "{file_clock(stop.departure_s)}"'
        yield f'departure_latest = "{file_clock(stop.departure_s + rounded_s)}"'
    if not first:
        yield f"dwell_s = {min(times.dwell_s, stands_s) if stands_s > 0 else times.dwell_s:g}"


def _rounded_s(stops: Sequence[TripStop], times: TimesRead) -> float:
    if times.rounded_s is not None:
        return times.rounded_s
    said = [time_s for stop in stops for time_s in (stop.arrival_s, stop.departure_s) if not math.isnan(time_s)]
    return ROUNDED_S if all(time_s % 60 == 0 for time_s in said) else 0.0


def _quoted(text: str) -> str:
    return toml_string(tidy(text))
