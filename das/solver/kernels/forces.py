"""Forces and powers of a moving train: resistance, traction, brakes, losses."""

from __future__ import annotations

from das.compiling import kernel
from das.domain.route import NEUTRAL
from das.solver.kernels.tuples import CURVE_STEPS_PER_MPS, NO_LIMIT_N, PlainTrain, TrainParams

TRACTION, ELECTRIC = 0, 1
"""Rows of the effort curves in `TrainParams.curves_n`."""
ADHESION_LEAST, ADHESION_EXTRA, ADHESION_SPEED, ADHESION_OFFSET = 0.161, 7.5, 3.6, 44.0
"""Coefficients of Curtius & Kniffler: friction between wheel and rail is least + extra/(speed·v + offset)."""


@kernel
def mean_resistance(v0, v1, q, p):
    """Running and tunnel resistance averaged over the distance at constant acceleration from v0 to v1 (exact)."""
    total = v0 + v1
    if total <= 0.0:
        return p.c0_n
    mean_v = (2.0 / 3.0) * (v0 * v0 + v0 * v1 + v1 * v1) / total
    return p.c0_n + p.c1_n_per_mps * mean_v + (p.c2_n_per_mps2 + q) * 0.5 * (v0 * v0 + v1 * v1)


@kernel
def on_supply(p, u):
    """The train on a stretch with supply u: without motors, without electric brake, or with the line's receptivity."""
    traction = 0.0 if u == NEUTRAL else p.traction_force_n
    electric = p.electric_force_n if u >= 0.0 or p.brakes_dissipate else 0.0
    return TrainParams(
        p.inertial_mass_kg,
        p.c0_n,
        p.c1_n_per_mps,
        p.c2_n_per_mps2,
        traction,
        p.traction_power_w,
        electric,
        p.electric_power_w,
        p.friction_force_n,
        p.adhesive_force_n,
        p.braked_adhesive_force_n,
        p.max_acceleration_mps2,
        p.max_deceleration_mps2,
        max(u, 0.0),
        p.brakes_dissipate,
        p.has_curves,
        p.curves_n,
    )


@kernel
def without_curves(p):
    """The parameters of a train without its effort curves, which vectorised code does not use."""
    return PlainTrain(*p[:-2])


@kernel
def adhesion_coefficient(v):
    """Friction between wheel and rail by Curtius & Kniffler, as in `das.domain.formulary.adhesion_coefficient`."""
    return ADHESION_LEAST + ADHESION_EXTRA / (ADHESION_SPEED * v + ADHESION_OFFSET)


@kernel
def _effort_limit(row, v, force, power, p):
    limit = force if v * force <= power else power / v
    if p.has_curves:
        x = v * CURVE_STEPS_PER_MPS
        i = min(int(x), p.curves_n.shape[1] - 2)
        low = p.curves_n[row, i]
        limit = min(limit, low + min(x - i, 1.0) * (p.curves_n[row, i + 1] - low))
    if p.adhesive_force_n < NO_LIMIT_N:
        return min(limit, p.adhesive_force_n * adhesion_coefficient(v))
    return limit


@kernel
def traction_limit(v, p):
    return _effort_limit(TRACTION, v, p.traction_force_n, p.traction_power_w, p)


@kernel
def electric_limit(v, p):
    return _effort_limit(ELECTRIC, v, p.electric_force_n, p.electric_power_w, p)


@kernel
def brake_limit(v, p, friction_n):
    """Electric brake plus `friction_n` of friction brake, limited by the adhesion of all axles."""
    both = electric_limit(v, p) + friction_n
    if p.braked_adhesive_force_n < NO_LIMIT_N:
        return min(both, p.braked_adhesive_force_n * adhesion_coefficient(v))
    return both


@kernel
def largest_gain(v, resisting, p):
    """Acceleration at full traction against a resisting force.

    The result is at most the train's largest acceleration, or that under full brakes if this is larger.
    """
    rate = (traction_limit(v, p) - resisting) / p.inertial_mass_kg
    if rate <= p.max_acceleration_mps2:
        return rate
    return max(p.max_acceleration_mps2, -(brake_limit(v, p, p.friction_force_n) + resisting) / p.inertial_mass_kg)


@kernel
def largest_loss(v, resisting, p, friction_n):
    """Deceleration at full brake with a resisting force.

    The result is at most the train's largest deceleration, or that under full traction if this is larger.
    """
    rate = (brake_limit(v, p, friction_n) + resisting) / p.inertial_mass_kg
    if rate <= p.max_deceleration_mps2:
        return rate
    return max(p.max_deceleration_mps2, (resisting - traction_limit(v, p)) / p.inertial_mass_kg)


@kernel
def loss_power(f, v, c):
    """Component loss (W) at wheel force f and speed v > 0."""
    if not c.is_map:
        power = f * v
        if power >= 0.0:
            return c.traction_ratio * power + c.idle_w
        return c.idle_w - c.brake_ratio * power
    x = v * c.steps_per_mps
    y = (f - c.force0_n) * c.steps_per_n
    i = min(max(int(x), 0), c.table_w.shape[0] - 2)
    j = min(max(int(y), 0), c.table_w.shape[1] - 2)
    a = x - i
    b = y - j
    low = c.table_w[i, j] + b * (c.table_w[i, j + 1] - c.table_w[i, j])
    high = c.table_w[i + 1, j] + b * (c.table_w[i + 1, j + 1] - c.table_w[i + 1, j])
    return low + a * (high - low)


@kernel
def electric_share(f, v, p):
    """The share of wheel force f provided by the motors: all traction, and braking up to the electric limit."""
    if f >= 0.0:
        return f
    if p.brakes_dissipate:
        return 0.0
    return max(f, -electric_limit(v, p))
