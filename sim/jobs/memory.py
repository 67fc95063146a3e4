"""The services that a worker has solved: the next run solves one only where it is another."""

from __future__ import annotations

from das.domain.losses import Level
from sim.world.scenario import Scenario
from sim.world.service import Service, prepare_service


class ServiceMemory:
    """Keeps the last few services, because each holds fronts of a hundred megabytes."""

    def __init__(self, most: int = 1) -> None:
        self._most = most
        self._kept: list[tuple[Level | None, Service]] = []

    def of(self, scenario: Scenario, level: Level | None) -> Service:
        """The scenario's service, planned with a level of losses [the vehicle's].

        Raises DasError for anything unusable, InfeasibleError where the train cannot run.
        """
        for i, (kept_level, service) in enumerate(self._kept):
            if kept_level == level and service.plans(scenario):
                self._kept.append(self._kept.pop(i))
                return service.on(scenario)
        solved = prepare_service(scenario, level=level)
        self._kept = [*self._kept, (level, solved)][-self._most :]
        return solved.on(scenario)
