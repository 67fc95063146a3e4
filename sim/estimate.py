"""What a run as driven took: forces and energy by inverse dynamics with a chosen vehicle.

What cannot be known from positions: the true train, mass and wind, how braking was shared between motors and friction
(electric first is assumed), and what the auxiliaries drew. The figures are an estimate and labelled so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from das.domain.losses import LossMap
from das.domain.route import Floats
from das.domain.trajectory import Ledger, Trajectory, mean_resistance_n
from das.domain.vehicle import BrakePolicy
from das.solver.section import LineProfile, Section

MIN_STEP_M = 0.05
"""Grid points nearer than this are one: the train stands."""
BEYOND_RATIO = 1.05
"""A force this much above the vehicle's envelope is counted as beyond what this train can do."""


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
    profile = LineProfile.on(section.route, vehicle, node, section.length_m)
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
