"""What goes wrong on a day: each kind with its figures, as a scenario file names them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from das.domain.units import KM, kmh


class SensorFault(StrEnum):
    """How localisation fails."""

    DROPOUT = "dropout"
    """No positions at all."""
    JUMP = "jump"
    """Positions off by `size_m`."""
    FROZEN = "frozen"
    """The last position again and again, with new times."""
    NOISE = "noise"
    """Positions scattered with the standard deviation `size_m`."""


@dataclass(frozen=True, kw_only=True)
class DepartureDelay:
    """The train leaves a stop late."""

    stop: str
    delay_s: float


class DwellOverrun(DepartureDelay):
    """The same where passengers hold the train up."""


@dataclass(frozen=True, kw_only=True)
class DelayOnTheWay:
    """From `from_m` to `to_m` the driver may not go faster than `speed_mps`; only he is told."""

    from_m: float
    to_m: float
    speed_mps: float


@dataclass(frozen=True, kw_only=True)
class Restriction:
    """A temporary speed restriction, told to driver and node when the head is `announced_m` before it."""

    from_m: float
    to_m: float
    speed_mps: float
    announced_m: float


@dataclass(frozen=True, kw_only=True)
class SignalStop:
    """A signal at danger at `at_m`, seen `seen_m` before it; it clears `clears_after_s` after it was first seen."""

    at_m: float
    seen_m: float
    clears_after_s: float


@dataclass(frozen=True, kw_only=True)
class TrainAhead:
    """A signal at danger at `at_m`, seen `seen_m` before it, until `clears_s` after the start.

    Traffic management knows that: `told_m` before the signal the node is told not to be in sight of it any sooner.
    """

    at_m: float
    seen_m: float
    clears_s: float
    told_m: float


@dataclass(frozen=True, kw_only=True)
class SlipperyRail:
    """Adhesion times `adhesion_ratio` from `from_m` to `to_m`."""

    from_m: float
    to_m: float
    adhesion_ratio: float


@dataclass(frozen=True, kw_only=True)
class HeadWind:
    """Wind against the train from `from_m` to `to_m` (tail wind < 0)."""

    from_m: float
    to_m: float
    wind_mps: float


@dataclass(frozen=True, kw_only=True)
class SensorOutage:
    """Localisation fails from `from_s` after the start for `for_s`."""

    fault: SensorFault
    from_s: float
    for_s: float
    size_m: float


@dataclass(frozen=True, kw_only=True)
class BusOutage:
    """Nothing gets through between simulator and node from `from_s` for `for_s`."""

    from_s: float
    for_s: float


@dataclass(frozen=True, kw_only=True)
class NodeRestart:
    """The node is killed at `at_s` and started anew."""

    at_s: float


Disturbance = (
    DepartureDelay
    | DelayOnTheWay
    | Restriction
    | SignalStop
    | TrainAhead
    | SlipperyRail
    | HeadWind
    | SensorOutage
    | BusOutage
    | NodeRestart
)


KINDS = {
    "departure-delay": DepartureDelay,
    "dwell-overrun": DwellOverrun,
    "delay-on-the-way": DelayOnTheWay,
    "restriction": Restriction,
    "signal-stop": SignalStop,
    "train-ahead": TrainAhead,
    "slippery-rail": SlipperyRail,
    "head-wind": HeadWind,
    "sensor-fault": SensorOutage,
    "bus-outage": BusOutage,
    "node-restart": NodeRestart,
}
"""Each kind by the name scenario files give it."""
_KIND_OF = {made: kind for kind, made in KINDS.items()}


NOTHING = "nothing"
"""What happens on a day without disturbances."""


def as_figures(disturbances: Sequence[Disturbance]) -> list[dict[str, Any]]:
    """Kind and figures (SI) of each, for programs."""
    return [{"kind": _KIND_OF[type(one)], **asdict(one)} for one in disturbances]


def described(disturbances: Sequence[Disturbance]) -> str:
    """What happens in a line, speeds and places as people say them."""
    return "; ".join(map(_described, disturbances)) or NOTHING


def _described(one: Disturbance) -> str:
    match one:
        case DwellOverrun():
            return f"dwell at {one.stop} {one.delay_s:.0f} s longer"
        case DepartureDelay():
            return f"departure from {one.stop} {one.delay_s:.0f} s late"
        case DelayOnTheWay():
            return f"no faster than {kmh(one.speed_mps):.0f} km/h {_stretch(one)}"
        case Restriction():
            said = f"restriction to {kmh(one.speed_mps):.0f} km/h {_stretch(one)}"
            return f"{said}, told {one.announced_m:.0f} m ahead"
        case SignalStop():
            return f"{_signal(one)}, clear {one.clears_after_s:.0f} s later"
        case TrainAhead():
            return f"{_signal(one)}, clear at {one.clears_s:.0f} s, the node told {one.told_m:.0f} m ahead"
        case SlipperyRail():
            return f"slippery rail {_stretch(one)}, adhesion × {one.adhesion_ratio:.2g}"
        case HeadWind():
            return f"head wind of {kmh(one.wind_mps):.0f} km/h {_stretch(one)}"
        case SensorOutage():
            sized = one.fault in (SensorFault.JUMP, SensorFault.NOISE)
            return f"localisation: {one.fault}{f' of {one.size_m:.0f} m' if sized else ''} {_span(one)}"
        case BusOutage():
            return f"bus outage {_span(one)}"
        case NodeRestart():
            return f"node restarted at {one.at_s:.0f} s"


def _stretch(one: DelayOnTheWay | Restriction | SlipperyRail | HeadWind) -> str:
    return f"from km {one.from_m / KM:.1f} to {one.to_m / KM:.1f}"


def _signal(one: SignalStop | TrainAhead) -> str:
    return f"signal at km {one.at_m / KM:.1f} at danger, seen {one.seen_m:.0f} m ahead"


def _span(one: SensorOutage | BusOutage) -> str:
    return f"at {one.from_s:.0f} s for {one.for_s:.0f} s"
