"""What a recording of the node alone does not hold, found from the files that it brings along and its positions.

The gradient is that of the line; forces and energy are the estimate of inverse dynamics (docs/explanation/
trip-energy.md), as `das-sim energy` makes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from das.bus import topics
from das.domain.errors import DasError
from das.domain.route import Route
from das.domain.units import KN, NS, PERMILLE, kwh
from sim.drive.drive import Drive
from sim.recording.course import DrivenCourse
from sim.review.series import Found, MapTrack

NOTHING: Final[Found] = {}


@dataclass(frozen=True, kw_only=True, eq=False)
class FilledIn:
    """Series by the names of `STYLES`, the train's way on the map, and the source.

    `source` says in a sentence what is estimated, or why nothing could be; it is empty where nothing was missing.
    """

    series: Found
    source: str
    way: MapTrack | None = None


def filled_in(drive: Drive) -> FilledIn:
    """What is missing in a recording without a simulator; nothing where the simulator was recorded."""
    recording = drive.recording
    if recording.of(topics.TRUTH) or not recording.of(topics.JOURNEY):
        return FilledIn(series=NOTHING, source="")
    try:
        return _estimated(drive)
    except DasError as error:
        why = str(error).removeprefix(f"{recording.path}: ")
        return FilledIn(series=NOTHING, source=f"force, energy and gradient are not known: {why}")


def _estimated(drive: Drive) -> FilledIn:
    from das.solver.section import build_section
    from sim.trips.estimate import estimate_run

    trip, inputs, motion = drive.course, drive.inputs, drive.motion
    section = build_section(
        inputs.route,
        inputs.vehicle,
        level=inputs.level,
        start_m=max(float(motion.s_m[0]), 0.0),
        end_m=min(float(motion.s_m[-1]), inputs.route.length_m),
    )
    since_s = (motion.time_ns - motion.time_ns[0]) * NS
    inside = np.clip(motion.s_m, section.start_m, section.end_m)
    driven = estimate_run(section, since_s, inside, motion.speed_mps)
    run, at = driven.trajectory, motion.time_ns[driven.index]
    within = (at >= trip.time_ns[0]) & (at <= trip.time_ns[-1])
    found = {
        "energy/driven": (at[within], kwh(driven.energy_input_j[within])),
        "gradient/permille": (at[:-1][within[:-1]], run.grade_ratio[within[:-1]] / PERMILLE),
    }
    if not drive.recording.of(topics.EFFORT):
        force_n = (run.force_el_n + run.force_friction_n)[within[:-1]]
        found["force/driven"] = (at[:-1][within[:-1]], force_n / KN)
    return FilledIn(
        series=found,
        source=f"force and energy are estimated from positions, nobody measured them ({inputs.source})",
        way=_way(inputs.route, trip),
    )


def _way(route: Route, trip: DrivenCourse) -> MapTrack | None:
    """Where the train was on the map by the line's geometry; None for a line without one."""
    if not len(route.geometry_position_m):
        return None
    places = (route.geometry_latitude_deg, route.geometry_longitude_deg)
    degrees = np.column_stack([np.interp(trip.s_m, route.geometry_position_m, one) for one in places])
    return MapTrack.through(trip.time_ns, degrees)
