"""The command `das-precompute sensitivity`."""

from __future__ import annotations

import csv
import io
import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from das.command_line.files import offscreen_pyplot, save_figure
from das.command_line.printing import busy, loading_solver, new_table, paragraph, print_table, shown, tell
from das.domain.files.writing import write_whole
from das.domain.units import kwh
from das.drawing.colors import SEVERAL
from precompute.cli.files import TableFiles
from precompute.cli.options import Pose, TripTime

if TYPE_CHECKING:
    from das.solver.section import Section
    from das.solver.solution import Solution
    from precompute.sensitivity import Followed, Variation, VariationOutcome

DEFAULT = "mass=±5%,±10%, resistance=±10%,±20%, wind=-20..20, receptivity=0.5,0, adhesion=0.6,0.3"
"""Variations unless the user gives others."""


def sensitivity(
    pose: Pose,
    trip: TripTime,
    files: TableFiles,
    vary: Annotated[
        str | None,
        typer.Option(
            "--vary",
            metavar="LIST",
            help="Differences from the plan: mass and resistance by %, head wind in km/h (tail wind < 0), receptivity "
            f"and adhesion as ratios; ± means both signs, a..b five values [default: {DEFAULT}].",
        ),
    ] = None,
) -> None:
    """Show how time and energy of a planned run change when train, wind, line or rail differ from the plan.

    The plan is the least-energy run under the options given. In the changed world the driver follows its speed profile
    as well as the train can, and brakes as early as the changed train needs. Beside it stands what replanning would
    give there, for the planned time ("on time") and for the time that following the plan took ("saved": what the stale
    plan wastes). All % are of the plan's energy at the current collector.
    """
    trip.check(needed=True)
    files.check(*pose.inputs())
    if files.plot is not None:
        offscreen_pyplot()  # refuse before the work begins
    with loading_solver():
        from precompute.sensitivity import assess, by_effect
    variations, left_out = _variations(pose, vary)
    section, plan, planned = _plan(pose, trip)
    outcomes = [assess(plan, one, pose.section) for one in shown(variations, lambda one: one.label)]
    pairs = by_effect(outcomes)
    rows = [outcome_row(outcome) for pair in pairs for outcome in pair]
    if files.out is not None:
        write_csv(files.out, rows)
    if files.plot is not None:
        draw_tornado(files.plot, section, plan, pairs)
    if files.as_json:
        print(json.dumps({"section": section.name, "plan": planned, "variations": rows, "left_out": left_out}))
        return
    print_rows(section, planned, rows)
    for line in left_out:
        tell(line)
    files.tell()


def _variations(pose: Pose, vary: str | None) -> tuple[list[Variation], list[str]]:
    """The variations, and a note about each default variation that is left out."""
    from precompute.sensitivity import Parameter, parse_variations

    plan, vehicle = pose.conditions(), pose.vehicle()
    variations = parse_variations(DEFAULT if vary is None else vary, plan)
    if vary is not None:
        for variation in variations:
            if variation.parameter is Parameter.ADHESION:
                variation.conditions.train(vehicle)  # raises if the train has no data on it
        return variations, []
    variations = [x for x in variations if x.conditions != plan]
    if math.isfinite(vehicle.adhesive_mass_kg):
        return variations, []
    left_out = f"adhesion: left out, {vehicle.id} has no data of it ([adhesion] in its file)"
    return [x for x in variations if x.parameter is not Parameter.ADHESION], [left_out]


def _plan(pose: Pose, trip: TripTime) -> tuple[Section, Solution, dict[str, Any]]:
    """The section, the plan, and the plan as JSON."""
    from precompute.cli.report import solution_json
    from precompute.cli.solve import solved_front

    section, front, min_time_s, front_s = solved_front(pose)
    began = time.perf_counter()
    with busy("solving …"):
        wanted_s = trip.wanted_s(min_time_s)
        assert wanted_s is not None
        plan = front.trajectory(wanted_s)
    return section, plan, solution_json(plan, min_time_s, front_s + time.perf_counter() - began)


COLUMNS: dict[str, tuple[str, float, str]] = {
    "time\n+s": ("late_s", 1.0, "+z.1f"),
    "energy\n+%": ("extra_ratio", 100.0, "+z.2f"),
    "s per\nstep": ("late_s_per_step", 1.0, "+z.3f"),
    "% per\nstep": ("extra_ratio_per_step", 100.0, "+z.3f"),
    "off\nplan\n%": ("off_plan_ratio", 100.0, ".0f"),
    "on time\n+s": ("on_time_late_s", 1.0, "+z.1f"),
    "on time\n+%": ("on_time_extra_ratio", 100.0, "+z.2f"),
    "saved\n%": ("saved_ratio", 100.0, "z.2f"),
}
"""Heading of a column, its key in a row, factor and format."""
LEGEND = {
    "time, energy": "for a driver who follows the plan, relative to the plan",
    "per step": "the same for 1 % of mass, resistance, receptivity or adhesion, or for 1 km/h of wind",
    "off plan": "share of the distance on which the train could not follow the plan",
    "on time": "a new plan for the planned time: its lateness and its energy, relative to the plan",
    "saved": "by a new plan for the time taken by following the old one",
}


def outcome_row(outcome: VariationOutcome) -> dict[str, Any]:
    """One variation as `--json` and `--out` give it; figures that do not exist are null."""
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
        f"{prefix}energy_kwh": kwh(run.balance.input) if run else None,
    }


def write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write the rows of `outcome_row` as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(path, text.getvalue().encode())


def print_rows(section: Section, planned: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    """Print the rows of `outcome_row` as a table with its legend, then the plan that they are compared with."""
    table = new_table(f"{section.name}, the plan in a changed world", ("changed",), COLUMNS)
    table.columns[0].no_wrap = True
    for row in rows:
        table.add_row(row["label"], *(_figure(row, *what) for what in COLUMNS.values()))
    print_table(table, LEGEND)
    buffer_percent = 100 * (planned["time_s"] / planned["min_time_s"] - 1)
    paragraph(
        f"plan: {planned['time_s']:.1f} s (buffer {buffer_percent:.2f} %, {planned['fit']}), "
        f"{planned['energy_kwh']:.2f} kWh; % of energy are of these"
    )
    for row in rows:
        if row["trouble"] is not None:
            tell(f"{row['label']}: {row['trouble']}")


def _figure(row: dict[str, Any], name: str, scale: float, form: str) -> str:
    value = row[name]
    return f"{scale * value:{form}}" if value is not None else "–"


LESS, MORE = SEVERAL[:2]
"""Colours of less and of more than planned."""
MARK = "0.1"
"""Colour of the mark of a new plan."""
BAR_HEIGHT = 0.36
"""Height of a bar; each row has a height of 1 and two bars."""
ROOM = 0.16
"""Share of the bars' span by which the axis extends beyond them, so that the figures at their ends fit."""

SHOWN = 0.05
"""Number below which 0.0 is printed."""


class _Bar(NamedTuple):
    """A bar at height y, for a parameter below or above the plan's value; None: nothing to draw."""

    y: float
    below: bool
    value: float | None
    mark: float | None


def draw_tornado(path: Path, section: Section, plan: Solution, pairs: list[list[VariationOutcome]]) -> None:
    """Write bars of time and energy against the plan as a picture, one row for each pair of variations."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 1.8 + 0.5 * len(pairs)), layout="constrained")
    energy, time = figure.subplots(1, 2, sharey=True)
    _draw_bars(energy, pairs, "extra_ratio", "on_time_extra_ratio", 100.0)
    _draw_bars(time, pairs, "late_s", "on_time_late_s", 1.0)
    energy.set_xlabel("energy against the plan, %")
    time.set_xlabel("time against the plan, s")
    energy.set_yticks(range(len(pairs)), [_pair_label(pair) for pair in pairs])
    energy.set_ylim(len(pairs) - 0.4, -0.6)
    figure.suptitle(
        f"{section.route.name}, {section.vehicle.name}, level {section.level}: driven by a plan of "
        f"{plan.time_s:.1f} s, {kwh(plan.balance.input):.2f} kWh"
        + (f"\ndata: {section.route.credit}" if section.route.credit else "")
    )
    figure.legend(handles=_handles(), loc="outside lower center", ncols=3, frameon=False)
    save_figure(path, figure)


def _draw_bars(axes: Any, pairs: list[list[VariationOutcome]], effect: str, replanned: str, scale: float) -> None:
    """A bar for each outcome, as long as its attribute `effect`, and a mark at its attribute `replanned`."""
    bars = []
    for row, pair in enumerate(pairs):
        heights = [row] if len(pair) == 1 else [row - BAR_HEIGHT / 2, row + BAR_HEIGHT / 2]
        for outcome, y in zip(pair, heights, strict=True):
            values = (getattr(outcome, name) for name in (effect, replanned))
            scaled = (None if value is None else scale * value for value in values)
            bars.append(_Bar(y, outcome.variation.step < 0, *scaled))
    ends = [0.0, *(x for bar in bars for x in (bar.value, bar.mark) if x is not None)]
    room = ROOM * (max(ends) - min(ends) or 1.0)
    axes.set_xlim(min(ends) - room, max(ends) + room)
    for bar in bars:
        _draw_bar(axes, bar, room)
    axes.axvline(0, color="0.3", linewidth=0.8)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)


def _draw_bar(axes: Any, bar: _Bar, room: float) -> None:
    if bar.mark is not None:
        axes.plot(bar.mark, bar.y, marker="|", markersize=11, markeredgewidth=2, color=MARK)
    colour = LESS if bar.below else MORE
    end, side = bar.value or 0.0, -1 if bar.value is not None and bar.value < -SHOWN else 1
    axes.barh(bar.y, end, BAR_HEIGHT, color=colour)
    if bar.mark is not None and 0 < side * (bar.mark - end) < room:
        end = bar.mark  # the figure would lie on the mark
    text = "not driven" if bar.value is None else f"{bar.value:+z.1f}".replace("-", "−")
    axes.annotate(
        text,
        (end, bar.y),
        (7 * side, 0),
        textcoords="offset points",
        ha="right" if side < 0 else "left",
        va="center",
        fontsize=8.5,
        color="black" if bar.value is not None else colour,
    )


def _pair_label(pair: list[VariationOutcome]) -> str:
    first, last = pair[0].variation, pair[-1].variation
    if first.value == -last.value and len(pair) > 1:
        return f"{last.parameter} ±{last.value:g} {last.unit}"
    return " / ".join(outcome.variation.label for outcome in pair).replace("-", "−")


def _handles() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    mark = Line2D([], [], color=MARK, marker="|", markersize=11, markeredgewidth=2, linestyle="none")
    mark.set_label("replanned for the planned time")
    return [
        Patch(color=LESS, label="parameter below the plan's"),
        Patch(color=MORE, label="parameter above the plan's"),
        mark,
    ]
