"""The command `das-precompute journey`."""

from __future__ import annotations

import json
import math
import time
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.running import busy
from das.domain.errors import DasError
from das.domain.files.load import load_journey
from das.domain.files.trajectory_csv import write_trajectory
from das.domain.files.writing import check_writable
from das.domain.journey import Journey
from das.domain.route import Route, Stop
from das.domain.units import PERCENT
from das.domain.vehicle import Vehicle
from das.solver.journey.chains import Split
from das.solver.journey.plan import JourneyPlan, JourneyPlanner
from das.solver.section import SectionOptions, build_section
from das.solver.warm_up import warm_up
from precompute.baselines import strategies as baselines
from precompute.cli.options import (
    COMPILING,
    AdhesionOption,
    JsonOption,
    LevelOption,
    LoadOption,
    LossMapOption,
    MassOption,
    NoFrictionOption,
    PointMassOption,
    ReceptivityOption,
    ResistanceOption,
    ReverseOption,
    RouteArgument,
    VehicleArgument,
    WindOption,
)
from precompute.cli.pose import Pose
from precompute.journey import report as journey_report

ALL_STOPS = "stops"
"""What to say instead of a journey to call at all stops of the route."""
DWELL_S = 30.0
EXAMPLES = (
    "Examples: das-precompute journey zurich-luzern zurich-luzern re460-ic --plot journey.png; "
    "das-precompute journey stops zurich-luzern re460-ic --buffer 7 --dwell 60"
)


def journey_command(
    journey: Annotated[
        str,
        typer.Argument(
            help=f"Bundled journey name, TOML file or TTOBench journey (JSON); or {ALL_STOPS!r}: all of the route's."
        ),
    ],
    route: RouteArgument,
    vehicle: VehicleArgument,
    time_s: Annotated[
        float | None, typer.Option("--time", help=f"With {ALL_STOPS!r}: whole time in s, dwells included.")
    ] = None,
    buffer_percent: Annotated[
        float | None,
        typer.Option(
            "--buffer", help=f"With {ALL_STOPS!r}: running time as % above the least possible, dwells beside it."
        ),
    ] = None,
    dwell_s: Annotated[
        float | None,
        typer.Option("--dwell", help=f"With {ALL_STOPS!r}: least dwell at every stop in s [default: {DWELL_S:g}]."),
    ] = None,
    reverse: ReverseOption = False,
    level: LevelOption = None,
    loss_map: LossMapOption = None,
    point_mass: PointMassOption = False,
    no_friction_brake: NoFrictionOption = False,
    load: LoadOption = None,
    mass_ratio: MassOption = 1.0,
    resistance_ratio: ResistanceOption = 1.0,
    head_wind_kmh: WindOption = 0.0,
    receptivity_ratio: ReceptivityOption = 1.0,
    adhesion_ratio: AdhesionOption = 1.0,
    as_json: JsonOption = False,
    csv: Annotated[Path | None, typer.Option(help="Write the trajectory of the whole journey as CSV.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture (PNG): speed, and time with its windows.")] = None,
) -> None:
    """The least-energy plan of a train's whole journey: when to be where, and how to drive between.

    Every window is kept: no stop is left early, none reached late, and passing points are passed in time. Where no
    window binds, time is shared so that one second less would cost the same everywhere (λ, the price of time, in kW:
    kWh an hour); λ changes only where a window binds. With "stops" nothing is timed but the departure (at 0) and the
    last arrival.

    Printed besides: the energy of the same windows with the same buffer in per cent everywhere, and that of driving as
    fast as possible and waiting. Windows that cannot be kept are an error that says which, and by how many seconds.
    """
    _check_outputs(csv, plot)
    pose = Pose(
        route=route,
        vehicle=vehicle,
        reverse=reverse,
        level=level,
        loss_map=loss_map,
        point_mass=point_mass,
        no_friction_brake=no_friction_brake,
        load=load,
        mass_ratio=mass_ratio,
        resistance_ratio=resistance_ratio,
        head_wind_kmh=head_wind_kmh,
        receptivity_ratio=receptivity_ratio,
        adhesion_ratio=adhesion_ratio,
    )
    line, train = pose.line(), pose.train()
    if journey == ALL_STOPS:
        asked = _all_stops(pose, line, train, time_s, buffer_percent, DWELL_S if dwell_s is None else dwell_s)
    elif (time_s, buffer_percent, dwell_s) == (None, None, None):
        asked = load_journey(journey, line)
    else:
        raise DasError(f"--time, --buffer and --dwell belong to {ALL_STOPS!r}: {journey} has times of its own")
    with busy(COMPILING):
        warm_up()
    began = time.perf_counter()
    with busy(f"planning {len(asked.calls) - 1} sections …"):
        planner = JourneyPlanner(asked, line, train, level=level, point_mass=point_mass)
        plan = planner.plan()
        solve_s = time.perf_counter() - began
        others_j = {"proportional": planner.plan(Split.PROPORTIONAL).input_j, "fastest": planner.fastest_j()}
    title = f"{asked.name}: {train.id}, {planner.hops[0].section.level}"
    _tell(plan, title, others_j, solve_s, as_json=as_json, csv=csv, plot=plot)


def _check_outputs(csv: Path | None, plot: Path | None) -> None:
    if csv is not None and csv == plot:
        raise DasError(f"{csv}: --csv and --plot name the same file")
    for path in (csv, plot):
        if path is not None:
            check_writable(path)


def _all_stops(
    pose: Pose, route: Route, train: Vehicle, time_s: float | None, buffer_percent: float | None, dwell_s: float
) -> Journey:
    """A journey over all stops of a route in a time, or with a buffer."""
    if time_s is not None and buffer_percent is None:
        return Journey.over_stops(route.stops, time_s=time_s, dwell_s=dwell_s)
    if time_s is not None or buffer_percent is None:
        raise DasError(f"{ALL_STOPS}: give either --time (s) or --buffer (%)")
    if not 0 <= dwell_s < math.inf:
        raise DasError(f"--dwell {dwell_s} s: expected a finite number >= 0")
    if not 0 <= buffer_percent < 1e4:
        raise DasError(f"--buffer {buffer_percent} %: expected a number from 0 to 10000")
    with busy(COMPILING):
        least_s = sum(_least_time_s(pose, route, train, *pair) for pair in pairwise(route.stops))
    running_s = least_s * (1.0 + buffer_percent * PERCENT)
    return Journey.over_stops(route.stops, time_s=running_s + dwell_s * (len(route.stops) - 2), dwell_s=dwell_s)


def _least_time_s(pose: Pose, route: Route, train: Vehicle, start: Stop, end: Stop) -> float:
    section = build_section(
        route,
        train,
        level=pose.level,
        start_m=start.position_m,
        end_m=end.position_m,
        options=SectionOptions(point_mass=pose.point_mass),
    )
    return baselines.fastest(section).time_s


def _tell(
    plan: JourneyPlan,
    title: str,
    others_j: dict[str, float],
    solve_s: float,
    *,
    as_json: bool,
    csv: Path | None,
    plot: Path | None,
) -> None:
    if csv is not None:
        write_trajectory(csv, plan.trajectory())
    if plot is not None:
        journey_report.draw(plot, plan, title)
    if as_json:
        print(json.dumps(journey_report.as_json(plan, others_j, solve_s)))
        return
    journey_report.print_plan(plan, title, others_j)
    for path in (csv, plot):
        if path is not None:
            print(f"written: {path}")
