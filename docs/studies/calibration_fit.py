"""Fitting the parameters of the Re 460's loss chains to what is published.

Stage 1 (static): three parameters of the GTO chain such that its map has the published L2 fit (efficiency and idle
part) and loss at full power: three equations, three unknowns. For the IGBT chain, which is the GTO chain with another
converter: its parameters such that runs that do not depend on the map consume what Table 2 prints for them.
Stage 2 (trajectories, GTO): a search without derivatives (Nelder & Mead 1965) over a few parameters of the shape, each
trial with its own stage 1, so that the optimal runs save what the paper prints. Everything starts from fixed numbers,
which a wider search by hand led to (docs/explanation/loss-maps.md), and is deterministic.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final

import numpy as np
from scipy import optimize

from das.domain.errors import DasError
from das.domain.loss_chain import LossChain
from das.domain.losses import Level, LossMap, fit_mean_efficiency
from das.domain.trajectory import consumed_j
from das.domain.vehicle import Vehicle
from docs.studies import calibration_targets as paper
from docs.studies.calibration_targets import Figures, Runs
from docs.studies.cases import GTO_VEHICLE, IGBT_VEHICLE, TABLE2_LEVELS
from precompute.loss_maps import cruising_deviation_ratio

STAGE_1_START: Final[Mapping[str, float]] = MappingProxyType(
    {"auxiliaries.base_w": 35e3, "transformer.copper_w": 190e3, "converter.line_ratio": 0.05, "gear.churning_w": 20e3}
)
"""Free parameters of the GTO chain's stage 1, with their start."""
EFFICIENCY_AIM, IDLE_AIM_W, FULL_POWER_AIM_W = 0.8885, 115e3, 1043e3
"""What stage 1 solves for: the L2 fit (eq. 16), the loss at full power (section 2: about 1000 kW), no mean deviation of
the fit when cruising. Efficiency and loss at full power are at the lossy end of what rounds to print: Table 2's fastest
run consumes more at L3 for its mechanical work than a less lossy map gives."""

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
"""Parameters of the shape that stage 2 varies, with their start."""
STAGE_2_TRIALS: Final = 100
STAGE_2_STEP: Final = 0.03
"""First step of each parameter (relative)."""
STAGE_2_MARGIN: Final = 0.05
"""Stage 2 aims inside the accepted intervals by this share of their half-width."""
IMPOSSIBLE: Final = 1e3
"""Cost of parameters for which stage 1 has no solution."""
STAGE_2_TARGETS: Final = (
    *paper.SAVING_TARGETS,
    *paper.TRIP_TARGETS[:2],
    *(target for target in paper.CELL_TARGETS if "igbt" not in target.name),
)

IGBT_START: Final[Mapping[str, float]] = MappingProxyType({"converter.conduction_w": 150e3})
"""Free parameters of the IGBT chain, with their start."""
OWN_OF_IGBT: Final = ("converter.", "motors.brake_current_ratio")
"""What the refit changes: the converter, and how well the electric brake uses the motors."""
_OF_GTO: Final = (*STAGE_1_START, *STAGE_2_START)
CALIBRATED: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {GTO_VEHICLE: _OF_GTO, IGBT_VEHICLE: (*(name for name in _OF_GTO if not name.startswith(OWN_OF_IGBT)), *IGBT_START)}
)
"""Parameters that the command writes, by vehicle; all others are assumptions of the files."""
DIGITS: Final = 4
"""Significant digits of a calibrated parameter in a file."""


def value_of(chain: LossChain, name: str) -> float:
    """A parameter of a chain by its dotted name, like "motors.copper_w"."""
    component, key = name.split(".")
    return float(getattr(getattr(chain, component), key))


def with_values(chain: LossChain, values: Mapping[str, float]) -> LossChain:
    """The chain with some parameters replaced."""
    for name, value in values.items():
        component, key = name.split(".")
        part = replace(getattr(chain, component), **{key: float(value)})
        chain = replace(chain, **{component: part})
    return chain


def rounded(chain: LossChain, names: Mapping[str, float]) -> LossChain:
    """The chain with the named parameters rounded to `DIGITS`, as they are written to a file."""
    return with_values(chain, {name: float(f"{value_of(chain, name):.{DIGITS}g}") for name in names})


def with_chain(vehicle: Vehicle, chain: LossChain) -> Vehicle:
    """The vehicle with the L3 map of a chain; L1 and L2 are fitted to it."""
    loss_map = chain.to_map(
        vehicle.source, vehicle.traction.max_force_n, vehicle.electric_brake.max_force_n, vehicle.max_speed_mps
    )
    return vehicle.with_loss_map(loss_map)


def solve_stage_1(vehicle: Vehicle, chain: LossChain) -> LossChain:
    """The GTO chain with the free parameters of stage 1 solved for; the others as in `chain`.

    Raises DasError where no set of positive parameters has the published fit and loss at full power.
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
    """The IGBT chain whose free parameters meet Table 2's last column for the runs that do not depend on a map."""
    whole_j = consumed_j(runs["fastest"], gto, Level.L3)
    column = TABLE2_LEVELS.index("l3-igbt")

    def residuals(trial: LossChain) -> list[float]:
        train = with_chain(vehicle, trial)
        return [
            100 * consumed_j(runs[row], train, Level.L3) / whole_j / paper.TABLE_2[row][column] - 1.0
            for row in ("fastest", "rms", *paper.L0_TO_L2)
        ]

    return _least_squares(residuals, with_values(chain, IGBT_START), IGBT_START)


def _least_squares(
    residuals: Callable[[LossChain], list[float]],
    chain: LossChain,
    start: Mapping[str, float],
    *,
    exact: bool = False,
) -> LossChain:
    """Least squares over the named parameters, each relative to its start; `exact`: the residuals must vanish."""
    names, scale = list(start), np.array(list(start.values()))

    def at(x: np.ndarray) -> LossChain:
        return with_values(chain, dict(zip(names, x * scale, strict=True)))

    solved = optimize.least_squares(
        lambda x: residuals(at(x)), np.ones(len(names)), bounds=(0.0, np.inf), xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    if exact and np.abs(solved.fun).max() > 1e-6:
        raise DasError(
            f"calibration: no {', '.join(names)} >= 0 meet the static targets (left over: "
            f"{', '.join(f'{100 * x:+.2f} %' for x in solved.fun)}); change the parameters that are assumed"
        )
    return at(solved.x)


def search_stage_2(
    vehicle: Vehicle, chain: LossChain, runs: Runs, report: Callable[[float], None] = lambda _cost: None
) -> LossChain:
    """The GTO chain whose optimal runs meet `STAGE_2_TARGETS`, by Nelder–Mead over the parameters of stage 2.

    `report` is called with the cost after each trial. The parameters of stage 2 come back rounded, those of stage 1
    solved for them.
    """
    names, scale = list(STAGE_2_START), np.array(list(STAGE_2_START.values()))

    def at(x: np.ndarray) -> LossChain:
        return with_values(chain, dict(zip(names, x * scale, strict=True)))

    def cost(x: np.ndarray) -> float:
        try:
            value = stage_2_cost(with_chain(vehicle, solve_stage_1(vehicle, at(x))), runs)
        except DasError:
            value = IMPOSSIBLE
        report(value)
        return value

    first = np.ones(len(names))
    found = optimize.minimize(
        cost,
        first,
        method="Nelder-Mead",
        options={
            "maxfev": STAGE_2_TRIALS,
            "initial_simplex": np.vstack((first, first + STAGE_2_STEP * np.eye(len(names)))),
            "xatol": 1e-3,
            "fatol": 1e-3,
        },
    )
    return solve_stage_1(vehicle, rounded(at(found.x), STAGE_2_START))


def stage_2_cost(vehicle: Vehicle, runs: Runs) -> float:
    """Sum of the misses of `STAGE_2_TARGETS` with the margin; 0 where all are met with it."""
    own = paper.l3_runs(vehicle, runs)
    optimum = paper.trip_run(vehicle, runs)
    # The column and row of the other inverter are not looked at.
    every = {**runs, **own, "l3-gto": optimum, "l3-igbt": optimum}
    figures = paper.saving_figures(vehicle, every) | paper.trip_figures(vehicle, vehicle, every)
    return sum(target.miss(figures[target.name], STAGE_2_MARGIN) for target in STAGE_2_TARGETS)


def evaluate(gto: Vehicle, gto_chain: LossChain, igbt: Vehicle, runs: Runs) -> Figures:
    """Everything in `calibration_targets.TARGETS`, as the two vehicles reach it."""
    every = {
        **runs,
        **paper.l3_runs(gto, runs),
        "l3-gto": paper.trip_run(gto, runs),
        "l3-igbt": paper.trip_run(igbt, runs),
    }
    return paper.map_figures(gto_chain, gto) | paper.saving_figures(gto, every) | paper.trip_figures(gto, igbt, every)


def refitted(gto: LossChain, igbt: LossChain) -> LossChain:
    """The GTO chain with what the refit changes taken from an IGBT chain."""
    brake_current_ratio = igbt.motors.brake_current_ratio
    return replace(gto, converter=igbt.converter, motors=replace(gto.motors, brake_current_ratio=brake_current_ratio))
