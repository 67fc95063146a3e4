"""The drivers by name."""

from __future__ import annotations

from sim.drivers.cab import Driver
from sim.drivers.human import HumanDriver
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass
from sim.drivers.knowledge import LineKnowledge
from sim.drivers.own_class import OwnDriver
from sim.drivers.parameters import HumanParameters
from sim.drivers.rules import FastDriver, PerfectDriver, RmsDriver, TimetableDriver

__all__ = ["DriverKind", "make_driver"]


def make_driver(
    kind: DriverKind | OwnClass,
    line: LineKnowledge,
    *,
    parameters: HumanParameters | None = None,
    friction: FrictionPolicy = FrictionPolicy.AS_MEASURED,
    seed: int = 0,
    stream: int = 0,
) -> Driver:
    """Make a driver for a line.

    Only the human driver uses the parameters, the friction policy and the stream (one per driver of a seed). A class of
    the user's is given the seed as well. Raises DasError for a class that cannot be used.
    """
    if isinstance(kind, OwnClass):
        return OwnDriver(kind, line, seed)
    if kind is DriverKind.HUMAN:
        return HumanDriver(line, parameters, friction=friction, seed=seed, stream=stream)
    if kind is DriverKind.PERFECT:
        return PerfectDriver(line)
    ruled = {DriverKind.FAST: FastDriver, DriverKind.RMS: RmsDriver, DriverKind.TIMETABLE: TimetableDriver}
    return ruled[kind](line)
