"""A window of samples of a running train, and its means of acceleration, force, line and resistance."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from das.domain.route import NEUTRAL, Floats, Route
from das.domain.vehicle import Vehicle
from das.solver.line_profile import LineProfile

SPEED_SD_MPS: Final = 0.05
"""The least noise of a measured speed (one standard deviation); a window whose speeds scatter more is trusted
less."""
FORCE_SD_RATIO: Final = 0.02
"""The noise of each measured force, as a share of it (one standard deviation)."""
FRICTION_SD_RATIO: Final = 0.1
"""The standing error of the measured friction brake force, as a share of it (one standard deviation): the force is
known from cylinder pressures only."""
POSITION_M: Final = 40.0
"""Error (m) that a position may have; a window is left out whose positions and speeds disagree more about the
distance run, or that may have come as near to a neutral section."""
LINE_GRID_M: Final = 10.0
"""The step with which the line is integrated along the way."""
NORMAL_MAD = 0.6745
"""The median absolute value of a normal variable, in standard deviations."""


class MeasuredWindow(NamedTuple):
    """Means over a window of samples, all with the same weights, and the variances of two of them."""

    acceleration_mps2: float
    force_n: float
    """The wheel force."""
    line_mps2: float
    """The force of gradients and curves divided by the mass of the train."""
    moving_n: float
    """The resistance c1·v + c2·v² of the train as planned."""
    tunnel_n: float
    """The additional resistance in tunnels, q·v²."""
    acceleration_variance: float
    force_variance: float
    coasts: bool = False
    """Whether no force was measured in the whole window."""


class LineIntegral:
    """The forces of the line on a train, integrated along the way: a difference gives the mean over any stretch."""

    def __init__(
        self,
        route: Route,
        vehicle: Vehicle,
        train_length_m: float,
        *,
        speed_sd_mps: float = SPEED_SD_MPS,
    ) -> None:
        """Integrate the line under a train; forces within the noise of its largest one count as none."""
        self._idle_n, self._speed_sd_mps = FORCE_SD_RATIO * vehicle.traction.max_force_n, speed_sd_mps
        self._resistance = vehicle.resistance
        breaks = route.breakpoints_m()
        grid = np.arange(0.0, route.length_m + train_length_m, LINE_GRID_M)
        ends = (grid, breaks, breaks + train_length_m, [route.length_m + train_length_m])
        self._node_m = np.unique(np.concatenate(ends))
        profile = LineProfile.on(route, vehicle, self._node_m, train_length_m)

        def along(value: Floats) -> Floats:
            return np.concatenate(([0.0], np.cumsum(value * profile.step_m)))

        self._work_m2ps2 = along(profile.constant_n / vehicle.mass_kg)
        self._tunnel = along(profile.tunnel_n_per_mps2)
        self._neutral_m = along((profile.supply == NEUTRAL).astype(float))

    def window(self, t: Floats, s: Floats, v: Floats, force: Floats, friction: Floats) -> MeasuredWindow | None:
        """Return the means over a window, all with the weights that the slope of the speeds gives the accelerations.

        Its samples, each (samples,), are times (s), positions of the head (m), speeds (m/s), whole wheel forces (N)
        and the part of the friction brake in them (N).

        The slope is Σc·v with c = (t − t̄)/Σ(t − t̄)². Summed by parts it is Σω·ā over the intervals between samples,
        with ω = Δt·Σ_later c. The result is None if the positions do not fit the speeds, or near a neutral section.
        """
        off = t - t.mean()
        scatter = float(off @ off)
        share = np.diff(t) * np.cumsum((off / scatter)[::-1])[::-1][1:]
        speed = 0.5 * (v[:-1] + v[1:])
        way = speed * np.diff(t)
        if abs(s[-1] - s[0] - way.sum()) > POSITION_M or self._in_neutral(float(s[0]), float(s[-1])):
            return None
        middle = 0.5 * (s[:-1] + s[1:])
        weight = 0.5 * (np.append(share, 0.0) + np.append(0.0, share))
        # An effort that changes between two samples may do so at any moment between them.
        between = np.sum((share * np.diff(force)) ** 2) / 12.0
        noise = np.sum((weight * FORCE_SD_RATIO * force) ** 2)
        noise = noise + (FRICTION_SD_RATIO * weight @ friction) ** 2
        r = self._resistance
        return MeasuredWindow(
            acceleration_mps2=float(off @ v) / scatter,
            force_n=float(weight @ force),
            line_mps2=float(share @ self._mean(self._work_m2ps2, middle, way)),
            moving_n=float(share @ (r.c1_n_per_mps * speed + r.c2_n_per_mps2 * speed**2)),
            tunnel_n=float(share @ (self._mean(self._tunnel, middle, way) * speed**2)),
            acceleration_variance=max(_noise_mps(v), self._speed_sd_mps) ** 2 / scatter,
            force_variance=float(between + noise),
            coasts=bool((np.abs(force) <= self._idle_n).all() and (np.abs(friction) <= self._idle_n).all()),
        )

    def _mean(self, integral: Floats, middle_m: Floats, way_m: Floats) -> Floats:
        """Return the means of an integrated quantity over stretches, given by their middles and lengths (m)."""
        ahead, behind = (np.interp(middle_m + x * way_m, self._node_m, integral) for x in (0.5, -0.5))
        return np.asarray((ahead - behind) / way_m)

    def _in_neutral(self, from_m: float, to_m: float) -> bool:
        """Whether the way between two positions of the head (m) comes near a neutral section."""
        ends = np.interp([from_m - POSITION_M, to_m + POSITION_M], self._node_m, self._neutral_m)
        return bool(ends[1] > ends[0])


def _noise_mps(speed_mps: Floats) -> float:
    """Return the noise of speeds (m/s, one standard deviation) from the median absolute second difference.

    The median leaves out the few second differences that come from changing forces.
    """
    bends = np.abs(np.diff(speed_mps, 2))
    return float(np.median(bends)) / (NORMAL_MAD * math.sqrt(6.0))
