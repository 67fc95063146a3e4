"""A window of samples of a running train, and its means of acceleration, force, line and resistance.

A sample belongs to one moment. It is made from positions and efforts, which are measured at different moments.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from das.domain.route import NEUTRAL, Floats, Route
from das.domain.units import NS
from das.domain.vehicle import Vehicle
from das.estimate.effort import Effort
from das.estimate.fix import OVERSPEED_RATIO
from das.solver.line_profile import LineProfile

LONGEST_GAP_S: Final = 2.5
"""Longest gap between samples (s) within a window; efforts further apart say nothing about the forces between them."""
MOST_WAITING: Final = 100
"""Most positions that wait for the next effort; older ones are dropped, so that memory stays bounded."""
POSSIBLE_FORCE_RATIO: Final = 1.5
"""Multiple of the train's largest force above which a force is a fault of the sensor."""
SPEED_SD_MPS: Final = 0.05
"""The least noise of a measured speed (one standard deviation); a window whose speeds scatter more is trusted
less."""
FORCE_SD_RATIO: Final = 0.02
"""The noise of each measured force, as a share of it (one standard deviation)."""
FRICTION_SD_RATIO: Final = 0.1
"""The standing error of the measured friction brake force, as a share of it (one standard deviation): the force is
known from cylinder pressures only."""
ODOMETRY_M: Final = 40.0
"""Disagreement (m) of positions and speeds about the distance run above which a window is left out."""
NEUTRAL_MARGIN_M: Final = 30.0
"""Distance (m) to a neutral section below which a window is left out."""
LINE_GRID_M: Final = 10.0
"""The step with which the line is integrated along the way."""
NORMAL_MAD = 0.6745
"""The median absolute value of a normal variable, in standard deviations."""


class Sample(NamedTuple):
    """What was measured at one moment: position (m), speed (m/s), the whole wheel force (N) and its friction part."""

    time_s: float
    s_m: float
    speed_mps: float
    force_n: float
    friction_n: float


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
        idle_n: float = 0.0,
        speed_sd_mps: float = SPEED_SD_MPS,
    ) -> None:
        """Integrate the line under a train; forces up to `idle_n` (N) count as none."""
        self._idle_n, self._speed_sd_mps = idle_n, speed_sd_mps
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

    def window(self, samples: Sequence[Sample]) -> MeasuredWindow | None:
        """Return the means over a window, all with the weights that the slope of the speeds gives the accelerations.

        The slope is Σc·v with c = (t − t̄)/Σ(t − t̄)². Summed by parts it is Σω·ā over the intervals between samples,
        with ω = Δt·Σ_later c. The result is None if the positions do not fit the speeds, or near a neutral section.
        """
        t, s, v, force, friction = np.array(samples).T
        off = t - t.mean()
        scatter = float(off @ off)
        share = np.diff(t) * np.cumsum((off / scatter)[::-1])[::-1][1:]
        speed = 0.5 * (v[:-1] + v[1:])
        way = speed * np.diff(t)
        if abs(s[-1] - s[0] - way.sum()) > ODOMETRY_M or self._in_neutral(float(s[0]), float(s[-1])):
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
        ends = np.interp([from_m - NEUTRAL_MARGIN_M, to_m + NEUTRAL_MARGIN_M], self._node_m, self._neutral_m)
        return bool(ends[1] > ends[0])


def _noise_mps(speed_mps: Floats) -> float:
    """Return the noise of speeds (m/s, one standard deviation) from the median absolute second difference.

    The median leaves out the few second differences that come from changing forces.
    """
    bends = np.abs(np.diff(speed_mps, 2))
    return float(np.median(bends)) / (NORMAL_MAD * math.sqrt(6.0))


class _Place(NamedTuple):
    """A measured position of the head (m) and a speed (m/s), and whether the sender marks them as usable."""

    time_ns: int
    s_m: float
    speed_mps: float
    usable: bool


class Pairing:
    """Makes samples from positions and efforts; a position waits until a later effort is received."""

    def __init__(self, vehicle: Vehicle, line_length_m: float) -> None:
        self._vehicle, self._line_length_m = vehicle, line_length_m
        self._places: deque[_Place] = deque(maxlen=MOST_WAITING)
        self._before: Effort | None = None
        self._effort: Effort | None = None

    def add_effort(self, effort: Effort) -> None:
        """Take over measured forces; impossible, repeated and late ones are ignored."""
        last = self._effort
        if not self._is_possible(effort):
            return
        if last is not None and effort.time_ns <= last.time_ns:
            if (last.time_ns - effort.time_ns) * NS <= LONGEST_GAP_S:
                return
            last = None  # the clock was set back
        self._before, self._effort = last, effort

    def add_position(self, time_ns: int, s_m: float, speed_mps: float, *, usable: bool) -> None:
        """Take over a position of the head (m) and a speed (m/s); waiting positions of later times are dropped."""
        if self._places and time_ns < self._places[-1].time_ns:
            self._places.clear()
        self._places.append(_Place(time_ns, s_m, speed_mps, usable))

    def samples(self) -> Iterator[Sample | None]:
        """Yield the samples that can be made now; None stands for a position that cannot be used.

        A sample has the force at its moment, interpolated linearly between the efforts before and after. A position
        without an effort before and after it is skipped.
        """
        effort, before = self._effort, self._before
        if effort is None:
            return
        while self._places and self._places[0].time_ns <= effort.time_ns:
            place = self._places.popleft()
            if not self._is_plausible(place):
                yield None
                continue
            forces = self._forces_at(place.time_ns, before, effort)
            if forces is not None:
                yield Sample(place.time_ns * NS, place.s_m, place.speed_mps, *forces)

    def _is_possible(self, effort: Effort) -> bool:
        """Whether a train like this one can have such forces; False for forces that are not a number."""
        train = self._vehicle
        electric_n = max(train.traction.max_force_n, train.electric_brake.max_force_n)
        most_n = POSSIBLE_FORCE_RATIO * (electric_n + train.friction_brake_force_n)
        return abs(effort.force_el_n) <= most_n and -most_n <= effort.force_friction_n <= 0

    def _is_plausible(self, place: _Place) -> bool:
        """Whether a position is usable and on the line, and its speed possible; False for what is not a number."""
        on_line = 0 <= place.s_m <= self._line_length_m
        fastest_mps = OVERSPEED_RATIO * self._vehicle.max_speed_mps
        return place.usable and on_line and abs(place.speed_mps) <= fastest_mps

    def _forces_at(self, time_ns: int, before: Effort | None, effort: Effort) -> tuple[float, float] | None:
        """Return the whole wheel force and its friction part (N) at a moment; None if it is not between efforts."""
        if time_ns == effort.time_ns:
            share = 1.0
            before = before or effort
        elif before is None or time_ns < before.time_ns or (effort.time_ns - before.time_ns) * NS > LONGEST_GAP_S:
            return None
        else:
            share = (time_ns - before.time_ns) / (effort.time_ns - before.time_ns)
        electric_n = before.force_el_n + share * (effort.force_el_n - before.force_el_n)
        friction_n = before.force_friction_n + share * (effort.force_friction_n - before.force_friction_n)
        return electric_n + friction_n, friction_n
