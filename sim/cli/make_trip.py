"""The command `das-sim make-trip`: a recorded trip made by simulation, as the bundled one was."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from das.command_line.options import (
    DEFAULT_TRAIN,
    FromOption,
    OutRecording,
    OverwriteOption,
    ReverseOption,
    RouteOption,
    SeedOption,
    ToOption,
    TrainOption,
    VehicleOption,
)
from das.command_line.printing import busy, tell
from das.domain.errors import DasError
from das.domain.files.writing import check_writable
from das.domain.units import NS, kwh
from sim.recording.metadata import typed_command

if TYPE_CHECKING:
    from sim.bundled.hurried import HurriedState
    from sim.bundled.make_trip import TripPlan

TIMETABLE_STEP_S: Final = 6.0
"""Timetables are made in tenths of a minute."""


def make_trip(
    route: RouteOption,
    vehicle: VehicleOption,
    out: OutRecording,
    overwrite: OverwriteOption = False,
    from_stop: FromOption = None,
    to_stop: ToOption = None,
    reverse: ReverseOption = False,
    delay_s: Annotated[float, typer.Option("--delay", metavar="S", help="How late the train leaves.", min=0)] = 0.0,
    buffer_percent: Annotated[
        float,
        typer.Option("--buffer", metavar="%", help="Timetable: % above the least running time.", min=0, max=1000),
    ] = 15.0,
    departure: Annotated[
        str, typer.Option(metavar="TIME", help="Timetable's departure, ISO 8601 UTC.")
    ] = "2026-11-21T08:04:00",
    seed: SeedOption = 1,
    train: TrainOption = DEFAULT_TRAIN,
) -> None:
    """Make a recorded trip by simulation: a driver without advice, seen through a GPS receiver."""
    check_writable(out, overwrite=overwrite)
    with busy("driving the simulated train …"):
        from das.bus.topics import check_train_name
        from das.command_line.loading import load_route, load_vehicle
        from das.domain.route import section_stops
        from das.solver.section import build_section
        from das.solver.solve import solve_front
        from sim.bundled.make_trip import TripPlan, drive, write_trip

        the_vehicle = load_vehicle(vehicle)
        the_route = load_route(route).reversed() if reverse else load_route(route)
        start, end = section_stops(the_route, from_stop, to_stop)
        section = build_section(the_route, the_vehicle, start_m=start.position_m, end_m=end.position_m)
        wanted_s = solve_front(section).fastest().time_s * (1 + buffer_percent / 100)
        plan = TripPlan(
            route=the_route,
            vehicle=the_vehicle,
            level=section.level,
            start=start,
            end=end,
            reversed=reverse,
            departure_ns=_utc_ns(departure),
            running_time_s=math.ceil(wanted_s / TIMETABLE_STEP_S) * TIMETABLE_STEP_S,
            delay_s=delay_s,
            seed=seed,
            train=check_train_name(train),
        )
        states = drive(plan)
        write_trip(out, plan, states, typed_command())
    _tell(plan, states[-1], out)


def _tell(plan: TripPlan, last: HurriedState, out: Path) -> None:
    """Tell how the trip went; `last` is its last state."""
    took_s, due_s = last.time_s, plan.running_time_s
    late_s = plan.delay_s + took_s - due_s
    tell(f"{plan.start.name} – {plan.end.name}: {took_s:.0f} s, timetable {due_s:.0f} s, arrival {late_s:+.0f} s")
    tell(f"energy of the simulated train {kwh(last.energy_input_j):.1f} kWh; written: {out}")


def _utc_ns(text: str) -> int:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise DasError(f"--departure {text}: expected a time like 2026-11-21T08:04:00") from None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return round(moment.timestamp() / NS)
