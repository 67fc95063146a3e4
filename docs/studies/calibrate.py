"""`python -m docs.studies.calibrate`: calibrate the loss chains of the Re 460 to what is printed, or check them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich import box
from rich.table import Table

from das.command_line.application import single_command
from das.command_line.compiling import loading_solver
from das.command_line.loading import load_vehicle
from das.command_line.options import JsonOption, OutFolderOption, OverwriteOption
from das.command_line.printing import busy, error_console, print_table, tell
from das.command_line.running import run_app
from das.domain.errors import DasError
from das.domain.files.load import locate_vehicle
from das.domain.files.native import read_loss_chain
from das.domain.files.writing import check_writable, write_whole
from das.domain.loss_chain import LossChain
from das.domain.units import KMH, KN, KW
from das.domain.vehicle import Vehicle
from das.solver.warm_up import warm_up
from docs.studies import calibration_fit as fit
from docs.studies import calibration_targets as paper
from docs.studies.calibration_targets import Figures
from docs.studies.cases import GTO_VEHICLE, IGBT_VEHICLE

LEGEND: Final = {
    "printed": "in the paper",
    "accepted": "for the figure that is reached",
    "cells of Table 2": "row at column, in % of what the fastest run consumes at L3 GTO",
}
UNITS: Final = {"w": ("kw", KW), "n": ("kn", KN), "mps": ("kmh", KMH)}
"""Suffix of a field → suffix and factor of its key in a vehicle's file."""


class What(StrEnum):
    """Which vehicle to calibrate."""

    GTO = "gto"
    IGBT = "igbt"


VEHICLE_IDS: Final = {What.GTO: GTO_VEHICLE, What.IGBT: IGBT_VEHICLE}


def calibrate(
    what: Annotated[What | None, typer.Option("--what", help="Only this vehicle [default: both].")] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Only hold the bundled vehicles against the targets (seconds).")
    ] = False,
    out: OutFolderOption = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Calibrate the loss chains of re460-ic (GTO) and re460-ic-igbt to what the paper prints.

    Every target is printed with what is reached; the exit code is 1 where one is missed. The vehicle files with the new
    parameters go to the folder of --out. This takes a few minutes.
    """
    names = [VEHICLE_IDS[kind] for kind in What if what in (None, kind)]
    _check_out(out, names, check=check, overwrite=overwrite)
    with loading_solver():
        warm_up()
    chains = {name: read_loss_chain(locate_vehicle(name)) for name in VEHICLE_IDS.values()}
    if not check:
        chains = _calibrated(chains, what)
    vehicles = {name: fit.with_chain(load_vehicle(name), chain) for name, chain in chains.items()}
    with busy("solving the runs that do not depend on a map …"):
        runs = paper.other_runs(vehicles[GTO_VEHICLE])
    with busy("evaluating …"):
        figures = fit.evaluate(vehicles[GTO_VEHICLE], chains[GTO_VEHICLE], vehicles[IGBT_VEHICLE], runs)
    chosen = {name: chains[name] for name in names}
    report(figures, chosen, _written(out, chosen), as_json=as_json)
    if not all(target.met(figures[target.name]) for target in paper.TARGETS):
        raise typer.Exit(1)


def _check_out(folder: Path | None, names: list[str], *, check: bool, overwrite: bool) -> None:
    """Refuse, before the work begins, a folder that is not there or files that cannot be written."""
    if folder is None:
        return
    if check:
        raise DasError("--check writes nothing: leave out --out, or --check")
    if not folder.is_dir():
        raise DasError(f"{folder}: no such folder")
    for name in names:
        check_writable(folder / f"{name}.toml", overwrite=overwrite)


def _written(folder: Path | None, chains: Mapping[str, LossChain]) -> list[Path]:
    """Write the vehicle files with the parameters of the chains; where they are."""
    if folder is None:
        return []
    for name, chain in chains.items():
        write_whole(folder / f"{name}.toml", vehicle_toml(name, chain).encode())
    return [folder / f"{name}.toml" for name in chains]


def _calibrated(chains: Mapping[str, LossChain], what: What | None) -> dict[str, LossChain]:
    """The chains after calibration: of the GTO vehicle unless only the other is asked for, then of the IGBT one."""
    gto, igbt = chains[GTO_VEHICLE], chains[IGBT_VEHICLE]
    train = load_vehicle(GTO_VEHICLE)
    if what is not What.IGBT:
        gto = _calibrated_gto(train, gto)
    if what is not What.GTO:
        with busy("IGBT …"):
            train = fit.with_chain(train, gto)
            solved = fit.solve_igbt(load_vehicle(IGBT_VEHICLE), fit.refitted(gto, igbt), train, paper.other_runs(train))
            igbt = fit.rounded(solved, fit.IGBT_START)
    return {GTO_VEHICLE: gto, IGBT_VEHICLE: igbt}


def _calibrated_gto(train: Vehicle, chain: LossChain) -> LossChain:
    with busy("GTO, stage 1, and the runs that do not depend on a map …"):
        start = fit.solve_stage_1(train, fit.with_values(chain, fit.STAGE_2_START))
        # From the start, not from the bundled parameters: the outcome must not depend on what is calibrated.
        runs = paper.other_runs(fit.with_chain(train, start))
    costs: list[float] = []
    with error_console().status("GTO, stage 2 …") as status:

        def tried(cost: float) -> None:
            costs.append(cost)
            status.update(
                f"GTO, stage 2: trial {len(costs)} of at most {fit.STAGE_2_TRIALS}, targets missed by "
                f"{min(costs):.3f} (0 = all met with a margin)"
            )

        found = fit.search_stage_2(train, start, runs, tried)
    return fit.rounded(found, fit.STAGE_1_START)


def report(figures: Figures, chains: Mapping[str, LossChain], written: Sequence[Path], *, as_json: bool) -> None:
    """Print every target with what is reached, and the files that were written."""
    if as_json:
        print(json.dumps(_as_json(figures, chains, written)))
        return
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("target")
    for name in ("printed", "reached", "accepted"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("")
    for target in paper.TARGETS:
        reached = figures[target.name]
        unit = f" {target.unit}" if target.unit else ""
        table.add_row(
            target.name,
            f"{target.printed}{unit}" if target.printed[0].isdigit() else target.printed,
            f"{reached:.4g}{unit}" if "%" not in unit else f"{reached:.2f}{unit}",
            _interval(target),
            "" if target.met(reached) else "missed",
        )
    print_table(table, LEGEND)
    missed = sum(not target.met(figures[target.name]) for target in paper.TARGETS)
    print(f"{len(paper.TARGETS) - missed} of {len(paper.TARGETS)} targets met")
    for path in written:
        tell(f"written: {path}")


def _interval(target: paper.PublishedFigure) -> str:
    if math.isinf(target.high):
        return f">= {target.low:.4g}"
    if target.low == target.high:
        return f"{target.low:.4g}"
    return f"{target.low:.4g} … {target.high:.4g}"


def _as_json(figures: Figures, chains: Mapping[str, LossChain], written: Sequence[Path]) -> dict[str, Any]:
    return {
        "targets": [
            {
                **asdict(target),
                "high": target.high if math.isfinite(target.high) else None,
                "reached": figures[target.name],
                "met": target.met(figures[target.name]),
            }
            for target in paper.TARGETS
        ],
        "parameters": {name: asdict(chain) for name, chain in chains.items()},
        "written": [str(path) for path in written],
    }


def vehicle_toml(name: str, chain: LossChain) -> str:
    """The bundled vehicle's file with the calibrated parameters of its block [losses.l3] as in `chain`.

    Sources and everything else stay. Raises DasError where the file has no line for one of them.
    """
    path = locate_vehicle(name)
    wanted = {_key(parameter): fit.value_of(chain, parameter) for parameter in fit.CALIBRATED[name]}
    table, lines = "", []
    for line in path.read_text(encoding="utf-8").splitlines():
        table = line.strip("[]") if line.startswith("[") else table
        key = (table, line.partition(" = ")[0])
        lines.append(f"{key[1]} = {_in_file(key[1], wanted.pop(key))}" if key in wanted else line)
    if wanted:
        raise DasError(f"{path}: no line {' = … in '.join(reversed(next(iter(wanted))))}")
    return "\n".join(lines) + "\n"


def _key(parameter: str) -> tuple[str, str]:
    """Table and key of a parameter like "motors.copper_w" in a vehicle file."""
    component, name = parameter.split(".")
    stem, _, suffix = name.rpartition("_")
    return f"losses.l3.{component}", f"{stem}_{UNITS[suffix][0]}" if suffix in UNITS else name


def _in_file(key: str, value_si: float) -> str:
    factors = dict(UNITS.values())
    return f"{value_si / factors.get(key.rpartition('_')[2], 1.0):.{fit.DIGITS}g}"


def main() -> None:
    """Run the command; bad input ends in one line and exit code 2."""
    name = "python -m docs.studies.calibrate"
    run_app(single_command(name, calibrate, (f"{name} --check",)), name)


if __name__ == "__main__":
    main()
