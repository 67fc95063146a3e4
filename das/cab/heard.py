"""The messages that the cab receives, as frozen values. The bus's codec makes them, and so may a simulation.

`heard_ns` is the clock at reception (ns since 1970; 0: no clock yet), `source` the session that sent the message.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, Final, NamedTuple

from das.domain.journey import OrderedStop
from das.domain.restriction import Restriction
from das.estimate.estimate import Effort, PositionFix

UNSTAMPED: Final = "a sender without time stamps"
"""The source of any message without its sender's time stamp, because such senders cannot be distinguished."""


class Kind(StrEnum):
    """The kinds of messages; their names are those of the bus's topics."""

    POSITION = "position"
    DELAY = "delay"
    EFFORT = "effort"
    JOURNEY = "journey"
    RESTRICTION = "restriction"
    TARGET = "target"


STATES = (Kind.JOURNEY, Kind.RESTRICTION, Kind.TARGET)
"""Kinds whose message applies until the next one; older ones never replace newer ones, and one publisher counts."""


class ToldRestriction(Restriction):
    """A restriction as received, before the guard has checked it, with any figures."""

    def __post_init__(self) -> None:
        """Accept any figures: the guard checks them."""


def judged(received: Restriction) -> Restriction:
    """A received restriction with its figures checked; raises InputError if they are impossible."""
    return Restriction(**vars(received))


class Target(NamedTuple):
    """A target of traffic management: a new arrival at a stop, or a window for a point to pass (ns; 0: open)."""

    stop: str = ""
    s_m: float = 0.0
    arrival_ns: int = 0
    earliest_ns: int = 0
    latest_ns: int = 0
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Heard:
    """A message that was received."""

    kind: ClassVar[Kind]
    heard_ns: int = 0
    source: str = ""


@dataclass(frozen=True, kw_only=True)
class PositionHeard(Heard):
    """The position and speed of the train as its sensors measure them."""

    kind: ClassVar[Kind] = Kind.POSITION
    fix: PositionFix


@dataclass(frozen=True, kw_only=True)
class DelayHeard(Heard):
    """The delay that the operator stated (s; late > 0) at `time_ns`."""

    kind: ClassVar[Kind] = Kind.DELAY
    delay_s: float
    time_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class EffortHeard(Heard):
    """The wheel forces, as the train measures them."""

    kind: ClassVar[Kind] = Kind.EFFORT
    effort: Effort


@dataclass(frozen=True, kw_only=True)
class StateHeard(Heard):
    """A message that applies until the next of its kind; `time_ns` is when it was sent."""

    time_ns: int


@dataclass(frozen=True, kw_only=True)
class JourneyHeard(StateHeard):
    """The journey that the train has to make; an empty text stands for the value that the cab was started with."""

    kind: ClassVar[Kind] = Kind.JOURNEY
    route_id: str
    vehicle_id: str
    stops: tuple[OrderedStop, ...]
    train: str = ""
    reversed: bool = False
    load: str = ""
    level: str = ""


@dataclass(frozen=True, kw_only=True)
class RestrictionsHeard(StateHeard):
    """All temporary restrictions known; restrictions received earlier no longer apply."""

    kind: ClassVar[Kind] = Kind.RESTRICTION
    restrictions: tuple[Restriction, ...]


@dataclass(frozen=True, kw_only=True)
class TargetsHeard(StateHeard):
    """All targets of traffic management in force; targets received earlier no longer apply."""

    kind: ClassVar[Kind] = Kind.TARGET
    targets: tuple[Target, ...]


@dataclass(frozen=True, kw_only=True)
class Unreadable(Heard):
    """A message that could not be read.

    `told` is the kind of message that its topic carries, `why` is the error (empty: the message has another type).
    """

    told: Kind
    why: str = ""

    @property
    def kind(self) -> Kind:  # type: ignore[override]
        """The kind of message that could not be read."""
        return self.told


@dataclass(frozen=True, kw_only=True)
class PublisherSeen:
    """A session has begun to publish a state (`there` is true), or no longer can."""

    kind: Kind
    source: str
    there: bool
    heard_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class NodeSeen:
    """Another session has begun to advise this train (`there` is true), or no longer can."""

    source: str
    there: bool
