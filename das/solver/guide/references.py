"""Finished references of a section: schedules of a train that departs at its start, for a ladder of times to the end.

They are computed beforehand (`precompute.tables.writing`), because that takes too long on board.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from das.solver.guide.schedule import Phase, Scheduled, settled
from das.solver.section import Section
from das.solver.state import least_time_s

NEAR_S, NEAR_AT_PLACE_S = 0.7, 0.3
"""The largest deviations (s) from the wanted time at which an arrival, or the passing of a place with a window, is near
enough."""
LATE_RATIO, EARLY_RATIO, EARLY_S = 3.0, 0.7, 2.0
"""The cost of a second of lateness and the value of a second of earliness, as multiples of the price of time, and the
largest earliness (s) that has a value. An early run was planned with too high a price."""


@overload
def lateness_s(late_s: float) -> float: ...
@overload
def lateness_s(late_s: NDArray[np.float64]) -> NDArray[np.float64]: ...
def lateness_s(late_s: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """The cost of a lateness (s; early < 0), in seconds at the price of time."""
    return LATE_RATIO * np.maximum(late_s, 0.0) + EARLY_RATIO * np.clip(late_s, -EARLY_S, 0.0)


class Finished(NamedTuple):
    """A finished schedule: time (s) and energy (J) from standstill at the start, price of time (W), and phases."""

    time_s: float
    energy_j: float
    lambda_w: float
    phases: tuple[Phase, ...]


class References:
    """The finished schedules of a section, the quickest first."""

    def __init__(self, finished: Sequence[Finished]) -> None:
        self.finished = tuple(finished)
        columns = np.array([one[:3] for one in self.finished])
        self._time_s, self._energy_j, self._lambda_w = columns.T

    def best(self, time_s: float) -> int | None:
        """The number of the schedule with the least energy plus cost of lateness; None beyond the slowest time."""
        late_s = self._time_s - time_s
        if late_s[-1] < -NEAR_S:
            return None
        price_w = self._lambda_w[np.abs(late_s).argmin()]
        return int((self._energy_j + price_w * lateness_s(late_s)).argmin())

    def quickest_s(self, dearest_w: float) -> float:
        """The time (s) of the quickest schedule with a price of time of at most `dearest_w`; infinity if none."""
        return float(self._time_s[self._lambda_w <= dearest_w].min(initial=np.inf))

    def departing(self, section: Section, s_m: float, v_mps: float, time_s: float) -> Scheduled | None:
        """The best schedule for a time, as kept by a train that departs near the start; None if none is slow enough.

        Raises InfeasibleError if the train stalls, DasError for a state outside the section.
        """
        ahead_s = float(section.fastest_run.time_to_go_s[0]) - least_time_s(section, s_m, v_mps)
        number = self.best(time_s + ahead_s)
        if number is None:
            return None
        found = self.finished[number]
        return Scheduled(*settled(section, found.phases, s_m, v_mps), found.lambda_w, finished=True)
