"""What the driver was shown and what the controller was set to, at any time of a recorded drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice.advice import Source
from das.advice.modes import Mode
from das.bus import topics
from das.bus.recording import Recording
from sim.drivers.presentations.presenter import SpeedIs, presenter_of, shown_presentation
from sim.recording.metadata import WHAT_IF, WhatIfKind

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

VALID_NS = 3_000_000_000
"""A message about the cab counts for this long (ns)."""


class Seen(NamedTuple):
    """Advice that a driver saw: mode, speed (m/s), effort as a share of the largest (NaN: none), and what was set.

    `top_only`: the speed is the highest to drive, and nothing else is advised.
    """

    mode: Mode
    speed_mps: float
    advised_ratio: float
    lever_ratio: float
    top_only: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownAdvice:
    """The advice shown over a drive, arrays of shape (messages,); `shown` is False where nothing was.

    `speed_now` tells whether the speed is the one to have at this moment, and not one to reach later.
    """

    time_ns: Times
    shown: NDArray[np.bool_]
    mode: NDArray[np.int64]
    speed_mps: Floats
    advised_ratio: Floats
    lever_ratio: Floats
    top_only: NDArray[np.bool_]
    speed_now: NDArray[np.bool_]

    @classmethod
    def of(cls, recording: Recording) -> ShownAdvice:
        """What the display showed; where no display was recorded, the node's advice counts as shown.

        Nobody saw the advice of a replay or of a what-if in open loop: the train drives as it was driven.
        """
        run = recording.metadata.get("run", {})
        unseen = run.get("kind") == "replay" or run.get(WHAT_IF) == WhatIfKind.OPEN_LOOP
        fields = ("presentation", "mode", "advised_speed_mps", "advised_lever_ratio", "lever_ratio")
        cab = recording.columns(topics.CAB, "time_ns", *fields)
        if len(cab["time_ns"]) and not unseen:
            speed_is = np.array([_speed_is(*one) for one in zip(cab["presentation"], cab["mode"], strict=True)])
            return cls(
                time_ns=cab["time_ns"],
                shown=cab["presentation"] > 0,
                mode=cab["mode"],
                speed_mps=cab["advised_speed_mps"],
                advised_ratio=cab["advised_lever_ratio"],
                lever_ratio=cab["lever_ratio"],
                top_only=speed_is == SpeedIs.HIGHEST,
                speed_now=speed_is == SpeedIs.TO_HAVE,
            )
        said = ("source", "mode", "advised_speed_mps", "advised_force_ratio")
        advice = recording.columns(topics.ADVICE, "time_ns", *said)
        nothing = np.full(len(advice["time_ns"]), math.nan)
        return cls(
            time_ns=advice["time_ns"],
            shown=(advice["source"] != Source.NONE) & (not unseen),
            mode=advice["mode"],
            speed_mps=advice["advised_speed_mps"],
            advised_ratio=advice["advised_force_ratio"],
            lever_ratio=nothing,
            top_only=np.zeros(len(nothing), dtype=bool),
            speed_now=np.ones(len(nothing), dtype=bool),
        )

    def at(self, time_ns: int) -> Seen | None:
        """What the driver saw at a time; None for nothing."""
        last = int(np.searchsorted(self.time_ns, time_ns, side="right")) - 1
        if last < 0 or not self.shown[last] or time_ns - int(self.time_ns[last]) > VALID_NS:
            return None
        number = int(self.mode[last])
        return Seen(
            mode=Mode(number) if number in set(Mode) else Mode.NONE,
            speed_mps=float(self.speed_mps[last]),
            advised_ratio=float(self.advised_ratio[last]),
            lever_ratio=float(self.lever_ratio[last]),
            top_only=bool(self.top_only[last]),
        )

    @property
    def comparable(self) -> NDArray[np.bool_]:
        """Where a speed was shown that the driven speed can be compared with: to have now, or not to exceed."""
        return self.shown & (self.speed_mps > 0) & (self.speed_now | self.top_only)

    @property
    def any_shown(self) -> bool:
        """Whether anything was shown at all."""
        return bool(self.shown.any())


def _speed_is(number: int, mode: int) -> SpeedIs:
    """What a speed on the display was; of a presentation that is not known, only a speed to hold is one to have."""
    presentation = shown_presentation(number)
    if presentation is None:
        return SpeedIs.TO_HAVE if mode == Mode.CRUISE else SpeedIs.TO_REACH
    return presenter_of(presentation).speed_is(mode)
