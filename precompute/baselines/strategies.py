"""Baseline strategies of driving without an optimiser: fastest, reduced maximum speed, four modes.

Like the front, each strategy gives a run on the integration grid of any section (gradients, limits, any loss level),
with its trajectory, its energy balance and its fit to the time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError, InfeasibleError
from das.domain.route import Floats
from das.domain.trajectory import EnergyBalance, Trajectory
from das.domain.units import KMH
from das.domain.vehicle import BrakePolicy
from das.solver import tolerances as tol
from das.solver.kernels.driving import climbing_floor, trip_time
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.kernels.tuples import SpeedBounds
from das.solver.section import Section, build_section
from das.solver.solution import Fit, trajectory_on
from das.solver.warm_up import tiny_route, tiny_vehicle
from precompute.baselines import Strategy, kernels

Ints = NDArray[np.int64]

LOWEST_CRUISE_MPS = 1.0
"""Lowest speed (m/s) at which a strategy cruises or passes a crest."""
SPEED_ROUNDING_MPS = 1e-10
"""Largest difference (m/s) between cruising speeds that count as the same."""
SCANNED_SPEEDS = 8
"""Number of cruising speeds tried before the search around the best one."""
GOLDEN_STEPS = 9
TRIED_SPEEDS, ENOUGH_RATIO = 20, 2e-3
"""Largest number of cruising speeds for which runs on time are sought, and the relative excess over the dual value: a
run with no more energy than that ends the search."""
MAX_PRICES = 60
HIGHEST_PRICE_RATIO = 1e3
"""Highest price of time tried for coasting, as a multiple of the traction power: so high that no loss of time is
worthwhile."""
SPARE_RATIO, SPARE_S = 1.2, 5.0
"""Multiple of the spare time, and additional time (s): an arc that loses more time than their sum is dropped."""
NEAR_S = 0.7
"""Largest deviation (s) of a set of arcs from the wanted time that is made up by changing the cruising speed."""
EXCHANGES = 5
"""Largest number of arcs that are exchanged to approach the wanted time."""
TUNED_RATIO = 0.05
"""Largest relative change of the cruising speed to bring a run with given arcs to the wanted time."""
MAX_TUNED, ENOUGH_TUNED = 20, 3
"""Largest number of sets of arcs that are tried, and the number of runs on time after which the search stops."""


class BaselineRun(NamedTuple):
    """Speeds at the nodes, the time (inf after a stall), the cruising speed, and a mask of the coasted intervals."""

    speeds_mps: Floats
    time_s: float
    cruise_mps: float
    coasting: NDArray[np.bool_]


class Driving:
    """The kernels, bound to a section and to the envelope along which the train brakes (default: with all brakes)."""

    def __init__(self, section: Section, envelope_mps: Floats | None = None) -> None:
        self.section = section
        self.envelope_mps = section.envelope_mps if envelope_mps is None else envelope_mps
        self.line = section.for_kernels
        # With a floor of 0 at a crest, rounding would decide whether the train passes it.
        floor = climbing_floor(self.line, self.envelope_mps, LOWEST_CRUISE_MPS, section.train)
        self.bounds = SpeedBounds(floor, self.envelope_mps)
        self.fastest = self.cruise(float(self.envelope_mps.max()))
        self.top_mps = float(self.fastest.speeds_mps.max())

    def cruise(self, cruise_mps: float) -> BaselineRun:
        """The base run of a cruising speed: the run without coasting arcs."""
        speeds = self._start()
        time_s = kernels.cruise_run(cruise_mps, self.line, self.bounds, self.section.train, speeds)
        return _run(speeds, time_s, cruise_mps, np.zeros(len(speeds) - 1, np.bool_))

    def coast(self, cruise_mps: float, ends: Ints) -> BaselineRun:
        """A base run with coasting arcs (see `precompute.baselines.kernels.four_mode_run`)."""
        base = self.cruise(cruise_mps)
        speeds, coasting = self._start(), np.empty(len(ends), np.bool_)
        time_s = kernels.four_mode_run(
            cruise_mps, ends, base.speeds_mps, self.line, self.bounds, self.section.train, speeds, coasting
        )
        return _run(speeds, time_s, cruise_mps, coasting)

    def cruise_in(self, time_s: float) -> BaselineRun:
        """The base run that takes a time, or the nearest time."""
        return hit(self.cruise, LOWEST_CRUISE_MPS, self.top_mps, time_s)

    def energy_j(self, run: BaselineRun) -> float:
        """Net energy at the current collector."""
        section = self.section
        return trajectory_on(section, section, run.speeds_mps).balance(section.vehicle, section.loss).input

    def _start(self) -> Floats:
        speeds = np.empty(len(self.section.node_m))
        speeds[0] = self.section.start_speed_mps
        return speeds


def _run(speeds: Floats, time_s: float, cruise_mps: float, coasting: NDArray[np.bool_]) -> BaselineRun:
    return BaselineRun(speeds, float(time_s) if time_s >= 0 else math.inf, cruise_mps, coasting)


def driven_with_motors(section: Section) -> Driving | None:
    """Driving that brakes with the motors only; None if it is impossible, or the same as with all brakes."""
    train = section.train
    if section.brakes is not BrakePolicy.BLENDED or train.friction_force_n == 0 or train.electric_force_n == 0:
        return None
    envelope = kernels.electric_envelope(section.for_kernels, section.envelope_mps, train)
    if section.start_speed_mps > envelope[0] or (section.floor_mps > envelope).any():
        return None
    return Driving(section, envelope)


def hit(drive: Callable[[float], BaselineRun], slow_mps: float, quick_mps: float, time_s: float) -> BaselineRun:
    """The run that takes `time_s`, by bisection of the cruising speed; if none does, the run at the nearer end."""
    slow, quick = drive(slow_mps), drive(quick_mps)
    if not quick.time_s <= time_s <= slow.time_s:
        return quick if time_s < quick.time_s else slow
    while quick.cruise_mps - slow.cruise_mps > SPEED_ROUNDING_MPS:
        run = drive(0.5 * (slow.cruise_mps + quick.cruise_mps))
        if abs(run.time_s - time_s) <= 0.05 * tol.TIME_TOLERANCE_S:
            return run
        if run.time_s > time_s:
            slow = run
        else:
            quick = run
    return min(quick, slow, key=lambda run: abs(run.time_s - time_s))


class _Path(NamedTuple):
    """Coasting arcs in order, as indices into the edges, and the time and energy that they add to the base run."""

    arcs: tuple[int, ...]
    extra_s: float
    extra_j: float


class _Edges(NamedTuple):
    """All arcs of a base run (E,): start and end node, extra time and energy."""

    start: Ints
    end: Ints
    extra_s: Floats
    extra_j: Floats


class _Arcs:
    """All coasting arcs of a base run, and the best of them for a spare time."""

    def __init__(self, driving: Driving, base: BaselineRun, spare_s: float) -> None:
        section = driving.section
        n = len(section.step_m)
        self.base, self.spare_s = base, spare_s
        self.highest_w = HIGHEST_PRICE_RATIO * section.train.traction_power_w
        base_s, base_j = np.empty(n + 1), np.empty(n + 1)
        costs = (section.train, section.loss_params)
        kernels.run_costs(base.speeds_mps, driving.line, *costs, base_s, base_j)
        self.base_j = float(base_j[-1])
        shape = (n, kernels.CROSSINGS)
        self._table = (np.empty(shape, np.int64), np.empty(shape), np.empty(shape), np.empty(n, np.int64))
        kernels.coasting_arcs(
            base.speeds_mps, base_s, base_j, SPARE_RATIO * spare_s + SPARE_S, driving.line, driving.bounds, *costs,
            *self._table,
        )  # fmt: skip

    def at(self, price_w: float) -> _Path:
        """The best arcs at a price of time (W)."""
        target, extra_s, extra_j, count = self._table
        n = len(count)
        choice, cost, time_s = np.empty(n, np.int64), np.empty(n + 1), np.empty(n + 1)
        kernels.best_arcs(price_w, target, extra_s, extra_j, count, choice, cost, time_s)
        first = np.cumsum(count) - count
        arcs, i = [], 0
        while i < n:
            if choice[i] >= 0:
                arcs.append(int(first[i] + choice[i]))
                i = int(target[i, choice[i]])
            else:
                i += 1
        return _Path(tuple(arcs), float(time_s[0]), float(cost[0] - price_w * time_s[0]))

    def around(self) -> tuple[_Path, _Path, float]:
        """The best arcs just above and just within the spare time, and the price of time (W) at which both are best.

        The dual function of the price, least (energy + price·(time − wanted)), is piecewise linear: each new price is
        that at which the lines of the two neighbours meet. If the best arcs at price 0 are within the spare time, they
        are returned as both.
        """
        slow = self.at(0.0)
        if slow.extra_s <= self.spare_s:
            return slow, slow, 0.0
        price_w, quick = self.highest_w, self.at(self.highest_w)
        for _ in range(MAX_PRICES):
            price_w = (quick.extra_j - slow.extra_j) / (slow.extra_s - quick.extra_s)
            new, known = self.at(price_w), slow.extra_j + price_w * slow.extra_s
            if new.extra_j + price_w * new.extra_s >= known - 1e-9 * max(abs(known), 1.0):
                break
            if new.extra_s > self.spare_s:
                slow = new
            else:
                quick = new
        return slow, quick, price_w

    def bound_j(self) -> float:
        """Dual value: no set of arcs on this base run that takes the wanted time needs less energy."""
        slow, _, price_w = self.around()
        return self.base_j + slow.extra_j + price_w * (slow.extra_s - self.spare_s)

    def near_time(self) -> list[_Path]:
        """Sets of arcs that take about the spare time; first the set that is best at the price of time.

        The time of the best arcs jumps with the price. To approach the spare time, arcs are added to, removed from or
        exchanged in the best sets on both sides of the jump.
        """
        slow, quick, price_w = self.around()
        if slow is quick:
            return [slow]
        edges, early, late = self._edges(), [quick], [slow]
        for _ in range(EXCHANGES):
            for path in [*self._exchanged(slow, edges), *self._exchanged(quick, edges)]:
                (early if path.extra_s <= self.spare_s else late).append(path)
            slow, quick = min(late, key=self._miss_s), min(early, key=self._miss_s)
            if min(self._miss_s(slow), self._miss_s(quick)) <= NEAR_S:
                break

        def best(paths: list[_Path], nearest: _Path) -> list[_Path]:
            near = {path for path in paths if self._miss_s(path) <= NEAR_S} | {nearest}
            return sorted(near, key=lambda path: (path.extra_j + price_w * path.extra_s, path.arcs))

        # A late set that coasts from the run-up is never on time, so early and late sets are taken in turn.
        pairs = zip_longest(best(early, quick), best(late, slow))
        mixed = [path for pair in pairs for path in pair if path is not None]
        return mixed[:MAX_TUNED]

    def ends(self, path: _Path) -> Ints:
        """The end node of the arc that starts at each node (0: none), as the kernel `four_mode_run` takes it."""
        edges, arcs = self._edges(), list(path.arcs)
        result = np.zeros(len(self._table[0]), np.int64)
        result[edges.start[arcs]] = edges.end[arcs]
        return result

    def _miss_s(self, path: _Path) -> float:
        return abs(path.extra_s - self.spare_s)

    def _edges(self) -> _Edges:
        target, extra_s, extra_j, count = self._table
        used = np.arange(kernels.CROSSINGS) < count[:, None]
        return _Edges(np.nonzero(used)[0], target[used], extra_s[used], extra_j[used])

    def _exchanged(self, path: _Path, edges: _Edges) -> Iterator[_Path]:
        """The path with one arc added, left out, or exchanged for another between its neighbours."""
        arcs = path.arcs
        begin = [*edges.start[list(arcs)], len(self._table[0])]
        end = [0, *edges.end[list(arcs)]]
        for k in range(len(arcs) + 1):
            for out in (0, 1) if k < len(arcs) else (0,):
                extra_s = path.extra_s - (edges.extra_s[arcs[k]] if out else 0.0)
                extra_j = path.extra_j - (edges.extra_j[arcs[k]] if out else 0.0)
                if out:
                    yield _Path(arcs[:k] + arcs[k + 1 :], extra_s, extra_j)
                between = (edges.start >= end[k]) & (edges.end <= begin[k + out])
                between &= np.abs(extra_s + edges.extra_s - self.spare_s) < self._miss_s(path)
                for e in np.flatnonzero(between):
                    changed = (*arcs[:k], int(e), *arcs[k + out :])
                    yield _Path(changed, float(extra_s + edges.extra_s[e]), float(extra_j + edges.extra_j[e]))


class FourModeSearch:
    """Finds the cruising speed and coasting arcs of least energy for a trip time."""

    def __init__(self, driving: Driving, time_s: float) -> None:
        self.driving, self.time_s = driving, time_s

    def run(self) -> list[BaselineRun]:
        """Good runs that take the wanted time; a single quicker run if using all of the time would cost energy."""
        top_speed = self.driving.cruise_in(self.time_s)
        speeds = self._best_speeds(top_speed.cruise_mps)
        arcs = self.arcs(speeds[0])
        slow, quick, _ = arcs.around()
        if slow is quick and quick.extra_s < arcs.spare_s:
            return [self.driving.coast(speeds[0], arcs.ends(quick))]
        bound_j = arcs.bound_j()
        runs = [top_speed]
        for speed_mps in speeds[:TRIED_SPEEDS]:
            runs += self._runs_on_time(speed_mps)
            # An arc that grazes the base run may end early once the speed is changed to hit the time; another set is
            # then tried.
            least_j = min(self.driving.energy_j(run) for run in runs)
            if least_j <= bound_j + ENOUGH_RATIO * max(abs(bound_j), abs(arcs.base_j)):
                break
        return runs

    def _runs_on_time(self, cruise_mps: float) -> list[BaselineRun]:
        """Runs of the wanted time near a cruising speed, at most `ENOUGH_TUNED`."""
        arcs = self.arcs(cruise_mps)
        runs: list[BaselineRun] = []
        for path in arcs.near_time():
            run = self._on_time(cruise_mps, arcs.ends(path))
            if abs(run.time_s - self.time_s) <= tol.TIME_TOLERANCE_S:
                runs.append(run)
            if len(runs) >= ENOUGH_TUNED:
                break
        return runs

    def arcs(self, cruise_mps: float) -> _Arcs:
        """All coasting arcs at a cruising speed."""
        base = self.driving.cruise(cruise_mps)
        if math.isinf(base.time_s):
            raise InfeasibleError(f"{self.driving.section.name}: the train stalls at {cruise_mps / KMH:.1f} km/h")
        return _Arcs(self.driving, base, max(self.time_s - base.time_s, 0.0))

    def _on_time(self, cruise_mps: float, ends: Ints) -> BaselineRun:
        """The run with these arcs that takes the wanted time, by a small change of the cruising speed."""

        def drive(speed_mps: float) -> BaselineRun:
            return self.driving.coast(speed_mps, ends)

        run = drive(cruise_mps)
        if run.time_s > self.time_s:
            return hit(drive, cruise_mps, min(cruise_mps * (1 + TUNED_RATIO), self.driving.top_mps), self.time_s)
        reached_mps = min(cruise_mps, float(run.speeds_mps.max()))
        return hit(drive, max(reached_mps * (1 - TUNED_RATIO), LOWEST_CRUISE_MPS), reached_mps, self.time_s)

    def _best_speeds(self, low_mps: float) -> list[float]:
        """The cruising speeds tried (a scan, then golden section around the best), least dual value first."""

        def bound_j(speed_mps: float) -> float:
            return self.arcs(speed_mps).bound_j()

        speeds = np.linspace(low_mps, self.driving.top_mps, SCANNED_SPEEDS)
        values = [bound_j(float(v)) for v in speeds]
        best = int(np.argmin(values))
        known = [(value, float(speed)) for value, speed in zip(values, speeds, strict=True)]
        low, high = float(speeds[max(best - 1, 0)]), float(speeds[min(best + 1, len(speeds) - 1)])
        ratio = (3 - math.sqrt(5)) / 2
        a, b = low + ratio * (high - low), high - ratio * (high - low)
        at_a, at_b = bound_j(a), bound_j(b)
        for _ in range(GOLDEN_STEPS):
            known += [(at_a, a), (at_b, b)]
            if at_a <= at_b:
                high, b, at_b = b, a, at_a
                a = low + ratio * (high - low)
                at_a = bound_j(a)
            else:
                low, a, at_a = a, b, at_b
                b = high - ratio * (high - low)
                at_b = bound_j(b)
        return [speed for _, speed in sorted(known)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """A run of a baseline strategy on a section's integration grid.

    `fit`, `least_time_s`, `requested_s` and `feasible` are those of `das.solver.solution.Solution`. `cruise_speed_mps`
    is the speed held (None for the fastest run, which runs at the limits). `coasting_m`: begin and end (route position)
    of each stretch on which the train coasts, in order.
    """

    strategy: Strategy
    trajectory: Trajectory
    balance: EnergyBalance
    fit: Fit
    least_time_s: float
    requested_s: float
    feasible: bool
    cruise_speed_mps: float | None = None
    coasting_m: tuple[tuple[float, float], ...] = ()

    @property
    def time_s(self) -> float:
        return self.trajectory.time_s


def baseline(strategy: Strategy, section: Section, time_s: float | None) -> Baseline:
    """The run of a baseline strategy; only the fastest run needs no time.

    Raises DasError for the optimal strategy, which `das.solver.front` finds, or if the time is missing.
    """
    if strategy is Strategy.FASTEST:
        return fastest(section, requested_s=time_s)
    if time_s is None or strategy is Strategy.OPTIMAL:
        raise DasError(
            f"strategy {strategy} with trip time {time_s} s: expected top-speed or four-mode with a time, or fastest"
        )
    return reduced_maximum_speed(section, time_s) if strategy is Strategy.TOP_SPEED else four_modes(section, time_s)


def warm_up() -> None:
    """Compile (or load from cache) every kernel of the baselines."""
    both = replace(tiny_vehicle(), brake_policy=BrakePolicy.BLENDED, friction_brake_force_n=1e5)
    section = build_section(tiny_route(), both)
    time_s = 1.2 * fastest(section).time_s
    reduced_maximum_speed(section, time_s)
    four_modes(section, time_s)


def fastest(section: Section, *, requested_s: float | None = None) -> Baseline:
    """The fastest run: full effort, the limits, full brake; `requested_s` only decides `fit`.

    Raises InfeasibleError if the train stalls, DasError for a requested time that is not positive.
    """
    if requested_s is not None:
        _check_time(requested_s)
    speeds = _fastest_mps(section)
    return _baseline(Strategy.FASTEST, section, speeds, speeds, requested_s)


def reduced_maximum_speed(section: Section, time_s: float) -> Baseline:
    """The run of duration `time_s` under one lower maximum speed (Nold & Corman 2024, section 4.1; their ref. 7).

    The train uses full effort up to min(limit, v), holds that speed (with traction on climbs, brakes on descents, and
    full traction where it cannot hold it), and brakes fully along the envelope. A bisection finds the v that meets the
    time to `TIME_TOLERANCE_S`. The speed exceeds v only where the end speed or a hill needs a run-up, or where the
    brakes cannot hold it.

    A time below the least possible gives the fastest run (`Fit.LATE`). A time longer than a run at `LOWEST_CRUISE_MPS`
    takes gives the run at that speed (`Fit.EARLY`). Raises DasError for a time that is not positive.
    """
    _check_time(time_s)
    quickest = _fastest_mps(section)
    if time_s <= _time_s(section, quickest) + tol.TIME_TOLERANCE_S:
        return _baseline(Strategy.TOP_SPEED, section, quickest, quickest, time_s, float(quickest.max()))
    run = Driving(section).cruise_in(time_s)
    return _baseline(Strategy.TOP_SPEED, section, run.speeds_mps, quickest, time_s, run.cruise_mps)


def four_modes(section: Section, time_s: float) -> Baseline:
    """The best run of duration `time_s` made of full traction, cruising, coasting and full brake.

    For constant efficiency these are the regimes of the optimum (e.g. Howlett & Pudney 1995). One cruising speed v
    holds for the section, as for `reduced_maximum_speed`; from that base run the train may coast at any node of the
    grid, until its speed equals that of the base run again: where the base run brakes, or earlier, reaching that speed
    from below or, on a descent, from above. Full brake means all brakes, or the motors at full effort (with friction
    only to hold a speed): whichever is better, for the whole section.

    Best switching points: for a given v, coasting arcs do not depend on each other, so for a price of time the best set
    is a shortest path along the nodes. The price is found by cutting planes, v by a scan and golden section on the dual
    value (least energy + price·time − price·time wanted), which varies smoothly although arcs begin at nodes. Where the
    time jumps with the price, single arcs are exchanged. Finally, v is moved a little, with the arcs kept, until the
    time is hit to `TIME_TOLERANCE_S`. The top-speed run is a candidate, so the result never needs more energy. Another
    cruising speed for each limit, or a run-up above v that a climb does not require, is not tried.

    A time below the least possible gives the fastest run (`Fit.LATE`); if a slower run would cost more energy, the
    least-energy run is returned (`Fit.EARLY`). Raises DasError for a time that is not positive.
    """
    _check_time(time_s)
    quickest = _fastest_mps(section)
    if time_s <= _time_s(section, quickest) + tol.TIME_TOLERANCE_S:
        return _baseline(Strategy.FOUR_MODE, section, quickest, quickest, time_s, float(quickest.max()))
    driving, gentle = Driving(section), driven_with_motors(section)
    runs = FourModeSearch(driving, time_s).run()
    if gentle is not None and gentle.fastest.time_s < time_s:
        runs += FourModeSearch(gentle, time_s).run()
    run = min(runs, key=driving.energy_j)
    coasting_m = _coasting(run, section)
    return _baseline(Strategy.FOUR_MODE, section, run.speeds_mps, quickest, time_s, run.cruise_mps, coasting_m)


def _check_time(time_s: float) -> None:
    if not time_s > 0 or math.isinf(time_s):
        raise DasError(f"trip time {time_s} s: expected a finite time > 0 s")


def _fastest_mps(section: Section) -> Floats:
    speeds = np.empty(len(section.node_m))
    speeds[0] = section.start_speed_mps
    time_s = fastest_roll_out(section.for_kernels, section.envelope_mps, section.train, speeds)
    if not 0 <= time_s < math.inf:
        raise InfeasibleError(
            f"{section.name}: the train stalls on the way, or the section is too short for it to move"
        )
    return speeds


def _time_s(section: Section, speeds: Floats) -> float:
    return float(trip_time(section.step_m, speeds))


def _coasting(run: BaselineRun, section: Section) -> tuple[tuple[float, float], ...]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], run.coasting, [False])).astype(np.int8)))
    return tuple((float(section.node_m[a]), float(section.node_m[b])) for a, b in edges.reshape(-1, 2))


def _baseline(
    strategy: Strategy,
    section: Section,
    speeds: Floats,
    quickest: Floats,
    requested_s: float | None,
    cruise_mps: float | None = None,
    coasting_m: tuple[tuple[float, float], ...] = (),
) -> Baseline:
    trajectory = trajectory_on(section, section, speeds)
    least_time_s = _time_s(section, quickest)
    requested_s = least_time_s if requested_s is None else requested_s
    miss_s = trajectory.time_s - requested_s
    ends_right = abs(speeds[-1] - section.end_speed_mps) <= tol.SPEED_TOLERANCE_MPS
    return Baseline(
        strategy=strategy,
        trajectory=trajectory,
        balance=trajectory.balance(section.vehicle, section.loss),
        fit=Fit.ON_TIME if abs(miss_s) <= tol.TIME_TOLERANCE_S else Fit.LATE if miss_s > 0 else Fit.EARLY,
        least_time_s=least_time_s,
        requested_s=requested_s,
        feasible=bool(ends_right and (speeds <= section.envelope_mps + tol.SPEED_TOLERANCE_MPS).all()),
        cruise_speed_mps=None if cruise_mps is None else min(cruise_mps, float(speeds.max())),
        coasting_m=coasting_m,
    )
