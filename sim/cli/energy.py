"""The command `das-sim energy`: where the energy of a recorded drive went, by cause and by place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from das.command_line.compiling import loading_solver
from das.command_line.options import JsonOption
from das.command_line.printing import busy, print_table, tell

if TYPE_CHECKING:
    from sim.drive.attribution.account import Account

TOLD_KWH = 0.5
"""What the times of a leg cost is told from this on (kWh)."""


def energy(
    file: Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording (.mcap) of a drive with its journey.")],
    as_json: JsonOption = False,
) -> None:
    """Say where the energy of a recorded drive went, by cause and by place, against the optimum for the same times."""
    with loading_solver():
        from sim.drive.attribution.rows import as_dict
        from sim.drive.drive import Drive

    with busy(f"reading {file} and solving its sections …"):
        account = Drive.read(file).known_account
    if as_json:
        print(json.dumps(as_dict(account)))
        return
    _print_causes(account)
    _print_places(account)
    if not account.measured:
        tell("The energies are estimates by inverse dynamics from positions: nobody measured them.")


def _print_causes(account: Account) -> None:
    from rich.table import Table

    from das.domain.units import kwh
    from sim.drive.attribution.account import OTHER_TRAIN
    from sim.drive.attribution.causes import EnergyCause

    columns = [(f"{leg.leg.start.name} – {leg.leg.end.name}", leg.by_cause, leg) for leg in account.legs]
    table = Table(title="energy at the current collector, kWh", title_justify="left")
    table.add_column("")
    for name, _, _ in columns:
        table.add_column(name, justify="right")
    table.add_column("all", justify="right", no_wrap=True)
    told = dict(account.by_cause)
    if account.against_timetable is not None and account.timetable_j is not None:
        due = [kwh(leg.timetable_j or 0.0) for _, _, leg in columns]
        table.add_row("optimum for the timetable", *(f"{x:.1f}" for x in due), f"{kwh(account.timetable_j):.1f}")
        for cause in (EnergyCause.RECOVERED, EnergyCause.ARRIVAL):
            told[cause] = account.against_timetable[cause]
            cells = (f"{kwh((leg.against_timetable or {}).get(cause, 0.0)):+.1f}" for _, _, leg in columns)
            table.add_row(f"  {cause.label}", *cells, f"{kwh(told[cause]):+.1f}")
        if account.other_train_j:
            other = (f"{kwh(leg.other_train_j):+.1f}" for _, _, leg in columns)
            table.add_row(f"  {OTHER_TRAIN}", *other, f"{kwh(account.other_train_j):+.1f}")
    best = [kwh(leg.optimum_j) for _, _, leg in columns]
    table.add_row("optimum for the same times", *(f"{x:.1f}" for x in best), f"{sum(best):.1f}")
    for cause, energy_j in account.by_cause.items():
        cells = (f"{kwh(parts.get(cause, 0.0)):+.1f}" for _, parts, _ in columns)
        table.add_row(f"  {cause.label}", *cells, f"{kwh(energy_j):+.1f}")
    driven = [kwh(leg.driven_j) for _, _, leg in columns]
    table.add_row("as driven", *(f"{x:.1f}" for x in driven), f"{sum(driven):.1f}")
    print_table(table, {cause.label: cause.meaning.rstrip(".") for cause in told})


def _print_places(account: Account) -> None:
    from das.domain.units import kwh
    from sim.drive.attribution.rows import worst_places

    worst = worst_places(account)
    if worst:
        told = "; ".join(
            f"{one.where}: {kwh(one.more_j):.1f} kWh, {' and '.join(cause.label for cause in one.causes)}"
            for one in worst
        )
        tell(f"most lost above the optimum: {told}")
