"""The command example: a set of example files, or a scenario for a line and a train of the user's own."""

from __future__ import annotations

import os
import re
import shlex
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import typer

from das.command_line.application import refuse_given
from das.command_line.files import check_outputs, load_route, load_vehicle
from das.command_line.options import FromOption, OverwriteOption, ReverseOption, ToOption
from das.command_line.printing import busy, tell, typed
from das.domain.errors import DasError
from das.domain.files.writing import check_writable, toml_string, write_folder_whole, write_whole
from sim.bundled import example_files

BUFFER_PERCENT, DWELL_S, DEPARTURE = 8.0, 60.0, "2026-11-21T08:00:00Z"
"""Default timetable of a scenario."""
OF_SCENARIOS: Final = (*("--journey", "--reverse", "--from", "--to", "--buffer", "--dwell", "--departure"),)
_JOURNEY = """\
[timetable]
departure = {departure}  # the day; the journey has the times of day
"""
_BUFFER = """\
[timetable]
departure = {departure}
buffer_percent = {buffer:g}  # above the least running time, braked in service
dwell_s = {dwell:g}  # at every stop on the way
"""
_DISTURBANCE = """\
# What may happen, a table for each:
# [[disturbances]]
# kind = "departure-delay"
# stop = {stop}
# delay_s = {{ min = 20, max = 60 }}
"""


@dataclass(frozen=True, kw_only=True)
class OwnScenario:
    """Options for line, train and timetable of a scenario; without line and train, example files are written."""

    route: Annotated[
        str | None, typer.Option(metavar="ROUTE", help="Write a scenario for this line (bundled, or a file).")
    ] = None
    vehicle: Annotated[
        str | None, typer.Option(metavar="VEHICLE", help="Train of the scenario (bundled, or a file).")
    ] = None
    journey: Annotated[
        str | None,
        typer.Option("--journey", metavar="FILE", help="Stops and times of a journey file [default: every stop]."),
    ] = None
    reverse: ReverseOption = False
    start: FromOption = None
    end: ToOption = None
    buffer_percent: Annotated[
        float,
        typer.Option("--buffer", metavar="PERCENT", min=0.0, max=1000.0, help="Running time above the least, in %."),
    ] = BUFFER_PERCENT
    dwell_s: Annotated[
        float, typer.Option("--dwell", metavar="S", min=0.0, help="Dwell at every stop on the way in s.")
    ] = DWELL_S
    departure: Annotated[str, typer.Option("--departure", metavar="TIME", help="Departure, with its zone.")] = DEPARTURE

    def check(self, out: Path, *, overwrite: bool) -> None:
        """Raise DasError for options that do not go together, and for a file that cannot be written."""
        if self.route is None or self.vehicle is None:
            raise DasError("a scenario needs --route and --vehicle")
        if self.journey is not None:
            refuse_given("the journey has stops and times of its own", "--from", "--to", "--buffer", "--dwell")
        if out.suffix != ".toml":
            raise DasError(f"{out}: expected a file name that ends in .toml")
        check_outputs(out, inputs=(self.route, self.vehicle, self.journey), overwrite=overwrite)

    def text(self, title: str, out: Path) -> str:
        """The scenario as TOML; paths are relative to the folder of `out`, names of bundled files stay."""
        folder = out.resolve().parent
        lines = [
            "# Made by das-sim example. All keys: docs/reference/scenarios.md",
            "schema_version = 1\n",
            "[scenario]",
            f"id = {toml_string(re.sub('[^A-Za-z0-9_.-]', '-', out.stem)[:64].lstrip('.-') or 'day')}",
            f"title = {toml_string(title)}",
        ]
        for key, name in (("route", self.route), ("vehicle", self.vehicle), ("journey", self.journey)):
            if name is not None:
                place = os.path.relpath(Path(name).resolve(), folder) if Path(name).suffix else name
                lines.append(f"{key} = {toml_string(Path(place).as_posix())}")
        lines += [f"{key} = {toml_string(name)}" for key, name in (("from", self.start), ("to", self.end)) if name]
        lines += ["reverse = true"] if self.reverse else []
        timetable = (_BUFFER if self.journey is None else _JOURNEY).format(
            departure=toml_string(self.departure), buffer=self.buffer_percent, dwell=self.dwell_s
        )
        return "\n".join([*lines, "", timetable, ""])


def example(
    out: Annotated[
        Path, typer.Argument(metavar="DIR|SCENARIO.toml", help="Folder (new or empty) or scenario to write.")
    ],
    own: OwnScenario,
    overwrite: OverwriteOption = False,
) -> None:
    """Write example files for a line of your own; or with --route and --vehicle, a scenario.

    The set of files holds a route, a vehicle, a journey, a plan of tables, a scenario, a recorded trip, kilometre posts
    and a README.txt with the commands to run on them. Route and vehicle are invented; the trip is simulated.

    A scenario describes simulated runs on a line of your own, timed by a journey or with a buffer.
    """
    if own.route is None and own.vehicle is None:
        refuse_given("needs --route and --vehicle", *OF_SCENARIOS)
        _write_example(out, overwrite=overwrite)
    else:
        _write_scenario(out, own, overwrite=overwrite)


def _write_scenario(out: Path, own: OwnScenario, *, overwrite: bool) -> None:
    own.check(out, overwrite=overwrite)
    with busy("reading line and train …"):
        from das.domain.files.reading import Fields
        from sim.world.scenario import scenario_of
        from sim.world.service import lay_out

        title = f"{load_route(str(own.route)).name}, {load_vehicle(str(own.vehicle)).name}"
        text = own.text(title, out)
        _, _, stops = lay_out(scenario_of(Fields.of(out, tomllib.loads(text))))
        write_whole(out, (text + _DISTURBANCE.format(stop=toml_string(stops[0].name))).encode())
    tell(f"written: {out}: {title}, {len(stops)} stops from {stops[0].name} to {stops[-1].name}")
    tell(f"run it: {typed('das-sim')} run {shlex.quote(str(out))}")


def _write_example(folder: Path, *, overwrite: bool) -> None:
    filled = _check_example(folder, overwrite)
    content = example_files()
    if filled:
        for name in content:
            check_writable(folder / name, overwrite=True)
        for name, data in content.items():
            write_whole(folder / name, data)
    else:
        write_folder_whole(folder, content)
    for name in sorted(content):
        tell(f"written: {folder / name}")
    tell(f"what to do with them: cd {shlex.quote(str(folder))} and read README.txt")


def _check_example(folder: Path, overwrite: bool) -> bool:
    if not folder.resolve().parent.is_dir():
        raise DasError(f"{folder}: no such folder {folder.parent}")
    if not folder.exists():
        return False
    if not folder.is_dir():
        raise DasError(f"{folder}: is a file, expected a folder to write")
    try:
        filled = any(folder.iterdir())
    except OSError as error:
        raise DasError(f"{folder}: cannot be read ({error.strerror})") from error
    if filled and not overwrite:
        raise DasError(f"{folder}: there are files in it already; choose a new folder, or say --overwrite")
    return filled
