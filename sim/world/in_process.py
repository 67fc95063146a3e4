"""The advice without a bus: the same cab as in the node, in this process, for many runs."""

from __future__ import annotations

from dataclasses import replace

from das.advice.advice import Advice
from das.advice.coach.settings import CoachSettings
from das.advice.settings import AdviceSettings
from das.cab.cab import Cab, CabSettings
from das.cab.heard import STATES, Heard, Kind
from das.cab.orders import Post
from das.cab.outputs import Output
from das.cab.situation import Situation
from das.cab.trains import Trains
from sim.world.loop import Tick, Told
from sim.world.service import Service

TRAIN = "train"
BEFORE_S = 10.0
"""The journey is told this long before the timetable's departure."""


class InProcess:
    """Tells a cab what the bus would, at the same moments of its clock; nothing is recorded."""

    def __init__(self, service: Service, *, coach: bool = False) -> None:
        self._service, self._coach = service, coach
        self._kept: dict[Kind, Heard] = {}
        self._judged_ns = 0
        self.said: list[Output] = []
        """What the cab said at the last tick, before the advice."""
        self.restart()
        self._hear(service.journey(TRAIN, service.moment_ns(-BEFORE_S)))

    def restart(self) -> None:
        """Begin with a cab that has heard nothing but what the bus keeps: journey, restrictions, targets."""
        service = self._service
        situation = Situation(
            route=service.route,
            vehicle=service.vehicle,
            level=service.level,
            point_mass=service.scenario.point_mass,
            braking=service.scenario.braking,
        )
        trains = Trains(service.vehicle, service.vehicle)
        post = Post(train=TRAIN, route=service.route, trains=trains, reverse=service.scenario.reverse)
        advice = AdviceSettings(coach=CoachSettings(enabled=self._coach))
        calibrate = service.scenario.sensors.force_noise_ratio is not None
        self.cab = Cab(post, situation, service.onboard, CabSettings(calibrate=calibrate, advice=advice))
        """The on-board system."""
        self._judged_ns = 0
        for heard in list(self._kept.values()):
            self._hear(heard)

    def exchange(self, tick: Tick) -> Advice:
        """The advice for a tick."""
        for heard in tick.told:
            self._hear(heard)
        *self.said, advice = self.cab.tick(tick.now_ns)
        self._judged_ns = tick.now_ns
        assert isinstance(advice, Advice)
        return advice

    def tell(self, now_ns: int, told: Told) -> None:
        """Nothing is recorded in this process."""

    def _hear(self, heard: Heard) -> None:
        if heard.kind in STATES:
            self._kept[heard.kind] = heard
        self.cab.hear(replace(heard, heard_ns=self._judged_ns))
