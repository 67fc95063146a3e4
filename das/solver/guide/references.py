"""Finished references of a section: schedules of a train that departs at its start, for a ladder of times to the end.

They are made beforehand, longer than there is time for in a cab (`precompute.tables.writing`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from das.solver.guide.lateness import NEAR_S, lateness_s
from das.solver.guide.phases import Phase
from das.solver.guide.schedule import Schedule, Scheduled
from das.solver.kernels.tuples import KnownRun
from das.solver.section import Section
from das.solver.state import least_time_s


class Finished(NamedTuple):
    """A finished schedule: its time (s) and energy (J) from standstill at the start, its price of time (W), phases."""

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
        """The number of the one of the least energy and price of its lateness; None for a time beyond the slowest."""
        late_s = self._time_s - time_s
        if late_s[-1] < -NEAR_S:
            return None
        price_w = self._lambda_w[np.abs(late_s).argmin()]
        return int((self._energy_j + price_w * lateness_s(late_s)).argmin())

    def quickest_s(self, dearest_w: float) -> float:
        """The time (s) of the quickest one whose price of time is at most this (W); infinity if none is so cheap."""
        return float(self._time_s[self._lambda_w <= dearest_w].min(initial=np.inf))

    def departing(
        self, section: Section, back_share: float, s_m: float, v_mps: float, time_s: float
    ) -> Scheduled | None:
        """The best schedule for a time, as a train keeps to it that departs near the start; None if none is so slow.

        `back_share`: see `Schedule`. Raises InfeasibleError if the train stalls, DasError for a state outside the
        section.
        """
        ahead_s = float(section.fastest_run.time_to_go_s[0]) - least_time_s(section, s_m, v_mps)
        number, nodes = self.best(time_s + ahead_s), len(section.node_m)
        if number is None:
            return None
        found = self.finished[number]
        raw = Schedule(
            section=section, phases=found.phases, known=KnownRun(np.zeros(nodes), np.zeros(nodes)),
            back_share=back_share,
        )  # fmt: skip
        return Scheduled(*raw.settled(s_m, v_mps), found.lambda_w, finished=True)
