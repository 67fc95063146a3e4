"""Copying and adding arrays in kernels.

Numba compiles `into[:] = values` and `into += share * values` as well. But both check that the shapes fit, and numba
then compiles some 30 functions that write the message of the error, again in every kernel that Python calls.
"""

from __future__ import annotations

from das.compiling import kernel


@kernel
def put(values, into):
    """Write the numbers of an array to the beginning of another one."""
    for i in range(values.size):
        into[i] = values[i]


@kernel
def add(share, values, into):
    """Add `share` times the numbers of an array to the first ones of another array."""
    for i in range(values.size):
        into[i] += share * values[i]
