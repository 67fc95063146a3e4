"""What the cab can be told: one frozen value for each thing. The bus's codec makes them; a simulation may as well.

`heard_ns` is the clock at the moment of hearing (ns since 1970; 0 while there is no clock yet). `source` names the
session that said it, where that is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import ClassVar, Final, NamedTuple

from das.domain.restriction import Restriction
from das.estimate.effort import Effort
from das.estimate.fix import PositionFix

UNSTAMPED: Final = "a sender without time stamps"
"""The source of a message that its sender did not stamp: nobody can tell whether two senders are behind it."""


class Kind(StrEnum):
    """The kinds of things that can be told; their names are those of the bus's topics."""

    POSITION = "position"
    DELAY = "delay"
    EFFORT = "effort"
    JOURNEY = "journey"
    RESTRICTION = "restriction"
    TARGET = "target"


STATES = (Kind.JOURNEY, Kind.RESTRICTION, Kind.TARGET)
"""What holds until the next of its kind is told: an older one must not undo a newer, and one publisher says it."""


class OrderedStop(NamedTuple):
    """A stop of a journey as ordered: its name, its position (m), and its times (ns since 1970; 0: none)."""

    name: str
    s_m: float
    arrival_ns: int = 0
    departure_ns: int = 0


class ToldRestriction(Restriction):
    """A restriction as told, not yet judged: its figures may be anything."""

    def __post_init__(self) -> None:
        """The guard judges the figures, not the value itself."""


def judged(told: Restriction) -> Restriction:
    """The restriction that is meant by one that was told; raises InputError where nobody can mean it."""
    return Restriction(*told.figures)


class Target(NamedTuple):
    """What traffic management wants: a new arrival at a stop, or the window of a point (ns since 1970; 0: open)."""

    stop: str = ""
    s_m: float = 0.0
    arrival_ns: int = 0
    earliest_ns: int = 0
    latest_ns: int = 0
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Heard:
    """Something that was told."""

    kind: ClassVar[Kind]
    heard_ns: int = 0
    source: str = ""


@dataclass(frozen=True, kw_only=True)
class PositionHeard(Heard):
    """Where the train is, as its sensors say."""

    kind: ClassVar[Kind] = Kind.POSITION
    fix: PositionFix


@dataclass(frozen=True, kw_only=True)
class DelayHeard(Heard):
    """The operator's word on the delay (s; late > 0), said at `time_ns`."""

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
    """Something that holds until the next of its kind; `time_ns` is when it was said."""

    time_ns: int


@dataclass(frozen=True, kw_only=True)
class JourneyHeard(StateHeard):
    """What the train is to do. Empty texts: as the cab was started."""

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
    """All temporary restrictions known; none of those told before holds any more."""

    kind: ClassVar[Kind] = Kind.RESTRICTION
    restrictions: tuple[Restriction, ...]

    def is_same(self, other: Heard | None) -> bool:
        """Whether another message is this one, whenever it was heard."""
        return other is not None and replace(other, heard_ns=self.heard_ns) == self


@dataclass(frozen=True, kw_only=True)
class TargetsHeard(StateHeard):
    """All targets of traffic management in force; none of those told before holds any more."""

    kind: ClassVar[Kind] = Kind.TARGET
    targets: tuple[Target, ...]


@dataclass(frozen=True, kw_only=True)
class Unreadable(Heard):
    """Something of a kind that could not be read; `why` in words (nothing: it is not of that kind at all)."""

    told: Kind
    why: str = ""


@dataclass(frozen=True, kw_only=True)
class PublisherSeen:
    """A session has begun to publish a state (`there`), or can do so no more."""

    kind: Kind
    source: str
    there: bool
    heard_ns: int = 0


@dataclass(frozen=True, kw_only=True)
class NodeSeen:
    """Another session has begun to advise this train (`there`), or can do so no more."""

    source: str
    there: bool


@dataclass(frozen=True, kw_only=True)
class ClockSet:
    """The clock that the cab is told the time by was set by `step_s` (s; < 0: back)."""

    step_s: float
    heard_ns: int = 0


def kind_of(heard: Heard) -> Kind:
    """What something that was told is about."""
    return heard.told if isinstance(heard, Unreadable) else heard.kind
