"""The command `das-precompute sensitivity`."""

from __future__ import annotations

import csv as csv_rows
import io
import json
import math
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from das.command_line.running import busy, err, print_table
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, write_whole
from das.domain.units import kwh
from das.solver.section import Section
from das.solver.solution import Solution
from das.solver.solve import solve_front
from das.solver.warm_up import warm_up
from precompute.cli import report
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
from precompute.sensitivity.analysis import Followed, Outcome, World, assess, by_effect
from precompute.sensitivity.picture import draw_tornado, require_matplotlib
from precompute.sensitivity.variations import DEFAULT, Parameter, Variation, parse_variations

COLUMNS: dict[str, tuple[str, float, str]] = {
    "time\n+s": ("late_s", 1.0, "+z.1f"),
    "energy\n+%": ("extra_ratio", 100.0, "+z.2f"),
    "s per %\nor km/h": ("late_s_per_step", 1.0, "+z.3f"),
    "% per %\nor km/h": ("extra_ratio_per_step", 100.0, "+z.3f"),
    "off plan\n% of way": ("off_plan_ratio", 100.0, ".0f"),
    "on time:\n+s": ("on_time_late_s", 1.0, "+z.1f"),
    "on time:\nenergy +%": ("on_time_extra_ratio", 100.0, "+z.2f"),
    "saved\n%": ("saved_ratio", 100.0, "z.2f"),
}
"""Heading of a column, its key in a row, factor and format."""


def sensitivity(
    route: RouteArgument,
    vehicle: VehicleArgument,
    time_s: Annotated[float | None, typer.Option("--time", help="Planned trip time in s.")] = None,
    buffer_percent: Annotated[
        float | None, typer.Option("--buffer", help="Planned trip time as % above the least possible.")
    ] = None,
    vary: Annotated[
        str | None,
        typer.Option(
            help="What differs from the plan: mass and resistance by %, head wind in km/h (tail wind < 0), receptivity "
            f"and adhesion as ratios; ± is both ways, a..b five values [default: {DEFAULT}].",
            show_default=False,
        ),
    ] = None,
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
    csv: Annotated[Path | None, typer.Option(help="Write one row a variation as CSV.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture (PNG), the largest effect on top.")] = None,
) -> None:
    """How time and energy of a planned run move when train, wind, line or rail differ from the plan.

    The plan is the least-energy run under the options given. The driver follows its speeds over the way in the changed
    world as well as the train can, and brakes as early as the changed train needs. Beside it: what planning anew would
    give there, for the planned time ("on time": how late the fastest run is, energy) and for the time that following
    the plan took ("saved": what the stale plan wastes). All % are of the plan's energy at the current collector.
    """
    if (time_s is None) is (buffer_percent is None):
        raise DasError("give either --time (s) or --buffer (%)")
    pose = posed(locals())
    _check_files(csv, plot)
    variations, left_out = _variations(pose, vary)
    section, plan, planned = _plan(pose, time_s, buffer_percent)
    pairs = by_effect(_outcomes(plan, variations, pose.section))
    rows = [_row(outcome) for pair in pairs for outcome in pair]
    if csv is not None:
        _write_csv(csv, rows)
    if plot is not None:
        draw_tornado(plot, section, plan, pairs)
    if as_json:
        print(json.dumps({"section": section.name, "plan": planned, "variations": rows, "left_out": left_out}))
        return
    _print(section, planned, rows)
    for line in [*left_out, *(f"written: {path}" for path in (csv, plot) if path is not None)]:
        print(line)


def _check_files(csv: Path | None, plot: Path | None) -> None:
    """Everything that writing needs, before the work begins."""
    if csv is not None and csv == plot:
        raise DasError(f"{csv}: --csv and --plot name the same file")
    for path in (csv, plot):
        if path is not None:
            check_writable(path)
    if plot is not None:
        require_matplotlib()


def _variations(pose: Pose, vary: str | None) -> tuple[list[Variation], list[str]]:
    """What to vary, and a line for what the default had to leave out."""
    plan, vehicle = pose.conditions(), pose.train()
    variations = parse_variations(DEFAULT if vary is None else vary, plan)
    if vary is not None:
        for variation in variations:
            if variation.parameter is Parameter.ADHESION:
                variation.conditions.train(vehicle)  # raises where the train has no data of it
        return variations, []
    variations = [x for x in variations if x.conditions != plan]
    if math.isfinite(vehicle.adhesive_mass_kg):
        return variations, []
    left_out = f"adhesion: left out, {vehicle.id} has no data of it ([adhesion] in its file)"
    return [x for x in variations if x.parameter is not Parameter.ADHESION], [left_out]


def _plan(pose: Pose, time_s: float | None, buffer_percent: float | None) -> tuple[Section, Solution, dict[str, Any]]:
    """The section, the plan, and the plan as JSON."""
    with busy(COMPILING):
        section = pose.section()
        warm_up()
    began = time.perf_counter()
    with busy("solving …"):
        front = solve_front(section)
        min_time_s = front.fastest().time_s
        plan = front.trajectory(buffered(min_time_s, buffer_percent) if time_s is None else time_s)
    return section, plan, report.solution_json(plan, min_time_s, time.perf_counter() - began)


def _outcomes(plan: Solution, variations: list[Variation], world: World) -> list[Outcome]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    outcomes = []
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as progress:
        task = progress.add_task("", total=len(variations))
        for variation in variations:
            progress.update(task, description=variation.label)
            outcomes.append(assess(plan, variation, world))
            progress.advance(task)
    return outcomes


def _row(outcome: Outcome) -> dict[str, Any]:
    """One variation as `--json` and `--csv` give it; what there is not is null."""
    variation, followed = outcome.variation, outcome.followed
    return {
        "parameter": str(variation.parameter),
        "label": variation.label,
        "value": variation.value,
        "step": variation.step,
        "step_unit": variation.unit,
        "followed": followed is not None,
        "trouble": outcome.trouble,
        **_run("", followed),
        "late_s": outcome.late_s,
        "extra_ratio": outcome.extra_ratio,
        "late_s_per_step": outcome.per_step(outcome.late_s),
        "extra_ratio_per_step": outcome.per_step(outcome.extra_ratio),
        "off_plan_ratio": followed.off_plan_ratio if followed else None,
        **_run("on_time_", outcome.on_time),
        "on_time_late_s": outcome.on_time_late_s,
        "on_time_extra_ratio": outcome.on_time_extra_ratio,
        **_run("same_time_", outcome.same_time),
        "saved_ratio": outcome.saved_ratio,
    }


def _run(prefix: str, run: Followed | Solution | None) -> dict[str, float | None]:
    return {
        f"{prefix}time_s": run.time_s if run else None,
        f"{prefix}energy_input_kwh": kwh(run.ledger.input) if run else None,
    }


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv_rows.DictWriter(text, rows[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue().encode())


def _print(section: Section, planned: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    table = Table(title=f"{section.name}, the plan in a changed world", title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("changed\n", no_wrap=True)
    for name in COLUMNS:
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(row["label"], *(_figure(row, *what) for what in COLUMNS.values()))
    print_table(table)
    buffer_percent = 100 * (planned["time_s"] / planned["min_time_s"] - 1)
    print(
        f"plan: {planned['time_s']:.1f} s (buffer {buffer_percent:.2f} %, {planned['fit']}), "
        f"{planned['energy_input_kwh']:.2f} kWh; % of energy are of these"
    )
    for row in rows:
        if row["trouble"] is not None:
            print(f"{row['label']}: {row['trouble']}")


def _figure(row: dict[str, Any], name: str, scale: float, form: str) -> str:
    value = row[name]
    return f"{scale * value:{form}}" if value is not None else "–"
