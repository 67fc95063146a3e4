"""Numba kernels for plans: they find modes, and read speed and force from a plan once a second."""

from __future__ import annotations

import math

from das.advice.regimes import Regime
from das.compiling import kernel
from das.solver.kernels.forces import brake_limit, electric_limit, mean_resistance, on_supply

_REDUCED_TRACTION, _CRUISE, _COAST = int(Regime.REDUCED_TRACTION), int(Regime.CRUISE), int(Regime.COAST)
_LEAST_BRAKE = int(Regime.REDUCED_BRAKE)


@kernel
def interval(nodes, x):
    """Index of the interval between nodes that contains x (x before the nodes: the first; beyond them: the last).

    The search is written out because numba's `searchsorted` would load numba's linear algebra and with it scipy.
    """
    low, high = 0, nodes.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@kernel
def linear(nodes, values, x):
    """Linear interpolation of a single number, as by np.interp."""
    i = interval(nodes, x)
    share = min(max((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0), 1.0)
    return values[i] + (values[i + 1] - values[i]) * share


@kernel
def allowed(nodes, envelope_w, limit, s):
    """The highest speed (m/s) at position s from which the limits and the stop can still be kept."""
    return min(math.sqrt(linear(nodes, envelope_w, s)), limit[interval(nodes, s)])


@kernel
def place(s, s_m, t_s, v, w):
    """Interval of a trajectory that contains a position, speed there (v² is linear in it) and time since the start."""
    i = interval(s_m, s)
    way = min(max(s - s_m[i], 0.0), s_m[i + 1] - s_m[i])
    speed = math.sqrt(w[i] + (w[i + 1] - w[i]) * way / (s_m[i + 1] - s_m[i]))
    mean = 0.5 * (v[i] + speed)
    return i, speed, t_s[i] + (way / mean if mean > 0.0 else 0.0)


@kernel
def horizon(here_s, s_m, t_s, v, force, nodes, envelope_w, limit, speeds, forces):
    """Fill in speed and force of a trajectory 1, 2, … s after `here_s`; limits and the stop bound each speed."""
    for n in range(speeds.size):
        at_s = here_s + n + 1.0
        i = interval(t_s, at_s)
        into = min(at_s - t_s[i], t_s[i + 1] - t_s[i])
        share = into / (t_s[i + 1] - t_s[i]) if into > 0.0 else 0.0
        speed = v[i] + (v[i + 1] - v[i]) * share
        there = s_m[i] + into * 0.5 * (v[i] + speed)
        speeds[n] = min(speed, allowed(nodes, envelope_w, limit, there))
        forces[n] = force[i] if at_s < t_s[-1] else 0.0


@kernel
def without_ripples(modes, v, band):
    """Modes per interval; a stretch between two stretches of cruising becomes cruising as well if it hardly differs.

    Hardly: the speeds stay within `band` (m/s) of each other, and the train only coasts or has reduced traction.
    """
    result = modes.copy()
    after = -1  # where the last stretch of cruising ended
    low = high = 0.0
    for i in range(modes.size):
        if modes[i] == _CRUISE:
            if after >= 0 and high - low <= band:
                result[after:i] = _CRUISE
            after, low, high = i + 1, v[i + 1], v[i + 1]
        elif modes[i] == _REDUCED_TRACTION or modes[i] == _COAST:
            low, high = min(low, v[i + 1]), max(high, v[i + 1])
        else:
            after = -1
    return result


@kernel
def without_short(modes, t_s, least_s):
    """Modes per interval; each mode other than braking that lasts less than `least_s` becomes the one before it.

    Consecutive replaced modes last less than `least_s` in total.
    """
    result = modes.copy()
    hidden_s = 0.0
    first = 0
    for last in range(1, modes.size + 1):
        if last < modes.size and modes[last] == modes[first]:
            continue
        hidden_s += t_s[last] - t_s[first]
        if first > 0 and modes[first] < _LEAST_BRAKE and hidden_s < least_s:
            result[first:last] = result[first - 1]
        else:
            hidden_s = 0.0
        first = last
    return result


@kernel
def rolling(s, v_w, braked, nodes, line, p, speeds):
    """Fill in the speeds at the nodes ahead of a train at s with v² = v_w that coasts, or brakes with a force (N).

    At first they hold its present speed, for its resistance; a second pass takes the resistance at the speeds found.
    """
    step, g, q, _ = line
    here = nodes.size - 1 - speeds.size
    for _ in range(2):
        lost = 0.0
        for k in range(speeds.size):
            i = here + k
            running = p.c0_n + p.c1_n_per_mps * speeds[k] + (p.c2_n_per_mps2 + q[i]) * (speeds[k] * speeds[k])
            lost += (running + g[i] + braked) * (step[i] if k > 0 else nodes[i + 1] - s)
            speeds[k] = math.sqrt(max(v_w - 2.0 * lost / p.inertial_mass_kg, 0.0))


@kernel
def meets_curve(above, slack, speeds, envelope, envelope_w):
    """The first node ahead at which speeds, lowered by `above`, are beyond the braking curve that they cross; else -1.

    They cross it where they exceed it by more than `slack`.
    """
    first, below = envelope.size - speeds.size, -1
    for k in range(speeds.size):
        speed = max(speeds[k] - above, 0.0)
        if envelope[first + k] < speed - slack:
            return below + 1
        if envelope_w[first + k] >= speed * speed:
            below = k
    return -1


@kernel
def passed_after(s, v, speeds, nodes, to):
    """The time (s) after which a train at s with speed v, and with `speeds` at the nodes ahead, passes a place."""
    at, before, elapsed = s, v, 0.0
    for k in range(speeds.size):
        if to <= at:
            return elapsed
        end = nodes[nodes.size - speeds.size + k]
        later = elapsed + 2.0 * (end - at) / max(speeds[k] + before, 0.1)
        if to < end:
            return (later - elapsed) / (end - at) * (to - at) + elapsed
        at, before, elapsed = end, speeds[k], later
    return elapsed


STEPS = 2
"""Iterations that find the speed at the end of an interval."""
TRIES, NEAR_W = 14, 0.02
"""The search for an effort takes at most `TRIES` steps, and ends when v² is met to within `NEAR_W` (m²/s²); on average
it takes three."""


@kernel
def full_effort(v, p):
    """The braking force (N) of effort 1 at a speed: of the motors, or of all brakes if the motors do not brake."""
    electric = electric_limit(v, p)
    if electric > 0.0 and not p.brakes_dissipate:
        return electric
    return brake_limit(v, p, p.friction_force_n)


@kernel
def most_braked(v, u, p):
    """The force (N) of all brakes of the train together at a speed, on a stretch with supply u."""
    return brake_limit(v, on_supply(p, u), p.friction_force_n)


@kernel
def largest_effort(v, u, p):
    """The effort of all brakes of the train together at a speed, on a stretch with supply u; 0 if there are none."""
    full = full_effort(v, p)
    return most_braked(v, u, p) / full if full > 0.0 else 0.0


@kernel
def braked(effort, v, u, p):
    """The force (N) of a braking effort at a speed on a stretch with supply u, at most that of all brakes."""
    return min(effort * full_effort(v, p), most_braked(v, u, p))


@kernel
def _braked_w(effort, w0, h, g, q, p, here):
    """v² (m²/s²) at the end of an interval in which the train brakes with an effort; < 0 if it stops before the end."""
    v0 = math.sqrt(w0)
    v1, w1 = v0, w0
    for _ in range(STEPS):
        faster = max(v0, v1)
        force = min(effort * full_effort(faster, p), brake_limit(faster, here, here.friction_force_n))
        held = (mean_resistance(v0, v1, q, here) + g) / p.inertial_mass_kg
        rate = max(min(force / p.inertial_mass_kg + held, p.max_deceleration_mps2), held)
        w1 = w0 - 2.0 * h * rate
        v1 = math.sqrt(max(w1, 0.0))
    return w1


@kernel
def left_over_w(effort, s, v, first, last, to_m, nodes, line, p):
    """v² (m²/s²) that is left at `to_m` if a train with speed v at s brakes from there with an effort.

    `first` and `last` are the intervals of s and of `to_m`. A result below 0 means that the train stops before `to_m`:
    v² is extrapolated beyond the stop.
    """
    _, g, q, u = line
    w = v * v
    at = s
    for i in range(first, last + 1):
        end = nodes[i + 1] if i < last else to_m
        h = end - at
        if h <= 0.0:
            continue
        before_w, w = w, _braked_w(effort, w, h, g[i], q[i], p, on_supply(p, u[i]))
        if w < 0.0:
            return w - (before_w - w) / h * (to_m - end)
        at = end
    return w


@kernel
def needed_effort(s, v, first, last, to_m, target, nodes, line, p):
    """The least effort that slows a train at s with speed v to `target` (m/s) at `to_m`; the largest if none does.

    v² at `to_m` is met to within `NEAR_W`, and is not above the wanted one.
    """
    aimed_w = target * target - 0.5 * NEAR_W
    low, low_w = 0.0, left_over_w(0.0, s, v, first, last, to_m, nodes, line, p) - aimed_w
    most = largest_effort(v, 1.0, p)
    if low_w <= 0.5 * NEAR_W or most <= 0.0:
        return 0.0
    # First guess: the effort that removes the surplus energy, at the mean speed. Then secant steps, a little too far,
    # until the last two efforts enclose the solution; then false position (Illinois).
    effort = p.inertial_mass_kg * low_w / (2.0 * (to_m - s)) / full_effort(max(0.5 * (v + target), 0.1), p)
    high, high_w, side = math.inf, 0.0, 0
    for _ in range(TRIES):
        effort = min(effort, most)
        found_w = left_over_w(effort, s, v, first, last, to_m, nodes, line, p) - aimed_w
        if abs(found_w) <= 0.5 * NEAR_W:
            return effort
        if found_w > 0.0:
            if effort == most:
                return most
            slope_w = (low_w - found_w) / (effort - low)
            low, low_w = effort, found_w
            high_w *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            high, high_w = effort, found_w
            low_w *= 0.5 if side < 0 else 1.0
            side = -1
        if high < math.inf:
            effort = low + (high - low) * low_w / (low_w - high_w)
        else:
            effort = low + 1.05 * low_w / slope_w if slope_w > 0.0 else most
    return min(high, most)


@kernel
def lowest_w(s, to_m, nodes, envelope_w):
    """The least v² (m²/s²) of an envelope from position s to `to_m`; 0 if `to_m` is not before the last node."""
    if to_m >= nodes[nodes.size - 1]:
        return 0.0
    least = linear(nodes, envelope_w, s)
    i = interval(nodes, s) + 1
    while nodes[i] < to_m:
        least = min(least, envelope_w[i])
        i += 1
    return min(least, linear(nodes, envelope_w, to_m))
