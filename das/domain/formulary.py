"""Equations of the literature that belong to no single class of `das.domain`: one function each, with its source.

The others stand in their classes, with their sources: `Resistance`, `EffortEnvelope` and `EfficiencyLoss`. Every
function takes numbers or numpy arrays in SI units, and is independent of trains, routes and files. The kernels of the
solver and of the train model repeat a few of the equations, because numba compiles scalars; tests compare the two.

[NC] is Nold & Corman, "Increasing realism in modelling energy losses in railway vehicles and their impact to
energy-efficient train control", Railway Engineering Science, 2024. Pages are counted from the first page of the
article. [B] is the public benchmark TTOBench: its data and the curve resistance in its tools.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from das.domain.units import KMH, STANDARD_GRAVITY_MPS2

Floats = NDArray[np.float64]

ROCKL_BORDER_PER_M = 1 / 300
"""Curvature (1/m) from which Röckl's formula for tight curves holds: a radius of 300 m."""


def curve_resistance_mps2(curvature_per_m: ArrayLike) -> Floats:
    """Curve resistance per mass (m/s²) at each curvature κ = 1/R (1/m, either sign).

    g·0.5κ/(1 − 30κ) for R >= 300 m, else g·0.65κ/(1 − 55κ), with a step at R = 300 m. Source: Röckl's formula in
    terms of the curvature, as [B] uses it (notes on its tracks).
    """
    k = np.abs(np.asarray(curvature_per_m, dtype=float))
    wide = 0.5 * k / (1 - 30 * np.minimum(k, ROCKL_BORDER_PER_M))
    tight = 0.65 * k / (1 - 55 * k)
    return np.asarray(STANDARD_GRAVITY_MPS2 * np.where(k <= ROCKL_BORDER_PER_M, wide, tight), dtype=float)


def line_force_n(mass_kg: float, grade_ratio: Floats, curve_mps2: Floats) -> Floats:
    """Force of gradient and curves against a train (N): m·(g·i + r), i the gradient (ratio, uphill > 0).

    Source: [NC], section 3.1, separates gradient and curve resistance from the running resistance. Gradients are small:
    sin(arctan i) ≈ i, as in [B].
    """
    return mass_kg * (STANDARD_GRAVITY_MPS2 * grade_ratio + curve_mps2)


def adhesion_coefficient(speed_mps: ArrayLike) -> Floats:
    """Friction between wheel and rail, µ = 0.161 + 7.5/(V + 44), V in km/h, on a dry rail.

    Source: Curtius & Kniffler (1944), "Neue Erkenntnisse über die Haftung zwischen Treibrad und Schiene", Elektrische
    Bahnen 20.
    """
    return np.asarray(0.161 + 7.5 / (np.asarray(speed_mps, dtype=float) / KMH + 44.0))


def largest_power_w(speed_mps: Floats, force_n: Floats) -> float:
    """The largest power (W) of forces (N) given at n rising speeds (m/s) and linear between them.

    On a piece F = a + b·v, the power v·(a + b·v) is largest at one of its ends, or at −a/(2·b) if that lies between.
    """
    (v0, v1), (f0, f1) = (speed_mps[:-1], speed_mps[1:]), (force_n[:-1], force_n[1:])
    slope = (f1 - f0) / (v1 - v0)
    falls = slope < 0.0
    at_mps = np.where(falls, (v0 * slope - f0) / np.where(falls, 2.0 * slope, 1.0), v0)
    inside_mps = np.clip(at_mps, v0, v1)
    return float(max((speed_mps * force_n).max(), (inside_mps * (f0 + slope * (inside_mps - v0))).max(initial=0.0)))
