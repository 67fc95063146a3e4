"""Numba kernels for plans: they find modes, and read speed and force from a plan once a second."""

from __future__ import annotations

import math

from das.compiling import kernel


@kernel
def interval(nodes, x):
    """Index of the interval between nodes that contains x (x before the nodes: the first; beyond them: the last).

    It is written out because numba's `searchsorted` would load numba's linear algebra and with it scipy.
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
    """As np.interp, for a single number."""
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
def _is_among(values, one):
    """Whether an array contains a number."""
    found = False
    for value in values:
        found = found or value == one
    return found


@kernel
def without_ripples(modes, v, cruise, rolling, band):
    """Modes per interval; a stretch between two stretches of `cruise` becomes `cruise` as well if it hardly differs.

    It hardly differs if its speeds stay within `band` (m/s) of each other and only the modes `rolling` occur in it.
    """
    result = modes.copy()
    after = -1  # where the last stretch of cruising ended
    low = high = 0.0
    for i in range(modes.size):
        if modes[i] == cruise:
            if after >= 0 and high - low <= band:
                result[after:i] = cruise
            after, low, high = i + 1, v[i + 1], v[i + 1]
        elif _is_among(rolling, modes[i]):
            low, high = min(low, v[i + 1]), max(high, v[i + 1])
        else:
            after = -1
    return result


@kernel
def without_short(modes, t_s, brakes, least_s):
    """Modes per interval, where each mode that lasts less than `least_s` is replaced by the one before it.

    Modes replaced in a row last less than `least_s` together. Modes numbered `brakes` or higher are never replaced.
    """
    result = modes.copy()
    hidden_s = 0.0
    first = 0
    for last in range(1, modes.size + 1):
        if last < modes.size and modes[last] == modes[first]:
            continue
        hidden_s += t_s[last] - t_s[first]
        if first > 0 and modes[first] < brakes and hidden_s < least_s:
            result[first:last] = result[first - 1]
        else:
            hidden_s = 0.0
        first = last
    return result
