"""The commands below `das-precompute vehicle`: import, show, check and new, for vehicle files."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final

import typer

from das.command_line.application import Entry
from das.command_line.files import load_vehicle
from das.command_line.options import JsonOption, LoadOption, ModeOption, VehicleArgument
from das.command_line.printing import print_table, tell, typed, warn
from das.domain.errors import DasError
from das.domain.units import TONNE, kmh
from precompute.cli.files import MadeFile, ShownFiles, end_check
from precompute.cli.options import picked
from precompute.vehicle_import.figures import Figures

COMMANDS: Final = (
    Entry(
        name="import",
        where="precompute.cli.vehicle_files:import_vehicle",
        summary="Make a vehicle file from rolling stock of OSRD or railtoolkit, or from a table of efforts.",
        examples=(
            "das-precompute vehicle import STOCK.json -o train.toml --losses re460-ic",
            "das-precompute vehicle import TRAIN.yaml -o train.toml --losses 0.85",
        ),
    ),
    Entry(
        name="show",
        where="precompute.cli.vehicle_files:show_vehicle",
        summary="Show forces, resistance, losses and the energy of cruising of a train, as a table and as a picture.",
        examples=("das-precompute vehicle show re460-ic --plot train.png",),
    ),
    Entry(
        name="check",
        where="precompute.cli.vehicle_files:check_vehicle",
        summary="Check a vehicle file for unusual values, in every mode and load.",
        examples=("das-precompute vehicle check re460-ic",),
    ),
    Entry(
        name="new",
        where="precompute.cli.vehicle_files:new_vehicle",
        summary="Write a vehicle file to fill in: every key with its meaning.",
        examples=("das-precompute vehicle new -o train.toml",),
    ),
)


@dataclass(frozen=True, kw_only=True)
class VehicleFile(MadeFile):
    """The vehicle file that a command makes."""

    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Vehicle file to write (.toml).")] = field()


@dataclass(frozen=True, kw_only=True)
class AssumedOptions:
    """What the files of other programs do not hold, and what in them is taken."""

    losses: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Losses of the traction chain: lossless, a mean efficiency like 0.85, or a vehicle (bundled name or "
            "file) with the same efficiency.",
        ),
    ] = None
    train: Annotated[
        str | None, typer.Option(metavar="ID", help="Train of a railtoolkit file [default: the first].")
    ] = None
    electric_brake: Annotated[
        float | None,
        typer.Option(metavar="RATIO", help="Add an electric brake with this share of the tractive effort."),
    ] = None
    accept: Annotated[
        list[str] | None, typer.Option(metavar="CHECK", help="Accept an implausible value; the error names the check.")
    ] = None


def import_vehicle(
    source: Annotated[
        Path, typer.Argument(metavar="FILE", help="Rolling stock (.json, .yaml), or a table (.csv, .yaml).")
    ],
    assumed: AssumedOptions,
    figures: Figures,
    written: VehicleFile,
) -> None:
    """Make a vehicle file from rolling stock of OSRD or railtoolkit, or from a table of efforts.

    These files give no losses, and mostly no electric brake. What is assumed instead is printed, and written in the
    file. The modes of a train (voltage, comfort) become modes of the vehicle: --mode picks one.
    """
    if assumed.losses is None:
        known = "lossless, a mean efficiency like 0.85, or a vehicle like re460-ic"
        raise DasError(f"--losses is missing: {source.name} gives no losses; expected {known}")
    written.check(source, assumed.losses)
    from precompute.vehicle_import.importing import import_train

    found = import_train(
        source,
        assumed.losses,
        figures,
        train_id=assumed.train,
        electric_brake=assumed.electric_brake,
        accepted=assumed.accept or (),
    )
    made = found.vehicle
    modes = f", modes: {len(made.modes)}, default {made.mode}" if made.modes else ""
    about = f"{made.name}, {made.mass_kg / TONNE:.4g} t, {kmh(made.max_speed_mps):.4g} km/h{modes}"
    written.write(found.text, found.notes, about)
    tell(f"look at it: {typed('das-precompute')} vehicle show {written.out} --plot train.png")


def show_vehicle(
    vehicle: VehicleArgument, *, mode: ModeOption = None, load: LoadOption = None, files: ShownFiles
) -> None:
    """Show forces, resistance, losses and the energy of cruising of a train, as a table and as a picture.

    Forces are those on a dry rail; the energy of cruising is that per kilometre on a level straight line.
    """
    files.check(vehicle)
    from precompute.cli import vehicle_report

    train = picked(load_vehicle(vehicle), mode, load)

    if files.plot is not None:
        from precompute.drawing.train import draw_train

        draw_train(train).save(files.plot, overwrite=True)
    if files.as_json:
        print(json.dumps(vehicle_report.as_dict(train)))
        return
    for line in vehicle_report.facts(train):
        tell(line)
    print_table(vehicle_report.table(train), vehicle_report.LEGEND)
    files.tell()


def check_vehicle(vehicle: VehicleArgument, as_json: JsonOption = False) -> None:
    """Check a vehicle file for unusual values, in every mode and load.

    The exit code is 1 if there are warnings, and 2 if the file cannot be used.
    """
    from das.domain.files.load import load_vehicle
    from precompute.cli import vehicle_report

    train = load_vehicle(vehicle)
    found = vehicle_report.warnings(train)

    def show() -> None:
        for text in found:
            warn(text)
        tell(f"{train.source}: modes: {len(train.modes)}, loads: {len(train.loads)}, warnings: {len(found)}")

    end_check(found, show, as_json=as_json)


def new_vehicle(written: VehicleFile) -> None:
    """Write a vehicle file to fill in: every key with its meaning.

    Its figures are those of no real train; replace them.
    """
    written.check()
    from precompute.cli.vehicle_report import TEMPLATE

    written.write(TEMPLATE)
    tell(f"fill it in, then: {typed('das-precompute')} vehicle check {written.out}")
