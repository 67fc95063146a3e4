"""The advice without a bus: the advisor in this process, for many runs."""

from __future__ import annotations

from das.advice.advisor import Advice
from das.cab.fronts import Situation
from das.cab.trip import Target, Trip
from das.domain.route import Restriction, Stop
from das.estimate.calibration import Calibrator, Recalibration
from das.estimate.localisation import Quality
from sim.world.link import Heard, Told
from sim.world.service import Service


class InProcess:
    """Asks the node's trip directly; nothing is recorded."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._restrictions: tuple[Restriction, ...] | None = None
        self._targets: tuple[Target, ...] = ()
        self.restart()

    def restart(self) -> None:
        """Begin with a trip that has heard nothing but what the bus keeps: journey, restrictions, targets."""
        service = self._service
        situation = Situation(route=service.route, vehicle=service.vehicle, level=service.level)
        self._trip = Trip(situation, service.onboard, background=False)
        if self._restrictions is not None:
            self._trip.set_restrictions(self._restrictions)
        self._trip.begin(
            [Stop(name=stop.name, position_m=stop.position_m) for stop in service.stops], service.timetables
        )
        self._trip.set_targets(self._targets)
        says_efforts = service.scenario.sensors.force_noise_ratio is not None
        self.calibrator = Calibrator(service.route, service.vehicle) if says_efforts else None
        self._recalibration = Recalibration()

    def exchange(self, heard: Heard) -> Advice:
        """The advice for a tick."""
        if heard.measured is not None:
            self._trip.set_position(heard.measured)
        self._calibrate(heard)
        if heard.delay_s is not None:
            self._trip.set_delay(heard.delay_s)
        if heard.restrictions is not None:
            self._restrictions = tuple(Restriction(**x._asdict()) for x in heard.restrictions)
            self._trip.set_restrictions(self._restrictions)
        if heard.targets is not None:
            self._targets = heard.targets
            self._trip.set_targets(self._targets)
        self._trip.take_news()
        return self._trip.update(heard.now_ns)

    def _calibrate(self, heard: Heard) -> None:
        if self.calibrator is None:
            return
        if heard.measured is not None:
            fix = heard.measured
            sure = fix.quality in (Quality.UNKNOWN, Quality.GOOD)
            self.calibrator.set_position(fix.time_ns, fix.s_m, fix.speed_mps, usable=sure)
        if heard.effort is not None:
            self.calibrator.set_effort(heard.effort)
        conditions = self._recalibration.due(self.calibrator.estimates, heard.now_ns)
        if conditions is not None:
            self._trip.set_conditions(conditions)

    def tell(self, now_ns: int, told: Told) -> None:
        """Nothing is recorded."""
