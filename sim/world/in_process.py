"""The advice without a bus: the advisor in this process, for many runs."""

from __future__ import annotations

from das.advisor import Advice, Advisor
from das.calibration import Calibrator
from das.journey_advisor import JourneyAdvisor
from das.localisation import Quality
from sim.world.link import Heard, Told
from sim.world.service import Service


class InProcess:
    """Asks the advisor directly; nothing is recorded."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self.restart()

    def restart(self) -> None:
        """Begin with an advisor that has heard nothing but the timetable."""
        self._advisor = JourneyAdvisor([Advisor(front) for front in self._service.fronts])
        self._advisor.set_timetables(self._service.timetables)
        says_efforts = self._service.scenario.sensors.force_noise_ratio is not None
        self.calibrator = Calibrator(self._service.route, self._service.vehicle) if says_efforts else None

    def exchange(self, heard: Heard) -> Advice:
        """The advice for a tick."""
        if heard.measured is not None:
            self._advisor.set_position(heard.measured)
        self._calibrate(heard)
        if heard.delay_s is not None:
            self._advisor.set_delay(heard.delay_s)
        return self._advisor.update(heard.now_ns)

    def _calibrate(self, heard: Heard) -> None:
        if self.calibrator is None:
            return
        if heard.measured is not None:
            fix = heard.measured
            sure = fix.quality is not Quality.DEGRADED
            self.calibrator.set_position(fix.time_ns, fix.s_m, fix.speed_mps, usable=sure)
        if heard.effort is not None:
            self.calibrator.set_effort(heard.effort)

    def tell(self, now_ns: int, told: Told) -> None:
        """Nothing is recorded."""
