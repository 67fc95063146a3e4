"""A service on one day: what a seed lets happen, and the true train on the true line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

from sim.drivers.cab import Driver
from sim.drivers.parameters import HumanParameters
from sim.drivers.registry import DriverKind, make_driver
from sim.plant import Patch, Plant
from sim.world.disturbances import DepartureDelay, Disturbance, HeadWind, SlipperyRail
from sim.world.service import Service

_Kind = TypeVar("_Kind")


@dataclass(frozen=True, kw_only=True, eq=False)
class Day:
    """Plan and truth for one seed; `held_s` per stop: by how much its departure is held up.

    `human` is who drives where a human does, `human_drawn` what the scenario says of him.
    """

    service: Service
    seed: int
    plant: Plant
    disturbances: tuple[Disturbance, ...]
    held_s: tuple[float, ...]
    human: HumanParameters
    human_drawn: Mapping[str, float]

    def driver(self, kind: DriverKind) -> Driver:
        """A driver for the day."""
        return make_driver(kind, self.service.line, parameters=self.human, seed=self.seed)

    def of(self, kind: type[_Kind]) -> tuple[_Kind, ...]:
        """The day's disturbances of one kind."""
        return tuple(one for one in self.disturbances if isinstance(one, kind))


def make_day(service: Service, seed: int) -> Day:
    """Draw what happens; raises DasError for what cannot be on this line or with this train."""
    disturbances = service.scenario.day(seed)
    human, drawn = service.scenario.human.draw(seed)
    return Day(
        service=service,
        seed=seed,
        plant=_plant(service, disturbances),
        disturbances=disturbances,
        held_s=_held_s(service, disturbances),
        human=human,
        human_drawn=drawn,
    )


def _plant(service: Service, disturbances: Sequence[Disturbance]) -> Plant:
    truth = service.scenario.truth
    vehicle, level = truth.train(service.vehicle, service.level)
    first_m = service.stops[0].position_m
    patches = []
    for x in disturbances:
        if isinstance(x, SlipperyRail | HeadWind):
            # What begins at the first stop is under the whole train that stands there.
            patch = Patch(from_m=x.from_m if x.from_m > first_m else -math.inf, to_m=x.to_m)
            what = (
                {"adhesion_ratio": x.adhesion_ratio} if isinstance(x, SlipperyRail) else {"head_wind_mps": x.wind_mps}
            )
            patches.append(replace(patch, **what))
    return Plant(service.route, vehicle, level=level, conditions=truth.conditions, patches=patches)


def _held_s(service: Service, disturbances: Sequence[Disturbance]) -> tuple[float, ...]:
    return tuple(
        sum(x.delay_s for x in disturbances if isinstance(x, DepartureDelay) and _same(x.stop, stop.name))
        for stop in service.stops
    )


def _same(name: str, other: str) -> bool:
    return name.casefold() == other.casefold()
