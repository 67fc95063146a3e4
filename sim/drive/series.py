"""The plotted series of a drive: quantities with their units and colours, and the values over time.

If only the node was recorded, some series are missing. They are derived from the attached files and the positions: the
gradient from the line, forces and energy by inverse dynamics (docs/explanation/trip-energy.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from das.advice.advice import Source
from das.domain.errors import DasError
from das.domain.units import KMH, KN, NS, PERCENT, PERMILLE, kwh
from sim.drive.table import DriveTable, PlanMade
from sim.meanings import Meaning
from sim.recording.course import DrivenCourse, Floats, Times

if TYPE_CHECKING:
    from sim.drive.energy import DriveEnergy
    from sim.drive.legs import DrivenMotion

UNKNOWN_S: Final = 10.0
"""Longest time (s) without records over which the curves of the drive have no gap."""


class Quantity(NamedTuple):
    """The quantity of an axis: a short name, its unit, and a longer name for use where there is room."""

    name: str
    unit: str
    words: str

    @property
    def title(self) -> str:
        """The short name with the unit, as used on the axes of pictures."""
        return f"{self.name[0].lower()}{self.name[1:]}, {self.unit}"

    @property
    def long_title(self) -> str:
        """The longer name with the unit."""
        return f"{self.words} ({self.spelt_unit})"

    @property
    def spelt_unit(self) -> str:
        """The unit without symbols that the fonts of the viewer may lack."""
        return self.unit.replace("‰", "permille")


QUANTITIES: Final = {
    "speed": Quantity("Speed", "km/h", "Speed"),
    "force": Quantity("Force", "kN", "Force at the wheels"),
    "gradient": Quantity("Gradient", "‰", "Gradient"),
    "lever": Quantity("Controller", "%", "Controller, shown and set: share of the largest effort"),
    "lost": Quantity("Lost", "kWh", "Energy lost above the optimum: by all driving, and by other efforts than advised"),
    "energy": Quantity("Energy", "kWh", "Energy at the current collector"),
    "deviation": Quantity("Late", "s", "Deviation from the timetable, late > 0"),
    "buffer": Quantity("Buffer", "%", "Buffer: time left above the least possible"),
    "estimate": Quantity("Position", "m", "Position estimated by the node"),
    "calibration": Quantity("To plan", "%", "Mass and resistance estimated by the node, relative to the plan"),
    "apart": Quantity("Driven minus\nshown", "km/h", "Driven speed less the speed shown to keep"),
    "place": Quantity("Lost above the\noptimum", "kWh/km", "Energy lost above the optimum, by place"),
    "sum": Quantity("Sum from the\nstart", "kWh", "Energy lost above the optimum, summed over the places"),
}
"""The quantities; the name of a series begins with the name of its quantity."""


def quantity_of(name: str) -> str:
    """The name of the quantity of a series."""
    return name.split("/", maxsplit=1)[0]


class Style(NamedTuple):
    """The style of a series: label, meaning of its colour, width, and whether a value holds until the next.

    `gaps`: the series comes with the advice, and has a gap while no message came from the node.
    """

    label: str
    meaning: Meaning
    width: float = 1.4
    held: bool = False
    gaps: bool = False


SAME_TIMES: Final = "optimum for the same times"
STYLES: Final = {
    "speed/limit": Style("limit", Meaning.LIMIT, held=True),
    "speed/optimum": Style("optimum from the start", Meaning.OPTIMUM, width=1.2),
    "speed/same_times": Style(SAME_TIMES, Meaning.OPTIMUM, width=1.2),
    "speed/advised": Style("advised", Meaning.ADVISED, width=3.0, gaps=True),
    "speed/shown": Style("shown to the driver", Meaning.SHOWN, width=1.0, held=True),
    "speed/driven": Style("driven", Meaning.DRIVEN),
    "force/advised": Style("advised", Meaning.ADVISED, width=3.0, gaps=True),
    "force/driven": Style("driven", Meaning.DRIVEN),
    "energy/optimum": Style(SAME_TIMES, Meaning.OPTIMUM),
    "energy/driven": Style("driven", Meaning.DRIVEN),
    "lost/driving": Style("lost by the driving so far", Meaning.LOST),
    "lost/advice": Style("of it, by other efforts than advised", Meaning.AGAINST),
    "gradient/permille": Style("gradient", Meaning.GRADIENT, held=True),
    "lever/shown": Style("shown", Meaning.SHOWN, width=3.0, held=True),
    "lever/set": Style("set by the driver", Meaning.DRIVEN, held=True),
    "deviation/operator": Style("known to traffic management", Meaning.OPERATOR, held=True),
    "deviation/predicted": Style("predicted arrival", Meaning.ADVISED, gaps=True),
    "buffer/percent": Style("buffer", Meaning.ADVISED, gaps=True),
    "estimate/sd": Style("standard deviation stated by the node", Meaning.ADVISED, gaps=True),
    "estimate/error": Style("estimated less true position", Meaning.ERROR, gaps=True),
    "calibration/mass": Style("mass", Meaning.MASS),
    "calibration/mass_sd": Style("its standard deviation", Meaning.MASS, width=0.7),
    "calibration/resistance": Style("resistance", Meaning.RESISTANCE),
    "calibration/resistance_sd": Style("its standard deviation", Meaning.RESISTANCE, width=0.7),
    "apart/shown": Style("driven less shown", Meaning.DRIVEN, width=1.2),
    "place/lost": Style("lost there", Meaning.LOST, held=True),
    "sum/lost": Style("lost by the driving up to there", Meaning.LOST),
}
"""The style of each series, in drawing order. An advised curve is wider and lies under the driven one, so that both are
visible where they agree."""

BUFFER_PERCENT: Final = (-5.0, 25.0)
"""Range of an axis of the buffer (%): at the end of a trip the buffer goes to infinity."""

SAME_STOP_M = 1.0
"""Largest distance (m) between the ends of plans that lead to one stop."""


def first_plans(table: DriveTable) -> DrivenCourse | None:
    """The first plans for all stops, joined: the optimum from where the advice began; None if none was recorded."""
    firsts: list[PlanMade] = []
    for plan in table.said.plans:
        if len(plan.s_m) and (not firsts or plan.s_m[-1] > firsts[-1].s_m[-1] + SAME_STOP_M):
            firsts.append(plan)
    if not firsts:
        return None
    return DrivenCourse(
        time_ns=np.concatenate([plan.time_ns + np.rint(plan.t_s / NS).astype(np.int64) for plan in firsts]),
        s_m=np.concatenate([plan.s_m for plan in firsts]),
        speed_mps=np.concatenate([plan.speed_mps for plan in firsts]),
    )


Found = dict[str, tuple[Times, Floats]]
"""Times and values of each series, by its name."""


def series(table: DriveTable) -> Found:
    """Times and values of all series but the limit, by the names of `STYLES`, from the first position on.

    A series has a gap (NaN) while its advice was withdrawn, or while nothing was shown.
    """
    found = {**_plan(table), **_advised(table), **driven(table), **_in_the_cab(table), **_estimated(table)}
    return {
        name: on_trip(table.course, *found[name], held=style.held) for name, style in STYLES.items() if name in found
    }


def _plan(table: DriveTable) -> Found:
    plan = first_plans(table)
    nothing = np.empty(0, np.int64), np.empty(0)
    return {"speed/optimum": (plan.time_ns, plan.speed_mps / KMH) if plan else nothing}


def _advised(table: DriveTable) -> Found:
    at, source, speed_mps, force_n, deviation_s, buffer_ratio = table.of_topic(
        "advice", "source", "advised_speed_mps", "advised_force_n", "predicted_deviation_s", "buffer_ratio"
    )
    gap = np.where(source == Source.NONE, np.nan, 1.0)
    return {
        "speed/advised": (at, speed_mps / KMH * gap),
        "force/advised": (at, force_n / KN * gap),
        **({} if table.own_timetable else {"deviation/predicted": (at, deviation_s * gap)}),
        "buffer/percent": (at, buffer_ratio / PERCENT * gap),
    }


def driven(table: DriveTable) -> Found:
    """The train's series, as far as recorded; so far, only the speed is cut to the time of the trip."""
    true_ns, gradient_ratio, input_j = table.of_topic("truth", "gradient_ratio", "energy_input_j")
    # Without a simulator, the train's own control may have measured its forces.
    source = "truth" if len(true_ns) else "effort"
    forces_ns, electric_n, friction_n = table.of_topic(source, "force_el_n", "force_friction_n")
    measured = slice(None if input_j.any() else 0)
    told_ns, delay_s = table.of_topic("delay", "delay_s")
    return {
        "speed/driven": _broken(table.course.time_ns, table.course.speed_mps / KMH),
        "force/driven": _broken(forces_ns, (electric_n + friction_n) / KN),
        "energy/driven": _broken(true_ns[measured], kwh(input_j[measured])),
        "gradient/permille": _broken(true_ns, gradient_ratio / PERMILLE),
        **({} if table.own_timetable else {"deviation/operator": (told_ns, delay_s)}),
    }


def _broken(time_ns: Times, values: Floats) -> tuple[Times, Floats]:
    """The series with a gap (NaN) behind each value after which nothing is recorded for longer than `UNKNOWN_S`."""
    behind = np.nonzero(np.diff(time_ns) * NS > UNKNOWN_S)[0] + 1
    return np.insert(time_ns, behind, time_ns[behind - 1] + 1), np.insert(values, behind, np.nan)


def _in_the_cab(table: DriveTable) -> Found:
    at, presentation, speed_mps, advised_ratio, lever_ratio = table.of_topic(
        "cab", "presentation", "advised_speed_mps", "advised_lever_ratio", "lever_ratio"
    )
    gap = np.where(presentation == 0, np.nan, 1.0)
    return {
        "speed/shown": (at, speed_mps / KMH * gap),
        "lever/shown": (at, advised_ratio / PERCENT * gap),
        "lever/set": (at, lever_ratio / PERCENT),
    }


def _estimated(table: DriveTable) -> Found:
    """The node's estimates: the position relative to the true one, and the train relative to the planned one."""
    advised_ns, s_m, sd_m = table.of_topic("advice", "s_m", "position_sd_m")
    known = sd_m > 0.0
    at, trip = advised_ns[known], table.course
    error_m = s_m[known] - trip.at(at, trip.s_m)
    compared = slice(None if table.has("truth") else 0)
    since, mass, mass_sd, resistance, resistance_sd = table.of_topic(
        "estimate", "mass_ratio", "mass_sd_ratio", "resistance_ratio", "resistance_sd_ratio"
    )
    return {
        "estimate/sd": (at, sd_m[known]),
        "estimate/error": (at[compared], error_m[compared]),
        "calibration/mass": (since, (mass - 1.0) / PERCENT),
        "calibration/mass_sd": (since, mass_sd / PERCENT),
        "calibration/resistance": (since, (resistance - 1.0) / PERCENT),
        "calibration/resistance_sd": (since, resistance_sd / PERCENT),
    }


def on_trip(trip: DrivenCourse, time_ns: Times, values: Floats, *, held: bool) -> tuple[Times, Floats]:
    """The values within the time of the trip.

    A value of a `held` quantity holds until the next: the last value before the trip and one at its end are included.
    """
    keep = time_ns >= trip.time_ns[0]
    if held and len(time_ns):
        keep[np.flatnonzero(~keep)[-1:]] = True
        if time_ns[-1] < trip.time_ns[-1]:
            time_ns, values = np.append(time_ns, trip.time_ns[-1]), np.append(values, values[-1])
            keep = np.append(keep, True)
    return time_ns[keep], values[keep]


def filled_in(energy: DriveEnergy) -> tuple[Found, str]:
    """The series that a recording without a simulator lacks, and a sentence on the estimates, or on why there are none;
    both are empty if a simulator was recorded."""
    table = energy.table
    if table.has("truth") or table.journey is None:
        return {}, ""
    try:
        return _estimate(table, energy.motion)
    except DasError as error:
        why = str(error).removeprefix(f"{table.recording.path}: ")
        return {}, f"force, energy and gradient are not known: {why}"


def _estimate(table: DriveTable, motion: DrivenMotion) -> tuple[Found, str]:
    from das.solver.section import build_section
    from sim.trips.estimate import estimate_run

    trip, inputs = table.course, table.inputs
    section = build_section(
        inputs.route,
        inputs.vehicle,
        level=inputs.level,
        start_m=max(float(motion.s_m[0]), 0.0),
        end_m=min(float(motion.s_m[-1]), inputs.route.length_m),
    )
    since_s = (motion.time_ns - motion.time_ns[0]) * NS
    inside = np.clip(motion.s_m, section.start_m, section.end_m)
    estimated = estimate_run(section, since_s, inside, motion.speed_mps)
    run, at = estimated.trajectory, motion.time_ns[estimated.index]
    within = (at >= trip.time_ns[0]) & (at <= trip.time_ns[-1])
    found = {
        "energy/driven": (at[within], kwh(estimated.energy_input_j[within])),
        "gradient/permille": (at[:-1][within[:-1]], run.grade_ratio[within[:-1]] / PERMILLE),
    }
    if not table.has("effort"):
        force_n = (run.force_el_n + run.force_friction_n)[within[:-1]]
        found["force/driven"] = (at[:-1][within[:-1]], force_n / KN)
    return found, f"force and energy are estimated from positions, not measured ({inputs.source})"
