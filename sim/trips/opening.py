"""Opening a trip: its file read and matched to the line, with what its recording brings along; and its section."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from das.bus.recording import Recording
from das.command_line.loading import load_route, load_vehicle
from das.domain.errors import DasError
from das.domain.files import load
from das.domain.files.loss_map_csv import read_loss_map
from das.domain.route import Route
from das.solver.section import Section, SectionOptions, build_section
from sim.recording.inputs import AttachedFiles
from sim.trips.options import TripOptions
from sim.trips.reading import Reading, RecordedJourney, read_trip, reading_of
from sim.trips.trip import Trip, Whereabouts, load_trip


def open_trip(trip_path: Path, options: TripOptions, folder: Path) -> tuple[TripOptions, Trip]:
    """Read, clean and match a trip; returns the options completed from the recording, and the trip.

    Files that a recording brings along are put into `folder`. Raises DasError for anything unusable.
    """
    reading = read_trip(trip_path, options.of_train)
    options = _completed(reading, options, folder)
    if options.route is None:
        raise DasError(f"{trip_path}: a trip without a journey needs --route")
    said = Whereabouts(
        reverse=options.reverse,
        from_stop=options.from_stop,
        to_stop=options.to_stop,
        line=options.line,
        strict=options.strict,
    )
    trip = load_trip(trip_path, reading, load_route(options.route), said)
    return replace(options, reverse=trip.reversed, line=None if trip.line_not_used else options.line), trip


def recorded_trip(recording: Recording, driven: Route) -> Trip:
    """The trip of a recording on its line as driven; DasError for positions that cannot be used."""
    reading = reading_of(recording)
    journey = RecordedJourney.of(reading)
    ends = (None, None) if journey is None else (journey.from_stop, journey.to_stop)
    return load_trip(recording.path, reading, driven, Whereabouts(reverse=False, from_stop=ends[0], to_stop=ends[1]))


def _completed(reading: Reading, options: TripOptions, folder: Path) -> TripOptions:
    """Fill route, vehicle, direction and stops from the recording's journey where they were not given."""
    journey = RecordedJourney.of(reading)
    if journey is None or reading.recording is None:
        return options
    if options.reverse is not None:
        raise DasError("--reverse: the recording says itself in which direction it drives")
    files = AttachedFiles(reading.recording, folder)
    route = options.route or files.find("routes", journey.route_id, load.load_route)[1]
    same_route = load_route(route).id == journey.route_id
    return replace(
        options,
        route=route,
        vehicle=options.vehicle or files.find("vehicles", journey.vehicle_id, load.load_vehicle)[1],
        reverse=journey.reversed,
        from_stop=options.from_stop or (journey.from_stop if same_route else None),
        to_stop=options.to_stop or (journey.to_stop if same_route else None),
    )


def trip_section(trip: Trip, options: TripOptions) -> Section:
    """The section of a trip with the chosen vehicle; raises DasError if none is chosen or it cannot run there."""
    if options.vehicle is None:
        raise DasError(f"{trip.path}: a trip without a journey needs --vehicle")
    vehicle = load_vehicle(options.vehicle)
    if options.loss_map is not None:
        vehicle = vehicle.with_loss_map(read_loss_map(options.loss_map))
    return build_section(
        trip.route,
        vehicle,
        level=options.level,
        start_m=trip.start.position_m,
        end_m=trip.end.position_m,
        options=SectionOptions(point_mass=options.point_mass),
    )
