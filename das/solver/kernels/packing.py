"""Packing the policies of decision nodes: values in single precision, times-to-go as steps of 16 bits."""

from __future__ import annotations

import numpy as np

from das.compiling import kernel
from das.solver.tolerances import INFEASIBLE, UNREACHABLE

UNKNOWN_STEP = 65535
"""The time-to-go of a state from which the section cannot be finished; the longest one of a node is a step less."""

_LEAST_STEP_S = np.finfo(np.float32).tiny


@kernel
def pack(first, last, value, time_to_go, packed_value, packed_times):
    """Pack the rows first … last − 1 of values (J) and times-to-go (s): (nodes, speeds, L) into arrays of that shape.

    Of each node and multiplier the times lie between the shortest one and 65534 equal steps above it.
    """
    steps, low_s, step_s = packed_times
    _, states, size = value.shape
    low, high = np.empty(size), np.empty(size)
    for k in range(first, last):
        low[:], high[:] = INFEASIBLE, -INFEASIBLE
        for j in range(states):
            for l in range(size):
                time_s = time_to_go[k, j, l]
                known = value[k, j, l] < UNREACHABLE
                low[l] = time_s if known and time_s < low[l] else low[l]
                high[l] = time_s if known and time_s > high[l] else high[l]
        for l in range(size):
            if high[l] < low[l]:
                low[l], high[l] = 0.0, 0.0
            low_s[k, l] = low[l]
            step_s[k, l] = (high[l] - low[l]) / (UNKNOWN_STEP - 1)
            high[l] = max(step_s[k, l], _LEAST_STEP_S)
        for j in range(states):
            for l in range(size):
                part = np.rint((time_to_go[k, j, l] - low[l]) / high[l])
                known = value[k, j, l] < UNREACHABLE
                steps[k, j, l] = np.uint16(min(part, UNKNOWN_STEP - 1.0) if known else UNKNOWN_STEP)
                packed_value[k, j, l] = value[k, j, l]
