"""The advice on one section, for a given state or for sensor messages: a leg without the rest of the cab."""

from __future__ import annotations

from das.advice.advice import Advice, Timetable
from das.advice.plan import Plan
from das.advice.planner import Planner
from das.cab.leg import Leg, NoPlanError
from das.cab.withdrawal import Trust, decide
from das.domain.route import Stop
from das.estimate.estimate import Estimate, PositionFix
from das.solver.front import Front
from das.solver.section import Section
from tests.support.fixes import believing


class OneSection:
    """A leg, and the position of the train on it."""

    def __init__(self, front: Front) -> None:
        section = front.section
        start, end = Stop(name="start", position_m=section.start_m), Stop(name="end", position_m=section.end_m)
        self.leg = Leg(start, end, section)
        self.localisation = believing(section.vehicle)
        self.set_front(front)

    @property
    def plan(self) -> Plan | None:
        return self.leg.planner.plan

    def set_front(self, front: Front) -> None:
        self.leg.use(Planner(front.section, front))

    def set_section(self, section: Section) -> None:
        self.leg.use_meanwhile(section)

    def set_timetable(self, timetable: Timetable) -> None:
        self.leg.set_timetable(timetable)

    def set_delay(self, delay_s: float) -> None:
        self.leg.set_delay(delay_s)

    def set_position(self, fix: PositionFix) -> None:
        self.localisation.take(fix)

    def update(self, now_ns: int) -> Advice:
        """The advice at a time (ns since 1970), from the sensor messages received."""
        return self.advise(self.localisation.at(now_ns))

    def advise(self, here: Estimate) -> Advice:
        """The advice for an estimated state; it is withdrawn by the same rules as in the cab."""
        return advised(self.leg, here)


def advised(leg: Leg, here: Estimate) -> Advice:
    """The advice of a leg for an estimated state, with trusted messages only."""
    leg.see(here)
    leg.refresh_goal()
    why = decide(here, Trust(), leg)
    if why is None:
        try:
            return leg.advise(here)
        except NoPlanError as error:
            why = decide(here, Trust(), leg, no_plan=str(error))
    assert why is not None
    return leg.withdraw(here, why)
