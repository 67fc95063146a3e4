"""The command das-sim."""

from __future__ import annotations

import json
import math
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.loading import warn_unusual
from das.command_line.printing import busy, error_console
from das.command_line.running import interrupt_on_termination, run_app
from das.domain.errors import DasError
from das.domain.files.load import load_route, load_vehicle
from das.domain.files.writing import check_writable
from das.domain.route import section_stops
from das.domain.units import NS, kwh
from sim.batch.command import batch
from sim.cli.options import (
    FromOption,
    LevelOption,
    LineOption,
    LossMapOption,
    ReplayOptions,
    ReverseOption,
    RouteOption,
    StrictOption,
    ToOption,
    TripArgument,
    VehicleOption,
)
from sim.cli.shared import (
    BusOption,
    InsecureBusOption,
    new_recording,
    progress_bar,
    speed_factor,
    typed_command,
)
from sim.drivers.command import drivers
from sim.review import command as view_command
from sim.trips import command as trip_command
from sim.world.command import run, scenarios

app = typer.Typer(
    help="Replay a train's trip, or drive a simulated day, against a live advice node; record it, look at it.\n\n"
    "Without a command: replays the bundled recording and tells how to view it.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

TIMETABLE_STEP_S = 6.0
"""Timetables are made in tenths of a minute."""
BUNDLED = "zurich-zug-late.mcap"
app.command(epilog="Example: das-sim run departure-delay --driver human --advice vector --seed 3")(run)
app.command(epilog="Example: das-sim scenarios --json")(scenarios)
app.command(epilog="Example: das-sim batch clear-day signal-stop --seeds 0-9 --advice vector,none -o runs")(batch)
app.command(epilog="Example: das-sim drivers --json")(drivers)
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]


def bundled_recording() -> Path:
    """The recording that comes with the program: in an installed package, or in the checkout."""
    package = Path(__file__).parents[1]
    for path in (package / "bundled" / BUNDLED, package.parent / "recordings" / BUNDLED):
        if path.is_file():
            return path
    raise DasError(f"{BUNDLED}: the bundled recording is missing from this installation")


@app.callback(invoke_without_command=True, epilog="Example: das-sim")
def default(context: typer.Context) -> None:
    """Without a command, replay the bundled recording."""
    if context.invoked_subcommand is None:
        path = bundled_recording()
        what = f"replaying the bundled recording {BUNDLED}: a late train on an illustrative Zürich–Luzern route"
        error_console().print(what)
        _replay(path, ReplayOptions())


@app.command(
    epilog="Example: das-sim replay trip.csv --route track.json --vehicle train.json --line kmposts.csv --reverse"
)
def replay(
    trip: TripArgument,
    route: RouteOption = None,
    vehicle: VehicleOption = None,
    reverse: ReverseOption = None,
    line: LineOption = None,
    from_stop: FromOption = None,
    to_stop: ToOption = None,
    strict: StrictOption = False,
    arrival_s: Annotated[
        float | None,
        typer.Option("--arrival", help="Timetable's running time in s [default: as long as the trip took]."),
    ] = None,
    delay_s: Annotated[
        float | None, typer.Option("--delay", help="Seconds by which the trip departs late [default: recorded, or 0].")
    ] = None,
    speed: Annotated[str, typer.Option(help="Times real time, real or max.")] = "max",
    level: LevelOption = None,
    loss_map: LossMapOption = None,
    point_mass: Annotated[bool, typer.Option("--point-mass", help="Take the train's length as 0.")] = False,
    train: Annotated[str, typer.Option(help="Train name, the second part of every key.")] = "train-1",
    out: Annotated[
        Path | None, typer.Option(help="Recording to write [default: recordings/replay-<time>.mcap].")
    ] = None,
    bus: BusOption = None,
    insecure_bus: InsecureBusOption = False,
    as_json: JsonOption = False,
) -> None:
    """Replay a trip: the node answers with advice every second, everything lands in an MCAP file."""
    options = ReplayOptions(
        route=route,
        vehicle=vehicle,
        reverse=reverse,
        line=line,
        strict=strict,
        from_stop=from_stop,
        to_stop=to_stop,
        arrival_s=arrival_s,
        delay_s=delay_s,
        speed=speed_factor(speed),
        level=level,
        loss_map=loss_map,
        point_mass=point_mass,
        train=train,
        bus=bus,
        insecure_bus=insecure_bus,
        out=out,
        as_json=as_json,
    )
    _replay(trip, options)


app.command("trip", epilog=trip_command.EPILOG)(trip_command.trip)
app.command("view", epilog=view_command.EPILOG)(view_command.view)


@app.command(
    "make-trip",
    epilog="Example: das-sim make-trip --route zurich-luzern --vehicle re460-ic --to Zug --delay 90 --out trip.mcap",
)
def make_trip(
    route: Annotated[str, typer.Option(help="Bundled route, TOML or TTOBench track.")],
    vehicle: Annotated[str, typer.Option(help="Bundled vehicle, TOML or TTOBench train.")],
    out: Annotated[Path, typer.Option(help="MCAP file to write.")],
    from_stop: Annotated[str | None, typer.Option("--from", help="First stop [default: the route's].")] = None,
    to_stop: Annotated[str | None, typer.Option("--to", help="Last stop [default: the route's].")] = None,
    reverse: Annotated[bool, typer.Option("--reverse", help="Drive the route from its end.")] = False,
    delay_s: Annotated[float, typer.Option("--delay", help="Seconds by which the train leaves late.", min=0)] = 0.0,
    buffer_percent: Annotated[
        float, typer.Option("--buffer", help="Timetable: % above the least running time.", min=0, max=1000)
    ] = 15.0,
    departure: Annotated[str, typer.Option(help="Timetable's departure, ISO 8601 UTC.")] = "2026-11-21T08:04:00",
    seed: Annotated[int, typer.Option(help="Seed of driver and receiver noise.", min=0)] = 1,
    train: Annotated[str, typer.Option(help="Train name.")] = "train-1",
) -> None:
    """Make a trip by simulation: a driver without advice on a simulated train, as a GPS receiver would tell it."""
    check_writable(out)
    with busy("driving the simulated train …"):
        from das.bus.topics import check_train_name
        from das.solver.section import build_section
        from das.solver.solve import solve_front
        from sim.bundled.make_trip import TripPlan, drive, write_trip

        the_route, the_vehicle = load_route(route), load_vehicle(vehicle)
        warn_unusual(the_route, the_vehicle)
        the_route = the_route.reversed() if reverse else the_route
        start, end = section_stops(the_route, from_stop, to_stop)
        section = build_section(the_route, the_vehicle, start_m=start.position_m, end_m=end.position_m)
        least_s = solve_front(section).fastest().time_s
        plan = TripPlan(
            route=the_route,
            vehicle=the_vehicle,
            level=section.level,
            start=start,
            end=end,
            reversed=reverse,
            departure_ns=_utc_ns(departure),
            running_time_s=math.ceil(least_s * (1 + buffer_percent / 100) / TIMETABLE_STEP_S) * TIMETABLE_STEP_S,
            delay_s=delay_s,
            seed=seed,
            train=check_train_name(train),
        )
        states = drive(plan)
        write_trip(out, plan, states, typed_command())
    late_s = delay_s + states[-1].time_s - plan.running_time_s  # against the timetable
    took_s, due_s = states[-1].time_s, plan.running_time_s
    print(f"{start.name} – {end.name}: {took_s:.0f} s, timetable {due_s:.0f} s, arrival {late_s:+.0f} s")
    print(f"energy of the simulated train {kwh(states[-1].energy_input_j):.1f} kWh; written: {out}")


def _replay(trip: Path, options: ReplayOptions) -> None:
    out = options.out or new_recording("replay")
    check_writable(out)
    with busy("reading the trip and solving its section …"):
        from sim.replay.job import prepare
        from sim.replay.replay import replay as run_replay
        from sim.replay.report import print_result, result

        job = prepare(trip, options, out, typed_command())
    interrupt_on_termination()
    try:
        with progress_bar(f"replaying {trip.name}", "starting node and recorder", "s") as progress:
            outcome = run_replay(job, progress)
    except KeyboardInterrupt:
        print(f"stopped; recorded so far: {out}", file=sys.stderr)
        raise
    with busy("estimating what it took, and how far that is known …"):
        found = result(job, outcome)
    if options.as_json:
        print(json.dumps(found))
    else:
        print_result(found)


def _utc_ns(text: str) -> int:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise DasError(f"--departure {text}: expected a time like 2026-11-21T08:04:00") from None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return round(moment.timestamp() / NS)


def main() -> None:
    """Entry point of das-sim."""
    run_app(app)


if __name__ == "__main__":
    main()
