"""The certificate of a journey: a lower bound of the energy of every run that keeps its windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from das.domain.trajectory import Trajectory
from das.offline.bound.certificate import NOT_FOUND, Certificate, behind_fastest, bound_of, fastest_is_ahead
from das.offline.bound.relaxation import Task
from das.offline.journey.sections import DriveLink, JourneySection, Timeline, WaitLink
from das.solver import tolerances as tol

Floats = NDArray[np.float64]


NO_PRICE: Final = (
    "a part of the journey has no price of time: it is run as fast as possible, or its time is not split optimally"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class PricedTimeline:
    """A timeline with a price of time (W) for each of its links.

    Any prices prove a bound; those of the optimum prove a high one.
    """

    sections: tuple[JourneySection, ...]
    timeline: Timeline
    price_w: Floats

    def certificate(self, runs: Sequence[Trajectory]) -> Certificate:
        """The certificate of a journey whose sections are driven by `runs`.

        The bound is the least of energy + price·time of every section, less the prices times the longest times that the
        windows allow (`docs/explanation/bounds.md`). Windows count with the tolerance to which a plan keeps them.
        """
        allowed_s = self._end_s() - self._begin_s()
        if not np.isfinite(self.price_w).all():
            return Certificate(bound_j=math.nan, allowed_s=allowed_s, reason=NO_PRICE)
        total_j = -self._most_for_time_j()
        if math.isfinite(total_j):
            total_j += sum(self._section_j(index, run) for index, run in enumerate(runs))
        reason = "" if math.isfinite(total_j) else NOT_FOUND
        return Certificate(bound_j=total_j if not reason else math.nan, allowed_s=allowed_s, reason=reason)

    def _begin_s(self) -> float:
        return self.timeline.events[0].window.earliest_s

    def _end_s(self) -> float:
        return self.timeline.events[-1].window.latest_s

    def _most_for_time_j(self) -> float:
        """The largest sum of prices times the times between events that the windows allow (J)."""
        events, links = self.timeline.events, self.timeline.links
        # A train may wait longer than it has to, so a wait must not be rewarded.
        is_wait = np.array([isinstance(link, WaitLink) for link in links])
        price_w = np.where(is_wait, np.maximum(self.price_w, 0.0), self.price_w)
        dwell_s = np.array([link.least_s if isinstance(link, WaitLink) else 0.0 for link in links])
        # Σ price·(t after − t before) by events: each takes the more expensive end of its window.
        weight_w = np.append(price_w, 0.0) - np.append(0.0, price_w)
        total_j = -float(price_w @ dwell_s)
        for event, weight in zip(events, weight_w, strict=True):
            if weight != 0.0:
                earliest_s = event.window.earliest_s - tol.TIME_TOLERANCE_S
                latest_s = event.window.latest_s + tol.TIME_TOLERANCE_S
                total_j -= float(weight) * (earliest_s if weight > 0 else latest_s)
        return total_j

    def _section_j(self, index: int, run: Trajectory) -> float:
        """A lower bound of energy + price·time (J) over a section."""
        journey_section = self.sections[index]
        section = journey_section.whole
        price_w = np.empty(len(section.step_m))
        for link, price in zip(self.timeline.links, self.price_w, strict=True):
            if isinstance(link, DriveLink) and link.section == index:
                price_w[journey_section.places[link.place] : journey_section.places[link.place + 1]] = price
        others_s = sum(_quickest_s(other) for other in self.sections if other is not journey_section)
        waits_s = sum(link.least_s for link in self.timeline.links if isinstance(link, WaitLink))
        task = Task(
            section=section,
            line=section,
            envelope_mps=section.envelope_mps,
            speeds_mps=run.v_mps,
            allowed_s=self._end_s() - self._begin_s() - others_s - waits_s + 2 * tol.TIME_TOLERANCE_S,
            price_w=price_w,
        )
        if fastest_is_ahead(task):
            task = behind_fastest(task)
        return bound_of(task, run.force_el_n, 0.0)


def _quickest_s(section: JourneySection) -> float:
    """The time (s) of a section along its envelope; no run is faster."""
    return float(section.whole.elapsed_s(section.whole.envelope_mps + tol.SPEED_TOLERANCE_MPS)[-1])
