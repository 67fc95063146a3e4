"""Displays that show less than the node says: one top speed, or four modes, computed from its message and the line."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from das.advice import kernels
from das.advice.braking import AT_MARK_M, BEGINS_MPS
from das.advice.goal import AT_STOP_M, COASTS_IN_S, OVERSPEED_MPS, TrainState
from das.advice.planner import PlanBasis, Planner
from das.advice.regimes import Regime
from das.cab.heard import judged
from das.cab.leg import AHEAD_DEVIATIONS
from das.cab.situation import Situation
from das.domain.errors import DasError
from das.domain.restriction import Restriction
from das.domain.units import NS
from das.solver.section import Section
from sim.drivers.presentations.presenter import FOUR_MODES, SimplerLook
from sim.world.reduced import ReducedSpeed
from sim.world.service import Service

BEFORE_S: Final = 4.0
"""Time (s) before it is needed at which full braking is shown: advice is valid for 3 s, and brakes need time to act."""
SLOW_MPS: Final = 4.0
"""Speed (m/s) below which `BEFORE_M` and `LEAST_S` count instead of `BEFORE_S`."""
BEFORE_M: Final = 5.0
"""Distance (m) before it is needed at which a slow train is shown full braking; it stops at most so far short."""
LEAST_S: Final = 2.0
"""Least time (s) before it is needed at which a slow train is shown full braking: a driver takes as long to act."""
WEAK_BRAKE_RATIO: Final = 0.6
"""Share of the full effort below which electric braking is shown as coasting: the only brake of the four modes is the
full one, with which the driver would brake too early."""


class SimplerDisplay:
    """What a display of one top speed or of four modes shows on one section, second by second."""

    def __init__(self, section: Section) -> None:
        self.section, self._planner = section, Planner(PlanBasis(section=section))
        self._reduced = ReducedSpeed(section)

    def look(self, advice: Any, departure_ns: int, arrival_ns: int) -> SimplerLook:
        """What is shown of advice (`Advice`, or its message) to a train with these times on the section."""
        mode, next_mode = Regime(int(advice.mode)), Regime(int(advice.next_mode))
        four, after, after_s = mode, FOUR_MODES.get(next_mode, next_mode), advice.next_change_s
        if mode not in (Regime.NONE, Regime.STOP, Regime.DEPART):
            four, after, after_s = self._four(advice, mode, after)
        return SimplerLook(
            time_ns=advice.time_ns,
            valid_until_ns=advice.valid_until_ns,
            mode=int(mode),
            top_speed_mps=self._top_mps(advice, mode, departure_ns, arrival_ns),
            four_mode=int(four),
            next_four_mode=int(after),
            next_four_change_s=after_s,
            advised_speed_mps=advice.advised_speed_mps,
            display_speed_mps=advice.display_speed_mps,
            departure_speed_mps=advice.departure_speed_mps,
        )

    def _top_mps(self, advice: Any, mode: Regime, departure_ns: int, arrival_ns: int) -> float:
        """The top speed (m/s); that of the trip ahead before the departure, NaN for a train that has arrived."""
        if mode is Regime.NONE or (mode is Regime.STOP and advice.s_m > self.section.start_m + AT_STOP_M):
            return math.nan
        if advice.predicted_arrival_ns:  # by the timetable, or as traffic management wants
            arrival_ns = advice.predicted_arrival_ns - round(advice.predicted_deviation_s / NS)
        now_ns = max(advice.time_ns, departure_ns) if mode is Regime.STOP else advice.time_ns
        return self._reduced.shown_mps(max(advice.s_m, self.section.start_m), advice.speed_mps, now_ns, arrival_ns)

    def _four(self, advice: Any, mode: Regime, after: Regime) -> tuple[Regime, Regime, float]:
        """What a display of four modes shows: the mode now and the next one, both replaced if they are not safe."""
        section, planner = self.section, self._planner
        s_m, advised_mps = max(advice.s_m, section.start_m), advice.advised_speed_mps
        planned_m = 0.0 if section.braking is None else section.braking.deviation_m
        ahead_m = min(AHEAD_DEVIATIONS * advice.position_sd_m - planned_m, section.end_m - AT_MARK_M - s_m)
        state = TrainState(advice.time_ns, s_m, advice.speed_mps, max(ahead_m, 0.0))
        excess_mps = state.v_mps - planner.allowed_for(state)
        valid_s = (advice.valid_until_ns - advice.time_ns) * NS
        modes = FourModes(valid_s, planner, state, max(advised_mps, advice.display_speed_mps), excess_mps)
        electric_n = float(section.vehicle.electric_brake_effort_n(np.maximum(advised_mps, 1e-3)))
        weak = mode is Regime.REDUCED_BRAKE and -advice.advised_force_n < WEAK_BRAKE_RATIO * electric_n
        four = Regime.COAST if weak else FOUR_MODES.get(mode, mode)
        guided = advice.guide is not None and int(advice.guide.now.mode) == mode
        if four is Regime.FULL_TRACTION and guided and modes.reaches(advice.guide.now.speed_mps):
            four = Regime.CRUISE
        safe, then, after_s = modes.safe(four, mode), modes.safe(after, after), advice.next_change_s
        if safe is not four or safe is Regime.FULL_BRAKE or then is not after:
            after, after_s = then, max(after_s, valid_s)
        due_s = modes.full_brake_due_s(safe)
        if due_s < after_s or (due_s < math.inf and after is not Regime.FULL_BRAKE):
            after, after_s = Regime.FULL_BRAKE, due_s
        return safe, after, after_s


class SimplerDisplays:
    """The display of a whole day: a `SimplerDisplay` for each section, another one when the restrictions change."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._for: tuple[int, tuple[Restriction, ...]] | None = None
        self._shown: SimplerDisplay | None = None

    def look(self, advice: Any, number: int, told: tuple[Any, ...]) -> SimplerLook | None:
        """What is shown of advice on the section with a number, under the restrictions told; None: nothing can be."""
        if int(advice.mode) == Regime.NONE:
            return None
        service, table = self._service, self._service.timetables[number]
        start_m, end_m = (stop.position_m for stop in service.stops[number : number + 2])
        situation = Situation(
            route=service.route,
            vehicle=service.vehicle,
            level=service.level,
            point_mass=service.scenario.point_mass,
            restrictions=tuple(judged(one) for one in told),
            braking=service.scenario.braking,
        )
        situation = situation.at(advice.time_ns).between(start_m, end_m)
        if self._for != (number, situation.restrictions):
            self._for, self._shown = (number, situation.restrictions), None
        try:
            if self._shown is None:
                self._shown = SimplerDisplay(situation.section_ahead(start_m, end_m, advice.s_m))
        except DasError:  # The node says why there is no advice.
            return None
        return self._shown.look(advice, table.departure_ns, table.arrival_ns)


class FourModes(NamedTuple):
    """Decides which of the four modes a train may be shown: full traction, hold a speed, coast, full brake.

    `held_mps` is the highest speed that the train may be told to hold (m/s), `excess_mps` is how much faster it is than
    allowed (m/s).
    """

    valid_for_s: float
    planner: Planner
    state: TrainState
    held_mps: float
    excess_mps: float

    def safe(self, four: Regime, mode: Regime) -> Regime:
        """The mode `four` if it is safe, else the one of the four modes that the limits and the stop ahead need.

        `mode` is what the other displays show. If they show braking to a train that is too fast, this is full braking,
        however weak theirs is.
        """
        planner, state, v_mps = self.planner, self.state, self.state.v_mps
        too_fast, pulls = self.excess_mps > OVERSPEED_MPS, four is Regime.FULL_TRACTION
        rolls = four is Regime.COAST or too_fast
        gained_mps2 = self._gained_mps2(four)
        gained_mps = max(gained_mps2, 0.0) * self.valid_for_s
        slowly_s = max(BEFORE_M / max(v_mps, 0.1), LEAST_S)
        before_s = slowly_s if v_mps <= SLOW_MPS else BEFORE_S
        soon_mps = max(v_mps, self.held_mps) if four is Regime.CRUISE else v_mps
        late = brakes_late(planner, state, soon_mps + (gained_mps if rolls else 0.0), before_s)
        if late or (too_fast and mode not in (Regime.CRUISE, Regime.COAST)):
            return Regime.FULL_BRAKE
        if pulls and (brakes_late(planner, state, v_mps + gained_mps, before_s) or too_fast):
            return Regime.CRUISE if self._may_creep() and not too_fast else Regime.COAST
        if pulls and self.excess_mps + gained_mps > OVERSPEED_MPS:
            return Regime.CRUISE  # Full traction would soon take the train above the limit.
        above = self.excess_mps + gained_mps > 0.0
        if rolls and above and gained_mps2 * COASTS_IN_S > -self.excess_mps:
            return Regime.CRUISE  # Coasting would not come down to the limit.
        return four

    def _may_creep(self) -> bool:
        """Whether a slow train may be told to hold a speed instead: it would stand short of its stop if it coasted."""
        before_s = max(BEFORE_M / max(self.held_mps, 0.1), LEAST_S)
        return self.state.v_mps <= SLOW_MPS and not brakes_late(self.planner, self.state, self.held_mps, before_s)

    def full_brake_due_s(self, four: Regime) -> float:
        """In how many whole seconds full braking must follow the mode `four`.

        Infinity if it need not while the advice is valid, or if `four` is full braking.
        """
        if four is Regime.FULL_BRAKE:
            return math.inf
        planner, valid_s = self.planner, math.ceil(self.valid_for_s)
        state = self.state._replace(ahead_m=planner.ahead.feared_m(self.state.braked_m) - self.state.s_m)
        gained_mps2 = max(self._gained_mps2(four), 0.0)
        for due_s in range(valid_s):
            held_mps = max(state.v_mps, self.held_mps)
            soon_mps = held_mps if four is Regime.CRUISE else state.v_mps + gained_mps2 * (due_s + 1)
            if brakes_late(planner, state, soon_mps, due_s + 1.0):
                return float(due_s)
        return math.inf

    def reaches(self, speed_mps: float) -> bool:
        """Whether full traction brings the train to a speed (m/s) while the advice is valid."""
        gained_mps2 = max(self._gained_mps2(Regime.FULL_TRACTION), 0.0)
        return self.state.v_mps + gained_mps2 * self.valid_for_s >= speed_mps

    def _gained_mps2(self, four: Regime) -> float:
        """The acceleration (m/s²) of the train with full traction if `four` is that, else when it coasts."""
        full = 1.0 if four is Regime.FULL_TRACTION else 0.0
        return self.planner.ahead.accelerates_mps2(full, self.state.s_m, self.state.v_mps)


def brakes_late(planner: Planner, state: TrainState, v_mps: float, within_s: float) -> bool:
    """Whether full braking comes too late for the limits and the stop ahead if it begins after `within_s` (s).

    Until then the train keeps the speed `v_mps`.
    """
    section, from_m = planner.section, state.braked_m
    lowest_w = kernels.lowest_w(from_m, from_m + v_mps * within_s, section.node_m, planner.allowed_w)
    return math.sqrt(lowest_w) < min(v_mps, planner.allowed_mps(state.s_m)) - BEGINS_MPS
