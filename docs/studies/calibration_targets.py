"""Published losses of the Re 460 as named targets, and the corresponding figures of a vehicle.

Source of every target: Nold & Corman (2024), Railway Engineering Science. The measured maps are confidential; only
these figures are available for comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from das.domain.levels import Level
from das.domain.loss_chain import LossChain
from das.domain.losses import LossMap, fit_mean_efficiency, operating_points
from das.domain.trajectory import Trajectory
from das.domain.units import KMH, KW
from das.domain.vehicle import Vehicle
from das.offline.refinement import refined
from das.solver.front import Front
from das.solver.solve import solve_front
from docs.studies.cases import (
    ACCELERATION,
    COMPLETE,
    DECELERATION,
    NOT_PRINTED,
    TABLE2,
    TABLE2_BUFFER_PERCENT,
    TABLE2_LEVELS,
    StudyCase,
    consumed_j,
)
from precompute.baselines import strategies as baselines
from precompute.loss_maps import cruising_deviation_ratio, fit_error

Figures = dict[str, float]
"""The value that a vehicle reaches, by target name."""

BUFFER_RATIO: Final = TABLE2_BUFFER_PERCENT / 100
"""The buffer t+ of Table 2."""
L0_TO_L2: Final = (Level.L0_NOREG, Level.L0_REG, Level.L1, Level.L2)

NORMALISER: Final = ("fastest", "l3-gto")
"""The cell that is 100 % by definition."""
CELL_TOLERANCE: Final[Mapping[str, float]] = {
    **dict.fromkeys(map(str, L0_TO_L2), 0.07),
    "l3-gto": 0.04,
    "l3-igbt": 0.04,
}
"""Accepted relative deviation of a cell from the printed figure, by column."""
EQUAL_ENERGY: Final = 5e-4
"""Largest relative difference of two energies that count as equal in comparisons of order."""

ACCELERATION_BUFFERS: Final = (0.02, 0.15, 0.25, 0.40)
DECELERATION_BUFFERS: Final = (0.02, 0.05, 0.10, 0.15, 0.30)
LARGE_BUFFER: Final = 0.10
"""Least buffer of a deceleration that counts as large."""


@dataclass(frozen=True)
class PublishedFigure:
    """A published figure and its accepted range: low <= reached <= high."""

    name: str
    printed: str
    low: float
    high: float
    unit: str
    source: str

    def met(self, reached: float) -> bool:
        return self.low <= reached <= self.high

    @property
    def accepted(self) -> str:
        """The accepted range as text."""
        if np.isinf(self.high):
            return f">= {self.low:.4g}"
        return f"{self.low:.4g}" if self.low == self.high else f"{self.low:.4g} … {self.high:.4g}"

    def miss(self, reached: float, margin_ratio: float = 0.0) -> float:
        """Distance of a figure from the range (in half-widths), 0 inside it; the margin makes the range smaller."""
        if self.met(reached) and margin_ratio == 0:
            return 0.0
        low, high = self.low, self.high
        half = 0.5 * (high - low) if np.isfinite(high - low) else max(abs(low if np.isinf(high) else high), 1e-9)
        inner = margin_ratio * half
        return max(low + inner - reached, reached - high + inner, 0.0) / half


TRIP_STEP_M: Final = 25.0
"""The longest decision step (m) of the runs of the two inverters. With it the driving of the two differs by 0.4 %, with
steps of 10 m by 0.2 %; with the usual, longer steps by 0.04 %."""


INF: Final = float("inf")
MAP_TARGETS: Final = (
    PublishedFigure("L2 fit: mean efficiency", "0.89", 0.885, 0.895, "", "eq. 16"),
    PublishedFigure("L2 fit: idle part", "115", 110.0, 120.0, "kW", "eq. 16"),
    PublishedFigure("L1 fit: 1/efficiency − 1", "0.150", 0.142, 0.158, "", "implied by Table 2, column L1"),
    PublishedFigure("L2 fit error, mean to input", "< 3", 0.0, 3.0, "%", "section 4.2: over all operating points"),
    PublishedFigure("cruising: mean signed deviation of L2", "0.5", -1.0, 1.0, "%", "section 4.2, fig. 4"),
    PublishedFigure("loss at full power", "about 1000", 940.0, 1060.0, "kW", "section 2"),
    PublishedFigure("auxiliaries, largest", "up to 150", 0.0, 150.0, "kW", "section 2"),
    PublishedFigure("best efficiency: share of full power", "inside the map", 0.0, 0.9, "", "section 3.3, fig. 2b"),
    PublishedFigure("clock change: largest jump of efficiency", "visible", 0.5, 5.0, "%", "section 3.3, fig. 2b"),
)
"""Targets for the map itself (vehicle with the GTO inverter)."""

SAVING_TARGETS: Final = (
    PublishedFigure("acceleration, t+ 2 %: L3 saves", "2.5", 1.5, 3.5, "%", "section 4.3, fig. 6"),
    PublishedFigure("acceleration, t+ 15 %: L3 saves", "4", 3.0, 5.0, "%", "section 4.3, fig. 6"),
    PublishedFigure("acceleration, t+ 25 %: L3 saves", "4", 3.0, 5.0, "%", "section 4.3, fig. 6"),
    PublishedFigure("acceleration, t+ 40 %: L3 saves", "4", 3.0, 5.0, "%", "section 4.3, fig. 6"),
    PublishedFigure("deceleration, t+ 2 %: L3 saves", "about 0", -1.0, 1.0, "%", "section 4.4, fig. 8"),
    PublishedFigure("deceleration, t+ 5 %: L3 saves", "about 2", 1.0, 3.0, "%", "section 4.4, fig. 8"),
    PublishedFigure("deceleration, large t+: L3 saves at most", "4", 3.0, 5.0, "%", "section 4.4, fig. 8"),
)
"""Savings of the L3 run over the L2 run, in % of the fastest run's energy, all at L3."""

TRIP_TARGETS: Final = (
    PublishedFigure("6 km: L3 GTO better than second best", "1.1", 1.0, 2.5, "%", "Table 2, column L3 GTO"),
    PublishedFigure("6 km: L3 GTO better than top-speed", "4.9", 4.0, 6.5, "%", "Table 2, column L3 GTO"),
    PublishedFigure("6 km: L3 GTO, share of traction at 110 km/h", "reduced", 0.0, 0.95, "", "section 4.5, fig. 9"),
    PublishedFigure("6 km: L2, share of traction at 110 km/h", "full", 0.99, INF, "", "section 4.5, fig. 9"),
    PublishedFigure("Table 2: columns with the best run on the diagonal", "6 of 6", 6, 6, "", "Table 2"),
    PublishedFigure("Table 2: columns with the fastest run worst", "6 of 6", 6, 6, "", "Table 2"),
    PublishedFigure("Table 2: columns with top-speed behind every optimum but L0 REG's", "5 of 5", 5, 5, "", "Table 2"),
    PublishedFigure("IGBT against GTO: mean power when driving", "gentler", 0.0, 0.9995, "", "section 4.6, fig. 10"),
    PublishedFigure("IGBT against GTO: mean power when braking", "gentler", 0.0, 0.999, "", "section 4.6, fig. 10"),
    PublishedFigure("IGBT against GTO: duration of driving", "longer", 1.0005, INF, "", "section 4.6, fig. 10"),
    PublishedFigure("IGBT against GTO: duration of braking", "longer", 1.001, INF, "", "section 4.6, fig. 10"),
)


def cell_name(row: str, column: str) -> str:
    return f"Table 2: {row} at {column}"


def _cell_targets() -> tuple[PublishedFigure, ...]:
    cells = [
        (row, column, value)
        for row, values in TABLE2.items()
        for column, value in zip(TABLE2_LEVELS, values, strict=True)
        if not np.isnan(value) and (row, column) != NORMALISER
    ]
    return tuple(
        PublishedFigure(
            cell_name(row, column),
            f"{value:.2f}",
            value * (1 - CELL_TOLERANCE[column]),
            value * (1 + CELL_TOLERANCE[column]),
            "%",
            "Table 2",
        )
        for row, column, value in cells
    )


CELL_TARGETS: Final = _cell_targets()
TARGETS: Final = (*MAP_TARGETS, *SAVING_TARGETS, *TRIP_TARGETS, *CELL_TARGETS)
STAGE_2_TARGETS: Final = (
    *SAVING_TARGETS,
    *TRIP_TARGETS[:2],
    *(target for target in CELL_TARGETS if "igbt" not in target.name),
)
STAGE_2_MARGIN: Final = 0.05
"""Margin, as a share of the half-width, by which stage 2 aims inside the accepted ranges."""


def map_figures(chain: LossChain, vehicle: Vehicle) -> Figures:
    """The figures of a chain's map for `MAP_TARGETS`."""
    loss_map, power_w = vehicle.loss_model(Level.L3), vehicle.traction.max_power_w
    assert isinstance(loss_map, LossMap)
    l1, l2 = (fit_mean_efficiency(loss_map, power_w, with_idle=with_idle) for with_idle in (False, True))
    points = operating_points(loss_map, power_w, vehicle.traction.max_force_n)
    driving = points.force_n > 0
    best = np.where(driving, points.efficiency_ratio(), 0.0).argmax()
    cruising = cruising_deviation_ratio(loss_map, l2, vehicle)
    reached = (
        1.0 / (1.0 + l2.traction_ratio),
        l2.idle_w / KW,
        l1.traction_ratio,
        100 * fit_error(loss_map, l2, power_w)["error_mean_to_input_ratio"],
        100 * cruising if cruising is not None else NOT_PRINTED,
        full_power_loss_w(loss_map, vehicle) / KW,
        float(chain.loss_by_component_w(points.force_n, points.speed_mps)["auxiliaries"].max()) / KW,
        float(points.power_w[best] / power_w),
        100 * largest_jump_ratio(loss_map, vehicle),
    )
    return dict(zip((target.name for target in MAP_TARGETS), reached, strict=True))


def full_power_loss_w(loss_map: LossMap, vehicle: Vehicle) -> float:
    """Mean loss (W) along the power hyperbola of traction, from its beginning to the top speed."""
    traction = vehicle.traction
    speed = np.arange(np.ceil(traction.max_power_w / traction.max_force_n / KMH), vehicle.max_speed_mps / KMH) * KMH
    return float(loss_map.loss_w(traction.max_power_w / speed, speed).mean())


def largest_jump_ratio(loss_map: LossMap, vehicle: Vehicle) -> float:
    """Largest increase of the efficiency from one speed of the map to the next higher one, at half the full power."""
    power_w = 0.5 * vehicle.traction.max_power_w
    speed = np.arange(50.0, vehicle.max_speed_mps / KMH) * KMH
    efficiency = power_w / (power_w + loss_map.loss_w(power_w / speed, speed))
    return float(np.diff(efficiency).max())


SAVING_CASES: Final = ((ACCELERATION, ACCELERATION_BUFFERS), (DECELERATION, DECELERATION_BUFFERS))
Runs = dict[str, Trajectory]
"""Row of Table 2, or "<case> <buffer>", → run."""


def _front(case: StudyCase, vehicle: Vehicle, level: Level) -> Front:
    return solve_front(case.section(vehicle, level), threads=1)


def _fastest(case: StudyCase, vehicle: Vehicle) -> Trajectory:
    """The fastest run; it is the same at every level."""
    return baselines.fastest(case.section(vehicle, Level.L0_REG)).trajectory


def other_runs(vehicle: Vehicle) -> Runs:
    """All runs that do not depend on the L3 map: fastest, top speed, the optima of L0 to L2, for all three cases."""
    runs = {"fastest": _fastest(COMPLETE, vehicle)}
    trip_s = runs["fastest"].time_s * (1 + BUFFER_RATIO)
    runs["top-speed"] = baselines.reduced_maximum_speed(COMPLETE.section(vehicle, Level.L0_REG), trip_s).trajectory
    for level in L0_TO_L2:
        runs[level] = _front(COMPLETE, vehicle, level).trajectory(trip_s).trajectory
    for case, buffers in SAVING_CASES:
        runs[f"{case.name} fastest"] = _fastest(case, vehicle)
        runs.update(_buffered(case, vehicle, Level.L2, buffers, runs[f"{case.name} fastest"].time_s))
    return runs


def l3_runs(vehicle: Vehicle, runs: Runs) -> Runs:
    """The L3 optima of acceleration and deceleration; `runs` from `other_runs`."""
    found: Runs = {}
    for case, buffers in SAVING_CASES:
        found.update(_buffered(case, vehicle, Level.L3, buffers, runs[f"{case.name} fastest"].time_s))
    return found


def _buffered(case: StudyCase, vehicle: Vehicle, level: Level, buffers: tuple[float, ...], least_s: float) -> Runs:
    front = _front(case, vehicle, level)
    return {f"{case.name} {buffer} {level}": front.trajectory(least_s * (1 + buffer)).trajectory for buffer in buffers}


def trip_run(vehicle: Vehicle, runs: Runs) -> Trajectory:
    """The L3 optimum of the 6 km, with short decision steps and refined.

    The difference between the two inverters' runs is smaller than the error of runs from the usual table.
    """
    front = solve_front(COMPLETE.section(vehicle, Level.L3, TRIP_STEP_M), threads=1)
    return refined(front.trajectory(runs["fastest"].time_s * (1 + BUFFER_RATIO))).trajectory


def saving_figures(vehicle: Vehicle, runs: Runs) -> Figures:
    """The figures of a vehicle for `SAVING_TARGETS`; `runs` contains the runs of L2 and L3."""
    saved = {}
    for case, buffers in SAVING_CASES:
        whole_j = consumed_j(runs[f"{case.name} fastest"], vehicle, Level.L3)
        for buffer in buffers:
            l2, l3 = (
                consumed_j(runs[f"{case.name} {buffer} {level}"], vehicle, Level.L3) for level in (Level.L2, Level.L3)
            )
            saved[case.name, buffer] = 100 * (l2 - l3) / whole_j
    large = max(saved[DECELERATION.name, buffer] for buffer in DECELERATION_BUFFERS if buffer >= LARGE_BUFFER)
    reached = [saved[ACCELERATION.name, buffer] for buffer in ACCELERATION_BUFFERS]
    reached += [saved[DECELERATION.name, 0.02], saved[DECELERATION.name, 0.05], large]
    return dict(zip((target.name for target in SAVING_TARGETS), reached, strict=True))


def table_2(gto: Vehicle, igbt: Vehicle, runs: Runs) -> dict[str, tuple[float, ...]]:
    """The computed Table 2: the paper's rows, from `runs`, in every column, in % of the fastest run at L3 GTO."""
    whole_j = consumed_j(runs["fastest"], gto, Level.L3)
    return {
        row: tuple(
            100 * consumed_j(runs[row], vehicle, level) / whole_j
            for vehicle, level in (*((gto, level) for level in L0_TO_L2), (gto, Level.L3), (igbt, Level.L3))
        )
        for row in TABLE2
    }


def trip_figures(gto: Vehicle, igbt: Vehicle, runs: Runs) -> Figures:
    """The figures of both vehicles for `TRIP_TARGETS` and `CELL_TARGETS`; `runs` contains all rows of Table 2."""
    table = table_2(gto, igbt, runs)
    column = {row: values[TABLE2_LEVELS.index("l3-gto")] for row, values in table.items()}
    best = column["l3-gto"]
    second = min(column[level] for level in L0_TO_L2)
    ours, theirs = runs["l3-gto"], runs["l3-igbt"]
    reached = (
        100 * (second / best - 1),
        100 * (column["top-speed"] / best - 1),
        traction_share_ratio(ours, gto, 110 * KMH),
        traction_share_ratio(runs[Level.L2], gto, 110 * KMH),
        *_orders(table),
        _mean_power_w(theirs, 1) / _mean_power_w(ours, 1),
        _mean_power_w(theirs, -1) / _mean_power_w(ours, -1),
        _duration_s(theirs, 1) / _duration_s(ours, 1),
        _duration_s(theirs, -1) / _duration_s(ours, -1),
    )
    figures = dict(zip((target.name for target in TRIP_TARGETS), reached, strict=True))
    for row, values in table.items():
        figures |= {cell_name(row, c): value for c, value in zip(TABLE2_LEVELS, values, strict=True)}
    return {target.name: figures[target.name] for target in (*TRIP_TARGETS, *CELL_TARGETS)}


def stage_2_cost(vehicle: Vehicle, runs: Runs) -> float:
    """Sum of the misses of `STAGE_2_TARGETS` with the margin; 0 if all are met with it."""
    own = l3_runs(vehicle, runs)
    optimum = trip_run(vehicle, runs)
    # No target of stage 2 uses the column and row of the other inverter.
    every = {**runs, **own, "l3-gto": optimum, "l3-igbt": optimum}
    figures = saving_figures(vehicle, every) | trip_figures(vehicle, vehicle, every)
    return sum(target.miss(figures[target.name], STAGE_2_MARGIN) for target in STAGE_2_TARGETS)


def evaluate(gto: Vehicle, gto_chain: LossChain, igbt: Vehicle, runs: Runs) -> Figures:
    """The figures of both vehicles for `TARGETS`."""
    every = {
        **runs,
        **l3_runs(gto, runs),
        "l3-gto": trip_run(gto, runs),
        "l3-igbt": trip_run(igbt, runs),
    }
    return map_figures(gto_chain, gto) | saving_figures(gto, every) | trip_figures(gto, igbt, every)


def _orders(table: Mapping[str, tuple[float, ...]]) -> tuple[float, float, float]:
    """Numbers of columns with the diagonal best; with fastest worst; with top-speed behind all optima but L0 REG's."""

    def count(holds: Callable[[dict[str, float], str], bool]) -> float:
        columns = {c: {row: values[i] for row, values in table.items()} for i, c in enumerate(TABLE2_LEVELS)}
        return float(sum(holds(cells, c) for c, cells in columns.items()))

    def top_speed_behind(cells: dict[str, float], name: str) -> bool:
        optima = [value for row, value in cells.items() if row not in ("fastest", "top-speed", Level.L0_REG)]
        return name != Level.L0_REG and cells["top-speed"] > max(optima)

    return (
        count(lambda cells, name: cells[name] <= min(cells.values()) * (1 + EQUAL_ENERGY)),
        count(lambda cells, _: cells["fastest"] == max(cells.values())),
        count(top_speed_behind),
    )


def traction_share_ratio(run: Trajectory, vehicle: Vehicle, speed_mps: float) -> float:
    """Traction force over the largest possible force at the point where the run first passes a speed."""
    i = int(np.argmax(run.v_mps >= speed_mps))
    return float(run.force_el_n[i - 1] / vehicle.traction.force_n(run.v_mps[i]))


def _work_and_square(run: Trajectory, sign: int) -> tuple[float, float]:
    """∫P dt (J) and ∫P² dt (W²s) of the motors when driving (+1) or braking (−1)."""
    power_w = np.maximum(sign * run.force_el_n, 0.0) * run.mean_speed_mps()
    return float(power_w @ run.interval_s()), float(power_w**2 @ run.interval_s())


def _mean_power_w(run: Trajectory, sign: int) -> float:
    """Mean wheel power weighted by the power itself; long stretches with almost no force then do not count."""
    work_j, square = _work_and_square(run, sign)
    return square / work_j


def _duration_s(run: Trajectory, sign: int) -> float:
    """Duration of driving or braking with that mean power for the same work (s)."""
    work_j, square = _work_and_square(run, sign)
    return work_j**2 / square
