"""The command das-precompute."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.table import Table

from das.command_line.running import busy, interrupt_on_termination, print_table, run_app
from das.domain.errors import DasError
from das.domain.files.trajectory_csv import write_trajectory
from das.domain.files.writing import check_writable
from das.domain.units import KM, KMH
from precompute.baselines.strategies import Strategy
from precompute.bench.command import bench
from precompute.calibrate.command import calibrate
from precompute.cli.options import (
    COMPILING,
    AdhesionOption,
    BoundaryOption,
    BrakeForceOption,
    EndSpeedOption,
    ForceOption,
    FromOption,
    JsonOption,
    LevelOption,
    LoadOption,
    LossMapOption,
    MassOption,
    NoFrictionOption,
    PointMassOption,
    PowerOption,
    ReceptivityOption,
    ResistanceOption,
    ReverseOption,
    RouteArgument,
    SpeedOption,
    StartSpeedOption,
    ToOption,
    VehicleArgument,
    WindOption,
    buffered,
    posed,
)
from precompute.cli.pose import Pose
from precompute.journey.command import EXAMPLES, journey_command
from precompute.loss_maps.command import loss_map_command
from precompute.sensitivity.command import sensitivity
from precompute.study.command import study
from precompute.tables.command import build, show, verify

app = typer.Typer(
    help="Solve the time–energy trade-off of a train on a section, offline.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

StrategyOption = Annotated[Strategy, typer.Option(help="How the section is driven (fastest: needs no time).")]

BUFFERS_PERCENT = "0,2,5,7,10,15,20"
EXACT_MAX_BUFFER_PERCENT = 10.0


@app.command(
    epilog="Example: das-precompute solve zurich-luzern re460-ic --from Zug --to Luzern --buffer 7 --plot run.png"
)
def solve(
    route: RouteArgument,
    vehicle: VehicleArgument,
    time_s: Annotated[float | None, typer.Option("--time", help="Trip time in s.")] = None,
    buffer_percent: Annotated[
        float | None, typer.Option("--buffer", help="Trip time as % above the least possible.")
    ] = None,
    strategy: StrategyOption = Strategy.OPTIMAL,
    from_stop: FromOption = None,
    to_stop: ToOption = None,
    reverse: ReverseOption = False,
    level: LevelOption = None,
    loss_map: LossMapOption = None,
    point_mass: PointMassOption = False,
    boundary_speed_mps: BoundaryOption = 0.0,
    start_speed_mps: StartSpeedOption = None,
    end_speed_mps: EndSpeedOption = None,
    max_power_kw: PowerOption = None,
    max_force_kn: ForceOption = None,
    max_brake_force_kn: BrakeForceOption = None,
    max_speed_kmh: SpeedOption = None,
    no_friction_brake: NoFrictionOption = False,
    load: LoadOption = None,
    mass_ratio: MassOption = 1.0,
    resistance_ratio: ResistanceOption = 1.0,
    head_wind_kmh: WindOption = 0.0,
    receptivity_ratio: ReceptivityOption = 1.0,
    adhesion_ratio: AdhesionOption = 1.0,
    as_json: JsonOption = False,
    csv: Annotated[Path | None, typer.Option(help="Write the trajectory as CSV, one row a node.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture (PNG).")] = None,
) -> None:
    """The least-energy run of a train over a section in a given time, or that of a baseline strategy.

    --strategy fastest: full effort, the limits, full brake. rms: the same under one reduced maximum speed. four-mode:
    full traction, one cruising speed, coasting, full brake, with the best switching points.

    Printed besides, for the optimal run: λ, the price of time at the solution (what one second less would cost), and
    the gap to a lower bound of the energy (slightly negative where the run is finer than the table behind the bound).

    A time below the least possible gives the fastest run; a time beyond the least-energy run gives that run. Both
    are said ("fit": late, early).
    """
    if time_s is not None and buffer_percent is not None:
        raise DasError("give either --time (s) or --buffer (%)")
    if time_s is None and buffer_percent is None and strategy is not Strategy.FASTEST:
        raise DasError("give either --time (s) or --buffer (%)")
    pose = posed(locals())
    if csv is not None and csv == plot:
        raise DasError(f"{csv}: --csv and --plot name the same file")
    for path in (csv, plot):
        if path is not None:
            check_writable(path)
    section, answer, min_time_s, solve_s = _answer(pose, strategy, time_s, buffer_percent)

    from precompute.cli import report

    if csv is not None:
        write_trajectory(csv, answer.trajectory)
    if plot is not None:
        report.draw_solution(plot, section, answer)
    result = report.solution_json(answer, min_time_s, solve_s)
    if as_json:
        print(json.dumps(result))
        return
    title = section.name if strategy is Strategy.OPTIMAL else f"{section.name}, {strategy}"
    _print_solutions(title, [result])
    _print_parameters(result)
    for path in (csv, plot):
        if path is not None:
            print(f"written: {path}")


@app.command(
    epilog="Examples: das-precompute front flat-6km re460-ic --buffers 0,5,10 --json; "
    "das-precompute front flat-6km re460-ic --exact --max-buffer 10"
)
def front(
    route: RouteArgument,
    vehicle: VehicleArgument,
    buffers: Annotated[
        str | None, typer.Option(help=f"Buffers in %, with commas between [default: {BUFFERS_PERCENT}].")
    ] = None,
    exact: Annotated[
        bool,
        typer.Option(
            "--exact", help="Every undominated run on the paper's grid (100 m × 0.25 km/h), beside the solver's."
        ),
    ] = False,
    max_buffer_percent: Annotated[
        float | None, typer.Option("--max-buffer", help="Largest buffer of the exact front in % [default: 10].")
    ] = None,
    csv: Annotated[Path | None, typer.Option(help="Write every point of the exact front as CSV.")] = None,
    from_stop: FromOption = None,
    to_stop: ToOption = None,
    reverse: ReverseOption = False,
    level: LevelOption = None,
    loss_map: LossMapOption = None,
    point_mass: PointMassOption = False,
    boundary_speed_mps: BoundaryOption = 0.0,
    start_speed_mps: StartSpeedOption = None,
    end_speed_mps: EndSpeedOption = None,
    max_power_kw: PowerOption = None,
    max_force_kn: ForceOption = None,
    max_brake_force_kn: BrakeForceOption = None,
    max_speed_kmh: SpeedOption = None,
    no_friction_brake: NoFrictionOption = False,
    load: LoadOption = None,
    mass_ratio: MassOption = 1.0,
    resistance_ratio: ResistanceOption = 1.0,
    head_wind_kmh: WindOption = 0.0,
    receptivity_ratio: ReceptivityOption = 1.0,
    adhesion_ratio: AdhesionOption = 1.0,
    as_json: JsonOption = False,
) -> None:
    """The trade-off between time and energy: the least-energy run for each of a list of buffers.

    --exact: the slow witness, the algorithm of the paper. It keeps every partial run that could still belong to the
    front; times are those of its grid, which is a little slower than the continuous solver. 6 km take some ten
    seconds, and memory grows fast with length and buffer.
    """
    pose = posed(locals())
    if not exact and (csv is not None or max_buffer_percent is not None):
        raise DasError("--csv and --max-buffer belong to --exact")
    max_buffer_percent = EXACT_MAX_BUFFER_PERCENT if max_buffer_percent is None else max_buffer_percent
    buffered(1.0, max_buffer_percent)
    wanted = _numbers(BUFFERS_PERCENT if buffers is None else buffers)
    if csv is not None:
        check_writable(csv)
    section, solved, min_time_s, front_s = _front(pose)
    if exact:
        from precompute.exact.command import exact_front

        if buffers is None:
            wanted = [x for x in wanted if x <= max_buffer_percent]
        exact_front(section, solved, max_buffer_percent, wanted, csv, as_json=as_json)
        return

    from precompute.cli import report

    points = []
    with busy("rolling out …"):
        for buffer_percent in wanted:
            began = time.perf_counter()
            solution = solved.trajectory(buffered(min_time_s, buffer_percent))
            point = report.solution_json(solution, min_time_s, time.perf_counter() - began)
            points.append({"buffer_percent": buffer_percent, **point})
    if as_json:
        print(json.dumps({"min_time_s": min_time_s, "front_s": front_s, "points": points}))
        return
    _print_solutions(section.name, points)


def _numbers(text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise DasError(f"--buffers {text}: expected numbers with commas between, like 0,5,10") from None
    for value in values:
        buffered(1.0, value)
    return values


def _answer(
    pose: Pose, strategy: Strategy, time_s: float | None, buffer_percent: float | None
) -> tuple[Any, Any, float, float]:
    """Section, run of a strategy, least time, and the seconds it took once everything was compiled."""

    def wanted_s(min_time_s: float) -> float | None:
        return buffered(min_time_s, buffer_percent) if buffer_percent is not None else time_s

    if strategy is Strategy.OPTIMAL:
        section, front, min_time_s, front_s = _front(pose)
        began = time.perf_counter()
        solution = front.trajectory(wanted_s(min_time_s))
        return section, solution, min_time_s, front_s + time.perf_counter() - began
    with busy(COMPILING):
        from precompute.baselines import strategies as baselines

        section = pose.section()
        baselines.warm_up()
    began = time.perf_counter()
    with busy(f"searching the {strategy} run …"):
        min_time_s = baselines.fastest(section).time_s
        run = baselines.baseline(strategy, section, wanted_s(min_time_s))
    return section, run, min_time_s, time.perf_counter() - began


def _front(pose: Pose) -> tuple[Any, Any, float, float]:
    """Section, front, least time, and the seconds the front took once everything was compiled."""
    with busy(COMPILING):
        from das.solver.solve import solve_front
        from das.solver.warm_up import warm_up

        section = pose.section()
        warm_up()
    began = time.perf_counter()
    with busy("solving …"):
        solved = solve_front(section)
        min_time_s = solved.fastest().time_s
    return section, solved, min_time_s, time.perf_counter() - began


def _print_solutions(title: str, results: list[dict[str, Any]]) -> None:
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    names = ("time s", "buffer %", "input kWh", "lost kWh", "saved %", "λ kW", "gap %", "ms", "fit")
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    first = results[0]["energy_input_kwh"]
    for result in results:
        buffer = 100 * (result["time_s"] / result["min_time_s"] - 1)
        table.add_row(
            f"{result['time_s']:.1f}",
            f"{buffer:.2f}",
            f"{result['energy_input_kwh']:.2f}",
            f"{result['energy_irreversible_kwh']:.2f}",
            f"{100 * (1 - result['energy_input_kwh'] / first):.1f}" if len(results) > 1 and first else "–",
            _price(result),
            f"{100 * result['gap_ratio']:.3f}" if result["gap_ratio"] is not None else "–",
            f"{1e3 * result['solve_s']:.0f}",
            result["fit"],
        )
    print_table(table)


def _price(result: dict[str, Any]) -> str:
    if result["strategy"] != Strategy.OPTIMAL:
        return "–"
    return f"{result['lambda_kw']:.0f}" if result["lambda_kw"] is not None else "∞"


def _print_parameters(result: dict[str, Any]) -> None:
    """The cruising speed and switching points of a baseline."""
    if result["cruise_speed_mps"] is not None:
        print(f"holds {result['cruise_speed_mps'] / KMH:.1f} km/h")
    for start_m, end_m in result["coasting_m"] or ():
        print(f"coasts from km {start_m / KM:.3f} to km {end_m / KM:.3f}")


app.command(epilog="Example: das-precompute study -o study --only fig9,table2")(study)
app.command(
    epilog="Examples: das-precompute build plan.toml -o tables; "
    "das-precompute build plan.toml -o tables --scheduler tcp://10.0.0.1:8786"
)(build)
app.command(epilog="Example: das-precompute verify tables")(verify)
app.command(epilog="Example: das-precompute show tables --json")(show)
app.command("calibrate", epilog="Example: das-precompute calibrate --check")(calibrate)
app.command("journey", epilog=EXAMPLES)(journey_command)
app.command(epilog="Example: das-precompute bench --only front,trajectory --json")(bench)
app.command("loss-map", epilog="Example: das-precompute loss-map re460-ic --plot map.png")(loss_map_command)
app.command(epilog="Example: das-precompute sensitivity zurich-luzern re460-ic --from Zug --to Luzern --buffer 7")(
    sensitivity
)


def main() -> None:
    """Entry point of das-precompute."""
    interrupt_on_termination()
    run_app(app)


if __name__ == "__main__":
    main()
