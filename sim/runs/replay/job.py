"""Preparing a replay: everything is read, checked and solved before a process starts."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from das import __version__
from das.bus.config import bus_folder
from das.bus.topics import check_train_name
from das.cab.heard import OrderedStop
from das.cab.warm_up import warm_up
from das.domain.errors import DasError
from das.domain.units import NS
from das.solver.section import Section
from das.solver.solve import solve_front
from sim.drive.above_optimum import AboveOptimum, EnergyBand, why_not_comparable
from sim.drive.attribution.driven_legs import (
    ComparedLeg,
    DrivenLeg,
    DrivenMotion,
    leg_energies,
    legs_of,
    likely_band,
    range_above,
    section_of_leg,
)
from sim.drive.calls import calls_on_the_way, kept_calls
from sim.options import ReplayOptions, TripOptions, speed_factor
from sim.recording.course import DrivenCourse
from sim.recording.inputs import DriveInputs, input_files, sha256
from sim.runs.replay.replay import ReplayJob, plan_timing
from sim.trips.estimate import EnergyRange, energy_range, estimate_run
from sim.trips.profile import DrivenRun, to_profile
from sim.trips.trip import Trip, open_trip, trip_section
from sim.world.processes import Processes

LONGEST_S = 86400.0
"""Running times and delays must be shorter than this (s): a day."""


def prepare(trip_path: Path, options: ReplayOptions, out: Path, command: str) -> ReplayJob:
    """Read trip, route and vehicle, solve the section and estimate the energy as driven.

    `command` is what the user typed; the recording keeps it. Raises DasError for anything unusable.
    """
    _check(options)
    if out.resolve() == trip_path.resolve():
        raise DasError(f"{out}: the recording to write is the trip to read")
    bus = bus_folder(options.bus, options.insecure_bus, options.train)
    folder = tempfile.TemporaryDirectory(prefix="das-replay-")
    of_trip, trip = open_trip(trip_path, options.trip, Path(folder.name))
    section = trip_section(trip, of_trip)
    warm_up()
    front = solve_front(section)
    legs = driven_legs(trip, trip.run)
    timing = plan_timing(trip, legs, options.arrival_s, options.delay_s)
    processes = Processes(
        train=options.train,
        node_arguments=_node_arguments(of_trip, trip.start.name, trip.end.name),
        out=out,
        metadata={**_metadata(trip, section, of_trip), "command": command, "train": options.train},
        start_ns=timing.first_tick_ns,
        attachments=tuple(_attachments(of_trip)),
        bus=bus,
    )
    run = trip.run
    return ReplayJob(
        processes=processes,
        trip=trip,
        front=front,
        legs=legs,
        timing=timing,
        reference=front.trajectory((timing.arrival_ns - timing.departure_ns) * NS),
        driven=estimate_run(section, run.time_s, run.s_m, run.speed_mps),
        delay_given=options.delay_s is not None,
        speed=speed_factor(options.speed),
        files_kept=folder,
    )


def driven_legs(trip: Trip, run: DrivenRun) -> tuple[DrivenLeg, ...]:
    """The legs of a trip, cut and timed as for every drive; one leg if the train does not stand at both end stops."""
    motion, matched = DrivenMotion.of_run(run), trip.matched
    course = DrivenCourse(time_ns=motion.time_ns, s_m=motion.s_m, speed_mps=motion.speed_mps)
    told = DrivenCourse(time_ns=matched.time_ns, s_m=matched.s_m, speed_mps=matched.speed_mps)
    start, end = kept_calls([OrderedStop(one.name, one.position_m) for one in (trip.start, trip.end)], course, told)
    if not trip.whole:
        return (DrivenLeg(start=start, end=end, motion=motion),)
    stood = [one for one in trip.route.stops if one.name in trip.stops_on_the_way]
    return legs_of(trip.path, motion, [start, *calls_on_the_way(stood, course, told), end])


@dataclass(frozen=True, kw_only=True, eq=False)
class TripEnergies:
    """The energy of a replayed trip beside that of the optimum with the same arrivals, leg by leg.

    `energy` is the range of the energy as driven. `above_range` is the range of the energy above the optimum, also by
    each unknown alone; it is None where trip and optimum cannot be compared.
    """

    legs: tuple[ComparedLeg, ...]
    above: AboveOptimum
    energy: EnergyRange
    above_range: EnergyRange | None


def trip_energies(job: ReplayJob) -> TripEnergies:
    """The energies of the trip of a replay."""
    trip, section = job.trip, job.front.section
    vehicle = replace(section.vehicle, train_length_m=section.train_length_m)
    inputs = DriveInputs(route=trip.route, vehicle=vehicle, level=section.level, source=str(trip.path))

    def compared(leg: DrivenLeg) -> ComparedLeg:
        front = solve_front(section_of_leg(inputs, leg)) if trip.whole else job.front
        return ComparedLeg.of(leg, front, leg_energies(front.section, leg))

    legs = tuple(compared(leg) for leg in job.legs)
    each = tuple(one.section_energy for one in legs)
    why_not = why_not_comparable(each, whole=trip.whole, direction_known=trip.direction_known)
    found = None if why_not else range_above(legs, lambda jerk: driven_legs(trip, to_profile(trip.matched, 1.0, jerk)))
    above = AboveOptimum(
        sections=each,
        measured=False,
        why_not=why_not,
        likely=None if found is None else likely_band(found.estimate_j, found.unknowns),
        worst=None if found is None else EnergyBand(found.low_j, found.high_j),
    )
    return TripEnergies(legs=legs, above=above, energy=energy_range(section, trip.matched), above_range=found)


def _check(options: ReplayOptions) -> None:
    check_train_name(options.train)
    speed_factor(options.speed)
    for name, value in (("--arrival", options.arrival_s), ("--delay", options.delay_s)):
        if value is not None and not 0 <= value < LONGEST_S:
            raise DasError(f"{name} {value:g}: expected seconds >= 0, less than a day")
    if options.arrival_s is not None and options.arrival_s <= 0:
        raise DasError(f"--arrival {options.arrival_s:g}: expected a running time > 0 s")


def _node_arguments(options: TripOptions, start: str, end: str) -> tuple[str, ...]:
    arguments = ["--route", str(options.route), "--vehicle", str(options.vehicle), "--from", start, "--to", end]
    if options.reverse:
        arguments.append("--reverse")
    if options.level is not None:
        arguments += ["--level", str(options.level)]
    if options.loss_map is not None:
        arguments += ["--loss-map", str(options.loss_map)]
    if options.point_mass:
        arguments.append("--point-mass")
    return tuple(arguments)


def _attachments(options: TripOptions) -> list[Path]:
    """The files that a replay is made from, besides the trip."""
    paths = _input_files(options).values()
    return [*paths, *([options.line] if options.line is not None else [])]


def _input_files(options: TripOptions) -> dict[str, Path]:
    """The paths of route, vehicle and loss map by those names; a loss map that is given replaces the vehicle's own."""
    files = input_files(str(options.route), str(options.vehicle))
    return files if options.loss_map is None else {**files, "loss_map": options.loss_map}


def _metadata(trip: Trip, section: Section, options: TripOptions) -> dict[str, str]:
    report = trip.matched.report
    return {
        "kind": "replay",
        "version": __version__,
        "trip": trip.path.name,
        "trip_sha256": sha256(trip.path),
        "route": section.route.name,
        "vehicle": section.vehicle.name,
        **{f"{name}_sha256": sha256(path) for name, path in _input_files(options).items()},
        "level": str(section.level),
        "map_anchor": report.anchor,
        "map_scale": f"{report.scale:.6f}",
        "map_offset_m": f"{report.offset_m:.1f}",
        "map_median_cross_track_m": _metres(report.median_cross_track_m),
        "map_p95_cross_track_m": _metres(report.p95_cross_track_m),
        "map_max_cross_track_m": _metres(report.max_cross_track_m),
        "gps_dropout_points": str(np.count_nonzero(trip.matched.dropout)),
        "cleaning": report.cleaning.summary,
    }


def _metres(distance_m: float | None) -> str:
    return "no line" if distance_m is None else f"{distance_m:.1f}"
