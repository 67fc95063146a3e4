"""Copying and adding arrays in kernels.

Numba also compiles `into[:] = values` and `into += share * values`. But both check the shapes; for this, numba compiles
about 30 functions for error messages in every kernel called from Python.
"""

from __future__ import annotations

from das.compiling import kernel


@kernel
def put(values, into):
    """Copy an array to the beginning of another one."""
    for i in range(values.size):
        into[i] = values[i]


@kernel
def add(share, values, into):
    """Add `share` times an array to the beginning of another one."""
    for i in range(values.size):
        into[i] += share * values[i]
