"""What goes wrong on a day: each kind with its figures, as a scenario file names them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum

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
    """The train leaves a stop late (`dwell-overrun` is the same at a stop on the way)."""

    stop: str
    delay_s: float


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


def described(disturbances: Sequence[Disturbance]) -> str:
    """What happens in a line: kinds and figures, speeds and places as people say them."""
    return "; ".join(map(_described, disturbances)) or "nothing"


def _described(disturbance: Disturbance) -> str:
    figures = (_figure(name, value) for name, value in asdict(disturbance).items())
    return f"{_NAMES[type(disturbance)]}: {', '.join(figures)}"


_NAMES = {
    DepartureDelay: "departure delay",
    DelayOnTheWay: "delay on the way",
    Restriction: "restriction",
    SignalStop: "signal stop",
    TrainAhead: "train ahead",
    SlipperyRail: "slippery rail",
    HeadWind: "head wind",
    SensorOutage: "sensor fault",
    BusOutage: "bus outage",
    NodeRestart: "node restart",
}
_PLACES = ("from_m", "to_m", "at_m")


def _figure(name: str, value: float | str) -> str:
    what, _, unit = name.rpartition("_")
    if isinstance(value, str):
        return f"{name} {value}"
    if unit == "mps":
        return f"{what} {kmh(value):.1f} km/h"
    if name in _PLACES:
        return f"{what} km {value / KM:.3f}"
    return f"{what.replace('_', ' ')} {value:.4g}{'' if unit == 'ratio' else f' {unit}'}"
