"""The command make-scenario, which writes a scenario for a line and a train of the user's own."""

from __future__ import annotations

import os
import re
import shlex
import tomllib
from pathlib import Path
from typing import Annotated

import typer

from das.command_line.files import check_outputs, load_route, load_vehicle
from das.command_line.options import OverwriteOption, ReverseOption, RouteOption, VehicleOption
from das.command_line.printing import busy, tell, typed
from das.domain.errors import DasError
from das.domain.files.writing import toml_string, write_whole

_JOURNEY = """\
[timetable]
departure = "2026-11-21T08:00:00Z"  # says the day; the journey has the times of day
"""
_BUFFER = """\
[timetable]
departure = "2026-11-21T08:00:00Z"
buffer_percent = 8  # above the least running time, braked in service
dwell_s = 60  # at every stop on the way
"""
_DISTURBANCE = """\
# What may happen, a table for each:
# [[disturbances]]
# kind = "departure-delay"
# stop = {stop}
# delay_s = {{ min = 20, max = 60 }}
"""


def make_scenario(
    route: RouteOption,
    vehicle: VehicleOption,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Scenario (.toml) to write.")],
    journey: Annotated[
        str | None,
        typer.Option("--journey", metavar="FILE", help="Stops and times of a journey file [default: every stop]."),
    ] = None,
    reverse: ReverseOption = False,
    overwrite: OverwriteOption = False,
) -> None:
    """Write a scenario for your own line and train: a run to simulate, with a journey's times or a buffer."""
    if out.suffix != ".toml":
        raise DasError(f"{out}: expected a file name that ends in .toml")
    check_outputs(out, inputs=(route, vehicle, journey), overwrite=overwrite)
    with busy("reading line and train …"):
        from das.domain.files.reading import Fields
        from sim.world.scenario import scenario_of
        from sim.world.service import lay_out

        title = f"{load_route(route).name}, {load_vehicle(vehicle).name}"
        text = scenario_text(title, {"route": route, "vehicle": vehicle, "journey": journey}, out, reverse=reverse)
        _, _, stops = lay_out(scenario_of(Fields.of(out, tomllib.loads(text))))
        write_whole(out, (text + _DISTURBANCE.format(stop=toml_string(stops[0].name))).encode())
    tell(f"written: {out}: {title}, {len(stops)} stops from {stops[0].name} to {stops[-1].name}")
    tell(f"drive it: {typed('das-sim')} run {shlex.quote(str(out))}")


def scenario_text(title: str, named: dict[str, str | None], out: Path, *, reverse: bool) -> str:
    """The scenario as TOML; the files it names (bundled names stay) are found from the folder of `out`."""
    folder = out.resolve().parent
    lines = [
        "# Made by das-sim make-scenario. All keys: docs/reference/scenarios.md",
        "schema_version = 1\n",
        "[scenario]",
        f"id = {toml_string(re.sub('[^A-Za-z0-9_.-]', '-', out.stem)[:64].lstrip('.-') or 'day')}",
        f"title = {toml_string(title)}",
    ]
    for key, name in named.items():
        if name is not None:
            place = os.path.relpath(Path(name).resolve(), folder) if Path(name).suffix else name
            lines.append(f"{key} = {toml_string(Path(place).as_posix())}")
    lines += ["reverse = true"] if reverse else []
    return "\n".join([*lines, "", _BUFFER if named["journey"] is None else _JOURNEY, ""])
