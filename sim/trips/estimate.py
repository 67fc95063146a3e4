"""What a run as driven took: forces and energy by inverse dynamics with a chosen vehicle.

What cannot be known from positions: the true train, mass and wind, how braking was shared between motors and friction
(electric first is assumed), and what the auxiliaries drew. The figures are an estimate and labelled so; `energy_range`
says how far they may be off.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.conditions import Conditions
from das.domain.losses import LossMap
from das.domain.route import Floats
from das.domain.trajectory import Ledger, Trajectory, mean_resistance_n
from das.domain.vehicle import BrakePolicy, Vehicle
from das.solver.section import LineProfile, Section
from sim.trips.matching import MatchedTrip
from sim.trips.profile import JERK_PSD_M2PS5, DrivenRun, to_profile

MIN_STEP_M = 0.05
"""Grid points nearer than this are one: the train stands."""
BEYOND_RATIO = 1.05
"""A force this much above the vehicle's envelope is counted as beyond what this train can do."""

MASS_RATIO, RESISTANCE_RATIO, WIND_MPS = 0.05, 0.10, 5.0
"""How far mass, running resistance and wind along the line may be from what is assumed (assumptions)."""
HELD_S = 8
"""Strongest is a force that is held so long: the smoothing acts over it, and tells no shorter one."""
SMOOTHING_RATIO = 10.0
"""The density of jerk in the smoothing is taken this much higher and lower: its window shrinks and grows by 1.8."""


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """What is not known, and the energy at the collector (J) at either end of what it may be."""

    name: str
    assumed: str
    low_j: float
    high_j: float


@dataclass(frozen=True, kw_only=True)
class EnergyRange:
    """The estimate (J), each unknown on its own, and all of them together at their worst either way.

    `left_out` counts the cases that cannot have been.
    """

    estimate_j: float
    unknowns: tuple[Unknown, ...]
    low_j: float
    high_j: float
    left_out: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenEstimate:
    """A run as driven with the forces this vehicle would have needed.

    `index[i]` is the point of the run at node i of the trajectory. `beyond_ratio` is the share of time in which the
    run asks for more than the vehicle has (it was another train, or the positions are rough).
    """

    trajectory: Trajectory
    ledger: Ledger
    energy_input_j: Floats
    index: NDArray[np.intp]
    beyond_ratio: float


def estimate_run(section: Section, time_s: Floats, s_m: Floats, speed_mps: Floats) -> DrivenEstimate:
    """Inverse dynamics over a run (arrays of one length, times and positions not decreasing).

    Force from the change of v² over the way, resistance, gradient and curves of each interval; traction by the
    motors, braking electric up to its envelope and friction beyond (all friction where the section brakes so).
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
    brakes_limit = vehicle.brake_effort_n(mean)
    beyond = (force > BEYOND_RATIO * traction) | (-force > BEYOND_RATIO * brakes_limit)
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
    loss = section.loss.loss_w(_in_map(section, electric, mean), _speed_in_map(section, mean)) * np.diff(t)
    return DrivenEstimate(
        trajectory=trajectory,
        ledger=trajectory.ledger_with(vehicle, loss),
        energy_input_j=np.concatenate(([0.0], np.cumsum(trajectory.input_j(loss)))),
        index=index,
        beyond_ratio=float(np.diff(t)[beyond].sum() / max(t[-1] - t[0], 1e-9)),
    )


def strongest_held_n(driven: DrivenEstimate) -> tuple[float, float]:
    """The strongest traction and braking (N, >= 0) that nothing falls short of for 8 s (or the run, if shorter)."""
    t, force = driven.trajectory.t_s, driven.trajectory.force_el_n + driven.trajectory.force_friction_n
    seconds = np.arange(t[0] + 0.5, t[-1], 1.0)
    here = force[np.searchsorted(t, seconds) - 1]
    held = np.lib.stride_tricks.sliding_window_view(here, min(HELD_S, len(here)))
    return max(float(held.min(axis=1).max()), 0.0), max(-float(held.max(axis=1).min()), 0.0)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One way it may have been; the defaults are what the estimate assumes."""

    mass_ratio: float = 1.0
    resistance_ratio: float = 1.0
    head_wind_mps: float = 0.0
    all_friction: bool = False
    jerk_psd_m2ps5: float = JERK_PSD_M2PS5

    def train(self, vehicle: Vehicle) -> Vehicle:
        """The train as it may have been."""
        return Conditions(
            mass_ratio=self.mass_ratio, resistance_ratio=self.resistance_ratio, head_wind_mps=self.head_wind_mps
        ).train(vehicle)

    def brakes(self, section: Section) -> BrakePolicy:
        """How it may have braked."""
        return BrakePolicy.FRICTION if self.all_friction else section.brakes


_Ends = tuple[dict[str, Any], dict[str, Any]]
_UNKNOWNS: tuple[tuple[str, str, _Ends], ...] = (
    ("mass", f"± {100 * MASS_RATIO:g} %", ({"mass_ratio": 1 - MASS_RATIO}, {"mass_ratio": 1 + MASS_RATIO})),
    (
        "running resistance",
        f"± {100 * RESISTANCE_RATIO:g} %",
        ({"resistance_ratio": 1 - RESISTANCE_RATIO}, {"resistance_ratio": 1 + RESISTANCE_RATIO}),
    ),
    ("wind along the line", f"± {WIND_MPS:g} m/s", ({"head_wind_mps": -WIND_MPS}, {"head_wind_mps": WIND_MPS})),
    ("braking", "electric first … friction alone", ({"all_friction": False}, {"all_friction": True})),
    (
        "smoothing of the record",
        f"jerk ÷ and × {SMOOTHING_RATIO:g}",
        (
            {"jerk_psd_m2ps5": JERK_PSD_M2PS5 / SMOOTHING_RATIO},
            {"jerk_psd_m2ps5": JERK_PSD_M2PS5 * SMOOTHING_RATIO},
        ),
    ),
)
"""Name, what it may have been in words, and the changes at either end."""


def energy_range(section: Section, matched: MatchedTrip) -> EnergyRange:
    """How far the energy of a trip as driven may be off: the inverse dynamics done again in every case."""
    return over_unknowns(driven_energy(section, matched))


def over_unknowns(energy_j: Callable[[Case], float | None]) -> EnergyRange:
    """An energy (J) with each unknown at either end, and with all together at the ends that give least, and most.

    That is the outermost, not the likeliest. None: so it cannot have been, and the case is left out.
    """
    known: dict[Case, float | None] = {}

    def at(case: Case) -> float | None:
        if case not in known:
            known[case] = energy_j(case)
        return known[case]

    estimate_j = at(Case())
    assert estimate_j is not None
    unknowns = []
    for name, assumed, ends in _UNKNOWNS:
        found = [e for e in (estimate_j, *(at(Case(**end)) for end in ends)) if e is not None]
        unknowns.append(Unknown(name=name, assumed=assumed, low_j=min(found), high_j=max(found)))
    low_j, high_j = (_outermost(at, sign) for sign in (-1.0, 1.0))
    left_out = sum(e is None for e in known.values())
    return EnergyRange(estimate_j=estimate_j, unknowns=tuple(unknowns), low_j=low_j, high_j=high_j, left_out=left_out)


def _outermost(energy_j: Callable[[Case], float | None], sign: float) -> float:
    """The least (sign < 0) or the most energy (J) with every unknown at one of its ends.

    First each goes where it leads furthest on its own; as one may turn round what another does (who brakes by friction
    loses more with a tail wind), then each in turn to where it leads furthest from there, until none leads further.
    """

    def reach(case: Case) -> float:
        energy = energy_j(case)
        return -np.inf if energy is None else sign * energy

    furthest = [max(({}, *ends), key=lambda end: reach(Case(**end))) for _, _, ends in _UNKNOWNS]
    together = Case(**{name: value for end in furthest for name, value in end.items()})
    case = max([together, *(Case(**end) for end in furthest)], key=reach)
    while True:
        before = case
        for _, _, ends in _UNKNOWNS:
            for end in ends:
                case = max(case, replace(case, **end), key=reach)
        if case == before:
            return sign * reach(case)


def driven_energy(section: Section, matched: MatchedTrip) -> Callable[[Case], float]:
    """Energy at the collector (J) of a trip as driven, by case."""

    @cache
    def smooth(jerk_psd_m2ps5: float) -> DrivenRun:
        return to_profile(matched, jerk_psd_m2ps5=jerk_psd_m2ps5)

    def driven_j(case: Case) -> float:
        run = smooth(case.jerk_psd_m2ps5)
        other = replace(section, vehicle=case.train(section.vehicle), brakes=case.brakes(section))
        return estimate_run(other, run.time_s, run.s_m, run.speed_mps).ledger.input

    return driven_j


def _moving_points(s_m: Floats) -> NDArray[np.intp]:
    """Indices of points that lie apart, the first among them."""
    keep = [0]
    for i in range(1, len(s_m)):
        if s_m[i] - s_m[keep[-1]] >= MIN_STEP_M:
            keep.append(i)
    return np.array(keep, dtype=np.intp)


def _in_map(section: Section, force_n: Floats, speed_mps: Floats) -> Floats:
    """Forces cut to what a loss map covers at their speeds (a foreign run may ask for more)."""
    if not isinstance(section.loss, LossMap):
        return force_n
    speed = _speed_in_map(section, speed_mps)
    low = np.interp(speed, section.loss.speed_mps, section.loss.force_low_n)
    high = np.interp(speed, section.loss.speed_mps, section.loss.force_high_n)
    return np.clip(force_n, low, high)


def _speed_in_map(section: Section, speed_mps: Floats) -> Floats:
    if not isinstance(section.loss, LossMap):
        return speed_mps
    return np.asarray(np.minimum(speed_mps, section.loss.speed_mps[-1]), dtype=float)
