"""The driver's knowledge of line and train, and its consequences up to the next halt.

The kernels work on grids of even cells; w is v² at the nodes between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from das.compiling import kernel
from das.domain.restriction import Restriction
from das.domain.route import NEUTRAL, POSITION_TOLERANCE_M, Floats, Route, Stretches
from das.domain.units import KMH, STANDARD_GRAVITY_MPS2
from das.domain.vehicle import Vehicle
from sim.drivers.cab import CabView
from sim.plant.kernels import TrainNumbers, brake_effort, running_resistance, traction_effort
from sim.plant.plant import train_numbers

PLANNED_RATIO, PLANNED_AT_MPS = 0.8, 5.0
"""Largest share of the train's braking on level track, at a reference speed (m/s), that a driver plans to use: the
rest compensates for errors and for the time until the brakes act."""
CELL_M = 5.0
"""Length (m) of the cells in which the line is remembered, counted back from the halt."""
SLOWEST_CAP_MPS = 20.0 * KMH
CAP_HALVINGS = 14


_LEAST_BRAKING_MPS2 = 0.02
"""Least braking (m/s²) that a train is assumed to have: on steep descents the ceiling would otherwise fall to zero."""
_CRAWL_MPS = 0.5
"""Speed (m/s) at which a train in front of a gradient that it cannot climb is assumed to crawl."""


@kernel
def ceiling(step, limit, line_n, tunnel, supply, braking, reserve, p):  # type: ignore[no-untyped-def]
    """The greatest w at each node from which planned braking keeps the limits ahead and stops at the last node. Planned
    braking is at most `braking` (m/s²), and at most the share `reserve` of the largest braking force.
    """
    n = limit.size
    w = np.zeros(n + 1)
    for i in range(n - 1, -1, -1):
        cap = min(limit[i], limit[max(i - 1, 0)]) ** 2
        w1 = min(w[i + 1], cap)
        v = math.sqrt(min(w1 + 2.0 * step * braking, cap))
        # Without supply only the friction brake remains.
        effort = brake_effort(v, 1.0, p) if supply[i] >= 0.0 else min(p.friction_force_n, brake_effort(v, 1.0, p))
        can = (reserve * effort + running_resistance(v, 0.0, tunnel[i], p) + line_n[i]) / p.inertial_mass_kg
        w[i] = min(cap, w1 + 2.0 * step * max(min(braking, can), _LEAST_BRAKING_MPS2))
    return w


@kernel
def needed_braking(step, first, w, s, v, least_way):  # type: ignore[no-untyped-def]
    """The least constant deceleration (m/s²) from v at s that keeps v² below w at all nodes ahead; < 0: none is needed.

    The distance to brake over is taken as at least `least_way` (m). `first` is the position of the first node of w.
    """
    needed = -math.inf
    i = max(int((s - first) / step) + 1, 0)
    while i < w.size:
        way = max(first + step * i - s, least_way)
        needed = max(needed, (v * v - w[i]) / (2.0 * way))
        if v * v / (2.0 * way) < needed:
            break  # not even a stop at a node further on needs more
        i += 1
    return needed


@kernel
def run_time(step, top, cap, line_n, tunnel, supply, start, w0, p):  # type: ignore[no-untyped-def]
    """Time (s) of the fastest trajectory from node `start`, where w is w0, under `top` and `cap` (both v²)."""
    w = min(w0, top[start], cap)
    v = math.sqrt(w)
    total = 0.0
    for i in range(start, line_n.size):
        pull = 0.0 if supply[i] == NEUTRAL else traction_effort(v, 1.0, p)
        rate = (pull - running_resistance(v, 0.0, tunnel[i], p) - line_n[i]) / p.inertial_mass_kg
        reached = max(w + 2.0 * step * min(rate, p.max_acceleration_mps2), _CRAWL_MPS * _CRAWL_MPS)
        w = min(reached, top[i + 1], cap)
        before = v
        v = math.sqrt(w)
        total += 2.0 * step / max(before + v, _CRAWL_MPS)
    return total


@kernel
def cap_for_time(step, top, line_n, tunnel, supply, start, w0, wanted, fastest_mps, slowest_mps, halvings, p):  # type: ignore[no-untyped-def]
    """The top speed (m/s) with which the trip from node `start` takes the wanted time (s), by bisection."""
    low = slowest_mps
    high = fastest_mps
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        if run_time(step, top, middle * middle, line_n, tunnel, supply, start, w0, p) > wanted:
            low = middle
        else:
            high = middle
    return high


@dataclass(frozen=True, kw_only=True)
class Habit:
    """A driver's margins to the permitted speeds. Braking is planned with `braking_mps2`, and at most `reserve_ratio`
    of the largest braking force. Speeds stay below limits by `below_mps`, or by a tenth of the limit if that is less.
    """

    braking_mps2: float
    reserve_ratio: float = 0.9
    below_mps: float = 1.0 * KMH


@dataclass(frozen=True, kw_only=True, eq=False)
class LineKnowledge:
    """Route and train as the driver knows them: as planned, without the deviations of the run."""

    route: Route
    vehicle: Vehicle
    train: TrainNumbers = field(init=False)
    line_limits_mps: Stretches = field(init=False)
    """The limit of the line over the whole train, by the position of its head."""
    limits_mps: Stretches = field(init=False)
    """The limit that a driver keeps: the limit of the line or the train's own top speed, whichever is lower."""
    supply: Stretches = field(init=False)

    def __post_init__(self) -> None:
        line = self.route.limits_over_train(self.vehicle.train_length_m)
        allowed = np.minimum(line.value, self.vehicle.max_speed_mps)
        object.__setattr__(self, "train", train_numbers(self.vehicle))
        object.__setattr__(self, "line_limits_mps", line)
        object.__setattr__(self, "limits_mps", Stretches(start_m=line.start_m, value=allowed))
        object.__setattr__(self, "supply", self.route.supply())

    def planned_braking_mps2(self, wish_mps2: float) -> float:
        """The deceleration (m/s²) planned for limits and stops: the driver's wish, or what the train can, if lower."""
        train = self.train
        brakes_mps2 = float(brake_effort(PLANNED_AT_MPS, 1.0, train)) / train.inertial_mass_kg
        return min(wish_mps2, PLANNED_RATIO * min(brakes_mps2, train.max_deceleration_mps2))


class Outlook:
    """The line up to the next halt as a driver with a certain habit of braking foresees it.

    It is valid for positions up to the halt. Outside the grid of cells, the values of the first or last cell
    apply.
    """

    def __init__(self, line: LineKnowledge, cab: CabView, habit: Habit) -> None:
        self.halt_m = cab.halt_m
        self.train = line.train
        cells = max(math.ceil((self.halt_m + CELL_M) / CELL_M), 1)
        node_m = self.halt_m - CELL_M * np.arange(cells, -1, -1.0)
        self._first_m, self._cells = float(node_m[0]), cells
        limit = _limits(line, node_m, cab.restrictions)
        falls = np.flatnonzero(np.diff(limit) < 0.0) + 1
        self._boards = list(zip(node_m[falls].tolist(), limit[falls].tolist(), strict=True))
        limit = limit - np.minimum(habit.below_mps, 0.1 * limit)
        self._line_n = _line_n(line, node_m)
        self._tunnel = _tunnels(line, node_m)
        self._supply = _least(line.supply, node_m)
        self._top = ceiling(
            CELL_M, limit, self._line_n, self._tunnel, self._supply, habit.braking_mps2,
            habit.reserve_ratio, self.train,
        )  # fmt: skip
        self.top_mps = math.sqrt(self._top.max())
        """The highest speed anywhere up to the halt."""
        # For values that are looked up one by one many times a second, lists are faster than arrays.
        self._allowed_w: list[float] = self._top.tolist()
        self._cells_line_n: list[float] = self._line_n.tolist()
        self._cells_tunnel: list[float] = self._tunnel.tolist()

    def allowed_mps(self, s_m: float) -> float:
        """The highest speed (m/s) from which planned braking keeps all known limits and stops ahead."""
        if s_m >= self.halt_m:
            return 0.0
        (i, part), w = self._cell(s_m), self._allowed_w
        return math.sqrt(w[i] + part * (w[i + 1] - w[i]))

    def needed_braking_mps2(self, s_m: float, speed_mps: float, least_way_m: float) -> float:
        """The constant deceleration (m/s²) for the speeds allowed ahead, with distances of at least `least_way_m`."""
        return float(needed_braking(CELL_M, self._first_m, self._top, s_m, speed_mps, least_way_m))

    def braking_to_mps2(self, s_m: float, speed_mps: float, to_mps: float, to_m: float) -> float:
        """The least constant deceleration (m/s²) to a speed at a place that obeys all lower limits before it.

        Negative: none is needed; infinite beyond the place.
        """
        places = [*((at_m, limit_mps) for at_m, limit_mps in self._boards if s_m < at_m < to_m), (to_m, to_mps)]
        w = speed_mps**2
        return max((w - v * v) / (2.0 * (at_m - s_m)) if at_m > s_m else math.inf for at_m, v in places)

    def resisting_n(self, s_m: float, speed_mps: float) -> float:
        """The force (N) that resists the train at `s_m`: running resistance, tunnel, curves and gradient."""
        i, _ = self._cell(s_m)
        train = self.train
        quadratic = train.c2_n_per_mps2 + self._cells_tunnel[i]
        return self._cells_line_n[i] + train.c0_n + speed_mps * (train.c1_n_per_mps + quadratic * speed_mps)

    def cap_for(self, time_s: float, s_m: float, speed_mps: float) -> float:
        """The top speed (m/s) with which the train reaches the halt `time_s` after now."""
        return float(
            cap_for_time(
                CELL_M, self._top, self._line_n, self._tunnel, self._supply, self._cell(s_m)[0], speed_mps**2, time_s,
                self.top_mps, SLOWEST_CAP_MPS, CAP_HALVINGS, self.train,
            )
        )  # fmt: skip

    def _cell(self, s_m: float) -> tuple[int, float]:
        x = (s_m - self._first_m) / CELL_M
        i = min(max(int(x), 0), self._cells - 1)
        return i, min(max(x - i, 0.0), 1.0)


class Foresight:
    """The outlook of a driver, recomputed when the halt or the restrictions change."""

    def __init__(self, line: LineKnowledge, habit: Habit) -> None:
        self.line, self.habit = line, habit
        self._key: tuple[float, tuple[Restriction, ...]] | None = None
        self._outlook: Outlook | None = None

    def outlook(self, cab: CabView) -> Outlook:
        """The outlook for a view of the cab."""
        key = (cab.halt_m, cab.restrictions)
        if self._outlook is None or key != self._key:
            self._key, self._outlook = key, Outlook(self.line, cab, self.habit)
        return self._outlook


def _limits(line: LineKnowledge, node_m: Floats, restrictions: tuple[Restriction, ...]) -> Floats:
    """The limit over the train in each cell (m/s), temporary ones included."""
    length_m = line.vehicle.train_length_m
    limit = _least(line.limits_mps, node_m)
    for one in restrictions:
        inside = one.is_under(node_m[:-1], node_m[1:], length_m)
        limit = np.where(inside, np.minimum(limit, one.limit_mps), limit)
    return limit


def _least(stretches: Stretches, node_m: Floats) -> Floats:
    """The least of the values at both ends and in the middle of each cell."""
    start, end = node_m[:-1], node_m[1:] - POSITION_TOLERANCE_M
    return np.minimum(np.minimum(stretches.at(start), stretches.at(end)), stretches.at(0.5 * (start + end)))


def _line_n(line: LineKnowledge, node_m: Floats) -> Floats:
    """Force of gradient and curves in each cell (N), over the train."""
    route, mass_kg = line.route, line.vehicle.mass_kg
    tail = node_m[:-1] - line.vehicle.train_length_m
    grade = route.gradients_ratio.mean(tail, node_m[1:])
    curve_mps2 = line.vehicle.line_resistance_mps2(route).mean(tail, node_m[1:])
    return np.asarray(mass_kg * (STANDARD_GRAVITY_MPS2 * grade + curve_mps2))


def _tunnels(line: LineKnowledge, node_m: Floats) -> Floats:
    """Additional v² coefficient of tunnels in each cell (N/(m/s)²), over the train."""
    tail = node_m[:-1] - line.vehicle.train_length_m
    return line.vehicle.tunnel_n_per_mps2(line.route).mean(tail, node_m[1:])
