"""`python -m docs.studies.calibrate`: calibrate the loss chains of the Re 460 to the paper's figures, or check them.

Stage 1 (static) determines four parameters of the GTO chain from four equations: its map has the published L2 fit
(efficiency and idle part) and loss at full power, and the fit has no mean deviation when cruising. The IGBT chain is
the GTO chain with another converter, whose parameters are chosen such that runs independent of the map consume the
energies printed in Table 2. Stage 2 (trajectories, GTO) searches without derivatives (Nelder & Mead 1965) over a few
parameters of the map's shape for optimal runs with the printed savings; stage 1 is repeated for each trial. The start
values are fixed results of a wider search (docs/explanation/loss-maps.md), and the calibration is deterministic.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Annotated, Final

import numpy as np
import typer
from scipy import optimize

from das.command_line.application import run_app, single_command
from das.command_line.files import load_vehicle
from das.command_line.options import OutFolderOption, OverwriteOption
from das.command_line.printing import busy, error_console, loading_solver, tell
from das.domain.errors import DasError
from das.domain.files.load import locate_vehicle
from das.domain.files.reading import read_toml
from das.domain.files.vehicles import read_chain
from das.domain.files.writing import check_writable, write_whole
from das.domain.levels import Level
from das.domain.loss_chain import LossChain
from das.domain.losses import LossMap, fit_mean_efficiency
from das.domain.units import KMH, KN, KW
from das.domain.vehicle import Vehicle
from das.solver.warm_up import warm_up
from docs.studies import calibration_targets as paper
from docs.studies.calibration_targets import Figures, Runs
from docs.studies.cases import GTO_VEHICLE, IGBT_VEHICLE, TABLE2, TABLE2_LEVELS, consumed_j
from precompute.loss_maps import cruising_deviation_ratio

TABLE_2_CELL: Final = re.compile(r"Table 2: \S+ at (\S+)$")
STAGE_1_START: Final[Mapping[str, float]] = MappingProxyType(
    {"auxiliaries.base_w": 35e3, "transformer.copper_w": 190e3, "converter.line_ratio": 0.05, "gear.churning_w": 20e3}
)
"""Free parameters of the GTO chain's stage 1, with their start values."""
EFFICIENCY_AIM, IDLE_AIM_W, FULL_POWER_AIM_W = 0.8885, 115e3, 1043e3
"""The aims of stage 1: the L2 fit (eq. 16), the loss at full power (section 2: about 1000 kW), and no mean deviation of
the fit when cruising. Efficiency and loss at full power have the highest losses that round to the printed figures: with
lower losses, Table 2's fastest run at L3 would consume too little for its mechanical work."""

STAGE_2_START: Final[Mapping[str, float]] = MappingProxyType(
    {
        "auxiliaries.fan_w": 120e3,
        "converter.line_brake_ratio": 0.042,
        "converter.switching_w": 45e3,
        "converter.snubber_w": 55e3,
        "motors.brake_current_ratio": 0.86,
        "motors.copper_w": 48e3,
    }
)
"""Parameters of the map's shape that stage 2 varies, with their start values."""
STAGE_2_TRIALS: Final = 100
STAGE_2_STEP: Final = 0.03
"""First step of each parameter (relative)."""
IGBT_START: Final[Mapping[str, float]] = MappingProxyType({"converter.conduction_w": 150e3})
"""Free parameters of the IGBT chain, with their start values."""
OWN_OF_IGBT: Final = ("converter.", "motors.brake_current_ratio")
"""Parameters that differ between the chains: the converter, and the use of the motors by the electric brake."""
_OF_GTO: Final = (*STAGE_1_START, *STAGE_2_START)
CALIBRATED: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {GTO_VEHICLE: _OF_GTO, IGBT_VEHICLE: (*(name for name in _OF_GTO if not name.startswith(OWN_OF_IGBT)), *IGBT_START)}
)
"""Parameters written by the command, by vehicle; all others are assumptions in the files."""
DIGITS: Final = 4
"""Significant digits of a calibrated parameter in a file."""
UNITS: Final = {"w": ("kw", KW), "n": ("kn", KN), "mps": ("kmh", KMH)}
"""Suffix of a field → suffix and factor of its key in a vehicle's file."""


def value_of(chain: LossChain, name: str) -> float:
    """The parameter of a chain with a dotted name such as "motors.copper_w"."""
    component, key = name.split(".")
    return float(getattr(getattr(chain, component), key))


def with_values(chain: LossChain, values: Mapping[str, float]) -> LossChain:
    """The chain with some parameters replaced."""
    for name, value in values.items():
        component, key = name.split(".")
        part = replace(getattr(chain, component), **{key: float(value)})
        chain = replace(chain, **{component: part})
    return chain


def _with_shares(chain: LossChain, start: Mapping[str, float], shares: np.ndarray) -> LossChain:
    """The chain with the named parameters at these multiples of their start values."""
    return with_values(chain, dict(zip(start, shares * list(start.values()), strict=True)))


def rounded(chain: LossChain, names: Mapping[str, float]) -> LossChain:
    """The chain with the named parameters rounded to `DIGITS`, as in a file."""
    return with_values(chain, {name: float(f"{value_of(chain, name):.{DIGITS}g}") for name in names})


def with_chain(vehicle: Vehicle, chain: LossChain) -> Vehicle:
    """The vehicle with the L3 map of a chain; L1 and L2 are fitted to it."""
    loss_map = chain.to_map(
        vehicle.source, vehicle.traction.max_force_n, vehicle.electric_brake.max_force_n, vehicle.max_speed_mps
    )
    return vehicle.with_loss_map(loss_map)


def solve_stage_1(vehicle: Vehicle, chain: LossChain) -> LossChain:
    """The GTO chain with the free parameters of stage 1 solved for; all others are as in `chain`.

    Raises DasError if no positive parameters give the published fit and loss at full power.
    """

    def residuals(trial: LossChain) -> list[float]:
        train = with_chain(vehicle, trial)
        loss_map = train.loss_model(Level.L3)
        assert isinstance(loss_map, LossMap)
        l2 = fit_mean_efficiency(loss_map, train.traction.max_power_w, with_idle=True)
        return [
            l2.traction_ratio / (1.0 / EFFICIENCY_AIM - 1.0) - 1.0,
            l2.idle_w / IDLE_AIM_W - 1.0,
            paper.full_power_loss_w(loss_map, train) / FULL_POWER_AIM_W - 1.0,
            float(cruising_deviation_ratio(loss_map, l2, train) or 0.0),
        ]

    return _least_squares(residuals, with_values(chain, STAGE_1_START), STAGE_1_START, exact=True)


def solve_igbt(vehicle: Vehicle, chain: LossChain, gto: Vehicle, runs: Runs) -> LossChain:
    """The IGBT chain whose free parameters match Table 2's last column for the runs that do not depend on a map."""
    whole_j = consumed_j(runs["fastest"], gto, Level.L3)
    column = TABLE2_LEVELS.index("l3-igbt")

    def residuals(trial: LossChain) -> list[float]:
        train = with_chain(vehicle, trial)
        return [
            100 * consumed_j(runs[row], train, Level.L3) / whole_j / TABLE2[row][column] - 1.0
            for row in ("fastest", "top-speed", *paper.L0_TO_L2)
        ]

    return _least_squares(residuals, with_values(chain, IGBT_START), IGBT_START)


def _least_squares(
    residuals: Callable[[LossChain], list[float]],
    chain: LossChain,
    start: Mapping[str, float],
    *,
    exact: bool = False,
) -> LossChain:
    """Least squares over the named parameters, each relative to its start value; `exact`: the residuals must be 0."""

    def at(x: np.ndarray) -> LossChain:
        return _with_shares(chain, start, x)

    solved = optimize.least_squares(
        lambda x: residuals(at(x)), np.ones(len(start)), bounds=(0.0, np.inf), xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    if exact and np.abs(solved.fun).max() > 1e-6:
        raise DasError(
            f"calibration: no {', '.join(start)} >= 0 meet the static targets (residuals: "
            f"{', '.join(f'{100 * x:+.2f} %' for x in solved.fun)}); change the assumed parameters"
        )
    return at(solved.x)


def search_stage_2(
    vehicle: Vehicle, chain: LossChain, runs: Runs, report: Callable[[float], None] = lambda _cost: None
) -> LossChain:
    """The GTO chain whose optimal runs meet `paper.STAGE_2_TARGETS`, by Nelder–Mead over the parameters of stage 2.

    `report` is called with the cost after each trial. The returned parameters of stage 2 are rounded, and stage 1 is
    solved for them.
    """

    def cost(x: np.ndarray) -> float:
        try:
            trial = solve_stage_1(vehicle, _with_shares(chain, STAGE_2_START, x))
            value = paper.stage_2_cost(with_chain(vehicle, trial), runs)
        except DasError:
            value = 1e3  # stage 1 has no solution
        report(value)
        return value

    first = np.ones(len(STAGE_2_START))
    found = optimize.minimize(
        cost,
        first,
        method="Nelder-Mead",
        options={
            "maxfev": STAGE_2_TRIALS,
            "initial_simplex": np.vstack((first, first + STAGE_2_STEP * np.eye(len(first)))),
            "xatol": 1e-3,
            "fatol": 1e-3,
        },
    )
    return solve_stage_1(vehicle, rounded(_with_shares(chain, STAGE_2_START, found.x), STAGE_2_START))


def chain_of(name: str) -> LossChain:
    """The parametric loss chain of a bundled vehicle."""
    return read_chain(read_toml(locate_vehicle(name)).table("losses").table(Level.L3))


def refitted(gto: LossChain, igbt: LossChain) -> LossChain:
    """The GTO chain with the parameters `OWN_OF_IGBT` of an IGBT chain."""
    brake_current_ratio = igbt.motors.brake_current_ratio
    return replace(gto, converter=igbt.converter, motors=replace(gto.motors, brake_current_ratio=brake_current_ratio))


def calibrate(
    check: Annotated[
        bool, typer.Option("--check", help="Only check the bundled vehicles against the targets (takes seconds).")
    ] = False,
    out: OutFolderOption = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Calibrate the loss chains of re460-ic (GTO) and re460-ic-igbt to the paper's figures.

    Prints the targets and the figures reached; the exit code is 1 if a target is missed. The vehicle files with the new
    parameters go to the folder of --out. This takes a few minutes.
    """
    if out is not None and check:
        raise DasError("--check writes nothing: leave out --out, or --check")
    if out is not None and not out.is_dir():
        raise DasError(f"{out}: no such folder")
    paths = {} if out is None else {name: out / f"{name}.toml" for name in CALIBRATED}
    for path in paths.values():
        check_writable(path, overwrite=overwrite)
    with loading_solver():
        warm_up()
    chains = {name: chain_of(name) for name in CALIBRATED}
    if not check:
        chains = _calibrated(chains)
    vehicles = {name: with_chain(load_vehicle(name), chain) for name, chain in chains.items()}
    with busy("solving the runs that do not depend on a map …"):
        runs = paper.other_runs(vehicles[GTO_VEHICLE])
    with busy("evaluating …"):
        figures = paper.evaluate(vehicles[GTO_VEHICLE], chains[GTO_VEHICLE], vehicles[IGBT_VEHICLE], runs)
    print("\n".join(reached_table(figures)))
    missed = [target.name for target in paper.TARGETS if not target.met(figures[target.name])]
    for name in missed:
        print(f"missed: {name}")
    for name, path in paths.items():
        write_whole(path, vehicle_toml(name, chains[name]).encode())
        tell(f"written: {path}")
    if missed:
        raise typer.Exit(1)


def _calibrated(chains: Mapping[str, LossChain]) -> dict[str, LossChain]:
    """The chains after calibration: of the GTO vehicle, then of the IGBT one."""
    gto = _calibrated_gto(load_vehicle(GTO_VEHICLE), chains[GTO_VEHICLE])
    with busy("IGBT …"):
        train = with_chain(load_vehicle(GTO_VEHICLE), gto)
        refit = refitted(gto, chains[IGBT_VEHICLE])
        igbt = rounded(solve_igbt(load_vehicle(IGBT_VEHICLE), refit, train, paper.other_runs(train)), IGBT_START)
    return {GTO_VEHICLE: gto, IGBT_VEHICLE: igbt}


def _calibrated_gto(train: Vehicle, chain: LossChain) -> LossChain:
    with busy("GTO, stage 1, and the runs that do not depend on a map …"):
        start = solve_stage_1(train, with_values(chain, STAGE_2_START))
        # From the start values, not from the bundled parameters: the result must not depend on an earlier calibration.
        runs = paper.other_runs(with_chain(train, start))
    costs: list[float] = []
    with error_console().status("GTO, stage 2 …") as status:

        def tried(cost: float) -> None:
            costs.append(cost)
            status.update(
                f"GTO, stage 2: trial {len(costs)} of at most {STAGE_2_TRIALS}, targets missed by "
                f"{min(costs):.3f} (0 = all met with a margin)"
            )

        found = search_stage_2(train, start, runs, tried)
    return rounded(found, STAGE_1_START)


def _printed_and_reached(target: paper.PublishedFigure, reached: float) -> tuple[str, str]:
    """The printed and reached figures of a target with their unit."""
    unit = f" {target.unit}" if target.unit else ""
    printed = f"{target.printed}{unit}" if target.printed[0].isdigit() else target.printed
    return printed, f"{reached:.4g}{unit}" if "%" not in unit else f"{reached:.2f}{unit}"


def reached_table(figures: Figures) -> Iterator[str]:
    """The lines of the page's table: all targets except the cells of Table 2, and their deviations by column."""
    yield "| | printed | reached | accepted |"
    yield "|---|---:|---:|---:|"
    columns: dict[str, tuple[float, float]] = {}
    for target in paper.TARGETS:
        reached = figures[target.name]
        if cell := TABLE_2_CELL.match(target.name):
            printed = float(target.printed)
            most, _ = columns.get(cell[1], (0.0, 0.0))
            columns[cell[1]] = (max(most, abs(reached / printed - 1.0)), target.high / printed - 1.0)
        else:
            yield f"| {target.name} | {' | '.join(_printed_and_reached(target, reached))} | {target.accepted} |"
    for column, (most, allowed) in columns.items():
        yield f"| Table 2, column {column}: largest deviation | | {100.0 * most:.1f} % | {100.0 * allowed:.0f} % |"
    met = sum(target.met(figures[target.name]) for target in paper.TARGETS)
    yield ""
    yield f"{met} of {len(paper.TARGETS)} targets are met."


def vehicle_toml(name: str, chain: LossChain) -> str:
    """The bundled vehicle's file with the calibrated parameters of its table [losses.l3] replaced by `chain`.

    Sources and all other lines are unchanged. Raises DasError if the file has no line for a parameter.
    """
    path = locate_vehicle(name)
    wanted = {_key(parameter): value_of(chain, parameter) for parameter in CALIBRATED[name]}
    table, lines = "", []
    for line in path.read_text(encoding="utf-8").splitlines():
        table = line.strip("[]") if line.startswith("[") else table
        key = (table, line.partition(" = ")[0])
        lines.append(f"{key[1]} = {_in_file(key[1], wanted.pop(key))}" if key in wanted else line)
    if wanted:
        raise DasError(f"{path}: no line {' = … in '.join(reversed(next(iter(wanted))))}")
    return "\n".join(lines) + "\n"


def _key(parameter: str) -> tuple[str, str]:
    """Table and key in a vehicle file for a parameter such as "motors.copper_w"."""
    component, name = parameter.split(".")
    stem, _, suffix = name.rpartition("_")
    return f"losses.l3.{component}", f"{stem}_{UNITS[suffix][0]}" if suffix in UNITS else name


def _in_file(key: str, value_si: float) -> str:
    factors = dict(UNITS.values())
    return f"{value_si / factors.get(key.rpartition('_')[2], 1.0):.{DIGITS}g}"


def main() -> None:
    """Run the command; an input error gives one line and exit code 2."""
    name = "python -m docs.studies.calibrate"
    run_app(single_command(name, calibrate, (f"{name} --check",)), name)


if __name__ == "__main__":
    main()
