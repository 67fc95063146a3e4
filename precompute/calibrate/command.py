"""The command `das-precompute calibrate`: the Re 460's loss chains against what the paper prints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from das.command_line.compiling import loading_solver
from das.command_line.options import JsonOption, OutFolderOption, OverwriteOption
from das.command_line.printing import busy, error_console
from das.domain.errors import DasError

if TYPE_CHECKING:
    from das.domain.loss_chain import LossChain
    from das.domain.vehicle import Vehicle


class What(StrEnum):
    """Which vehicle to calibrate."""

    GTO = "gto"
    IGBT = "igbt"


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
    if check and out is not None:
        raise DasError("--check writes nothing: leave out --out, or --check")
    with loading_solver():
        from das.command_line.loading import load_vehicle
        from das.domain.files.load import locate_vehicle
        from das.domain.files.native import read_loss_chain
        from das.solver.warm_up import warm_up
        from precompute.calibrate import fit
        from precompute.calibrate import targets as paper
        from precompute.calibrate.report import report

        vehicle_ids = {What.GTO: fit.GTO, What.IGBT: fit.IGBT}
        names = [vehicle_ids[kind] for kind in What if what in (None, kind)]
        _check_folder(out, [f"{name}.toml" for name in names], overwrite=overwrite)
        warm_up()
    chains = {name: read_loss_chain(locate_vehicle(name)) for name in (fit.GTO, fit.IGBT)}
    if not check:
        chains = _calibrated(chains, what)
    vehicles = {name: fit.with_chain(load_vehicle(name), chain) for name, chain in chains.items()}
    with busy("solving the runs that do not depend on a map …"):
        runs = paper.other_runs(vehicles[fit.GTO])
    with busy("evaluating …"):
        figures = fit.evaluate(vehicles[fit.GTO], chains[fit.GTO], vehicles[fit.IGBT], runs)
    chosen = {name: chains[name] for name in names}
    report(figures, chosen, _written(out, chosen), as_json=as_json)
    if not all(target.met(figures[target.name]) for target in paper.TARGETS):
        raise typer.Exit(1)


def _check_folder(folder: Path | None, names: list[str], *, overwrite: bool) -> None:
    """Refuse, before the work begins, a folder that is not there or files that cannot be written."""
    from das.domain.files.writing import check_writable

    if folder is None:
        return
    if not folder.is_dir():
        raise DasError(f"{folder}: no such folder")
    for name in names:
        check_writable(folder / name, overwrite=overwrite)


def _written(folder: Path | None, chains: Mapping[str, LossChain]) -> list[Path]:
    """Write the vehicle files with the parameters of the chains; where they are."""
    from das.domain.files.writing import write_whole
    from precompute.calibrate.fit import CALIBRATED
    from precompute.calibrate.vehicle_file import vehicle_toml

    if folder is None:
        return []
    for name, chain in chains.items():
        write_whole(folder / f"{name}.toml", vehicle_toml(name, chain, CALIBRATED[name]).encode())
    return [folder / f"{name}.toml" for name in chains]


def _calibrated(chains: Mapping[str, LossChain], what: What | None) -> dict[str, LossChain]:
    """The chains after calibration: of the GTO vehicle unless only the other is asked for, then of the IGBT one."""
    from das.command_line.loading import load_vehicle
    from precompute.calibrate import fit
    from precompute.calibrate.targets import other_runs

    gto, igbt = chains[fit.GTO], chains[fit.IGBT]
    train = load_vehicle(fit.GTO)
    if what is not What.IGBT:
        gto = _calibrated_gto(train, gto)
    if what is not What.GTO:
        with busy("IGBT …"):
            train = fit.with_chain(train, gto)
            solved = fit.solve_igbt(load_vehicle(fit.IGBT), fit.refitted(gto, igbt), train, other_runs(train))
            igbt = fit.rounded(solved, fit.IGBT_START)
    return {fit.GTO: gto, fit.IGBT: igbt}


def _calibrated_gto(train: Vehicle, chain: LossChain) -> LossChain:
    from precompute.calibrate import fit
    from precompute.calibrate.targets import other_runs

    with busy("GTO, stage 1, and the runs that do not depend on a map …"):
        start = fit.solve_stage_1(train, fit.with_values(chain, fit.STAGE_2_START))
        # From the start, not from the bundled parameters: the outcome must not depend on what is calibrated.
        runs = other_runs(fit.with_chain(train, start))
    with _Trials(fit.STAGE_2_TRIALS) as progress:
        return fit.rounded(fit.search_stage_2(train, start, runs, progress.trial), fit.STAGE_1_START)


class _Trials:
    """Shows on a terminal the trials of the search of stage 2."""

    def __init__(self, most: int) -> None:
        self._most, self._trials, self._best = most, 0, math.inf
        self._status = error_console().status("GTO, stage 2 …")

    def __enter__(self) -> _Trials:
        self._status.__enter__()
        return self

    def __exit__(self, *args: Any) -> None:
        self._status.__exit__(*args)

    def trial(self, cost: float) -> None:
        """Count a trial and keep the least cost."""
        self._trials, self._best = self._trials + 1, min(self._best, cost)
        self._status.update(
            f"GTO, stage 2: trial {self._trials} of at most {self._most}, targets missed by {self._best:.3f} "
            "(0 = all met with a margin)"
        )
