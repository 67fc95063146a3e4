"""The commands below `das-precompute vehicle`: import, show, check and new, for vehicle files."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from das.command_line.application import Entry
from das.command_line.files import check_outputs, check_picture, load_vehicle
from das.command_line.options import JsonOption, LoadOption, ModeOption, OverwriteOption, PlotOption, VehicleArgument
from das.command_line.printing import print_table, tell, typed, warn
from das.domain.errors import DasError
from das.domain.units import TONNE, kmh
from precompute.vehicle_import.figures import Figures

if TYPE_CHECKING:
    from das.domain.vehicle import Vehicle

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
        summary="Check a vehicle file, in every mode and load: what is unusual in it.",
        examples=("das-precompute vehicle check re460-ic",),
    ),
    Entry(
        name="new",
        where="precompute.cli.vehicle_files:new_vehicle",
        summary="Write a vehicle file to fill in: every key with its meaning.",
        examples=("das-precompute vehicle new -o train.toml",),
    ),
)

OutVehicleOption = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Vehicle file to write (.toml).")]


@dataclass(frozen=True, kw_only=True)
class AssumedOptions:
    """What the files of other programs do not hold, and what in them is taken."""

    losses: Annotated[
        str | None,
        typer.Option(
            "--losses",
            metavar="NAME",
            help="Losses of the traction chain: lossless, a mean efficiency like 0.85, or the vehicle (bundled name or "
            "file) whose efficiency the train has.",
        ),
    ] = None
    train: Annotated[
        str | None, typer.Option("--train", metavar="ID", help="Train of a railtoolkit file [default: the first].")
    ] = None
    electric_brake: Annotated[
        float | None,
        typer.Option(
            "--electric-brake", metavar="RATIO", help="Give it an electric brake: this share of the traction."
        ),
    ] = None
    accept: Annotated[
        list[str] | None,
        typer.Option("--accept", metavar="CHECK", help="Accept an implausible value; the error names the check."),
    ] = None


def import_vehicle(
    source: Annotated[
        Path, typer.Argument(metavar="FILE", help="Rolling stock (.json, .yaml), or a table (.csv, .yaml).")
    ],
    out: OutVehicleOption,
    assumed: AssumedOptions,
    figures: Figures,
    overwrite: OverwriteOption = False,
) -> None:
    """Make a vehicle file from rolling stock of OSRD or railtoolkit, or from a table of efforts.

    These files give no losses, and mostly no electric brake. What is assumed instead is printed, and written in the
    file. The modes of a train (voltage, comfort) become modes of the vehicle: --mode picks one.
    """
    if assumed.losses is None:
        known = "lossless, a mean efficiency like 0.85, or a vehicle like re460-ic"
        raise DasError(f"--losses is missing: {source.name} gives no losses; expected {known}")
    check_outputs(out, inputs=(source, assumed.losses), overwrite=overwrite)
    from das.domain.files.writing import write_whole
    from precompute.vehicle_import.importing import import_train

    found = import_train(
        source,
        assumed.losses,
        figures,
        train_id=assumed.train,
        electric_brake=assumed.electric_brake,
        accepted=assumed.accept or (),
    )
    write_whole(out, found.text.encode())
    for note in found.notes:
        tell(f"note: {note}")
    made = found.vehicle
    modes = f", modes: {len(made.modes)}, default {made.mode}" if made.modes else ""
    tell(f"written: {out}: {made.name}, {made.mass_kg / TONNE:.4g} t, {kmh(made.max_speed_mps):.4g} km/h{modes}")
    tell(f"look at it: {typed('das-precompute')} vehicle show {out} --plot train.png")


def show_vehicle(
    vehicle: VehicleArgument,
    mode: ModeOption = None,
    load: LoadOption = None,
    plot: PlotOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Show forces, resistance, losses and the energy of cruising of a train, as a table and as a picture.

    Forces are those on a dry rail; the energy of cruising is that per kilometre on a level straight line.
    """
    check_picture(plot)
    check_outputs(plot, inputs=(vehicle,), overwrite=overwrite)
    from precompute.cli import vehicle_report

    train = vehicle_report.picked(load_vehicle(vehicle), mode, load)
    if plot is not None:
        from das.drawing.train import draw_train

        draw_train(train).save(plot, overwrite=True)
    if as_json:
        print(json.dumps(vehicle_report.as_dict(train)))
        return
    for line in vehicle_report.facts(train):
        tell(line)
    print_table(vehicle_report.table(train), vehicle_report.LEGEND)
    if plot is not None:
        tell(f"written: {plot}")


def check_vehicle(vehicle: VehicleArgument, as_json: JsonOption = False) -> None:
    """Check a vehicle file, in every mode and load: what is unusual in it.

    The exit code is 1 if there are warnings, and 2 if the file cannot be used.
    """
    from das.domain.files import load
    from precompute.cli import vehicle_report

    train: Vehicle = load.load_vehicle(vehicle)
    found = vehicle_report.warnings(train)
    if as_json:
        print(json.dumps({"warnings": found}))
    else:
        for text in found:
            warn(text)
        tell(f"{train.source}: modes: {len(train.modes)}, loads: {len(train.loads)}, warnings: {len(found)}")
    if found:
        raise typer.Exit(1)


def new_vehicle(out: OutVehicleOption, overwrite: OverwriteOption = False) -> None:
    """Write a vehicle file to fill in: every key with its meaning.

    Its figures are those of no real train; replace them.
    """
    check_outputs(out, overwrite=overwrite)
    from das.domain.files.writing import write_whole
    from precompute.cli.vehicle_report import TEMPLATE

    write_whole(out, TEMPLATE.encode())
    tell(f"written: {out}")
    tell(f"fill it in, then: {typed('das-precompute')} vehicle check {out}")
