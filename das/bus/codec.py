"""Between messages and values: the only place that knows how the cab's plain values look on the bus."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message

from das import __version__
from das.advice.advice import Advice
from das.advice.plan import Plan
from das.bus import das_pb2
from das.bus.received import Received
from das.bus.restrictions import decoded, encoded
from das.bus.topics import (
    ADVICE,
    CONTROL,
    DELAY,
    EFFORT,
    ESTIMATE,
    EVENT,
    JOURNEY,
    PLAN,
    POSITION,
    RESTRICTION,
    STATUS,
    TARGET,
    Topic,
)
from das.cab import event_wording
from das.cab.heard import (
    DelayHeard,
    EffortHeard,
    Heard,
    JourneyHeard,
    Kind,
    OrderedStop,
    PositionHeard,
    RestrictionsHeard,
    Target,
    TargetsHeard,
    ToldRestriction,
    Unreadable,
)
from das.cab.outputs import Estimated, Event, Output, Status
from das.estimate.effort import Effort
from das.estimate.fix import PositionFix, Quality

TOPICS_HEARD: Mapping[Kind, Topic] = {
    Kind.POSITION: POSITION,
    Kind.DELAY: DELAY,
    Kind.EFFORT: EFFORT,
    Kind.JOURNEY: JOURNEY,
    Kind.RESTRICTION: RESTRICTION,
    Kind.TARGET: TARGET,
}
"""The topic of each kind of thing that the cab can be told."""
KINDS = {topic.name: kind for kind, topic in TOPICS_HEARD.items()}


class Outgoing(NamedTuple):
    """A message and the topic it is published on."""

    topic: Topic
    message: Message


def heard(received: Received, heard_ns: int) -> Heard | None:
    """What a message says, heard at a time of the clock (ns since 1970; 0: no clock yet).

    None for topics that the cab does not hear; `Unreadable` for messages that are not of their topic's type.
    """
    kind = KINDS.get(received.topic.name)
    if kind is None:
        return None
    common = {"heard_ns": heard_ns, "source": received.source}
    if received.message is None:
        return Unreadable(told=kind, **common)  # type: ignore[arg-type]
    try:
        return _DECODERS[kind](received.message, common)
    except ValueError as error:
        return Unreadable(told=kind, why=event_wording.unreadable(error), **common)  # type: ignore[arg-type]


def told(value: Heard) -> Outgoing:
    """The message that tells a cab something."""
    return Outgoing(TOPICS_HEARD[value.kind], _ENCODERS[type(value)](value))


def control(now_ns: int, tick: int, *, restrictions_ns: int, targets_ns: int, finish: bool = False) -> Outgoing:
    """The message by which a simulation tells a node the time (ns since 1970) and asks for the advice of a tick.

    `restrictions_ns` and `targets_ns` are the times of the restrictions and targets that the node must have heard
    before it answers (0: none). `finish` says that the run is over; the node ends.
    """
    command = das_pb2.Control.COMMAND_FINISH if finish else das_pb2.Control.COMMAND_TICK
    message = das_pb2.Control(
        time_ns=now_ns, tick=tick, command=command, restrictions_ns=restrictions_ns, targets_ns=targets_ns
    )
    return Outgoing(CONTROL, message)


def finishes(control: Any) -> bool:
    """Whether a Control message says that the run is over; every other one asks for advice."""
    return bool(control.command == das_pb2.Control.COMMAND_FINISH)


def said(output: Output, tick: int = 0) -> Outgoing:
    """The message for something the cab says; `tick` is that of the Control message answered (0: none)."""
    if isinstance(output, Advice):
        return Outgoing(ADVICE, advice_message(output, tick))
    if isinstance(output, Status):
        return Outgoing(STATUS, das_pb2.Status(version=__version__, **dataclasses.asdict(output)))
    if isinstance(output, Plan):
        return Outgoing(PLAN, _plan_message(output))
    if isinstance(output, Estimated):
        return Outgoing(ESTIMATE, das_pb2.Estimate(**dataclasses.asdict(output)))
    return Outgoing(EVENT, event_message(output))


def advice_message(advice: Advice, tick: int) -> das_pb2.Advice:
    """An advice as a message; the field names are the same."""
    fields = dict(vars(advice))  # A deep copy would take half of the time between a position and its advice.
    if advice.coach is not None:
        fields["coach"] = dataclasses.asdict(advice.coach)
    return das_pb2.Advice(tick=tick, **fields)


def event_message(event: Event, name: str = "das-node") -> Log:
    """An event as a message; `name` says which program speaks."""
    log = Log(level=event.severity, message=event.text, name=name)  # type: ignore[arg-type]
    log.timestamp.FromNanoseconds(event.time_ns)
    return log


def _plan_message(plan: Plan) -> das_pb2.Plan:
    run = plan.solution.trajectory
    return das_pb2.Plan(
        time_ns=plan.made_ns, s_m=run.s_m, t_s=run.t_s, speed_mps=run.v_mps, force_n=[*plan.force_n, 0.0]
    )


def _position(message: Any, common: dict[str, Any]) -> PositionHeard:
    fix = PositionFix(
        time_ns=message.time_ns,
        s_m=message.s_m,
        speed_mps=message.speed_mps,
        uncertainty_m=message.uncertainty_m,
        speed_uncertainty_mps=message.speed_uncertainty_mps,
        quality=Quality(message.quality),
    )
    return PositionHeard(fix=fix, **common)


def _delay(message: Any, common: dict[str, Any]) -> DelayHeard:
    return DelayHeard(time_ns=message.time_ns, delay_s=message.delay_s, **common)


def _effort(message: Any, common: dict[str, Any]) -> EffortHeard:
    effort = Effort(
        time_ns=message.time_ns, force_el_n=message.force_el_n, force_friction_n=message.force_friction_n
    )  # fmt: skip
    return EffortHeard(effort=effort, **common)


def _journey(message: Any, common: dict[str, Any]) -> JourneyHeard:
    return JourneyHeard(
        time_ns=message.time_ns,
        train=message.train,
        route_id=message.route_id,
        vehicle_id=message.vehicle_id,
        reversed=message.reversed,
        load=message.load,
        level=message.level,
        stops=tuple(OrderedStop(x.name, x.s_m, x.arrival_ns, x.departure_ns) for x in message.stops),
        **common,
    )


def _restrictions(message: Any, common: dict[str, Any]) -> RestrictionsHeard:
    restrictions = tuple(decoded(one, ToldRestriction) for one in message.restrictions)
    return RestrictionsHeard(time_ns=message.time_ns, restrictions=restrictions, **common)


def _targets(message: Any, common: dict[str, Any]) -> TargetsHeard:
    targets = tuple(
        Target(x.stop, x.s_m, x.arrival_ns, x.earliest_ns, x.latest_ns, x.reason) for x in message.targets
    )  # fmt: skip
    return TargetsHeard(time_ns=message.time_ns, targets=targets, **common)


_DECODERS: Mapping[Kind, Callable[[Any, dict[str, Any]], Heard]] = {
    Kind.POSITION: _position,
    Kind.DELAY: _delay,
    Kind.EFFORT: _effort,
    Kind.JOURNEY: _journey,
    Kind.RESTRICTION: _restrictions,
    Kind.TARGET: _targets,
}


def _position_message(value: PositionHeard) -> Message:
    fields = dataclasses.asdict(value.fix)
    return das_pb2.Position(**{**fields, "quality": das_pb2.Position.Quality.ValueType(value.fix.quality)})


def _delay_message(value: DelayHeard) -> Message:
    return das_pb2.Delay(time_ns=value.time_ns, delay_s=value.delay_s)


def _effort_message(value: EffortHeard) -> Message:
    return das_pb2.Effort(**dataclasses.asdict(value.effort))


def _journey_message(value: JourneyHeard) -> Message:
    return das_pb2.Journey(
        time_ns=value.time_ns,
        train=value.train,
        route_id=value.route_id,
        vehicle_id=value.vehicle_id,
        reversed=value.reversed,
        load=value.load,
        level=value.level,
        stops=[das_pb2.Journey.Stop(**stop._asdict()) for stop in value.stops],
    )


def _restrictions_message(value: RestrictionsHeard) -> Message:
    return das_pb2.Restrictions(time_ns=value.time_ns, restrictions=map(encoded, value.restrictions))


def _targets_message(value: TargetsHeard) -> Message:
    targets = [das_pb2.Targets.Target(**one._asdict()) for one in value.targets]
    return das_pb2.Targets(time_ns=value.time_ns, targets=targets)


_ENCODERS: Mapping[type[Heard], Callable[[Any], Message]] = {
    PositionHeard: _position_message,
    DelayHeard: _delay_message,
    EffortHeard: _effort_message,
    JourneyHeard: _journey_message,
    RestrictionsHeard: _restrictions_message,
    TargetsHeard: _targets_message,
}
