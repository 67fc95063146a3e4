"""The tight bound of a task with a loss map: shortest paths over cells of speeds, which get narrower and fewer."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossMap
from das.offline.bound import (
    LARGEST_PRICE_W,
    LEAST_POWER_W,
    NOT_FOUND,
    TERMS_RATIO,
    Certificate,
    Task,
    acceleration_limits,
    behind_fastest,
    fastest_is_ahead,
    force_limits,
    map_rows,
    task_of,
)
from das.offline.bound_kernels import MapRows, row_hulls
from das.solver import tolerances as tol
from das.solver.kernels.forces import ELECTRIC, TRACTION
from das.solver.kernels.tuples import TrainParams
from das.solver.solution import Solution
from docs.studies.tight_bound_kernels import (
    CellEfforts,
    CellLine,
    Cells,
    CellTrain,
    EvenRows,
    values_ahead,
    values_behind,
)

FIRST_WIDTH: Final = 0.03
"""First width of the cells, in the square root of the speed (m/s): 0.3 m/s at 25 m/s."""
NARROWEST_WIDTH: Final = 0.0001
"""Narrowest width of a cell."""
ENOUGH_GAP_RATIO: Final = 1e-3
"""Gap, as a share of the energy, at which the search ends."""
SLOW_RATIO: Final = 0.9
"""Share of the gap that a pass may leave; if it leaves more, the search ends."""
GROWTH: Final = 1.3
"""Largest expected ratio of the times per cell of two successive passes."""

Floats = NDArray[np.float64]

FORCE_SLACK_N: Final = 0.01
"""Largest excess (N) over a limit of force that counts as keeping the limit."""
SLACK_RATIO: Final = 1e-8
"""Largest relative excess over any other limit that counts as keeping the limit."""
SLOWEST_TAU: Final = 1e6
"""Slowness (s/m) of the slowest row of a loss map: no run is that slow."""
PARTS: Final = 2
"""Parts into which each open cell is split after each pass."""


class Incumbent(NamedTuple):
    """The known run: its energy (J) and its price of time (W)."""

    energy_j: float
    lambda_w: float


def tightened(solution: Solution, tight_s: float = math.inf) -> Solution:
    """The solution with a bound that is searched for during about `tight_s` seconds more.

    This raises the bound of a train with a loss map (`docs/explanation/bounds.md`); any other solution, and one whose
    bound is good enough, is returned unchanged.
    """
    loss, known, energy_j = solution.section.loss, solution.certificate, solution.balance.input
    hopeless = known.reason not in ("", NOT_FOUND) or energy_j - known.bound_j <= ENOUGH_GAP_RATIO * abs(energy_j)
    if not isinstance(loss, LossMap) or hopeless:
        return solution
    task = task_of(solution, known.allowed_s)
    if fastest_is_ahead(task):
        task = behind_fastest(task)
    incumbent = Incumbent(energy_j, min(solution.lambda_w, LARGEST_PRICE_W))
    found_j = tightened_j(task, loss, incumbent, tight_s)
    if not math.isfinite(found_j) or found_j <= known.bound_j:
        return solution
    return replace(solution, proven=Certificate(bound_j=found_j, allowed_s=known.allowed_s))


def tightened_j(
    task: Task,
    loss: LossMap,
    incumbent: Incumbent,
    budget_s: float,
    *,
    clock: Callable[[], float] = time.thread_time,
) -> float:
    """The highest bound (J) that cells of speeds prove for a task within `budget_s` (of CPU time); −inf if none.

    Runs that need more than the incumbent are excluded, so the bound is at most its energy. A pass that is not expected
    to end in time is not begun, except the first.
    """
    lambda_w = incumbent.lambda_w
    rows, line = even_rows(map_rows(task, loss), loss), cell_line(task, lambda_w)
    _load_kernels(all_cells(task, 10.0 * FIRST_WIDTH), line, rows)
    cells, best_j, gap_j = all_cells(task, FIRST_WIDTH), -np.inf, np.inf
    began = clock()
    most_j = incumbent.energy_j + lambda_w * task.allowed_s
    while True:
        pass_began = clock()
        total_j = values_behind(cells, line, rows)
        slack_j = TERMS_RATIO * (abs(total_j) + lambda_w * task.allowed_s)
        found_j = min(total_j - lambda_w * task.allowed_s - slack_j, incumbent.energy_j)
        best_j, left_j = max(best_j, found_j), incumbent.energy_j - found_j
        slow = left_j > SLOW_RATIO * gap_j
        gap_j = min(gap_j, left_j)
        narrow = cells.width / PARTS < NARROWEST_WIDTH
        if slow or narrow or gap_j <= ENOUGH_GAP_RATIO * abs(incumbent.energy_j):
            return float(best_j)
        values_ahead(cells, line, rows)
        before = int(cells.open.sum())
        close(cells, most_j + slack_j)
        after = PARTS * int(cells.open.sum())
        now = clock()
        if now + GROWTH * (now - pass_began) * after / before - began > budget_s:
            return float(best_j)
        cells = split(cells, PARTS)


def _load_kernels(cells: Cells, line: CellLine, rows: EvenRows) -> None:
    """One pass over few cells, so that compiling does not count as time of the search."""
    values_behind(cells, line, rows)
    values_ahead(cells, line, rows)


def close(cells: Cells, most_j: float) -> None:
    """Close the cells through which no run passes whose energy + price·time is at most `most_j`."""
    inside = np.isfinite(cells.ahead) & np.isfinite(cells.value)
    total = np.where(inside, cells.ahead, np.inf) + np.where(inside, cells.value, 0.0)
    cells.open[:] &= total <= most_j
    cells.open[[0, -1]] = True


def cell_line(task: Task, lambda_w: float) -> CellLine:
    """The intervals of a task at a price of time (W), as the kernels take them."""
    train, line = task.section.train, task.line
    traction_n, electric_n = force_limits(task)
    more, less = 1.0 + SLACK_RATIO, 1.0 - SLACK_RATIO
    braking = (line.supply >= 0) & (not train.brakes_dissipate)
    constant_n = train.c0_n + line.constant_n
    fastest = float(task.envelope_mps.max()) + tol.SPEED_TOLERANCE_MPS
    price_w = np.full_like(line.step_m, lambda_w) + (0.0 if task.price_w is None else task.price_w)
    return CellLine(
        step_m=np.ascontiguousarray(line.step_m),
        constant_n=constant_n,
        quadratic=train.c2_n_per_mps2 + line.tunnel_n_per_mps2,
        efforts=CellEfforts(
            traction_n=traction_n * more + FORCE_SLACK_N,
            electric_n=electric_n * more + FORCE_SLACK_N,
            least_electric_n=np.where(braking, train.electric_force_n * less - FORCE_SLACK_N, 0.0).clip(min=0.0),
            brake_n=(electric_n + train.friction_force_n) * more + FORCE_SLACK_N,
        ),
        max_acceleration=acceleration_limits(task, constant_n + min(train.c1_n_per_mps, 0.0) * fastest) * more,
        share=np.clip(line.supply, 0.0, 1.0),
        price_w=price_w,
        slowest_tau=task.high_tau * more,
        top_mps=np.sqrt(2.0 * task.high_w),
        train=CellTrain(
            linear=train.c1_n_per_mps,
            mass_kg=train.inertial_mass_kg,
            traction_w=max(train.traction_power_w, LEAST_POWER_W) * more,
            electric_w=max(train.electric_power_w, LEAST_POWER_W) * more,
            least_electric_w=train.electric_power_w * less,
            adhesive_n=train.adhesive_force_n * less,
            has_curves=train.has_curves,
            curves_n=_curve_bounds_n(train),
        ),
    )


def _curve_bounds_n(train: TrainParams) -> Floats:
    """Bounds (3, n) of the effort curves at the samples of speed, with some slack (see `CellTrain`)."""
    traction, electric = train.curves_n[TRACTION], train.curves_n[ELECTRIC]
    most = [
        np.maximum.accumulate(row[::-1])[::-1] * (1.0 + SLACK_RATIO) + FORCE_SLACK_N for row in (traction, electric)
    ]
    least = np.minimum.accumulate(electric) * (1.0 - SLACK_RATIO) - FORCE_SLACK_N
    return np.stack([*most, least.clip(min=0.0)])


def even_rows(rows: MapRows, loss: LossMap) -> EvenRows:
    """The lower hulls of a loss map's rows at its own forces, extended linearly on both sides.

    Between standstill and the first speed of the map, ψ is linear in the slowness for each force, so a row at
    `SLOWEST_TAU` comes first.
    """
    psi = np.empty((len(rows.tau) + 1, len(loss.force_n)))
    psi[0] = _on_forces(*_slowest_hull(rows, loss), loss.force_n)
    for row, force, hull, count in zip(psi[1:], rows.hull_force, rows.hull_psi, rows.vertices, strict=True):
        row[:] = _on_forces(force[:count], hull[:count], loss.force_n)
    tau = np.concatenate(([SLOWEST_TAU], rows.tau))
    return EvenRows(psi, tau, float(loss.force_n[0]), 1.0 / loss.force_step_n, 1.0 / loss.speed_step_mps)


def _slowest_hull(rows: MapRows, loss: LossMap) -> tuple[Floats, Floats]:
    """Forces and ψ (N) of the lower hull at the slowness `SLOWEST_TAU`, for the forces that the first row has."""
    ends = rows.hull_force[0, [0, rows.vertices[0] - 1]]
    first, last = np.searchsorted(loss.force_n, ends)
    standing, moving = loss.filled_w[0], loss.filled_w[1]
    psi = (loss.force_n + SLOWEST_TAU * standing + (moving - standing) / loss.speed_mps[1])[None, :]
    force, hull, count = np.empty_like(psi), np.empty_like(psi), np.empty(1, np.int64)
    row_hulls(np.array(loss.force_n), psi, np.array([first]), np.array([last]), force, hull, count)
    return force[0, : count[0]], hull[0, : count[0]]


def _on_forces(hull_n: Floats, psi_n: Floats, force_n: Floats) -> Floats:
    """A hull at evenly spaced forces (N), extended linearly on both sides."""
    found = np.interp(force_n, hull_n, psi_n)
    if len(hull_n) > 1:
        above, below = force_n > hull_n[-1], force_n < hull_n[0]
        found[above] = psi_n[-1] + (psi_n[-1] - psi_n[-2]) / (hull_n[-1] - hull_n[-2]) * (force_n[above] - hull_n[-1])
        found[below] = psi_n[0] + (psi_n[1] - psi_n[0]) / (hull_n[1] - hull_n[0]) * (force_n[below] - hull_n[0])
    return np.asarray(found)


def all_cells(task: Task, width: float) -> Cells:
    """Cells of a width for all speeds of a task."""
    top = np.sqrt(2.0 * task.high_w)
    count = np.maximum(np.ceil(np.sqrt(top) / width).astype(np.int64), 1)
    count[[0, -1]] = 1
    return _cells(np.zeros_like(count), count, np.ones(int(count.sum()), np.bool_), top, width)


def _cells(
    first: NDArray[np.int64], count: NDArray[np.int64], is_open: NDArray[np.bool_], top: Floats, width: float
) -> Cells:
    offset = np.concatenate(([0], np.cumsum(count)[:-1]))
    guess, slope, value, ahead = (np.full(len(is_open), np.inf) for _ in range(4))
    return Cells(first, count, offset, guess, slope, value, ahead, is_open, top, width)


def split(cells: Cells, parts: int) -> Cells:
    """The open cells, each split into this number of parts."""
    n = len(cells.size)
    first, count, opens = np.zeros(n, np.int64), np.ones(n, np.int64), []
    for k in range(n):
        mask = cells.open[cells.offset[k] : cells.offset[k] + cells.size[k]]
        if k in (0, n - 1):
            opens.append(mask)
            continue
        used = np.flatnonzero(mask)
        begin, end = (used[0], used[-1] + 1) if len(used) else (0, 1)
        first[k], count[k] = parts * (cells.first[k] + begin), parts * (end - begin)
        opens.append(np.repeat(mask[begin:end], parts))
    width = cells.width / parts
    is_open = np.concatenate(opens)
    return _cells(first, count, is_open, cells.top_mps, width)
