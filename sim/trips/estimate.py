"""The forces and the energy of a driven run, by inverse dynamics with a chosen vehicle.

Positions do not show the train, its mass, the wind, the shares of motors and friction brake (electric first is
assumed), or the energy of auxiliaries. The figures are therefore estimates; `energy_range` gives their uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.domain.conditions import Conditions
from das.domain.losses import LossMap
from das.domain.route import Floats
from das.domain.trajectory import EnergyBalance, Trajectory, mean_resistance_n
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver.line_profile import LineProfile
from das.solver.section import Section

ESTIMATE_BEYOND_RATIO: Final = 1.05
"""Multiple of the vehicle's envelope above which a force exceeds its capability."""
ESTIMATE_MASS_RATIO: Final = 0.05
"""Relative error that the mass may have."""
ESTIMATE_RESISTANCE_RATIO: Final = 0.10
"""Relative error that the running resistance may have."""
ESTIMATE_WIND_MPS: Final = 5.0
"""Speed (m/s) of a possible wind along the line, in either direction."""
ESTIMATE_HELD_S: Final = 8
"""Time (s) for which the strongest force must be held; smoothing hides shorter peaks."""
ESTIMATE_FOREIGN_RATIO: Final = 0.005
"""Largest share of the time with more force than the vehicle has; beyond it, another vehicle made the trip."""
CHOICE_OVERSPEED_RATIO: Final = 1.05
"""Multiple of its top speed that a train may reach; above it, train protection brakes."""
ESTIMATE_MIN_STEP_M: Final = 0.05
"""Distance (m) below which points count as one, at which the train stands."""
ESTIMATE_MOST_DOUBT_RATIO: Final = 0.25
"""Largest additional uncertainty of mass and resistance due to missing force: an empty or an overloaded train."""
ESTIMATE_SMOOTHING_RATIO: Final = 10.0
"""Factor by which the density of jerk may be higher or lower: the window shrinks or grows by a factor of 1.8."""


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """An unknown of the drive, and the energy at the collector (J) at both ends of its range.

    `assumed` is the range of the unknown, in words.
    """

    name: str
    assumed: str
    low_j: float
    high_j: float


@dataclass(frozen=True, kw_only=True)
class EnergyRange:
    """The estimated energy (J), its range for each unknown alone, and for all of them at their worst."""

    estimate_j: float
    unknowns: tuple[Unknown, ...]
    low_j: float
    high_j: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenEstimate:
    """A driven run with the forces that this vehicle would have needed.

    `index[i]` is the point of the run at node i of the trajectory. `beyond` marks intervals in which the run needs more
    force for 8 s than the vehicle has; then the train was another one, or the positions are inaccurate. `lacking_ratio`
    is the largest share of the force needed for 8 s that the vehicle lacks.
    """

    trajectory: Trajectory
    balance: EnergyBalance
    energy_input_j: Floats
    index: NDArray[np.intp]
    beyond: NDArray[np.bool_]
    lacking_ratio: float

    @property
    def beyond_ratio(self) -> float:
        """The share of time in which the run needs more force than the vehicle has."""
        step_s = self.trajectory.interval_s()
        return float(step_s[self.beyond].sum() / max(step_s.sum(), 1e-9))


def estimate_run(section: Section, time_s: Floats, s_m: Floats, speed_mps: Floats) -> DrivenEstimate:
    """Inverse dynamics over a run; the arrays have one length, and times and positions never decrease.

    The force comes from the change of v² over the distance, and the resistance, gradient and curves of each interval.
    The motors drive; they also brake up to their envelope, and the friction brake does the rest (or all of it, if the
    section brakes so).
    """
    vehicle = section.vehicle
    index = _moving_points(s_m)
    node, v = s_m[index], speed_mps[index]
    profile = LineProfile.on(section.route, vehicle, node, section.train_length_m)
    step = profile.step_m
    force = (
        vehicle.inertial_mass_kg * np.diff(v**2) / (2.0 * step)
        + mean_resistance_n(vehicle.resistance, v, profile.tunnel_n_per_mps2)
        + profile.constant_n
    )
    mean = np.maximum(0.5 * (v[:-1] + v[1:]), 0.1)
    traction, electric_limit = vehicle.traction_effort_n(mean), vehicle.electric_brake_effort_n(mean)
    may_feed_back = (profile.supply >= 0) & (section.brakes is not BrakePolicy.FRICTION)
    motors_limit = np.where(may_feed_back, electric_limit, 0.0)
    electric = np.clip(force, -motors_limit, traction)
    friction = np.minimum(force + motors_limit, 0.0)
    t = time_s[index]
    trajectory = Trajectory(
        s_m=node,
        t_s=t,
        v_mps=v,
        force_el_n=np.where(force > 0, force, electric),
        force_friction_n=friction,
        grade_ratio=profile.grade_ratio,
        grade_and_curve_n=profile.constant_n,
        tunnel_n_per_mps2=profile.tunnel_n_per_mps2,
        limit_mps=profile.limit_mps,
        supply=profile.supply,
    )
    loss = _loss_w(section, electric, mean) * np.diff(t)
    pulls, lacking_traction = _beyond(t, force, traction)
    holds, lacking_brakes = _beyond(t, -force, vehicle.brake_effort_n(mean))
    return DrivenEstimate(
        trajectory=trajectory,
        balance=trajectory.balance_with(vehicle, loss),
        energy_input_j=np.concatenate(([0.0], np.cumsum(trajectory.input_j(loss)))),
        index=index,
        beyond=pulls | holds,
        lacking_ratio=max(lacking_traction, lacking_brakes),
    )


def _beyond(t: Floats, force_n: Floats, largest_n: Floats) -> tuple[NDArray[np.bool_], float]:
    """Mask of the intervals between times (s) in 8 s whose mean force (N) is above the mean of the largest forces, and
    the largest share of it that is missing.
    """
    seconds = np.arange(t[0] + 0.5, t[-1], 1.0)
    here = np.searchsorted(t, seconds) - 1
    length = min(ESTIMATE_HELD_S, len(seconds))
    around = np.lib.stride_tricks.sliding_window_view
    needed_n, had_n = (around(one[here], length).mean(axis=1) for one in (force_n, largest_n))
    over = needed_n > ESTIMATE_BEYOND_RATIO * had_n
    found = np.zeros(len(force_n), dtype=bool)
    for first in np.flatnonzero(over):
        found[here[first] : here[first + length - 1] + 1] = True
    return found, float((1.0 - had_n[over] / needed_n[over]).max(initial=0.0))


def strongest_held_n(driven: DrivenEstimate, inferred: NDArray[np.bool_]) -> tuple[float, float]:
    """The strongest traction and braking (N, >= 0) that were held for 8 s, or for the whole of a shorter run.

    `inferred` marks the points of the run that lie in gaps: the forces there are not counted.
    """
    t, force = driven.trajectory.t_s, driven.trajectory.force_el_n + driven.trajectory.force_friction_n
    seconds = np.arange(t[0] + 0.5, t[-1], 1.0)
    unseen = inferred[driven.index]
    force = np.where(unseen[:-1] | unseen[1:], 0.0, force)  # 0: a force that spans a gap is not held
    here = force[np.searchsorted(t, seconds) - 1]
    held = np.lib.stride_tricks.sliding_window_view(here, min(ESTIMATE_HELD_S, len(here)))
    return max(float(held.min(axis=1).max()), 0.0), max(-float(held.max(axis=1).min()), 0.0)


@dataclass(frozen=True, kw_only=True)
class DrivenCase:
    """A possible case of the drive; the defaults are as in the estimate."""

    mass_ratio: float = 1.0
    resistance_ratio: float = 1.0
    head_wind_mps: float = 0.0
    all_friction: bool = False
    jerk_ratio: float = 1.0

    def train(self, vehicle: Vehicle) -> Vehicle:
        """The train in this case."""
        return Conditions(
            mass_ratio=self.mass_ratio, resistance_ratio=self.resistance_ratio, head_wind_mps=self.head_wind_mps
        ).train(vehicle)

    def brakes(self, section: Section) -> BrakePolicy:
        """The braking of the train in this case."""
        return BrakePolicy.FRICTION if self.all_friction else section.brakes


BRAKING = "braking"
"""The name of an unknown: the shares of motors and friction brake in braking."""

MASS = "mass"
"""The name of an unknown: the mass of the train."""

RESISTANCE = "running resistance"
"""The name of an unknown: the resistance of the train."""

_UnknownEnds = tuple[str, str, tuple[dict[str, Any], dict[str, Any]]]
"""The name of an unknown, its range in words, and the changes of a case at either end of the range."""
_OTHER_UNKNOWNS: tuple[_UnknownEnds, ...] = (
    (
        "wind along the line",
        f"± {ESTIMATE_WIND_MPS:g} m/s",
        ({"head_wind_mps": -ESTIMATE_WIND_MPS}, {"head_wind_mps": ESTIMATE_WIND_MPS}),
    ),
    (BRAKING, "electric first … friction alone", ({"all_friction": False}, {"all_friction": True})),
    (
        "smoothing of the record",
        f"1/{ESTIMATE_SMOOTHING_RATIO:g} to {ESTIMATE_SMOOTHING_RATIO:g} times as strong",
        ({"jerk_ratio": 1.0 / ESTIMATE_SMOOTHING_RATIO}, {"jerk_ratio": ESTIMATE_SMOOTHING_RATIO}),
    ),
)
_DIGITS = 3
"""Decimals of the ratios of mass and resistance that are tried."""


def doubt(beyond_ratio: float, lacking_ratio: float) -> float:
    """The additional uncertainty of mass and resistance compared with a known train, as a share.

    If the trip needs more force than the train has in too much of the time (`beyond_ratio`), it may have been another
    train: one that is lighter or has less resistance by the missing share of the force could have driven it.
    """
    return min(lacking_ratio, ESTIMATE_MOST_DOUBT_RATIO) if beyond_ratio > ESTIMATE_FOREIGN_RATIO else 0.0


def _all_unknowns(doubt_ratio: float) -> tuple[_UnknownEnds, ...]:
    found: list[_UnknownEnds] = []
    for name, key, known in (
        (MASS, "mass_ratio", ESTIMATE_MASS_RATIO),
        (RESISTANCE, "resistance_ratio", ESTIMATE_RESISTANCE_RATIO),
    ):
        off = known + doubt_ratio
        found.append((name, f"± {100 * off:.0f} %", ({key: round(1 - off, _DIGITS)}, {key: round(1 + off, _DIGITS)})))
    return *found, *_OTHER_UNKNOWNS


class DrivenPart(NamedTuple):
    """A part of a trip from one stand to the next: times from 0 on, positions and speeds, arrays of one length."""

    time_s: Floats
    s_m: Floats
    speed_mps: Floats


SmoothedParts = Callable[[float], Sequence[DrivenPart]]
"""A function that returns the parts of a trip if its record is smoothed with a multiple of the usual jerk density."""


def energy_range(section: Section, parts: SmoothedParts, doubt_ratio: float = 0.0) -> EnergyRange:
    """The uncertainty of the energy of a driven trip: inverse dynamics is repeated for every case.

    Each unknown deviates alone, and all together to the ends with the least and the most energy: the extreme range, not
    the likeliest. Mass and resistance may be wrong by `doubt_ratio` more than those of a known train (see `doubt`).
    """
    smoothed = cache(parts)

    @cache
    def driven_j(case: DrivenCase) -> float:
        other = replace(section, vehicle=case.train(section.vehicle), brakes=case.brakes(section))
        return sum(estimate_run(other, *part).balance.input for part in smoothed(case.jerk_ratio))

    unknowns = one_by_one(driven_j, doubt_ratio)
    low_j, high_j = (_outermost(driven_j, sign, _all_unknowns(doubt_ratio)) for sign in (-1.0, 1.0))
    return EnergyRange(estimate_j=driven_j(DrivenCase()), unknowns=unknowns, low_j=low_j, high_j=high_j)


def _energy_at(case: DrivenCase, energy_j: Callable[[DrivenCase], float | None], doubt_ratio: float) -> float | None:
    """The energy (J) in a case; None if it is impossible.

    A train with too little force may have had more effort than in its file. A heavier one, or one with more resistance,
    is therefore not impossible for lack of effort: its energy is as far from the assumed one as that of the opposite
    train.
    """
    found_j = energy_j(case)
    if found_j is not None or not doubt_ratio:
        return found_j
    mass_ratio, resistance_ratio = (round(2.0 - one, _DIGITS) for one in (case.mass_ratio, case.resistance_ratio))
    assumed_j = energy_j(replace(case, mass_ratio=1.0, resistance_ratio=1.0))
    opposite_j = energy_j(replace(case, mass_ratio=mass_ratio, resistance_ratio=resistance_ratio))
    return None if assumed_j is None or opposite_j is None else 2.0 * assumed_j - opposite_j


def one_by_one(energy_j: Callable[[DrivenCase], float | None], doubt_ratio: float = 0.0) -> tuple[Unknown, ...]:
    """The range of an energy (J) for each unknown alone; `doubt_ratio` is that of `doubt`.

    `energy_j` returns None for an impossible case, which is left out. The assumed case must be possible.
    """
    estimate_j = energy_j(DrivenCase())
    assert estimate_j is not None
    unknowns = []
    for name, assumed, ends in _all_unknowns(doubt_ratio):
        cases = [_energy_at(DrivenCase(**end), energy_j, doubt_ratio) for end in ends]
        found = [e for e in (estimate_j, *cases) if e is not None]
        unknowns.append(Unknown(name=name, assumed=assumed, low_j=min(found), high_j=max(found)))
    return tuple(unknowns)


def _outermost(energy_j: Callable[[DrivenCase], float], sign: float, unknowns: Sequence[_UnknownEnds]) -> float:
    """The least (sign < 0) or the most energy (J) with every unknown at one of its ends.

    First, each unknown is set to the end with the largest effect on its own. One unknown may reverse the effect of
    another: a train that brakes by friction loses more with a tail wind. Therefore each in turn is then set to the end
    with the largest effect, until nothing changes.
    """

    def reach(case: DrivenCase) -> float:
        return sign * energy_j(case)

    furthest = [max(({}, *ends), key=lambda end: reach(DrivenCase(**end))) for _, _, ends in unknowns]
    together = DrivenCase(**{name: value for end in furthest for name, value in end.items()})
    case = max([together, *(DrivenCase(**end) for end in furthest)], key=reach)
    while True:
        before = case
        for _, _, ends in unknowns:
            for end in ends:
                case = max(case, replace(case, **end), key=reach)
        if case == before:
            return sign * reach(case)


def _moving_points(s_m: Floats) -> NDArray[np.intp]:
    """Indices of the first point and of each that lies at least `ESTIMATE_MIN_STEP_M` beyond the last one taken."""
    keep = [0]
    for i in range(1, len(s_m)):
        if s_m[i] - s_m[keep[-1]] >= ESTIMATE_MIN_STEP_M:
            keep.append(i)
    return np.array(keep, dtype=np.intp)


def _loss_w(section: Section, force_n: Floats, speed_mps: Floats) -> Floats:
    """Losses (W), with forces and speeds limited to the range of a loss map; a foreign run may need more."""
    loss = section.loss
    if isinstance(loss, LossMap):
        speed_mps = np.asarray(np.minimum(speed_mps, loss.speed_mps[-1]), dtype=float)
        low_n, high_n = (np.interp(speed_mps, loss.speed_mps, one) for one in (loss.force_low_n, loss.force_high_n))
        force_n = np.clip(force_n, low_n, high_n)
    return loss.loss_w(force_n, speed_mps)
