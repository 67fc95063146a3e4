"""Trajectories as CSV: one row a node, forces hold from it to the next (format: docs/reference/file-formats.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from das.domain.files.writing import write_whole
from das.domain.trajectory import Trajectory

COLUMNS = ("s_m", "t_s", "v_mps", "force_el_n", "force_friction_n", "grade_ratio", "limit_mps")


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory; the last row has no forces and repeats the gradient and limit before it."""
    per_interval = (
        (trajectory.force_el_n, 0.0),
        (trajectory.force_friction_n, 0.0),
        (trajectory.grade_ratio, trajectory.grade_ratio[-1]),
        (trajectory.limit_mps, trajectory.limit_mps[-1]),
    )
    columns = [trajectory.s_m, trajectory.t_s, trajectory.v_mps, *(np.append(a, last) for a, last in per_interval)]
    lines = [",".join(COLUMNS)]
    lines += [",".join(f"{x + 0.0:.12g}" for x in row) for row in zip(*columns, strict=True)]
    write_whole(path, ("\n".join(lines) + "\n").encode())
