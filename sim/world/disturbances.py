"""The disturbances of a run: a class for each kind, with figures named as in scenario files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from das.domain.restriction import Restriction
from das.domain.units import KM, kmh
from sim.recording.opening import NOTHING


class SensorFault(StrEnum):
    """The kinds of failure of localisation."""

    DROPOUT = "dropout"
    """Localisation gives no positions."""
    JUMP = "jump"
    """Positions are wrong by `size_m`."""
    FROZEN = "frozen"
    """Localisation repeats its last position with new times."""
    NOISE = "noise"
    """Positions scatter with the standard deviation `size_m`."""


@dataclass(frozen=True, kw_only=True)
class DepartureDelay:
    """The train leaves a stop late."""

    stop: str
    delay_s: float


class DwellOverrun(DepartureDelay):
    """The train leaves a stop late because passengers hold it up."""


@dataclass(frozen=True, kw_only=True)
class DelayOnTheWay:
    """Between `from_m` and `to_m` the driver may not go faster than `speed_mps`; the node is not informed."""

    from_m: float
    to_m: float
    speed_mps: float


@dataclass(frozen=True, kw_only=True)
class AnnouncedRestriction:
    """A temporary speed restriction, announced to driver and node when the train's head is `announced_m` before it.

    The restriction is valid from `valid_from_s` to `valid_until_s` on the run's clock (None: open).
    """

    from_m: float
    to_m: float
    speed_mps: float
    announced_m: float
    valid_from_s: float | None = None
    valid_until_s: float | None = None

    def restriction(self, moment_ns: Callable[[float], int]) -> Restriction:
        """The restriction as announced; `moment_ns` turns a time of the run's clock (s) into ns since 1970."""
        ends = (self.valid_from_s, self.valid_until_s)
        from_ns, until_ns = (0 if clock_s is None else moment_ns(clock_s) for clock_s in ends)
        return Restriction(self.from_m, self.to_m, self.speed_mps, from_ns, until_ns)

    @classmethod
    def of(cls, one: Restriction, announced_m: float, clock_s: Callable[[int], float]) -> AnnouncedRestriction:
        """A restriction, announced `announced_m` before it; `clock_s` turns ns since 1970 into times of the run (s)."""
        return cls(
            from_m=one.start_m,
            to_m=one.end_m,
            speed_mps=one.limit_mps,
            announced_m=announced_m,
            valid_from_s=clock_s(one.valid_from_ns) if one.valid_from_ns else None,
            valid_until_s=clock_s(one.valid_until_ns) if one.valid_until_ns else None,
        )


@dataclass(frozen=True, kw_only=True)
class SignalStop:
    """A signal at danger at `at_m`, visible `seen_m` before it; it clears `clears_after_s` after it was seen."""

    at_m: float
    seen_m: float
    clears_after_s: float


@dataclass(frozen=True, kw_only=True)
class TrainAhead:
    """A signal at danger at `at_m`, visible `seen_m` before it, that clears at `clears_s` on the run's clock.

    Traffic management knows this time. When the train is `told_m` before the signal, the node receives a target: not
    to come within sight of the signal before it clears.
    """

    at_m: float
    seen_m: float
    clears_s: float
    told_m: float


@dataclass(frozen=True, kw_only=True)
class SlipperyRail:
    """The adhesion is multiplied by `adhesion_ratio` between `from_m` and `to_m`."""

    from_m: float
    to_m: float
    adhesion_ratio: float


@dataclass(frozen=True, kw_only=True)
class HeadWind:
    """A wind of `wind_mps` blows against the train between `from_m` and `to_m` (tail wind < 0)."""

    from_m: float
    to_m: float
    wind_mps: float


@dataclass(frozen=True, kw_only=True)
class SensorOutage:
    """Localisation fails from `from_s` on the run's clock, for `for_s`; `size_m` is the size of a jump or noise."""

    fault: SensorFault
    from_s: float
    for_s: float
    size_m: float


@dataclass(frozen=True, kw_only=True)
class BusOutage:
    """No message passes between simulator and node from `from_s` on the run's clock, for `for_s`."""

    from_s: float
    for_s: float


@dataclass(frozen=True, kw_only=True)
class NodeRestart:
    """The node is killed at `at_s` on the run's clock and restarted."""

    at_s: float


Disturbance = (
    DepartureDelay
    | DelayOnTheWay
    | AnnouncedRestriction
    | SignalStop
    | TrainAhead
    | SlipperyRail
    | HeadWind
    | SensorOutage
    | BusOutage
    | NodeRestart
)


KINDS: dict[str, type[Any]] = {
    "departure-delay": DepartureDelay,
    "dwell-overrun": DwellOverrun,
    "delay-on-the-way": DelayOnTheWay,
    "restriction": AnnouncedRestriction,
    "signal-stop": SignalStop,
    "train-ahead": TrainAhead,
    "slippery-rail": SlipperyRail,
    "head-wind": HeadWind,
    "sensor-fault": SensorOutage,
    "bus-outage": BusOutage,
    "node-restart": NodeRestart,
}
"""The class of each kind of disturbance, by its name in scenario files."""
_KIND_OF = {made: kind for kind, made in KINDS.items()}


def as_figures(disturbances: Sequence[Disturbance]) -> list[dict[str, Any]]:
    """The kind and the figures (SI) of each disturbance, for programs; open ends are left out."""
    figures = ((_KIND_OF[type(one)], asdict(one)) for one in disturbances)
    return [{"kind": kind, **{k: v for k, v in found.items() if v is not None}} for kind, found in figures]


def described(disturbances: Sequence[Disturbance]) -> str:
    """A line of text on the disturbances, with speeds in km/h and places in km."""
    return "; ".join(map(_described, disturbances)) or NOTHING


def _described(one: Disturbance) -> str:
    match one:
        case DwellOverrun():
            return f"dwell at {one.stop} {one.delay_s:.0f} s longer"
        case DepartureDelay():
            return f"departure from {one.stop} {one.delay_s:.0f} s late"
        case DelayOnTheWay():
            return f"no faster than {kmh(one.speed_mps):.0f} km/h {_stretch(one)}"
        case AnnouncedRestriction():
            said = f"restriction to {kmh(one.speed_mps):.0f} km/h {_stretch(one)}"
            return f"{said}{_window(one)}, told {one.announced_m:.0f} m ahead"
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


def _stretch(one: DelayOnTheWay | AnnouncedRestriction | SlipperyRail | HeadWind) -> str:
    return f"from km {one.from_m / KM:.1f} to {one.to_m / KM:.1f}"


def _window(one: AnnouncedRestriction) -> str:
    ends = (("from", one.valid_from_s), ("until", one.valid_until_s))
    said = [f" {word} {clock_s:.0f} s" for word, clock_s in ends if clock_s is not None]
    return f", valid{''.join(said)}" if said else ""


def _signal(one: SignalStop | TrainAhead) -> str:
    return f"signal at km {one.at_m / KM:.1f} at danger, seen {one.seen_m:.0f} m ahead"


def _span(one: SensorOutage | BusOutage) -> str:
    return f"at {one.from_s:.0f} s for {one.for_s:.0f} s"
