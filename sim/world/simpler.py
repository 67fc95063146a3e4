"""Displays that show only a part of the advice (one top speed, or four modes), and a sheet made before the run.

The top speed is the reduced maximum speed, with which a train that brakes gently keeps the timetable. A display shows
this speed in whole steps, and a lower step from the place where braking for a lower speed begins.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from das.advice import kernels
from das.advice.braking import AT_MARK_M, BEGINS_MPS
from das.advice.goal import AT_STOP_M, LONGEST_RATIO, TrainState
from das.advice.planner import BRAKED_EARLY_S, Planner
from das.advice.regimes import TRACTION, InstructionKind, Regime, departure_regime
from das.advice.shown import OVERSPEED_MPS, steady_step, step_below
from das.cab.heard import judged
from das.cab.leg import AHEAD_DEVIATIONS
from das.domain.braking import ServiceBraking
from das.domain.errors import DasError
from das.domain.journey import Window
from das.domain.restriction import Restriction
from das.domain.units import KMH, NS
from das.solver.front import Front
from das.solver.kernels.driving import FULL_BRAKES, braking_envelope
from das.solver.kernels.forces import largest_gain, mean_resistance, on_supply
from das.solver.kernels.roll_out import fastest_roll_out
from das.solver.kernels.tuples import LineArrays
from das.solver.section import Section, with_braking
from precompute.sheet import SectionSheet, SheetLine, section_sheet
from sim.drivers.cab import AdviceView
from sim.drivers.kinds import Presentation
from sim.drivers.presentations.presenter import FOUR_MODES, SimplerLook
from sim.plant.kernels import PlantState
from sim.plant.plant import Efforts
from sim.world.service import Day, Service
from sim.world.surroundings import Calls

EASY_BRAKING_MPS2: Final = 0.5
"""The deceleration of comfortable service braking (assumption)."""
JUDGED_EVERY_S: Final = 30.0
"""Interval (s) at which the reduced maximum speed is computed."""
SLOWEST_MPS: Final = 20.0 * KMH
"""Lowest speed shown (m/s), except under a lower limit and in the last metres before a stop, where it is halved,
repeatedly if necessary."""
HALVINGS: Final = 12
"""Number of halvings of the interval in the search for the reduced maximum speed."""
COASTS_IN_S: Final = 5.0
"""Time (s) within which coasting down to a limit is advised; otherwise the train brakes."""
BELOW_RATIO: Final = 0.999
"""Divisor of the allowed speed: the largest initial speed of the computation, for a train that is too fast."""

Floats = NDArray[np.float64]
LEVEL_MPS = 1e-6
"""Decrease (m/s) of speed over an interval below which a curve counts as level."""


class Staircase:
    """The top speed to show at each position of a section, under a curve of gentle braking.

    The speed shown is never above the limit over the train, nor above the curve. If the reduced maximum speed is above
    the curve, the speed at the foot of the curve is shown instead: the next lower limit, or before a stop the slowest
    speed. The speed 0 of a stop itself is not shown: the driver finds the mark without the display, and a train
    that stands short of the mark must still be able to move up. In the last metres, where full braking from the slowest
    speed would no longer stop the train at the mark, that speed is halved until it would.

    If the train is so much slower than the curve that speeding up saves time, the display shows a speed that the train
    can reach before it must brake, until the curve has fallen to that speed.
    """

    def __init__(self, section: Section, curve_mps: Floats, braking_mps2: float) -> None:
        self._section, self._braking_mps2 = section, braking_mps2
        self._falls = np.diff(curve_mps) < -LEVEL_MPS
        # Where the curve rises with the limit, an interval has the higher speed of the next interval's start.
        starts = np.where(self._falls, curve_mps[:-1], curve_mps[1:])
        self._start_w, self._end_w = starts**2, curve_mps[1:] ** 2
        self._foot_mps, self._full_w = _feet(self._falls, curve_mps[1:]), section.envelope_mps**2
        self._judged_mps = self._shown_mps = math.nan

    def at(self, s_m: float, v_mps: float, judged_mps: float) -> float:
        """The speed to show (m/s) at a position and speed of the train; `judged_mps` is the reduced maximum speed."""
        i = int(kernels.interval(self._section.node_m, s_m))
        limit_mps = float(self._section.limit_mps[i])
        # In whole steps; a small change of the reduced maximum speed does not change the speed shown.
        self._judged_mps = steady_step(judged_mps, self._judged_mps)
        free_mps = min(self._judged_mps, step_below(limit_mps))
        curve_mps = self.curve_mps(s_m)
        # While a train slows down, the shown speed does not rise as long as the train is faster than the new speed.
        slows = self._falls[i] and v_mps > free_mps > self._shown_mps
        if curve_mps >= free_mps:
            self._shown_mps = self._shown_mps if slows else free_mps
        else:
            next_mps = float(self._foot_mps[i])  # the next lower limit; 0 before a stop
            foot_mps = min(step_below(next_mps) if next_mps > 0 else self._slow_mps(s_m), free_mps)
            if not foot_mps < self._shown_mps <= min(curve_mps, free_mps):
                reached_mps = self._worth_reaching(i, v_mps, curve_mps)
                self._shown_mps = max(foot_mps, min(step_below(reached_mps), free_mps))
        return min(self._shown_mps, limit_mps)

    def curve_mps(self, s_m: float) -> float:
        """The highest speed (m/s) at a place from which gentle braking obeys every limit and stop ahead."""
        section = self._section
        i = int(kernels.interval(section.node_m, s_m))
        share = min(max((s_m - section.node_m[i]) / (section.node_m[i + 1] - section.node_m[i]), 0.0), 1.0)
        return math.sqrt(self._start_w[i] + (self._end_w[i] - self._start_w[i]) * share)

    def _slow_mps(self, s_m: float) -> float:
        """The slowest speed shown, halved until full braking from it stops the train at the mark."""
        full_mps = math.sqrt(kernels.linear(self._section.node_m, self._full_w, s_m))
        speed_mps = SLOWEST_MPS
        while speed_mps > full_mps and speed_mps > 0:
            speed_mps = step_below(0.5 * speed_mps)
        return speed_mps

    def _worth_reaching(self, i: int, v_mps: float, curve_mps: float) -> float:
        """The speed (m/s) that a train can reach before it must brake; 0 if speeding up to it saves too little time.

        With the train's speed v, the curve's speed c here, acceleration a and braking b, the train reaches
        u² = (b·v² + a·c²)/(a + b), over a distance of (c² − v²)/(2b), in the time (u − v)·(1/a + 1/b).
        """
        gain, braking = self._acceleration_mps2(i, curve_mps), self._braking_mps2
        if v_mps >= curve_mps or gain <= 0:
            return 0.0
        reached = math.sqrt((braking * v_mps**2 + gain * curve_mps**2) / (gain + braking))
        way_m = (curve_mps**2 - v_mps**2) / (2.0 * braking)
        takes_s = (reached - v_mps) * (1.0 / gain + 1.0 / braking)
        saves_s = way_m / v_mps - takes_s if v_mps > 0 else math.inf
        return reached if saves_s >= BRAKED_EARLY_S else 0.0

    def _acceleration_mps2(self, i: int, v_mps: float) -> float:
        """The acceleration (m/s²) that full traction gives in an interval at a speed."""
        line = self._section.for_kernels
        here = on_supply(self._section.train, float(line.supply[i]))
        resisting_n = mean_resistance(v_mps, v_mps, float(line.tunnel_n_per_mps2[i]), here) + float(line.constant_n[i])
        return float(largest_gain(v_mps, resisting_n, here))


def _feet(falls: NDArray[np.bool_], ends_mps: Floats) -> Floats:
    """The speed at the foot of the falling part of a curve that contains or follows each interval."""
    feet = ends_mps.copy()
    for i in range(len(falls) - 2, -1, -1):
        if falls[i + 1]:
            feet[i] = feet[i + 1]
    return feet


class ReducedSpeed:
    """The reduced maximum speed of a section: the single top speed with which the train keeps the timetable.

    It is computed at the departure and again at regular intervals, and is constant in between.
    """

    def __init__(self, section: Section) -> None:
        easy_mps2 = min(EASY_BRAKING_MPS2, section.train.max_deceleration_mps2)
        easy = section.train._replace(max_deceleration_mps2=easy_mps2)
        ceiling, _ = braking_envelope(section.for_kernels, section.limit_mps, section.end_speed_mps, easy, FULL_BRAKES)
        # On a descent too steep for gentle braking, the section's envelope is used.
        self._ceiling_mps = np.minimum(np.maximum(ceiling, section.floor_mps), section.envelope_mps)
        self._section = section
        self._staircase = Staircase(section, self._ceiling_mps, easy_mps2)
        self._judged_ns, self._for_ns, self._speed_mps = 0, 0, math.nan

    def shown_mps(self, s_m: float, v_mps: float, now_ns: int, arrival_ns: int) -> float:
        """The top speed to show (m/s): the reduced maximum speed, or a lower one that applies here or ahead."""
        return self._staircase.at(s_m, v_mps, self.judged_mps(s_m, v_mps, now_ns, arrival_ns))

    def judged_mps(self, s_m: float, v_mps: float, now_ns: int, arrival_ns: int) -> float:
        """The reduced maximum speed (m/s) for the rest of the section; recomputed only if the last value is old."""
        age_s = (now_ns - self._judged_ns) * NS
        if math.isnan(self._speed_mps) or arrival_ns != self._for_ns or not 0 <= age_s < JUDGED_EVERY_S:
            before_mps = self._speed_mps if arrival_ns == self._for_ns else math.nan
            self._judged_ns, self._for_ns = now_ns, arrival_ns
            self._speed_mps = self._judged(s_m, v_mps, (arrival_ns - now_ns) * NS, before_mps)
        return self._speed_mps

    def _judged(self, s_m: float, v_mps: float, left_s: float, before_mps: float) -> float:
        low, high = SLOWEST_MPS, max(float(self._ceiling_mps.max()), SLOWEST_MPS)
        least_s = self.time_s(s_m, v_mps, high)
        if least_s >= left_s:
            return high
        ample = left_s > LONGEST_RATIO * least_s
        if ample and not math.isnan(before_mps):
            return before_mps
        left_s = LONGEST_RATIO * least_s if ample else left_s
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.time_s(s_m, v_mps, middle) > left_s else (low, middle)
        return high

    def time_s(self, s_m: float, v_mps: float, top_mps: float) -> float:
        """The time (s) to the section's end under a top speed, with gentle braking; inf if a hill stops the train."""
        section = self._section
        first = int(np.searchsorted(section.node_m, s_m, side="right")) - 1
        first = min(max(first, 0), len(section.step_m) - 1)
        cap = np.maximum(np.minimum(self._ceiling_mps[first:], top_mps), section.floor_mps[first:])
        line = LineArrays(*(array[first:].copy() for array in section.for_kernels))
        line.step_m[0] = max(float(section.node_m[first + 1]) - s_m, 1e-3)
        speeds = np.empty(len(cap))
        speeds[0] = min(v_mps, cap[0] / BELOW_RATIO)
        took_s = float(fastest_roll_out(line, cap, section.train, speeds))
        return took_s if took_s >= 0 else math.inf


BEFORE_S: Final = 4.0
"""Lead (s) with which full braking is shown: advice is valid for 3 s, and brakes need time to act."""
SLOW_MPS: Final = 4.0
"""Speed (m/s) below which `BEFORE_M` and `LEAST_S` count instead of `BEFORE_S`."""
BEFORE_M: Final = 5.0
"""Lead (m) with which full braking is shown to a slow train, which stops short by no more than that."""
LEAST_S: Final = 2.0
"""Least lead (s) with which full braking is shown to a slow train: the time that a driver takes to act."""
WEAK_BRAKE_RATIO: Final = 0.6
"""Share of the full effort below which electric braking is shown as coasting: the four modes have only the full
brake, which would be too early."""


class SimplerDisplay:
    """The content of a display with one top speed or with four modes on one section, second by second."""

    def __init__(self, section: Section) -> None:
        self.section, self._planner = section, Planner(section)
        self._reduced = ReducedSpeed(section)

    def look(self, advice: Any, departure_ns: int, arrival_ns: int) -> SimplerLook:
        """The part of advice (`Advice`, or its message) to show; the times (ns since 1970) are those of the section."""
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
        """The top speed (m/s); before the departure, of the trip ahead; NaN for a train that has arrived."""
        if mode is Regime.NONE or (mode is Regime.STOP and advice.s_m > self.section.start_m + AT_STOP_M):
            return math.nan
        if advice.predicted_arrival_ns:  # by the timetable or by traffic management
            arrival_ns = advice.predicted_arrival_ns - round(advice.predicted_deviation_s / NS)
        now_ns = max(advice.time_ns, departure_ns) if mode is Regime.STOP else advice.time_ns
        return self._reduced.shown_mps(max(advice.s_m, self.section.start_m), advice.speed_mps, now_ns, arrival_ns)

    def _four(self, advice: Any, mode: Regime, after: Regime) -> tuple[Regime, Regime, float]:
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
    """The display of a whole run: a `SimplerDisplay` for each section, replaced when the restrictions change."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._for: tuple[int, tuple[Restriction, ...]] | None = None
        self._shown: SimplerDisplay | None = None

    def look(self, advice: Any, number: int, told: tuple[Any, ...]) -> SimplerLook | None:
        """The part of advice to show on a section (by number) under the received restrictions; None to show nothing."""
        if int(advice.mode) == Regime.NONE:
            return None
        service, table = self._service, self._service.timetables[number]
        start_m, end_m = (stop.position_m for stop in service.stops[number : number + 2])
        situation = replace(service.situation, restrictions=tuple(judged(one) for one in told))
        situation = situation.at(advice.time_ns).between(start_m, end_m)
        if self._for != (number, situation.restrictions):
            self._for, self._shown = (number, situation.restrictions), None
        try:
            if self._shown is None:
                self._shown = SimplerDisplay(situation.section_ahead(start_m, end_m, advice.s_m))
        except DasError:  # The node reports why there is no advice.
            return None
        return self._shown.look(advice, table.departure_ns, table.arrival_ns)


class FourModes(NamedTuple):
    """The choice of the mode that may be shown: full traction, hold a speed, coast, full brake.

    `held_mps` is the highest speed that may be advised to hold (m/s), `excess_mps` the train's excess over the allowed
    speed (m/s).
    """

    valid_for_s: float
    planner: Planner
    state: TrainState
    held_mps: float
    excess_mps: float

    def safe(self, four: Regime, mode: Regime) -> Regime:
        """The mode `four` if it is safe, else whichever of the four modes the limits and the stop ahead require.

        `mode` is the mode on the other displays. If they show braking, however weak, to a train that is too fast, the
        result is full braking.
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
            return Regime.CRUISE  # Coasting would not slow the train to the limit.
        return four

    def _may_creep(self) -> bool:
        """Whether a slow train may be advised to hold a speed, because it would stop short if it coasted."""
        before_s = max(BEFORE_M / max(self.held_mps, 0.1), LEAST_S)
        return self.state.v_mps <= SLOW_MPS and not brakes_late(self.planner, self.state, self.held_mps, before_s)

    def full_brake_due_s(self, four: Regime) -> float:
        """The number of whole seconds after which full braking must follow the mode `four`.

        Infinity if full braking is not needed while the advice is valid, or if `four` is full braking.
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
        """The acceleration (m/s²) of the train with full traction if `four` is full traction, else while coasting."""
        full = 1.0 if four is Regime.FULL_TRACTION else 0.0
        return self.planner.ahead.accelerates_mps2(full, self.state.s_m, self.state.v_mps)


def brakes_late(planner: Planner, state: TrainState, v_mps: float, within_s: float) -> bool:
    """Whether full braking comes too late for the limits and the stop ahead if it begins after `within_s` (s).

    Until then the train keeps the speed `v_mps`.
    """
    section, from_m = planner.section, state.braked_m
    lowest_w = kernels.lowest_w(from_m, from_m + v_mps * within_s, section.node_m, planner.allowed_w)
    return math.sqrt(lowest_w) < min(v_mps, planner.allowed_mps(state.s_m)) - BEGINS_MPS


VALID_S = 3600.0
"""Validity (s) of an instruction of the sheet in the driver's view: a sheet does not expire."""
LEFT_LATE_S = 60.0
"""Largest lateness (s) of a departure with which the driver follows the sheet; if later, the driver ignores it."""
HELD_UP_MPS = 5.0
"""Largest shortfall (m/s) below the sheet's speed with which a driver coasts and brakes as the sheet instructs."""
SHEETS_KEPT = 256
_MODES = {
    InstructionKind.HOLD: Regime.CRUISE,
    InstructionKind.COAST: Regime.COAST,
    InstructionKind.BRAKE: Regime.REDUCED_BRAKE,
}


class PaperSheet:
    """The sheet of a run, read at the position of the train."""

    def __init__(self, day: Day) -> None:
        self._service = day.service

    def look(self, state: PlantState, calls: Calls, now_ns: int) -> AdviceView | None:
        """The sheet's instruction in a state; None if the driver ignores it because the train is late or held up."""
        zero_ns = self._service.timetables[0].departure_ns
        blank = AdviceView(
            time_s=(now_ns - zero_ns) * NS,
            valid_until_s=(now_ns + round(VALID_S / NS) - zero_ns) * NS,
            presentation=Presentation.SHEET,
            mode=int(Regime.STOP),
        )
        if calls.finished:
            return blank
        sheet = self._sheet(calls.section)
        lines = sheet.lines
        if calls.waits:
            return replace(
                blank, mode=int(Regime.DEPART), next_mode=_mode(lines[0]), next_speed_mps=lines[0].speed_mps,
                next_effort_ratio=lines[0].effort_ratio,
            )  # fmt: skip
        due_ns = self._service.timetables[calls.section].departure_ns
        late_s = calls.departures[-1].time_s - self._service.clock_s(due_ns)
        number = sum(line.posted_m <= state.s_m for line in lines[1:])
        if late_s > LEFT_LATE_S or _held_up(sheet, lines[number], state):
            return None
        return self._said(blank, lines, number, state)

    def _said(self, blank: AdviceView, lines: tuple[SheetLine, ...], number: int, state: PlantState) -> AdviceView:
        line, efforts = lines[number], Efforts.at(state.speed_mps, self._service.line.train)
        braking = line.kind is InstructionKind.BRAKE
        following = lines[number + 1] if number + 1 < len(lines) else None
        end_m = self._service.stops[-1].position_m if following is None else following.posted_m
        way_m = max(end_m - state.s_m, 0.0)
        said = replace(
            blank, mode=_mode(line), speed_mps=line.speed_mps, display_speed_mps=line.speed_mps, target_way_m=way_m,
            lever_ratio=line.effort_ratio if _mode(line) in TRACTION else math.nan,
            force_n=-efforts.brakes_n if braking else line.effort_ratio * efforts.traction_n,
        )  # fmt: skip
        if following is None:
            return said
        return replace(
            said, next_mode=_mode(following), next_speed_mps=following.speed_mps,
            next_effort_ratio=following.effort_ratio, next_change_s=way_m / max(state.speed_mps, 1.0),
        )  # fmt: skip

    def _sheet(self, number: int) -> SectionSheet:
        service = self._service
        table, front = service.timetables[number], service.fronts[number]
        braking = service.scenario.braking.of(service.vehicle)
        point_m, window = _window(service, number)
        return _made(front, braking, (table.arrival_ns - table.departure_ns) * NS, point_m, window)


@lru_cache(maxsize=SHEETS_KEPT)
def _made(
    front: Front, braking: ServiceBraking, time_s: float, point_m: float | None, window: Window | None
) -> SectionSheet:
    return section_sheet(with_braking(front.section, braking), time_s, point_m, window)


def _window(service: Service, number: int) -> tuple[float | None, Window | None]:
    """The first passing of a section with a window to be enforced, and that window (s from the departure)."""
    departs_ns = service.timetables[number].departure_ns
    first_m, last_m = (service.stops[i].position_m for i in (number, number + 1))
    for due in service.passings:
        if first_m < due.s_m < last_m and not due.wish and (due.earliest_ns or due.latest_ns):
            earliest_s = (due.earliest_ns - departs_ns) * NS if due.earliest_ns else -math.inf
            latest_s = (due.latest_ns - departs_ns) * NS if due.latest_ns else math.inf
            return due.s_m, Window(earliest_s=earliest_s, latest_s=latest_s)
    return None, None


def _mode(line: SheetLine) -> int:
    return int(_MODES.get(line.kind, departure_regime(line.effort_ratio)))


def _held_up(sheet: SectionSheet, line: SheetLine, state: PlantState) -> bool:
    """Whether a train is so slow that coasting or braking by the sheet would stop it short of its place."""
    slows = line.kind in (InstructionKind.COAST, InstructionKind.BRAKE)
    return slows and state.speed_mps < sheet.speed_at(state.s_m) - HELD_UP_MPS
