"""A trip cut into its sections: from one stop at which the train stood to the next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

from das.solver.front import Front
from das.solver.section import Section, SectionOptions, build_section
from das.solver.solve import solve_front
from sim.trips.matching import MatchedTrip, RunEnds
from sim.trips.profile import to_profile
from sim.trips.standing import Stand, stands
from sim.trips.trip import Trip


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenSection:
    """A section of a trip: its stops, all its best runs, the record of it, and how long it was driven (s)."""

    start: str
    end: str
    front: Front
    matched: MatchedTrip
    trip_s: float


def driven_sections(trip: Trip, front: Front) -> tuple[DrivenSection, ...]:
    """The sections of a trip, of which `front` has the best runs without a stop on the way.

    A trip that stood at stops on the way is compared section by section: the optimum stands there for as long.
    """
    whole = DrivenSection(
        start=trip.start.name,
        end=trip.end.name,
        front=front,
        matched=trip.matched,
        trip_s=float(trip.run.time_s[-1]),
    )
    return tuple(_cut(trip, front.section)) if trip.stops_on_the_way else (whole,)


def _cut(trip: Trip, section: Section) -> Iterator[DrivenSection]:
    names = [trip.start.name, *trip.stops_on_the_way, trip.end.name]
    last = len(trip.matched.time_ns) - 1
    kept = [Stand(0, trip.matched.ends.departure), *_on_the_way(trip), Stand(trip.matched.ends.arrival, last)]
    for (before, behind), (start, end) in zip(pairwise(kept), pairwise(names), strict=True):
        matched = _part(trip.matched, before, behind)
        place = trip.matched.s_m
        part = build_section(
            section.route,
            section.vehicle,
            level=section.level,
            start_m=section.start_m if before is kept[0] else float(place[before.last]),
            end_m=section.end_m if behind is kept[-1] else float(place[behind.first]),
            options=SectionOptions(point_mass=section.train_length_m == 0, brakes=section.brakes),
        )
        trip_s = float(to_profile(matched).time_s[-1])
        yield DrivenSection(start=start, end=end, front=solve_front(part), matched=matched, trip_s=trip_s)


def _on_the_way(trip: Trip) -> list[Stand]:
    """The stands at the stops on the way, in order."""
    time_ns = trip.matched.time_ns
    at_stops = [one for one in trip.stands if one.dwell_s is not None and one.stop in trip.stops_on_the_way]
    found = [
        next(stand for stand in stands(trip.matched.standing) if float(trip.matched.s_m[stand.last]) == one.s_m)
        for one in at_stops
    ]
    return sorted(found, key=lambda stand: int(time_ns[stand.first]))


def _part(matched: MatchedTrip, before: Stand, behind: Stand) -> MatchedTrip:
    """The record from one stand to the next, both with it."""
    points = slice(before.first, behind.last + 1)
    fields = ("time_ns", "s_m", "speed_mps", "latitude_deg", "longitude_deg", "dropout", "invalid", "uncertainty_m")
    ends = matched.ends
    return replace(
        matched,
        **{name: getattr(matched, name)[points].copy() for name in (*fields, "standing")},
        ends=RunEnds(
            departure=before.last - before.first,
            arrival=behind.first - before.first,
            starts_standing=ends.starts_standing if before.first == 0 else True,
            ends_standing=ends.ends_standing if behind.last == len(matched.time_ns) - 1 else True,
        ),
    )
