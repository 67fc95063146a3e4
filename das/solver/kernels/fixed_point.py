"""The search for a speed that is its own image under a step."""

from __future__ import annotations

from das.compiling import kernel

FIXED_POINT_STEPS = 60
"""Most iterations."""
FIXED_POINT_TOLERANCE = 1e-13
"""A speed has been found when an iteration changes it by at most this share."""


@kernel
def narrowed(v, new, low, low_gap, high, high_gap):
    """The next guess of a speed that is its own `new`, where new falls as v rises, and the bounds of it.

    The power limit leaves less force, the faster the step: v would swing between too fast and too slow. So it is
    bracketed and found by false position (Illinois); `high_gap` is 0 as long as nothing was too fast.
    """
    gap = new - v
    if gap > 0.0:
        low, low_gap, high_gap = v, gap, 0.5 * high_gap
    else:
        high, high_gap, low_gap = v, gap, 0.5 * low_gap
    if high_gap == 0.0:
        return low, low_gap, high, high_gap, new
    return low, low_gap, high, high_gap, low + (high - low) * low_gap / (low_gap - high_gap)
