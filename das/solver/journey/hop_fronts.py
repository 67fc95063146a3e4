"""Fronts of the hops of a journey, whole or in part, under one ladder of multipliers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import InfeasibleError
from das.solver import tolerances as tol
from das.solver.front import Fit, Front, default_ladder, solve_front
from das.solver.journey.hops import Hop
from das.solver.journey.timeline import Stretch

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned:
    """A stretch and its time."""

    stretch: Stretch
    time_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Run(Planned):
    """A stretch as driven: speeds at its nodes, price of time; `feasible`: within limits and forces, and on time."""

    speeds_mps: Floats
    lambda_w: float
    feasible: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A stretch by multiplier: `time_s` (L + 1,), falling, the last that of the fastest run; least `total_j` (L,)."""

    time_s: Floats
    total_j: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Ahead:
    """What lies behind a tight passing costs (`value_j`), by the speed there; slower than `least_mps` is too late."""

    speed_mps: Floats
    value_j: Floats
    least_mps: float


class HopFronts:
    """Fronts of whole hops are kept where there is room; their tables and runs always.

    `ladder_w` is the ladder of all hops: that of the strongest, and below 0 parts of the idle loss. `least_energy` is
    its index of 0.
    """

    def __init__(self, hops: Sequence[Hop]) -> None:
        self.hops = tuple(hops)
        self.ladder_w = _ladder(hops)
        self.least_energy = int(np.searchsorted(self.ladder_w, 0.0))
        self._fronts: dict[int, Front] = {}
        self._tables: dict[int, Table] = {}
        self._runs: dict[tuple[int, float], Run] = {}

    def is_whole(self, stretch: Stretch) -> bool:
        """Whether a stretch is a hop from stop to stop."""
        return stretch.last - stretch.first == len(self.hops[stretch.hop].places) - 1

    def part(self, stretch: Stretch, ahead: Ahead | None) -> Front:
        """The front of a part of a hop; `ahead` is what comes after its end (None: a stop)."""
        hop = self.hops[stretch.hop]
        if ahead is None:
            return solve_front(hop.part(stretch.first, stretch.last), lambda_w=self.ladder_w)
        section = hop.part(stretch.first, stretch.last, ahead.least_mps)
        speeds = np.linspace(section.floor_mps[-1], section.envelope_mps[-1], section.speed_steps + 1)
        value = np.interp(speeds**2, ahead.speed_mps**2, ahead.value_j)
        value[value > tol.UNREACHABLE] = tol.INFEASIBLE
        return solve_front(section, lambda_w=self.ladder_w, end_value_j=value)

    def table(self, stretch: Stretch, part: Front | None, speed_mps: float) -> Table:
        """The table of a stretch from a speed: of its part of a hop, or of the whole hop where that is None."""
        if part is not None:
            return _table(part, speed_mps)
        if stretch.hop not in self._tables:
            self._tables[stretch.hop] = _table(self._whole(stretch.hop), 0.0)
        return self._tables[stretch.hop]

    def drive(self, planned: Planned, part: Front | None = None, speed_mps: float = 0.0) -> Run:
        """The run over a part of a hop, or over a whole one where that is None."""
        if isinstance(planned, Run):
            return planned
        if part is not None:
            return _driven(planned, part, speed_mps)
        key = (planned.stretch.hop, planned.time_s)
        if key not in self._runs:
            self._runs[key] = _driven(planned, self._whole(planned.stretch.hop), 0.0)
        return self._runs[key]

    def _whole(self, hop: int) -> Front:
        if hop in self._fronts:
            return self._fronts[hop]
        front = solve_front(self.hops[hop].section, lambda_w=self.ladder_w)
        if sum(map(_size, self._fronts.values())) + _size(front) <= tol.JOURNEY_FRONTS_BYTES:
            self._fronts[hop] = front
        return front


def late_s(front: Front, speed_mps: float, left_s: float) -> float:
    """By how much the fastest run from a speed misses a time; inf where it cannot end as it must."""
    try:
        fastest = front.fastest(front.section.start_m, speed_mps)
    except InfeasibleError:
        return math.inf
    return fastest.time_s - left_s if fastest.feasible else math.inf


def _ladder(hops: Sequence[Hop]) -> Floats:
    idle_w = float(hops[0].section.loss.loss_w(0.0, tol.CREEP_MPS))
    slow = -idle_w * np.array(tol.LADDER_IDLE_RATIOS if idle_w > 0 else ())
    return np.concatenate((slow, max((default_ladder(hop.section) for hop in hops), key=lambda ladder: ladder[-1])))


def _size(front: Front) -> int:
    return front.value_j.nbytes * 3 // 2  # the times-to-go take half as much


def _table(front: Front, speed_mps: float) -> Table:
    times_s, total_j = front.by_multiplier(front.section.start_m, speed_mps)
    least_s = front.least_time_s(front.section.start_m, speed_mps)
    return Table(time_s=np.minimum.accumulate(np.append(times_s, least_s)), total_j=total_j)


def _driven(planned: Planned, front: Front, speed_mps: float) -> Run:
    start_m, tolerance_s = front.section.start_m, tol.JOURNEY_TIME_TOLERANCE_S
    solution = front.trajectory(planned.time_s, start_m, speed_mps, tolerance_s=tolerance_s)
    return Run(
        stretch=planned.stretch,
        time_s=planned.time_s,
        speeds_mps=solution.trajectory.v_mps,
        lambda_w=solution.lambda_w,
        feasible=solution.feasible and solution.fit is Fit.ON_TIME,
    )
