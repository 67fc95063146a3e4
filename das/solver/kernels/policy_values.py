"""Values of a policy: their speed grid, and interpolation between its lines.

Values are interpolated in λ by the cubic through the values and slopes at both neighbouring λ (the slope dV/dλ is the
time-to-go) and in speed by a cubic; decisions are then smooth where the optimum is smooth.
"""

from __future__ import annotations

from das.compiling import kernel
from das.solver.tolerances import INFEASIBLE, SMALLEST_SHARE


@kernel
def grid_speed(floor, top, j, steps):
    """Speed of grid line j of a decision node; the lines are evenly spaced from the floor to the envelope."""
    return floor + (top - floor) * j / steps


@kernel
def locate(v, floor, top, steps):
    """Grid line below speed v and the weight of the line above it, linear in v²; (-1, 0.0) outside the table.

    A standing train (line 0 of a floor of 0) is not in the table. A speed less than half a grid step below the floor
    counts as the floor: the difference is a rounding error of the integration.
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


@kernel
def blended_values(policies, policy, k, first, last, row):
    """Write the values (J) of the policy at decision node k, grid lines first … last, into row[first … last]."""
    value, time_to_go = policies.value_j, policies.time_to_go_s
    a, gap = policy.ladder_index, policy.gap_w
    if gap <= 0.0:
        for j in range(first, last + 1):
            row[j] = value[k, j, a]
        return
    u = policy.offset_w / gap
    r = 1.0 - u
    of_va = (1.0 + 2.0 * u) * r * r
    of_ta = u * r * r * gap
    of_vb = u * u * (3.0 - 2.0 * u)
    of_tb = -u * u * r * gap
    for j in range(first, last + 1):
        va = value[k, j, a]
        vb = value[k, j, a + 1]
        if va >= 0.5 * INFEASIBLE or vb >= 0.5 * INFEASIBLE:
            row[j] = INFEASIBLE
        else:
            ta = time_to_go[k, j, a]
            tb = time_to_go[k, j, a + 1]
            row[j] = of_va * va + of_ta * ta + of_vb * vb + of_tb * tb


@kernel
def value_at(row, v, floor, top):
    """Value (J) at speed v of a decision node whose grid lines have the values `row`; floor and top bound the speed
    grid there.

    Only the lines given by `needed_lines` for v are read.
    """
    steps = row.size - 1
    i, s = locate(v, floor, top, steps)
    if i < 0:
        return INFEASIBLE
    y1 = row[i]
    if s == 0.0:
        return y1
    y2 = row[i + 1]
    if i < 2 or i > steps - 2:
        return (1.0 - s) * y1 + s * y2
    u = (v - floor) * (steps / (top - floor)) - i
    y0 = row[i - 1]
    y3 = row[i + 2]
    if max(max(y0, y1), max(y2, y3)) >= 0.5 * INFEASIBLE:
        return (1.0 - u) * y1 + u * y2
    return y1 + 0.5 * u * (y2 - y0 + u * (2.0 * y0 - 5.0 * y1 + 4.0 * y2 - y3 + u * (3.0 * (y1 - y2) + y3 - y0)))


@kernel
def needed_lines(low, high, floor, top, steps):
    """First and last grid line that `value_at` reads for speeds low … high."""
    first = max(locate(low, floor, top, steps)[0] - 1, 0)
    return first, min(max(locate(high, floor, top, steps)[0], 0) + 2, steps)
