"""The reduced maximum speed that the RMS presentation of the advice shows."""

from __future__ import annotations

import math

from das.domain.errors import DasError
from das.solver.section import build_section
from precompute.baselines import reduced_maximum_speed
from sim.plant import PlantState
from sim.world.calls import Calls
from sim.world.service import Service

JUDGED_EVERY_S = 30.0
LEAST_LEFT_S = 1.0


class ReducedSpeed:
    """The one highest speed with which the timetable is kept from here, judged anew every while and at every stop."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._judged_s, self._speed_mps = -math.inf, math.nan
        self._judged_at: tuple[int, bool] | None = None

    def at(self, state: PlantState, calls: Calls) -> float:
        """That speed (m/s; NaN before there was one)."""
        at = (calls.section, calls.waits)  # on departure as well
        if state.time_s - self._judged_s >= JUDGED_EVERY_S or at != self._judged_at:
            self._judged_at = at
            self._judged_s, self._speed_mps = state.time_s, self._judged_mps(state, calls)
        return self._speed_mps

    def _judged_mps(self, state: PlantState, calls: Calls) -> float:
        service = self._service
        left_s = service.clock_s(calls.timetable.arrival_ns) - state.time_s
        try:
            ahead = build_section(
                service.route,
                service.vehicle,
                level=service.level,
                start_m=state.s_m,
                end_m=calls.stop_m,
                start_speed_mps=state.speed_mps,
            )
            speed_mps = reduced_maximum_speed(ahead, max(left_s, LEAST_LEFT_S)).cruise_speed_mps
        except DasError:  # too fast for what comes, or nothing left to plan: what was said before still holds
            return self._speed_mps
        return self._speed_mps if speed_mps is None else speed_mps
