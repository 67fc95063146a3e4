"""A temporary speed restriction: its extent, its speed and its time window."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime, timedelta, tzinfo
from typing import Any

import numpy as np
from numpy.typing import NDArray

from das.domain.errors import InputError
from das.domain.units import KM, KMH, NS

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

LEAST_RESTRICTION_MPS = 0.5
"""Lowest speed (m/s) of a restriction that a train could pass."""
COUNTS_BEFORE_S = 900.0
"""Time (s) by which plans observe a restriction before its window opens. Every train brakes in less: from 500 km/h at
0.2 m/s² it takes 700 s, so the train is slow enough, or past the restriction, when the window opens."""
COUNTS_AFTER_S = 10.0
"""Time (s) after its window has closed until which plans observe a restriction: twice the clock correction (5 s) up to
which the node continues to advise."""
LONGEST_TEXT = 200
"""Longest text, name or id (characters) in a message; a message with a longer one is rejected as implausible."""
LATEST_NS = 2**63 - 1
"""The latest time (ns since 1970) that a message can contain."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, order=True)
class Restriction:
    """A temporary speed limit between two positions. It applies to the whole train, until its rear has left, from
    `valid_from_ns` to `valid_until_ns` (ns since 1970; 0: the window is open at that end). Raises InputError for an
    implausible value.

    A field with text for people does not affect plans: it is declared `field(default="", compare=False)`, and
    restrictions that differ only in their texts are equal.
    """

    start_m: float
    end_m: float
    limit_mps: float
    valid_from_ns: int = 0
    valid_until_ns: int = 0

    def __post_init__(self) -> None:
        # This form also rejects NaN.
        if not -math.inf < self.start_m < self.end_m < math.inf:
            shown = f"{self.start_m:g} … {self.end_m:g} m"
            raise InputError("restriction", "positions", shown, "a start before the end")
        if not LEAST_RESTRICTION_MPS <= self.limit_mps < math.inf:
            raise InputError("restriction", "limit_mps", self.limit_mps, f"at least {LEAST_RESTRICTION_MPS:g} m/s")
        for key, moment_ns in (("valid_from_ns", self.valid_from_ns), ("valid_until_ns", self.valid_until_ns)):
            if not 0 <= moment_ns <= LATEST_NS:
                raise InputError("restriction", key, moment_ns, "nanoseconds since 1970, or 0 for open")
        if not (self.valid_until_ns == 0 or self.valid_from_ns < self.valid_until_ns):
            raise InputError("restriction", "valid_until_ns", self.valid_until_ns, f"more than {self.valid_from_ns}")
        for key, text in self.texts.items():
            if len(text) > LONGEST_TEXT:
                raise InputError("restriction", key, text, f"at most {LONGEST_TEXT} letters")

    @property
    def figures(self) -> tuple[float, ...]:
        """The values of all fields except texts, in order: extent, speed and window."""
        return tuple(getattr(self, one.name) for one in fields(self) if one.compare)

    @property
    def texts(self) -> dict[str, str]:
        """The texts of the restriction by the names of their fields."""
        return {one.name: getattr(self, one.name) for one in fields(self) if not one.compare}

    @property
    def has_window(self) -> bool:
        """Whether the restriction has a start or end time."""
        return bool(self.valid_from_ns or self.valid_until_ns)

    @property
    def unlimited(self) -> Restriction:
        """The restriction without its window, for a caller that has decided that plans must observe it."""
        return replace(self, valid_from_ns=0, valid_until_ns=0) if self.has_window else self

    def holds_at(self, time_ns: int | Times) -> Any:
        """Whether the restriction is in force at each time (ns since 1970): `from ≤ time < until`."""
        return (time_ns >= self.valid_from_ns) & (time_ns < (self.valid_until_ns or LATEST_NS))

    def counts_at(self, now_ns: int) -> bool:
        """Whether a plan made now (ns since 1970) must observe the restriction, wherever the train is.

        Plans must do so from `COUNTS_BEFORE_S` before the window opens to `COUNTS_AFTER_S` after it has closed.
        """
        from_ns, until_ns = self.counting_ns
        return from_ns <= now_ns < until_ns

    @property
    def counting_ns(self) -> tuple[int, int]:
        """Start and end (ns since 1970) of the time in which plans observe the restriction; open: 0, `LATEST_NS`."""
        from_ns = self.valid_from_ns and max(self.valid_from_ns - round(COUNTS_BEFORE_S / NS), 0)
        until_ns = self.valid_until_ns and min(self.valid_until_ns + round(COUNTS_AFTER_S / NS), LATEST_NS)
        return from_ns, until_ns or LATEST_NS

    def is_under(self, from_m: float | Floats, to_m: float | Floats, length_m: float = 0.0) -> Any:
        """Whether the restriction is under a train of a length (m) with its head anywhere between two positions (m)."""
        return (to_m > self.start_m) & (from_m < self.end_m + length_m)

    @property
    def words(self) -> str:
        """The restriction as text, for example "80 km/h, km 20.00 to 22.00 from 08:10:00 until 08:20:00 UTC"."""
        return self.words_in(UTC)

    def words_in(self, zone: tzinfo) -> str:
        """The restriction as text, with times of day in a time zone."""
        ends = (("from", self.valid_from_ns), ("until", self.valid_until_ns))
        window = "".join(f" {word} {_clock(moment_ns, zone)}" for word, moment_ns in ends if moment_ns)
        place = f"km {self.start_m / KM:.2f} to {self.end_m / KM:.2f}"
        return f"{self.limit_mps / KMH:.4g} km/h, {place}{window}{f' {zone}' if window else ''}"


def _clock(moment_ns: int, zone: tzinfo) -> str:
    return (_EPOCH + timedelta(microseconds=moment_ns // 1000)).astimezone(zone).strftime("%H:%M:%S")
