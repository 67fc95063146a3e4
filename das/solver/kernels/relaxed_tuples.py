"""The convex relaxation of a section, its variables and its multipliers, as the kernels take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class RelaxedMotion(NamedTuple):
    """What moves the train over each interval (n,): F = inertia·(w1 − w0) + constant + quadratic·(w0 + w1) + linear/τ.

    `max_acceleration` (m/s²) is 1e5 or more where there is no such limit.
    """

    step_m: Floats
    inertia: Floats
    constant: Floats
    linear: Floats
    quadratic: Floats
    max_acceleration: Floats


class RelaxedEfforts(NamedTuple):
    """Limits of the motors over each interval (n,): −electric <= f <= traction.

    A limit is a force, and a line power·τ + offset in the slowness. `adhesive_force` (one number, negative: none) times
    the coefficient of adhesion limits the traction too.
    """

    traction_force: Floats
    traction_power: Floats
    traction_offset: Floats
    electric_force: Floats
    electric_power: Floats
    electric_offset: Floats
    adhesive_force: float


class Box(NamedTuple):
    """Bounds of v²/2 at the nodes (n + 1,) and of the slowness (n,); `free` says which speeds are variables."""

    low_w: Floats
    high_w: Floats
    free: NDArray[np.bool_]
    low_tau: Floats
    high_tau: Floats


class Planes(NamedTuple):
    """Planes (n, planes) below the energy per metre: e >= force·f + slowness·τ + speed·(w0 + w1) + constant."""

    force: Floats
    slowness: Floats
    speed: Floats
    constant: Floats


class Program(NamedTuple):
    """The convex relaxation as the kernels take it; all forces are in units of one force."""

    motion: RelaxedMotion
    efforts: RelaxedEfforts
    box: Box
    planes: Planes
    allowed_s: float


class RelaxedRun(NamedTuple):
    """Values of all variables: w (n + 1,), and local (n, 3) with τ, f and e of each interval."""

    w: Floats
    local: Floats


class Multipliers(NamedTuple):
    """Multipliers of the constraints (n, rows), and that of the time in element 0 of `time` (1,)."""

    rows: Floats
    time: Floats
