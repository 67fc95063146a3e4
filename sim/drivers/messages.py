"""The cab and the controller as messages of the bus, and back; every number stays the same to the last bit."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

from google.protobuf.message import Message

from das.bus import das_pb2
from das.bus.restrictions import decoded, encoded
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from sim.drivers.cab import AdviceView, CabView, Presentation, lever_ratio
from sim.drivers.checked import checked
from sim.drivers.knowledge import LineKnowledge
from sim.plant.kernels import FORCE, LEVER, Command, demanded
from sim.plant.plant import force, lever, speed

PRESENTATIONS: Final = {
    Presentation.RMS: das_pb2.Cab.PRESENTATION_RMS,
    Presentation.FOUR_MODE: das_pb2.Cab.PRESENTATION_FOUR_MODE,
    Presentation.VECTOR: das_pb2.Cab.PRESENTATION_VECTOR,
    Presentation.COACH: das_pb2.Cab.PRESENTATION_COACH,
    Presentation.DEVIATION: das_pb2.Cab.PRESENTATION_DEVIATION,
}
"""The presentations as the message names them."""
SHOWN: Final = {number: presentation for presentation, number in PRESENTATIONS.items()}
"""What the numbers in the message mean."""
_HIDDEN: Final = (
    *("advised_speed_mps", "advised_lever_ratio", "next_change_s", "display_speed_mps", "advice_s", "valid_until_s"),
    *("advised_force_n", "due_s", "target_way_m", "deviation_s", "next_speed_mps", "next_effort_ratio"),
)
"""Fields that are NaN while nothing is shown."""


class CabLook(NamedTuple):
    """A look of the driver: the time (ns since 1970), the cab, what the controller is set to, and the look's number.

    The number is 0 where no external driver is asked.
    """

    time_ns: int
    cab: CabView
    command: Command
    number: int = 0


def cab_message(look: CabLook, line: LineKnowledge) -> Message:
    """The message `Cab` of a look; what is ahead is in it only where an external driver is asked."""
    cab, asked = look.cab, look.number > 0
    message = das_pb2.Cab(
        time_ns=look.time_ns,
        limit_mps=cab.limit_mps,
        signal_m=cab.signal_m if math.isfinite(cab.signal_m) else math.nan,
        # The controller's setting that asks what the last command asks.
        lever_ratio=lever_ratio(demanded(look.command, 0.0, cab.speed_mps, line.train), cab.speed_mps, line.train),
        friction_ratio=look.command.friction_ratio,
        look=look.number,
        clock_s=cab.time_s,
        s_m=cab.s_m,
        speed_mps=cab.speed_mps,
        stop_m=cab.stop_m,
        departure_s=cab.departure_s,
        arrival_s=cab.arrival_s,
        may_depart=cab.may_depart,
        restrictions=map(encoded, cab.restrictions),
        **_advice_fields(cab.shown, horizons=asked),
    )
    if asked:
        message.limits_ahead.extend(das_pb2.Cab.LimitAhead(s_m=s, limit_mps=v) for s, v in _limits_ahead(cab, line))
    return message


def cab_view(message: Any) -> CabView:
    """The cab as its message shows it."""
    return CabView(
        time_s=message.clock_s,
        s_m=message.s_m,
        speed_mps=message.speed_mps,
        limit_mps=message.limit_mps,
        stop_m=message.stop_m,
        departure_s=message.departure_s,
        arrival_s=message.arrival_s,
        may_depart=message.may_depart,
        signal_m=math.inf if math.isnan(message.signal_m) else message.signal_m,
        restrictions=tuple(decoded(one, Restriction) for one in message.restrictions),
        advice=_advice_view(message),
    )


def controls_message(look: int, command: Command) -> Message:
    """The message `Controls` that answers a look."""
    message = das_pb2.Controls(look=look, friction_ratio=command.friction_ratio)
    if command.law == LEVER:
        message.lever_ratio = command.value
    elif command.law == FORCE:
        message.force_n = command.value
    else:
        held = message.held_speed
        held.speed_mps, held.rate_mps2, held.force_n = command.value, command.rate_mps2, command.force_n
        held.gain_per_s, held.low_n, held.high_n = command.gain_per_s, command.low_n, command.high_n
    return message


def command_of(message: Any, time_s: float) -> Command:
    """The command that a message `Controls` asks for at a moment (s on the cab's clock).

    Raises DasError where it asks for nothing, or with a number that is NaN or out of range.
    """
    who, law = "--driver external", message.WhichOneof("set")
    if law is None:
        raise DasError(
            f"{who}: at {time_s:.1f} s it answered Controls with neither lever_ratio, force_n nor held_speed"
        )
    if law == "lever_ratio":
        command = lever(message.lever_ratio, friction_ratio=message.friction_ratio)
    elif law == "force_n":
        command = force(message.force_n, friction_ratio=message.friction_ratio)
    else:
        held = message.held_speed
        said = {name: getattr(held, name) for name in ("gain_per_s", "low_n", "high_n") if held.HasField(name)}
        command = speed(held.speed_mps, rate_mps2=held.rate_mps2, force_n=held.force_n, **said)
        command = command._replace(friction_ratio=message.friction_ratio)
    return checked(command, who, time_s)


def _advice_fields(view: AdviceView | None, *, horizons: bool) -> dict[str, Any]:
    if view is None:
        return dict.fromkeys(_HIDDEN, math.nan)
    shown = {
        "presentation": PRESENTATIONS[view.presentation],
        "mode": view.mode,
        "advised_speed_mps": view.speed_mps,
        "advised_lever_ratio": view.lever_ratio,
        "next_mode": view.next_mode,
        "next_change_s": view.next_change_s,
        "reason": view.reason,
        "display_speed_mps": view.display_speed_mps,
        "advice_s": view.time_s,
        "valid_until_s": view.valid_until_s,
        "advised_force_n": view.force_n,
        "next_speed_mps": view.next_speed_mps,
        "next_effort_ratio": view.next_effort_ratio,
        "due_s": view.due_s,
        "target_way_m": view.target_way_m,
        "deviation_s": view.deviation_s,
    }
    ahead = {"horizon_speed_mps": view.horizon_speed_mps, "horizon_force_n": view.horizon_force_n}
    return {**shown, **ahead} if horizons else shown


def _advice_view(message: Any) -> AdviceView | None:
    presentation = SHOWN.get(message.presentation)
    if presentation is None:
        return None
    return AdviceView(
        time_s=message.advice_s,
        valid_until_s=message.valid_until_s,
        presentation=presentation,
        mode=message.mode,
        speed_mps=message.advised_speed_mps,
        display_speed_mps=message.display_speed_mps,
        lever_ratio=message.advised_lever_ratio,
        force_n=message.advised_force_n,
        horizon_speed_mps=tuple(message.horizon_speed_mps),
        horizon_force_n=tuple(message.horizon_force_n),
        next_mode=message.next_mode,
        next_change_s=message.next_change_s,
        next_speed_mps=message.next_speed_mps,
        next_effort_ratio=message.next_effort_ratio,
        due_s=message.due_s,
        target_way_m=message.target_way_m,
        deviation_s=message.deviation_s,
        reason=message.reason,
    )


def _limits_ahead(cab: CabView, line: LineKnowledge) -> list[tuple[float, float]]:
    """Positions (m) and limits (m/s) of the line that begin between the train's head and the next stop."""
    limits = line.limits_mps
    ahead = (limits.start_m > cab.s_m) & (limits.start_m < cab.stop_m)
    return list(zip(limits.start_m[ahead].tolist(), limits.value[ahead].tolist(), strict=True))
