"""Fronts of the sections of a journey, whole or in part, under one ladder of multipliers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import InfeasibleError
from das.solver import tolerances as tol
from das.solver.fastest import fastest, least_time_s
from das.solver.front import Front
from das.solver.journey.sections import JourneySection
from das.solver.journey.timeline import Stretch
from das.solver.solution import Fit
from das.solver.solve import default_ladder, solve_front

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedStretch:
    """A stretch and its time."""

    stretch: Stretch
    time_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenStretch(TimedStretch):
    """A stretch as driven: the speeds at its nodes, and the price of time there (W).

    `feasible` says that the run is within limits and forces, and on time.
    """

    speeds_mps: Floats
    lambda_w: float
    feasible: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class MultiplierTable:
    """What a stretch takes under each multiplier of the ladder.

    `time_s` (L + 1,) falls, and its last value is that of the fastest run. `total_j` (L,) is the least total cost.
    """

    time_s: Floats
    total_j: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Ahead:
    """What comes after a tight passing: its cost (`value_j`, J) by the speed at the passing (`speed_mps`).

    A train that passes slower than `least_mps` is too late for what follows.
    """

    speed_mps: Floats
    value_j: Floats
    least_mps: float


class SectionFronts:
    """Solves the fronts of sections; keeps those of whole sections where there is room, and their tables and runs
    always.

    All sections have the same ladder `ladder_w`: that of the section with the largest multipliers, and below 0
    parts of the idle loss. `least_energy` is the index of 0 in it.
    """

    def __init__(self, sections: Sequence[JourneySection]) -> None:
        self.sections = tuple(sections)
        self.ladder_w = _ladder(sections)
        self.least_energy = int(np.searchsorted(self.ladder_w, 0.0))
        self._fronts: dict[int, Front] = {}
        self._tables: dict[int, MultiplierTable] = {}
        self._runs: dict[tuple[int, float], DrivenStretch] = {}

    def is_whole(self, stretch: Stretch) -> bool:
        """Whether a stretch is a section from stop to stop."""
        return stretch.last - stretch.first == len(self.sections[stretch.section].places) - 1

    def part(self, stretch: Stretch, ahead: Ahead | None) -> Front:
        """The front of a part of a section; `ahead` is what comes after its end (None: a stop)."""
        journey_section = self.sections[stretch.section]
        if ahead is None:
            return solve_front(journey_section.part(stretch.first, stretch.last), lambda_w=self.ladder_w, packed=False)
        section = journey_section.part(stretch.first, stretch.last, ahead.least_mps)
        speeds = np.linspace(section.floor_mps[-1], section.envelope_mps[-1], section.speed_steps + 1)
        value = np.interp(speeds**2, ahead.speed_mps**2, ahead.value_j)
        value[value > tol.UNREACHABLE] = tol.INFEASIBLE
        return solve_front(section, lambda_w=self.ladder_w, end_value_j=value, packed=False)

    def table(self, stretch: Stretch, part: Front | None, speed_mps: float) -> MultiplierTable:
        """The table of a stretch from a speed: of its part of a section, or of the whole section where that is None."""
        if part is not None:
            return _table(part, speed_mps)
        if stretch.section not in self._tables:
            self._tables[stretch.section] = _table(self._whole(stretch.section), 0.0)
        return self._tables[stretch.section]

    def drive(self, planned: TimedStretch, part: Front | None = None, speed_mps: float = 0.0) -> DrivenStretch:
        """The run over a part of a section, or over a whole one where that is None."""
        if isinstance(planned, DrivenStretch):
            return planned
        if part is not None:
            return _driven(planned, part, speed_mps)
        key = (planned.stretch.section, planned.time_s)
        if key not in self._runs:
            self._runs[key] = _driven(planned, self._whole(planned.stretch.section), 0.0)
        return self._runs[key]

    def _whole(self, section: int) -> Front:
        if section in self._fronts:
            return self._fronts[section]
        front = solve_front(self.sections[section].whole, lambda_w=self.ladder_w, packed=False)
        if sum(map(_size, self._fronts.values())) + _size(front) <= tol.JOURNEY_FRONTS_BYTES:
            self._fronts[section] = front
        return front


def late_s(front: Front, speed_mps: float, left_s: float) -> float:
    """By how much the fastest run from a speed misses a time; inf where it cannot end as it must."""
    try:
        quickest = fastest(front.section, front.section.start_m, speed_mps)
    except InfeasibleError:
        return math.inf
    return quickest.time_s - left_s if quickest.feasible else math.inf


def _ladder(sections: Sequence[JourneySection]) -> Floats:
    idle_w = float(sections[0].whole.loss.loss_w(0.0, tol.CREEP_MPS))
    slow = -idle_w * np.array(tol.LADDER_IDLE_RATIOS if idle_w > 0 else ())
    return np.concatenate(
        (slow, max((default_ladder(section.whole) for section in sections), key=lambda ladder: ladder[-1]))
    )


def _size(front: Front) -> int:
    return front.value_j.nbytes * 3 // 2  # the times-to-go take half as much


def _table(front: Front, speed_mps: float) -> MultiplierTable:
    times_s, total_j = front.by_multiplier(front.section.start_m, speed_mps)
    least_s = least_time_s(front.section, front.section.start_m, speed_mps)
    return MultiplierTable(time_s=np.minimum.accumulate(np.append(times_s, least_s)), total_j=total_j)


def _driven(planned: TimedStretch, front: Front, speed_mps: float) -> DrivenStretch:
    start_m, tolerance_s = front.section.start_m, tol.JOURNEY_TIME_TOLERANCE_S
    solution = front.trajectory(planned.time_s, start_m, speed_mps, tolerance_s=tolerance_s)
    return DrivenStretch(
        stretch=planned.stretch,
        time_s=planned.time_s,
        speeds_mps=solution.trajectory.v_mps,
        lambda_w=solution.lambda_w,
        feasible=solution.feasible and solution.fit is Fit.ON_TIME,
    )
