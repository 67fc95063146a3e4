"""Trajectories as CSV: one row a node, forces hold from it to the next (format: docs/reference/file-formats.md)."""

from __future__ import annotations

from pathlib import Path

from das.domain.files.writing import write_whole
from das.domain.trajectory import Trajectory


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory's columns (see `Trajectory.columns`) to a CSV file; DasError where that fails."""
    columns = trajectory.columns()
    lines = [",".join(columns)]
    lines += [",".join(f"{x + 0.0:.12g}" for x in row) for row in zip(*columns.values(), strict=True)]
    write_whole(path, ("\n".join(lines) + "\n").encode())
