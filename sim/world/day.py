"""One day of a service: what the seed lets happen, and the true train on the true line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

from das.domain.conditions import Conditions
from sim.drivers.cab import Driver
from sim.drivers.kinds import DriverKind, FrictionPolicy, OwnClass
from sim.drivers.parameters import HumanParameters
from sim.drivers.population import Participant, stream_of
from sim.drivers.registry import make_driver
from sim.plant.plant import Patch, Plant
from sim.recording.inputs import sha256
from sim.world.disturbances import DepartureDelay, Disturbance, HeadWind, SlipperyRail, as_figures
from sim.world.service import Service

_Kind = TypeVar("_Kind")


@dataclass(frozen=True, kw_only=True, eq=False)
class Day:
    """Plan and truth of the day that belongs to one seed.

    `conditions` are those of the true train and line, without what happens on the way. `held_s` is by how much the
    departure from each stop is held up. `human` are the parameters of the driver, if a human drives, and `stream` is
    the number of the driver's own random stream on this day. `drawn` is everything that was drawn, in SI, for programs:
    the disturbances, what the scenario says about the truth, and the human.
    """

    service: Service
    seed: int
    plant: Plant
    conditions: Conditions
    disturbances: tuple[Disturbance, ...]
    held_s: tuple[float, ...]
    human: HumanParameters
    drawn: Mapping[str, Any]
    stream: int = 0

    def driver(self, kind: DriverKind | OwnClass, friction: FrictionPolicy = FrictionPolicy.AS_MEASURED) -> Driver:
        """Make a driver of a kind, or of a class of the user's, for this day; DasError where it cannot be made.

        Only a human driver uses the friction policy.
        """
        human, stream = self.human, self.stream
        return make_driver(kind, self.service.line, parameters=human, friction=friction, seed=self.seed, stream=stream)

    def of(self, kind: type[_Kind]) -> tuple[_Kind, ...]:
        """The day's disturbances of one kind."""
        return tuple(one for one in self.disturbances if isinstance(one, kind))


def make_day(service: Service, seed: int, participant: Participant | None = None) -> Day:
    """Draw what happens on the day of a seed. The human driver is the participant, or else drawn by the seed as well.

    Raises DasError for what cannot happen on this line or with this train, and for a participant whom the scenario
    would change from day to day.
    """
    disturbances = service.scenario.day(seed)
    human, of_human = service.scenario.human.of(seed, participant, service.scenario.source)
    truth = service.scenario.truth.draw(seed)
    return Day(
        service=service,
        seed=seed,
        plant=_plant(service, truth, disturbances),
        conditions=truth,
        disturbances=disturbances,
        held_s=_held_s(service, disturbances),
        human=human,
        stream=stream_of(participant),
        drawn={
            "disturbances": as_figures(disturbances),
            "truth": asdict(truth),
            "human": of_human,
            **_population(participant),
        },
    )


def with_disturbances(day: Day, disturbances: Sequence[Disturbance]) -> Day:
    """The same day with other restrictions or news; disturbances of train or line must be drawn with the day."""
    found = tuple(disturbances)
    return replace(day, disturbances=found, drawn={**day.drawn, "disturbances": as_figures(found)})


def _population(participant: Participant | None) -> dict[str, dict[str, str]]:
    """The population of a participant by its id, and the hash of its file."""
    if participant is None:
        return {}
    population = participant.population
    return {"population": {"id": population.id, "sha256": sha256(population.source)}}


def _plant(service: Service, conditions: Conditions, disturbances: Sequence[Disturbance]) -> Plant:
    vehicle, level = service.scenario.truth.train(service.vehicle, service.level)
    first_m = service.stops[0].position_m
    patches = []
    for x in disturbances:
        if isinstance(x, SlipperyRail | HeadWind):
            # A patch that begins at the first stop lies under the whole train, which stands there.
            patch = Patch(from_m=x.from_m if x.from_m > first_m else -math.inf, to_m=x.to_m)
            what = (
                {"adhesion_ratio": x.adhesion_ratio} if isinstance(x, SlipperyRail) else {"head_wind_mps": x.wind_mps}
            )
            patches.append(replace(patch, **what))
    return Plant(service.route, vehicle, level=level, conditions=conditions, patches=patches)


def _held_s(service: Service, disturbances: Sequence[Disturbance]) -> tuple[float, ...]:
    return tuple(
        sum(x.delay_s for x in disturbances if isinstance(x, DepartureDelay) and _same(x.stop, stop.name))
        for stop in service.stops
    )


def _same(name: str, other: str) -> bool:
    return name.casefold() == other.casefold()
