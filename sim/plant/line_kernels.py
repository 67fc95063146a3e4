"""Numba kernels that look the line up for the simulated train: means over it, weather, supply.

Symbols are those of `sim.plant.kernels`. The kernels check nothing.
"""

from __future__ import annotations

from das.compiling import kernel


@kernel
def _segment(starts, s):
    """Index of the last start not beyond s (0 before the first)."""
    low = 0
    high = starts.size
    while high - low > 1:
        middle = (low + high) // 2
        if starts[middle] <= s:
            low = middle
        else:
            high = middle
    return low


@kernel
def _integral(line, i, column, s):
    d = s - line.node_m[i]
    return line.profile[i, column + 2] + d * (line.profile[i, column] + 0.5 * d * line.profile[i, column + 1])


@kernel
def line_means(line, s, way):
    """Gradient (ratio), curve (m/s²) and tunnel (N/(m/s)²) means over the train and over the next `way` metres."""
    i = _segment(line.node_m, s)
    if way <= 0.0:
        d = s - line.node_m[i]
        q = line.profile[i]
        return q[0] + d * q[1], q[3] + d * q[4], q[6] + d * q[7]
    j = i
    while j + 1 < line.node_m.size and line.node_m[j + 1] <= s + way:
        j += 1
    end = s + way
    return (
        (_integral(line, j, 0, end) - _integral(line, i, 0, s)) / way,
        (_integral(line, j, 3, end) - _integral(line, i, 3, s)) / way,
        (_integral(line, j, 6, end) - _integral(line, i, 6, s)) / way,
    )


@kernel
def weather_at(line, s, t, length):
    """State of the rail (1 = dry) and head wind (m/s) on a train with its head at s: patches count by their share."""
    rail = 1.0
    wind = 0.0
    for k in range(line.weather.shape[0]):
        patch = line.weather[k]
        if not patch[2] <= t < patch[3]:
            continue
        if length > 0.0:
            share = max(min(s, patch[1]) - max(s - length, patch[0]), 0.0) / length
        else:
            share = 1.0 if patch[0] <= s < patch[1] else 0.0
        rail *= 1.0 - share * (1.0 - patch[4])
        wind += share * patch[5]
    return rail, wind


@kernel
def supply_at(line, s, way):
    """The least supply the head meets in the next `way` metres."""
    i = _segment(line.supply_start_m, s)
    least = line.supply[i]
    while i + 1 < line.supply.size and line.supply_start_m[i + 1] < s + way:
        i += 1
        least = min(least, line.supply[i])
    return least
