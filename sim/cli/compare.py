"""The command `das-sim compare`: recorded drives of one line, aligned on track position."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.options import JsonOption, OverwriteOption, PlotOption
from das.command_line.outputs import check_outputs, check_picture, save_figure
from das.command_line.printing import busy, paragraph, print_table, tell
from das.domain.errors import DasError

if TYPE_CHECKING:
    from sim.drive.comparison.aligned import AlignedDrives

SHOWN = 8
"""Stretches that the table shows: those where the drives part most."""


def compare(
    files: Annotated[
        list[Path], typer.Argument(metavar="RECORDING…", help="Two or more recordings (.mcap) of drives on one line.")
    ],
    step: Annotated[
        float, typer.Option("--step", metavar="METRES", help="Distance of the positions that are compared.")
    ] = 10.0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Table (.csv) to write: one row a position.")
    ] = None,
    plot: PlotOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Compare recorded drives at the same places: where and by how much their times and energies part."""
    if len(files) < 2:
        raise DasError("expected two recordings or more, of which the first is the one to compare with")
    check_picture(plot)
    check_outputs(out, plot, inputs=files, overwrite=overwrite)
    from das.domain.files.writing import write_whole
    from sim.drive.comparison.aligned import AlignedDrives
    from sim.drive.comparison.on_track import drives_on_track
    from sim.drive.comparison.rows import as_csv, as_dict

    with busy("reading the recordings …"):
        aligned = AlignedDrives.of(drives_on_track(files), step)
    if out is not None:
        write_whole(out, as_csv(aligned))
    if plot is not None:
        from sim.review.light import comparison_figure

        save_figure(plot, comparison_figure(aligned))
    if as_json:
        print(json.dumps(as_dict(aligned)))
        return
    _print(aligned)
    for path in (out, plot):
        if path is not None:
            tell(f"written: {path}")


def _print(aligned: AlignedDrives) -> None:
    from sim.drive.comparison.rows import sentences

    for index in range(1, len(aligned.drives)):
        for line in sentences(aligned, index):
            paragraph(line)
        _print_stretches(aligned, index)


def _print_stretches(aligned: AlignedDrives, index: int) -> None:
    """The stretches on which a drive parts most from the first; nothing where it does not."""
    from rich.table import Table

    from das.domain.units import kwh
    from sim.drive.comparison.aligned import place

    parted = [one for one in aligned.stretches(index) if abs(one.time_s) >= 0.05 or abs(kwh(one.lost_j)) >= 0.005]
    if not parted:
        return
    table = Table(title=f"where {aligned.drives[index].label} parts from the first", title_justify="left")
    for name in ("from", "to", "time, s", "drawn, kWh", "lost, kWh"):
        table.add_column(name, justify="right")
    most = sorted(parted, key=lambda one: -abs(one.lost_j))[:SHOWN]
    for one in sorted(most, key=lambda one: one.start_m):
        numbers = (f"{one.time_s:+.1f}", f"{kwh(one.energy_j):+.2f}", f"{kwh(one.lost_j):+.2f}")
        table.add_row(place(one.start_m), place(one.end_m), *numbers)
    print_table(table, {"drawn": "at the current collector", "lost": "without what went into the train's speed"})
