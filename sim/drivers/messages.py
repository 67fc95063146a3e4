"""The cab as a message of the bus, and the advice and commands in cab messages; numbers are kept exactly."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from google.protobuf.message import Message

from das.advice.reason import Reason
from das.bus import das_pb2
from das.bus.topics import encode_restriction
from das.domain.errors import DasError
from sim.drivers.cab import AdviceView, CabView
from sim.drivers.presentations.presenter import presenter_of, shown_presentation

if TYPE_CHECKING:
    from sim.drivers.knowledge import LineKnowledge
    from sim.plant.kernels import Command

_SAME: Final = (
    *("valid_until_s", "display_speed_mps", "due_s", "target_way_m", "deviation_s"),
    *("next_change_s", "next_change_m", "next_speed_mps", "next_effort_ratio"),
    *("second_change_s", "second_change_m", "second_speed_mps", "second_effort_ratio"),
)
"""Numeric fields of `AdviceView` that the message has under the same names."""
_FIELDS: Final = {
    "time_s": "advice_s",
    "speed_mps": "advised_speed_mps",
    "lever_ratio": "advised_lever_ratio",
    "force_n": "advised_force_n",
    **{name: name for name in _SAME},
}
"""Numeric fields of `AdviceView` with their names in the message; in the message, NaN while nothing is shown."""
_MODES: Final = ("mode", "next_mode", "second_mode")
"""The modes of `AdviceView`; the message has them under the same names."""
_SEEN: Final = ("late_s", "gradient_ratio", "force_el_n", "force_friction_n", "cause")
"""Fields of `CabView` that the message has under the same names if an external driver is asked."""


class CabLook(NamedTuple):
    """A look of the driver: time (ns since 1970), the cab, the command in force, and the number of the look.

    The number is 0 if the look does not ask an external driver. `interlock` (by its number on the bus) overrides the
    controller; `wall_ns` is the wall clock (ns since 1970), 0 if the run keeps no pace.
    """

    time_ns: int
    cab: CabView
    command: Command
    number: int = 0
    interlock: int = 0
    wall_ns: int = 0


def cab_message(look: CabLook, line: LineKnowledge) -> Message:
    """The message `Cab` of a look; with horizons and limits ahead only if the look asks an external driver."""
    from sim.plant.kernels import demanded  # compiled; reading a recorded cab does not need the train model
    from sim.plant.plant import lever_ratio

    cab, asked = look.cab, look.number > 0
    message = das_pb2.Cab(
        time_ns=look.time_ns,
        limit_mps=cab.limit_mps,
        signal_m=cab.signal_m if math.isfinite(cab.signal_m) else math.nan,
        # The setting of the controller that asks for the same force as the last command.
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
        restrictions=map(encode_restriction, cab.restrictions),
        interlock=das_pb2.Cab.Interlock.ValueType(look.interlock),
        wall_ns=look.wall_ns,
        **({name: getattr(cab, name) for name in _SEEN} if asked else {}),
        **_advice_fields(cab.shown, horizons=asked),
    )
    if asked:
        message.limits_ahead.extend(das_pb2.Cab.LimitAhead(s_m=s, limit_mps=v) for s, v in _limits_ahead(cab, line))
    return message


def command_of(message: Any, time_s: float) -> Command:
    """The command in a message `Controls` at a moment (s on the cab's clock). Raises DasError if the message has
    none, or if a number is NaN or out of range.
    """
    from sim.plant.plant import checked, force, lever, speed

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
        return dict.fromkeys(_FIELDS.values(), math.nan)
    ahead = ("horizon_speed_mps", "horizon_force_n") if horizons else ()
    return {
        "presentation": presenter_of(view.presentation).number,
        **{field: getattr(view, name) for name, field in _FIELDS.items()},
        **{name: getattr(view, name) for name in (*_MODES, *ahead)},
        "reason": das_pb2.Reason(**vars(view.reason)),
    }


def recorded_view(message: Any) -> AdviceView | None:
    """The advice that a recorded cab showed; None if it showed none or its presentation is unknown."""
    presentation = shown_presentation(message.presentation)
    if presentation is None:
        return None
    view = AdviceView(
        presentation=presentation,
        **{name: getattr(message, field) for name, field in _FIELDS.items()},
        **{name: getattr(message, name) for name in _MODES},
        reason=Reason.read(message.reason),
        horizon_speed_mps=tuple(message.horizon_speed_mps),
        horizon_force_n=tuple(message.horizon_force_n),
    )
    # In recordings made before the fields for the shown speed and the stop existed, both are 0.
    older = not view.display_speed_mps and not message.stop_m
    return replace(view, display_speed_mps=math.nan) if older else view


def _limits_ahead(cab: CabView, line: LineKnowledge) -> list[tuple[float, float]]:
    """Starts (m) and values (m/s) of the limits that begin between the train's head and the next stop."""
    limits = line.limits_mps
    ahead = (limits.start_m > cab.s_m) & (limits.start_m < cab.stop_m)
    return list(zip(limits.start_m[ahead].tolist(), limits.value[ahead].tolist(), strict=True))
