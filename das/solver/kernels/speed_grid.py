"""The speed grid of a decision node: evenly from the floor to the envelope."""

from __future__ import annotations

from das.compiling import kernel
from das.solver.tolerances import SMALLEST_SHARE


@kernel
def grid_speed(floor, top, j, steps):
    """Speed of grid line j of a decision node: evenly from the floor to the envelope."""
    return floor + (top - floor) * j / steps


@kernel
def locate(v, floor, top, steps):
    """Grid line below speed v and the share of the line above it, linear in v²; (-1, 0.0) outside the table.

    A standing train (line 0 of a floor of 0) is not in the table. A speed less than half a line below a floor
    is taken as on it: that is the rounding of the integration.
    """
    span = top - floor
    if span <= 0.0:
        return 0, 0.0
    x = (v - floor) * (steps / span)
    if floor <= 0.0:
        if x < 1.0:
            return -1, 0.0
    elif x < 0.0:
        if x < -0.5:
            return -1, 0.0
        return 0, 0.0
    lower = min(int(x), steps - 1)
    # (v² − a²)/(b² − a²) with the lines a = v − beyond and b = a + span/steps: one division, no cancellation.
    u = x - lower
    beyond = u * (span / steps)
    share = u * (2.0 * v - beyond) / (2.0 * (v - beyond) + span / steps)
    if share < SMALLEST_SHARE:
        share = 0.0
    elif share > 1.0 - SMALLEST_SHARE:
        share = 1.0
    return lower, share
