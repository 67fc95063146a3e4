"""A schedule: a run as phases by place, each with a driving regime and the speed to which it leads.

Drivers and forecasts need only these actions: accelerate to a speed with an effort, hold it up to a place, coast, brake
to a speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.solver.kernels import schedule as kernels
from das.solver.kernels.tuples import KnownRun
from das.solver.section import Section
from das.solver.solution import Fit, Solution
from das.solver.state import RollOut, State, following_node, least_time_s

Floats = NDArray[np.float64]
MET_MPS = 1e-3
"""Largest difference (m/s) from the scheduled speed at which a train is taken to follow the schedule."""
NOWHERE = -1.0
"""The value of `met_mps` for a forecast that is computed to the end and never joins the schedule's trajectory."""
ON_CURVE_MPS = 0.05
"""Largest difference (m/s) between the target of a phase that follows the braking curve and the curve at its end."""


class PhaseKind(IntEnum):
    """The action of a driver in a phase, with the numbers used in the kernels."""

    TRACTION = kernels.TRACTION
    """A share of the largest traction effort; with a share of 0 a descent accelerates the train."""
    HOLD = kernels.HOLD
    """The speed is held, by traction or by brakes."""
    COAST = kernels.COAST
    """No effort at all."""
    BRAKE = kernels.BRAKE
    """A share of the largest effort of the electric brake, until the lower speed ahead is reached."""
    CURVE = kernels.CURVE
    """The brakes keep the train on the braking curve of a limit or stop ahead."""


BRAKES = (PhaseKind.BRAKE, PhaseKind.CURVE)
"""The kinds in which a train brakes."""


class Phase(NamedTuple):
    """An action on a stretch: kind, share of effort, the section's interval where it begins, speed to reach (m/s)."""

    kind: PhaseKind
    share: float
    begin: int
    target_mps: float

    @property
    def rolls_up(self) -> bool:
        """Whether the train coasts up to the speed."""
        return self.kind is PhaseKind.TRACTION and self.share == 0.0


@dataclass(frozen=True, eq=False)
class Prospect:
    """The forecast of a train that keeps to a schedule: speeds at the nodes (NaN behind the state), time, energy.

    `at_m` are the places (m) of the state and of the nodes ahead.
    """

    speeds_mps: Floats
    time_s: float
    energy_j: float
    at_m: Floats

    @cached_property
    def ahead_mps(self) -> Floats:
        """The speeds (m/s) at the state and at the nodes ahead."""
        return self.speeds_mps[-len(self.at_m) :]

    @cached_property
    def times_s(self) -> Floats:
        """The times (s from now) at the state and at the nodes ahead."""
        speeds = self.ahead_mps
        steps_s = 2.0 * np.diff(self.at_m) / np.maximum(speeds[:-1] + speeds[1:], 1e-3)
        return np.concatenate(([0.0], steps_s.cumsum()))

    def passes_s(self, s_m: float) -> float:
        """The time (s from now) at which the train passes a place."""
        return float(np.interp(s_m, self.at_m, self.times_s))

    def passes_mps(self, s_m: float) -> float:
        """The speed at which the train passes a place (m/s)."""
        return float(np.interp(s_m, self.at_m, self.ahead_mps))


@dataclass(frozen=True, kw_only=True, eq=False)
class Schedule:
    """Phases of a section in the order of the line, and the trajectory that keeps to them.

    `known` is that trajectory, at all nodes of the section.
    """

    section: Section
    phases: tuple[Phase, ...]
    known: KnownRun

    @cached_property
    def at(self) -> NDArray[np.int64]:
        """The number of the phase of every interval of the section (before the start: the first)."""
        begins = np.array([one.begin for one in self.phases])
        intervals = np.arange(len(self.section.step_m))
        return np.maximum(np.searchsorted(begins, intervals, side="right") - 1, 0)

    @cached_property
    def ends_m(self) -> Floats:
        """The distance (m) from each interval of the section to the end of its phase."""
        node_m = self.section.node_m
        ends = np.array([self.begin_m(k + 1) for k in range(len(self.phases))])
        return np.asarray(ends[self.at] - node_m[1:])

    @cached_property
    def columns(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Kind, share and target speed of every phase; a brake with share 0 that ends on the braking curve is a
        `CURVE`."""
        kinds = np.array([int(one.kind) for one in self.phases])
        targets = np.array([one.target_mps for one in self.phases])
        led_to = self.section.envelope_mps[[*(one.begin for one in self.phases[1:]), len(self.at)]]
        shares = np.array([one.share for one in self.phases])
        curves = (kinds == PhaseKind.BRAKE) & (shares == 0.0) & (np.abs(led_to - targets) < ON_CURVE_MPS)
        kinds[curves] = PhaseKind.CURVE
        return kinds, shares, targets

    def speed_at(self, s_m: float) -> float:
        """The scheduled speed (m/s) at a position; v² is linear between the nodes."""
        return math.sqrt(float(np.interp(s_m, self.section.node_m, self.known.speed_mps**2)))

    def brakes_by_effort(self, number: int) -> bool:
        """Whether a phase brakes to its speed with a given effort, not along a limit's curve, and then holds it."""
        kind, share, _ = self.columns
        return bool(kind[number] == PhaseKind.BRAKE and share[number] > 0.0)

    def begin_m(self, number: int) -> float:
        """The place (m) where a phase begins; beyond the last one: the end of the section."""
        if number >= len(self.phases):
            return self.section.end_m
        return float(self.section.node_m[self.phases[number].begin])

    def reached_m(self, number: int, s_m: float) -> float:
        """The place (m) where a brake phase reaches its target speed; if the train is past it, the end of the phase."""
        first, last = self.phases[number].begin + 1, len(self.at)
        if number + 1 < len(self.phases):
            last = max(self.phases[number + 1].begin, first)
        reached = self.known.speed_mps[first:last] < self.phases[number].target_mps + MET_MPS
        at_m = float(self.section.node_m[first + int(np.argmax(reached)) if reached.any() else last])
        return at_m if s_m < at_m else self.begin_m(number + 1)

    def forecast(self, s_m: float, v_mps: float, *, met_mps: float = MET_MPS) -> Prospect:
        """The forecast of a train in a state that keeps to the schedule; raises InfeasibleError if it stalls."""
        section = self.section
        following = min(following_node(section, s_m), len(section.step_m))
        first = following - 1
        step, envelope = section.step_m.copy(), section.envelope_mps.copy()
        step[first] = max(float(section.node_m[following]) - s_m, 1e-3)
        envelope[first] = max(envelope[first], v_mps)
        line = section.for_kernels._replace(step_m=step)
        speeds = np.full(len(section.node_m), np.nan)
        speeds[first] = v_mps
        time_s, energy_j = kernels.follow(
            first, self.at, self.ends_m, self.columns, self.known, met_mps, line, envelope,
            section.train, section.loss_params, speeds,
        )  # fmt: skip
        at_m = section.node_m[first:].copy()
        at_m[0] = s_m
        return Prospect(speeds, section.finished_s(time_s, s_m, v_mps), energy_j, at_m)


class Scheduled(NamedTuple):
    """A schedule, the forecast of a train that keeps to it, and its price of time (W).

    `finished`: it was computed beforehand and read from a table.
    """

    schedule: Schedule
    forecast: Prospect
    lambda_w: float
    finished: bool = False

    def solution(self, s_m: float, v_mps: float, requested_s: float) -> Solution:
        """The solution of a train that keeps to the schedule from a state; `requested_s` is the requested time.

        Raises InfeasibleError if the train stalls.
        """
        section = self.schedule.section
        state, forecast = State.at(section, s_m, v_mps), self.schedule.forecast(s_m, v_mps)
        least_s = least_time_s(section, s_m, v_mps)
        return state.solution(
            RollOut(forecast.speeds_mps[-len(state.node_m) :], forecast.time_s),
            least_time_s=least_s,
            requested_s=requested_s,
            fit=Fit.LATE if requested_s < least_s else Fit.ON_TIME,
            lambda_w=self.lambda_w,
        )


def settled(section: Section, phases: tuple[Phase, ...], s_m: float, v_mps: float) -> tuple[Schedule, Prospect]:
    """The schedule of these phases, with the trajectory that they give from a state, and its forecast.

    Raises InfeasibleError if the train stalls.
    """
    nowhere = KnownRun(*np.zeros((2, len(section.node_m))))
    raw = Schedule(section=section, phases=phases, known=nowhere)
    forecast = raw.forecast(s_m, v_mps, met_mps=NOWHERE)
    first = len(section.node_m) - len(forecast.at_m)
    run = known_run(section, np.append(np.full(first, v_mps), forecast.ahead_mps))
    run.time_to_go_s[:first] = run.time_to_go_s[first]
    return replace(raw, known=run), forecast


def on_section(schedule: Schedule, section: Section) -> Schedule:
    """The schedule on another section of the same line: its phases begin at the same places."""
    node_m, before = section.node_m, schedule.section.node_m
    found: list[Phase] = []
    for one in schedule.phases:
        begin = min(int(np.searchsorted(node_m, before[one.begin])), len(section.step_m) - 1)
        if found and begin <= found[-1].begin:
            found.pop()
        found.append(one._replace(begin=begin))
    squares = np.interp(node_m, before, schedule.known.speed_mps**2)
    speeds = np.minimum(np.sqrt(squares), section.envelope_mps)
    return replace(schedule, section=section, phases=tuple(found), known=known_run(section, speeds))


def known_run(section: Section, speeds_mps: Floats) -> KnownRun:
    """A trajectory by its speeds at the nodes of a section, with the time to go from each of them."""
    times = 2.0 * section.step_m / np.maximum(speeds_mps[:-1] + speeds_mps[1:], 1e-3)
    return KnownRun(speeds_mps, np.append(times[::-1].cumsum()[::-1], 0.0))
