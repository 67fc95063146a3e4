"""Looking up what the optimum does next from any state, without rolling out the run, in well under 0.2 ms.

The cab does not use it: on board the whole run is rolled out. It serves analyses of tables and the bench. The kernels
answer from the policies of a section; their symbols are those of `das.solver.kernels`, their times those of the
decision grid.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.compiling import kernel
from das.domain.errors import DasError, InfeasibleError
from das.domain.units import KMH
from das.solver.front import Front
from das.solver.kernels.forces import brake_limit, mean_resistance, on_supply, traction_limit
from das.solver.kernels.landings import LANDINGS
from das.solver.kernels.policy_values import locate, time_at
from das.solver.kernels.roll_out import best_landing
from das.solver.kernels.tuples import DecisionStep, LineArrays, LossParams, Policies, Policy, SpeedBounds
from das.solver.solution import Fit
from das.solver.state import check_state
from das.solver.tolerances import INFEASIBLE, MIN_STEP_M, TIME_TOLERANCE_S

ON_TIME, LATE, EARLY, STUCK = 0, 1, 2, 3
"""How the answer relates to the time left; STUCK: the policies know no feasible continuation."""
_MOST_NARROWINGS = 6


class Look(NamedTuple):
    """What a look-up works on: the speed now, the step to the next decision node, the section's policies and losses.

    `out` and `row` are working space (see `best_landing`).
    """

    v0: float
    step: DecisionStep
    policies: Policies
    losses: LossParams
    out: NDArray[np.float64]
    row: NDArray[np.float64]


@kernel
def first_step(s, node, decision, line, bounds, p):
    """The step from position s to the next decision node; a node nearer than MIN_STEP_M counts as passed."""
    step, g, q, u = line
    floor, envelope = bounds
    i = np.searchsorted(node, s + MIN_STEP_M, side="right")
    k = np.searchsorted(decision, i)
    last = decision[k]
    part = node[i] - s
    h, gh, qh = part, g[i - 1] * part, q[i - 1] * part
    for j in range(i, last):
        h += step[j]
        gh += g[j] * step[j]
        qh += q[j] * step[j]
    final = k == decision.size - 1 and floor[last] >= envelope[last]
    return DecisionStep(k, h, gh / h, qh / h, floor[last], envelope[last], final, on_supply(p, u[i - 1]))


@kernel
def _slope(policies, policy, k, j):
    """Time-to-go (s) on a grid line: the λ-derivative of the cubic through values and slopes at both neighbouring λ."""
    value, time_to_go = policies.value_j, policies.time_to_go_s
    a, gap = policy.ladder_index, policy.gap_w
    ta = time_at(time_to_go, k, j, a)
    if gap <= 0.0:
        return ta
    tb = time_at(time_to_go, k, j, a + 1)
    u = policy.offset_w / gap
    secant = (float(value[k, j, a + 1]) - float(value[k, j, a])) / gap
    return 6.0 * u * (1.0 - u) * secant + (1.0 - u) * (1.0 - 3.0 * u) * ta + u * (3.0 * u - 2.0) * tb


@kernel
def _follow(x, policy):
    """Best landing of the first step under a policy, least total cost (J) and time (s)."""
    v1, cost = best_landing(x.v0, x.step, policy, x.policies, x.losses, x.out, x.row)
    if v1 < 0.0 or x.v0 + v1 <= 0.0:
        return -1.0, INFEASIBLE, INFEASIBLE
    step = x.step
    time = 2.0 * step.length_m / (x.v0 + v1)
    if not step.final:
        j, s = locate(v1, step.floor_mps, step.envelope_mps, x.row.size - 1)
        time += (1.0 - s) * _slope(x.policies, policy, step.node, j)
        if s > 0.0:
            time += s * _slope(x.policies, policy, step.node, j + 1)
    return v1, cost, time


@kernel
def _follow_step(x, a):
    """Best landing of the first step at multiplier a of the ladder, least total cost (J) and time (s)."""
    return _follow(x, Policy(x.policies.lambda_w[a], a, 0.0, 0.0))


@kernel
def _guess(x, time_left):
    """Ladder index whose time is about `time_left`: assumes that all multipliers land like the middle one."""
    step = x.step
    low, high = 0, x.policies.lambda_w.size - 1
    v1, _, _ = _follow_step(x, high // 2)
    if v1 < 0.0 or step.final:
        return high
    ahead = time_left - 2.0 * step.length_m / (x.v0 + v1)
    j, _ = locate(v1, step.floor_mps, step.envelope_mps, x.row.size - 1)
    while high > low:
        a = (low + high) // 2
        if time_at(x.policies.time_to_go_s, step.node, j, a) > ahead:
            low = a + 1
        else:
            high = a
    return low


@kernel
def _neighbours(x, time_left):
    """Neighbours of the ladder whose times enclose `time_left`: slow index, its time, quick index, its time.

    Both neighbours are the same where the time is beyond an end of the ladder.
    """
    a = _guess(x, time_left)
    _, _, time = _follow_step(x, a)
    step = 1 if time > time_left else -1
    while 0 <= a + step < x.policies.lambda_w.size:
        _, _, other = _follow_step(x, a + step)
        if step > 0 and other <= time_left:
            return a, time, a + 1, other
        if step < 0 and other > time_left:
            return a - 1, other, a, time
        a, time = a + step, other
    return a, time, a, time


@kernel
def _narrow(x, time_left, left, slow, right, quick):
    """λ, landing, cost and time of the policy between two neighbours whose time is `time_left` (false position)."""
    lam = x.policies.lambda_w
    gap = lam[right] - lam[left]
    low, high, above, below = 0.0, gap, slow - time_left, quick - time_left
    kept = 0
    price, v1, cost, time = lam[left], -1.0, INFEASIBLE, INFEASIBLE
    for _ in range(_MOST_NARROWINGS):
        offset = low + (high - low) * min(max(above / (above - below), 0.02), 0.98)
        price = lam[left] + offset
        v1, cost, time = _follow(x, Policy(price, left, offset, gap))
        if abs(time - time_left) <= TIME_TOLERANCE_S:
            break
        # The end kept twice in a row counts half, so that both ends move (Illinois).
        if time > time_left:
            low, above = offset, time - time_left
            below *= 0.5 if kept > 0 else 1.0
            kept = 1
        else:
            high, below = offset, time - time_left
            above *= 0.5 if kept < 0 else 1.0
            kept = -1
    return price, v1, cost, time


@kernel
def _mean_force(x, v1):
    """Mean wheel force (N) of the first step with landing v1, within what the train can do now."""
    step, p = x.step, x.step.train
    force = p.inertial_mass_kg * (v1 * v1 - x.v0 * x.v0) / (2.0 * step.length_m)
    force += mean_resistance(x.v0, v1, step.tunnel_n_per_mps2, p)
    force += step.constant_n
    return max(min(force, traction_limit(x.v0, p)), -brake_limit(x.v0, p, p.friction_force_n))


@kernel
def look_up(s, v0, time_left, node, decision, step_m, g, q, u, floor, envelope, lam, value, time_to_go, p, c):
    """The optimal continuation from position s and speed v0 when `time_left` seconds are left.

    Returns (fit, λ, decision node ahead, landing speed there, mean wheel force up to it (N), energy-to-go (J),
    time-to-go (s)). On time, the energy is that of the supported front: max over λ of (least total cost − λ·time).

    Each array is an argument of its own: handing over tuples of arrays would make the look-up a tenth slower.
    """
    line, bounds = LineArrays(step_m, g, q, u), SpeedBounds(floor, envelope)
    policies = Policies(lam, value, time_to_go)
    step = first_step(s, node, decision, line, bounds, p)
    x = Look(v0, step, policies, c, np.empty(LANDINGS), np.empty(policies.value_j.shape[1]))
    left, slow, right, quick = _neighbours(x, time_left)
    fit = ON_TIME
    if left < right:
        price, v1, cost, time = _narrow(x, time_left, left, slow, right, quick)
    else:
        price = policies.lambda_w[left]
        v1, cost, time = _follow_step(x, left)
        if v1 < 0.0:
            return STUCK, price, step.node, v0, 0.0, INFEASIBLE, INFEASIBLE
        if abs(time - time_left) > TIME_TOLERANCE_S:
            fit = LATE if time > time_left else EARLY
    energy = cost - price * (time_left if fit == ON_TIME else time)
    return fit, price, step.node, v1, _mean_force(x, v1), energy, time


_FITS = {ON_TIME: Fit.ON_TIME, LATE: Fit.LATE, EARLY: Fit.EARLY}


class Continuation(NamedTuple):
    """What the optimum does from a state.

    `speed_mps` is the advised speed at `next_m`, the next decision node, and `force_n` the mean wheel force up to there
    (traction > 0, all brakes < 0) within what the train can do now. `time_to_go_s` and `energy_to_go_j` (at the
    current collector) count to the end of the section on the decision grid: they differ from those of a rolled-out
    trajectory by its finer integration.
    """

    fit: Fit
    lambda_w: float
    next_m: float
    speed_mps: float
    force_n: float
    energy_to_go_j: float
    time_to_go_s: float


class LookUp:
    """Answers from the policies of a front, which was solved or read from a table."""

    def __init__(self, front: Front) -> None:
        section = front.section
        self._section, self._node_m = section, section.node_m[section.decision]
        self._arrays = (
            section.node_m, section.decision, *section.for_kernels, *section.bounds, *front.policies,
            section.train, section.loss_params,
        )  # fmt: skip

    def __call__(self, s_m: float, v_mps: float, time_left_s: float) -> Continuation:
        """The continuation from position `s_m` (m) and speed `v_mps` with `time_left_s` to the end of the section.

        Raises DasError for a state outside the section or a time that is not a number, InfeasibleError where the
        policies know no feasible continuation.
        """
        section = self._section
        check_state(section, s_m, v_mps)
        if math.isnan(time_left_s):
            raise DasError(f"time left {time_left_s} s: expected a number")
        code, price_w, k, speed_mps, force_n, energy_j, time_s = look_up(
            float(s_m), float(v_mps), float(time_left_s), *self._arrays
        )
        if code == STUCK:
            raise InfeasibleError(
                f"{section.route.source}: no feasible continuation is known from {s_m:.1f} m at {v_mps / KMH:.1f} km/h"
            )
        return Continuation(
            fit=_FITS[code],
            lambda_w=price_w,
            next_m=float(self._node_m[k]),
            speed_mps=speed_mps,
            force_n=force_n,
            energy_to_go_j=energy_j,
            time_to_go_s=time_s,
        )
