"""A record of a trip as its file tells it: points in the order of the file, not judged yet."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from das.domain.route import Floats
from das.domain.units import NS

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """Points of a record; arrays of shape (points,), NaN where the file does not tell a value.

    `number` is the place of a point in its file, counted in `place`s (lines, positions). Positions are either on the
    map or on the route; on the route, `position_m` counts as in the route's file, or in the direction driven if
    `as_driven`. In a recording of ours, a point may be `degraded` (its speed was not measured) or `invalid` (nothing
    was). `unread` are the names of columns that were not used.
    """

    source: str
    place: str = "line"
    number: Ints
    time_ns: Ints
    latitude_deg: Floats
    longitude_deg: Floats
    position_m: Floats
    speed_mps: Floats
    uncertainty_m: Floats
    degraded: Bools
    invalid: Bools
    as_driven: bool = False
    unread: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self._arrays():
            getattr(self, name).setflags(write=False)

    @classmethod
    def of(cls, source: str, number: Ints, time_ns: Ints, **known: Any) -> Self:
        """Make a record of which only some columns are known."""
        count = len(time_ns)
        for name in ("latitude_deg", "longitude_deg", "position_m", "speed_mps", "uncertainty_m"):
            known.setdefault(name, np.full(count, np.nan))
        for name in ("degraded", "invalid"):
            known.setdefault(name, np.zeros(count, dtype=bool))
        return cls(source=source, number=number, time_ns=time_ns, **known)

    @property
    def on_route(self) -> bool:
        """Whether its positions are on the route already."""
        return bool(np.isfinite(self.position_m).any())

    def __len__(self) -> int:
        return len(self.time_ns)

    def elapsed_s(self) -> Floats:
        """Time since the first point (s)."""
        return np.asarray((self.time_ns - self.time_ns[0]) * NS, dtype=np.float64)

    def take(self, which: Any) -> Self:
        """Some of its points, by mask, slice or indices."""
        return replace(self, **{name: getattr(self, name)[which].copy() for name in self._arrays()})

    def driven(self, reverse: bool, route_length_m: float) -> Self:
        """The same record with positions in the direction driven."""
        if self.as_driven or not reverse:
            return replace(self, as_driven=True)
        return replace(self, position_m=route_length_m - self.position_m, as_driven=True)

    def where(self, point: int) -> str:
        """The place of a point in its file: "line 3"."""
        return f"{self.place} {self.number[point]}"

    def _arrays(self) -> list[str]:
        return [f.name for f in fields(self) if isinstance(getattr(self, f.name), np.ndarray)]
