"""Baseline strategies: how trains are driven without an optimiser – fastest, reduced maximum speed, four modes.

Like the front, each strategy gives a run on the integration grid of any section (gradients, limits, any loss level),
with its trajectory, its energy balance and how well it meets the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError, InfeasibleError
from das.domain.trajectory import EnergyBalance, Trajectory
from das.domain.vehicle import BrakePolicy
from das.solver import tolerances as tol
from das.solver.kernels.driving import trip_time
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.section import Section, build_section
from das.solver.solution import Fit, trajectory_on
from das.solver.warm_up import tiny_route, tiny_vehicle
from precompute.baselines import Strategy
from precompute.baselines.search import BaselineRun, Driving, FourModeSearch, driven_with_motors

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """A run of a baseline strategy on a section's integration grid.

    `fit`, `least_time_s`, `requested_s` and `feasible` mean what they mean in `das.solver.solution.Solution`.
    `cruise_speed_mps` is the speed held (None for the fastest run, which runs at the limits). `coasting_m`: begin and
    end (route position) of each stretch on which the train coasts, in order.
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

    Full effort up to min(limit, v); that speed is held (traction on climbs, brakes on descents; full traction where the
    train cannot hold it); full brake along the envelope. A bisection finds the v that hits the time to
    `TIME_TOLERANCE_S`. The speed exceeds v only where the end speed or a hill needs a run-up, or where the brakes
    cannot hold it.

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
    grid, until it meets the base run again: at a brake point, or in between, below it or (on a descent) above it. Full
    brake means all brakes, or the motors at full effort (with friction only to hold a speed): whichever is better, for
    the whole section.

    Best switching points: for a given v, coasting arcs do not depend on each other, so for a price of time the best set
    is a shortest path along the nodes. The price is found by cutting planes, v by a scan and golden section on the dual
    value (least energy + price·time − price·time wanted), which varies smoothly although arcs begin at nodes. Where the
    time jumps with the price, single arcs are exchanged. Finally, v is moved a little, with the arcs kept, until the
    time is hit to `TIME_TOLERANCE_S`. The top-speed run is a candidate, so the result never needs more energy. Not
    tried: another cruising speed per limit, or running up above v before a climb.

    A time below the least possible gives the fastest run (`Fit.LATE`); where a slower run would cost more energy, the
    least-energy run (`Fit.EARLY`). Raises DasError for a time that is not positive.
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
        raise InfeasibleError(f"{section.name}: the train stalls on its way, or the section is too short to move")
    return speeds


def _time_s(section: Section, speeds: Floats) -> float:
    return float(trip_time(section.step_m, speeds))


def _coasting(run: BaselineRun, section: Section) -> tuple[tuple[float, float], ...]:
    """Begin and end (m) of each unbroken stretch of coasting."""
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
