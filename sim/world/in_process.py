"""The advice without a bus: the advisor in this process, for many runs."""

from __future__ import annotations

from das.advisor import Advice, Advisor
from das.journey_advisor import JourneyAdvisor
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

    def exchange(self, heard: Heard) -> Advice:
        """The advice for a tick."""
        if heard.measured is not None:
            self._advisor.set_position(heard.measured)
        if heard.delay_s is not None:
            self._advisor.set_delay(heard.delay_s)
        return self._advisor.update(heard.now_ns)

    def tell(self, now_ns: int, told: Told) -> None:
        """Nothing is recorded."""
