"""A point that must be passed in a window of time: the optimum up to the point and the optimum from there on.

The part before the point may end at any speed. Each such speed is priced by the energy that the rest then costs, at the
multiplier (price of time) that fits the time left after the point. So both parts together need the least energy, up to
the step between two multipliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.goal import LONGEST_RATIO
from das.domain.errors import DasError
from das.domain.journey import Call, Journey, Passing, Window
from das.domain.trajectory import Trajectory
from das.solver import tolerances as tol
from das.solver.front import Front
from das.solver.journey.sections import build_journey_sections
from das.solver.section import Section, capped
from das.solver.solution import Fit, Solution
from das.solver.solve import solve_ahead, solve_front
from das.solver.state import fastest

SLOWING_MPS2: Final = 0.4
"""The train brakes to the lower speed at this rate, or harder if this is not slow enough."""
CRAWL_MPS: Final = 0.5
"""No train is told to go slower than this."""
HALVINGS: Final = 24
"""The lower speed is found by halving an interval this many times."""
PRICES_TRIED: Final = 2
"""The price of time after the point is estimated this many times, each time from the latest speed at the point."""

Floats = NDArray[np.float64]
SAME_W = 1e-6
"""Squares of speeds that differ by less than this (m²/s²) count as equal."""


class PassingRun(NamedTuple):
    """What fronts are solved for: the train's state (m, m/s), and its times to the point and to the end (s)."""

    s_m: float
    v_mps: float
    to_point_s: float
    total_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class PassingFronts:
    """Two fronts of optimal trajectories: one up to a point of the line, one from there to the end of the section."""

    before: Front
    after: Front

    @property
    def at_m(self) -> float:
        """The position of the point (m)."""
        return self.after.section.start_m

    @classmethod
    def solve(cls, section: Section, at_m: float, ladder_w: Floats, run: PassingRun) -> PassingFronts:
        """Solve both parts for a trajectory that passes the point `at_m` (m), for each multiplier (W) of a ladder.

        The fronts also serve other times and states, but their trajectories then cost a little more than the optimum.
        Raises DasError for a point that is not inside the section, InfeasibleError if a part cannot be driven.
        """
        first, last = _parts(section, at_m)
        after = solve_front(last, lambda_w=ladder_w)
        slow = -float(section.loss.loss_w(0.0, tol.CREEP_MPS)) * np.array(tol.LADDER_IDLE_RATIOS)
        ladder_w = np.unique(np.concatenate((slow, ladder_w)))
        speed, price = float(last.envelope_mps[0]), -1
        for _ in range(PRICES_TRIED):
            before_price, price = price, _price_index(after, speed, run.total_s - run.to_point_s)
            if price == before_price:
                break
            before = solve_ahead(first, run.s_m, lambda_w=ladder_w, end_value_j=_value_ahead(first, after, price))
            speed = float(before.trajectory(max(run.to_point_s, 1.0), run.s_m, run.v_mps).trajectory.v_mps[-1])
        return cls(before=before, after=after)

    def trajectory(self, to_point_s: float, total_s: float, s_m: float, v_mps: float, tolerance_s: float) -> Solution:
        """The trajectory from a state before the point that passes it after `to_point_s` and ends after `total_s`.

        A part with too little time is as fast as possible. Raises as `Front.trajectory` does.
        """
        first = self.before.trajectory(max(to_point_s, 0.1), s_m, v_mps, tolerance_s=tolerance_s)
        if first.fit is Fit.EARLY:
            first = self._slowed(first, to_point_s, s_m, v_mps)
        speed = float(first.trajectory.v_mps[-1])
        longest_s = LONGEST_RATIO * fastest(self.after.section, self.at_m, speed).time_s
        rest_s = min(max(total_s - first.time_s, 0.1), longest_s)
        last = self.after.trajectory(rest_s, self.at_m, speed, tolerance_s=tolerance_s)
        return replace(
            last,
            trajectory=_joined(first.trajectory, last.trajectory),
            least_time_s=first.least_time_s + last.least_time_s,
            requested_s=total_s,
            feasible=first.feasible and last.feasible,
        )

    def _slowed(self, slowest: Solution, wanted_s: float, s_m: float, v_mps: float) -> Solution:
        """A trajectory slower than any of the front: under the highest top speed with which it takes the wanted time.

        The train brakes gently to that speed, or fully if gentle braking is too quick. If even a crawl is too quick, it
        crawls.
        """
        low, high = CRAWL_MPS, max(float(slowest.trajectory.v_mps.max()), 2 * CRAWL_MPS)
        braking = next((x for x in (SLOWING_MPS2, math.inf) if self._takes(wanted_s, low, x, s_m, v_mps)), math.inf)
        for _ in range(HALVINGS):
            top = 0.5 * (low + high)
            low, high = (top, high) if self._takes(wanted_s, top, braking, s_m, v_mps) else (low, top)
        return self._under(low, braking, s_m, v_mps) or slowest

    def _takes(self, wanted_s: float, top_mps: float, braking_mps2: float, s_m: float, v_mps: float) -> bool:
        run = self._under(top_mps, braking_mps2, s_m, v_mps)
        return run is not None and run.time_s >= wanted_s

    def _under(self, top_mps: float, braking_mps2: float, s_m: float, v_mps: float) -> Solution | None:
        """The fastest trajectory that brakes at a rate to a top speed and keeps it; None if a hill stops the train."""
        section = self.before.section
        way_m = np.maximum(section.node_m - s_m, 0.0)
        falling_w = v_mps**2 - 2 * braking_mps2 * way_m if math.isfinite(braking_mps2) else np.zeros(len(way_m))
        cap = np.sqrt(np.maximum(falling_w, top_mps**2))
        try:
            return fastest(capped(section, cap), s_m, v_mps)
        except DasError:
            return None


def time_at(run: Trajectory, s_m: float) -> float:
    """When a trajectory is at a position (s from its start), with constant acceleration between its nodes."""
    i = int(np.clip(np.searchsorted(run.s_m, s_m, side="right") - 1, 0, len(run.s_m) - 2))
    way, length = s_m - run.s_m[i], run.s_m[i + 1] - run.s_m[i]
    speed = np.sqrt(run.v_mps[i] ** 2 + (run.v_mps[i + 1] ** 2 - run.v_mps[i] ** 2) * way / length)
    return float(run.t_s[i] + (2.0 * way / (run.v_mps[i] + speed) if way > 0 else 0.0))


def _parts(section: Section, at_m: float) -> tuple[Section, Section]:
    """The two parts of a section cut at a point; the first may end at any speed from which the second can be driven."""
    start = Call(name="start", position_m=section.start_m, departure=Window(earliest_s=0.0))
    end = Call(name="end", position_m=section.end_m, arrival=Window(latest_s=1e9))
    points = (start, Passing(name="target", position_m=at_m), end)
    journey = Journey(id="target", name="target", source="target", points=points)
    (journey_section,) = build_journey_sections(
        journey, section.route, section.vehicle, level=section.level, point_mass=section.train_length_m == 0
    )
    return _under(section, journey_section.part(0, 1)), _under(section, journey_section.part(1, 2))


def _under(section: Section, part: Section) -> Section:
    """A part of a section, nowhere faster than the section's own envelope, which may brake earlier than the part's."""
    lower_w = np.interp(part.node_m, section.node_m, section.envelope_mps**2)
    return capped(part, np.sqrt(lower_w)) if np.any(lower_w < part.envelope_mps**2 - SAME_W) else part


def _price_index(after: Front, v_mps: float, time_s: float) -> int:
    """The index of the multiplier whose trajectory from the point takes closest to `time_s`."""
    times_s, _ = after.by_multiplier(after.section.start_m, v_mps)
    return int(np.argmin(np.abs(times_s - time_s)))


def _value_ahead(first: Section, after: Front, price: int) -> Floats:
    """What the second part costs (J), for each speed at the end of the first part."""
    last = after.section
    known = np.linspace(last.floor_mps[0], last.envelope_mps[0], last.speed_steps + 1)
    speeds = np.linspace(first.floor_mps[-1], first.envelope_mps[-1], first.speed_steps + 1)
    value = np.interp(speeds**2, known**2, after.value_j[0, :, price])
    return np.where(value > tol.UNREACHABLE, tol.INFEASIBLE, value)


def _joined(first: Trajectory, last: Trajectory) -> Trajectory:
    """Two trajectories joined into one."""
    parts = {x.name: (getattr(first, x.name), getattr(last, x.name)) for x in fields(Trajectory)}
    parts["t_s"] = (first.t_s, first.time_s + last.t_s)
    of_nodes = ("s_m", "t_s", "v_mps")
    return Trajectory(**{
        name: np.concatenate((a, b[1:] if name in of_nodes else b)) for name, (a, b) in parts.items()
    })  # fmt: skip
