"""The largest wheel force of a train at each speed, from force and power or from an effort curve, for each mode."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.formulary import largest_power_w
from das.domain.units import KMH

Floats = NDArray[np.float64]

SAMPLE_STEP_MPS = 0.1 * KMH
"""Spacing of the speeds (m/s) at which the solver's kernels sample an effort curve. The points of most real tables lie
at whole multiples of it; a kink elsewhere causes an error of about 1/10 000 of the force."""


@dataclass(frozen=True, kw_only=True)
class EffortCurve:
    """The largest wheel force (N) at n rising speeds (m/s), the first of which is 0.

    The force is linear between two speeds and constant beyond the last. It may rise and fall.
    """

    speed_mps: tuple[float, ...]
    force_n: tuple[float, ...]

    def at(self, speed_mps: ArrayLike) -> Floats:
        """Largest force (N) at each speed (m/s)."""
        return np.asarray(np.interp(np.asarray(speed_mps, dtype=float), self.speed_mps, self.force_n))

    @cached_property
    def samples_n(self) -> Floats:
        """The forces (N) at whole multiples of `SAMPLE_STEP_MPS`, from standstill to the last speed or just beyond."""
        steps = int(np.ceil(self.speed_mps[-1] / SAMPLE_STEP_MPS - 1e-9))
        return self.at(SAMPLE_STEP_MPS * np.arange(max(steps, 1) + 1))

    @cached_property
    def largest_power_w(self) -> float:
        """The largest power (W) on the curve, and on its samples, up to its last speed."""
        sampled_mps = SAMPLE_STEP_MPS * np.arange(len(self.samples_n), dtype=np.float64)
        exact_w = largest_power_w(np.array(self.speed_mps), np.array(self.force_n))
        return max(exact_w, largest_power_w(sampled_mps, self.samples_n))


@dataclass(frozen=True, kw_only=True)
class EffortEnvelope:
    """The largest wheel force at each speed: the smallest of a force, a power hyperbola and, if given, a curve.

    min(F, P/v, curve(v)). An envelope made of a curve has the largest force and the largest power of the curve.
    Source: Nold & Corman (2024), section 3.3 and fig. 2, p. 8: the power hyperbola bounds the forces.
    """

    max_force_n: float
    max_power_w: float
    curve: EffortCurve | None = None

    @classmethod
    def of_curve(cls, curve: EffortCurve, top_mps: float) -> EffortEnvelope:
        """The envelope given by a curve alone, for a train with a top speed (m/s)."""
        beyond_w = top_mps * curve.force_n[-1] if top_mps > curve.speed_mps[-1] else 0.0
        return cls(max_force_n=max(curve.force_n), max_power_w=max(curve.largest_power_w, beyond_w), curve=curve)

    def force_n(self, speed_mps: ArrayLike) -> Floats:
        """Largest force (N, >= 0) at each speed (m/s); a speed of 0 counts as 1e-9 m/s."""
        v = np.maximum(np.asarray(speed_mps, dtype=float), 1e-9)
        force_n = np.asarray(np.minimum(self.max_force_n, self.max_power_w / v), dtype=float)
        return force_n if self.curve is None else np.minimum(force_n, self.curve.at(speed_mps))


@dataclass(frozen=True, kw_only=True)
class EffortMode:
    """The efforts of a train in one mode: for a line voltage, for diesel operation, or for a type of weather."""

    traction: EffortEnvelope
    electric_brake: EffortEnvelope
    voltage_v: float | None = None
    weather: str = ""
