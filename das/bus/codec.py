"""Conversion of messages to values and back: only this module knows the bus format of the cab's values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message

from das import __version__
from das.advice.advice import Advice
from das.advice.plan import Plan
from das.bus import das_pb2, topics
from das.bus.topics import Received, Topic, decode_restriction, encode_restriction
from das.cab import heard
from das.cab.heard import Heard, Kind
from das.cab.outputs import Estimated, Event, Output, Status
from das.domain.journey import OrderedStop
from das.estimate.estimate import Effort, PositionFix, Quality

INPUT_TOPICS: Mapping[Kind, Topic] = {Kind(one.name): one for one in topics.TOPICS if one.name in list(Kind)}
"""The topic of each kind of message that the cab receives; they have the same names."""
DELAY_FIELDS = ("time_ns", "delay_s")
"""The fields that the value and the message of a delay share."""
JOURNEY_FIELDS = ("time_ns", "train", "route_id", "vehicle_id", "reversed", "load", "level")
"""The fields that the value and the message of a journey share."""


class Outgoing(NamedTuple):
    """A message and the topic it is published on."""

    topic: Topic
    message: Message


def decode(received: Received, heard_ns: int) -> Heard | None:
    """The value of a message received at `heard_ns` (ns since 1970; 0: no clock yet).

    None for topics that the cab does not receive; `heard.Unreadable` for messages that are not of their topic's type.
    """
    if received.topic.name not in list(Kind):
        return None
    kind = Kind(received.topic.name)
    common = {"heard_ns": heard_ns, "source": received.source}
    if received.message is None:
        return heard.Unreadable(told=kind, **common)  # type: ignore[arg-type]
    try:
        return _DECODERS[kind](received.message, common)
    except ValueError as error:
        return heard.Unreadable(told=kind, why=f"one that cannot be read ({error})", **common)  # type: ignore[arg-type]


def encode_input(value: Heard) -> Outgoing:
    """The message of a value that a cab receives."""
    return Outgoing(INPUT_TOPICS[value.kind], _ENCODERS[type(value)](value))


def control(now_ns: int, tick: int, *, restrictions_ns: int, targets_ns: int, finish: bool = False) -> Outgoing:
    """The message with which a simulation sends a node the time (ns since 1970) and requests the advice of a tick.

    `restrictions_ns` and `targets_ns` are the times of the restrictions and targets that the node must have received
    before it answers (0: none). With `finish` the simulation is over, and the node ends.
    """
    command = das_pb2.Control.COMMAND_FINISH if finish else das_pb2.Control.COMMAND_TICK
    message = das_pb2.Control(
        time_ns=now_ns, tick=tick, command=command, restrictions_ns=restrictions_ns, targets_ns=targets_ns
    )
    return Outgoing(topics.CONTROL, message)


def finishes(control: Any) -> bool:
    """Whether a Control message ends the simulation; every other Control message requests advice."""
    return bool(control.command == das_pb2.Control.COMMAND_FINISH)


def encode_output(output: Output, tick: int = 0) -> Outgoing:
    """The message of an output of the cab; `tick` is the tick of the Control message answered (0: none)."""
    if isinstance(output, Advice):
        return Outgoing(topics.ADVICE, advice_message(output, tick))
    if isinstance(output, Status):
        return Outgoing(topics.STATUS, das_pb2.Status(version=__version__, **vars(output)))
    if isinstance(output, Plan):
        return Outgoing(topics.PLAN, _plan_message(output))
    if isinstance(output, Estimated):
        return Outgoing(topics.ESTIMATE, das_pb2.Estimate(**vars(output)))
    return Outgoing(topics.EVENT, event_message(output))


def advice_message(advice: Advice, tick: int) -> das_pb2.Advice:
    """The message of advice; the field names are the same."""
    fields, guide = {**vars(advice), "reason": vars(advice.reason)}, advice.guide
    if guide is not None:  # `dataclasses.asdict` would copy each value, which takes longer than the message.
        parts = {name: vars(getattr(guide, name)) for name in ("now", "reason", "replan")}
        fields["guide"] = {**vars(guide), **parts, "following": list(map(vars, guide.following))}
    return das_pb2.Advice(tick=tick, **fields)


def event_message(event: Event) -> Log:
    """The message of an event of das-node."""
    log = Log(level=event.severity, message=event.text, name="das-node")  # type: ignore[arg-type]
    log.timestamp.FromNanoseconds(event.time_ns)
    return log


def _plan_message(plan: Plan) -> das_pb2.Plan:
    planned = plan.solution.trajectory
    return das_pb2.Plan(
        time_ns=plan.made_ns, s_m=planned.s_m, t_s=planned.t_s, speed_mps=planned.v_mps, force_n=[*plan.force_n, 0.0]
    )


def _values(one: Any, names: Iterable[str]) -> dict[str, Any]:
    """Fields of a message or of a value by name; most have the same name in both."""
    return {name: getattr(one, name) for name in names}


_DECODERS: Mapping[Kind, Callable[[Any, dict[str, Any]], Heard]] = {
    Kind.POSITION: lambda message, common: heard.PositionHeard(
        fix=PositionFix(**{**_values(message, PositionFix.__dataclass_fields__), "quality": Quality(message.quality)}),
        **common,
    ),
    Kind.DELAY: lambda message, common: heard.DelayHeard(**_values(message, DELAY_FIELDS), **common),
    Kind.EFFORT: lambda message, common: heard.EffortHeard(
        effort=Effort(**_values(message, Effort.__dataclass_fields__)), **common
    ),
    Kind.JOURNEY: lambda message, common: heard.JourneyHeard(
        stops=tuple(OrderedStop(**_values(one, OrderedStop._fields)) for one in message.stops),
        **_values(message, JOURNEY_FIELDS),
        **common,
    ),
    Kind.RESTRICTION: lambda message, common: heard.RestrictionsHeard(
        time_ns=message.time_ns,
        restrictions=tuple(decode_restriction(one, heard.ToldRestriction) for one in message.restrictions),
        **common,
    ),
    Kind.TARGET: lambda message, common: heard.TargetsHeard(
        time_ns=message.time_ns,
        targets=tuple(heard.Target(**_values(one, heard.Target._fields)) for one in message.targets),
        **common,
    ),
}
_ENCODERS: Mapping[type[Heard], Callable[[Any], Message]] = {
    heard.PositionHeard: lambda value: das_pb2.Position(**vars(value.fix)),
    heard.DelayHeard: lambda value: das_pb2.Delay(**_values(value, DELAY_FIELDS)),
    heard.EffortHeard: lambda value: das_pb2.Effort(**vars(value.effort)),
    heard.JourneyHeard: lambda value: das_pb2.Journey(
        stops=(das_pb2.Journey.Stop(**one._asdict()) for one in value.stops), **_values(value, JOURNEY_FIELDS)
    ),
    heard.RestrictionsHeard: lambda value: das_pb2.Restrictions(
        time_ns=value.time_ns, restrictions=map(encode_restriction, value.restrictions)
    ),
    heard.TargetsHeard: lambda value: das_pb2.Targets(
        time_ns=value.time_ns, targets=(das_pb2.Targets.Target(**one._asdict()) for one in value.targets)
    ),
}
