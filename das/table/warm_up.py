"""Compile what answers from a table before time matters."""

from __future__ import annotations

import numpy as np

from das.solver.section import build_section
from das.solver.solve import solve_front
from das.solver.warm_up import tiny_route, tiny_vehicle
from das.table.format import ARRAYS, packed, unpacked


def warm_up() -> None:
    """Compile (or load from the cache) what answers from the arrays of a table; some 6 s the first time."""
    section = build_section(tiny_route(), tiny_vehicle())
    front = solve_front(section, lambda_w=np.array([0.0, 1e4, 1e5, 1e6]))
    read = {  # read-only, as the arrays of a file are
        name: np.frombuffer(array.tobytes(), ARRAYS[name].kind).reshape(array.shape)
        for name, array in packed(front).items()
    }
    stored, least_time_s = unpacked(section, front.lambda_w, read), front.fastest().time_s
    for buffer_ratio in (0.01, 0.1, 0.3):
        stored.trajectory(least_time_s * (1 + buffer_ratio))
