"""What the cab says: plain frozen values. The node turns them into messages; a simulation takes them as they are."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from das.advice.advice import Advice
from das.advice.cause import Cause
from das.advice.plan import Plan


class Severity(IntEnum):
    """How bad an event is; the numbers are those of the log message on the bus."""

    INFO = 2
    WARNING = 3
    ERROR = 4


class NodeState(IntEnum):
    """How the on-board system is; the numbers are those of the bus message."""

    STARTING = 0
    WAITING = 1
    """No journey has been heard yet."""
    READY = 2
    """There is a journey, but no position yet."""
    ADVISING = 3
    WITHDRAWN = 4
    """There is no advice; cause and reason say why."""
    STOPPING = 5


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened, for people to read."""

    time_ns: int
    severity: Severity
    text: str


@dataclass(frozen=True, kw_only=True)
class Status:
    """How the on-board system is; `solve_s` and `last_advice_s` are what the last ones took by the stopwatch (s)."""

    time_ns: int
    state: NodeState
    reason: str = ""
    cause: Cause = Cause.NONE
    section: str = ""
    solve_s: float = 0.0
    last_advice_s: float = 0.0
    advices: int = 0


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """Mass and running resistance as found while driving, as ratios of the planned train's, with deviations."""

    time_ns: int
    mass_ratio: float
    mass_sd_ratio: float
    resistance_ratio: float
    resistance_sd_ratio: float
    samples: int
    usable: bool
    differs: bool
    doubt: str = ""
    """Why the measured forces are not trusted, or `far-mass`: they are, but the mass is strange; nothing: neither."""


Output = Advice | Status | Plan | Estimated | Event
