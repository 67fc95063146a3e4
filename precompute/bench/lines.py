"""Long lines made up from a seed, to measure growth with length."""

from __future__ import annotations

import numpy as np

from das.domain.route import Route, Stop, Stretches
from das.domain.units import KM, KMH, PERMILLE

BREAKPOINTS_PER_KM = 5
"""Changes of limit or gradient; a real main line has three to six."""
LIMIT_SHARE = 0.3
"""The share of them that are limits."""
LIMITS_KMH = np.arange(80.0, 165.0, 10.0)
STEEPEST_PERMILLE = 8.0
CLEAR_OF_STOPS_M = 50.0


def made_up_line(length_km: float, seed: int = 1) -> Route:
    """A line between two stops with random limits and gradients; the same for the same seed."""
    draw = np.random.default_rng(seed)
    breakpoints = round(BREAKPOINTS_PER_KM * length_km)
    limits = max(round(LIMIT_SHARE * breakpoints), 1)
    gradients = breakpoints + 1 - limits  # both lists begin at 0
    length_m = length_km * KM

    def stretches(values: np.ndarray) -> Stretches:
        inner = np.sort(draw.uniform(CLEAR_OF_STOPS_M, length_m - CLEAR_OF_STOPS_M, len(values) - 1))
        return Stretches(start_m=np.concatenate(([0.0], inner)), value=values)

    name = f"made up, {length_km:g} km, seed {seed}"
    return Route(
        id="made-up",
        name=name,
        source=name,
        illustrative=True,
        length_m=length_m,
        stops=(Stop(name="A", position_m=0.0), Stop(name="B", position_m=length_m)),
        limits_mps=stretches(draw.choice(LIMITS_KMH, limits) * KMH),
        gradients_ratio=stretches(draw.uniform(-STEEPEST_PERMILLE, STEEPEST_PERMILLE, gradients) * PERMILLE),
        curvature_per_m=Stretches(start_m=np.zeros(1), value=np.zeros(1)),
        geometry_position_m=np.empty(0),
        geometry_latitude_deg=np.empty(0),
        geometry_longitude_deg=np.empty(0),
    )
