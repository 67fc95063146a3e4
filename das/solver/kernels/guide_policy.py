"""Policies over instructions: the effect of each instruction, and the best one in every state.

An instruction consists of a manner (defined by `KINDS` and `SHARES`) and a speed X to which it leads; a train that
reaches X holds it. Its number is `x · 16 + manner`, where x is the index of X among the ascending speeds. The lines of
the speed grid are multiples of `line_mps`; the envelope of each node is an additional line.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import compiled, kernel
from das.domain.units import KMH
from das.solver.kernels.forces import brake_limit, on_supply, traction_limit
from das.solver.kernels.landings import landing_speed, landing_under, step_cost
from das.solver.kernels.schedule import BACK_SHARE, BRAKE, COAST, CURVE, HOLD, TRACTION
from das.solver.kernels.tuples import LineArrays

KINDS = (TRACTION, TRACTION, TRACTION, TRACTION, COAST, BRAKE, BRAKE, BRAKE, HOLD, CURVE, TRACTION)
SHARES = (1.0, 0.8, BACK_SHARE, 0.4, 0.0, 1.0, 0.7, 0.4, 0.0, 0.0, 0.0)
"""Kind and share of the largest effort for each manner; braking before the braking curve uses the electric brake."""
MANNERS, CODE = 11, 16
BACK, ROLLS, HOLDS, ON_CURVE, ROLLS_UP = 2, 4, 8, 9, 10
"""Numbers of manners: traction back to a speed, coasting, holding, braking curve, and coasting until a hill has
accelerated the train to a speed. With a manner before `HOLDS` the motion until X is reached does not depend on X;
`ROLLS_UP` moves the train like `ROLLS`."""
FROM_ABOVE, COLUMNS, LANDED = 10, 11, 11
"""Columns of holding: `HOLDS` accelerates to an X beyond the step, `FROM_ABOVE` slows down to a lower X. Row `LANDED`
contains the costs of all manners for the speeds X that are reached within the step."""
COPIES, NOTHING, PARTS = 16, -1, 33
"""Sources of a part of the costs: a column of the moves; `COPIES` + a row that is copied; none, for infeasible costs.
`PARTS` is the largest number of parts on a line."""
NEAR_MPS = 2.5 * KMH
"""Difference from the train's own speed (m/s), half a step of the advised speeds, below which a speed counts as reached
and is held."""
BAND_MPS = 10.0 * KMH
"""Largest excess (m/s) over the speed to hold that a train loses by coasting; a faster train gets another
instruction."""
STANDS_S = 8.0
"""Minimum duration (s) of an instruction: about the time a driver needs to read it, act and check."""
SAME_MPS = 1e-5
"""Speed difference (m/s) below which speeds count as equal; moves are stored in single precision."""
CONTACT_MPS = 1e-3
"""Largest difference (m/s) from the braking curve at which a train is on it."""
NO_INSTRUCTION = 65535
WORD = 32
"""Number of speeds X whose bits fit in a word of `GuidePolicy.stay`."""
_BIG, _REACHED = 1e30, 1e16
PART = {"fastmath": True, "forceinline": True}
"""Options of a kernel that is inlined into its callers. Without them each call would pass all fields of its arrays,
more than 60 values, and the sweep would take twice as long."""


class GuideGrid(NamedTuple):
    """The grid of a section: line, envelope, limits and end speeds of braking curves by decision node, and speeds X."""

    line: LineArrays
    envelope_mps: NDArray[np.float64]
    limit_mps: NDArray[np.float64]
    """The lowest limit of each decision step."""
    goal_mps: NDArray[np.float64]
    """The speed to which the braking curve of each decision node falls."""
    goal_x: NDArray[np.int64]
    """Number of `goal_mps` among the speeds X; -1 for standstill."""
    crest_mps: NDArray[np.float64]
    """The speed from which the braking curve falls in each decision step, down to the envelope at its end."""
    falls_m: NDArray[np.float64]
    """The length of that fall; 0 if the envelope does not fall at the end of the step."""
    speeds_mps: NDArray[np.float64]
    """The speeds X that may be advised, ascending."""
    line_mps: float
    """The distance between two lines of the speed grid."""


class GuideMoves(NamedTuple):
    """Results of the manners in a decision step (nodes, lines, columns): speed, energy, line below the speed, weight of
    the line above.

    The line is -1 if a manner cannot be continued to the end of the step. The speed is -1 if the train stops.
    """

    landing_mps: NDArray[np.float32]
    energy_j: NDArray[np.float32]
    target: NDArray[np.int16]
    weight: NDArray[np.float32]


class GuidePrices(NamedTuple):
    """Prices of time (W), of a change, and of a change before `STANDS_S` (J).

    `least_mps` is the lowest speed to which a new instruction may lead, where the limit is not lower.
    """

    time_w: float
    change_j: float
    young_j: float
    least_mps: float


class GuidePolicy(NamedTuple):
    """The best new instruction in each state (nodes, lines), and the instructions worth keeping there.

    `stay` has a bit for each X (nodes, lines, manners, ages, words). Age 0: shown for `STANDS_S`; age 1: more recent.
    """

    choice: NDArray[np.uint16]
    stay: NDArray[np.uint32]


@compiled(**PART)
def top_line(envelope, line_mps):
    """The number of the highest line of a node."""
    return int(np.ceil(envelope / line_mps - SAME_MPS))


@compiled(**PART)
def between(v, line_mps, top):
    """The line below a speed up to the envelope `top`, and the weight of the line above it, linear in v²."""
    j = max(min(int(v / line_mps + 1e-9), top_line(top, line_mps) - 1), 0)
    if j == 0:
        return 0, 1.0  # Trains stand only at the ends of a section: the lowest cell counts as its upper line.
    a, b = j * line_mps, min((j + 1) * line_mps, top)
    return j, min(max((v * v - a * a) / (b * b - a * a), 0.0), 1.0)


@compiled(**PART)
def first_above(speeds, v):
    """The index of the lowest of the ascending speeds above a given speed."""
    low, high = 0, speeds.size
    while low < high:
        middle = (low + high) // 2
        if speeds[middle] > v:
            high = middle
        else:
            low = middle + 1
    return low


@kernel
def column_landing(m, v0, step, p):
    """The speed after a decision step (length, resistances) in a column of the moves; 0 if it cannot be used."""
    h, g, q = step
    powered = traction_limit(v0, p) > 0.0
    if m < ROLLS:
        return landing_speed(v0, h, SHARES[m], g, q, p) if powered else 0.0
    if ROLLS < m < HOLDS:
        slower = landing_speed(v0, h, -SHARES[m], g, q, p)
        return slower if slower < v0 else 0.0  # On a steep descent a reduced effort may not slow the train down.
    if m == HOLDS and powered:
        full = landing_speed(v0, h, 1.0, g, q, p)
        return max(landing_speed(v0, h, SHARES[BACK], g, q, p), min(v0, full))
    rolls = landing_under(0.0, v0, h, g, q, p)
    if m != FROM_ABOVE or rolls <= v0:
        return rolls
    return max(v0, landing_under(-brake_limit(v0, p, p.friction_force_n), v0, h, g, q, p))  # Motors may be off.


@kernel
def kept_landing(m, v0, v1, envelope, top, last):
    """The speed after a step to v1 within the envelope (`envelope` before it, `top` after); -1 if m cannot continue."""
    if m == ON_CURVE and last:
        return top if v1 >= top - SAME_MPS else -1.0
    if v1 > top:
        if m == ON_CURVE or v1 <= top + CONTACT_MPS:
            v1 = top
        elif m < ROLLS:
            v1 = top if v0 <= top + SAME_MPS else -1.0
        elif m < HOLDS:
            # A train that coasts up to a constant limit gets the instruction to hold it.
            v1 = top if v0 <= envelope - CONTACT_MPS and top < envelope - SAME_MPS else -1.0
        else:
            v1 = -1.0
    return -1.0 if v1 <= 0.0 or (last and v1 < top - SAME_MPS) else v1


@kernel
def curve_energy(v0, v1, k, grid, p, c):
    """The energy (J) of decision step k from v0 towards v1, until the braking curve is met and followed to its end.

    Braking on the curve is stronger than the mean of the step, and may exceed what the motors give.
    """
    line, h, top_w = grid.line, grid.line.step_m[k], grid.envelope_mps[k + 1] ** 2
    g, q, fall = line.constant_n[k], line.tunnel_n_per_mps2[k], grid.falls_m[k]
    gains, falls = (v1 * v1 - v0 * v0) / h, (grid.crest_mps[k] ** 2 - top_w) / fall
    meets = min(max((top_w + falls * h - v0 * v0) / (gains + falls), 0.0), h)
    at_mps = math.sqrt(max(v0 * v0 + gains * meets, 0.0))
    energy = step_cost(v0, at_mps, meets, g, q, p, c)[1] if meets > 0.0 else 0.0
    if meets < h:
        energy += step_cost(at_mps, math.sqrt(top_w), h - meets, g, q, p, c)[1]
    return energy


@kernel
def guide_moves(first, last, grid, p, c, row, moves):
    """Fill the moves of decision nodes first … last − 1; row `row` of the moves is that of node `first`."""
    landing, energy, target, weight = moves
    line, envelope, line_mps = grid.line, grid.envelope_mps, grid.line_mps
    for k in range(first, last):
        h, g, q = line.step_m[k], line.constant_n[k], line.tunnel_n_per_mps2[k]
        here, top = on_supply(p, line.supply[k]), envelope[k + 1]
        for j in range(landing.shape[1]):
            v0 = min(j * line_mps, envelope[k])
            for m in range(COLUMNS):
                at = row + k - first, j, m
                target[at], landing[at] = -1, -1.0
                if j > top_line(envelope[k], line_mps) or (v0 <= 0.0 and m >= ROLLS):
                    continue
                v1 = column_landing(m, v0, (h, g, q), here)
                kept = kept_landing(m, v0, v1, envelope[k], top, k == line.step_m.size - 1)
                if v1 > 0.0:
                    landing[at] = v1 if kept < 0.0 else kept
                if kept >= 0.0:
                    landing[at], energy[at] = kept, step_cost(v0, kept, h, g, q, here, c)[1]
                    if m >= ROLLS and v1 > kept + SAME_MPS and grid.falls_m[k] > 0.0:
                        energy[at] = curve_energy(v0, v1, k, grid, here, c)
                    target[at], weight[at] = between(kept, line_mps, top)


@compiled(**PART)
def put_ahead(begin, end, cost, young, w, ahead, lower, manner, here, j, row):
    """Fill in the costs for the speeds X from begin to end that a step of this cost does not reach.

    The step leads to `manner`, between lines `lower` and `lower` + 1 (weight `w`). `ahead` and `here` (lines, rows,
    ages, X) hold, for age 0, the cost of an instruction shown for `STANDS_S` and, for age 1, the additional cost of a
    more recent one. The share `young` of the latter remains, because an instruction gets older in a step.
    """
    a, b = 1.0 - w, w
    for x in range(np.uint64(begin), np.uint64(max(begin, end))):
        here[j, row, 0, x] = cost + a * ahead[lower, manner, 0, x] + b * ahead[lower + 1, manner, 0, x]
        here[j, row, 1, x] = young * (a * ahead[lower, manner, 1, x] + b * ahead[lower + 1, manner, 1, x])


@compiled(**PART)
def put_same(begin, end, given, here, j, row):
    """Copy the costs of a row for the speeds X from begin to end to another row."""
    for x in range(np.uint64(begin), np.uint64(max(begin, end))):
        here[j, row, 0, x], here[j, row, 1, x] = here[j, given, 0, x], here[j, given, 1, x]


@compiled(**PART)
def put_none(begin, end, here, j, row):
    """Fill a row with the costs of infeasible moves, for the speeds X from begin to end."""
    for x in range(np.uint64(begin), np.uint64(max(begin, end))):
        here[j, row, 0, x], here[j, row, 1, x] = _BIG, 0.0


@compiled(**PART)
def put_landed(begin, end, v0, ends, step, ahead, grid, price_w, p, c, here, j):
    """Fill in the costs of reaching the speeds X from begin to end at the end of a decision step and then holding them.

    `ends` are the lowest and the highest speed there.
    """
    h, g, q = step
    for x in range(begin, end):
        to = grid.speeds_mps[x]
        if to > ends[1] + SAME_MPS or to < ends[0] - SAME_MPS:
            put_none(x, x + 1, here, j, LANDED)
            continue
        took, spent = step_cost(v0, to, h, g, q, p, c)
        lower, w = between(to, grid.line_mps, ends[1])
        young = max(1.0 - took / STANDS_S, 0.0)
        put_ahead(x, x + 1, spent + price_w * took, young, w, ahead, lower, HOLDS, here, j, LANDED)


@compiled(**PART)
def put_part(part, v0, h, i, moves, ahead, price_w, here, j):
    """Fill in a part (manner, begin, end, source) of the costs on line j, for a step of length h.

    The costs for the speeds X from begin to end are those of a move (row i) that does not reach them, or a copy of
    another row.
    """
    manner, begin, end, source = part[0], part[1], part[2], part[3]
    if source >= COPIES:
        put_same(begin, end, source - COPIES, here, j, manner)
        return
    lower = np.int64(moves.target[i, j, source]) if source >= 0 else -1
    if lower < 0:
        put_none(begin, end, here, j, manner)
        return
    took = 2.0 * h / (v0 + moves.landing_mps[i, j, source])
    cost = moves.energy_j[i, j, source] + price_w * took
    young, w = max(1.0 - took / STANDS_S, 0.0), np.float64(moves.weight[i, j, source])
    put_ahead(begin, end, cost, young, w, ahead, lower, manner, here, j, manner)


@kernel
def add_part(parts, n, manner, begin, end, source):
    """Write part n, if it is not empty; returns the number of parts."""
    if begin >= end:
        return n
    parts[n, 0], parts[n, 1], parts[n, 2], parts[n, 3] = manner, begin, end, source
    return n + 1


@kernel
def fill_parts(v0, falls, limit_mps, line_mps, speeds, landing_mps, spans, parts):
    """Fill in the parts of the costs, in the order in which they can be filled, and the range of X (begin, end) for
    which each manner is defined; returns the number of parts.

    `landing_mps` are the speeds after the step by column; `falls`: v0 is above the end of the braking curve,
    or the step is the last.
    """
    up_to = first_above(speeds, limit_mps + SAME_MPS)
    equal, above = first_above(speeds, v0 - SAME_MPS), first_above(speeds, v0 + SAME_MPS)
    lower, higher = first_above(speeds, v0 - line_mps), first_above(speeds, v0 + line_mps)
    # Holding: slow down to X, reach X in this step, accelerate to X.
    up, down, begin = landing_mps[HOLDS], landing_mps[FROM_ABOVE], up_to
    if up > 0.0 and down > 0.0:
        begin = min(first_above(speeds, v0 - BAND_MPS), up_to)
    reached = min(max(first_above(speeds, up - SAME_MPS), equal, begin), up_to)
    below = min(max(first_above(speeds, down - SAME_MPS), begin), reached)
    begin = below if down > v0 + SAME_MPS else begin  # The brakes cannot hold the train on the descent.
    n = add_part(parts, 0, HOLDS, 0, begin, NOTHING)
    n = add_part(parts, n, HOLDS, begin, below, FROM_ABOVE)
    n = add_part(parts, n, HOLDS, below, reached, COPIES + LANDED)
    n = add_part(parts, n, HOLDS, reached, up_to, HOLDS)
    n = add_part(parts, n, HOLDS, up_to, speeds.size, NOTHING)
    spans[HOLDS, 0], spans[HOLDS, 1] = begin, up_to
    up_to = max(up_to, above)
    for column in range(ROLLS + 1):  # X is below the speed and held, or reached in this step, or not reached.
        m = ROLLS_UP if column == ROLLS else column
        reached = min(max(first_above(speeds, landing_mps[column] - SAME_MPS), above), up_to)
        n = add_part(parts, n, m, lower, above, COPIES + HOLDS)
        n = add_part(parts, n, m, above, reached, COPIES + LANDED)
        n = add_part(parts, n, m, reached, up_to, column)
        spans[m, 0], spans[m, 1] = lower, up_to
    for m in range(ROLLS, HOLDS):
        v1 = landing_mps[m]
        reached = min(first_above(speeds, v1 + SAME_MPS), equal) if v1 > 0.0 else equal
        n = add_part(parts, n, m, 0, reached, m)
        n = add_part(parts, n, m, reached, equal, COPIES + LANDED)
        n = add_part(parts, n, m, equal, higher, COPIES + HOLDS)
        spans[m, 0], spans[m, 1] = 0, higher
    spans[ON_CURVE, 0], spans[ON_CURVE, 1] = 0, 1
    return add_part(parts, n, ON_CURVE, 0, 1, ON_CURVE if falls else NOTHING)


@compiled(**PART)
def put_costs(k, i, j, v0, grid, p, c, moves, price_w, ahead, here, spans, parts):
    """Fill in the costs of all manners on line j of node k, and the range of X (begin, end) for which each is defined.

    `ahead` are the costs at the next node; row i of the moves is that of node k; `parts` is overwritten.
    """
    line, speeds, h, top = grid.line, grid.speeds_mps, grid.line.step_m[k], grid.envelope_mps[k + 1]
    last = k == line.step_m.size - 1
    slowest = fastest = v0
    for m in range(COLUMNS):
        v1 = moves.landing_mps[i, j, m]
        slowest, fastest = min(slowest, v1) if v1 > 0.0 else slowest, max(fastest, v1)
    put_landed(
        first_above(speeds, slowest - SAME_MPS), first_above(speeds, fastest + SAME_MPS), v0,
        (top if last else 0.0, top), (h, line.constant_n[k], line.tunnel_n_per_mps2[k]), ahead, grid, price_w, p, c,
        here, j,
    )  # fmt: skip
    falls = last or v0 > grid.goal_mps[k] + SAME_MPS
    n = fill_parts(v0, falls, grid.limit_mps[k], grid.line_mps, speeds, moves.landing_mps[i, j], spans, parts)
    for at in range(n):
        put_part(parts[at], v0, h, i, moves, ahead, price_w, here, j)


@compiled(**PART)
def least(begin, end, here, j, m):
    """The least cost of a new instruction in a manner to the speeds X from begin to end."""
    found = _BIG
    for x in range(np.uint64(begin), np.uint64(max(begin, end))):
        found = min(found, here[j, m, 0, x] + here[j, m, 1, x])
    return found


@compiled(**PART)
def best_instruction(v0, on_curve, speeds, slowest, here, j, spans):
    """The least cost of a new instruction on a line to a speed X from number `slowest` on, and that instruction."""
    down, up = first_above(speeds, v0 - NEAR_MPS), first_above(speeds, v0 + NEAR_MPS)
    near = first_above(speeds, v0 - NEAR_MPS - SAME_MPS), first_above(speeds, v0 + NEAR_MPS + SAME_MPS)
    best, which = _BIG, NO_INSTRUCTION
    for m in range(MANNERS):
        begin, end = 0, down
        if m < ROLLS or m == ROLLS_UP:
            begin, end = up, spans[m, 1]
        elif m == HOLDS:
            begin, end = max(near[0], spans[m, 0]), min(near[1], spans[m, 1])
        begin = max(begin, slowest)
        if m == ON_CURVE:
            begin, end = 0, 1 if on_curve else 0
        lowest = least(begin, end, here, j, m)
        if lowest < best:
            best = lowest
            for x in range(begin, end):
                if here[j, m, 0, x] + here[j, m, 1, x] <= lowest:
                    which = x * CODE + m
                    break
    return best, which


@compiled(**PART)
def keep(span, leave, leave_young, here, j, m, stay, i):
    """Limit the cost of keeping each instruction of a manner to the cost of leaving it; set the bits of `stay`."""
    begin, end = np.uint64(span[0]), np.uint64(span[1])
    for w in range(stay.shape[4]):
        kept, kept_young, first = np.uint32(0), np.uint32(0), np.uint64(w * WORD)
        for x in range(max(begin, first), min(end, first + np.uint64(WORD))):
            old, young = here[j, m, 0, x], here[j, m, 0, x] + here[j, m, 1, x]
            kept |= np.uint32(old <= leave) << np.uint32(x - first)
            kept_young |= np.uint32(young <= leave_young) << np.uint32(x - first)
        stay[i, j, m, 0, w], stay[i, j, m, 1, w] = kept, kept_young
    for x in range(begin, end):
        young = min(here[j, m, 0, x] + here[j, m, 1, x], leave_young)
        here[j, m, 0, x] = min(here[j, m, 0, x], leave)
        here[j, m, 1, x] = young - here[j, m, 0, x]
    premium = leave_young - leave
    for x in range(np.uint64(0), begin):
        here[j, m, 0, x], here[j, m, 1, x] = leave, premium
    for x in range(end, np.uint64(here.shape[3])):
        here[j, m, 0, x], here[j, m, 1, x] = leave, premium


@compiled(fastmath=True)
def guide_sweep(first, last, ahead, grid, p, c, moves, prices, policy):
    """Fill the policy for one price of time by a backward sweep from decision node `last` to `first`.

    Row 0 of moves and policy is node `first`. `ahead` are the costs at node `last` (lines, rows, ages, X), which are
    overwritten. Returns the costs at node `first`.
    """
    choice, stay = policy
    n = grid.line.step_m.size
    here, spans, parts = np.zeros_like(ahead), np.zeros((MANNERS, 2), np.int64), np.zeros((PARTS, 4), np.int64)
    for k in range(last - 1, first - 1, -1):
        i, train = k - first, on_supply(p, grid.line.supply[k])
        envelope, top = grid.envelope_mps[k], grid.envelope_mps[k + 1]
        choice[i], stay[i] = NO_INSTRUCTION, 0
        slowest = first_above(grid.speeds_mps, min(prices.least_mps, grid.limit_mps[k]) - SAME_MPS)
        for j in range(top_line(envelope, grid.line_mps) + 1):
            v0 = min(j * grid.line_mps, envelope)
            put_costs(k, i, j, v0, grid, train, c, moves, prices.time_w, ahead, here, spans, parts)
            rolls_into = top < v0 - SAME_MPS and moves.landing_mps[i, j, FROM_ABOVE] > top - SAME_MPS
            on_curve = rolls_into or k == n - 1
            best, which = best_instruction(v0, on_curve, grid.speeds_mps, slowest, here, j, spans)
            if best >= _REACHED:
                here[j, :, 0], here[j, :, 1] = _BIG, 0.0
                continue
            choice[i, j] = which
            if k < n - 1 and abs(v0 - grid.goal_mps[k]) < CONTACT_MPS:
                x = grid.goal_x[k]  # The curve ends; its speed is held if possible.
                here[j, ON_CURVE, 0, 0], here[j, ON_CURVE, 1, 0] = best, 0.0
                if spans[HOLDS, 0] <= x < spans[HOLDS, 1] and here[j, HOLDS, 0, x] < _REACHED:
                    here[j, ON_CURVE, :, 0] = here[j, HOLDS, :, x]
            for m in range(MANNERS):
                keep(spans[m], best + prices.change_j, best + prices.young_j, here, j, m, stay, i)
        ahead, here = here, ahead
    return ahead
