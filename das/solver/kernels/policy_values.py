"""Values of a policy between the multipliers of the ladder and between the lines of the speed grid.

Values are interpolated in λ by the cubic through both values and both slopes (dV/dλ is the time-to-go) and in speed by
a cubic, so that decisions are smooth where the optimum is.
"""

from __future__ import annotations

from numba import types
from numba.extending import overload

from das.compiling import kernel
from das.solver.kernels.speed_grid import locate
from das.solver.kernels.tuples import PackedTimes
from das.solver.tolerances import INFEASIBLE


def time_at(time_to_go, k, j, a):
    """Time-to-go (s) at decision node k, grid line j and multiplier a, of an array or of PackedTimes."""
    if isinstance(time_to_go, PackedTimes):
        return time_to_go.low_s[k, a] + time_to_go.step_s[k, a] * float(time_to_go.steps[k, j, a])
    return time_to_go[k, j, a]


@overload(time_at)
def _compiled_time_at(time_to_go, k, j, a):
    if isinstance(time_to_go, types.BaseNamedTuple):
        return lambda time_to_go, k, j, a: (
            time_to_go.low_s[k, a] + time_to_go.step_s[k, a] * float(time_to_go.steps[k, j, a])
        )
    return lambda time_to_go, k, j, a: time_to_go[k, j, a]


@kernel
def blended_values(policies, policy, k, first, last, row):
    """Values (J) of the policy at decision node k, grid lines first … last, into row[first … last]."""
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
            ta = time_at(time_to_go, k, j, a)
            tb = time_at(time_to_go, k, j, a + 1)
            row[j] = of_va * va + of_ta * ta + of_vb * vb + of_tb * tb


@kernel
def value_at(row, v, floor, top):
    """Value (J) at speed v of a decision node whose grid lines hold `row`; floor and top bound the speed grid there.

    Only the lines that `needed_lines` names for v are read.
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
