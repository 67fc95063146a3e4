"""The backward sweep: least cost and time-to-go of every state under every multiplier."""

from __future__ import annotations

from das.compiling import kernel
from das.solver.kernels.lanes import LANES, NodeRows, relaxation

_TWO_VECTORS = 2 * LANES
_relax_two, _relax_one, _relax_some = relaxation(2), relaxation(1), relaxation(1, partly=True)


@kernel
def backward_sweep(first, last, lam, moves, value, time_to_go):
    """Bellman sweep of the multipliers lam[first … last − 1] at once: value (J) and time-to-go (s) of every state.

    value[k, j, l] = min over landings of energy + lam·dt + value at the landing (linear in v²). Row k = n of both
    outputs must hold the end values; the other rows are filled.
    """
    n, states = moves.filled.shape
    for k in range(n - 1, -1, -1):
        ahead, here = NodeRows(value[k + 1], time_to_go[k + 1]), NodeRows(value[k], time_to_go[k])
        for j in range(states):
            l = first
            while last - l >= _TWO_VECTORS:
                _relax_two(moves, (k, j, l, last), lam, ahead, here)
                l += _TWO_VECTORS
            if last - l >= LANES:
                _relax_one(moves, (k, j, l, last), lam, ahead, here)
                l += LANES
            if l < last:
                _relax_some(moves, (k, j, l, last), lam, ahead, here)
