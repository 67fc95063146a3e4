"""Losses of the traction chain: efficiency models (levels L0 to L2) and loss maps (level L3).

The levels are those of Nold & Corman (2024), section 3. A loss is the power in W dissipated in the chain from current
collector to wheel at wheel force `force_n` (negative = electric brake) and speed `speed_mps`; at
standstill it is zero at every level.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.errors import DasError, InputError, check_number
from das.domain.units import KMH

Floats = NDArray[np.float64]

GRID_EVENNESS = 1e-6
"""Relative deviation from even spacing allowed on the axes of a loss map."""
MOST_MAP_POINTS = 5_000_000
"""Largest number of points of a loss map: 500 km/h and 10 000 kN in steps of 1; a larger map has a wrong speed or
force."""


@dataclass(frozen=True, kw_only=True)
class EfficiencyLoss:
    """Loss proportional to wheel power, with an idle part: eqs. 8 to 11 of the paper, from p. 9 on.

    P_L = traction_ratio·max(F·v, 0) + brake_ratio·max(−F·v, 0) + idle_w. Level L0 has neither part, L1 one ratio
    1/η̄ − 1 for both signs, L2 the idle part as well. Separate ratios are an extension for trains whose files give one
    efficiency for driving and one for braking, as in TTOBench.
    """

    traction_ratio: float
    brake_ratio: float
    idle_w: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_number("efficiency loss", name, value)

    @classmethod
    def from_efficiencies(cls, traction: float, brake: float, idle_w: float = 0.0) -> EfficiencyLoss:
        """Constant efficiencies: F·v/η at the collector when driving, F·v·η when braking (TTOBench's meaning)."""
        return cls(traction_ratio=1.0 / traction - 1.0, brake_ratio=1.0 - brake, idle_w=idle_w)

    @classmethod
    def symmetric(cls, mean_efficiency: float, idle_w: float = 0.0) -> EfficiencyLoss:
        """Levels L1 and L2 of the paper: (1/η̄ − 1)·|P_mech| + c0 (eqs. 10, 11)."""
        ratio = 1.0 / mean_efficiency - 1.0
        return cls(traction_ratio=ratio, brake_ratio=ratio, idle_w=idle_w)

    def with_constant(self, power_w: float) -> EfficiencyLoss:
        """The losses plus a constant power."""
        return replace(self, idle_w=self.idle_w + power_w)

    def loss_w(self, force_n: ArrayLike, speed_mps: ArrayLike) -> Floats:
        """Loss (W) at each pair of wheel force (N) and speed (m/s)."""
        speed = np.asarray(speed_mps, dtype=float)
        power = np.asarray(force_n, dtype=float) * speed
        loss = self.traction_ratio * np.maximum(power, 0) + self.brake_ratio * np.maximum(-power, 0) + self.idle_w
        return np.where(speed > 0, loss, 0.0)


LOSSLESS = EfficiencyLoss(traction_ratio=0.0, brake_ratio=0.0)
"""Level L0: no component losses."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LossMap:
    """Loss in W on an even grid of speed and wheel force, with bilinear interpolation.

    `loss_w_table[i, j]` belongs to `speed_mps[i]` and `force_n[j]`; NaN marks a state that the map does not cover. The
    covered forces of each speed must be one unbroken range. `filled_w` continues the losses of each speed linearly
    beyond that range: a cell cut by the edge of the map (a power hyperbola runs through cells) can then be interpolated
    up to the edge.
    """

    name: str
    speed_mps: Floats
    force_n: Floats
    loss_w_table: Floats
    filled_w: Floats = field(init=False)
    force_low_n: Floats = field(init=False)
    force_high_n: Floats = field(init=False)

    def __post_init__(self) -> None:
        _check_even("speed", self.name, self.speed_mps)
        _check_even("force", self.name, self.force_n)
        if self.speed_mps[0] != 0:
            first_kmh = float(self.speed_mps[0] / KMH)
            raise InputError(self.name, "first speed (km/h)", first_kmh, "a map that begins at 0 km/h")
        ends_n = float(self.force_n[0]), float(self.force_n[-1])
        if not ends_n[0] <= 0 <= ends_n[1]:
            raise InputError(self.name, "forces (N)", ends_n, "a range that contains 0 N")
        if np.abs(self.force_n).min() > GRID_EVENNESS * (self.force_n[-1] - self.force_n[0]):
            raise InputError(self.name, "force", float(np.abs(self.force_n).min()), "0 N among the points of the grid")
        _check_losses(self)
        filled = self.loss_w_table.copy()
        ends = np.array([_continue_linearly(self, i, row) for i, row in enumerate(filled)])
        low, high = self.force_n[ends].T.copy()
        for name, value in (("filled_w", filled), ("force_low_n", low), ("force_high_n", high)):
            object.__setattr__(self, name, value)
        for array in (self.speed_mps, self.force_n, self.loss_w_table, filled, low, high):
            array.setflags(write=False)

    @property
    def force_step_n(self) -> float:
        return float((self.force_n[-1] - self.force_n[0]) / (len(self.force_n) - 1))

    @property
    def speed_step_mps(self) -> float:
        return float((self.speed_mps[-1] - self.speed_mps[0]) / (len(self.speed_mps) - 1))

    def covers(self, force_n: ArrayLike, speed_mps: ArrayLike) -> NDArray[np.bool_]:
        """Whether each state lies in the map (to within the grid cell through which the map's edge runs)."""
        force, speed = np.asarray(force_n, dtype=float), np.asarray(speed_mps, dtype=float)
        slack = 1e-6 * self.force_step_n
        low = np.interp(speed, self.speed_mps, self.force_low_n) - self.force_step_n - slack
        high = np.interp(speed, self.speed_mps, self.force_high_n) + self.force_step_n + slack
        on_axes = (force >= self.force_n[0] - slack) & (force <= self.force_n[-1] + slack)
        inside = (speed <= self.speed_mps[-1] * (1 + 1e-9)) & (force >= low) & (force <= high) & on_axes
        return np.asarray(inside, dtype=np.bool_)

    def with_constant(self, power_w: float) -> LossMap:
        """The losses plus a constant power."""
        return replace(self, loss_w_table=self.loss_w_table + power_w)

    def loss_w(self, force_n: ArrayLike, speed_mps: ArrayLike) -> Floats:
        """Loss (W), bilinear; raises DasError naming the first state that is outside the map."""
        force, speed = np.broadcast_arrays(np.asarray(force_n, dtype=float), np.asarray(speed_mps, dtype=float))
        inside = self.covers(force, speed)
        if not inside.all():
            where = np.flatnonzero(~inside.ravel())[0]
            raise outside_map(self, float(force.ravel()[where]), float(speed.ravel()[where]))
        x = np.clip(speed / self.speed_step_mps, 0, len(self.speed_mps) - 1)
        y = np.clip((force - self.force_n[0]) / self.force_step_n, 0, len(self.force_n) - 1)
        i = np.minimum(x.astype(np.intp), len(self.speed_mps) - 2)
        j = np.minimum(y.astype(np.intp), len(self.force_n) - 2)
        a, b = x - i, y - j
        table = self.filled_w
        slower, faster = ((1 - b) * table[row, j] + b * table[row, j + 1] for row in (i, i + 1))
        return np.where(speed > 0, (1 - a) * slower + a * faster, 0.0)


LossModel = EfficiencyLoss | LossMap


def check_map_size(source: str | Path, speeds: int, forces: int) -> None:
    """Raise InputError if a loss map with these numbers of speeds and forces has more than `MOST_MAP_POINTS` points."""
    if speeds * forces > MOST_MAP_POINTS:
        found, expected = f"{speeds} speeds × {forces} forces", f"at most {MOST_MAP_POINTS} points"
        raise InputError(source, "size of the loss map", found, expected)


def outside_map(loss_map: LossMap, force_n: float, speed_mps: float) -> DasError:
    """The error for a state outside the map."""
    return DasError(
        f"{loss_map.name}: the state {force_n / 1e3:.1f} kN at {speed_mps / KMH:.1f} km/h "
        f"({force_n * speed_mps / 1e3:.0f} kW at the wheel) is outside the loss map"
    )


def fit_mean_efficiency(model: LossMap, max_power_w: float, *, with_idle: bool) -> EfficiencyLoss:
    """Least-squares fit of levels L1 (`with_idle=False`) and L2 to a loss map over its operating points.

    P_L ≈ k·|F·v| (+ c0) is fitted over all covered points of the map with speed > 0 and wheel power up to
    `max_power_w`, with η̄ = 1/(1 + k). If k or c0 would be negative, it is 0. L1 has a separate fit without c0.
    """
    points = operating_points(model, max_power_w)
    x, y = points.power_w, points.loss_w
    if not x.any():
        raise DasError(
            f"{model.name}: no point of the map with a force has a wheel power up to {max_power_w / 1e3:g} kW; "
            "no efficiency can be fitted"
        )
    ratio, idle_w = float(x @ y / (x @ x)), 0.0
    if with_idle:
        slope, constant_w = np.linalg.lstsq(np.stack([x, np.ones_like(x)], axis=1), y, rcond=None)[0]
        if constant_w >= 0:
            ratio, idle_w = (float(slope), float(constant_w)) if slope >= 0 else (0.0, float(y.mean()))
    return EfficiencyLoss(traction_ratio=ratio, brake_ratio=ratio, idle_w=idle_w)


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingPoints:
    """Points of a loss map at which the train can run: four arrays of one length.

    `force_n` (N, braking < 0), `speed_mps` (> 0), `power_w` = |F·v| at the wheel, `loss_w`.
    """

    force_n: Floats
    speed_mps: Floats
    power_w: Floats
    loss_w: Floats

    def input_w(self) -> Floats:
        """Input power of the chain (W): from the collector when driving, from the wheel when braking."""
        return self.power_w + np.where(self.force_n < 0, 0.0, self.loss_w)

    def efficiency_ratio(self) -> Floats:
        """Output power of the chain divided by its input power; 0 if braking recovers nothing."""
        into = np.maximum(self.input_w(), 1e-9)
        return np.maximum(into - self.loss_w, 0.0) / into


def operating_points(model: LossMap, max_power_w: float, max_force_n: float = np.inf) -> OperatingPoints:
    """All covered points of a map with speed > 0, wheel power up to `max_power_w` and |force| up to `max_force_n`."""
    speed, force = np.meshgrid(model.speed_mps, model.force_n, indexing="ij")
    power = np.abs(force * speed)
    use = np.isfinite(model.loss_w_table) & (speed > 0) & (power <= max_power_w * (1 + 1e-9))
    use &= np.abs(force) <= max_force_n
    return OperatingPoints(force_n=force[use], speed_mps=speed[use], power_w=power[use], loss_w=model.loss_w_table[use])


def _check_even(what: str, name: str, axis: Floats) -> None:
    if len(axis) < 2:
        raise InputError(name, what, len(axis), "at least two different values")
    steps = np.diff(axis)
    mean = (axis[-1] - axis[0]) / (len(axis) - 1)
    bad = np.flatnonzero(np.abs(steps - mean) > GRID_EVENNESS * abs(mean))
    if len(bad) or mean <= 0:
        where = int(bad[0]) if len(bad) else 0
        key = f"{what} step after {axis[where]:g}"
        raise InputError(name, key, float(steps[where]), f"an even grid, step {mean:g}")


def _check_losses(loss_map: LossMap) -> None:
    table = loss_map.loss_w_table
    bad = np.argwhere(np.isinf(table) | (table < 0))
    if len(bad):
        i, j = bad[0]
        key = f"loss at {loss_map.speed_mps[i] / KMH:g} km/h, {loss_map.force_n[j]:g} N"
        raise InputError(loss_map.name, key, float(table[i, j]), "a finite loss >= 0 W")


def _continue_linearly(loss_map: LossMap, speed: int, row: Floats) -> tuple[int, int]:
    """Fill the NaN at both ends of the row of a speed with its end slopes, never below zero.

    Returns the indices of the lowest and highest covered force. Raises InputError unless they bound an unbroken range.
    """
    known = np.flatnonzero(np.isfinite(row))
    if len(known) < 2 or known[-1] - known[0] + 1 != len(known):
        key = f"forces at {loss_map.speed_mps[speed] / KMH:g} km/h"
        expected = "one unbroken range of at least two forces"
        raise InputError(loss_map.name, key, f"{len(known)} points", expected)
    first, last = int(known[0]), int(known[-1])
    before, after = np.arange(first, 0, -1), np.arange(1, len(row) - last)
    row[:first] = np.maximum(row[first] + (row[first] - row[first + 1]) * before, 0.0)
    row[last + 1 :] = np.maximum(row[last] + (row[last] - row[last - 1]) * after, 0.0)
    return first, last
