"""Advice for a journey of several sections: one advisor a section, and which of them speaks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from das.advice.advisor import AT_STOP_M, LOST_BEYOND_M, Advice, Advisor, Timetable
from das.advice.plan import Plan
from das.domain.errors import DasError
from das.estimate.localisation import Estimate, Localisation, PositionFix

BACK_M = 200.0
"""A train that has begun a section is on the one before again only where it is heard further back than this."""


class JourneyAdvisor:
    """Hands what is heard to the advisor of the section the train is on, and asks it.

    A section ends when the train stands at its stop. A train heard for the first time is on the section that its
    position says. `localisation`: one that has heard this train already.
    """

    def __init__(self, advisors: Sequence[Advisor], localisation: Localisation | None = None) -> None:
        self.advisors = tuple(advisors)
        self._localisation = localisation or Localisation(self.advisors[0].section.vehicle)
        self.here = Estimate(time_ns=0)
        """The state behind the last advice."""
        self._index: int | None = None

    @property
    def index(self) -> int:
        """Which section the train is on (before the first position: the first)."""
        return self._index or 0

    @property
    def current(self) -> Advisor:
        """The advisor of the section the train is on."""
        return self.advisors[self.index]

    @property
    def has_position(self) -> bool:
        return self._localisation.heard

    @property
    def plan(self) -> Plan | None:
        """The plan behind the last advice."""
        return self.current.plan

    def set_timetables(self, timetables: Sequence[Timetable]) -> None:
        """One timetable a section; raises DasError where a section has no time or begins before the last has ended."""
        for i, (before, after) in enumerate(pairwise(timetables), 1):
            if after.departure_ns < before.arrival_ns:
                raise DasError(f"timetable: the departure from stop {i + 1} is before the arrival there")
        for timetable in timetables:
            timetable.check()
        for advisor, timetable in zip(self.advisors, timetables, strict=True):
            advisor.set_timetable(timetable)
        self._index = None
        self._place()

    def set_position(self, fix: PositionFix) -> None:
        """Take over what sensors say; the train is on the section that the state makes of it."""
        self._localisation.take(fix)
        self._place()

    def set_delay(self, delay_s: float) -> None:
        """Take over the operator's word on the delay."""
        for advisor in self.advisors:
            advisor.set_delay(delay_s)

    def locate(self, now_ns: int) -> None:
        """Let the section's advisor know where the train is at a moment."""
        self.here = self._localisation.at(now_ns)
        self.current.see(self.here)

    def update(self, now_ns: int) -> Advice:
        """The advice at a moment."""
        self.locate(now_ns)
        return self.advise()

    def advise(self) -> Advice:
        """The advice for where the train was located last."""
        return self.current.advise(self.here)

    def _place(self) -> None:
        if self._localisation.moment is not None:
            self._index = self._section_of(*self._localisation.moment)

    def _section_of(self, s_m: float, stands: bool) -> int:
        """By position; at a stop the section that ends there until the train stands, then the one that begins there.

        A train that runs through its stop stays with the section it has not ended, until it stands or is far away; one
        that has begun a section is not put back by a position that scatters.
        """
        ends_m = [advisor.section.end_m for advisor in self.advisors[:-1]]
        before = self._index
        index = sum(s_m >= end_m - (AT_STOP_M if stands else 0.0) for end_m in ends_m)
        if before is None:
            return index
        if before == index + 1 and s_m >= ends_m[index] - BACK_M:
            return before
        if not stands and before == index - 1 and s_m < ends_m[before] + LOST_BEYOND_M:
            return before
        return index
