"""The command `das-precompute loss-map`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.printing import busy, print_table, tell
from das.domain.units import KW
from precompute.cli.options import MapFiles

if TYPE_CHECKING:
    from das.domain.losses import LossMap
    from das.domain.vehicle import Vehicle

LEGEND = {
    "fit": "level whose constant efficiency is fitted to the map",
    "idle": "constant loss of the fit",
    "mean/in": "mean deviation of the fit over the mean power that goes in",
    "mean/max, rms/max": "mean and root mean square deviation over the largest loss",
    "cruising": "mean of (map − fit)/fit at 40 to 160 km/h on the level, |cruising| of its magnitude",
}


def loss_map(
    source: Annotated[
        str, typer.Argument(metavar="VEHICLE|MAP.csv", help="Bundled vehicle, vehicle file, or loss map (CSV).")
    ],
    files: MapFiles,
    vehicle: Annotated[
        str | None,
        typer.Option("--vehicle", metavar="VEHICLE", help="Train whose forces bound a CSV map [default: re460-ic]."),
    ] = None,
) -> None:
    """Describe a loss map: coverage, fits of L1 and L2 with their errors, best efficiency, largest losses."""
    files.check(source, vehicle)
    from das.domain.files.writing import write_whole
    from precompute.loss_maps import csv_bytes, loss_map_summary, map_of

    model, train = map_of(source, vehicle)
    summary = loss_map_summary(model, train)
    if files.plot is not None:
        from precompute.loss_maps import draw_maps

        with busy("drawing …"):
            draw_maps(files.plot, model, train)
    if files.out is not None:
        write_whole(files.out, csv_bytes(model))
    if files.as_json:
        print(json.dumps(summary))
        return
    _print_facts(model, train, summary)
    _print_fits(summary)
    files.tell()


def _print_facts(model: LossMap, train: Vehicle, summary: dict[str, Any]) -> None:
    cover = summary["coverage"]
    (slow, fast), (least, most) = cover["speed_kmh"], cover["force_kn"]
    tell(f"{model.name}\ncovers {slow:g} … {fast:g} km/h, {least:g} … {most:g} kN")
    tell(f"{cover['operating_points']} operating points within {train.traction.max_power_w / KW:g} kW of {train.id}")
    full = [f"{name} {loss:.0f} kW" for name, loss in summary["full_power_loss_kw"].items() if loss is not None]
    tell(f"largest loss {summary['largest_loss_kw']:.0f} kW; mean at full power: {', '.join(full) or 'none'}")
    for name, best in summary["best"].items():
        if best is not None:
            tell(
                f"best efficiency {name}: {best['efficiency_ratio']:.1%} at {best['speed_kmh']:.0f} km/h, "
                f"{best['force_kn']:.0f} kN ({best['power_share_ratio']:.0%} of the power)"
            )


def _print_fits(summary: dict[str, Any]) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    for name in (
        *("fit", "mean\nefficiency", "idle\nkW", "mean/in\n%", "mean/max\n%", "rms/max\n%"),
        *("cruising\n%", "|cruising|\n%"),
    ):
        table.add_column(name, justify="right", no_wrap=True)
    for level, fit in summary["fits"].items():
        cruising, absolute = fit["cruising_deviation_ratio"], fit["cruising_absolute_deviation_ratio"]
        table.add_row(
            level,
            f"{fit['mean_efficiency_ratio']:.4f}",
            f"{fit['idle_kw']:.1f}",
            *(
                f"{100 * fit[f'error_{name}_ratio']:.2f}"
                for name in ("mean_to_input", "mean_to_largest", "rms_to_largest")
            ),
            f"{100 * cruising:+.2f}" if cruising is not None else "–",
            f"{100 * absolute:.2f}" if absolute is not None else "–",
        )
    print_table(table, LEGEND)
