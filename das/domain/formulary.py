"""The equations of the literature that the project uses: one function each, with its source.

Every function takes numbers or numpy arrays in SI units, and is independent of trains, routes and files. The classes of
`das.domain` and the section of `das.solver` call them. The kernels of the solver and of the train model repeat a few of
them, because numba compiles scalars; tests compare the two.

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


def davis_resistance_n(speed_mps: ArrayLike, c0_n: float, c1_n_per_mps: float, c2_n_per_mps2: float) -> Floats:
    """Running resistance R(v) = c0 + c1·v + c2·v² (N) at each speed (m/s).

    Source: Davis (1926), "The tractive resistance of electric locomotives and cars", General Electric Review 29,
    pp. 685–707; [NC], section 3.2, eq. 4, gives the power v·R(v), with c1, c2, c3 for c0, c1, c2.
    """
    v = np.asarray(speed_mps, dtype=float)
    return c0_n + c1_n_per_mps * v + c2_n_per_mps2 * v**2


def mean_davis_resistance_n(
    speeds_mps: Floats, c0_n: float, c1_n_per_mps: float, c2_n_per_mps2: float | Floats
) -> Floats:
    """Davis resistance (N), averaged exactly over the distance of each interval between n speeds (m/s): n − 1 values.

    At constant acceleration v² is linear in the distance: with the speeds a and b at the ends, the mean of v² is (a² +
    b²)/2 and the mean of v is (2/3)·(a² + a·b + b²)/(a + b). Source: integration of Davis' formula.
    """
    a, b = speeds_mps[:-1], speeds_mps[1:]
    total = np.maximum(a + b, 1e-12)
    mean_v = (2.0 / 3.0) * (a * a + a * b + b * b) / total
    return c0_n + c1_n_per_mps * mean_v + c2_n_per_mps2 * 0.5 * (a * a + b * b)


def davis_in_head_wind(
    c0_n: float, c1_n_per_mps: float, c2_n_per_mps2: float, wind_mps: float
) -> tuple[float, float, float]:
    """Davis coefficients of c0 + c1·v + c2·(v + w)²: the air meets the train at its own speed v plus the wind speed w.

    A tail wind is negative. It would push a slower train; this formula counts that force as resistance. Source:
    expansion of the square; only c2 describes air resistance.
    """
    w = wind_mps
    return c0_n + c2_n_per_mps2 * w * w, c1_n_per_mps + 2 * c2_n_per_mps2 * w, c2_n_per_mps2


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


def effort_n(speed_mps: ArrayLike, max_force_n: float, max_power_w: float) -> Floats:
    """Largest wheel force (N, >= 0) at each speed (m/s): the smaller of a force and a power hyperbola, min(F, P/v).

    Source: [NC], section 3.3 and fig. 2, p. 8: the power hyperbola bounds the forces. A speed of 0 counts as 1e-9 m/s.
    """
    v = np.maximum(np.asarray(speed_mps, dtype=float), 1e-9)
    return np.asarray(np.minimum(max_force_n, max_power_w / v), dtype=float)


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


def efficiency_loss_ratio(efficiency: float) -> float:
    """Loss per mechanical power of a constant efficiency: 1/η − 1.

    Source: [NC], section 3.4.2, eq. 10, p. 9.
    """
    return 1.0 / efficiency - 1.0


def proportional_loss_w(power_w: Floats, traction_ratio: float, brake_ratio: float, idle_w: float) -> Floats:
    """Component loss (W) at each mechanical power at the wheel (W, braking < 0), with an idle part c0 (W).

    P_L = k_traction·max(P, 0) + k_brake·max(−P, 0) + c0. Source: [NC], section 3.4, eqs. 9 to 11, from p. 9 on: level
    L0 has neither part, L1 one ratio 1/η̄ − 1 for both signs, L2 the idle part as well. Separate ratios are an
    extension for trains whose files give one efficiency for driving and one for braking [B].
    """
    return traction_ratio * np.maximum(power_w, 0) + brake_ratio * np.maximum(-power_w, 0) + idle_w
