"""The format of a table on disk (docs/reference/tables.md): its files, its arrays and how they are packed.

A table is a folder with `manifest.json` and plain `.npy` arrays. The policies of a front are packed: values as 32-bit
numbers, times-to-go as 16-bit steps between the least and the greatest of each node and multiplier.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import DasError
from das.solver.front import Front
from das.solver.kernels.policy_values import pack
from das.solver.kernels.tuples import PackedTimes
from das.solver.section import Section

Floats = NDArray[np.float64]

Arrays = dict[str, NDArray[Any]]

SCHEMA_VERSION: Final = 3
MANIFEST: Final = "manifest.json"
_SEAL = b',\n "manifest_sha256": "'


class TableError(DasError):
    """A table cannot be used; the message says why."""


@dataclass(frozen=True, kw_only=True)
class ArrayFormat:
    """An array of a table: its type, its axes (a name of `Sizes`, or a number), and what it holds."""

    kind: str
    axes: tuple[str | int, ...]
    meaning: str

    def shape(self, sizes: Sizes) -> tuple[int, ...]:
        """The lengths of the array's axes."""
        return tuple(axis if isinstance(axis, int) else getattr(sizes, axis) for axis in self.axes)

    def size_bytes(self, sizes: Sizes) -> int:
        """The size of the array's file (bytes): the header and the numbers."""
        return len(self.header(sizes)) + math.prod(self.shape(sizes)) * np.dtype(self.kind).itemsize

    def header(self, sizes: Sizes) -> bytes:
        """The header of the array's file, as `numpy.save` writes it."""
        file = io.BytesIO()
        facts = {"descr": self.kind, "fortran_order": False, "shape": self.shape(sizes)}
        np.lib.format.write_array_header_1_0(file, facts)
        return file.getvalue()


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """The lengths of all axes of a table's arrays.

    `points` is the number of integration nodes, `intervals` the number of steps between them.
    """

    nodes: int
    speeds: int
    multipliers: int
    points: int
    runs: int

    @property
    def intervals(self) -> int:
        return self.points - 1


_POLICY = ("nodes", "speeds", "multipliers")
ARRAYS: Final[Mapping[str, ArrayFormat]] = {
    "value_j": ArrayFormat(
        kind="<f4", axes=_POLICY, meaning="least cost energy + λ·time to the end [decision node, speed, λ], J"
    ),
    "time_to_go_steps": ArrayFormat(
        kind="<u2",
        axes=_POLICY,
        meaning="time to the end [decision node, speed, λ], in steps of time_to_go_scale_s",
    ),
    "time_to_go_scale_s": ArrayFormat(
        kind="<f4",
        axes=(2, "nodes", "multipliers"),
        meaning="[least time, time of a step; decision node; λ], s",
    ),
    "grid": ArrayFormat(
        kind="<f8",
        axes=(3, "nodes"),
        meaning="[position (m), slowest speed, braking envelope (m/s); decision node]",
    ),
    "run_s_m": ArrayFormat(kind="<f8", axes=("points",), meaning="route position [integration node], m"),
    "run_v_mps": ArrayFormat(kind="<f8", axes=("runs", "points"), meaning="speed [trajectory, integration node], m/s"),
    "run_t_s": ArrayFormat(kind="<f4", axes=("runs", "points"), meaning="time [trajectory, integration node], s"),
    "run_force_el_n": ArrayFormat(
        kind="<f4",
        axes=("runs", "intervals"),
        meaning="traction > 0, electric brake < 0 [trajectory, interval], N",
    ),
    "run_force_friction_n": ArrayFormat(
        kind="<f4", axes=("runs", "intervals"), meaning="friction brake <= 0 [trajectory, interval], N"
    ),
}
"""Every array of a table, by the name of its file."""


def grid_of(section: Section) -> Floats:
    """The decision grid of a section: position (m), slowest speed and braking envelope (m/s) of each node, (3, K)."""
    nodes = section.decision
    return np.stack((section.node_m[nodes], section.floor_mps[nodes], section.envelope_mps[nodes]))


def section_facts(section: Section) -> dict[str, Any]:
    """Facts by which people recognise a section; only the hashes decide whether two sections are the same."""
    places = {round(stop.position_m, 3): stop.name for stop in section.route.stops}
    return {
        "route": section.route.id,
        "from": places.get(round(section.start_m, 3)),
        "to": places.get(round(section.end_m, 3)),
        "start_m": section.start_m,
        "end_m": section.end_m,
        "start_speed_mps": section.start_speed_mps,
        "end_speed_mps": section.end_speed_mps,
        "train": section.vehicle.id,
        "mass_kg": section.vehicle.mass_kg,
        "length_m": section.train_length_m,
        "level": str(section.level),
    }


def packed(front: Front) -> Arrays:
    """The policies of a solved front, as the arrays of a table hold them."""
    value, times = front.value_j, front.time_to_go_s
    if not isinstance(times, PackedTimes):
        nodes, _, size = value.shape
        value = np.empty(front.value_j.shape, np.float32)
        scale = np.empty((2, nodes, size), np.float32)
        packed_times = PackedTimes(np.empty(value.shape, np.uint16), *scale)
        pack(0, nodes, front.value_j, times, value, packed_times)
        times = packed_times
    return {
        "value_j": value,
        "time_to_go_steps": times.steps,
        "time_to_go_scale_s": np.stack((times.low_s, times.step_s)),
        "grid": grid_of(front.section),
    }


def unpacked(section: Section, lambda_w: Floats, arrays: Mapping[str, NDArray[Any]]) -> Front:
    """The front of a section from the arrays of its table; nothing is copied."""
    low_s, step_s = arrays["time_to_go_scale_s"]
    return Front(
        section=section,
        lambda_w=lambda_w,
        value_j=arrays["value_j"],
        time_to_go_s=PackedTimes(arrays["time_to_go_steps"], low_s, step_s),
    )


def sealed(manifest: Mapping[str, Any]) -> bytes:
    """A manifest as JSON; its last key is the hash of all bytes before it."""
    body = json.dumps(manifest, ensure_ascii=False, allow_nan=False, indent=1).encode()[: -len("\n}")]
    return body + _SEAL + hashlib.sha256(body).hexdigest().encode() + b'"\n}\n'


def seal_of(content: bytes) -> str:
    """The hash that the last key of a manifest must hold."""
    return hashlib.sha256(content.rpartition(_SEAL)[0]).hexdigest()


def read_regular(path: Path, most_bytes: int) -> bytes:
    """The content of a file, which is opened without waiting, so that a pipe does not block the reader.

    Raises FileNotFoundError if there is no such file, and TableError if it is not a regular file, is larger than
    `most_bytes` or cannot be read.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(path) from None
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise TableError(f"{path}: is not a regular file")
        if status.st_size > most_bytes:
            raise TableError(f"{path}: {status.st_size} bytes, expected at most {most_bytes}")
        with open(handle, "rb", closefd=False) as file:
            return file.read(status.st_size)
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror})") from error
    finally:
        os.close(handle)


def regular_size_bytes(path: Path) -> int:
    """The size of a regular file; raises as `read_regular` does."""
    try:
        status = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(path) from None
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror})") from error
    if not stat.S_ISREG(status.st_mode):
        raise TableError(f"{path}: is not a regular file")
    return status.st_size
